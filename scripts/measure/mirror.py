"""Frames of real people, and the same seen in a mirror, or with pixels that are not square."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vfoa.types import Float, Head, Image, StereoFrame, StereoRig


def frame_of(image: Image, *, fx_px: float = 500.0, cx_px: float | None = None) -> StereoFrame:
    """A frame with the same picture (H, W, 3) RGB on both sides, the principal point at its centre by default."""
    height, width = image.shape[:2]
    cx = (width - 1) / 2 if cx_px is None else cx_px
    rig = StereoRig(
        width_px=width,
        height_px=height,
        fx_px=fx_px,
        fy_px=fx_px,
        cx_px=cx,
        cy_px=(height - 1) / 2,
        baseline_m=0.1,
        cx_right_px=cx,
    )
    return StereoFrame(index=0, time_ns=0, left=image, right=image, rig=rig)


def read_rgb(path: Path) -> Image:
    """An image file as (H, W, 3) RGB."""
    return np.ascontiguousarray(cv2.imread(str(path), cv2.IMREAD_COLOR)[..., ::-1])


def bandage_frame(shared_data: Path, number: int) -> StereoFrame:
    """A frame of Sintel's bandage_2, in which a girl's face is large and turned to the image's left.

    Its principal point is put off the centre on purpose: a mirror that forgets it is found out.
    """
    folder = shared_data / "sintel" / "training" / "clean_left" / "bandage_2"
    return frame_of(read_rgb(folder / f"frame_{number:04d}.png"), fx_px=896.0, cx_px=480.0)


def mirrored(frame: StereoFrame) -> StereoFrame:
    """The frame with left and right exchanged: u becomes width - 1 - u, the principal point with it."""
    width, rig = frame.rig.width_px, frame.rig
    flipped = np.ascontiguousarray(frame.left[:, ::-1])
    rig = replace(rig, cx_px=width - 1 - rig.cx_px, cx_right_px=width - 1 - rig.cx_right_px)
    return replace(frame, left=flipped, right=flipped, rig=rig)


def mirrored_head(head: Head, width_px: int) -> Head:
    """The head in the mirrored frame; its own left eye is then what was the right one."""

    def box(found: Float) -> Float:
        return np.array([width_px - 1 - found[2], found[1], width_px - 1 - found[0], found[3]])

    landmarks = head.landmarks_px
    return replace(
        head,
        box_px=box(head.box_px),
        face_box_px=None if head.face_box_px is None else box(head.face_box_px),
        landmarks_px=None if landmarks is None else landmarks[[1, 0, 2, 4, 3]] * [-1, 1] + [width_px - 1, 0],
    )


def mirrored_direction(direction: Float) -> Float:
    """A direction (3,) in the camera frame, seen in the mirror."""
    return direction * [-1, 1, 1]


def stretched(frame: StereoFrame, rows: int) -> StereoFrame:
    """The frame with this number of rows, as an anamorphic camera sees it."""
    factor = rows / frame.rig.height_px
    image = np.asarray(cv2.resize(frame.left, (frame.rig.width_px, rows), interpolation=cv2.INTER_LINEAR), np.uint8)
    cy_px = float(_stretched(frame.rig.cy_px, factor))
    rig = replace(frame.rig, height_px=rows, fy_px=frame.rig.fy_px * factor, cy_px=cy_px)
    return replace(frame, left=image, right=image, rig=rig)


def stretched_head(head: Head, factor: float) -> Head:
    """The head in the stretched frame, of ``factor`` times the rows."""

    def moved(found: Float) -> Float:
        moved = found.reshape(-1, 2).copy()
        moved[:, 1] = _stretched(moved[:, 1], factor)
        return moved.reshape(found.shape)

    return replace(
        head,
        box_px=moved(head.box_px),
        face_box_px=None if head.face_box_px is None else moved(head.face_box_px),
        landmarks_px=None if head.landmarks_px is None else moved(head.landmarks_px),
    )


def _stretched(v: Any, factor: float) -> Any:
    return (v + 0.5) * factor - 0.5
