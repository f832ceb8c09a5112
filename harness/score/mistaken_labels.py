"""Mistakes of labels that explain many errors at once: they are of another time, or two names are exchanged in them.

Answers are compared with the labels as they are, and as they would be without the mistake. A note is made where far
more frames would be right, and looks hardly gain by chance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, combinations
from typing import NamedTuple

import numpy as np

from harness.labels.labels import NOWHERE
from harness.run.notes import Note, NoteKind
from harness.score.judged_subjects import JudgedSubject
from harness.score.statistics import sign_flip_p
from vfoa.types import Codes, Flags, Float

OFFSET_GAIN, EXCHANGE_GAIN = 0.15, 0.25
"""Least gain of the rate by which labels are said to be early or late, and names exchanged."""
LEAST_OFFSET_S, MOST_OFFSET_S = 0.5, 60.0
"""Offsets of labels that are tried. People mark a look up to half a second late."""
OFFSET_P, EXCHANGE_P = 5e-4, 0.05
"""Most probable by chance: of the best of many offsets, and of one exchange."""


def label_notes(subjects: Sequence[JudgedSubject]) -> tuple[Note, ...]:
    """A note for each clip whose labels seem to be early or late, or two of whose names seem to be exchanged."""
    by_clip: dict[str, list[JudgedSubject]] = {}
    for each in subjects:
        of_clip = by_clip.setdefault(each.clip, [])
        if len(each.truth) and each.configuration == (of_clip or [each])[0].configuration:
            of_clip.append(each)
    notes = []
    for clip, people in by_clip.items():
        if found := next(chain(_offset(people), _exchange(people)), None):
            notes.append(Note(f"{clip} under {people[0].configuration}: {found}", NoteKind.DOUBT))
    return tuple(notes)


class _Outcome(NamedTuple):
    """Whether frames of a person are right under a mistake (n,), and as they are (n,), and their looks (n,)."""

    changed: Flags
    plain: Flags
    looks: Codes


@dataclass(frozen=True, slots=True)
class _Gain:
    """What frames of some people gain under a mistake: the rates with it, and as they are."""

    outcomes: Sequence[_Outcome]

    @property
    def rate(self) -> float:
        return self._mean(0)

    @property
    def before(self) -> float:
        return self._mean(1)

    def is_shown(self, least: float, most_p: float) -> bool:
        """Whether the gain is large, and hardly by chance: looks are as likely to lose as to gain then."""
        if self.rate - self.before < least:
            return False
        of_looks = [np.bincount(each.looks, each.changed.astype(np.float64) - each.plain) for each in self.outcomes]
        return sign_flip_p(np.concatenate(of_looks)) < most_p

    def _mean(self, column: int) -> float:
        frames = np.concatenate([each[column] for each in self.outcomes])
        return float(frames.mean()) if len(frames) else 0.0


# Labels of another time


def _offset(people: Sequence[JudgedSubject]) -> Iterator[str]:
    """How late or early the labels of a clip's people seem to be."""
    rate_hz = people[0].rate_hz if people else None
    if rate_hz is None or (by := _best_shift(people, rate_hz)) is None:
        return
    gain = _Gain([_with_labels_after(each, by) for each in people])
    if gain.is_shown(OFFSET_GAIN, OFFSET_P):
        yield (
            f"{gain.rate:.0%} of the frames would be right, and not {gain.before:.0%}, if the labels were not "
            f"{abs(by) / rate_hz:.1f} s too {'late' if by > 0 else 'early'}: were they made on a film that begins at "
            "another time? (--offset of vfoa labels import)"
        )


def _best_shift(people: Sequence[JudgedSubject], rate_hz: float) -> int | None:
    """By how many frames later labels, for each frame, make most frames right that are not; None without any shift.

    Half of the frames have to have such a label.
    """
    least, most = max(1, round(LEAST_OFFSET_S * rate_hz)), round(MOST_OFFSET_S * rate_hz)
    most = min(most, max(int(np.ptp(each.positions)) for each in people))
    if most < least:
        return None
    gained, frames = np.zeros(2 * most + 1), np.zeros(2 * most + 1)
    for each in people:
        places = each.positions - each.positions[0]
        labelled = _at(places, np.ones(len(places)))
        for code in np.intersect1d(each.truth, each.predicted).tolist():
            gained += _by_shift(_at(places, each.predicted == code), _at(places, each.truth == code), most)
        gained -= _by_shift(_at(places, each.correct), labelled, most)
        frames += _by_shift(labelled, labelled, most)
    shifts = np.arange(-most, most + 1)
    is_tried = (abs(shifts) >= least) & (frames >= sum(len(each.truth) for each in people) / 2)
    if not is_tried.any():
        return None
    return int(shifts[np.argmax(np.where(is_tried, gained / np.maximum(frames, 1), -np.inf))])


def _at(places: Codes, values: Flags | Float) -> Float:
    """Values (n,) at their places in a row, 0 elsewhere."""
    return np.bincount(places, values.astype(np.float64)).astype(np.float64)


def _by_shift(now: Float, later: Float, most: int) -> Float:
    """Sums (2 most + 1,) of ``now`` at each place times ``later`` at a place shifted by -most to most."""
    from scipy.fft import next_fast_len

    size = next_fast_len(len(now) + most, real=True)
    products = np.fft.irfft(np.fft.rfft(now, size).conj() * np.fft.rfft(later, size), size)
    return np.rint(np.concatenate([products[-most:], products[: most + 1]]))


def _with_labels_after(subject: JudgedSubject, by: int) -> _Outcome:
    """A subject's answers with the labels ``by`` frames later, where there are labels."""
    _, now, then = np.intersect1d(subject.positions + by, subject.positions, assume_unique=True, return_indices=True)
    changed = subject.predicted[now] == subject.truth[then]
    return _Outcome(changed, subject.correct[now], subject.looks[now])


# Names that are exchanged


def _exchange(people: Sequence[JudgedSubject]) -> Iterator[str]:
    """Which two people, or two targets, of a clip seem to have each other's names."""
    codes = {name: code for each in people for name, code in zip(each.true_names, each.truth.tolist(), strict=True)}
    for one, other in combinations(people, 2):
        names = codes.get(one.subject, _NO_CODE), codes.get(other.subject, _NO_CODE)
        gain = _Gain([_as_other(one, other, names), _as_other(other, one, names)])
        if gain.is_shown(EXCHANGE_GAIN, EXCHANGE_P):
            yield _exchanged(gain, f"frames of {one.subject} and {other.subject}", "they", "person")
    targets = [str(name) for name in codes if name != NOWHERE]
    for name, other_name in combinations(targets, 2):
        gain = _Gain([_with_names(each, (codes[name], codes[other_name])) for each in people])
        if gain.is_shown(EXCHANGE_GAIN, EXCHANGE_P / (len(targets) * (len(targets) - 1) / 2)):
            yield _exchanged(gain, "frames", f"{name} and {other_name}", "thing")


_NO_CODE = -2
"""The code of a name that is no target of any label."""


def _exchanged(gain: _Gain, frames: str, who: str, what: str) -> str:
    return (
        f"{gain.rate:.0%} of the {frames} would be right, and not {gain.before:.0%}, if {who} had each other's names: "
        f"do labels and manifest (from_left) mean the same {what}?"
    )


def _as_other(subject: JudgedSubject, other: JudgedSubject, names: tuple[int, int]) -> _Outcome:
    """The other person's answers as if the subject's, in the frames that both have; their names are exchanged."""
    _, mine, yours = np.intersect1d(subject.frames, other.frames, assume_unique=True, return_indices=True)
    answers = _renamed(other.predicted[yours], names)
    return _Outcome(answers == subject.truth[mine], subject.correct[mine], subject.looks[mine])


def _with_names(subject: JudgedSubject, names: tuple[int, int]) -> _Outcome:
    """A subject's answers with two names exchanged."""
    return _Outcome(_renamed(subject.predicted, names) == subject.truth, subject.correct, subject.looks)


def _renamed(answers: Codes, names: tuple[int, int]) -> Codes:
    """The answers with two names exchanged."""
    one, other = names
    return np.where(answers == one, other, np.where(answers == other, one, answers))
