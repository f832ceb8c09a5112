"""Access to a server of this program: only for a browser or program on this machine that knows the token.

Another site that is open in the same browser can send requests to this machine, under any host name that it owns.
Therefore a request must have a loopback name as host, no other origin than this server, and the token in a cookie or a
header.
"""

from __future__ import annotations

import re
import secrets
from contextlib import suppress
from urllib.parse import urlencode

from starlette.datastructures import MutableHeaders
from starlette.requests import ClientDisconnect, Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

TOKEN_HEADER = "x-vfoa-token"
LARGEST_BODY = 100_000
"""Most bytes of a request's body."""

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

    A request with a body must state its length, at most :data:`LARGEST_BODY` bytes; the HTTP server reads no more.
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
        answer: ASGIApp = self._refusal(request) or self._entrance(request) or self._app
        with suppress(ClientDisconnect):  # there is nobody left to tell
            await answer(scope, receive, send_with_headers)

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
        return None if request.method in ("GET", "HEAD") else _refused_body(request)

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


def _refused_body(request: Request) -> Response | None:
    if "transfer-encoding" in request.headers:
        return _refused("expected a body with its length", 411)
    if int(request.headers.get("content-length", 0)) > LARGEST_BODY:
        return _refused(f"expected a body of at most {LARGEST_BODY} bytes", 413)
    return None


def _refused(text: str, status: int) -> Response:
    return PlainTextResponse(text + "\n", status)


def _is_entrance(request: Request) -> bool:
    return request.method == "GET" and request.url.path in ENTRANCES and "token" in request.query_params


def _cookie(request: Request) -> str:
    """The cookie's name. Cookies know hosts, not ports: each server has its own name."""
    return f"vfoa_{request.url.port}"
