"""Connections to a server of this program: limited in number, and in time until the request is complete.

Without limits, clients that connect and send nothing, or stop in the middle of a request, would use up the server's
file descriptors, until it could answer nobody. uvicorn's own limit counts requests, not connections that say nothing.
"""

from __future__ import annotations

import asyncio
import logging
from typing import Any

from starlette.types import ASGIApp, Receive, Scope, Send

MOST = 64
"""Most connections at a time. A browser opens six to a host."""

REQUEST_S = 20.0
"""Seconds that a client may take for a request, from its connection or from the previous answer."""

_LOOK_S = 1.0
_SILENT_S = 60.0
_log = logging.getLogger(__name__)


class Connections:
    """The open connections of a server, and the application, which is called when a request is complete.

    The connection that has been incomplete for longest is closed if others need its place; one that is being answered
    stays. If all are being answered, the new one is closed.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._open: dict[Any, _Connection] = {}
        self._logged_s = -_SILENT_S

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request; its connection keeps its place meanwhile."""
        connection = self._open.get(scope["client"])
        if connection is not None:
            connection.owes = False
        try:
            await self._app(scope, receive, send)
        finally:
            if connection is not None:
                connection.owes, connection.since = True, asyncio.get_running_loop().time()

    def bounded(self, served: asyncio.Protocol) -> asyncio.Protocol:
        """Return the protocol of a connection that is served by another protocol, and takes a place here."""
        return _Connection(served, self)

    def take(self, client: Any, connection: _Connection) -> None:
        """Give a new connection a place, and close the slowest one if there are too many."""
        self._open[client] = connection
        if len(self._open) > MOST:
            if connection.since - self._logged_s >= _SILENT_S:
                self._logged_s = connection.since
                _log.warning("more than %d connections at once: those without a request are closed", MOST)
            owing = [each for each in self._open.values() if each.owes]
            slowest = min(owing, key=lambda each: each.since, default=connection)
            self.leave(slowest)
            slowest.transport.abort()

    def leave(self, connection: _Connection) -> None:
        """Release the place of a connection."""
        self._open = {client: each for client, each in self._open.items() if each is not connection}


class _Connection(asyncio.Protocol):
    """A connection that is closed if its client is too slow. ``owes``: the rest of a request is missing."""

    transport: asyncio.Transport
    since = 0.0
    owes = True
    _look: asyncio.TimerHandle

    def __init__(self, served: asyncio.Protocol, places: Connections) -> None:
        self._served, self._places = served, places
        self.data_received, self.eof_received = served.data_received, served.eof_received  # type: ignore[method-assign]
        self.pause_writing, self.resume_writing = served.pause_writing, served.resume_writing  # type: ignore[method-assign]

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        self.transport, self.since = transport, asyncio.get_running_loop().time()
        self._served.connection_made(transport)
        self._keep_watch()
        self._places.take(transport.get_extra_info("peername"), self)

    def connection_lost(self, exc: Exception | None) -> None:
        self._look.cancel()
        self._places.leave(self)
        self._served.connection_lost(exc)

    def _keep_watch(self) -> None:
        loop = asyncio.get_running_loop()
        if self.owes and loop.time() - self.since > REQUEST_S:
            self.transport.abort()
        self._look = loop.call_later(_LOOK_S, self._keep_watch)
