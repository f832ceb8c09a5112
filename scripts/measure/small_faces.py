"""Models of gaze and head pose on faces that are made smaller: whether a face is found, and how far answers turn.

Each photograph has one face. It is shrunk about that face, in an image of the same size: what changes is only how many
pixels the face has. The weights are looked for as by ``vfoa models list``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np

from harness.report.formats import Table
from scripts.measure.mirror import frame_of, read_rgb
from scripts.measure.printing import print_tables
from scripts.measure.turned_faces import Model, answers_of, given_photographs, models, surest, turns_of, turns_row
from vfoa.heads.yunet import YuNet
from vfoa.types import Image

HEIGHTS_PX = (120, 80, 60, 48, 40, 32, 24)
"""Heights of the head's box to which photographs are shrunk."""
_SIDE_PX = 900
_GRAY = (114, 114, 114)


def measure(photograph: Path, models: Mapping[str, Model], faces: YuNet) -> dict[int, dict[str, float] | None]:
    """The turn of each model's answer at each height, degrees, from that in the photograph; None: no face is found."""
    image = read_rgb(photograph)
    box_px = surest(faces.faces(frame_of(image))).box_px
    whole = frame_of(shrunk(image, box_px, 1.0))
    before = answers_of(models, whole, surest(faces.faces(whole)))
    turns: dict[int, dict[str, float] | None] = {}
    for height_px in HEIGHTS_PX:
        frame = frame_of(shrunk(image, box_px, height_px / (box_px[3] - box_px[1])))
        turns[height_px] = turns_of(models, frame, faces, before)
    return turns


def shrunk(image: Image, box_px: Sequence[float], factor: float) -> Image:
    """A gray image with the photograph in it, made smaller by a factor, the middle of the box in its middle."""
    small = cv2.resize(image, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA) if factor != 1 else image
    u, v = ((low + high) / 2 for low, high in (box_px[0::2], box_px[1::2]))
    move = np.array([[1, 0, _SIDE_PX / 2 - factor * u], [0, 1, _SIDE_PX / 2 - factor * v]], np.float32)
    moved = cv2.warpAffine(small, move, (_SIDE_PX, _SIDE_PX), borderValue=_GRAY)
    return np.asarray(moved, dtype=np.uint8)


def small_faces_table(found: Sequence[Mapping[int, Mapping[str, float] | None]], names: Sequence[str]) -> Table:
    """One row for each height: the faces that are found, and the mean turn of each model's answer."""
    rows = tuple(turns_row(str(height_px), [each[height_px] for each in found], names) for height_px in HEIGHTS_PX)
    return Table(title="Faces that are small", columns=("head px", "found", *names), rows=rows, words=0)


def main() -> None:
    """Measure the models on photographs and print a table."""
    photographs, known, faces = given_photographs(__doc__), models(), YuNet(YuNet.Settings())
    print_tables(small_faces_table([measure(path, known, faces) for path in photographs], list(known)))
