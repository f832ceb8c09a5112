"""Who may talk to the page's server: a browser or program on this machine that knows the token, and no other page.

Another site that is open in the same browser can send requests to this machine, under any host name it owns. So the
host must be a loopback name, the origin this server's own, and the token must be there, by cookie or header.
"""

from __future__ import annotations

import re
import secrets

from starlette.datastructures import MutableHeaders
from starlette.requests import Request
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_LOOPBACK = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:[0-9]{1,5})?")
TOKEN_HEADER = "x-vfoa-token"
CONTENT_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = {
    "Content-Security-Policy": CONTENT_POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}


class Guard:
    """Refuses requests before the application sees them, and sets the headers of every answer."""

    def __init__(self, app: ASGIApp, token: str) -> None:
        self._app, self._token = app, token

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            return
        request = Request(scope)
        answer = self._refusal(request) or self._entrance(request) or self._app

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in _HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        await answer(scope, receive, send_with_headers)

    def _refusal(self, request: Request) -> Response | None:
        if not _LOOPBACK.fullmatch(request.headers.get("host", "")):
            return PlainTextResponse("this server answers to loopback names only", 421)
        origin = request.headers.get("origin")
        if origin is not None and origin != f"http://{request.headers['host']}":
            return PlainTextResponse("requests from other origins are refused", 403)
        if request.headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return PlainTextResponse("requests from other sites are refused", 403)
        if not any(secrets.compare_digest(given.encode(), self._token.encode()) for given in self._given(request)):
            return PlainTextResponse("open the address that vfoa annotate printed: it holds the token", 403)
        return None

    def _given(self, request: Request) -> list[str]:
        """Every token the request shows; that in the address counts for the page itself alone."""
        found = [request.headers.get(TOKEN_HEADER), request.cookies.get(_cookie(request))]
        if _is_entrance(request):
            found.append(request.query_params["token"])
        return [each for each in found if each]

    def _entrance(self, request: Request) -> Response | None:
        """The first visit: the token moves from the address into a cookie, so that it stays in no history."""
        if not _is_entrance(request):
            return None
        answer = RedirectResponse("/", 303)
        answer.set_cookie(_cookie(request), self._token, httponly=True, samesite="strict")
        return answer


def _is_entrance(request: Request) -> bool:
    return request.method == "GET" and request.url.path == "/" and "token" in request.query_params


def _cookie(request: Request) -> str:
    """Cookies know hosts, not ports: each server has its own name."""
    return f"vfoa_{request.url.port}"
