"""One clip on the labelling page: its frames, its labels, and a run's predictions for it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from functools import cached_property
from pathlib import Path
from typing import Any, get_args

from harness.annotate.actions import Action, edited
from harness.annotate.clip_pictures import ClipPictures, PictureKind, RegionPx
from harness.annotate.history import History
from harness.annotate.journaled_store import JournaledStore, StaleRevisionError, StepBack
from harness.annotate.suggestions import LabelBlock, Predictions, advice
from harness.clips.manifest import ClipManifest, known_categories, load_manifest
from harness.clips.naming import COLOURS, KEYS, NameRule, keys_and_colours
from harness.files.digests import digest_files
from harness.files.folders import came_with_program
from harness.files.safe_names import vfoa_command
from harness.labels.labels import timeline_of
from harness.sources import Clip
from vfoa.errors import VfoaError


def _images_of(manifest: ClipManifest) -> Clip:
    """The clip of a manifest, whose images are shown."""
    return manifest.open_images(
        ": write its labels by hand (annotations/README.md), or "
        f"{vfoa_command('labels', 'import', 'FILE', '--clip', manifest.word, '--format', 'FORMAT')}"
    )


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
        open_clip: Callable[[ClipManifest], Clip] = _images_of,
    ) -> None:
        _check_choices(run, configuration, blind, uncertain_first)
        manifest = load_manifest(clip)
        if not manifest.subjects:
            raise VfoaError(f"{manifest.path}: found no subject; expected [subjects.NAME], a person to label")
        self._clip = open_clip(manifest)
        self._frames = tuple(self._clip.frames)
        if not self._frames:
            raise VfoaError(f"{manifest.path}: the clip has no frames")
        self._run, self._configuration = run, configuration
        self._annotator, self._blind, self._uncertain_first = annotator, blind, uncertain_first
        self._reading, self.changing = threading.Lock(), threading.RLock()
        self._timeline = timeline_of(self._clip)
        self._history = History(manifest, annotator, self._timeline)
        self._store, self._drawing = self._history.labels, self._history.drawing
        try:
            self._predictions = self._predict()
        except BaseException:
            self.close()
            raise
        self._views = ClipPictures(self._clip, self.manifest, self._predictions)

    @property
    def manifest(self) -> ClipManifest:
        """The present manifest: another object after each change of targets."""
        return self._history.manifest

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
        if left := ", ".join(self._history.left_over):
            notes.append(
                f"{self.path.name} has labels of {left}, which {self.manifest.path.name} does "
                "not have: no run is scored until these labels have another target, or the manifest has this one again."
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
        left = {name: NameRule(category="") for name in self._history.left_over}
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
            "looks": {name: asdict(look) for name, look in keys_and_colours({**rules, **left}).items()},
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
        }

    def state(self) -> dict[str, Any]:
        """The labels as JSON, read again if another program has changed the file."""
        with self.changing:
            self._store.refresh()
            can = {f"can_{kind}": self._history.next_step(kind) is not None for kind in get_args(StepBack)}
            return {**self._store.state(), **can}

    def make_all(self, actions: Sequence[Action], revision: int, drawn: int) -> None:
        """Make all actions that were not made before, on these revisions of labels and drawing.

        Raises
        ------
        StaleRevisionError
            If something else changed since the revisions, or since those of the actions that were made before; nothing
            is made.
        """
        with self.changing:
            known = self._store.requests | self._drawing.requests
            made = [at for at, action in enumerate(actions) if action.id in known]
            rest = actions[made[-1] + 1 if made else 0 :]
            self._history.refresh()
            own = {actions[at].id for at in made}
            kinds = {action.kind for action in rest}
            if kinds & {"draw", "undo", "redo"} and _is_stale(self._drawing, drawn, own):
                raise StaleRevisionError
            if kinds - {"draw", "seen"} and _is_stale(self._store, revision, own):
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
        """Take back the last change of labels, targets or drawing, or make it again: :meth:`History.step_back`."""
        with self._changing_names():
            self._history.step_back(kind)

    def drawn(self) -> dict[str, Any]:
        """The drawn shapes as JSON, read again if another program has changed the file."""
        with self.changing:
            self._drawing.refresh()
            return self._drawing.state()

    def add_target(self, name: str, rule: NameRule) -> None:
        """Write a new target into the manifest, and allow its name."""
        with self._changing_names():
            self._history.add_target(name, rule)

    def change_target(self, name: str, *, new_name: str, key: str | None, colour: str) -> None:
        """Give a target another name, also in the labels of all annotators, or another key or colour."""
        with self._changing_names():
            self._history.change_target(name, new_name=new_name, key=key, colour=colour)

    def delete_target(self, name: str, to: str | None) -> None:
        """Delete a target from the manifest; labels of all annotators that have it become ``to``."""
        with self._changing_names():
            self._history.delete_target(name, to)

    @contextmanager
    def _changing_names(self) -> Iterator[None]:
        """Let the block change targets; the views and predictions then have the new names."""
        with self.changing:
            before = self.manifest
            yield
            if self.manifest is not before:
                self._predictions = self._predict()
                with self._reading:
                    self._views.use(self.manifest, self._predictions)

    def _predict(self) -> Predictions | None:
        return Predictions(self._run, self.manifest, self._configuration) if self._run else None

    def scene(self, at: int) -> dict[str, Any]:
        """Outlines and heads at a position, as JSON."""
        with self._reading:
            return self._views.scene(self._frames[self._store.check_position(at)])

    def picture(
        self,
        view: PictureKind,
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
        self._history.close()

    @cached_property
    def _times_s(self) -> list[float]:
        """Time of each frame, seconds since the first one."""
        return [round((time_ns - self._timeline.times_ns[0]) / 1e9, 4) for time_ns in self._timeline.times_ns]

    @cached_property
    def _categories(self) -> list[str]:
        """Object names used by the segmentation models, the clip's ground truth and the run."""
        records = self._predictions.records.values() if self._predictions else ()
        return sorted(known_categories(self._clip) | {target.label for record in records for target in record.targets})

    def _label_first(self) -> list[LabelBlock]:
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


def _is_stale(store: JournaledStore[Any], revision: int, own: Collection[str]) -> bool:
    """Whether the last change of a store is neither the one of the revision nor one of the requests."""
    return revision != store.revision and store.last_request not in own


def _check_choices(run: Path | None, configuration: str | None, blind: bool, uncertain_first: bool) -> None:
    if run is None and (configuration is not None or uncertain_first):
        raise VfoaError("--config and --uncertain-first need --run: they refer to a run's predictions")
    if blind and uncertain_first:
        raise VfoaError("--blind shows nothing of the run's predictions, and --uncertain-first orders by them")
