"""The page's server: one socket on 127.0.0.1, one token, an end by Ctrl-C or SIGTERM."""

from __future__ import annotations

import secrets
import socket

import uvicorn

from harness.annotate.app import create_app
from harness.annotate.session import Session
from vfoa.errors import VfoaError


class PageServer:
    """Serves one clip's page; the address is known, and taken, from the start.

    Raises
    ------
    VfoaError
        If the port is taken.
    """

    def __init__(self, session: Session, port: int = 0) -> None:
        self._token = secrets.token_urlsafe(24)
        self._socket = _listen(port)
        self.port: int = self._socket.getsockname()[1]
        config = uvicorn.Config(
            create_app(session, self._token),
            log_level="warning",
            lifespan="off",
            ws="none",
            server_header=False,
        )
        self._server = uvicorn.Server(config)

    @property
    def address(self) -> str:
        """Where the page is, with the token."""
        return f"http://127.0.0.1:{self.port}/?token={self._token}"

    def run(self) -> None:
        """Serve until the process is told to end, or :meth:`stop` is called."""
        try:
            self._server.run(sockets=[self._socket])
        finally:
            self._socket.close()

    def stop(self) -> None:
        """End :meth:`run`, from another thread."""
        self._server.should_exit = True


def _listen(port: int) -> socket.socket:
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind(("127.0.0.1", port))
    except OSError as error:
        found.close()
        raise VfoaError(f"--port {port}: cannot be used: {error.strerror}") from None
    found.listen()
    return found
