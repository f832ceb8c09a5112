"""Answers of another system as a method of attention: who looks at what, by names, from a table.

frame,subject,target[,instance_id][,p_NAME...]
time_s,subject,target[,instance_id][,p_NAME...]
frame,subject,u_px,v_px[,in_image]

CSV in any dialect, or Parquet. A row is one person in one frame. ``target`` is a name of the manifest (a target or a
subject), ``none`` for "looks at nothing", or blank for no answer; a frame without a row has none either.
``instance_id`` says which one it is where things share a name; default: the first. ``p_NAME`` are probabilities of
targets, ``p_none`` that of nothing, which without a column has the rest up to 1; a blank cell is 0. With
probabilities a blank target is the likeliest one. A thing that the manifest does not name is ``label#id``, as vfoa's
own tables call it.

``u_px, v_px`` is the point of the left image that the person looks at, as gaze-following networks say it: the target is
the object whose mask holds the point (in a frame without masks: the smallest box). ``in_image`` 0 is ``none``; a row
without a point is no answer.

The file of Idiap's tracker holds the answers of its own model (:mod:`harness.sources.measured.idiap`).

Answers are joined by name, so they count whether or not this pipeline found the person or the object: what it did not
find is added to the scene without a box.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from harness.clips.manifest import ClipManifest
from harness.clips.naming import NameRule, Names, is_automatic
from harness.files.digests import file_digest
from harness.files.parquet import read_parquet_columns
from harness.files.tables import TableColumns, read_columns
from harness.labels.labels import NOWHERE
from harness.pipeline.configuration import CLIP_VARIABLE
from harness.remote import expand
from harness.sources import Clip, MeasuredClip
from harness.sources.measured.idiap import answers_of_idiap, is_tracker_output
from vfoa.errors import VfoaError, did_you_mean
from vfoa.methods import MethodSettings
from vfoa.tracking import Tracked
from vfoa.types import (
    Attention,
    Cues,
    Instance,
    NoAttention,
    Person,
    Scene,
    Subject,
    Target,
    TargetAttention,
)

KEYS = ("frame", "time_s")
"""Columns that say which frame a row is of; a table has one of them."""
NAMED = ("target", "instance_id")
POINT = ("u_px", "v_px")
CHANCE = "p_"
"""How the name of a column of probabilities begins."""

_IN_IMAGE = {"": False, "1": False, "true": False, "1.0": False, "0": True, "false": True, "0.0": True}
"""Cells of ``in_image``, and whether they say that the point is outside."""
_TOLERANCE = 1e-3
"""By how much the probabilities of a row may differ from 1, for tables with few digits."""
_FIRST_TRACK = 1_000_000
"""Tracks of people whom no detector found are numbered from here."""
_LAST_ID = 65535
"""Instances that no segmenter found are numbered from here, downwards."""


class AnswersSettings(MethodSettings):
    """Location of the answers, and how their frames are numbered."""

    method: Literal["answers"]
    """``answers``: those of another system, from a table."""
    file: str = Field(min_length=1)
    """Table of the answers; ``${CLIP}`` stands for the clip's name."""
    frame_offset: int = 0
    """Added to the table's frame numbers: 1 where it counts from 0 and the clip from 1."""

    def for_clip(self, clip: str) -> AnswersSettings:
        """Return the settings with the clip's name in the file's."""
        return self.model_copy(update={"file": self.file.replace(CLIP_VARIABLE, clip)})


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """One person's answer in a frame: a name or :data:`NOWHERE`; ``instance_id`` is which one of that name.

    ``chances`` are the probabilities of names above 0; empty where the system gives none. ``point_px`` (u, v) is the
    point looked at, in place of a name.
    """

    target: str = NOWHERE
    instance_id: int | None = None
    chances: Mapping[str, float] = field(default_factory=dict)
    point_px: tuple[float, float] | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all that it speaks of."""
        return tuple(name for name in (self.target, *self.chances) if name != NOWHERE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Answers:
    """The answers of a table by frame and subject; whether it has probabilities, and whether it has points."""

    probabilistic: bool
    has_points: bool
    by_frame: Mapping[int, Mapping[str, Answer]]


class FileAnswers:
    """The answers of a table, as a :class:`vfoa.methods.AttentionMethod`."""

    Settings = AnswersSettings
    says_nowhere = True
    from_file = True

    def __init__(self, settings: AnswersSettings, manifest: ClipManifest, clip: Clip | MeasuredClip) -> None:
        self._path = expand(settings.file, Path.cwd(), "attention.file")
        self._rules: Mapping[str, NameRule] = {**manifest.targets, **manifest.subjects}
        self._people = tuple(manifest.subjects)
        frames = tuple(clip.frames)
        times_ns = tuple(map(clip.time_ns, frames))
        key = file_digest(self._path), frames, times_ns, tuple(self._rules), self._people, settings.frame_offset
        self._answers = _read_once(self._path, *key)
        if self._answers.has_points and isinstance(clip, MeasuredClip):
            raise VfoaError(
                f"{self._path}:1: u_px, v_px: found points of an image, and the clip {manifest.name} has no images; "
                "expected the column target"
            )

    @property
    def probabilistic(self) -> bool:
        """Whether the table has probabilities."""
        return self._answers.probabilistic

    def digest(self) -> str:
        """Hexadecimal sha256 of the table."""
        return file_digest(self._path)

    def start(self) -> None:
        """No state."""

    def attend(
        self, subjects: tuple[Subject, ...], scene: Scene, states: tuple[None, ...]
    ) -> tuple[tuple[Attention, ...], tuple[None, ...]]:
        """Give each subject of a name the table's answer; the scene has what :meth:`complete` added."""
        answers = self._answers.by_frame.get(scene.index, {})
        return tuple(_attention(subject, answers.get(subject.name or ""), scene) for subject in subjects), states

    def complete(self, scene: Scene, tracked: Tracked, names: Names) -> tuple[Scene, Tracked, Names]:
        """Add the people and targets that the table names in this frame and that were not found, without a box."""
        answers = self._answers.by_frame.get(scene.index, {})
        known = {*names.targets.values()}
        wanted = dict.fromkeys(name for answer in answers.values() for name in answer.names)
        unseen = [subject for subject in answers if subject not in names.subjects.values()]
        used = {target.instance.id for target in scene.targets}
        free = (number for number in range(_LAST_ID, 0, -1) if number not in used)
        added = {next(free): name for name in dict.fromkeys((*wanted, *unseen)) if name not in known}
        of_targets = {**names.targets, **added}
        ids = {name: number for number, name in reversed(of_targets.items())}
        people = tuple(
            Person(view=Cues(head_pose=None, gaze=None), instance_id=ids[name], eye_origin_left=None) for name in unseen
        )
        tracks = {name: _FIRST_TRACK + self._people.index(name) for name in unseen}
        targets = tuple(self._target(number, name) for number, name in added.items())
        return (
            replace(scene, targets=scene.targets + targets, people=scene.people + people, names=of_targets),
            Tracked(ids=(*tracked.ids, *tracks.values()), open=tracked.open | {*tracks.values()}),
            Names(subjects={**names.subjects, **{track: name for name, track in tracks.items()}}, targets=of_targets),
        )

    def _target(self, number: int, name: str) -> Target:
        label = name.partition("#")[0] if is_automatic(name) else self._rules[name].category
        instance = Instance(id=number, label=label, category_id=0, is_thing=True, score=0.0)
        return Target(instance=instance, box_px=None, points_left=np.zeros((0, 3), np.float32), box=None)


def _attention(subject: Subject, answer: Answer | None, scene: Scene) -> Attention:
    if answer is None:
        return Attention(subject=subject, missing=NoAttention.NO_ANSWER)
    if answer.point_px is not None:
        return _attention_at(subject, answer.point_px, scene)
    ids: dict[str, int] = {}
    for number, name in scene.names.items():
        ids.setdefault(name, number)
    if answer.instance_id is not None and scene.names.get(answer.instance_id) == answer.target:
        ids[answer.target] = answer.instance_id
    chances = answer.chances or dict.fromkeys(answer.names, 1.0)
    totals = {ids[name]: chance for name, chance in chances.items() if name != NOWHERE}
    focus = None if answer.target == NOWHERE else ids[answer.target]
    return Attention(subject=subject, values=_values(subject, scene, totals), focus=focus)


def _attention_at(subject: Subject, point_px: tuple[float, float], scene: Scene) -> Attention:
    """The attention of a person who looks at a point of the image: the target there has all of it."""
    ids, (u, v) = scene.ids, point_px
    if ids is None:
        found = _smallest_box(scene, point_px, subject.person.instance_id)
    else:
        (height, width), (column, row) = ids.shape, (math.floor(u + 0.5), math.floor(v + 0.5))
        if not (0 <= column < width and 0 <= row < height):
            raise VfoaError(
                f"{subject.name} in frame {scene.index} looks at u_px = {u:g}, v_px = {v:g}, outside the image of "
                f"{width} x {height}; expected a point of it, or in_image = 0"
            )
        found = int(ids[row, column])
    values = _values(subject, scene, {} if found is None else {found: 1.0})
    if found not in {value.instance_id for value in values}:
        return Attention(subject=subject, missing=NoAttention.NO_OBJECT)
    return Attention(subject=subject, values=values, focus=found)


def _smallest_box(scene: Scene, point_px: tuple[float, float], own_id: int | None) -> int | None:
    """The instance with the smallest box in the image that holds the point; None: no box does."""
    u, v = point_px
    areas: dict[int, float] = {}
    for target in scene.targets:
        if target.box_px is not None and target.instance.id != own_id:
            u0, v0, u1, v1 = target.box_px.tolist()
            if u0 <= u <= u1 and v0 <= v <= v1:
                areas[target.instance.id] = (u1 - u0) * (v1 - v0)
    return min(areas, key=lambda number: areas[number], default=None)


def _values(subject: Subject, scene: Scene, totals: Mapping[int, float]) -> tuple[TargetAttention, ...]:
    """The attention to each target but the person's own body."""
    return tuple(
        TargetAttention(instance_id=number, gaze=math.nan, head=math.nan, total=totals.get(number, 0.0))
        for number in (target.instance.id for target in scene.targets)
        if number != subject.person.instance_id
    )


@lru_cache(maxsize=4)
def _read_once(
    path: Path,
    digest: str,
    frames: tuple[int, ...],
    times_ns: tuple[int, ...],
    names: tuple[str, ...],
    people: tuple[str, ...],
    frame_offset: int,
) -> Answers:
    """Read a table once per content: the description of the run needs it, perception, and the method."""
    return read_answers(path, frames, times_ns, names, people, frame_offset=frame_offset)


def read_answers(
    path: Path,
    frames: Sequence[int],
    times_ns: Sequence[int],
    names: Sequence[str],
    people: Sequence[str],
    *,
    frame_offset: int = 0,
) -> Answers:
    """Read the answers of a clip.

    Parameters
    ----------
    frames, times_ns
        The clip's frame numbers in ascending order, and their times in ns.
    names, people
        The manifest's names of all targets, and of the subjects, who are targets, too.
    frame_offset
        Added to the table's frame numbers.

    Raises
    ------
    VfoaError
        For the first mistake, with file and line: a column or a name that is unknown, a frame that the clip does not
        have, two rows of one person in one frame, probabilities that do not add up.
    """
    columns = _read(path)
    table = _Table(columns, tuple(names), tuple(people))
    by_frame: dict[int, dict[str, Answer]] = {}
    lines: dict[tuple[int, str], int] = {}
    for row, frame in enumerate(_frames(table, frames, times_ns, frame_offset)):
        subject = table.subject(row)
        if (before := lines.setdefault((frame, subject), row)) != row:
            raise VfoaError(
                f"{columns.where(row)}: frame {frame}, subject {subject!r}: occurs twice, first at "
                f"{columns.where(before)}"
            )
        if (answer := table.answer(row, subject)) is not None:
            by_frame.setdefault(frame, {})[subject] = answer
    return Answers(probabilistic=bool(table.chances), has_points=table.has_points, by_frame=by_frame)


def _read(path: Path) -> TableColumns:
    """The columns of a table in any of the formats."""
    if path.suffix == ".parquet":
        return read_parquet_columns(path)
    return answers_of_idiap(path) if is_tracker_output(path) else read_columns(path, None, ("subject",))


class _Table:
    """A table of answers while it is checked."""

    def __init__(self, columns: TableColumns, names: tuple[str, ...], people: tuple[str, ...]) -> None:
        self.columns, self._names, self._people = columns, names, people
        answers = (*names, NOWHERE)
        expected = (*KEYS, "subject", *NAMED, *(CHANCE + name for name in answers), *POINT, "in_image")
        unnamed = tuple(
            column.removeprefix(CHANCE)
            for column in columns.cells
            if column.startswith(CHANCE) and is_automatic(column.removeprefix(CHANCE))
        )
        answers = (*answers, *unnamed)
        for column in columns.cells:
            if column not in expected and column.removeprefix(CHANCE) not in unnamed:
                raise VfoaError(f"{columns.path}:1: no column {column!r} here; {did_you_mean(column, expected)}")
        self.has_points = any(column in columns.cells for column in POINT)
        named = [column for column in columns.cells if column in NAMED or column.startswith(CHANCE)]
        if "subject" not in columns.cells or self.has_points == bool(named):
            found = f"{named[0]} beside points" if named and self.has_points else ",".join(columns.cells)
            raise VfoaError(
                f"{columns.path}:1: found {found}; expected frame,subject,target,... or frame,subject,u_px,v_px,..."
            )
        self._points = columns.group(POINT) if self.has_points else None
        self._out = self._are_out() if self.has_points else ()
        self._check_points()
        self._numbers = columns.numbers("instance_id")
        given = {name: columns.numbers(CHANCE + name) for name in answers if CHANCE + name in columns.cells}
        self.chances = {name: np.nan_to_num(column) for name, column in given.items()}
        self._has_chances = np.zeros(len(columns.lines), np.bool_)
        for numbers in given.values():
            self._has_chances |= ~np.isnan(numbers)
        self._sums = np.sum([*self.chances.values()], axis=0) if self.chances else None
        self._check_chances()

    def subject(self, row: int) -> str:
        """The person of a row."""
        subject = self.columns.cells["subject"][row]
        if subject not in self._people:
            raise VfoaError(f"{self.columns.where(row)}: subject {subject!r}: {did_you_mean(subject, self._people)}")
        return subject

    def answer(self, row: int, subject: str) -> Answer | None:
        """The answer in a row; None for no answer."""
        if self._points is not None:
            u, v = self._points[row].tolist()
            if self._out[row]:
                return Answer()
            return None if math.isnan(u) else Answer(point_px=(u, v))
        target, where = self.columns.cells["target"][row], self.columns.where(row)
        chances = {name: float(column[row]) for name, column in self.chances.items() if column[row] > 0}
        if self._has_chances[row] and NOWHERE not in self.chances and (rest := 1 - sum(chances.values())) > 0:
            chances[NOWHERE] = rest
        if self.chances and not chances:
            if target:
                raise VfoaError(f"{where}: target {target!r}: found no probability; expected those of this row, too")
            return None
        if not target and not chances:
            return None
        target = target or max(chances, key=lambda name: chances[name])
        if target not in (*self._names, NOWHERE) and not is_automatic(target):
            raise VfoaError(f"{where}: target {target!r}: {did_you_mean(target, (*self._names, NOWHERE))}")
        if subject in (target, *chances):
            raise VfoaError(f"{where}: {subject!r} looks at {subject!r}; expected another target")
        number = self._numbers[row]
        return Answer(target=target, instance_id=None if math.isnan(number) else int(number), chances=chances)

    def _are_out(self) -> tuple[bool, ...]:
        """Which rows say that the point is not in the image."""
        cells = self.columns.cells.get("in_image", ("",) * len(self.columns.lines))
        for row, cell in enumerate(cells):
            if cell.lower() not in _IN_IMAGE:
                where = self.columns.where(row)
                raise VfoaError(f"{where}: in_image: found {cell!r}; expected 1, 0 or nothing")
        return tuple(_IN_IMAGE[cell.lower()] for cell in cells)

    def _check_points(self) -> None:
        """Reject points in shares of the image's size, which are no pixels."""
        points = np.zeros((0, 2)) if self._points is None else self._points[~np.isnan(self._points[:, 0])]
        if len(points) > 1 and (points >= 0).all() and (points <= 1).all():
            raise VfoaError(
                f"{self.columns.path}: u_px, v_px: all are from 0 to 1; expected pixels of the left image: multiply by "
                "its width and height"
            )

    def _check_chances(self) -> None:
        for name, column in self.chances.items():
            for row in np.flatnonzero((column < 0) | (column > 1))[:1].tolist():
                where = self.columns.where(row)
                raise VfoaError(f"{where}: {CHANCE}{name}: expected a probability from 0 to 1, found {column[row]:g}")
        if self._sums is None:
            return
        least = 1.0 if NOWHERE in self.chances else 0.0
        wrong = (self._sums > 1 + _TOLERANCE) | ((self._sums < least - _TOLERANCE) & self._has_chances)
        for row in np.flatnonzero(wrong)[:1].tolist():
            names = ", ".join(CHANCE + name for name in self.chances)
            limit = "1" if least else f"at most 1 (the rest is that of {NOWHERE})"
            where, total = self.columns.where(row), self._sums[row]
            raise VfoaError(f"{where}: {names}: the probabilities add up to {total:.4g}; expected {limit}")


def _frames(table: _Table, frames: Sequence[int], times_ns: Sequence[int], offset: int) -> Iterator[int]:
    """The frame of each row."""
    columns = table.columns
    given = [key for key in KEYS if key in columns.cells]
    if len(given) != 1:
        found = " and ".join(given) or "neither"
        raise VfoaError(f"{columns.path}:1: found {found} of the columns {' and '.join(KEYS)}; expected one of them")
    numbers = _by_time(columns, frames, times_ns) if given == ["time_s"] else columns.integers("frame") + offset
    outside = np.flatnonzero(~np.isin(numbers, np.array([*frames], np.int64)))
    if len(outside):
        row, first, last = int(outside[0]), frames[0], frames[-1]
        raise VfoaError(
            f"{columns.where(row)}: frame {numbers[row] - offset}: not in the clip, whose frames are {first} to {last}"
            f"{_shift_hint(numbers, first, last, offset)}"
        )
    yield from numbers.tolist()


def _shift_hint(numbers: NDArray[np.int64], first: int, last: int, offset: int) -> str:
    """What to set where all frames of a table are in the clip when they are counted from one more, or one less."""
    for shift in (1, -1):
        if first <= numbers.min() + shift and numbers.max() + shift <= last:
            return f"; if the table counts from {first - shift}, set attention.frame_offset = {offset + shift}"
    return ""


def _by_time(columns: TableColumns, frames: Sequence[int], times_ns: Sequence[int]) -> NDArray[np.int64]:
    """The nearest frame to each time, in seconds from the clip's first frame, within half a frame."""
    times_s = (np.array(times_ns, np.int64) - times_ns[0]) / 1e9
    wanted = columns.numbers("time_s")
    if len(times_s) < 2 or times_s[-1] <= 0:
        raise VfoaError(f"{columns.path}:1: time_s: the clip's frames have no times; expected the column frame")
    right = np.clip(np.searchsorted(times_s, wanted), 1, len(times_s) - 1)
    nearest = np.where(wanted - times_s[right - 1] <= times_s[right] - wanted, right - 1, right)
    half_s = float(np.median(np.diff(times_s))) / 2
    far = np.isnan(wanted) | (np.abs(wanted - times_s[nearest]) > half_s * (1 + _TOLERANCE))
    for row in np.flatnonzero(far)[:1].tolist():
        raise VfoaError(
            f"{columns.where(row)}: time_s: found {columns.cells['time_s'][row]!r}, no time of a frame; expected "
            f"seconds from the clip's first frame, 0 to {times_s[-1]:.3f}, within {half_s:.3f}"
        )
    return np.array(frames, np.int64)[nearest]
