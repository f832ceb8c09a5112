"""Models of gaze and head pose on faces that the border of the image cuts: whether one is found, how far answers turn.

Each photograph has one face. The image is made to end within it, at each of its four sides; the camera stays where it
is. The weights are looked for as by ``vfoa models list``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from harness.report.formats import Table
from scripts.measure.mirror import frame_of, read_rgb
from scripts.measure.printing import print_tables
from scripts.measure.turned_faces import Model, answers_of, given_photographs, models, surest, turns_of, turns_row
from vfoa.heads.yunet import YuNet
from vfoa.types import Float, StereoFrame

SHARES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
"""Shares of the face's box that are cut off."""
SIDES = range(4)
"""Left, top, right and bottom."""


def measure(photograph: Path, models: Mapping[str, Model], faces: YuNet) -> dict[float, list[dict[str, float] | None]]:
    """The turn of each model's answer at each share and side, degrees, from that in the photograph.

    None: the face is not found.
    """
    frame = frame_of(read_rgb(photograph))
    head = surest(faces.faces(frame))
    face_px = head.box_px if head.face_box_px is None else head.face_box_px
    before = answers_of(models, frame, head)
    return {
        share: [turns_of(models, cut_at(frame, face_px, side, share), faces, before) for side in SIDES]
        for share in SHARES
    }


def cut_at(frame: StereoFrame, face_px: Float, side: int, share: float) -> StereoFrame:
    """The part of a frame without a share of a face's box (4,) at one side, and all beyond it; the same camera."""
    size_px = (face_px[2:] - face_px[:2])[side % 2]
    edges = [0, 0, frame.rig.width_px, frame.rig.height_px]
    at = face_px[side] + (share if side < 2 else -share) * size_px
    edges[side] = int(np.clip(round(at), 0, edges[2 + side % 2]))
    left, top, right, bottom = edges
    image = np.ascontiguousarray(frame.left[top:bottom, left:right])
    rig = replace(
        frame.rig,
        width_px=right - left,
        height_px=bottom - top,
        cx_px=frame.rig.cx_px - left,
        cy_px=frame.rig.cy_px - top,
        cx_right_px=frame.rig.cx_right_px - left,
    )
    return replace(frame, left=image, right=image, rig=rig)


def cut_faces_table(
    found: Sequence[Mapping[float, Sequence[Mapping[str, float] | None]]], names: Sequence[str]
) -> Table:
    """One row for each share: the faces that are found, and the mean turn of each model's answer."""
    rows = tuple(
        turns_row(f"{100 * share:.0f} %", [cut for each in found for cut in each[share]], names) for share in SHARES
    )
    return Table(title="Faces cut by the image's border", columns=("cut off", "found", *names), rows=rows, words=0)


def main() -> None:
    """Measure the models on photographs and print a table."""
    photographs, known, faces = given_photographs(__doc__), models(), YuNet(YuNet.Settings())
    print_tables(cut_faces_table([measure(path, known, faces) for path in photographs], list(known)))
