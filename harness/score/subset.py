"""Conditions on labelled frames: a finished run is scored on those that meet all of them, without running it again."""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from harness.labels.labels import Label, LabelRange, Labels, ranges_of
from vfoa.errors import VfoaError, did_you_mean

_SIGNS: dict[str, Callable[[float, float], bool]] = {
    "<=": operator.le,
    ">=": operator.ge,
    "<": operator.lt,
    ">": operator.gt,
}
WORDS = ("clip", "subject", "target", "note")
NUMBERS = ("time", "frame")
EXPECTED = "clip, subject, target or note with = or != (several: mug|book), or time (s) or frame with <, <=, > or >="


@dataclass(frozen=True, slots=True, kw_only=True)
class Condition:
    """One condition, as its user wrote it in ``text``. ``values`` are words, any of which holds, or one number."""

    text: str
    key: str
    sign: str
    values: tuple[str, ...]

    @classmethod
    def parse(cls, text: str) -> Condition:
        """Parse ``target=mug|book``, ``subject!=ann``, ``note=occluded`` or ``time>=2.5``.

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
        return cls(text=text.strip(), key=key, sign=sign, values=tuple(value.split("|")))

    def holds(self, clip: str, subject: str, label: Label, frame: int, time_s: float | None) -> bool:
        """Whether a labelled frame meets it. A note meets ``note=word`` if the word is one of its words."""
        if self.key in NUMBERS:
            number = time_s if self.key == "time" else frame
            assert number is not None
            return _SIGNS[self.sign](number, float(self.values[0]))
        words = {
            "clip": [clip],
            "subject": [subject],
            "target": [label.target],
            "note": re.findall(r"[\w-]+", label.note),
        }
        return any(value in words[self.key] for value in self.values) == (self.sign == "=")


def conditions_of(text: str) -> list[Condition]:
    """Parse conditions that are separated by commas; none of an empty text. Raises as :meth:`Condition.parse` does."""
    return [Condition.parse(part) for part in text.split(",") if part.strip()]


def subset(
    labels: Mapping[str, Labels],
    conditions: Sequence[Condition],
    frames: Mapping[str, Sequence[int]],
    times_ns: Mapping[str, Sequence[int]],
) -> dict[str, Labels]:
    """The labels of the frames that meet all conditions, by clip; other frames are without a label, so not scored.

    Parameters
    ----------
    frames, times_ns
        The frames of the run by clip, and their times.

    Raises
    ------
    VfoaError
        If no frame is left, a condition names nothing that is labelled, or asks for times that the run does not have.
    """
    _check_names(labels, conditions)
    if any(condition.key == "time" for condition in conditions):
        for clip in labels:
            if len(times_ns.get(clip, ())) != len(frames[clip]):
                raise VfoaError(f"--where: time: the run has no times of {clip}; expected them: run it again, or frame")
    found: dict[str, Labels] = {}
    for clip, of_clip in labels.items():
        ranges = list(_ranges(clip, of_clip, conditions, frames[clip], times_ns.get(clip, ())))
        if ranges:
            found[clip] = Labels(ranges)
    if not found:
        raise VfoaError(
            f"--where {' --where '.join(each.text for each in conditions)}: no labelled frame of the run meets this"
        )
    return found


def _ranges(
    clip: str, labels: Labels, conditions: Sequence[Condition], frames: Sequence[int], times_ns: Sequence[int]
) -> Iterator[LabelRange]:
    """Yield the ranges of a clip's frames that meet all conditions."""
    seconds: list[float | None] = [time / 1e9 for time in times_ns]
    seconds = seconds or [None] * len(frames)
    for subject in labels.subjects:
        met: list[tuple[int, Label | None]] = []
        for frame, time_s in zip(frames, seconds, strict=True):
            label = labels.at(frame, subject)
            is_met = label and all(each.holds(clip, subject, label, frame, time_s) for each in conditions)
            met.append((frame, label if is_met else None))
        yield from ranges_of(subject, met)


def _check_names(labels: Mapping[str, Labels], conditions: Sequence[Condition]) -> None:
    """Reject names that no label has; a note is free text."""
    rows = [row for of_clip in labels.values() for row in of_clip.ranges]
    known = {
        "clip": set(labels),
        "subject": {row.subject for row in rows},
        "target": {row.label.target for row in rows},
    }
    for condition in conditions:
        for value in condition.values if condition.key in known else ():
            if value not in known[condition.key]:
                raise VfoaError(
                    f"--where: {condition.key} {value!r}: no label has it; {did_you_mean(value, known[condition.key])}"
                )
