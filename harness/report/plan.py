"""The number of clips and looks needed to see a difference, from the spread of a finished run."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

from harness.report.formats import UNKNOWN, Table
from harness.score.comparison import POWER, Clips, Spread, clips_needed, detectable_difference
from harness.score.intervals import LEAST_CLIPS, Units
from harness.score.oracle_ablation import without_oracles
from harness.score.score import Scores
from harness.score.scored_frames import pair


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Clips that two configurations need: ``clips`` with as many looks each as now, ``clips_longer`` with twice those.

    ``difference`` is the observed one, ``detectable`` the one that this run can detect; both are shares. The tests are
    corrected for ``family`` comparisons. None: not reachable, or not known from so few clips.
    """

    reference: str
    configuration: str
    difference: float
    detectable: float
    spread: Spread
    family: int
    clips: Clips | None
    clips_longer: Clips | None


def plans(scores: Scores, points: float, power: float = POWER) -> list[Plan]:
    """Plan for every two configurations how to detect a difference of ``points`` points of FRR."""
    pairs = list(_pairs(scores))
    return [_plan(one, two, units, points / 100, power, len(pairs)) for one, two, units in pairs]


def _pairs(scores: Scores) -> Iterator[tuple[str, str, Units]]:
    for one, two in combinations(without_oracles(scores.scored_configurations), 2):
        units = pair(scores.frames_of(one), scores.frames_of(two)).units
        if units is not None:
            yield one, two, units


def _plan(reference: str, configuration: str, units: Units, difference: float, power: float, family: int) -> Plan:
    spread = Spread.of(units)
    return Plan(
        reference=reference,
        configuration=configuration,
        difference=units.rate,
        detectable=detectable_difference(units, family, power),
        spread=spread,
        family=family,
        clips=clips_needed(spread, difference, power=power, family=family),
        clips_longer=clips_needed(spread, difference, looks=2 * spread.looks, power=power, family=family),
    )


def plan_table(found: list[Plan], points: float, power: float = POWER) -> Table:
    """The clips and looks that every two configurations need."""
    family = found[0].family if found else 1
    return Table(
        title=f"Clips needed to see a difference of {points:g} points",
        columns=(
            *("Configuration", "Against", "Points now", "Detectable now", "Spread of clips", "Spread of looks"),
            *("Clips", "Range", "Power %", "Twice the looks"),
        ),
        words=2,
        rows=tuple(
            (
                *(each.configuration, each.reference, f"{100 * each.difference:+.1f}", _points(each.detectable)),
                *(_deviation(each.spread.between), _deviation(each.spread.within)),
                *_clips(each.clips),
                UNKNOWN if each.clips_longer is None else str(each.clips_longer.needed),
            )
            for each in found
        ),
        notes=(
            f"Clips: as many as find a true difference of this size significant at 5 %, corrected for {family} "
            f"comparison{'s' if family > 1 else ''}, with a probability of {100 * power:.0f} %; at least "
            f"{LEAST_CLIPS}, the fewest that a test by clip takes. Power: that probability for the clips given. Twice "
            "the looks: the clips if each has twice as many looks.",
            "The spread of few clips is uncertain itself: power is averaged over the spreads that these clips leave "
            "possible. Range: the clips if the spread is at the ends of its own 80 % interval. Few clips make it wide: "
            "plan again when there are more.",
            "Spread: standard deviation of the difference between clips, and what the looks of one clip add to it, "
            "in points. The differences of clips are taken as normal and independent.",
        ),
    )


def _clips(clips: Clips | None) -> tuple[str, str, str]:
    if clips is None:
        return UNKNOWN, UNKNOWN, UNKNOWN
    most = "more than 100000" if clips.most is None else str(clips.most)
    return str(clips.needed), f"{clips.fewest} to {most}", f"{100 * clips.power:.0f}"


def _points(share: float) -> str:
    return UNKNOWN if math.isnan(share) else "none" if math.isinf(share) else f"{100 * share:.1f}"


def _deviation(variance: float) -> str:
    return UNKNOWN if math.isnan(variance) else f"{100 * math.sqrt(variance):.1f}"
