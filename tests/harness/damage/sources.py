"""Clips of the other kinds (MPI Sintel, an MCAP recording, a video of both views), each to be damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.disk import moving_picture, picture, sintel_camera, sintel_scene, write_image, write_text, write_video
from tests.harness.damage.project import put
from tests.harness.damage.table import Case, Damage, both, case, cut, flipped, gone, image, replaced, text
from tests.recordings import rectified_camera, write_pairs

CHECK = ("clips", "check", "mine")

SINTEL = 'name = "mine"\nadapter = "sintel"\nroot = "../data"\n[source]\nscene = "alley"\n'
MCAP = 'name = "mine"\nadapter = "mcap"\nroot = "../take.mcap"\n'
VIDEO = """\
name = "mine"
adapter = "stereo_folder"
root = ".."
[source]
both = "both.mkv"
layout = "video_side_by_side"
camera = { fx_px = 50.0, cx_px = 31.5, cy_px = 23.5, baseline_m = 0.1 }
"""

CAMERA = "data/training/camdata_left/alley/frame_0002.cam"


def sintel(root: Path) -> None:
    sintel_scene(root / "data")
    write_text(root / "datasets" / "mine.toml", SINTEL)


def mcap(root: Path) -> None:
    left, right = (rectified_camera(64, 48, 50.0, 31.5, 23.5, baseline) for baseline in (0.0, 0.1))
    pairs = [(k * 40_000_000, picture(k), picture(1000 + k), left, right) for k in range(1, 9)]
    write_pairs(root / "take.mcap", pairs, chunk_size=20_000)
    write_text(root / "datasets" / "mine.toml", MCAP)


def video(root: Path) -> None:
    pairs = [np.hstack([moving_picture(k), np.roll(moving_picture(k), -4, axis=1)]) for k in range(1, 9)]
    write_video(root / "both.mkv", pairs)
    write_text(root / "datasets" / "mine.toml", VIDEO)


def camera(fx_px: float) -> Damage:
    return lambda root: put(root / CAMERA, sintel_camera(fx_px))


def _nothing(root: Path) -> None:
    """Not damaged: what the others differ from."""


def _emptied(root: Path) -> None:
    for path in (root / "data" / "training" / "clean_left" / "alley").iterdir():
        path.unlink()


def _source(name: str, make: Damage, damage: Damage, *says: str) -> Case:
    return case(name, both(make, damage), *says, command=CHECK)


def odd(root: Path) -> None:
    """Images of both views side by side, an odd number of pixels wide."""
    write_image(root / "both" / "0001.png", picture(1, 65))
    manifest = VIDEO.replace("both.mkv", "both").replace("video_side_by_side", "images_side_by_side")
    write_text(root / "datasets" / "mine.toml", manifest)


TAKE, FILM = "take.mcap", "both.mkv"
FRAME = "data/training/clean_left/alley/frame_0002.png"

WHOLE = [
    _source("sintel whole", sintel, _nothing),
    _source("mcap whole", mcap, _nothing),
    _source("video whole", video, _nothing),
]

STILL_READ = [
    _source("mcap with a flipped bit in a chunk", mcap, flipped(TAKE, 0.5), "checksum", "damaged"),
    _source("mcap cut", mcap, cut(TAKE, 0.6), "take.mcap", "cut"),
    _source("video cut", video, cut(FILM, 0.6), "both.mkv"),
]
"""The usable part of them is used, and a message names the loss."""

DAMAGED = [
    _source("sintel camera of no focal length", sintel, camera(0.0), "frame_0002.cam"),
    _source("sintel image of another size", sintel, image(FRAME, np.zeros((9, 9, 3), np.uint8)), "frame_0002.png"),
    _source("sintel scene empty", sintel, _emptied, "alley"),
    _source("sintel scene gone", sintel, replaced("datasets/mine.toml", '"alley"', '"aley"'), "'alley'"),
    _source("mcap cut near its start", mcap, cut(TAKE, 0.01), "take.mcap"),
    _source("mcap gone", mcap, gone(TAKE), "take.mcap"),
    _source("video is text", video, text(FILM), "both.mkv"),
    _source("video gone", video, gone(FILM), "both.mkv"),
    _source("both views of odd width", odd, _nothing, "0001.png", "65"),
]
