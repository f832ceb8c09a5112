"""Looks: the unit of inference within a clip.

A look is a longest run of one true target of one subject. The frames of a look share what makes them right or wrong
(the target, its size and place, a slow error of the gaze), so they count as one observation, not as many. An error also
outlasts a short look: looks of less than :data:`LEAST_S` seconds are joined with the subject's next ones until they
last that long. ``reports/coverage.md`` shows the effect: without joining, a test by looks of 0.7 s calls equal
configurations different in about 10 % of experiments; with it, in about 6 %.
"""

from __future__ import annotations

import numpy as np

from harness.score.statistics import Codes

LEAST_S = 2.0
"""Seconds that a unit lasts at least, where a subject has as many."""


def number_looks(truth: Codes, positions: Codes, frames_per_second: float | None) -> Codes:
    """Number the looks of one subject's scored frames, 0 and up: (n,).

    Parameters
    ----------
    truth, positions
        The code of the true target and the place in the clip of each scored frame, in order: (n,).
    frames_per_second
        The rate of the clip's frames; None where it is not known: looks are not joined then.
    """
    if len(truth) == 0:
        return np.zeros(0, dtype=np.intp)
    steps = np.diff(positions)
    stride = float(np.median(steps)) if len(steps) else 1.0  # labels may be sparser than the clip's frames
    begins = np.concatenate(([True], (np.diff(truth) != 0) | (steps > 1.5 * stride)))
    looks = np.cumsum(begins) - 1
    if frames_per_second is None:
        return looks
    return _joined(np.bincount(looks) * stride / frames_per_second)[looks]


def _joined(seconds: np.ndarray) -> Codes:
    """The number of the unit that each look becomes a part of; a short rest at the end joins the unit before it."""
    units = np.zeros(len(seconds), dtype=np.intp)
    unit, lasted = 0, 0.0
    for look, each in enumerate(seconds.tolist()):
        if lasted >= LEAST_S:
            unit, lasted = unit + 1, 0.0
        units[look] = unit
        lasted += each
    if unit and lasted < LEAST_S:
        units[units == unit] = unit - 1
    return units
