"""A camera that is known by its field of view alone."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from harness.cli.clips import app
from harness.clips.manifest import load_manifest
from harness.sources.depth_optics import Intrinsics
from tests.disk import HEIGHT, WIDTH, picture, stereo_pair_folder, write_image, write_text
from vfoa.errors import VfoaError
from vfoa.validation import parse


@given(fov_deg=st.floats(5, 170), width=st.integers(16, 4000), height=st.integers(16, 3000))
def test_the_outer_edges_of_an_image_are_the_field_of_view_apart(fov_deg: float, width: int, height: int) -> None:
    camera = Intrinsics(fov_deg=fov_deg, baseline_m=0.1).pair("x", lambda: (width, height))
    left, right = ((edge - camera.cx_px) / camera.fx_px for edge in (-0.5, width - 0.5))
    assert math.degrees(math.atan(right) - math.atan(left)) == pytest.approx(fov_deg)
    top, bottom = ((edge - camera.cy_px) / camera.fy_px for edge in (-0.5, height - 0.5))
    assert top == pytest.approx(-bottom)
    assert camera.fx_px == camera.fy_px


def _add(*options: str) -> tuple[int, str]:
    found = CliRunner().invoke(app, ["add", *options])
    return found.exit_code, found.output if found.exception is None else str(found.exception)


@pytest.mark.parametrize("packed", [False, True])
def test_a_clip_is_added_by_field_of_view_and_baseline(
    packed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    options = ["--set", "layout=images_side_by_side"] if packed else []
    if packed:  # the field of view is that of one view, half of the picture
        for number in (1, 2, 3):
            both = np.hstack([picture(number), picture(1000 + number)])
            write_image(tmp_path / "pairs" / f"{number}.png", both)
    else:
        stereo_pair_folder(tmp_path / "pairs")
    assert _add("pairs", "--name", "mine", "--fov-deg", "90", "--baseline", "0.12", *options)[0] == 0
    rig = load_manifest("mine").open_images().frame(1).rig
    assert (rig.width_px, rig.height_px) == (WIDTH, HEIGHT)
    assert (rig.fx_px, rig.fy_px) == pytest.approx((WIDTH / 2, WIDTH / 2))
    assert (rig.cx_px, rig.cy_px) == ((WIDTH - 1) / 2, (HEIGHT - 1) / 2)
    assert rig.baseline_m == 0.12
    checked = CliRunner().invoke(app, ["check", "mine", "--json"])
    assert "a field of view of 90 degrees" in " ".join(json.loads(checked.stdout)[0]["notes"])


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--fov-deg", "90", "--baseline", "0.1", "--fx", "700"], "--fov-deg and --fx: found both"),
        (["--fov-deg", "90", "--calibration", "c.yaml"], "--fov-deg and --calibration: found both"),
        (["--fov-deg", "90"], r"baseline_m: missing"),
        (["--fov-deg", "190", "--baseline", "0.1"], "fov_deg"),
        ([], "--fov-deg"),
    ],
)
def test_what_is_missing_or_too_much_is_said(
    options: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    stereo_pair_folder(tmp_path / "pairs")
    write_text(tmp_path / "c.yaml", "")
    code, output = _add("pairs", *options)
    assert code != 0
    assert said in output
    assert not (tmp_path / "datasets").exists()


@pytest.mark.parametrize(
    ("camera", "said"),
    [
        ({"fov_deg": 90, "cx_px": 1.0}, "found fov_deg and cx_px"),
        ({"fx_px": 700, "cx_px": 1.0}, "cy_px: missing"),
        ({"baseline_m": 0.1}, "fx_px, cx_px, cy_px: missing"),
    ],
)
def test_a_manifest_gives_numbers_or_a_field_of_view(camera: dict[str, float], said: str) -> None:
    with pytest.raises(VfoaError, match=said):
        parse(Intrinsics, camera, "clip.toml", "source.camera")
