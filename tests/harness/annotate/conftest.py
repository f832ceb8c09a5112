"""A working directory with a small clip on disk, and its labelling page."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tests.annotating import Page, make_work, serve


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
