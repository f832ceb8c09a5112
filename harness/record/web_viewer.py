"""The web viewer inside the Rerun package, and the page that opens a recording in it, as files to serve.

Rerun's own server sends no content policy, and its page makes three requests to the network: for a font, for the newest
version, and to report that it was started.
"""

from __future__ import annotations

from pathlib import Path

import httpx

from harness.record import program
from harness.record.viewer import free_port
from harness.server.local_server import HOST
from vfoa.errors import VfoaError

NAMES = ("re_viewer.js", "re_viewer_bg.wasm", "favicon.ico")
_RETRIES = 7
"""Attempts to connect, after pauses of 0, 0.5, 1, 2 ... 16 s: 30 s in all."""


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
        program.started(["--serve-web", "--bind", HOST, *ports]),
        httpx.Client(base_url=address, trust_env=False, transport=httpx.HTTPTransport(retries=_RETRIES)) as client,
    ):
        return page_files() | {name: _fetched(client, name) for name in NAMES}


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
