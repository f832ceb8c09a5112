"""The labelling page's server."""

from __future__ import annotations

from harness.annotate.address import Address, new_address
from harness.annotate.app import create_app
from harness.annotate.session import Session
from harness.server.local_server import LocalServer
from vfoa.errors import VfoaError

_PATIENCE_S = 20
"""Longest time for a frame that must first be rendered or decoded, seconds."""


class PageServer(LocalServer):
    """Serves one clip's page; the port is taken when the server is made.

    Parameters
    ----------
    port
        0: any that is free.
    before
        The page's last address: the same token, and the same port if it is free and no other is requested.

    Raises
    ------
    VfoaError
        If the port is taken.
    """

    def __init__(self, session: Session, port: int = 0, before: Address | None = None) -> None:
        address = before or new_address()
        app = create_app(session)
        try:
            super().__init__(app, port or address.port, patience_s=_PATIENCE_S, token=address.token)
        except VfoaError:
            if port or not address.port:
                raise
            super().__init__(app, patience_s=_PATIENCE_S, token=address.token)
        self.parts = Address(port=self.port, token=address.token)
