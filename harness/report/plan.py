"""The number of clips and looks needed to see a difference, from the spread of a finished run."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

from harness.report.formats import UNKNOWN, Table
from harness.score.comparison import POWER, Spread, clips_needed, detectable_difference
from harness.score.intervals import LEAST_CLIPS, Units
from harness.score.oracle_ablation import without_oracles
from harness.score.score import Scores
from harness.score.scored_frames import pair


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """Clips that two configurations need: ``clips`` with as many looks each as now, ``clips_longer`` with twice those.

    ``difference`` is the observed one, ``detectable`` the one that this run can detect; all three are shares. None: not
    reachable, or not known from so few clips.
    """

    reference: str
    configuration: str
    difference: float
    detectable: float
    spread: Spread
    clips: int | None
    clips_longer: int | None


def plans(scores: Scores, points: float, power: float = POWER) -> list[Plan]:
    """Plan for every two configurations how to detect a difference of ``points`` points of FRR."""
    return [_plan(one, two, units, points / 100, power) for one, two, units in _pairs(scores)]


def _pairs(scores: Scores) -> Iterator[tuple[str, str, Units]]:
    for one, two in combinations(without_oracles(scores.scored_configurations), 2):
        units = pair(scores.frames_of(one), scores.frames_of(two)).units
        if units is not None:
            yield one, two, units


def _plan(reference: str, configuration: str, units: Units, difference: float, power: float) -> Plan:
    spread = Spread.of(units)
    return Plan(
        reference=reference,
        configuration=configuration,
        difference=units.rate,
        detectable=detectable_difference(units, power),
        spread=spread,
        clips=clips_needed(spread, difference, power=power),
        clips_longer=clips_needed(spread, difference, looks=2 * spread.looks, power=power),
    )


def plan_table(found: list[Plan], points: float, power: float = POWER) -> Table:
    """The clips and looks that every two configurations need."""
    return Table(
        title=f"Clips needed to see a difference of {points:g} points",
        columns=(
            *("Configuration", "Against", "Points now", "Detectable now", "Spread of clips", "Spread of looks"),
            *("Looks per clip", "Clips", "Looks", "Clips at twice the looks"),
        ),
        words=2,
        rows=tuple(
            (
                *(each.configuration, each.reference, f"{100 * each.difference:+.1f}", _points(each.detectable)),
                *(_deviation(each.spread.between), _deviation(each.spread.within)),
                f"{each.spread.looks:.1f}",
                UNKNOWN if each.clips is None else str(each.clips),
                UNKNOWN if each.clips is None else str(math.ceil(each.clips * each.spread.looks)),
                UNKNOWN if each.clips_longer is None else str(each.clips_longer),
            )
            for each in found
        ),
        notes=(
            "Clips and looks on which a true difference of this size is found significant at 5 %, before Holm, in "
            f"{100 * power:.0f} of 100 experiments; at least {LEAST_CLIPS} clips, the fewest that a test by clip "
            "takes.",
            "Spread: standard deviation of the difference between clips, and what the looks of one clip add to it, "
            "in points. A look is at least 2 s long. A spread that few clips have shown is uncertain itself: plan "
            "again when there are more.",
        ),
    )


def _points(share: float) -> str:
    return UNKNOWN if math.isnan(share) else f"{100 * share:.1f}"


def _deviation(variance: float) -> str:
    return UNKNOWN if math.isnan(variance) else f"{100 * math.sqrt(variance):.1f}"
