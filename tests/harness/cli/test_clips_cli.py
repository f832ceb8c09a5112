from __future__ import annotations

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from harness.cli.clips import app
from harness.clips.families import clip_files
from harness.clips.listing import clips_at_hand, clips_named
from harness.clips.matching import MATCHED_SIDE_PX, matched_offsets_px
from tests.disk import labels_text, write_bytes, write_image, write_text
from tests.recordings import rectified_camera, write_pairs
from vfoa.errors import VfoaError

WIDTH, HEIGHT, DISPARITY = 192, 144, 12
CAMERA = "fx_px = 300.0\ncx_px = 95.5\ncy_px = 71.5\nbaseline_m = 0.1\n"
MANIFEST = f"""
name = "wall"
adapter = "stereo_folder"
root = "wall"
[source]
left = "left"
right = "right"
rate_hz = 25
[source.camera]
{CAMERA}
[subjects.girl]
category = "person"
[targets.bird]
category = "bird"
"""
LABELS = labels_text("1,3,girl,bird,")


def _textured(rows_apart: int) -> tuple[np.ndarray, np.ndarray]:
    """Two views of a flat wall with blobs, the right one also moved down by ``rows_apart``."""
    noise = np.random.default_rng(0).integers(0, 256, (HEIGHT + 40, WIDTH + 40), dtype=np.uint8)
    blobs = cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 3), None, 0, 255, cv2.NORM_MINMAX)
    wall = cv2.cvtColor(blobs, cv2.COLOR_GRAY2RGB)
    left = wall[20 : 20 + HEIGHT, 20 : 20 + WIDTH]
    right = wall[20 - rows_apart : 20 - rows_apart + HEIGHT, 20 + DISPARITY : 20 + DISPARITY + WIDTH]
    return left, right


def _clip(folder: Path, rows_apart: int = 0, manifest: str = MANIFEST, labels: str = LABELS) -> None:
    for n in (1, 2, 3):
        for side, image in zip(("left", "right"), _textured(rows_apart), strict=True):
            write_image(folder / "datasets" / "wall" / side / f"{n}.png", image)
    write_text(folder / "datasets" / "wall.toml", manifest)
    write_text(folder / "annotations" / "wall.csv", labels)


def _check(*arguments: str) -> tuple[int, dict[str, object]]:
    found = CliRunner().invoke(app, ["check", "--json", *arguments])
    return found.exit_code, json.loads(found.stdout)[0]


@pytest.fixture(autouse=True)
def _work_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.delenv("VFOA_DATA", raising=False)


@pytest.mark.parametrize("rows_apart", [0, 4])
def test_the_row_difference_is_measured(rows_apart: int) -> None:
    found = matched_offsets_px(*_textured(rows_apart))
    assert len(found) >= 30
    np.testing.assert_allclose(np.median(found, axis=0), (DISPARITY, -rows_apart), atol=0.1)


def test_the_row_difference_of_large_pictures_is_measured_in_their_own_pixels() -> None:
    factor = 1 + MATCHED_SIDE_PX // WIDTH
    size = (factor * WIDTH + 1, factor * HEIGHT)  # which no whole number of squares fills
    found = matched_offsets_px(*(cv2.resize(image, size) for image in _textured(4)))
    assert len(found) >= 30
    np.testing.assert_allclose(np.median(found, axis=0), (factor * DISPARITY, -factor * 4), atol=0.2 * factor)


def test_pictures_without_features_give_no_measure() -> None:
    flat = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    assert matched_offsets_px(flat, flat).shape == (0, 2)


def test_a_good_clip_passes(tmp_path: Path) -> None:
    _clip(tmp_path)
    code, found = _check("wall")
    assert code == 0
    assert found["problems"] == []
    assert (found["frames"], found["size_px"], found["baseline_m"], found["labels"]) == (3, [WIDTH, HEIGHT], 0.1, 3)


def test_rows_that_do_not_match_fail(tmp_path: Path) -> None:
    _clip(tmp_path, rows_apart=4)
    code, found = _check("wall")
    assert code == 2
    assert found["problems"] == ["matched points lie 4.0 rows apart (median); expected at most 1.5 in a rectified pair"]


def test_a_calibration_of_fisheye_lenses_is_recognised(tmp_path: Path) -> None:
    """The user says that four coefficients are k1, k2, p1, p2, and not of cv2.fisheye; OpenCV's file says neither."""
    matrix, lenses = np.array([[300, 0, 95.5], [0, 300, 71.5], [0, 0, 1.0]]), ([0, 0, 0.2, 0.0], [0, 0, -0.2, 0.0])
    document = {"K1": matrix.tolist(), "D1": lenses[0], "K2": matrix.tolist(), "D2": lenses[1]}
    document |= {"R": np.eye(3).tolist(), "T": [-0.1, 0, 0]}
    write_text(tmp_path / "datasets" / "wall" / "stereo.json", json.dumps(document))
    manifest = MANIFEST.replace(f"[source.camera]\n{CAMERA}", 'fisheye = false\ncalibration = "stereo.json"\n')
    _clip(tmp_path, manifest=manifest)
    pixels = np.stack(np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)), axis=-1).reshape(-1, 1, 2).astype(np.float64)
    for side, lens, view in zip(("left", "right"), lenses, _textured(0), strict=True):
        places = cv2.fisheye.undistortPoints(pixels, matrix, np.array(lens), P=matrix).reshape(HEIGHT, WIDTH, 2)
        seen = cv2.remap(view, places.astype(np.float32), None, cv2.INTER_LINEAR)
        for number in (1, 2, 3):
            write_image(tmp_path / "datasets" / "wall" / side / f"{number}.png", seen)
    code, found = _check("wall")
    assert code == 2
    (note,) = [note for note in found["notes"] if "fisheye" in note]
    assert note.endswith("say fisheye = true in [source]")
    write_text(tmp_path / "datasets" / "wall.toml", manifest.replace("fisheye = false", "fisheye = true"))
    code, found = _check("wall")
    assert (code, found["problems"]) == (0, [])
    assert not [note for note in found["notes"] if "rows apart" in note]


def test_images_that_were_rectified_before_are_recognised(tmp_path: Path) -> None:
    """The calibration turns the right camera by 20 mrad, of which nothing is left in the images."""
    turned, _ = cv2.Rodrigues(np.array([0.02, 0.0, 0.0]))
    matrix = [[300, 0, 95.5], [0, 300, 71.5], [0, 0, 1]]
    document = {"K1": matrix, "D1": [0] * 5, "K2": matrix, "D2": [0] * 5, "R": turned.tolist(), "T": [-0.1, 0, 0]}
    write_text(tmp_path / "datasets" / "wall" / "stereo.json", json.dumps(document))
    manifest = MANIFEST.replace(f"[source.camera]\n{CAMERA}", 'calibration = "stereo.json"\n')
    _clip(tmp_path, manifest=manifest)
    code, found = _check("wall")
    assert code == 2
    assert found["vertical_error_px"] == pytest.approx(300 * 0.02, rel=0.2)
    (note,) = [note for note in found["notes"] if "rectified" in note]
    assert "0.0 rows apart" in note
    assert "rectified = true in [source]" in note
    _clip(tmp_path, manifest=manifest.replace("calibration", "rectified = true\ncalibration"))
    code, found = _check("wall")
    assert code == 0
    assert not [note for note in found["notes"] if "rectified" in note]


def test_swapped_views_fail(tmp_path: Path) -> None:
    swapped = MANIFEST.replace('left = "left"', 'left = "x"').replace('"right"', '"left"').replace('"x"', '"right"')
    _clip(tmp_path, manifest=swapped)
    code, found = _check("wall")
    assert code == 2
    assert found["problems"] == [
        "matched points have a disparity of -12.0 px (median); expected a positive one (left and right swapped? "
        "exchange left = and right = in [source]; of packed views: swap = true)"
    ]


def test_principal_points_apart_shift_the_disparity(tmp_path: Path) -> None:
    """With cx_right = cx - 20 a point at a disparity of 12 px lies behind the cameras."""
    lines = [f"P{camera}: 300 0 {cx} {tx} 0 300 71.5 0 0 0 1 0\n" for camera, cx, tx in ((2, 95.5, 0), (3, 75.5, -30))]
    write_text(tmp_path / "datasets" / "wall" / "calib.txt", "".join(lines))
    camera = f"[source.camera]\n{CAMERA}"
    _clip(tmp_path, manifest=MANIFEST.replace(camera, 'calibration = "calib.txt"'))
    assert "a disparity of -8.0 px" in str(_check("wall")[1]["problems"])


def test_what_cannot_be_measured_is_said(tmp_path: Path) -> None:
    _clip(tmp_path)
    for path in (tmp_path / "datasets" / "wall").rglob("*.png"):
        write_image(path, np.full((HEIGHT, WIDTH, 3), 128 + ("left" in path.parts), np.uint8))
    code, found = _check("wall")
    assert (code, found["vertical_error_px"], found["matches"]) == (0, None, 0)
    assert found["notes"] == [
        "0 points were matched between left and right; rectification is checked from 30 on",
    ]
    assert "wall: note: 0 points" in CliRunner().invoke(app, ["check", "wall"]).stdout


def test_the_middle_frame_is_decoded_as_well(tmp_path: Path) -> None:
    _clip(tmp_path)
    for number in (4, 5):  # 1 to 5: first 1, middle 3, last 5
        for side, image in zip(("left", "right"), _textured(0), strict=True):
            write_image(tmp_path / "datasets" / "wall" / side / f"{number}.png", image)
    (tmp_path / "datasets" / "wall" / "left" / "3.png").write_bytes(b"")
    code, found = _check("wall")
    assert code == 2
    assert "left/3.png: the file is empty" in str(found["problems"])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"labels": LABELS.replace("bird", "brid")}, "wall.csv:3: unknown target 'brid'; did you mean 'bird'?"),
        ({"labels": LABELS.replace("1,3", "1,4")}, "wall.csv:3: frame 4 is outside the clip"),
        ({"manifest": MANIFEST.replace("0.1", "120.0")}, "the baseline is 120 m; expected 0.02 to 1 m"),
        ({"manifest": MANIFEST.replace("95.5", "800.0")}, "the principal point (800, 71.5) lies outside the image"),
        (
            {"manifest": MANIFEST.replace("targets.bird", 'targets."bird#2"')},
            "targets: found the name 'bird#2'",
        ),
        ({"manifest": MANIFEST.replace("left =", "lft =")}, "unknown key 'source.lft'; did you mean 'left'?"),
    ],
)
def test_a_bad_clip_fails_with_one_line(tmp_path: Path, change: dict[str, str], message: str) -> None:
    _clip(tmp_path, **change)  # type: ignore[arg-type]
    code, found = _check("wall")
    assert code == 2
    problems = found["problems"]
    assert isinstance(problems, list)
    assert message in problems[0]
    assert "\n" not in problems[0]


@pytest.mark.parametrize(
    ("rows", "unseen"),
    [
        (["1,bird,box,200,20,260,60,"], ["bird"]),  # of pictures twice as wide
        (["1,bird,box,0.1,0.2,0.4,0.6,"], ["bird"]),  # shares of width and height
        (["1,bird,box,20,20,60,60,1"], ["bird"]),
        (["1,bird,point,20,150,,,", "1,girl,head,20,20,60,60,"], ["bird"]),
        (["1,bird,box,-50,20,-10,60,", "3,bird,box,-10,20,30,60,"], []),  # it comes in
        (["1,bird,point,192,144,,,", "1,girl,head,150,100,260,200,"], []),
    ],
)
def test_a_drawn_shape_that_the_images_do_not_show_is_a_problem(
    tmp_path: Path, rows: list[str], unseen: list[str]
) -> None:
    _clip(tmp_path)
    header = "# vfoa drawn 1\nframe,name,kind,u0_px,v0_px,u1_px,v1_px,outside\n"
    write_text(tmp_path / "annotations" / "wall.drawn.csv", header + "".join(f"{row}\n" for row in rows))
    problems = _check("wall")[1]["problems"]
    assert isinstance(problems, list)
    assert [re.findall(r"drawn: the \w+ of '(\w+)' .*192 x 144", problem) for problem in problems] == [
        [name] for name in unseen
    ]


def test_a_baseline_whose_unit_is_said_passes(tmp_path: Path) -> None:
    far = MANIFEST.replace("0.1", "1.5")
    _clip(tmp_path, manifest=far)
    assert _check("wall")[0] == 2
    _clip(tmp_path, manifest=far.replace("[source]", '[source]\ncalibration_unit = "m"'))
    assert _check("wall")[0] == 0


@pytest.mark.parametrize(
    ("source", "camera", "keys"),
    [
        ("left = 'left'\nright = 'right'", CAMERA.replace("0.1", "120"), {"camera.baseline_m", "calibration_unit"}),
        ("left = 'left'\nright = 'right'\ncalibration = 'k.txt'", None, {"baseline_m", "calibration_unit"}),
        ("recording = 'wall.mcap'", None, {"baseline_m"}),
        ("recording = 'wall.mcap'", CAMERA.replace("0.1", "120"), {"camera.baseline_m"}),
    ],
)
def test_a_baseline_in_millimetres_is_corrected_by_keys_that_the_source_takes(
    tmp_path: Path, source: str, camera: str | None, keys: set[str]
) -> None:
    is_recording = "recording" in source
    table = "" if camera is None else f"[source.camera]\n{camera}"
    adapter = "mcap" if is_recording else "stereo_folder"
    _clip(tmp_path, manifest=f'name = "wall"\nadapter = "{adapter}"\nroot = "wall"\n[source]\n{source}\n{table}')
    write_text(tmp_path / "datasets" / "wall" / "k.txt", "300 0 95.5 0 300 71.5 0 0 1\n120\n")
    info = [rectified_camera(WIDTH, HEIGHT, fx=300, cx=95.5, cy=71.5, baseline_m=each) for each in (0, 120)]
    write_pairs(tmp_path / "datasets" / "wall" / "wall.mcap", [(1, *_textured(0), *info)])
    problems = _check("wall")[1]["problems"]
    assert isinstance(problems, list)
    (said,) = (problem for problem in problems if "the baseline is 120 m" in problem)
    assert {*re.findall(r"(?:camera\.)?baseline_m|calibration_unit", said)} == keys


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ({"fx_px": 5.6}, ["focal length of 5.6 px", "of 173 degrees"]),
        ({"fx_px": 4000.0}, ["of 3 degrees"]),
        ({"cx_px": 189.0, "cy_px": 142.0}, ["(189, 142) is 49% of the size away"]),
        ({"cy_px": 50.0}, ["(95.5, 50) is 15% of the size away"]),
        ({"cx_px": 70.0, "cy_px": 60.0, "fx_px": 200.0}, []),
    ],
)
def test_a_camera_of_other_images_is_noted(tmp_path: Path, numbers: dict[str, float], words: list[str]) -> None:
    """A focal length in millimetres, a calibration of twice the size, and a camera that is right."""
    lines = MANIFEST.splitlines(keepends=True)
    given = [next((f"{key} = {value}\n" for key, value in numbers.items() if key in line), line) for line in lines]
    _clip(tmp_path, manifest="".join(given))
    notes = [note for note in _check("wall")[1]["notes"] if "focal length" in note or "principal" in note]
    assert len(notes) == min(len(words), 1)
    assert [word for word in words if word not in "".join(notes)] == []


def test_images_that_decode_and_cannot_be_right(tmp_path: Path) -> None:
    _clip(tmp_path)
    for number in (1, 2, 3):
        left = tmp_path / "datasets" / "wall" / "left" / f"{number}.png"
        write_bytes(left.parents[1] / "right" / left.name, left.read_bytes())
    assert "frame 1, 2, 3: left and right are the same image" in str(_check("wall")[1]["problems"])
    for path in (tmp_path / "datasets" / "wall").rglob("*.png"):  # 12 bits in files of 16
        write_image(path, cv2.imread(str(path)).astype(np.uint16) << 4)
    assert "the brightest value of 3 frames is 15 of 255" in str(_check("wall")[1]["problems"])


@pytest.mark.parametrize("bits", [9, 14])
def test_pictures_of_fewer_bits_than_their_files_are_noted(tmp_path: Path, bits: int) -> None:
    _clip(tmp_path)
    pictures = {path: cv2.imread(str(path)) for path in (tmp_path / "datasets" / "wall").rglob("*.png")}
    deep = {path: np.round(picture / 255 * (2**bits - 1)).astype(np.uint16) for path, picture in pictures.items()}
    for path, picture in deep.items():
        write_image(path, picture)
    most = max(int(picture.max()) for picture in deep.values())
    (note,) = (note for note in _check("wall")[1]["notes"] if "16-bit" in note)
    assert f"use {bits} bits (the greatest value found is {most})" in note
    assert f"keep {bits - 8}" in note
    advised = note.partition("files: ")[2].rstrip(")") + ")"
    for path in pictures:
        exec(advised, {"cv2": cv2, "file": str(path)})
    code, result = _check("wall")
    assert code == 0
    assert not [note for note in result["notes"] if "16-bit" in note]
    for path, picture in pictures.items():
        assert np.abs(cv2.imread(str(path)).astype(int) - picture).max() <= 2


def test_pictures_of_16_bits_and_of_8_have_no_note(tmp_path: Path) -> None:
    _clip(tmp_path)
    assert not [note for note in _check("wall")[1]["notes"] if "16-bit" in note]
    for path in (tmp_path / "datasets" / "wall").rglob("*.png"):
        write_image(path, cv2.imread(str(path)).astype(np.uint16) * 257)
    assert not [note for note in _check("wall")[1]["notes"] if "16-bit" in note]


def test_a_misspelt_category_is_said(tmp_path: Path) -> None:
    _clip(tmp_path, manifest=MANIFEST.replace('"person"', '"persn"').replace('"bird"', '"dragon"'))
    notes = _check("wall")[1]["notes"]
    assert notes == ["subjects.girl: no model of COCO's categories knows 'persn'; did you mean 'person'?"]


@pytest.mark.parametrize(
    ("written", "meant"), [("persn", "person"), ("Person", "person"), ("TV", "tv"), ("tv", None), ("dragon", None)]
)
def test_a_category_is_found_in_capitals_too(tmp_path: Path, written: str, meant: str | None) -> None:
    _clip(tmp_path, manifest=MANIFEST.replace('category = "bird"', f'category = "{written}"'))
    notes = _check("wall")[1]["notes"]
    said = f"targets.bird: no model of COCO's categories knows {written!r}; did you mean {meant!r}?"
    assert notes == ([said] if meant else [])


def test_labels_behind_a_broken_link_are_said(tmp_path: Path) -> None:
    _clip(tmp_path)
    labels = tmp_path / "annotations" / "wall.csv"
    labels.unlink()
    labels.symlink_to("gone.csv")
    assert "wall.csv: a link to gone.csv, which does not exist" in str(_check("wall")[1]["problems"])


def test_a_near_scene_names_the_limit_and_a_better_one(tmp_path: Path) -> None:
    """The wall is 2.5 m away, for 300 px, 0.1 m and 12 px; with a baseline of 0.02 m it is at half a metre."""
    _clip(tmp_path, manifest=MANIFEST.replace("= 0.1", "= 0.02").replace("= 300.0", "= 200.0"))
    code, found = _check("wall")
    assert code == 0
    (note,) = found["notes"]  # type: ignore[misc]
    match = re.fullmatch(
        r"(\d+)% of the matches are nearer than stereo\.min_depth_m = 0\.45, .*=(0\.\d+) reaches them", note
    )
    assert match
    assert int(match[1]) > 90
    assert 0.85 * 200 * 0.02 / DISPARITY < float(match[2]) < 200 * 0.02 / DISPARITY


@pytest.mark.parametrize("columns", [40, 80, 200])
def test_no_terminal_is_too_narrow_for_a_column(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    _clip(tmp_path)
    monkeypatch.setenv("COLUMNS", str(columns))
    printed = CliRunner().invoke(app, ["check", "wall"]).stdout
    words = printed.split()
    assert all(word in words for word in ("wall", "ok", "192x144", "0.1000", "0.00", "labels", "baseline"))
    assert max(map(len, printed.splitlines())) <= max(columns, 80)


def test_a_truncated_image_fails_and_is_named(tmp_path: Path) -> None:
    _clip(tmp_path)
    path = tmp_path / "datasets" / "wall" / "right" / "3.png"
    write_bytes(path, path.read_bytes()[:-1000])
    found = CliRunner().invoke(app, ["check", "wall"])
    assert found.exit_code == 2
    assert f"{path}: truncated PNG" in found.stdout.replace("\n", "")


def test_the_list_works_without_the_data(tmp_path: Path) -> None:
    _clip(tmp_path)
    found = CliRunner().invoke(app, ["list", "--json"])
    assert found.exit_code == 0
    rows = {row["name"]: row for row in json.loads(found.stdout)}
    assert (rows["wall"]["frames"], rows["wall"]["labels"], rows["wall"]["problem"]) == (3, 3, None)
    bandage = rows["sintel_bandage_2"]
    assert (bandage["frames"], bandage["labels"], bandage["subjects"]) == (None, 50, ["girl"])
    assert "VFOA_DATA, which is not set" in bandage["problem"]


def test_frames_that_are_ignored_are_no_labels(tmp_path: Path) -> None:
    _clip(tmp_path, labels=LABELS.replace(",bird,", ",ignore,"))
    assert _check("wall")[1]["labels"] == 0


def test_all_clips_are_those_whose_data_is_at_hand(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _clip(tmp_path)
    write_text(tmp_path / "datasets" / "lab.toml", 'name = "lab"\nadapter = "stereo_folder"\nroot = "${LAB}/x"\n')
    (tmp_path / "datasets" / "torn.toml").write_text("name =")
    here, (without_data, packaged) = clips_at_hand()
    assert (here, without_data) == (["torn", "wall"], "LAB is not set: lab")
    assert "clips that came with vfoa" in packaged
    monkeypatch.setenv("LAB", "/lab")
    assert "lab" in clips_at_hand()[0]


@pytest.mark.parametrize("name", ["walls", "datasets/walls.toml"])
def test_a_family_stands_for_those_of_its_clips_that_are_here(tmp_path: Path, name: str) -> None:
    _clip(tmp_path)
    family = MANIFEST.replace('name = "wall"', "").replace('root = "wall"', 'root = "${CLIP}"')
    write_text(tmp_path / "datasets" / "walls.toml", family + "[clips]\nwall_1 = {}\nwall_2 = {}\nwall_3 = {}\n")
    for clip in ("wall_1", "wall_3"):
        (tmp_path / "datasets" / clip).symlink_to("wall")
    assert clips_named([name, "wall", "wall_3"]) == (["wall_1", "wall_3", "wall"], ["no files here: wall_2"])
    found = CliRunner().invoke(app, ["check", "--json", name])
    assert [(check["name"], check["frames"], check["problems"]) for check in json.loads(found.stdout)] == [
        ("wall_1", 3, []),
        ("wall_3", 3, []),
    ]


def test_without_clips_of_ones_own_those_of_the_package_are_at_hand() -> None:
    here, (without_data,) = clips_at_hand()
    assert "studio_table" in here
    assert without_data.startswith("VFOA_DATA is not set: ")
    assert "sintel_bandage_2" in without_data


def test_the_list_has_one_line_a_clip_in_80_columns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _clip(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    lines = CliRunner().invoke(app, ["list"]).stdout.splitlines()
    table = lines[3 : lines.index(" " * 80, 1)]
    assert all(len(line) <= 80 and line.split() for line in table)
    assert {line.split()[0] for line in table} == set(clip_files())


def test_the_tables_name_every_clip(tmp_path: Path) -> None:
    _clip(tmp_path)
    write_text(tmp_path / "datasets" / "torn.toml", MANIFEST.replace("name", "nam"))
    table, _, lines = CliRunner().invoke(app, ["list"]).stdout.partition(f"\n{' ' * 20}")
    # those of the working directory are first
    assert re.findall(r"^ (\w+)", table, re.MULTILINE)[1:4] == ["torn", "wall", "demo_1"]
    torn, without_data = lines.strip().splitlines()
    assert torn.startswith("torn: ")
    assert without_data.startswith("VFOA_DATA is not set: idiap_vfoa, ")
    assert without_data.endswith(", sintel_bandage_2")
    checked = CliRunner().invoke(app, ["check", "wall"])
    assert checked.exit_code == 0
    assert "192x144" in checked.stdout


def test_the_real_clips_pass(shared_data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VFOA_DATA", str(shared_data.resolve()))
    code, sintel = _check("sintel_bandage_2")
    assert (code, sintel["frames"], sintel["labels"]) == (0, 50, 50)
    code, kitti = _check("kitti_pair")
    assert (code, kitti["frames"], kitti["baseline_m"]) == (0, 1, pytest.approx(0.532, abs=0.002))


def test_a_download_without_a_folder_of_data_sets_is_refused() -> None:
    refused = CliRunner().invoke(app, ["fetch", "vr_objects"])
    assert isinstance(refused.exception, VfoaError)
    assert "VFOA_DATA is not set" in str(refused.exception)
    assert "--out" in str(refused.exception)
