"""The page's server: one socket on 127.0.0.1, one token."""

from __future__ import annotations

import secrets

from harness.annotate.app import create_app
from harness.annotate.session import Session
from harness.local_server import HOST, listen, make_server

_PATIENCE_S = 20
"""A frame that has to be rendered or decoded first takes this long at most."""


class PageServer:
    """Serves one clip's page; the address is known, and taken, from the start.

    Raises
    ------
    VfoaError
        If the port is taken.
    """

    def __init__(self, session: Session, port: int = 0) -> None:
        self._token = secrets.token_urlsafe(24)
        self._listener = listen(port)
        self.port: int = self._listener.getsockname()[1]
        self._server = make_server(create_app(session, self._token), patience_s=_PATIENCE_S)

    @property
    def address(self) -> str:
        """Where the page is, with the token."""
        return f"http://{HOST}:{self.port}/?token={self._token}"

    def run(self) -> None:
        """Serve until the process is told to end, or :meth:`stop` is called."""
        try:
            self._server.run(sockets=[self._listener])
        finally:
            self.close()

    def stop(self) -> None:
        """End :meth:`run`, from another thread."""
        self._server.should_exit = True

    def close(self) -> None:
        """Let go of the port."""
        self._listener.close()
