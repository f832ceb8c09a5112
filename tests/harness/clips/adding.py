"""Sources on disk for `vfoa clips add`, and the verb itself."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from harness.cli.clips import app
from tests.calibrations import RIG, opencv_nodes, write_opencv
from tests.disk import HEIGHT, WIDTH, picture, sintel_scene, write_image, write_text, write_video
from tests.recordings import rectified_camera, write_pairs
from vfoa.errors import VfoaError

NUMBERS = ("--fx", "100", "--cx", "31.5", "--cy", "23.5", "--baseline", "0.12")


LEFT = rectified_camera(WIDTH, HEIGHT, fx=100.0, cx=31.5, cy=23.5)


RIGHT = rectified_camera(WIDTH, HEIGHT, fx=100.0, cx=31.5, cy=23.5, baseline_m=0.12)


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A source on disk: how it is made (the path to add), the options it needs, and what is to be found there."""

    make: Callable[[Path], Path]
    options: tuple[str, ...] = ()
    adapter: str
    frames: int = 3
    baseline_m: float = 0.12


def scene_folder(root: Path) -> Path:
    return sintel_scene(root) / "training" / "clean_left" / "alley"


def final_scene(root: Path) -> Path:
    training = sintel_scene(root) / "training"
    for side in ("left", "right"):
        shutil.copytree(training / f"clean_{side}", training / f"final_{side}")
    return root


def recording(path: Path, numbers: range = range(1, 4)) -> Path:
    pairs = ((n * 40_000_000, picture(n), picture(1000 + n), LEFT, RIGHT) for n in numbers)
    return write_pairs(path, pairs)


def split_recording(root: Path) -> Path:
    recording(root / "day_0.mcap")
    recording(root / "day_1.mcap", range(4, 6))
    return root


def views(number: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Two views of a smooth wall, eight pixels apart: halves of one picture that look alike."""
    noise = np.random.default_rng(number).integers(0, 256, (HEIGHT, WIDTH + 8, 3), dtype=np.uint8)
    wall = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 1), None, 0, 255, cv2.NORM_MINMAX)
    return wall[:, :WIDTH], wall[:, 8:]


def images(root: Path, left: str, right: str) -> Path:
    for number in (1, 2, 3):
        for name, image in zip((left, right), views(number), strict=True):
            write_image(root / name.format(number), image)
    return root


def kitti(root: Path, left: str = "image_2/{:06d}.png", right: str = "image_3/{:06d}.png") -> Path:
    """The odometry set's layout: one baseline for the gray cameras, another for the colour ones, as there."""
    columns = {0: 0, 1: -12, 2: 4, 3: -8.5}
    lines = [f"P{camera}: 100 0 31.5 {column} 0 100 23.5 0 0 0 1 0\n" for camera, column in columns.items()]
    write_text(root / "calib.txt", "".join(lines))
    return images(root, left, right)


def packed(root: Path, axis: int) -> Path:
    for number in (1, 2, 3):
        write_image(root / f"{number:04d}.png", np.concatenate(views(number), axis=axis))
    return root


def video_pair(root: Path) -> Path:
    for side, name in enumerate(("left.avi", "right.avi")):
        write_video(root / name, [views(number)[side] for number in (1, 2, 3)])
    return root


def wide_video(path: Path) -> Path:
    return write_video(path, [np.concatenate(views(number), axis=1) for number in (1, 2, 3)])


def opencv_file(root: Path) -> Path:
    """A folder of pairs with the file that ``stereoRectify``'s matrices were written to."""
    images(root, "left/{}.png", "right/{}.png")
    storage = cv2.FileStorage(str(root / "stereo.yml"), cv2.FILE_STORAGE_WRITE)
    for name, column in (("P1", 0.0), ("P2", -12.0)):
        storage.write(name, np.array([[100, 0, 31.5, column], [0, 100, 23.5, 0], [0, 0, 1, 0]]))
    storage.release()
    return root


KINDS = {
    "two-folders": Kind(
        make=lambda root: images(root, "left/{}.png", "right/{}.png"), options=NUMBERS, adapter="stereo_folder"
    ),
    "one-folder": Kind(
        make=lambda root: images(root, "l_{}.png", "r_{}.png"), options=NUMBERS, adapter="stereo_folder"
    ),
    "side-by-side": Kind(make=lambda root: packed(root, axis=1), options=NUMBERS, adapter="stereo_folder"),
    "top-bottom": Kind(make=lambda root: packed(root, axis=0), options=NUMBERS, adapter="stereo_folder"),
    "two-videos": Kind(make=video_pair, options=NUMBERS, adapter="stereo_folder"),
    "wide-video": Kind(make=lambda root: wide_video(root / "a.avi"), options=NUMBERS, adapter="stereo_folder"),
    "opencv": Kind(make=opencv_file, adapter="stereo_folder"),
    "kitti-colour": Kind(make=kitti, adapter="stereo_folder", baseline_m=0.125),
    "kitti-gray": Kind(
        make=lambda root: kitti(root, "image_0/{:06d}.png", "image_1/{:06d}.png"), adapter="stereo_folder"
    ),
    "sintel-scene": Kind(make=scene_folder, adapter="sintel", baseline_m=0.1),
    "sintel-set": Kind(make=sintel_scene, adapter="sintel", baseline_m=0.1),
    "sintel-final": Kind(make=final_scene, options=("--set", "pass=final"), adapter="sintel", baseline_m=0.1),
    "mcap": Kind(make=lambda root: recording(root / "table.mcap"), adapter="mcap"),
    "mcap-split": Kind(make=split_recording, adapter="mcap", frames=5),
}


def vfoa(*arguments: str | Path) -> Any:
    """The JSON that a verb of `vfoa clips` prints."""
    found = CliRunner().invoke(app, [*map(str, arguments), "--json"], catch_exceptions=False)
    assert found.exit_code == 0, found.output
    return json.loads(found.stdout)


def refused(*arguments: str | Path) -> str:
    """The one line with which `vfoa clips add` refuses; nothing is written then."""
    with pytest.raises(VfoaError) as error:
        CliRunner().invoke(app, ["add", *map(str, arguments)], catch_exceptions=False)
    assert not list(Path.cwd().rglob("*.toml"))
    assert not list(Path.cwd().rglob("*.csv"))
    assert "\n" not in str(error.value)
    return str(error.value)


def opencv_sample(root: Path) -> None:
    nodes = opencv_nodes(RIG)
    write_opencv(root / "intrinsics.yml", {name: value for name, value in nodes.items() if name[-1] in "12"})
    write_opencv(root / "extrinsics.yml", {"R": nodes["R"], "T": nodes["T"]})
