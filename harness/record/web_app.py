"""Recordings in a browser: the web viewer, the way to it, and a page whose cells lead there, all under one address."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Protocol
from urllib.parse import quote

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, RedirectResponse, Response
from starlette.routing import BaseRoute, Route

from harness.local_server import local_app
from harness.record.composed import Composed
from harness.record.web_viewer import WebFile
from vfoa.errors import VfoaError

VIEWER = "/viewer/"

PAGE_POLICY = "frame-ancestors 'none'"
"""The rest of the page's policy stands in the page."""

_FRAME = re.compile(r"-?[0-9]{1,19}")
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-cache",
}


class Addresses(Protocol):
    """What is wanted of a :class:`harness.record.catalogue.Catalogue`."""

    @property
    def origin(self) -> str:
        """Where a browser reaches it."""
        ...

    def address(self, recording: Composed, frame: int | None) -> str:
        """What the viewer opens."""
        ...


def site(
    recordings: Mapping[str, Composed],
    catalogue: Addresses,
    viewer: Mapping[str, WebFile],
    *,
    page: Callable[[], str] | None = None,
) -> Starlette:
    """The application; nothing in it writes, and no path of a request becomes a path of a file.

    ``/`` is the page (without one: the first recording), ``/open?recording=NAME&frame=N`` leads to the viewer at a
    frame, and ``/viewer/`` is the viewer, which may ask this server and the catalogue for things and nobody else.

    Parameters
    ----------
    recordings
        By the names under which they are asked for.
    viewer
        As :func:`harness.record.web_viewer.web_viewer_files` gives it.
    page
        Makes the page anew each time it is asked for.
    """

    def show_page(request: Request) -> Response:
        if page is None:
            return RedirectResponse(open_path(next(iter(recordings)), None), headers=_HEADERS)
        return HTMLResponse(page(), headers={**_HEADERS, "Content-Security-Policy": PAGE_POLICY})

    def open_recording(request: Request) -> Response:
        name, frame = request.query_params.get("recording", ""), request.query_params.get("frame")
        if name not in recordings:
            return _refusal(404, f"There is no recording {name!r} here.")
        if frame is not None and not _FRAME.fullmatch(frame):
            return _refusal(400, f"frame: expected a number, found {frame!r}.")
        address = catalogue.address(recordings[name], None if frame is None else int(frame))
        return RedirectResponse(
            f"{VIEWER}?persist=0&hide_welcome_screen&url={quote(address, safe='')}", headers=_HEADERS
        )

    def viewer_file(request: Request) -> Response:
        found = viewer.get(request.path_params.get("name", "index.html"))
        if found is None:
            return _refusal(404, "The viewer has no such file.")
        policy = {"Content-Security-Policy": _viewer_policy(catalogue.origin)}
        return Response(found.content, media_type=found.media_type, headers={**_HEADERS, **policy})

    routes: list[BaseRoute] = [
        Route("/", _told(show_page)),
        Route("/open", _told(open_recording)),
        Route(VIEWER, viewer_file),
        Route(VIEWER + "{name}", viewer_file),
    ]
    return local_app(routes)


def open_path(name: str, frame: int | None) -> str:
    """Where the site opens a recording."""
    return f"/open?recording={quote(name, safe='')}" + ("" if frame is None else f"&frame={frame}")


def _told(answer: Callable[[Request], Response]) -> Callable[[Request], Response]:
    """An answer that says in one line what is wrong with the run's files."""

    def answered(request: Request) -> Response:
        try:
            return answer(request)
        except VfoaError as error:
            return _refusal(500, str(error))

    return answered


def _refusal(status: int, text: str) -> Response:
    return PlainTextResponse(text + "\n", status_code=status, headers=_HEADERS)


def _viewer_policy(catalogue: str) -> str:
    return "; ".join(
        (
            "default-src 'none'",
            "script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval'",
            "style-src 'unsafe-inline'",
            f"connect-src 'self' {catalogue}",
            "img-src 'self' data: blob:",
            "worker-src 'self' blob:",
            PAGE_POLICY,
        )
    )
