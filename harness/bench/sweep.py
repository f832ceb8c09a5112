"""Time of attention under hundreds of cone settings, all at once and one by one."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from timeit import Timer

from harness.bench.attention import seeded_frame
from vfoa.attention import AttentionSettings, pay_attention
from vfoa.cone_sweep import ConeSweep

SETTINGS = tuple(
    AttentionSettings.model_validate(
        {"cones_deg": cones, "n_rays": n_rays, "weighting": weighting, "occlusion": occlusion}
    )
    for cones, n_rays, weighting, occlusion in itertools.product(
        [(5.0,), (10.4,), (15.0,), (20.0,), (25.6,), (30.0,), (40.0,), (60.0,), (90.0,), (10.4, 25.6), (20.0, 60.0)],
        [8, 16, 40, 80],
        ["adaptive", "equal", "gaze", "head"],
        ["ignore", "first_hit"],
    )
)
"""About as many as in a group of ``harness/experiments/sensitivity.toml``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SweepTiming:
    """Milliseconds per frame of one subject under every setting (the best of several rounds)."""

    settings: int
    boxes: int
    at_once_ms: float
    one_by_one_ms: float

    @property
    def times_faster(self) -> float:
        """Time of one by one over that of all at once."""
        return self.one_by_one_ms / self.at_once_ms


def time_sweep(*, boxes: int = 20, rounds: int = 5) -> SweepTiming:
    """Time both implementations on one seeded frame."""
    (subject,), targets = seeded_frame(boxes=boxes, subjects=1)
    sweep = ConeSweep(SETTINGS)

    def one_by_one() -> None:
        for settings in SETTINGS:
            pay_attention(subject, targets, settings)

    return SweepTiming(
        settings=len(SETTINGS),
        boxes=boxes,
        at_once_ms=1e3 * min(Timer(lambda: sweep.foci(subject, targets)).repeat(rounds, 1)),
        one_by_one_ms=1e3 * min(Timer(one_by_one).repeat(rounds, 1)),
    )
