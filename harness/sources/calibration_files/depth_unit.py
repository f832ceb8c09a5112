"""The unit of depth in whole numbers that people's scripts save beside a camera."""

from __future__ import annotations

import re
from pathlib import Path

from harness.sources.calibration_files.camera_tables import with_camera_table
from harness.sources.calibration_files.documents import document_suffix, numbers, read_document
from vfoa.errors import VfoaError

_DEPTH_SCALE = re.compile(
    r"(?:png_)?depth_?scale(?:_(mm|m|met(?:er|re)s?)(?:_per_(?:unit|count))?)?|scale", re.IGNORECASE
)
"""The name of the unit of depth in whole numbers."""
_METRES_PER_COUNT, _COUNTS_PER_METRE = 0.02, 50.0
"""Of a scale of depth: the most metres per count, and the least counts per metre, that are read."""


def counts_per_metre(path: Path) -> float | None:
    """The unit that the file of a camera says, in counts per metre.

    ``depth_scale`` is in metres per count, as of a RealSense (0.001), or in counts per metre, as of Open3D (1000);
    ``png_depth_scale`` and ``scale`` are those of NICE-SLAM and Replica. None: the file says none, or 1, which is a
    millimetre in BOP's data sets, and nothing beside depth in metres. ``depth_scale_m`` and ``depth_scale_mm`` have
    their units in their names.

    Raises
    ------
    VfoaError
        If it is neither.
    """
    document = with_camera_table(read_document(path)) if document_suffix(path) else {}
    for name in sorted(document, key=lambda name: name == "scale"):  # that of an image, maybe
        unit = _DEPTH_SCALE.fullmatch(str(name))
        if unit is None:
            continue
        (scale,) = numbers(document[name], f"{path}: {name}", 1) * (0.001 if unit[1] == "mm" else 1)
        if 0 < scale <= _METRES_PER_COUNT:
            return round(1 / float(scale), 2)  # a RealSense says 0.0010000000474974513
        if scale >= _COUNTS_PER_METRE:
            return float(scale)
        if scale != 1 and name != "scale":
            raise VfoaError(
                f"{path}: {name}: found {scale:g}; expected metres per count, such as 0.001, or counts per metre, such "
                "as 1000: say depth_scale = in [source], in counts per metre"
            )
    return None
