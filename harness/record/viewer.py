"""Rerun's viewer, opened at a frame: in a window, in a file, in a notebook, and as files for a browser.

By default the program sends usage statistics and looks up the newest version, and there is no option against either: it
is started without any network, and stopped by its caller. Its own server of the web viewer sends no content policy, and
its page makes three requests to the network, so that only the files are taken from it.
"""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any, BinaryIO

import httpx
import rerun as rr
import rerun_cli
from rerun.experimental import ViewerClient

from harness.files.io import atomic_write
from harness.record.composed import Composed
from harness.record.reading import reading
from harness.server.local_server import HOST
from vfoa.errors import VfoaError

if TYPE_CHECKING:
    from rerun.notebook import Viewer

_CONNECT_S = 30.0
_DRAWN_S = 120.0
_POLL_S = 0.3
_ENDS_S = 5.0
"""Time in which a viewer that does not answer any more has ended."""
_NOTEBOOK_PX = 640
_NOWHERE = "http://127.0.0.1:9"
"""A proxy that does not answer, so that network requests fail at once."""
_WEB_FILES = ("re_viewer.js", "re_viewer_bg.wasm", "favicon.ico")
_RETRIES = 7
"""Attempts to connect, after pauses of 0, 0.5, 1, 2 ... 16 s: 30 s in all."""

_NO_GLYPH = re.compile(r'No glyph for "(.+?)" \((U\+[0-9A-F]+)\)')
"""The viewer without a window panics at a letter that its font lacks; the one in a browser draws a box."""

INSTEAD = "--web shows a recording in a browser, --screenshot PNG draws it into a file"
"""Advice for a machine without a display."""


def show(recordings: Sequence[Composed], frame: int | None) -> None:
    """Open recordings in a window, the first one at ``frame``; returns when the window is closed.

    Raises
    ------
    VfoaError
        If the viewer cannot be started, for example without a display.
    """
    with _viewer([]) as (process, client):
        _open(client, recordings, frame)
        process.wait()


GoTo = Callable[[Composed, int, Sequence[str]], None]
"""Shows a recording at a frame, with these tabs in front."""


@contextmanager
def opened(options: Sequence[str] = (), *, instead: str = INSTEAD) -> Iterator[GoTo]:
    """Yield a function that shows recordings in one viewer, any number of times.

    ``options`` are the viewer's own, ``--headless`` for one without a window. It is stopped at the end. ``instead``
    says what to do without a display.

    Raises
    ------
    VfoaError
        If the viewer cannot be started, a recording is missing, or the window was closed.
    """
    known: set[tuple[Path, ...]] = set()
    with _viewer(options, instead) as (process, client):

        def go_to(recording: Composed, frame: int, tabs: Sequence[str]) -> None:
            if process.poll() is not None:
                raise VfoaError("the Rerun viewer: expected an open window, found that it was closed")
            recording.expect_files()
            if recording.files in known:
                client.open(str(recording.files[-1]))  # bring it to the front again
                client.set_time("frame", sequence=frame, play_state="paused")
            else:
                known.add(recording.files)
                _open(client, [recording], frame)
            if tabs:
                _bring_to_front(client, tabs)

        yield go_to


def screenshot(recording: Composed, frame: int | None, png: Path, *, size: tuple[int, int] = (1600, 900)) -> None:
    """Draw a recording at a frame into a PNG file, without a display; ``size`` is (width, height) in pixels.

    Needs a Vulkan driver; one that runs on the CPU is enough (on Debian: mesa-vulkan-drivers, libvulkan1).

    Raises
    ------
    VfoaError
        If the viewer cannot be started, or still draws after two minutes.
    """
    options = ["--headless", "--window-size", f"{size[0]}x{size[1]}"]
    with _viewer(options) as (_, client):
        _open(client, [recording], frame)
        atomic_write(png, _settled_picture(client))


def show_recording(recording: Composed, frame: int | None) -> Viewer:
    """Return a viewer that shows a recording, as the last value of a cell; with ``frame``, it opens there.

    Raises
    ------
    VfoaError
        If the notebook part of Rerun is not installed, or the recording cannot be read.
    """
    from rerun.notebook import HAS_NOTEBOOK, Viewer

    if not HAS_NOTEBOOK:
        raise VfoaError('the notebook viewer is not installed; install it: pip install "vfoa[notebook]"')
    stream = rr.RecordingStream(recording.application_id)
    viewer = Viewer(width="auto", height=_NOTEBOOK_PX, recording=stream)
    with tempfile.TemporaryDirectory() as scratch:
        for file in recording.files_to_open(Path(scratch)):
            with reading(file):
                stream.log_file_from_path(file)
        stream.flush()
    if frame is not None:
        viewer.set_time_ctrl(timeline="frame", sequence=frame)
    return viewer


def _open(client: ViewerClient, recordings: Sequence[Composed], frame: int | None) -> None:
    # the one opened last is in front
    for recording in reversed(recordings):
        with tempfile.TemporaryDirectory() as scratch:
            # the layout first, since an open recording keeps its own
            client.open([*map(str, recording.files_to_open(Path(scratch)))])
    if frame is not None:
        client.set_time("frame", sequence=frame, play_state="paused")


def _bring_to_front(client: ViewerClient, tabs: Sequence[str]) -> None:
    """Select the tab of the first name, within it that of the second, and so on; names without a tab are skipped."""
    layout = client.get_blueprint().blueprint
    containers = {
        path.lstrip("/"): entry["ContainerBlueprint"] for path, entry in layout.items() if "ContainerBlueprint" in entry
    }
    within = set(containers)
    for tab in tabs:
        paths = [path for path in within if containers[path].get("display_name") == tab]
        for path in paths[:1]:
            for parent in containers.values():
                if path in _contents(parent) and parent.get("container_kind") == "Tabs":
                    parent["active_tab"] = path
            within = _below(containers, path)
    client.set_blueprint(layout, of="recording")


def _contents(container: Mapping[str, Any]) -> list[str]:
    contents = container.get("contents", [])
    return [contents] if isinstance(contents, str) else list(contents)


def _below(containers: Mapping[str, Mapping[str, Any]], path: str) -> set[str]:
    inside = {child for child in _contents(containers[path]) if child in containers}
    return inside.union(*(_below(containers, child) for child in inside))


def _settled_picture(client: ViewerClient) -> bytes:
    """Return a screenshot that equals the one before it, which means that loading and layout are finished."""
    deadline = time.monotonic() + _DRAWN_S
    before = b""
    while time.monotonic() < deadline:
        time.sleep(_POLL_S)
        try:
            now = client.take_screenshot()
        except TimeoutError:  # the client waits 15 s, in which a busy machine may not draw one picture
            continue
        if now == before:
            return now
        before = now
    raise VfoaError(f"the Rerun viewer: expected a settled picture within {_DRAWN_S:.0f} s, found none")


@contextmanager
def _viewer(options: Sequence[str], instead: str = INSTEAD) -> Iterator[tuple[subprocess.Popen[bytes], ViewerClient]]:
    port = free_port()
    arguments = ["--bind", HOST, "--port", str(port), "--hide-welcome-screen", *options]
    # a file, since a full pipe that nobody reads would block the viewer
    with tempfile.TemporaryFile() as stderr, started(arguments, stderr) as process:
        try:
            yield process, _connect(process, port, stderr, instead)
        except ConnectionError as error:
            raise _ended(process, stderr, instead) or VfoaError(
                f"the Rerun viewer: found no answer ({error})"
            ) from None
        except TimeoutError as error:
            raise VfoaError(
                f"the Rerun viewer: found no answer ({error}); try again when the machine is idle"
            ) from None


def _connect(process: subprocess.Popen[bytes], port: int, stderr: BinaryIO, instead: str) -> ViewerClient:
    deadline = time.monotonic() + _CONNECT_S
    while time.monotonic() < deadline:
        try:
            return ViewerClient.connect(f"rerun+http://{HOST}:{port}/proxy")
        except Exception:  # the client has no error type of its own for "not yet there"
            if ended := _ended(process, stderr, instead, _POLL_S):
                raise ended from None
    raise VfoaError(f"the Rerun viewer: expected an answer within {_CONNECT_S:.0f} s, found none")


def _ended(
    process: subprocess.Popen[bytes], stderr: BinaryIO, instead: str, wait_s: float = _ENDS_S
) -> VfoaError | None:
    """Why the viewer has ended; None if it runs ``wait_s`` seconds later: it may answer before it has a window."""
    try:
        process.wait(wait_s)
    except subprocess.TimeoutExpired:
        return None
    stderr.seek(0)
    lines = stderr.read().decode(errors="replace").strip().splitlines()
    reason = _panic(lines) or (lines[-1] if lines else "it printed no reason")
    if "DISPLAY" in reason:
        return VfoaError(f"the Rerun viewer: found no display to open its window on; {instead}")
    if glyph := _NO_GLYPH.search(reason):
        return VfoaError(
            f"the Rerun viewer: found {glyph[1]} ({glyph[2]}) in a name of the recording; expected letters of its font "
            "(Latin, Greek, Cyrillic): --web shows the recording, with a box in place of such a letter"
        )
    return VfoaError(f"the Rerun viewer ended with status {process.returncode}: {reason}")


def _panic(lines: Sequence[str]) -> str | None:
    """The message of the first panic in what the viewer printed, None without one.

    Rerun prints ``thread 'main' panicked at 'MESSAGE'``, Rust ``thread 'main' panicked at FILE:LINE:COLUMN:``, then the
    message in the next line.
    """
    for line, after in zip(lines, [*lines, ""][1:], strict=True):
        _, is_panic, rest = line.partition(" panicked at ")
        if is_panic:
            return rest.strip("'") if rest.startswith("'") else after.strip() or rest
    return None


def free_port() -> int:
    """Return a free port of this machine."""
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])


def web_viewer_files() -> dict[str, bytes]:
    """Return the page ``viewer.html`` and the files that it loads, by name, as read from Rerun's own server.

    Raises
    ------
    VfoaError
        If it does not answer, or has other files (another version of Rerun).
    """
    port = free_port()
    ports = ["--port", str(free_port()), "--web-viewer-port", str(port)]
    address = f"http://{HOST}:{port}"
    with (
        started(["--serve-web", "--bind", HOST, *ports]),
        httpx.Client(base_url=address, trust_env=False, transport=httpx.HTTPTransport(retries=_RETRIES)) as client,
    ):
        return page_files() | {name: _fetched(client, name) for name in _WEB_FILES}


def page_files() -> dict[str, bytes]:
    """Return the files of the page itself."""
    return {file.name: file.read_bytes() for file in Path(__file__).with_name("viewer_page").iterdir()}


def _fetched(client: httpx.Client, name: str) -> bytes:
    try:
        response = client.get(f"/{name}")
        response.raise_for_status()
    except httpx.HTTPError as error:
        raise VfoaError(f"the Rerun web viewer: expected a file {name}, found none: {error}") from None
    return response.content


def viewer_binary() -> Path:
    """The viewer inside the Rerun package. Ending the ``rerun`` command, a wrapper, would leave the viewer running."""
    return Path(rerun_cli.__file__).with_name("rerun")


@contextmanager
def started(
    arguments: Sequence[str], stderr: IO[bytes] | int = subprocess.DEVNULL
) -> Iterator[subprocess.Popen[bytes]]:
    """Run the program with these arguments until the block ends, for whatever reason."""
    with tempfile.TemporaryDirectory(prefix="vfoa-") as folder:
        analytics = Path(folder) / "rerun" / "analytics.json"
        analytics.parent.mkdir()
        off = {"analytics_enabled": False, "analytics_id": "", "metadata": {}}
        paths = {"config_file_path": str(analytics), "data_dir_path": str(analytics.parent)}
        analytics.write_text(json.dumps(off | paths), encoding="utf-8")
        inherited = {name: value for name, value in os.environ.items() if name.lower() != "no_proxy"}
        proxies = ("all_proxy", "http_proxy", "https_proxy")
        nowhere = dict.fromkeys([*proxies, *map(str.upper, proxies)], _NOWHERE)
        environment = inherited | nowhere | {"XDG_CONFIG_HOME": folder, "TMPDIR": folder}  # it leaves a folder there
        command = [str(viewer_binary()), *arguments]
        process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=stderr)
        try:
            yield process
        finally:
            process.kill()  # it has nothing to save
            process.wait()
