"""The labelling page's server."""

from __future__ import annotations

from harness.annotate.app import create_app
from harness.annotate.session import Session
from harness.local_server import LocalServer

_PATIENCE_S = 20
"""A frame that has to be rendered or decoded first takes this long at most."""


class PageServer(LocalServer):
    """Serves one clip's page; the address is known, and taken, from the start.

    Raises
    ------
    VfoaError
        If the port is taken.
    """

    def __init__(self, session: Session, port: int = 0) -> None:
        super().__init__(create_app(session), port, patience_s=_PATIENCE_S)
