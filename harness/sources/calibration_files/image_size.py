"""The size of the images in a calibration, under the names that people give it."""

from __future__ import annotations

import re
from collections.abc import Mapping

from harness.sources.calibration_files.documents import Document, numbers
from harness.sources.calibration_files.opencv_names import bare_name, one_level
from vfoa.errors import VfoaError
from vfoa.types import Float

_SIZES = {
    "width": ("width", "imagewidth", "imagesizewidth", "imgwidth", "imgw", "framewidth", "resolutionwidth"),
    "height": ("height", "imageheight", "imagesizeheight", "imgheight", "imgh", "frameheight", "resolutionheight"),
    "both": ("imagesize", "imgsize", "size", "imageshape", "imgshape", "framesize", "resolution", "imageresolution"),
}
"""Bare names of the size of the images, without the part that says of which camera, or in which unit, it is."""
_BESIDE_SIZE = re.compile(
    r"^(?:(?:left|right)(?:cam(?:era)?)?|cam(?:era)?(?:left|right))|(?:px)?(?:left|right|[lr012])?$"
)


def image_size(document: Document, matrix: Float | None, where: str) -> tuple[int, int] | None:
    """The (width, height) of the images of a calibration; None if the file does not say it.

    ``matrix``, K or P of a camera, tells whether rows or columns are first.
    """
    of_names = [(name := bare_name(each), _BESIDE_SIZE.sub("", name), value) for each, value in one_level(document)]
    of_names.sort(key=lambda of_name: of_name[0] == of_name[1])  # that of one camera counts if there is no other
    plain = {name: value for _, name, value in of_names}
    found = {role: [plain[name] for name in names if name in plain] for role, names in _SIZES.items()}
    named = [found["width"][0], found["height"][0]] if found["width"] and found["height"] else None
    values = named or next(iter(found["both"]), None)
    if values is None:
        return None
    if isinstance(values, Mapping):
        return image_size(values, matrix, where)
    values = re.findall(r"[0-9]+", values) if isinstance(values, str) else values  # 640x480
    if (given := numbers(values, f"{where}: image size")).size not in (2, 3):  # NumPy's shape has the channels, too
        raise VfoaError(f"{where}: image size: found {given.tolist()}; expected width and height")
    width, height = given[:2].tolist()
    if named is None and _is_shape(width, height, matrix):
        width, height = height, width
    return (int(width), int(height)) if width > 0 and height > 0 else None


def _is_shape(first: float, second: float, matrix: Float | None) -> bool:
    """Whether an image size is (rows, columns), as of NumPy or MATLAB: the principal point is nearer to that middle."""
    if matrix is None or matrix.size not in (9, 12) or not (first > 0 and second > 0):
        return False
    column, row = matrix.reshape(3, -1)[:2, 2]
    off = [abs(column / width - 0.5) + abs(row / height - 0.5) for width, height in ((first, second), (second, first))]
    return off[1] < off[0]
