"""Conditions on labelled frames: a finished run is scored on those that meet all of them, without running it again."""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np

from harness.files.safe_names import composed
from harness.labels.labels import Label, LabelRange, Labels, ranges_of
from harness.run.columns import UNKNOWN, PairColumns
from harness.score.baselines import view_of
from harness.score.looks import seconds_from_change
from harness.score.verdict_columns import LabelColumns, named_by
from vfoa.errors import VfoaError, did_you_mean

_SIGNS: dict[str, Callable[[float, float], bool]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}
WORDS = ("clip", "subject", "target", "tag", "note")
DISTANCES = ("distance", "target_distance")
"""Metres from the camera to the person's eyes, and from the eyes to the true target's centre, as the run measured."""
OF_TIME = ("time", "from_change")
"""Seconds since the clip's first frame, as pages show them, and to the nearest change of the subject's label."""
NUMBERS = (*OF_TIME, "frame", *DISTANCES)
EXPECTED = (
    "clip, subject, target, tag or note with = or != (several: mug|book), or time (s), from_change (s), frame, "
    "distance (m) or target_distance (m) with <, <=, > or >="
)
_BAR = re.compile(r"(?<!\\)\|")
"""Separates values; after a backslash it is part of one."""
_BETWEEN = re.compile(r",(?=\s*(?:$|,|\w+\s*[!<>=]))")
Distances = Mapping[tuple[str, int, str], tuple[float, float]]
"""Both distances by clip, frame and subject; NaN where one is not known."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """One condition, as its user wrote it in ``text``. ``values`` are words, any of which holds, or one number."""

    text: str
    key: str
    sign: str
    values: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Condition:
        """Parse ``target=mug|book``, ``subject!=ann``, ``tag=occluded`` or ``time>=2.5``.

        Raises
        ------
        VfoaError
            If it is none of these.
        """
        match = re.fullmatch(r"\s*(\w+)\s*(!=|<=|>=|=|<|>)\s*(.+?)\s*", text)
        if match is None:
            raise VfoaError(f"--where: found {text!r}; expected {EXPECTED}")
        key, sign, value = match.groups()
        if key not in (*WORDS, *NUMBERS):
            raise VfoaError(f"--where: found {key!r} in {text!r}; {did_you_mean(key, (*WORDS, *NUMBERS))}")
        if (key in NUMBERS) != (sign in _SIGNS) or (key in NUMBERS and not re.fullmatch(r"-?\d+(\.\d+)?", value)):
            raise VfoaError(f"--where: found {text!r}; expected {EXPECTED}")
        values = tuple(part.strip().replace(r"\|", "|") for part in _BAR.split(composed(value)))
        return cls(text=text.strip(), key=key, sign=sign, values=values)

    def holds(self, clip: str, subject: str, label: Label, numbers: Mapping[str, float]) -> bool:
        """Whether a labelled frame meets it; ``numbers`` are its values of :data:`NUMBERS`, NaN meets no condition.

        A note meets ``note=word`` if the word is one of its words.
        """
        if self.key in NUMBERS:
            return _SIGNS[self.sign](numbers[self.key], float(self.values[0]))
        words = {
            "clip": [clip],
            "subject": [subject],
            "target": [label.target],
            "tag": label.tags,
            "note": re.findall(r"[\w-]+", label.note),
        }
        return any(value in words[self.key] for value in self.values) == (self.sign == "=")


def conditions_of(text: str) -> list[Condition]:
    """Parse conditions that are separated by commas; none of an empty text. Raises as :meth:`Condition.parse` does.

    A comma inside a name (``target=cup, red``) separates nothing: no condition begins after it.
    """
    return [Condition.parse(part) for part in _BETWEEN.split(text) if part.strip()]


def subset(
    labels: Mapping[str, Labels],
    conditions: Sequence[Condition],
    frames: Mapping[str, Sequence[int]],
    times_ns: Mapping[str, Sequence[int]],
    columns: Callable[[], Iterable[PairColumns]],
) -> dict[str, Labels]:
    """The labels of the frames that meet all conditions, by clip; other frames are without a label, so not scored.

    Parameters
    ----------
    frames, times_ns
        The frames of the run by clip, and their times.
    columns
        Gives the run's columns; called only for a condition on a distance.

    Raises
    ------
    VfoaError
        If no frame is left, a condition names nothing that is labelled, or asks for times that the run does not have.
    """
    _check_names(labels, conditions)
    if timed := next((condition.key for condition in conditions if condition.key in OF_TIME), None):
        for clip in labels:
            if len(times_ns.get(clip, ())) != len(frames[clip]):
                raise VfoaError(f"--where: {timed}: the run has no times of {clip}; run it again, or use frame")
    has_distances = any(condition.key in DISTANCES for condition in conditions)
    distances = measured_distances(columns(), labels) if has_distances else {}

    def numbered(clip: str, subject: str) -> Iterator[_Numbered]:
        return _frames_of(clip, subject, labels[clip], frames[clip], times_ns.get(clip, ()), distances)

    found: dict[str, Labels] = {}
    for clip, of_clip in labels.items():
        ranges = [row for name in of_clip.subjects for row in _ranges(clip, name, numbered(clip, name), conditions)]
        if ranges:
            found[clip] = Labels(ranges)
    if not found:
        asked = " --where ".join(each.text for each in conditions)
        pairs = ((clip, subject) for clip, of_clip in labels.items() for subject in of_clip.subjects)
        labelled = [numbers for pair in pairs for _, label, numbers in numbered(*pair) if label]
        raise VfoaError(f"--where {asked}: no labelled frame of the run meets this{_known(labelled, conditions)}")
    return found


_Numbered = tuple[int, Label | None, Mapping[str, float]]
"""A frame, a subject's label in it, and the numbers that conditions may be on."""


def _frames_of(
    clip: str, subject: str, labels: Labels, frames: Sequence[int], times_ns: Sequence[int], distances: Distances
) -> Iterator[_Numbered]:
    """Yield all frames of a clip for a subject."""
    seconds = [(time_ns - times_ns[0]) / 1e9 for time_ns in times_ns] or [math.nan] * len(frames)
    own = [labels.at(frame, subject) for frame in frames]
    apart_s = seconds_from_change(own, seconds)
    for frame, time_s, label, from_change_s in zip(frames, seconds, own, apart_s, strict=True):
        known = zip(DISTANCES, distances.get((clip, frame, subject), (math.nan, math.nan)), strict=True)
        yield frame, label, {"time": time_s, "from_change": from_change_s, "frame": frame, **dict(known)}


def _ranges(
    clip: str, subject: str, numbered: Iterable[_Numbered], conditions: Sequence[Condition]
) -> Iterator[LabelRange]:
    """Yield the ranges of a subject's frames that meet all conditions."""
    met: list[tuple[int, Label | None]] = []
    for frame, label, numbers in numbered:
        is_met = label and all(each.holds(clip, subject, label, numbers) for each in conditions)
        met.append((frame, label if is_met else None))
    yield from ranges_of(subject, met)


def _known(labelled: Sequence[Mapping[str, float]], conditions: Sequence[Condition]) -> str:
    """The end of a message: from where to where the numbers of the conditions go in labelled frames."""
    keys = dict.fromkeys(condition.key for condition in conditions if condition.key in NUMBERS)
    known = {key: [numbers[key] for numbers in labelled if math.isfinite(numbers[key])] for key in keys}
    ends = {key: (round(min(values), 3), round(max(values), 3)) for key, values in known.items() if values}
    return "".join(f"; {key} is {low} to {high}" for key, (low, high) in ends.items())


def measured_distances(columns: Iterable[PairColumns], labels: Mapping[str, Labels]) -> Distances:
    """The distances in the labelled frames: medians over the configurations that measured them, so the same for all."""
    measured: dict[tuple[str, int, str], list[tuple[float, float]]] = {}
    for each in columns:
        scene, view, eyes_m = each.scene, view_of(each.scene), each.looks.eyes_m
        of_clip = labels.get(each.clip, Labels(()))
        for subject in of_clip.subjects:
            own = np.flatnonzero((scene.person_names == each.words.code(subject)) & ~np.isnan(eyes_m[:, 0]))
            frames = scene.frames[scene.person_at[own]]
            label = LabelColumns(of_clip.of(subject), of_clip.places(subject, frames), each.words)
            named = named_by(label, view, own) & view.has_box[own]
            for row in np.flatnonzero(label.truth != UNKNOWN).tolist():
                eyes, centers = eyes_m[own[row]].tolist(), view.centers_m[own[row], named[row]].tolist()
                to_target = min((math.dist(eyes, center) for center in centers), default=math.nan)
                key = each.clip, int(frames[row]), subject
                measured.setdefault(key, []).append((math.hypot(*eyes), to_target))
    return {key: (_median(own for own, _ in pairs), _median(to for _, to in pairs)) for key, pairs in measured.items()}


def _median(values: Iterable[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return median(known) if known else math.nan


def _check_names(labels: Mapping[str, Labels], conditions: Sequence[Condition]) -> None:
    """Reject names and tags that no label has; a note is free text."""
    rows = [row for of_clip in labels.values() for row in of_clip.ranges]
    known = {
        "clip": set(labels),
        "subject": {row.subject for row in rows},
        "target": {row.label.target for row in rows},
        "tag": {tag for row in rows for tag in row.label.tags},
    }
    for condition in conditions:
        for value in condition.values if condition.key in known else ():
            if value not in known[condition.key]:
                expected = did_you_mean(value, known[condition.key])
                bar = r"; a | in a name is written \|" if any("|" in name for name in known[condition.key]) else ""
                raise VfoaError(f"--where: {condition.key} {value!r}: no label has it; {expected}{bar}")
