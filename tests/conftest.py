"""Examples of property tests, the browser, and the folders of real clips and weights, without which tests skip."""

from __future__ import annotations

import gc
import os
import sys
from collections.abc import Generator, Iterator
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import typer.testing
from hypothesis import HealthCheck, settings

import harness  # noqa: F401  # sets the limit of OpenCV, which other tests import before it
from tests.browser import chromium, requested, set_width
from tests.disk import share_rendered_frames
from tests.repository import REPOSITORY

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

# Compiled modules are kept, whatever the surroundings say: the suite starts hundreds of processes, each of which would
# compile all that it imports.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False
os.environ.pop("SSH_CONNECTION", None)  # whoever is logged in from elsewhere is told one line more

# Properties are tried on the same examples in every run of the suite, and on many others by `make explore`.
PROPERTIES = {"deadline": None, "suppress_health_check": [HealthCheck.function_scoped_fixture]}
settings.register_profile("suite", derandomize=True, max_examples=20, **PROPERTIES)
settings.register_profile("explore", max_examples=1000, **PROPERTIES)


def pytest_configure(config: pytest.Config) -> None:
    """Use the suite's number of examples unless another is requested. Not on import, which tests may repeat."""
    if not config.getoption("--hypothesis-profile"):
        settings.load_profile("suite")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Keep the imported modules and the tests, two million objects, out of Python's search for garbage.

    Otherwise every tenth second of the suite is spent on that. What tests leave is searched less often than usual.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(20_000)
        gc.enable()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One worker more than there are cores: many tests wait for a browser or a server."""
    return (os.cpu_count() or 1) + 1


def _folder(variable: str, name: str) -> Path:
    folder = Path(os.environ.get(variable) or REPOSITORY.parent / "shared" / name)
    if not folder.is_dir():
        pytest.skip(f"needs {variable} or ../shared/{name}: no folder {folder}")
    return folder


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real clips."""
    return _folder("VFOA_DATA", "data")


@pytest.fixture(scope="session")
def shared_models() -> Path:
    """The folder of real weights."""
    return _folder("VFOA_MODELS", "models")


@pytest.fixture(scope="session")
def default_models(shared_models: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the real weights that a default run finds: those of the folder, 3DDFA_V2's beside them."""
    if not (tddfa := shared_models / "3ddfa_v2" / "mb05_120x120.onnx").is_file():
        pytest.skip(f"needs 3DDFA_V2: no file {tddfa}")
    folder = tmp_path_factory.mktemp("models")
    for file in (*shared_models.glob("*.onnx"), tddfa):
        (folder / file.name).symlink_to(file)
    return folder


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep stage outputs apart from the user's; rendered frames stay in place, since rendering is slow."""
    with pytest.MonkeyPatch.context() as patch:
        share_rendered_frames(folder := tmp_path_factory.mktemp("caches") / "own")
        patch.setattr("harness.files.folders.platform_cache", lambda: folder)
        yield


@pytest.fixture(scope="session", autouse=True)
def _no_waiting_for_disks() -> Iterator[None]:
    """Do not wait until a file is on the disk, nor, later, until one that is there is removed: 6 ms for each."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", lambda file: None)
        yield


@pytest.fixture(scope="session", autouse=True)
def _commands_are_built_once() -> Iterator[None]:
    """Give a runner of Typer the same commands for each call, as the program does: to build them takes 0.2 s."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(typer.testing, "_get_command", cache(typer.testing._get_command))
        yield


@pytest.fixture(autouse=True)
def _no_real_time() -> Iterator[None]:
    """End each test with the scheduling it began with: for root, an encoder may make this process a real-time one.

    Whatever it starts afterwards, a browser for example, would be one too, and two of them can stop the machine.
    """
    if not hasattr(os, "sched_getscheduler"):
        yield
        return
    usual = os.sched_getscheduler(0)
    yield
    assert os.sched_getscheduler(0) == usual


@pytest.fixture(scope="session")
def chrome(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chrome]:
    """The browser of all tests of a process; it takes seconds to start."""
    with chromium(tmp_path_factory.mktemp("profile")) as browser:
        yield browser


@pytest.fixture
def browser(chrome: Chrome) -> Chrome:
    """The browser, 1280 pixels wide, with an empty page and without what it said and asked for in earlier tests."""
    chrome.get("about:blank")
    chrome.get_log("browser")
    requested(chrome)
    set_width(chrome, 1280)
    return chrome
