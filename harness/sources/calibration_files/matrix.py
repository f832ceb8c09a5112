"""A bare camera matrix in a text (``K.txt``): nine numbers, and the baseline in metres on a line of its own.

The matrix is on one line (``700 0 639.5 0 700 359.5 0 0 1``) or on three, the baseline alone (``0.12``) or with a name
(``baseline: 0.12``).
"""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np

from harness.sources.calibration import Calibration
from harness.sources.calibration_files.incomplete import IncompleteCalibrationError
from vfoa.errors import VfoaError

_COMMENT = re.compile(r"#.*")
_BASELINE = re.compile(r"baseline(?:_m)?\s*[:=]?\s*", re.IGNORECASE)


def is_matrix(text: str) -> bool:
    """Whether a text begins with a line of three or nine numbers."""
    first = next(iter(_lines(text)), "")
    numbers = _numbers(first)
    return numbers is not None and len(numbers) in (3, 9)


def read(path: Path, text: str, baseline_m: float | None) -> Calibration:
    """Return the rectified pair of two cameras that share this matrix.

    Parameters
    ----------
    baseline_m
        Baseline in metres for a file that does not hold one.

    Raises
    ------
    VfoaError
        If there are not nine numbers, and at most one after them, they are no camera matrix, or no baseline is known
        (:class:`IncompleteCalibrationError`).
    """
    found = [number for line in _lines(text) for number in _numbers(_BASELINE.sub("", line)) or [math.nan]]
    if len(found) not in (9, 10) or not np.isfinite(found).all():
        raise VfoaError(f"{path}: found {len(found)} values; expected a camera matrix of 3 x 3 numbers and a baseline")
    k = np.array(found[:9]).reshape(3, 3)
    if not (k[0, 0] > 0 and k[1, 1] > 0 and np.array_equal(k[2], [0, 0, 1]) and k[1, 0] == 0):
        raise VfoaError(f"{path}: found {k.tolist()}; expected a camera matrix [fx 0 cx; 0 fy cy; 0 0 1]")
    baseline = found[9] if len(found) == 10 else baseline_m
    if baseline is None:
        raise IncompleteCalibrationError(
            f"{path}: a camera matrix without a baseline; expected a line with the distance of the two cameras in "
            "metres, or --baseline METRES (baseline_m in [source])"
        )
    if not baseline > 0:
        raise VfoaError(f"{path}: the baseline is {baseline:g}; expected a positive number of metres")
    fx, fy, cx, cy = (float(k[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return Calibration(fx_px=fx, fy_px=fy, cx_px=cx, cy_px=cy, cx_right_px=cx, baseline_m=float(baseline))


def _lines(text: str) -> list[str]:
    return [line for each in text.splitlines() if (line := _COMMENT.sub("", each).strip())]


def _numbers(line: str) -> list[float] | None:
    """The numbers of a line, with or without brackets and commas; None if it holds anything else."""
    try:
        return [float(word) for word in re.sub(r"[\[\],;]", " ", line).split()]
    except ValueError:
        return None
