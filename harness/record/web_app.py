"""Recordings in a browser: the web viewer, the files that it reads, and a page that links to them, at one address."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from mimetypes import guess_type
from pathlib import Path
from urllib.parse import quote, urlencode

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import (
    FileResponse,
    HTMLResponse,
    JSONResponse,
    PlainTextResponse,
    RedirectResponse,
    Response,
)
from starlette.routing import Route

from harness.record.composed import Composed
from harness.record.reading import has_video
from harness.run.directory import Pair
from harness.score.verdicts import Verdict, answered
from vfoa.errors import VfoaError

VIEWER = "/viewer/"

PAGE_POLICY = "frame-ancestors 'none'"
"""The rest of the page's policy is in the page."""

VIEWER_POLICY = (
    "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; connect-src 'self'; "
    f"img-src 'self' data: blob:; worker-src 'self' blob:; base-uri 'none'; form-action 'none'; {PAGE_POLICY}"
)

Routes = Sequence[Route]

AV1 = "av01.0.08M.08"
"""The videos of recordings as a browser is asked whether it decodes them."""

_FRAME = re.compile(r"-?[0-9]{1,18}")
_BINARY = "application/octet-stream"


def site(
    recordings: Mapping[str, Composed],
    viewer: Mapping[str, bytes],
    *,
    page: Callable[[str], str] | None = None,
    more: Routes = (),
) -> Starlette:
    """The application for a :class:`harness.server.local_server.LocalServer`, which is read-only except for ``more``.

    ``/`` is the page (without one: the first recording), ``/open?recording=NAME&frame=N&subject=WHO`` leads to the
    viewer at a frame with that person's tab in front, ``/viewer/`` is the viewer, and ``/files/NUMBER/`` has the files
    of a recording, also in parts (HTTP Range), and its layout.
    No path of a request becomes a path of a file: recordings and their files are numbered.

    Parameters
    ----------
    recordings
        By the names in requests.
    viewer
        From :func:`harness.record.viewer.web_viewer_files`.
    page
        Makes the page anew for each request, from the conditions on labelled frames of ``/?where=CONDITIONS``.
    more
        Further routes; one of ``/`` replaces the page.
    """
    served = _SiteHandlers(recordings=recordings, viewer=viewer, page=page)
    return Starlette(
        routes=[
            *more,
            Route("/", served.show_page),
            Route("/open", served.open_recording),
            Route("/files/{number:int}/{file:int}.rrd", served.recorded_file),
            Route("/files/{number:int}/layout.rbl", served.layout),
            Route(VIEWER, served.viewer_file),
            Route(VIEWER + "{name}", served.viewer_file),
        ],
        # an error in the run's files is an answer of one line
        exception_handlers={VfoaError: lambda _, error: PlainTextResponse(f"{error}\n", 500)},
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _SiteHandlers:
    """The answers to requests; ``recordings``, ``viewer`` and ``page`` are those of :func:`site`."""

    recordings: Mapping[str, Composed]
    viewer: Mapping[str, bytes]
    page: Callable[[str], str] | None

    def show_page(self, request: Request) -> Response:
        """The page, or an address that opens the first recording."""
        if self.page is None:
            return RedirectResponse(open_path(next(iter(self.recordings)), None))
        where = request.query_params.get("where", "")
        try:
            return HTMLResponse(self.page(where), headers={"Content-Security-Policy": PAGE_POLICY})
        except VfoaError as error:
            return PlainTextResponse(f"{error}\n", 400 if where else 500)

    def open_recording(self, request: Request) -> Response:
        """The address of the viewer with a recording, at a frame and with a tab in front."""
        name, frame = request.query_params.get("recording", ""), request.query_params.get("frame")
        if name not in self.recordings:
            raise HTTPException(404, f"There is no recording {name!r} here.")
        if frame is not None and not _FRAME.fullmatch(frame):
            raise HTTPException(400, f"frame: expected a number, found {frame!r}.")
        recording = self.recordings[name]
        recording.expect_files()
        place = f"/files/{self._numbered().index(recording)}"
        query = [("files", f"{place}/{number}.rrd") for number in range(len(recording.files))]
        who = request.query_params.get("subject")
        have_video = [has_video(file) for file in recording.files]  # all are read: a damaged one is an error here
        if any(have_video):
            query.append(("codec", AV1))
        if recording.make_layout is not None:
            query.append(("layout", f"{place}/layout.rbl" + (f"?{urlencode({'subject': who})}" if who else "")))
            query.append(("application", recording.application_id))
        about = {"clip": recording.clip, "subject": who, "frame": frame}
        query += [(key, value) for key, value in about.items() if value is not None]
        return RedirectResponse(f"{VIEWER}?{urlencode(query)}")

    def recorded_file(self, request: Request) -> Response:
        """A file of a recording, by their numbers."""
        number, file = request.path_params["number"], request.path_params["file"]
        recordings = self._numbered()
        if number >= len(recordings) or file >= len(recordings[number].files):
            raise HTTPException(404, "There is no such recording here.")
        recordings[number].expect_files()
        return FileResponse(recordings[number].files[file], media_type=_BINARY)

    def layout(self, request: Request) -> Response:
        """The layout of a recording, by its number."""
        number, recordings = request.path_params["number"], self._numbered()
        made = recordings[number].layout(request.query_params.get("subject")) if number < len(recordings) else None
        if made is None:
            raise HTTPException(404, "There is no such layout here.")
        with tempfile.TemporaryDirectory() as scratch:
            made.save(recordings[number].application_id, str(Path(scratch) / "layout.rbl"))
            return Response((Path(scratch) / "layout.rbl").read_bytes(), media_type=_BINARY)

    def viewer_file(self, request: Request) -> Response:
        """A file of the web viewer."""
        name = request.path_params.get("name", "viewer.html")
        if name not in self.viewer:
            raise HTTPException(404, "The viewer has no such file.")
        headers = {"Content-Security-Policy": VIEWER_POLICY}
        return Response(self.viewer[name], media_type=guess_type(name)[0], headers=headers)

    def _numbered(self) -> list[Composed]:
        return [*self.recordings.values()]


def open_path(name: str, frame: int | None = None, subject: str | None = None) -> str:
    """The path at which the application opens a recording, with the subject's tab in front."""
    asked = {"recording": name, "frame": frame, "subject": subject}
    return f"/open?{urlencode({key: value for key, value in asked.items() if value is not None}, quote_via=quote)}"


def failures_routes(wrong: Callable[[], Sequence[Verdict]], recordings: Mapping[Pair, Composed]) -> Routes:
    """The routes of a page beside the viewer that steps through wrong frames, as ``more`` of :func:`site`.

    ``wrong`` are the present ones; those of a clip and configuration without a recording are left out. A frame's number
    is a text: it may have 63 bits, of which JavaScript's numbers keep 53.
    """
    keys = ("clip", "configuration", "subject", "truth", "error_type")

    def listed(request: Request) -> Response:
        shown = ((verdict, recordings.get((verdict.clip, verdict.configuration))) for verdict in wrong())
        return JSONResponse(
            [
                {key: getattr(verdict, key) for key in keys}
                | {"predicted": verdict.predicted and answered(verdict), "frame": str(verdict.frame)}
                | {"open": open_path(recording.name, verdict.frame, verdict.subject)}
                for verdict, recording in shown
                if recording is not None
            ]
        )

    return (
        Route("/", lambda request: RedirectResponse(f"{VIEWER}failures.html")),
        Route("/failures.json", listed),
    )
