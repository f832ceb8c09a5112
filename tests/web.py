"""A web server on this machine that can be told to misbehave."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING

from harness.server.local_server import LocalServer

if TYPE_CHECKING:
    from starlette.types import ASGIApp


class Site:
    """Files by path, and what the server was asked.

    ``cut_after``: break the connection after so many bytes of each answer. ``ranges``: whether parts are given.
    ``kind``: the content type that every answer claims.
    """

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}
        self.moved: dict[str, str] = {}
        self.asked: list[tuple[str, str | None]] = []
        self.cut_after: int | None = None
        self.ranges = True
        self.kind: str | None = None
        self.address = ""

    def url(self, path: str) -> str:
        """The address of a path."""
        return self.address + path


@contextmanager
def serve() -> Iterator[Site]:
    """Run a server on 127.0.0.1 until the block ends."""
    site = Site()
    server = ThreadingHTTPServer(("127.0.0.1", 0), _handler(site))
    site.address = f"http://127.0.0.1:{server.server_address[1]}"
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield site
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def _handler(site: Site) -> type[BaseHTTPRequestHandler]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            wanted = self.headers.get("Range")
            site.asked.append((self.path, wanted))
            if self.path in site.moved:
                self.send_response(302)
                self.send_header("Location", site.moved[self.path])
                self.end_headers()
            elif self.path in site.files:
                self._send(site.files[self.path], wanted)
            else:
                self.send_error(404)

        def _send(self, content: bytes, wanted: str | None) -> None:
            first = int(wanted.removeprefix("bytes=").removesuffix("-")) if wanted and site.ranges else 0
            if first and first >= len(content):
                self.send_error(416)
                return
            self.send_response(206 if first else 200)
            self.send_header("Content-Length", str(len(content) - first))
            if site.kind:
                self.send_header("Content-Type", site.kind)
            if first:
                self.send_header("Content-Range", f"bytes {first}-{len(content) - 1}/{len(content)}")
            self.end_headers()
            end = None if site.cut_after is None else first + site.cut_after
            self.wfile.write(content[first:end])

        def log_message(self, format: str, *args: object) -> None:
            pass

    return Handler


@contextmanager
def running(app: ASGIApp) -> Iterator[LocalServer]:
    """Run an application on 127.0.0.1 until the block ends."""
    server = LocalServer(app)
    thread = threading.Thread(target=server.run)
    thread.start()
    try:
        yield server
    finally:
        server.stop()
        thread.join()
