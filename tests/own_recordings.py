"""Recordings as somebody brings them, of one scene with a genuine face, in five kinds of sources.

A photograph of a face (AFLW2000-3D, whose fits tell where the head points), a screen and a shelf stand before a wall.
Ann's head points at the screen in the first half of the frames; in the second half, the photograph is mirrored, and it
points at the shelf. Where both stand follows from the head's labelled direction.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from tests.calibrations import matrix, write_opencv
from tests.depth_recordings import Lens, Shot, write_take
from tests.disk import write_image, write_video
from tests.recordings import rectified_camera, write_pairs

WIDTH, HEIGHT, FX, CX, CY, BASELINE_M = 960, 540, 700.0, 479.5, 269.5, 0.12
FRAMES, STEP_NS, START_NS = range(1, 5), 500_000_000, 1_700_000_000_000_000_000
PHOTOGRAPH = "image02616"
EYES_PX, FACE_SIDE_PX, FACE_DISPARITY, WALL_DISPARITY = (480, 250), 170, 52, 28
EYES_IN_PHOTOGRAPH = (0.37, 0.55)
"""Of its width and height."""
REACH_M, THING_PX = 0.75, (150, 130)
CLOCK = (440, 40), (80, 60), 56
"""Corner and size in the left image, px, and disparity, px, of what is nearest to the eyes and never looked at."""


@dataclass(frozen=True, kw_only=True)
class Thing:
    """A flat picture that faces the cameras: its corner in the left image, px, and its disparity, px."""

    pixels: NDArray[np.uint8]
    corner_px: tuple[int, int]
    disparity: int


def noise(seed: int, height: int, width: int) -> NDArray[np.uint8]:
    """A texture that stereo matches well."""
    grain = np.random.default_rng(seed).normal(size=(height, width, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(grain, (0, 0), 2)
    return np.clip(120 + 60 * smooth / np.abs(smooth).max(), 0, 255).astype(np.uint8)


def things(data: Path, *, is_mirrored: bool) -> Iterator[Thing]:
    """What is seen, of the wall first."""
    yield Thing(pixels=noise(1, HEIGHT, WIDTH + WALL_DISPARITY), corner_px=(0, 0), disparity=WALL_DISPARITY)
    photograph = cv2.imread(str(data / "faces" / f"{PHOTOGRAPH}.jpg"))[..., ::-1]
    face = cv2.resize(photograph[:, ::-1] if is_mirrored else photograph, (FACE_SIDE_PX, FACE_SIDE_PX))
    across, down = EYES_IN_PHOTOGRAPH
    u, v = EYES_PX[0] - FACE_SIDE_PX * (1 - across if is_mirrored else across), EYES_PX[1] - FACE_SIDE_PX * down
    yield Thing(pixels=face, corner_px=(round(u), round(v)), disparity=FACE_DISPARITY)
    corner, (width, height), disparity = CLOCK
    yield Thing(pixels=noise(4, height, width), corner_px=corner, disparity=disparity)
    for seed, side in ((2, 1), (3, -1)):
        (u, v), disparity = pointed_at(data, side)
        width, height = THING_PX
        corner = round(u - width / 2), round(v - height / 2)
        yield Thing(pixels=noise(seed, height, width), corner_px=corner, disparity=disparity)


def pointed_at(data: Path, side: int) -> tuple[tuple[float, float], int]:
    """The point before the head to which it points, in the left image, and its disparity; ``side`` -1: mirrored."""
    pose = json.loads((data / "faces" / "pose.json").read_text())[PHOTOGRAPH]
    yaw, pitch = math.radians(side * pose["yaw_deg"]), math.radians(pose["pitch_deg"])
    towards = -math.sin(yaw), -math.sin(pitch) * math.cos(yaw), -math.cos(pitch) * math.cos(yaw)
    depth = FX * BASELINE_M / FACE_DISPARITY
    x, y, z = (
        start + REACH_M * part
        for start, part in zip(
            ((EYES_PX[0] - CX) / FX * depth, (EYES_PX[1] - CY) / FX * depth, depth), towards, strict=True
        )
    )
    return (CX + FX * x / z, CY + FX * y / z), round(FX * BASELINE_M / z)


@dataclass(frozen=True, kw_only=True)
class View:
    """Both images (H, W, 3) RGB and the depth of the left one, mm."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    depth_mm: NDArray[np.uint16]


@cache
def view(data: Path, *, is_mirrored: bool) -> View:
    left, right = (np.zeros((HEIGHT, WIDTH, 3), np.uint8) for _ in range(2))
    depth_mm = np.zeros((HEIGHT, WIDTH), np.uint16)
    for thing in things(data, is_mirrored=is_mirrored):
        u, v = thing.corner_px
        height, width = thing.pixels.shape[:2]
        for image, at in ((left, u), (right, u - thing.disparity)):
            first, last = max(at, 0), min(at + width, WIDTH)
            image[v : v + height, first:last] = thing.pixels[:, first - at : last - at]
        depth_mm[v : v + height, u : u + width] = round(1000 * FX * BASELINE_M / thing.disparity)
    return View(left=left, right=right, depth_mm=depth_mm)


def views(data: Path) -> Iterator[View]:
    for number in FRAMES:
        yield view(data, is_mirrored=number > len(FRAMES) // 2)


def stereo_folder(root: Path, data: Path) -> Path:
    """Pairs in two folders, and beside them what OpenCV's stereoCalibrate says of the cameras."""
    for number, each in zip(FRAMES, views(data), strict=True):
        write_image(root / "left" / f"{number:04d}.png", each.left)
        write_image(root / "right" / f"{number:04d}.png", each.right)
    k, d = matrix(FX, FX, CX, CY), np.zeros((1, 5))
    pose = {"R": np.eye(3), "T": np.array([[-BASELINE_M], [0], [0]])}
    write_opencv(root / "stereo.yml", {"K1": k, "D1": d, "K2": k, "D2": d, **pose}, (WIDTH, HEIGHT))
    return root


def mcap(root: Path, data: Path) -> Path:
    """A recording of ROS 2 with both images and their camera_info."""
    numbers = {"fx": FX, "cx": CX, "cy": CY}
    cameras = [rectified_camera(WIDTH, HEIGHT, **numbers, baseline_m=baseline_m) for baseline_m in (0.0, BASELINE_M)]
    pairs = ((START_NS + n * STEP_NS, each.left, each.right, *cameras) for n, each in enumerate(views(data)))
    return write_pairs(root / "desk.mcap", pairs)


def side_by_side(root: Path, data: Path) -> Path:
    """A film with both views in each picture, without loss."""
    pictures = [np.concatenate([each.left, each.right], axis=1) for each in views(data)]
    return write_video(root / "desk.avi", pictures, rate_hz=1e9 / STEP_NS)


def depth_bag(root: Path, data: Path) -> Path:
    """A bag of ROS 1 as RealSense's driver records it: colour and aligned depth."""
    root.mkdir(parents=True, exist_ok=True)
    lens = Lens(width=WIDTH, height=HEIGHT, fx=FX, cx=CX, cy=CY)
    shots = (
        Shot(stamp_ns=START_NS + n * STEP_NS, colour=each.left, depth_mm=each.depth_mm, lens=lens)
        for n, each in enumerate(views(data))
    )
    return write_take(root, "bag", shots, name="desk")
