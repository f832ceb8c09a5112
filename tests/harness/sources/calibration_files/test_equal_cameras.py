"""One camera beside a baseline, as people's scripts write it for depth from rectified images: it is both cameras."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.sources.calibration import Calibration
from harness.sources.calibration_files.one_camera import read_one_camera
from harness.sources.calibration_files.read import Options, find_calibrations, read_cameras
from tests.disk import write_text
from vfoa.errors import VfoaError

SIZE = (1280, 720)
NUMBERS = '"fx": 700, "fy": 705, "cx": 641.5, "cy": 359.5'
MATRIX = "[[700, 0, 641.5], [0, 705, 359.5], [0, 0, 1]]"
EXPECTED = (700.0, 705.0, 641.5, 359.5, 641.5, 0.12)


def _found(cameras: object) -> tuple[float, ...]:
    assert isinstance(cameras, Calibration)
    numbers = cameras.fx_px, cameras.fy_px, cameras.cx_px, cameras.cy_px, cameras.cx_right_px, cameras.baseline_m
    return tuple(round(number, 9) for number in numbers if number is not None)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("camera.json", f'{{{NUMBERS}, "baseline": 0.12}}'),
        ("camera.json", f'{{{NUMBERS}, "width": 1280, "height": 720, "baseline_mm": 120}}'),
        ("camera.json", f'{{"intrinsics": {{{NUMBERS}, "coeffs": [0, 0, 0, 0, 0]}}, "baseline_m": 0.12}}'),
        ("camera.json", f'{{"K": {MATRIX}, "baseline": 0.12}}'),
        ("camera.json", f'{{"camera_matrix": {MATRIX}, "dist_coeffs": [[0, 0, 0, 0, 0]], "baseline_cm": 12}}'),
        ("camera.yaml", "fx: 700\nfy: 705\ncx: 641.5\ncy: 359.5\nbaseline: 0.12\n"),
        ("camera.txt", "fx: 700\nfy: 705\ncx: 641.5\ncy: 359.5\nbaseline: 0.12  # metres\n"),
        ("intrinsics.txt", "# left camera\nFx = 700.0\nFy = 7.05e2\nCx = 641.5\nCy = 359.5\nbaseline_mm = 120\n"),
        ("camera_intrinsics.txt", "fx fy cx cy\n700 705 641.5 359.5\n0.12\n"),
        ("camera_intrinsics.txt", "# fx, fy, cx, cy\n700.0, 705.0, 641.5, 359.5\nbaseline: 0.12\n"),
        ("camera.txt", "fx 700\nfy 705\nppx 641.5\nppy 359.5\nbaseline 0.12\n"),
    ],
)
def test_its_numbers_are_those_of_both(name: str, content: str, tmp_path: Path) -> None:
    path = write_text(tmp_path / name, content)
    assert _found(read_cameras([path], lambda: SIZE)) == EXPECTED
    assert find_calibrations(tmp_path, lambda: SIZE) == ([(name,)], [])


def test_of_rectified_images_the_lens_does_not_matter(tmp_path: Path) -> None:
    path = write_text(tmp_path / "camera.json", f'{{"K": {MATRIX}, "D": [-0.2, 0.1, 0, 0, 0], "baseline": 0.12}}')
    assert _found(read_cameras([path], lambda: SIZE, Options(rectified=True))) == EXPECTED


@pytest.mark.parametrize("text", ["fx: 700\nfy: 705\ncx: 641.5\ncy: 359.5\n", "700 705 641.5 359.5\n"])
def test_a_text_may_be_of_a_single_camera(text: str, tmp_path: Path) -> None:
    path = write_text(tmp_path / "camera.txt", text)
    assert read_one_camera(path, SIZE).k.tolist() == [[700, 0, 641.5], [0, 705, 359.5], [0, 0, 1]]


@pytest.mark.parametrize("line", ["198 214 34 81", "1280 720 700 705", "700 641.5 705 359.5"])
def test_four_numbers_of_something_else_are_no_camera(line: str, tmp_path: Path) -> None:
    """A box, a size with focal lengths, and the principal point beside its focal length."""
    path = write_text(tmp_path / "box.txt", f"{line}\n")
    with pytest.raises(VfoaError, match=r"box\.txt: "):
        read_cameras([path], lambda: SIZE)
    with pytest.raises(VfoaError, match=r"box\.txt: "):
        read_one_camera(path, SIZE)
    assert find_calibrations(tmp_path, lambda: SIZE, Options(baseline_m=0.12)) == ([], [])
