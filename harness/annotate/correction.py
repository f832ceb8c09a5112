"""Correct labels of a run's clip through the store, and score the run again; the form for it on served pages.

The form without scripts is at ``/label?clip=CLIP&subject=SUBJECT&frame=N``, and posted to the same path. The pages
beside the viewer read from ``/label.json`` what their form asks for.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass
from html import escape
from pathlib import Path
from urllib.parse import parse_qsl

from pydantic import Field
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from harness.annotate.actions import mark_range
from harness.annotate.clip_stores import open_store, undo_command
from harness.clips.manifest import ClipManifest, manifest_of_run
from harness.labels.labels import RESERVED, timeline_of
from harness.report.write import refresh
from harness.run.directory import RunDirectory
from harness.score.finished_run import FinishedRun
from vfoa.errors import VfoaError, check_known
from vfoa.settings import Settings
from vfoa.validation import parse

PATH, JSON_PATH = "/label", "/label.json"
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
_STYLE = (
    "body{font:16px/1.5 system-ui;max-width:36rem;margin:2rem auto;padding:0 1rem;color-scheme:light dark}"
    "label{display:block;margin:.6rem 0}"
)


class LabelQuery(Settings):
    """The label that the form is about: by default, the clip's first person; ``back`` leads back to the page before."""

    clip: str
    subject: str | None = None
    frame: int | None = None
    back: str = Field(default="/", pattern=r"^/([^/\\].*)?$")


class Correction(Settings):
    """The true target of a subject from ``first`` to ``last``, in the source's own frame numbers."""

    clip: str
    subject: str
    target: str
    first: int
    last: int

    def __str__(self) -> str:
        frames = f"frame {self.first}" if self.first == self.last else f"frames {self.first} to {self.last}"
        return f"{self.clip}, {frames}: {self.subject} looks at {self.target}"


class Posted(Correction):
    """A correction, and the page that the form was opened from."""

    back: str = Field(default="/", pattern=r"^/([^/\\].*)?$")


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledLook:
    """The frames ``first`` to ``last`` around one with its label, ``target``; None if the frame has no label."""

    target: str | None
    first: int
    last: int


def look_around(directory: RunDirectory, clip: str, subject: str, frame: int | None) -> LabelledLook:
    """The look of a subject around a frame of the run, which is the first one by default.

    Raises
    ------
    VfoaError
        If the run has no such clip, or no such frame of it.
    """
    run = FinishedRun.read(directory)
    (frames,) = (of_run.frames for of_run in run.manifest.clips if of_run.name == clip)
    if frame is not None and frame not in frames:
        raise VfoaError(f"{clip}: the run has no frame {frame}; expected one of {min(frames)} to {max(frames)}")
    place = 0 if frame is None else frames.index(frame)
    labels = run.reference().labels.get(clip)
    if labels is None or (label := labels.at(frames[place], subject)) is None:
        return LabelledLook(target=None, first=frames[place], last=frames[place])

    def ends(others: Iterable[int]) -> int:
        last = frames[place]
        for other in others:
            if (there := labels.at(other, subject)) is None or there.target != label.target:
                break
            last = other
        return last

    return LabelledLook(target=label.target, first=ends(reversed(frames[:place])), last=ends(frames[place + 1 :]))


def choices(directory: RunDirectory, clip: str, subject: str) -> tuple[str, ...]:
    """Possible targets of a subject of a run's clip, ``none`` and ``ignore`` last.

    Raises
    ------
    VfoaError
        If the run has no such clip, or the clip no such subject.
    """
    manifest = _manifest(directory, clip)
    check_known(subject, manifest.subjects, f"{clip}: unknown subject")
    others = (name for name in manifest.subjects if name != subject)
    return (*manifest.targets, *others, *RESERVED)


def correct(directory: RunDirectory, correction: Correction) -> Path:
    """Write a correction into the labels that a run is scored against, and score the run again.

    It is written to the journal of the labels (`vfoa labels undo`). Tables, page and recordings are updated.

    Returns
    -------
    Path
        The file of the labels.

    Raises
    ------
    VfoaError
        If a name or a frame is not the clip's, another process labels the clip, or the run is not finished.
    """
    FinishedRun.read(directory)  # a run that cannot be scored is refused before its labels change
    manifest = _manifest(directory, correction.clip)
    timeline = timeline_of(manifest.open())
    frames = list(timeline.frames)
    if correction.first > correction.last:
        raise VfoaError(
            f"{correction.clip}: frame {correction.first} comes after frame {correction.last}; expected the first one "
            "first"
        )
    for frame in (correction.first, correction.last):
        if frame not in frames:
            raise VfoaError(f"{correction.clip}: no frame {frame}; expected {frames[0]} to {frames[-1]}")
    first, last = frames.index(correction.first), frames.index(correction.last)
    with closing(open_store(manifest, directory.read_manifest().scored_annotator, timeline)) as store:
        corrected = mark_range(store.track(correction.subject), first, last, correction.target)
        store.put(correction.subject, corrected)
        path = store.path
    refresh(directory)
    return path


def _manifest(directory: RunDirectory, clip: str) -> ClipManifest:
    """The manifest whose names the labels have that the run is scored against."""
    run = directory.read_manifest()
    places = {of_run.name: of_run.manifest for of_run in run.clips}
    check_known(clip, places, f"{directory.path}: no clip")
    return manifest_of_run(places[clip], clip, run.scored_annotator)


def correction_routes(directory: RunDirectory) -> list[Route]:
    """Routes of the form for any label of a run's clips: it writes the labels and scores the run again."""
    one_at_a_time = threading.Lock()

    def show(request: Request) -> Response:
        query = parse(LabelQuery, {**request.query_params}, "label")
        manifest = _manifest(directory, query.clip)
        subjects = tuple(manifest.subjects)
        if not subjects:
            raise VfoaError(
                f"{query.clip}: found no subject in its manifest; expected [subjects.NAME], a person to label"
            )
        subject = query.subject or subjects[0]
        targets = choices(directory, query.clip, subject)
        look = look_around(directory, query.clip, subject, query.frame)
        if request.url.path == JSON_PATH:
            ends = {"first": str(look.first), "last": str(look.last)}  # of up to 63 bits
            return JSONResponse(
                {"subjects": subjects, "subject": subject, "targets": targets, "target": look.target, **ends}
            )
        undo = undo_command(manifest, directory.read_manifest().scored_annotator)
        return _page(_form(query, subject, targets, look, undo))

    def change(body: str) -> Response:
        posted = parse(Posted, dict(parse_qsl(body, max_num_fields=20)), "label")
        with one_at_a_time:
            path = correct(directory, posted)
        done = f"{posted}. Written to {path.name}; tables, page and recordings are updated."
        return _page(f'<p>{escape(done)}</p><p><a href="{escape(posted.back)}">Back to where you were</a></p>')

    async def answer(request: Request) -> Response:
        try:
            if request.method != "POST":
                return await run_in_threadpool(show, request)
            body = (await request.body()).decode("utf-8", errors="replace")
            return await run_in_threadpool(change, body)
        except (VfoaError, ValueError) as error:
            return PlainTextResponse(f"{error}\n", status_code=400)

    return [Route(PATH, answer, methods=["GET", "POST"]), Route(JSON_PATH, answer)]


def _form(query: LabelQuery, subject: str, targets: tuple[str, ...], look: LabelledLook, undo: str) -> str:
    options = "".join(f"<option>{escape(name)}</option>" for name in targets)
    clip, subject, back = escape(query.clip), escape(subject), escape(query.back)
    now = "not labelled" if look.target is None else f"labelled {look.target} from frame {look.first} to {look.last}"
    frame = look.first if query.frame is None else query.frame
    return (
        f"<p>{clip}, frame {frame}: what does {subject} look at? It is {escape(now)}.</p>"
        f'<form method="post" action="{PATH}"><input type="hidden" name="clip" value="{clip}">'
        f'<input type="hidden" name="subject" value="{subject}"><input type="hidden" name="back" value="{back}">'
        f'<label>Target <select name="target" required><option value="">choose</option>{options}</select></label>'
        f'<label>From frame <input name="first" type="number" value="{look.first}" required></label>'
        f'<label>to frame <input name="last" type="number" value="{look.last}" required></label>'
        f'<button>Write the label</button> <a href="{back}">Cancel</a></form>'
        f"<p>The run is scored again. To take the label back: <code>{escape(undo)}</code></p>"
    )


def _page(body: str) -> Response:
    head = f'<!doctype html><html lang="en"><meta charset="utf-8"><title>Label</title><style>{_STYLE}</style>'
    content = f"{head}<h1>The label is wrong</h1>{body}</html>"
    return HTMLResponse(content, headers={"Content-Security-Policy": _POLICY})
