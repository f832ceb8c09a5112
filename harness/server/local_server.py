"""A web server for one person on one machine: 127.0.0.1, a token, bounded, and ended with the process that runs it."""

from __future__ import annotations

import os
import secrets
import socket
import sys
import webbrowser
from typing import TYPE_CHECKING

from vfoa.errors import VfoaError

if TYPE_CHECKING:
    from starlette.types import ASGIApp

HOST = "127.0.0.1"
MOST_CONNECTIONS = 64
"""Requests beyond this number of open connections get 503. A browser opens six to a host."""


class LocalServer:
    """Serves an application behind a :class:`harness.server.guard.Guard`; it takes its port when it is made.

    When it ends, it waits ``patience_s`` seconds for running answers. Without a ``token`` it makes a new one.

    Raises
    ------
    VfoaError
        If the port is taken or not allowed.
    """

    def __init__(self, app: ASGIApp, port: int = 0, *, patience_s: int = 1, token: str | None = None) -> None:
        import uvicorn

        from harness.server.guard import Guard

        self._token = token or secrets.token_urlsafe(24)
        config = uvicorn.Config(
            Guard(app, self._token),
            http="h11",
            limit_concurrency=MOST_CONNECTIONS,
            log_level="error",
            access_log=False,
            lifespan="off",
            ws="none",
            proxy_headers=False,
            timeout_graceful_shutdown=patience_s,
        )
        self._server = uvicorn.Server(config)
        self._listener = _listen(port)
        self.port: int = self._listener.getsockname()[1]

    @property
    def address(self) -> str:
        """The address of ``/``, with the token."""
        return self.address_of("/")

    def address_of(self, path: str) -> str:
        """The address of a path that a person opens, with the token."""
        return f"http://{HOST}:{self.port}{path}{'&' if '?' in path else '?'}token={self._token}"

    def run(self) -> None:
        """Serve until Ctrl-C, a signal that does the same, or :meth:`stop`."""
        try:
            self._server.run(sockets=[self._listener])
        finally:
            self.close()

    def stop(self) -> None:
        """End :meth:`run`, from another thread."""
        self._server.should_exit = True

    def close(self) -> None:
        """Release the port."""
        self._listener.close()


def _listen(port: int) -> socket.socket:
    """Return a socket that listens on 127.0.0.1; port 0 is any free port."""
    # named as TCP, or asyncio leaves Nagle's algorithm on: every body then waits 40 ms for the receipt of its header
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((HOST, port))
    except OSError as error:
        listener.close()
        raise VfoaError(f"--port {port}: cannot listen on {HOST}: {error.strerror}") from None
    listener.listen()
    return listener


def forwarding(port: int) -> str | None:
    """The command that brings a port to the machine of somebody who is logged in by SSH; None for whoever is not."""
    connection = os.environ.get("SSH_CONNECTION", "").split()  # the client's address and port, then this machine's
    return f"ssh -N -L {port}:{HOST}:{port} {connection[2]}" if len(connection) == 4 else None


def open_browser(address: str) -> None:
    """Open the person's own browser, if there is a display."""
    if sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(address)
