"""`vfoa clips add` on every kind of source: what it writes, `vfoa clips check` passes as it is."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from harness.cli.clip_adding import MOST_FAILURES
from harness.cli.clips import app
from harness.cli.terminal import MOST_ROWS
from harness.clips.check import check_clip, depth_notes
from harness.clips.families import patterns_of
from harness.clips.manifest import load_manifest
from harness.sources import ADAPTERS, Recogniser
from tests.disk import HEIGHT, WIDTH, write_image, write_text, write_video
from tests.harness.clips.adding import (
    KINDS,
    NUMBERS,
    Kind,
    images,
    opencv_file,
    recording,
    refused,
    scene_folder,
    vfoa,
    views,
)
from tests.measured import measured_tables
from tests.scenes import make_rig
from vfoa.errors import VfoaError
from vfoa.types import StereoFrame

pytestmark = pytest.mark.usefixtures("work_here")


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_what_is_added_passes_the_check(tmp_path: Path, kind: Kind) -> None:
    path = kind.make(tmp_path / "data")
    added = vfoa("add", path, *kind.options, "--name", "mine", "--subject", "ann", "--target", "mug=cup")
    assert (added["adapter"], added["frames"]) == (kind.adapter, kind.frames)
    (checked,) = vfoa("check", "mine")
    assert checked["problems"] == []
    assert (checked["frames"], checked["size_px"]) == (kind.frames, [WIDTH, HEIGHT])
    assert checked["baseline_m"] == pytest.approx(kind.baseline_m)
    assert checked["labels"] == 0  # all frames are ignored until somebody labels them


def test_a_name_that_the_check_would_refuse_is_refused_and_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match="'ann#1'"):
        vfoa("add", scene_folder(tmp_path), "--name", "mine", "--subject", "ann#1")
    assert not Path("datasets/mine.toml").exists()
    assert not Path("annotations/mine.csv").exists()


@pytest.mark.parametrize("name", ["demo", "people", "benchmark"])
def test_no_clip_gets_a_name_under_which_vfoa_run_runs_something_else(tmp_path: Path, name: str) -> None:
    with pytest.raises(VfoaError, match=rf"{name}\.toml: vfoa run {name} .*--name NAME"):
        vfoa("add", scene_folder(tmp_path), "--name", name)
    assert not Path("datasets").exists()


def test_several_paths_are_clips_of_their_own(tmp_path: Path) -> None:
    for person in ("p01", "p02"):
        images(tmp_path / person / "rec", "left/{}.png", "right/{}.png")
        recording(tmp_path / person / "zed.mcap")
    folders = [str(tmp_path / person) for person in ("p01", "p02")]
    alike = [f"{folder}/zed.mcap" for folder in folders]
    assert [clip["name"] for clip in vfoa("add", *alike, "--subject", "ann")] == ["p01_zed", "p02_zed"]
    words = ["add", f"{folders[0]}/rec", f"{tmp_path}/gone", f"{folders[1]}/rec", *NUMBERS, "--subject", "ann"]
    found = CliRunner().invoke(app, words, catch_exceptions=False)
    assert (found.exit_code, found.stderr) == (2, f"not added: {tmp_path}/gone: no such file or folder\n")
    assert "next: vfoa clips check p01_rec p02_rec" in found.stdout.splitlines()
    names = ("p01_zed", "p02_zed", "p01_rec", "p02_rec")
    assert [check["problems"] for check in vfoa("check", *names)] == [[]] * 4
    assert {path.stem for path in Path("datasets").iterdir()} == {*names}


def test_many_clips_are_named_by_a_pattern_and_their_rows_and_errors_by_the_first_ones(tmp_path: Path) -> None:
    paths = [str(measured_tables(tmp_path / f"pilot_{k}")) for k in range(MOST_ROWS + 2)]
    gone = [str(tmp_path / f"gone_{k}") for k in range(MOST_FAILURES + 3)]
    found = CliRunner().invoke(app, ["add", *paths, *gone], catch_exceptions=False)
    lines = found.stdout.splitlines()
    assert sum("measured" in line and line.lstrip().startswith("pilot_") for line in lines) == MOST_ROWS
    assert "next: vfoa clips check 'pilot_*'" in lines
    assert "next: vfoa run 'pilot_*' --preset measured" in lines
    *errors, others = found.stderr.splitlines()
    assert errors == [f"not added: {path}: no such file or folder" for path in gone[:MOST_FAILURES]]
    assert others == f"not added: 3 paths more: {', '.join(gone[MOST_FAILURES:])}"
    (tmp_path / "pilot_7" / "people.csv").unlink()
    checked = CliRunner().invoke(app, ["check", "pilot_*"], catch_exceptions=False).stdout.splitlines()
    assert sum(line.lstrip().startswith("pilot_") for line in checked if "  ok  " in line) == MOST_ROWS - 1
    assert next(line for line in checked if " pilot_" in line).split()[:2] == ["pilot_7", "fails"]


def test_patterns_name_these_clips_and_no_others() -> None:
    for name in ("p01", "p02", "p1", "p10", "talk", "talk_1"):
        write_text(Path("datasets") / f"{name}.toml", "")
    assert patterns_of(["p01", "p02", "p1", "p10"]) == ["p*"]
    assert patterns_of(["talk", "p01", "p02"]) == ["talk", "p0*"]
    assert patterns_of(["p01", "p10", "p1", "talk_1"]) == ["p01", "p1*", "talk_1"]
    assert patterns_of(["p02"]) == ["p02"]


@pytest.mark.parametrize("option", [("--name", "mine"), ("--openface", "a.csv"), ("--gaze3d", "a.csv")])
def test_what_belongs_to_one_clip_is_refused_for_several(tmp_path: Path, option: tuple[str, str]) -> None:
    assert option[0] in refused(scene_folder(tmp_path / "a"), scene_folder(tmp_path / "b"), *option)


def test_a_folder_of_folders_says_how_each_is_added(tmp_path: Path) -> None:
    for person in ("p01", "p 2"):
        images(tmp_path / "the data" / person, "left/{}.png", "right/{}.png")
    said = refused(tmp_path / "the data", *NUMBERS)
    words = shlex.split(said.partition("a clip of each folder: ")[2])
    assert words == ["vfoa", "clips", "add", f"{tmp_path}/the data/*/"]
    added = vfoa("add", *(tmp_path / "the data").glob("*/"), *NUMBERS)
    assert sorted(clip["name"] for clip in added) == ["p01", "p_2"]


@pytest.mark.parametrize(
    ("names", "of"),
    [
        (("p01/talk.mp4", "p 2/talk.mp4"), "folder: vfoa clips add {}/*/"),
        (("a.mp4", "b.mp4"), "film: vfoa clips add {}/*.mp4"),
    ],
)
def test_films_of_both_views_say_how_each_is_added(names: tuple[str, str], of: str, tmp_path: Path) -> None:
    for name in names:
        write_video(tmp_path / "data" / name, [np.hstack(views(number)) for number in range(5)])
    assert refused(tmp_path / "data", *NUMBERS).endswith(f"; or a clip of each {of.format(tmp_path / 'data')}")


def test_a_folder_of_folders_of_recordings_names_one_to_add(tmp_path: Path) -> None:
    file, _ = (recording(tmp_path / "data" / person / "zed.mcap") for person in ("p01", "p02"))
    assert f"such as {file};" in refused(tmp_path / "data")
    assert vfoa("add", file)["adapter"] == "mcap"


def test_the_film_of_one_camera_is_refused_with_what_is_a_clip_of_it(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    film = tmp_path / "talk.mp4"
    write_video(film, [rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8) for _ in range(5)])
    said = refused(film, *NUMBERS)
    assert said.startswith(f"{film}: no two views are seen in talk.mp4; ")
    assert [word for word in ("layout=video_side_by_side", "left=LEFT.mp4", "people.csv") if word not in said] == []


def test_what_is_added_is_listed(tmp_path: Path) -> None:
    vfoa("add", scene_folder(tmp_path), "--name", "mine", "--subject", "ann", "--target", "mug=cup")
    (listed,) = [row for row in vfoa("list") if row["name"] == "mine"]
    assert (listed["subjects"], listed["targets"], listed["labels"]) == (["ann"], ["mug"], 0)


def test_a_camera_in_question_is_told_when_a_clip_is_added(tmp_path: Path) -> None:
    """A baseline in millimetres, and the calibration of larger images, before anything is run."""
    path = images(tmp_path / "data", "left/{}.png", "right/{}.png")
    added = vfoa("add", path, "--fx", "100", "--cx", "62", "--cy", "23.5", "--baseline", "120", "--name", "mine")
    assert [
        word for word in ("baseline is 120 m", "(62, 23.5)") if not any(word in note for note in added["notes"])
    ] == []
    assert vfoa("add", path, *NUMBERS, "--set", "rate_hz=25", "--name", "right")["notes"] == []


def test_what_was_found_is_said(tmp_path: Path) -> None:
    found = CliRunner().invoke(app, ["add", str(scene_folder(tmp_path))], catch_exceptions=False)
    lines = found.stdout.splitlines()
    assert lines[0] == "sintel: MPI Sintel, scene alley, clean pass"
    assert "  frames       3, 1 to 3" in lines
    assert "  size         64x48" in lines
    assert "  rate         24 Hz" in lines
    assert "  calibration  camdata_left, read for every frame: fx 101 px, baseline 0.1 m" in lines


def test_a_clip_without_people_is_added_again_with_them_until_it_is_edited(tmp_path: Path) -> None:
    path = scene_folder(tmp_path)
    vfoa("add", path)
    assert vfoa("add", path, "--subject", "ann", "--target", "mug=cup")["subjects"] == ["ann"]
    with pytest.raises(VfoaError, match="found a clip of this name"):
        vfoa("add", path, "--subject", "ben")
    manifest = Path("datasets/other.toml")
    vfoa("add", path, "--name", "other")
    manifest.write_text(manifest.read_text() + "# mine\n")
    with pytest.raises(VfoaError, match="found a clip of this name"):
        vfoa("add", path, "--name", "other", "--subject", "ann")


def test_a_manifest_is_never_overwritten(tmp_path: Path) -> None:
    path = scene_folder(tmp_path)
    vfoa("add", path)
    before = {each: each.read_bytes() for each in Path.cwd().rglob("*.*")}
    with pytest.raises(VfoaError, match=r"sintel_alley\.toml: .* --name NAME"):
        vfoa("add", path)
    assert {each: each.read_bytes() for each in Path.cwd().rglob("*.*")} == before


def test_an_adding_that_was_killed_between_its_files_can_be_done_again(tmp_path: Path) -> None:
    path = scene_folder(tmp_path)
    vfoa("add", path, "--subject", "ann")
    manifest, labels = Path("datasets/sintel_alley.toml"), Path("annotations/sintel_alley.csv")
    written = manifest.read_bytes(), labels.read_bytes()
    manifest.unlink()  # it is written last
    vfoa("add", path, "--subject", "ann")
    assert (manifest.read_bytes(), labels.read_bytes()) == written


def test_labels_without_a_manifest_are_not_overwritten_either(tmp_path: Path) -> None:
    write_text(Path.cwd() / "annotations" / "sintel_alley.csv", "mine")
    with pytest.raises(VfoaError, match=r"sintel_alley\.csv: found labels of this name"):
        vfoa("add", scene_folder(tmp_path))
    assert (Path.cwd() / "annotations" / "sintel_alley.csv").read_text() == "mine"
    assert not (Path.cwd() / "datasets").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--fx", "100"), "--cx: missing; expected all of --fx --cx --cy (or --fov-deg), and --baseline"),
        ((*NUMBERS, "--calibration", "c.yml"), "found both; expected one of them"),
        (NUMBERS, "unknown key 'source.camera'"),
        (("--set", "pass"), "--set pass: expected KEY=VALUE, such as pass=final"),
        (("--set", "pss=clean"), "unknown key 'source.pss'; did you mean 'pass'"),
        (("--adapter", "sintl"), "no 'sintl'; did you mean 'sintel'"),
        (("--adapter", "mcap"), "not recognised by mcap"),
        (("--name", "a/b"), "name: "),
        (("--subject", "none"), "expected a word other than none and ignore"),
        (("--subject", "ann", "--subject", "ann"), "--subject: 'ann' is given twice"),
        (("--target", "mug=cup", "--target", "mug=bowl"), "--target: 'mug' is given twice"),
        (("--subject", "ann", "--target", "ann"), "a subject has this name"),
    ],
)
def test_a_wrong_option_is_one_line(tmp_path: Path, options: tuple[str, ...], message: str) -> None:
    assert message in refused(scene_folder(tmp_path), *options)


def test_what_is_not_a_clip_is_refused(tmp_path: Path) -> None:
    assert refused(tmp_path / "nowhere").endswith("nowhere: no such file or folder")
    write_text(tmp_path / "notes" / "a.txt", "hello")
    names = [name for name in ADAPTERS.names() if isinstance(ADAPTERS.load(name), Recogniser)]
    assert f"not recognised by {', '.join(names)}; found files" in (said := refused(tmp_path / "notes"))
    assert "deep: 1 .txt (" in said


@pytest.mark.parametrize(
    ("name", "header"),
    [
        ("feat.csv", ",FaceRectX,FaceRectY,Pitch,Roll,Yaw,input,frame,approx_time"),  # Py-Feat
        ("faces.csv", "frame,face_id,timestamp,gaze_yaw,gaze_pitch,emotion"),  # OpenFace 3
        ("gaze.csv", "section id,recording id,timestamp [ns],gaze x [px],gaze y [px]"),  # Pupil Cloud
        ("take.tsv", "Frame\tTime\tHelmet_1 Centroid_X\tHelmet_1 R0"),  # THOER-MAGNI
    ],
)
def test_a_table_of_another_program_says_which_columns_are_read(tmp_path: Path, name: str, header: str) -> None:
    said = refused(write_text(tmp_path / name, f"{header}\n"))
    assert said.count("\n") == 0
    assert "people.csv" in said
    assert "vfoa labels import" in said


def test_images_of_a_format_that_is_not_read_are_counted(tmp_path: Path) -> None:
    for name in ("left/1.heic", "left/2.heic", "right/1.heic", "notes.txt"):
        write_text(tmp_path / "phone" / name, "ftypheic")
    assert "deep: 3 .heic, 1 .txt (" in refused(tmp_path / "phone")


def test_an_unreadable_first_frame_writes_nothing(tmp_path: Path) -> None:
    path = scene_folder(tmp_path)
    (path / "frame_0001.png").write_bytes(b"")
    assert "frame_0001.png: the file is empty" in refused(path)


def test_the_root_follows_vfoa_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = scene_folder(tmp_path / "all" / "sintel")
    monkeypatch.setenv("VFOA_DATA", "../all")
    vfoa("add", path, "--name", "absolute")
    assert f'root = "{tmp_path}/all/sintel"' in (Path.cwd() / "datasets" / "absolute.toml").read_text()
    monkeypatch.setenv("VFOA_DATA", f"{tmp_path}/all/../all")
    vfoa("add", path)
    assert 'root = "${VFOA_DATA}/sintel"' in (Path.cwd() / "datasets" / "sintel_alley.toml").read_text()
    (tmp_path / "all").rename(tmp_path / "moved")
    monkeypatch.setenv("VFOA_DATA", str(tmp_path / "moved"))
    assert vfoa("check", "sintel_alley")[0]["problems"] == []


def test_a_path_is_read_from_where_one_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    images(tmp_path / "clip", "left/{}.png", "right/{}.png")
    opencv_file(tmp_path / "other")
    assert vfoa("add", "../clip", "--calibration", "../other/stereo.yml")["name"] == "clip"
    text = (Path.cwd() / "datasets" / "clip.toml").read_text()
    assert f'root = "{tmp_path}/clip"' in text
    assert f'calibration = "{tmp_path}/other/stereo.yml"' in text
    monkeypatch.chdir(tmp_path / "clip")
    assert vfoa("add", ".", *NUMBERS, "--name", "here")["frames"] == 3


def test_odd_names_survive(tmp_path: Path) -> None:
    path = recording(tmp_path / 'a "b" \\ ü' / "my table (1).mcap")
    added = vfoa("add", path, "--subject", 'Ann "A"', "--target", "red mug=cup", "--target", "blue mug=cup")
    assert added["name"] == "my_table_1"
    (checked,) = vfoa("check", "my_table_1")
    assert (checked["problems"], checked["frames"]) == ([], 3)


PLUGIN = """
from pathlib import Path
import numpy as np
from harness.sources import Recognised, Truth
from vfoa.settings import Settings
from vfoa.types import StereoFrame, StereoRig

class Slides:
    class Settings(Settings):
        file: str

    def __init__(self, settings, root):
        self.frames, self.rate_hz, self.notes = (1,), None, ()

    @classmethod
    def recognise(cls, path, given):
        if path.suffix not in (".slides", ".mcap"):
            return ()
        return [Recognised(root=path.parent, source={"file": path.name}, layout="slides", name="s", calibration="own")]

    def frame(self, number):
        rig = StereoRig(width_px=4, height_px=3, fx_px=9, fy_px=9, cx_px=1, cy_px=1, baseline_m=0.1, cx_right_px=1)
        black = np.zeros((3, 4, 3), np.uint8)
        return StereoFrame(index=1, time_ns=0, left=black, right=black, rig=rig)

    def time_ns(self, number):
        return 0

    def truth(self, number):
        return Truth()

    def digest(self):
        return "0" * 64
"""


def test_an_adapter_of_another_package_takes_part(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    info = tmp_path / "site" / "slides-1.0.dist-info"
    write_text(tmp_path / "site" / "slides_clip.py", PLUGIN)
    write_text(info / "METADATA", "Metadata-Version: 2.1\nName: slides\nVersion: 1.0\n")
    write_text(info / "entry_points.txt", "[vfoa.adapters]\nslides = slides_clip:Slides\n")
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    write_text(tmp_path / "a.slides", "")
    assert vfoa("add", tmp_path / "a.slides", "--name", "mine")["adapter"] == "slides"
    shutil.rmtree(Path.cwd() / "datasets")
    shutil.rmtree(Path.cwd() / "annotations")
    both = recording(tmp_path / "b.mcap")
    assert "several adapters can read it; expected one of: --adapter mcap (an MCAP recording), --adapter slides" in (
        refused(both)
    )
    assert vfoa("add", both, "--adapter", "slides")["adapter"] == "slides"


def test_targets_that_no_model_knows_are_to_be_drawn(tmp_path: Path) -> None:
    recorded = recording(tmp_path / "a.mcap")
    targets = ("--target", "mug=cup", "--target", "robot", "--target", "screen=TV")
    added = vfoa("add", recorded, "--name", "mine", "--subject", "anna", *targets)
    assert added["notes"][-1] == (
        "no model of COCO's categories knows robot (robot), screen (TV; did you mean 'tv'?): take other masks, or "
        "draw: vfoa annotate mine, key p"
    )
    write_text(Path("annotations") / "mine.drawn.csv", "# vfoa drawn 2\n")
    problems = check_clip("mine").problems
    assert problems[-1].endswith("mine.drawn.csv:1: found '# vfoa drawn 2'; expected '# vfoa drawn 1'")


def test_the_real_set_is_added(shared_data: Path) -> None:
    added = vfoa("add", shared_data / "sintel", "--name", "again")
    assert (added["frames"], added["rate_hz"], added["rig"]["fx_px"]) == (50, 24.0, 896.0)
    assert load_manifest("again").source == load_manifest("sintel_bandage_2").source  # which test_clips_cli checks


@pytest.mark.parametrize(("depth_m", "noted"), [(0.2, True), (2.0, False)])
def test_depth_nearer_than_matchers_search_is_noted(depth_m: float, noted: bool) -> None:
    rig, black = make_rig(64, 48), np.zeros((48, 64, 3), np.uint8)
    frame = StereoFrame(index=1, time_ns=0, left=black, depth_m=np.full((48, 64), depth_m, np.float32), rig=rig)
    assert any("depth_scale in [source]" in note for note in depth_notes([frame])) == noted


@pytest.mark.parametrize("every_frame", [False, True])
def test_frames_that_cannot_be_read_are_counted_and_named(tmp_path: Path, every_frame: bool) -> None:
    for number in range(1, 6):
        for side, image in zip(("left", "right"), views(number), strict=True):
            write_image(tmp_path / "data" / side / f"{number}.png", image)
    vfoa("add", tmp_path / "data", "--name", "mine", *NUMBERS)
    for number in (2, 4):
        damaged = tmp_path / "data" / "left" / f"{number}.png"
        damaged.write_bytes(damaged.read_bytes()[:-20])
    problems = check_clip("mine", every_frame=every_frame).problems
    (said,) = (problem for problem in problems if "cannot be read" in problem)
    assert said.startswith("2 of 5 frames cannot be read: 2, 4; ")
    assert "left/2.png: truncated PNG" in said
