"""Connections to a server of this program: limited in number, and in time until the request is complete.

Without limits, clients that connect and send nothing, or stop in the middle of a request, would use up the server's
file descriptors, until it could answer nobody.
"""

from __future__ import annotations

import asyncio
import logging
from typing import ClassVar, cast

from uvicorn.protocols.http.h11_impl import H11Protocol

MOST = 64
"""Most connections at a time. A browser opens six to a host."""

REQUEST_S = 20.0
"""Seconds that a client may take for a request, from its connection or from the previous answer."""

_LOOK_S = 1.0
_SILENT_S = 60.0
_log = logging.getLogger(__name__)


class BoundedConnection(H11Protocol):
    """A connection that is closed if its client is too slow, or if others need its place.

    The connection that has been incomplete for longest is closed first; one that is being answered stays. If all are
    being answered, the new one is closed.
    """

    _owed_since = 0.0
    _look: asyncio.TimerHandle | None = None
    _logged_s: ClassVar[float] = -_SILENT_S

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Accept the connection, and take a place."""
        super().connection_made(transport)
        self._owed_since = self.loop.time()
        self._keep_watch()
        open_ones = [
            each for each in cast("set[BoundedConnection]", self.connections) if not each.transport.is_closing()
        ]
        if len(open_ones) > MOST:
            if self.loop.time() - BoundedConnection._logged_s >= _SILENT_S:
                BoundedConnection._logged_s = self.loop.time()
                _log.warning("more than %d connections at once: those without a request are closed", MOST)
            owing = [each for each in open_ones if each._owes()]
            min(owing, key=lambda each: each._owed_since, default=self).transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Release the place."""
        if self._look is not None:
            self._look.cancel()
        super().connection_lost(exc)

    def on_response_complete(self) -> None:
        """Start waiting for the client's next request."""
        self._owed_since = self.loop.time()
        super().on_response_complete()

    def _owes(self) -> bool:
        """Whether the rest of a request is missing."""
        return self.cycle is None or self.cycle.response_complete or self.cycle.more_body

    def _keep_watch(self) -> None:
        if self._owes() and self.loop.time() - self._owed_since > REQUEST_S:
            self.transport.abort()
        else:
            self._look = self.loop.call_later(_LOOK_S, self._keep_watch)
