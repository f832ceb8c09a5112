"""One clip on the labelling page: its frames, its labels, and a run's predictions for it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any, get_args

from harness.annotate import targets
from harness.annotate.actions import Action, edited
from harness.annotate.clip_stores import open_drawing, open_store, with_others
from harness.annotate.drawing_store import DrawingStore
from harness.annotate.journal import Entry, StaleRevisionError, StepBack
from harness.annotate.label_store import LabelStore
from harness.annotate.suggestions import Block, Predictions, advice
from harness.annotate.targets import TargetChange, finish_change
from harness.annotate.views import RegionPx, View, Views
from harness.clips.manifest import ClipManifest, known_categories, load_manifest
from harness.clips.naming import COLOURS, KEYS, NameRule, looks
from harness.files.digests import digest_files
from harness.files.folders import came_with_program
from harness.files.io import read_bytes
from harness.labels.labels import RESERVED, TO_DECIDE, timeline_of
from harness.sources import Clip
from vfoa.errors import VfoaError


class Session:
    """A clip that one annotator is labelling. Its methods may be called from several threads.

    Parameters
    ----------
    clip
        The clip's name or its manifest.
    run, configuration
        The run whose predictions and boxes are shown; without one, the clip's own masks, if it has any.
    annotator
        The annotator of these labels: ``annotations/<clip>@<annotator>.csv``. None: the clip's own file.
    blind
        Show no suggestions.
    uncertain_first
        Order the frames by the run's uncertainty.

    Raises
    ------
    VfoaError
        If one of these is missing or wrong, or the clip has no images or no subject.
    """

    def __init__(
        self,
        clip: str,
        *,
        run: Path | None = None,
        configuration: str | None = None,
        annotator: str | None = None,
        blind: bool = False,
        uncertain_first: bool = False,
        open_clip: Callable[[ClipManifest], Clip] = ClipManifest.open_images,
    ) -> None:
        _check_choices(run, configuration, blind, uncertain_first)
        self.manifest = load_manifest(clip)
        if not self.manifest.subjects:
            raise VfoaError(f"{self.manifest.path}: subjects: none; expected at least one person to label")
        self._clip = open_clip(self.manifest)
        self._frames = tuple(self._clip.frames)
        if not self._frames:
            raise VfoaError(f"{self.manifest.path}: the clip has no frames")
        self._run, self._configuration = run, configuration
        self._annotator, self._blind, self._uncertain_first = annotator, blind, uncertain_first
        self._predictions = Predictions(run, self.manifest, configuration) if run else None
        self._reading, self.changing = threading.Lock(), threading.RLock()
        self._timeline = timeline_of(self._clip)
        self.manifest = finish_change(self.manifest, self._timeline)
        self._views = Views(self._clip, self.manifest, self._predictions)
        self._drawing = open_drawing(self.manifest, self._timeline)
        try:
            self._store = open_store(self.manifest, annotator, self._timeline)
        except BaseException:
            self._drawing.close()
            raise

    @property
    def path(self) -> Path:
        """The CSV that is written."""
        return self._store.path

    @property
    def notice(self) -> str | None:
        """Notes on a read-only clip that came with the program, and on labels of unknown targets; None: no notes."""
        notes = []
        if came_with_program(self.manifest.path):
            notes.append(f"{self.manifest.name} came with vfoa and is read-only: changed labels go to {self.path}.")
        if self._left_over:
            notes.append(
                f"{self.path.name} has labels of {', '.join(self._left_over)}, which {self.manifest.path.name} does "
                "not have: runs are not scored until they are of another target, or the manifest has it again."
            )
        return " ".join(notes) or None

    @property
    def advice(self) -> str | None:
        """A line with the frames and times to label first; None without a run."""
        return advice(self._label_first(), self._frames, self._times_s)

    def about(self) -> dict[str, Any]:
        """The clip and its names, which labelling does not change, as JSON."""
        shown = None if self._blind else self._predictions
        rules = {**self.manifest.targets, **self.manifest.subjects}
        left = {name: NameRule(category="") for name in self._left_over}
        return {
            "clip": self.manifest.name,
            "annotator": self._annotator,
            "file": self.path.name,
            "notice": self.notice,
            # a browser's numbers have 53 bits; the page only shows these
            "frames": [number if abs(number) < 2**53 else str(number) for number in self._frames],
            "rate_hz": self._clip.rate_hz,
            "times_s": self._times_s,
            "subjects": self._store.subjects,
            "names": self._store.names(),
            "looks": {name: asdict(look) for name, look in looks({**rules, **left}).items()},
            "keys": KEYS,
            "colours": COLOURS,
            "categories": self._categories,
            "shared": [name for name, rule in self.manifest.targets.items() if rule.is_shared],
            "configuration": shown and shown.configuration,
            "suggestions": {name: self._suggestions(name) for name in self._store.subjects},
            "order": {name: shown.order(self._frames, name) for name in self._store.subjects} if shown else None,
            "uncertain_first": self._uncertain_first,
            "label_first": [asdict(block) for block in self._label_first()],
            "blind": self._blind,
            "to_decide": TO_DECIDE,
        }

    def state(self) -> dict[str, Any]:
        """The labels as JSON, read again if another program has changed the file."""
        with self.changing:
            self._store.refresh()
            can = {f"can_{kind}": self._next(kind) is not None for kind in get_args(StepBack)}
            return {**self._store.state(), **can}

    def make_all(self, actions: Sequence[Action], revision: int, drawn: int) -> None:
        """Make all actions that were not made before, on these revisions of labels and drawing.

        Raises
        ------
        StaleRevisionError
            If something else changed since the revisions; nothing is made.
        """
        with self.changing:
            known = self._store.requests | self._drawing.requests
            made = [at for at, action in enumerate(actions) if action.id in known]
            rest = actions[made[-1] + 1 if made else 0 :]
            if not made:  # else, the first of them had the right revision
                self._refresh()
                kinds = {action.kind for action in rest}
                if kinds & {"draw", "undo", "redo"} and drawn != self._drawing.revision:
                    raise StaleRevisionError
                if kinds - {"draw", "seen"} and revision != self._store.revision:
                    raise StaleRevisionError
            for action in rest:
                with self._store.under(action.id), self._drawing.under(action.id):
                    self.make(action)

    def make(self, action: Action) -> None:
        """Make a person's action on the present state.

        Raises
        ------
        VfoaError
            If a name, a position or a place is wrong, or a file cannot be written.
        """
        with self.changing:
            match action.kind:
                case "undo" | "redo":
                    self.step_back(action.kind)
                case "draw":
                    self._drawing.draw(action.draw)
                case "seen":
                    self._store.see(action.subject, action.at)
                case _:
                    self._edit(action)

    def _edit(self, action: Action) -> None:
        at, subject, store = self._store.check_position(action.at), action.subject, self._store
        suggested = self._suggestions(subject) if action.kind == "accept" else None
        if new := edited(action, store.track(subject), suggested, store.seen(subject)):
            store.put(subject, new, seen=at if action.kind == "look" else None)

    def step_back(self, kind: StepBack) -> None:
        """Take back the last change of labels, targets or drawing, whichever is newest, or make it again.

        A change that was undone before a newer one was made cannot be made again.
        """
        with self.changing:
            self._refresh()
            if (found := self._next(kind)) is None:
                return
            store, step = found
            change = TargetChange.of_step(step)
            if change and kind == "undo":
                change = change.inverse
            self._with_targets(change, lambda: store.step_back(kind))

    def _refresh(self) -> None:
        """Read labels and drawing again if another program has changed them."""
        self._store.refresh()
        self._drawing.refresh()

    def _next(self, kind: StepBack) -> tuple[LabelStore | DrawingStore, Entry] | None:
        """Labels (with targets) or drawing, whichever has the next step to undo or redo, and the step; or None."""
        stores = (self._store, self._drawing)
        last_made_s = max((made[0] for store in stores if (made := store.last_step("undo"))), default=0.0)
        found = [(last, store) for store in stores if (last := store.last_step(kind)) and last[0] >= last_made_s]
        if not found:
            return None
        (_, step), store = max(found, key=lambda timed: timed[0][0])
        return store, step

    def drawn(self) -> dict[str, Any]:
        """The drawn shapes as JSON, read again if another program has changed the file."""
        with self.changing:
            self._drawing.refresh()
            return self._drawing.state()

    def add_target(self, name: str, rule: NameRule) -> None:
        """Write a new target into the manifest, and allow its name."""
        with self.changing:
            self._change(targets.with_target(self.manifest.path, name, rule))

    def change_target(self, name: str, *, new_name: str, key: str | None, colour: str) -> None:
        """Give a target another name, also in the labels of all annotators, or another key or colour."""
        with self.changing:
            self._refresh()
            to = targets.with_change(self.manifest.path, name, new_name=new_name, key=key, colour=colour)
            if new_name == name:
                self._change(to)
                return
            with with_others(self._store, self.manifest, self._timeline) as stores:
                labels = {store.path.name: store.reassigned(name, new_name) for store in stores}
            tracks = self._drawing.tracks()
            self._change(to, labels, [[new_name if track[0] == name else track[0], *track[1:]] for track in tracks])

    def delete_target(self, name: str, to: str | None) -> None:
        """Delete a target from the manifest; labels of all annotators that have it become ``to``."""
        with self.changing:
            self._refresh()
            with with_others(self._store, self.manifest, self._timeline) as stores:
                if to is not None:
                    for store in stores:
                        store.check_reassignment(name, to)
                    labels = {store.path.name: store.reassigned(name, to) for store in stores}
                elif uses := sum(store.uses(name) for store in stores):
                    raise VfoaError(f"{name!r} is the target of {uses} labels; expected another target for them")
                else:
                    labels = {}
            drawn = [track for track in self._drawing.tracks() if track[0] != name]
            self._change(targets.without_target(self.manifest.path, name), labels, drawn)

    def _change(self, text: str, labels: dict[str, list[Any]] | None = None, drawn: list[Any] | None = None) -> None:
        """Change the manifest to this text, with these changes of labels by file name, and to this drawing."""
        before = self._drawing.tracks()
        change = TargetChange(
            manifest=(read_bytes(self.manifest.path).decode(), text),
            labels={name: changes for name, changes in (labels or {}).items() if changes},
            drawn=None if drawn is None or drawn == before else (before, drawn),
        )
        self._with_targets(change, lambda: self._store.change_targets(change.model_dump(mode="json")))

    def _with_targets(self, change: TargetChange | None, make: Callable[[], None]) -> None:
        """Make a change of this annotator's labels and, if it changes targets, the same in all other files."""
        if not change:
            make()
            return
        if read_bytes(self.manifest.path).decode() != change.manifest[0]:
            self._store.commit({"set": []})  # no earlier step can be undone
            raise VfoaError(
                f"{self.manifest.path} was edited since its targets were changed here: changes until then can no "
                "longer be undone"
            )
        with with_others(self._store, self.manifest, self._timeline) as stores:
            change.check_labels(self.manifest, stores[1:])
            drawn = change.on_drawing(self._drawing.tracks(), self.manifest)
            if drawn != self._drawing.tracks():
                self._drawing.check_writable()
            with change.kept(self.manifest):
                change.in_labels(stores[1:])
                make()
                self._drawing.set_tracks(drawn)
        self._read_manifest()

    def scene(self, at: int) -> dict[str, Any]:
        """Outlines and heads at a position, as JSON."""
        with self._reading:
            return self._views.scene(self._frames[self._store.check_position(at)])

    def picture(
        self,
        view: View,
        at: int,
        subject: str | None = None,
        *,
        region: RegionPx | None = None,
        width: int | None = None,
    ) -> bytes | None:
        """A region of a view, or all of it, as JPEG of at most this width; None for an unknown head."""
        with self._reading:
            number = self._frames[self._store.check_position(at)]
            return self._views.picture(view, number, subject, region, width)

    def digest(self) -> str:
        """The digest of the present files of labels and names."""
        files = (("labels", self.path), ("manifest", self.manifest.path))
        return digest_files(file for file in files if file[1].is_file())

    def close(self) -> None:
        """Close the files."""
        self._store.close()
        self._drawing.close()

    @property
    def _left_over(self) -> list[str]:
        """Targets of labels that are not in the manifest (any more)."""
        known = {*self.manifest.targets, *self.manifest.subjects, *RESERVED}
        return [name for name in self._store.names() if name not in known]

    @cached_property
    def _times_s(self) -> list[float]:
        """Time of each frame, seconds since the first one."""
        return [round((time_ns - self._timeline.times_ns[0]) / 1e9, 4) for time_ns in self._timeline.times_ns]

    @cached_property
    def _categories(self) -> list[str]:
        """Object names used by the segmentation models, the clip's ground truth and the run."""
        records = self._predictions.records.values() if self._predictions else ()
        return sorted(known_categories(self._clip) | {target.label for record in records for target in record.targets})

    def _read_manifest(self) -> None:
        self.manifest = load_manifest(self.manifest.path, self.manifest.name)
        if self._run:
            self._predictions = Predictions(self._run, self.manifest, self._configuration)
        left = [name for name in self._left_over if self._store.uses(name)]
        self._store.targets = [*self.manifest.targets, *left]
        self._drawing.targets = [*self.manifest.targets]
        with self._reading:
            self._views.use(self.manifest, self._predictions)

    def _label_first(self) -> list[Block]:
        if self._predictions is None or self._blind:
            return []
        return self._predictions.label_first(self._store.subjects, self._frames, self._times_s)

    def _suggestions(self, subject: str) -> list[tuple[str, float] | None] | None:
        """Name and attention for each frame; None if there are none, or they may not be shown."""
        if self._predictions is None or self._blind:
            return None
        known = {*self._store.names()} - {subject}
        predictions = [self._predictions.predict(frame, subject) for frame in self._frames]
        return [
            (prediction.target, round(prediction.attention, 4)) if prediction and prediction.target in known else None
            for prediction in predictions
        ]


def _check_choices(run: Path | None, configuration: str | None, blind: bool, uncertain_first: bool) -> None:
    if run is None and (configuration is not None or uncertain_first):
        raise VfoaError("--config and --uncertain-first need --run: they refer to a run's predictions")
    if blind and uncertain_first:
        raise VfoaError("--blind shows nothing of the run's predictions, and --uncertain-first orders by them")
