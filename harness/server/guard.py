"""Access to a server of this program: only for a browser or program on this machine that knows the token.

Another site that is open in the same browser can send requests to this machine, under any host name that it owns.
Therefore a request must have a loopback name as host, no other origin than this server, and the token in a cookie or a
header.
"""

from __future__ import annotations

import asyncio
import re
import secrets
from typing import Any
from urllib.parse import urlencode

from starlette.datastructures import MutableHeaders
from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

TOKEN_HEADER = "x-vfoa-token"
LARGEST_BODY = 100_000
"""Most bytes of a request's body."""

MOST_CONNECTIONS = 64
"""Most connections at a time. A browser opens six to a host."""

REQUEST_S = 20.0
"""Seconds that a client may take for a request, from its connection or from the previous answer."""

_LOOK_S = 1.0

ENTRANCES = ("/", "/open")
"""Paths whose address may hold the token: those that a person opens from the terminal."""

_LOOPBACK = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:[0-9]{1,5})?")
_HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; media-src 'self'; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "same-origin",  # without a referrer, a browser sends "Origin: null" with a form of this server's
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class Guard:
    """Refuses requests before the application sees them, and sets the headers of every answer.

    The application gets a request's complete body: never more than :data:`LARGEST_BODY` bytes, whatever the request
    states as its length.
    """

    def __init__(self, app: ASGIApp, token: str) -> None:
        self._app, self._token = app, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            return

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        request = Request(scope, receive)
        answer: ASGIApp | None = self._refusal(request) or self._entrance(request)
        if answer is None and request.method not in ("GET", "HEAD"):
            answer, receive = await _receive_body(request)
        await (answer or self._app)(scope, receive, send_with_headers)

    def _refusal(self, request: Request) -> Response | None:
        if not _LOOPBACK.fullmatch(request.headers.get("host", "")):
            return _refused("this server answers to loopback names only", 421)
        origin = request.headers.get("origin")
        if origin is not None and origin != f"http://{request.headers['host']}":
            return _refused("requests from other origins are refused", 403)
        if request.headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return _refused("requests from other sites are refused", 403)
        if not any(secrets.compare_digest(given.encode(), self._token.encode()) for given in self._given(request)):
            return _refused("open the address that vfoa printed: it holds the token", 403)
        return None

    def _given(self, request: Request) -> list[str]:
        """Every token in the request; one in the address counts only for paths that a person opens."""
        tokens = [request.headers.get(TOKEN_HEADER), request.cookies.get(_cookie(request))]
        if _is_entrance(request):
            tokens.append(request.query_params["token"])
        return [token for token in tokens if token]

    def _entrance(self, request: Request) -> Response | None:
        """The first visit: the token moves from the address into a cookie, so that it is in no history."""
        if not _is_entrance(request):
            return None
        others = urlencode([(name, value) for name, value in request.query_params.multi_items() if name != "token"])
        answer = RedirectResponse(request.url.path + (f"?{others}" if others else ""), 303)
        answer.set_cookie(_cookie(request), self._token, httponly=True, samesite="strict")
        return answer


async def _receive_body(request: Request) -> tuple[Response | None, Receive]:
    """Return a refusal, or None and the function that gives the body to the application."""
    too_large = _refused(f"expected a body of at most {LARGEST_BODY} bytes", 413)
    if int(request.headers.get("content-length", 0)) > LARGEST_BODY:
        return too_large, request.receive
    body, more = bytearray(), True
    while more:
        message = await request.receive()
        if message["type"] == "http.disconnect":
            return _refused("the request was cut", 400), request.receive
        body += message.get("body", b"")
        more = message.get("more_body", False)
        if len(body) > LARGEST_BODY:
            return too_large, request.receive
    rest: list[Message] = [{"type": "http.request", "body": bytes(body), "more_body": False}]

    async def receive() -> Message:
        return rest.pop() if rest else await request.receive()

    return None, receive


def _refused(text: str, status: int) -> Response:
    return PlainTextResponse(text + "\n", status)


def _is_entrance(request: Request) -> bool:
    return request.method == "GET" and request.url.path in ENTRANCES and "token" in request.query_params


def _cookie(request: Request) -> str:
    """The cookie's name. Cookies know hosts, not ports: each server has its own name."""
    return f"vfoa_{request.url.port}"


class Connections:
    """The open connections of a server, and the application, which is called when a request is complete.

    If there are too many, the connection that has waited longest for the rest of its request is closed. A connection
    that is being answered stays open; if all are being answered, the new one is closed.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._open: dict[Any, _Connection] = {}

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
        if len(self._open) > MOST_CONNECTIONS:
            owing = [other for other in self._open.values() if other.owes]
            slowest = min(owing, key=lambda other: other.since, default=connection)
            self.leave(slowest)
            slowest.transport.abort()

    def leave(self, connection: _Connection) -> None:
        """Release the place of a connection."""
        self._open = {client: other for client, other in self._open.items() if other is not connection}


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
