"""Checks of a posterior: sets of answers, and how well the measured directions fit it.

A set of answers is the smallest set of objects (including "nowhere") that together have 90 % of a subject's
probability.

The directions are checked by posterior-predictive checks (Rubin 1984): before each frame the posterior gives the
probability of directions that fit worse than the measured ones. If the model is right, these tail probabilities are
uniform; if many are small, the directions do not fit it.

Directions that surprise nobody can still fit the wrong targets. The share of the way to the targets that heads turn
shows it: people turn them 0.35 to 0.75 of the way. A larger implied share says that the head points near some target
all the time while the eyes look elsewhere, so that the targets do not explain it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from harness.labels.labels import IGNORED, Labels
from harness.run.grid import base_of
from harness.run.records import DirectionFitRecord, FrameRecord, SubjectRecord
from harness.score.verdicts import find_subject, right_answers
from vfoa.posterior.grid import PLAUSIBLE_SHARE

SET_LEVEL = 0.9
"""The least probability of a set."""

SMALL_TAIL = 0.05
"""A smaller tail probability is a surprise; if the model is right, this share of the frames has one."""
MOST_SURPRISES = 0.15
"""Share of surprising frames above which a note says that the directions do not fit."""
MOST_TIMES_CLAIMED = 1.5
"""Factor between the claimed and the implied error, either way, above which a note says that they do not fit."""
MOST_SHARE = PLAUSIBLE_SHARE
"""Implied share of the head above which a note says that the targets do not explain the head."""
FEWEST_FRAMES = 20
"""Fewer frames give no check."""

_ROUNDING = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class SetCoverage:
    """Share of one configuration's sets that hold the truth, and their mean size, over ``n`` scored frames."""

    configuration: str
    n: int
    covered: int
    mean_size: float


def prediction_set(subject: SubjectRecord) -> tuple[int | None, ...] | None:
    """Instance ids of the smallest set, the likeliest first; None stands for nowhere. None: no probabilities.

    Of equally likely objects those with the lower id come first, and nowhere last.
    """
    if subject.fit is None or not subject.attention:
        return None
    probabilities: dict[int | None, float] = {value.instance_id: value.total for value in subject.attention}
    probabilities[None] = max(0.0, 1 - sum(probabilities.values()))
    ranked = sorted(probabilities, key=lambda key: (-probabilities[key], key is None, key or 0))
    reached = np.cumsum([probabilities[key] for key in ranked])
    return tuple(ranked[: 1 + int(np.argmax(reached >= SET_LEVEL * reached[-1] - _ROUNDING))])


class SetLog:
    """Collects the sets of the scored frames from passing records; the seeds of a configuration are taken together."""

    def __init__(self, labels_by_clip: Mapping[str, Labels]) -> None:
        self._labels = labels_by_clip
        self._found: dict[str, list[tuple[bool, int]]] = {}

    def watch(self, records: Iterable[FrameRecord]) -> Iterator[FrameRecord]:
        """Yield the records unchanged."""
        for record in records:
            labels = self._labels.get(record.clip)
            for _, name, label in labels.labelled([record.frame]) if labels is not None else ():
                subject = find_subject(record, name)
                held = None if subject is None or label.target == IGNORED else prediction_set(subject)
                if held is not None:
                    covered = not set(held).isdisjoint(right_answers(record, label))
                    self._found.setdefault(base_of(record.configuration), []).append((covered, len(held)))
            yield record

    def part(self, configuration: str) -> list[tuple[bool, int]]:
        """The sets of a configuration so far, covered or not and the size of each, for another log."""
        return self._found.get(base_of(configuration), [])

    def add(self, configuration: str, found: list[tuple[bool, int]]) -> None:
        """Add a part of another log."""
        if found:
            self._found.setdefault(base_of(configuration), []).extend(found)

    def coverages(self) -> list[SetCoverage]:
        """One coverage for each configuration that gives probabilities."""
        return [
            SetCoverage(
                configuration=name,
                n=len(found),
                covered=sum(covered for covered, _ in found),
                mean_size=float(np.mean([size for _, size in found])),
            )
            for name, found in self._found.items()
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class DirectionCheck:
    """One configuration on one clip: the share of surprising frames, and the median errors in degrees, of ``n`` frames.

    ``claimed_deg`` is the mean gaze error that its source claims, ``implied_deg`` the one that the directions imply;
    None without gaze. ``share`` is the median share of the way to the targets that the head turns; None without head.
    """

    clip: str
    configuration: str
    n: int
    surprises: float
    claimed_deg: float | None
    implied_deg: float | None
    share: float | None = None

    @property
    def fits(self) -> bool:
        """Whether the directions fit, so that no note is needed."""
        if self.n < FEWEST_FRAMES:
            return True
        times = self.implied_deg / self.claimed_deg if self.implied_deg and self.claimed_deg else 1.0
        explained = self.share is None or self.share <= MOST_SHARE
        return explained and self.surprises <= MOST_SURPRISES and 1 / MOST_TIMES_CLAIMED <= times <= MOST_TIMES_CLAIMED

    def misfit(self) -> str:
        """What does not fit, or how far it is from it."""
        parts = [f"{100 * self.surprises:.0f} % of {self.n} frames surprise it (expected {100 * SMALL_TAIL:.0f} %)"]
        if self.claimed_deg is not None and self.implied_deg is not None:
            claimed, implied = (f"{angle:.0f} deg" for angle in (self.claimed_deg, self.implied_deg))
            parts.append(f"the gaze claims an error of {claimed}, the directions imply {implied}")
        if self.share is not None and self.share > MOST_SHARE:
            parts.append(f"heads turn {100 * self.share:.0f} % of the way to targets (people: 35 to 75 %)")
        return "; ".join(parts)


def misfit_notes(checks: Iterable[DirectionCheck]) -> list[str]:
    """A note for each configuration whose directions do not fit on some of its clips."""
    by_configuration: dict[str, list[DirectionCheck]] = {}
    for each in checks:
        by_configuration.setdefault(each.configuration, []).append(each)
    notes = []
    for name, of_name in by_configuration.items():
        unfit = [each for each in of_name if not each.fits]
        if unfit:
            clips = f"{len(unfit)} of {len(of_name)} clips ({', '.join(each.clip for each in unfit)})"
            where = f"{clips}, on the first" if len(unfit) > 1 else unfit[0].clip
            notes.append(f"{name}: directions do not fit the posterior on {where}: {unfit[0].misfit()}.")
    return notes


@dataclass(slots=True)
class DirectionLog:
    """Collects the fit of every subject in every frame; the seeds of a configuration are taken together."""

    _found: dict[tuple[str, str], list[DirectionFitRecord]] = field(default_factory=dict)

    def watch(self, records: Iterable[FrameRecord]) -> Iterator[FrameRecord]:
        """Yield the records unchanged."""
        for record in records:
            fits = [each.fit for each in record.subjects if each.fit is not None and each.name is not None]
            if fits:
                self._found.setdefault((record.clip, base_of(record.configuration)), []).extend(fits)
            yield record

    def part(self, clip: str, configuration: str) -> list[DirectionFitRecord]:
        """The fits of a configuration on a clip so far, for another log."""
        return self._found.get((clip, base_of(configuration)), [])

    def add(self, clip: str, configuration: str, found: list[DirectionFitRecord]) -> None:
        """Add a part of another log."""
        if found:
            self._found.setdefault((clip, base_of(configuration)), []).extend(found)

    def checks(self) -> list[DirectionCheck]:
        """One check for each clip and configuration with a posterior, over the named subjects."""
        return [
            DirectionCheck(
                clip=clip,
                configuration=configuration,
                n=len(fits),
                surprises=float(np.mean([each.tail < SMALL_TAIL for each in fits])),
                claimed_deg=_median_deg([each.claimed_error_rad for each in fits]),
                implied_deg=_median_deg([each.implied_error_rad for each in fits]),
                share=_median([each.implied_share for each in fits]),
            )
            for (clip, configuration), fits in self._found.items()
        ]


def _median_deg(angles_rad: list[float | None]) -> float | None:
    middle = _median(angles_rad)
    return None if middle is None else float(np.degrees(middle))


def _median(values: list[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.median(known)) if known else None
