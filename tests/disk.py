"""Small clips written to disk, with every pixel known."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from harness.studio.store import cache_folder

WIDTH, HEIGHT = 64, 48


def picture(seed: int, width: int = WIDTH, height: int = HEIGHT) -> NDArray[np.uint8]:
    """A random image (H, W, 3) RGB."""
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def write_image(path: Path, image: NDArray[np.generic]) -> Path:
    """Write gray or RGB pixels in the format of the path's suffix."""
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image if image.ndim == 2 else np.ascontiguousarray(image[..., ::-1]))
    return path


def write_bytes(path: Path, data: bytes) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def write_text(path: Path, text: str) -> Path:
    return write_bytes(path, text.encode())


LABELS_HEADER = "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note\n"


def labels_text(*rows: str) -> str:
    """A file of labels; a row is its first and last frame, subject, target and note: ``"1,12,ann,cup,"``."""
    return LABELS_HEADER + "".join(f"{row}\n" for row in rows)


def sintel_camera(fx_px: float, cx_px: float = 31.5, cy_px: float = 23.5) -> bytes:
    """A .cam file as the depth set's README describes it."""
    intrinsics = [fx_px, 0, cx_px, 0, fx_px, cy_px, 0, 0, 1]
    extrinsics = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]
    return struct.pack("<f", 202021.25) + struct.pack("<9d", *intrinsics) + struct.pack("<12d", *extrinsics)


def sintel_disparity(disparity_px: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Disparities (H, W) in the stereo set's encoding: d = 4 R + G / 64, to the next 1/64."""
    counts = np.round(np.asarray(disparity_px, dtype=np.float64) * 64).astype(np.int64)
    return np.stack([counts >> 8, counts & 255, np.zeros_like(counts)], axis=-1).astype(np.uint8)


def sintel_scene(root: Path, scene: str = "alley", frames: tuple[int, ...] = (1, 2, 3)) -> Path:
    """A scene in the official layout; fx is 100 + the frame's number, the left image of frame n is ``picture(n)``."""
    training = root / "training"
    for n in frames:
        write_image(training / "clean_left" / scene / f"frame_{n:04d}.png", picture(n))
        write_image(training / "clean_right" / scene / f"frame_{n:04d}.png", picture(1000 + n))
        write_bytes(training / "camdata_left" / scene / f"frame_{n:04d}.cam", sintel_camera(100.0 + n))
    return root


def stereo_pair_folder(root: Path, frames: tuple[int, ...] = (1, 2, 3)) -> Path:
    """Folders ``left`` and ``right`` of numbered PNG."""
    for n in frames:
        write_image(root / "left" / f"{n:06d}.png", picture(n))
        write_image(root / "right" / f"{n:06d}.png", picture(1000 + n))
    return root


def moving_picture(number: int, width: int = WIDTH, height: int = HEIGHT) -> NDArray[np.uint8]:
    """A smooth image (H, W, 3) RGB that differs for every number, so that lossy codecs keep numbers apart."""
    image = np.empty((height, width, 3), np.uint8)
    image[..., 0] = 128 + 100 * np.sin((np.arange(width) + 7 * number) / 9)
    image[..., 1] = 128 + 100 * np.cos((np.arange(height)[:, None] - 5 * number) / 11)
    image[..., 2] = (13 * number) % 256
    return image


def write_video(path: Path, images: list[NDArray[np.uint8]], fourcc: str = "FFV1", rate_hz: float = 25.0) -> Path:
    """Write RGB images as a video; FFV1 (in .mkv, .avi) keeps them nearly as they are, mp4v (in .mp4) predicts."""
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width = images[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, cv2.VideoWriter_fourcc(*fourcc), rate_hz, (width, height))
    assert writer.isOpened()
    for image in images:
        writer.write(np.ascontiguousarray(image[..., ::-1]))
    writer.release()
    return path


def share_rendered_frames(cache: Path) -> None:
    """Let a program with this cache of its own read the frames that were rendered before."""
    rendered = cache_folder("").absolute()
    rendered.mkdir(parents=True, exist_ok=True)
    cache.mkdir()
    (cache / "studio").symlink_to(rendered)
