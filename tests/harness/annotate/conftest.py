"""A working directory with a small clip on disk, and its labelling page."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from harness.annotate.session import Session
from tests.annotating import LabellingPage, Page, make_work, serve

if TYPE_CHECKING:
    from selenium.webdriver import Chrome


@pytest.fixture
def work(tmp_path: Path) -> Path:
    return make_work(tmp_path)


@pytest.fixture
def noise(work: Path) -> Iterator[Callable[..., Page]]:
    """Serves the clip with the choices it is given."""
    with ExitStack() as stack:

        def start(**choices: Any) -> Page:
            return stack.enter_context(serve(clip=str(work / "datasets" / "noise.toml"), **choices))

        yield start


@pytest.fixture
def open_page(browser: Chrome, noise: Callable[..., Page]) -> Callable[..., LabellingPage]:
    """Opens the clip's page in the browser, with the choices it is given."""
    return lambda **choices: LabellingPage(browser, noise(**choices))


@pytest.fixture
def opened(work: Path) -> Iterator[Any]:
    """Opens the clip ``noise`` with the choices it is given."""
    sessions: list[Session] = []

    def start(**choices: Any) -> Session:
        sessions.append(Session(str(work / "datasets" / "noise.toml"), **choices))
        return sessions[-1]

    yield start
    for session in sessions:
        session.close()
