"""Whole images, maps and recordings to begin with: each function writes one at a path, by the writers of the tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from tests import depth_recordings
from tests.disk import moving_picture, picture, sintel_camera, sintel_disparity, write_bytes, write_image
from tests.disk import write_video as write_film
from tests.recordings import Family, rectified_camera, write_pairs

SMALL = (32, 24)
"""Width and height of images in recordings."""


# Images and maps


def sintel_cam(path: Path) -> None:
    write_bytes(path, sintel_camera(100.0))


def dpt(path: Path) -> None:
    header = np.array([202021.25], "<f4").tobytes() + np.array([5, 4], "<i4").tobytes()
    write_bytes(path, header + np.ones(20, "<f4").tobytes())


def sintel_png(path: Path) -> None:
    write_image(path, sintel_disparity(np.full((4, 5), 7.0)))


def segments_png(path: Path) -> None:
    write_image(path, picture(3, 5, 4))


def png_16(path: Path) -> None:
    write_image(path, np.full((4, 5), 700, np.uint16))


def npy(path: Path) -> None:
    np.save(path, np.ones((4, 5), np.float32))


def pfm(path: Path) -> None:
    write_bytes(path, b"Pf\n5 4\n-1.0\n" + np.ones(20, "<f4").tobytes())


def exr(path: Path) -> None:
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"Z": np.ones((4, 5), np.float32)}) as file:
        file.write(str(path))


def image(path: Path) -> None:
    write_image(path, picture(1, 20, 10))


def turned_jpeg(path: Path) -> None:
    """With an orientation in EXIF, as phones write it."""
    image(path)
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    data = path.read_bytes()
    path.write_bytes(data[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + data[2:])


def video(path: Path) -> None:
    write_film(path, [moving_picture(k, *SMALL) for k in range(1, 5)])


# Recordings


def mcap(family: Family) -> Callable[[Path], Any]:
    def write(path: Path) -> None:
        left, right = (rectified_camera(*SMALL, 50.0, 15.5, 11.5, baseline) for baseline in (0.0, 0.1))
        pairs = [(k * 40_000_000, picture(k, *SMALL), picture(99 + k, *SMALL), left, right) for k in (1, 2)]
        write_pairs(path, pairs, family, chunk_size=9_000)

    return write


def shot(number: int) -> depth_recordings.Shot:
    lens = depth_recordings.Lens(width=SMALL[0], height=SMALL[1], fx=50.0, cx=15.5, cy=11.5)
    depth = np.full(SMALL[::-1], 900 + number, np.uint16)
    depth[:, :3] = 0
    return depth_recordings.Shot(
        stamp_ns=1_700_000_000_000_000_007 + number * 40_000_000,
        colour=moving_picture(number, *SMALL),
        depth_mm=depth,
        lens=lens,
    )


def depth_bag(kind: depth_recordings.Format) -> Callable[[Path], Any]:
    """One file of a recording of colour and depth, moved to where it is wanted."""

    def write(path: Path) -> None:
        made = depth_recordings.write_take(_folder(path.parent / "made"), kind, map(shot, (1, 2)), "rvl")
        file = made if made.is_file() else next(each for each in made.iterdir() if each.suffix == path.suffix)
        path.write_bytes(file.read_bytes())

    return write


def _folder(path: Path) -> Path:
    path.mkdir(parents=True, exist_ok=True)
    return path


def video_mcap(path: Path) -> None:
    shots = [shot(number) for number in range(3)]
    coder, options = depth_recordings.CODERS["h264"]
    packets = depth_recordings.Encoder(coder, *SMALL, options).packets([each.colour for each in shots])
    depth_recordings.write_video_take(path, "h264", packets, shots)
