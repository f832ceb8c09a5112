"""The labelling page's server: the page's own files, pictures by position, and the labels as JSON."""

from __future__ import annotations

import secrets
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, get_args

from pydantic import BeforeValidator, Field
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from harness.annotate.actions import Action
from harness.annotate.clip_pictures import PictureKind, RegionPx
from harness.annotate.journaled_store import OutsideClipError, StaleRevisionError
from harness.annotate.last_address import Address, read_address, write_address
from harness.annotate.session import Session
from harness.clips.naming import NameRule
from harness.files.modules import bundle
from harness.files.parsing import parse_json
from harness.server.local_server import LocalServer
from vfoa.errors import VfoaError
from vfoa.settings import Settings
from vfoa.validation import parse

_PATIENCE_S = 20
"""Longest time for a frame that must first be rendered or decoded, seconds."""


class Changes(Settings):
    """Actions in their order, on these revisions of labels and drawing."""

    revision: int = 0
    drawn: int = 0
    changes: list[Action] = Field(max_length=1000)


class PictureQuery(Settings):
    """Query of a picture: the subject of a head, or a part of a view (``u0,v0,u1,v1``), and the greatest width."""

    subject: str | None = None
    region: Annotated[RegionPx | None, BeforeValidator(lambda text: text.split(","))] = None
    width: int | None = Field(default=None, ge=1, le=20_000)


class NewTarget(Settings):
    """A target that the manifest does not have yet, with its rule."""

    name: str
    rule: NameRule


class ChangedTarget(Settings):
    """Another name, key or colour of a target."""

    name: str
    new_name: str
    key: str | None
    colour: str


class DeletedTarget(Settings):
    """A target to delete, and the target that replaces it in the labels."""

    name: str
    to: str | None = None


class PageServer(LocalServer):
    """Serves one clip's page; the port is taken when the server is made.

    Within a day, a page of the same labels has the same token, and the same port if it is free and no other is
    requested (``port``; 0: any).

    Raises
    ------
    VfoaError
        If the requested port is taken.
    """

    def __init__(self, session: Session, port: int = 0) -> None:
        app, last = create_app(session), read_address(session.path)
        token = last.token if last else secrets.token_urlsafe(24)
        try:
            super().__init__(app, port or (last.port if last else 0), patience_s=_PATIENCE_S, token=token)
        except VfoaError:
            if port or not last:
                raise
            super().__init__(app, patience_s=_PATIENCE_S, token=token)
        write_address(session.path, Address(port=self.port, token=token))


_MISSING = {"right": "this clip has no right view", "head": "no head found here"}
"""Why there is no picture of a view; every clip has the others."""


def create_app(session: Session) -> Starlette:
    """Return the application for one clip, to be served by a :class:`harness.server.local_server.LocalServer`."""
    page = Path(__file__).with_name("page")
    script = bundle(page / "main.js")

    def about(request: Request) -> Response:
        return JSONResponse(session.about())

    def scene(request: Request) -> Response:
        return JSONResponse(session.scene(request.path_params["at"]))

    def picture(request: Request) -> Response:
        view = request.path_params["view"]
        if view not in get_args(PictureKind):
            raise HTTPException(404)
        shown = parse(PictureQuery, {**request.query_params}, "picture")
        at = request.path_params["at"]
        coded = session.picture(view, at, shown.subject, region=shown.region, width=shown.width)
        if coded is None:
            raise HTTPException(404, _MISSING[view])
        return Response(coded, media_type="image/jpeg")

    def change(body: bytes) -> Response:
        actions = parse(Changes, parse_json(body, "request"), "request")
        with session.changing:
            names = session.manifest
            try:
                session.make_all(actions.changes, actions.revision, actions.drawn)
            except StaleRevisionError:
                error = "labels or drawing were changed elsewhere"
                return JSONResponse({"error": error, **states(), "about": session.about()}, 409)
            except (VfoaError, OSError) as error:
                return _refused(error, **states(), about=session.about())
            renewed = {} if session.manifest is names else {"about": session.about()}
            return JSONResponse({**states(), **renewed})

    def state(request: Request) -> Response:
        with session.changing:
            answer = states()
            known = request.query_params.get("revision")
            renewed = {} if known in (None, str(answer["state"]["revision"])) else {"about": session.about()}
            return JSONResponse({**answer, **renewed})

    def states() -> dict[str, Any]:
        return {"state": session.state(), "drawn": session.drawn()}

    def change_targets(kind: type[Settings], make: Callable[..., None]) -> Callable[[Request], Any]:
        def answer(body: bytes) -> Response:
            make(**dict(parse(kind, parse_json(body, "request"), "request")))
            return JSONResponse({"about": session.about(), **states()})

        return _posted(answer)

    return Starlette(
        routes=[
            Route("/", lambda request: FileResponse(page / "page.html")),
            Route("/script.js", lambda request: Response(script, media_type="text/javascript")),
            Mount("/page", StaticFiles(directory=page)),
            Route("/api/clip", about),
            Route("/api/state", state),
            Route("/api/scene/{at:int}", scene),
            Route("/picture/{view}/{at:int}", picture),
            Route("/api/change", _posted(change), methods=["POST"]),
            Route("/api/target", change_targets(NewTarget, session.add_target), methods=["POST"]),
            Route("/api/target/change", change_targets(ChangedTarget, session.change_target), methods=["POST"]),
            Route("/api/target/delete", change_targets(DeletedTarget, session.delete_target), methods=["POST"]),
        ],
        exception_handlers=dict.fromkeys((VfoaError, OSError), lambda _, error: _refused(error)),
    )


def _posted(answer: Callable[[bytes], Response]) -> Callable[[Request], Any]:
    """A route that takes JSON and works in a thread, so that pictures are served meanwhile."""

    async def endpoint(request: Request) -> Response:
        if request.headers.get("content-type", "").partition(";")[0] != "application/json":
            raise HTTPException(415, "expected JSON")
        return await run_in_threadpool(answer, await request.body())

    return endpoint


def _refused(error: Exception, **more: Any) -> Response:
    """The answer to an error: of a request, of a position, or of a full or read-only disk."""
    problem, status = str(error), 404 if isinstance(error, OutsideClipError) else 400
    if isinstance(error, OSError):
        problem, status = f"{error.filename or 'the disk'}: {error.strerror or error}", 507
    return JSONResponse({"error": problem, **more}, status)
