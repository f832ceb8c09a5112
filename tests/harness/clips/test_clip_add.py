"""`vfoa clips add` on every kind of source: what it writes, `vfoa clips check` passes as it is."""

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
from tests.calibrations import RIG, SIZE, opencv_nodes, write_kalibr, write_opencv, write_ros, write_zed
from tests.disk import HEIGHT, WIDTH, picture, sintel_scene, write_image, write_text, write_video
from tests.recordings import recorder, rectified_camera, write_pairs
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


@pytest.fixture(autouse=True)
def _work_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.delenv("VFOA_DATA", raising=False)


def vfoa(*arguments: str | Path) -> Any:
    """What a verb of `vfoa clips` prints as JSON."""
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


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_what_is_added_passes_the_check(tmp_path: Path, kind: Kind) -> None:
    path = kind.make(tmp_path / "data")
    added = vfoa("add", path, *kind.options, "--name", "mine", "--subject", "ann", "--target", "mug=cup")
    assert (added["adapter"], added["frames"]) == (kind.adapter, kind.frames)
    (checked,) = vfoa("check", "mine")
    assert checked["problems"] == []
    assert (checked["frames"], checked["size_px"]) == (kind.frames, [WIDTH, HEIGHT])
    assert checked["baseline_m"] == pytest.approx(kind.baseline_m)
    assert checked["labels"] == kind.frames


def test_what_is_added_is_listed(tmp_path: Path) -> None:
    vfoa("add", scene_folder(tmp_path), "--name", "mine", "--subject", "ann", "--target", "mug=cup")
    (listed,) = [row for row in vfoa("list") if row["name"] == "mine"]
    assert (listed["subjects"], listed["targets"], listed["labels"]) == (["ann"], ["mug"], 3)


def test_what_was_found_is_said_and_the_next_commands_work(tmp_path: Path) -> None:
    found = CliRunner().invoke(app, ["add", str(scene_folder(tmp_path))], catch_exceptions=False)
    lines = found.stdout.splitlines()
    assert lines[0] == "sintel: MPI Sintel, scene alley, clean pass"
    assert "  frames       3, 1 to 3" in lines
    assert "  size         64x48" in lines
    assert "  rate         24 Hz" in lines
    assert "  calibration  camdata_left, read for every frame: fx 101 px, baseline 0.1 m" in lines
    verbs = [line.removeprefix("next: vfoa ") for line in lines if line.startswith("next")]
    assert verbs == ["clips check sintel_alley", "run sintel_alley"]
    assert CliRunner().invoke(app, verbs[0].split()[1:]).exit_code == 0
    named = CliRunner().invoke(
        app, ["add", str(tmp_path), "--name", "mine", "--subject", "ann"], catch_exceptions=False
    )
    assert "next: vfoa annotate mine" in named.stdout.splitlines()


def test_a_manifest_is_never_overwritten(tmp_path: Path) -> None:
    path = scene_folder(tmp_path)
    vfoa("add", path)
    before = {each: each.read_bytes() for each in Path.cwd().rglob("*.*")}
    with pytest.raises(VfoaError, match=r"sintel_alley\.toml: there is a clip of this name; .* --name NAME"):
        vfoa("add", path)
    assert {each: each.read_bytes() for each in Path.cwd().rglob("*.*")} == before


def test_labels_without_a_manifest_are_not_overwritten_either(tmp_path: Path) -> None:
    write_text(Path.cwd() / "annotations" / "sintel_alley.csv", "mine")
    with pytest.raises(VfoaError, match=r"sintel_alley\.csv: there is a clip"):
        vfoa("add", scene_folder(tmp_path))
    assert (Path.cwd() / "annotations" / "sintel_alley.csv").read_text() == "mine"
    assert not (Path.cwd() / "datasets").exists()


def test_several_scenes_and_passes_are_listed_with_the_options_that_decide(tmp_path: Path) -> None:
    final_scene(tmp_path)
    sintel_scene(tmp_path, "market")
    message = refused(tmp_path)
    assert message == (
        f"{tmp_path}: it can be read in 3 ways; expected --set scene=(alley | market) and --set pass=(clean | final)"
    )
    assert "--set scene=(alley | market)" in refused(tmp_path, "--set", "scene=aley")
    vfoa("add", tmp_path, "--set", "scene=market")


def test_several_pairs_of_topics_are_listed(tmp_path: Path) -> None:
    path = tmp_path / "two.mcap"
    with recorder(path) as record:
        for rig in ("front", "rear"):
            for side, camera in (("left", LEFT), ("right", RIGHT)):
                record.camera(f"/{rig}/{side}/camera_info", 10**9, camera)
                record.picture(f"/{rig}/{side}/image", 10**9, picture(1))
    message = refused(path)
    assert "2 pairs of image topics" in message
    assert "/front/left/image (sensor_msgs/msg/Image, 1 messages)" in message
    assert message.endswith("(here as --set KEY=VALUE)")
    vfoa("add", path, "--set", "left=/rear/left/image", "--set", "right=/rear/right/image")


def test_a_recording_without_calibration_takes_a_file(tmp_path: Path) -> None:
    path = tmp_path / "bare.mcap"
    with recorder(path) as record:
        for side in ("left", "right"):
            record.picture(f"/{side}/image_rect", 10**9, picture(1))
    assert "no single calibration topic" in refused(path)
    matrix = "100 0 31.5 {} 0 100 23.5 0 0 0 1 0"
    write_text(tmp_path / "calib.txt", f"P2: {matrix.format(0)}\nP3: {matrix.format(-12)}\n")
    added = vfoa("add", path, "--calibration", tmp_path / "calib.txt")
    assert added["calibration"] == "as given"
    assert added["rig"]["baseline_m"] == pytest.approx(0.12)
    assert 'calibration = "calib.txt"' in (Path.cwd() / "datasets" / "bare.toml").read_text()


def opencv_sample(root: Path) -> None:
    nodes = opencv_nodes(RIG)
    write_opencv(root / "intrinsics.yml", {name: value for name, value in nodes.items() if name[-1] in "12"})
    write_opencv(root / "extrinsics.yml", {"R": nodes["R"], "T": nodes["T"]})


CALIBRATIONS: dict[str, Callable[[Path], object]] = {
    "opencv": lambda root: write_opencv(root / "stereo.xml", opencv_nodes(RIG), SIZE),
    "opencv sample": opencv_sample,
    "ros": lambda root: write_ros(root / "calibration", RIG),
    "kalibr": lambda root: write_kalibr(root / "camchain.yaml", RIG),
    "zed": lambda root: write_zed(root / "SN123.conf", RIG),
}


@pytest.mark.parametrize("write", CALIBRATIONS.values(), ids=CALIBRATIONS)
def test_every_calibration_beside_the_images_is_found(tmp_path: Path, write: Callable[[Path], object]) -> None:
    for side in ("left", "right"):
        write_image(tmp_path / side / "1.png", np.full((SIZE[1], SIZE[0], 3), 128, np.uint8))
    write(tmp_path)
    vfoa("add", tmp_path, "--name", "mine")
    (checked,) = vfoa("check", "mine")
    assert checked["problems"] == []
    assert checked["baseline_m"] == pytest.approx(0.1199, abs=1e-4)


def test_two_calibration_files_can_be_given(tmp_path: Path) -> None:
    for side in ("left", "right"):
        write_image(tmp_path / "clip" / side / "1.png", np.full((SIZE[1], SIZE[0], 3), 128, np.uint8))
    left, right = write_ros(tmp_path / "elsewhere", RIG)
    vfoa("add", tmp_path / "clip", "--calibration", left, "--calibration", right, "--name", "mine")
    assert vfoa("check", "mine")[0]["baseline_m"] == pytest.approx(0.1199, abs=1e-4)


def test_a_calibration_is_never_guessed(tmp_path: Path) -> None:
    message = refused(images(tmp_path, "left/{}.png", "right/{}.png"))
    assert "no calibration was found; expected --calibration FILE" in message
    assert "or --fx --cx --cy --baseline of a rectified pair, in pixels and metres" in message


def test_both_pairs_of_kitti_are_listed(tmp_path: Path) -> None:
    kitti(kitti(tmp_path), "image_0/{:06d}.png", "image_1/{:06d}.png")
    assert refused(tmp_path).endswith("it can be read in 2 ways; expected --set left=(image_0 | image_2)")
    vfoa("add", tmp_path, "--set", "left=image_0", *NUMBERS, "--name", "gray")
    assert vfoa("check", "gray")[0]["problems"] == []
    vfoa("add", tmp_path, "--set", "left=image_2", "--name", "colour")
    assert vfoa("check", "colour")[0]["baseline_m"] == pytest.approx(0.125)


def test_halves_that_are_alike_both_ways_are_asked_for(tmp_path: Path) -> None:
    for number in (1, 2):
        tile = views(number)[0]
        write_image(tmp_path / f"{number}.png", np.tile(tile, (2, 2, 1)))
    assert "it can be read in 2 ways; expected --set layout=(" in refused(tmp_path, *NUMBERS)
    vfoa("add", tmp_path, *NUMBERS, "--set", "layout=images_top_bottom", "--name", "mine")
    assert vfoa("check", "mine")[0]["size_px"] == [2 * WIDTH, HEIGHT]


def test_several_calibrations_are_listed(tmp_path: Path) -> None:
    opencv_file(tmp_path)
    shutil.copy(tmp_path / "stereo.yml", tmp_path / "left" / "older.yml")
    assert refused(tmp_path).endswith("it can be read in 2 ways; expected --calibration (stereo.yml | left/older.yml)")
    added = vfoa("add", tmp_path, "--calibration", tmp_path / "stereo.yml", "--name", "mine")
    assert added["calibration"] == "as given"


def test_kitti_s_raw_recordings_keep_their_calibration_above(tmp_path: Path) -> None:
    drive = images(tmp_path / "day" / "drive_1", "image_02/data/{:010d}.png", "image_03/data/{:010d}.png")
    lines = [
        f"P_rect_{camera}: 100 0 31.5 {column} 0 100 23.5 0 0 0 1 0\n" for camera, column in (("02", 0), ("03", -12))
    ]
    write_text(tmp_path / "day" / "calib_cam_to_cam.txt", "".join(lines))
    assert vfoa("add", drive)["calibration"] == "../calib_cam_to_cam.txt"
    assert vfoa("check", "drive_1")[0]["baseline_m"] == pytest.approx(0.12)


def test_a_large_file_that_is_no_picture_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.bag").write_bytes(b"x")

    def fail(path: Path) -> bytes:
        raise AssertionError(path)

    monkeypatch.setattr(Path, "read_bytes", fail)
    assert "not recognised" in refused(tmp_path / "a.bag")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--fx", "100"), "--cx: missing; expected all of --fx --cx --cy --baseline"),
        ((*NUMBERS, "--calibration", "c.yml"), "found both; expected one of them"),
        (NUMBERS, "unknown key 'source.camera'"),
        (("--set", "pass"), "--set pass: expected KEY=VALUE, such as pass=final"),
        (("--set", "pss=clean"), "unknown key 'source.pss'; did you mean 'pass'"),
        (("--adapter", "sintl"), "no 'sintl'; did you mean 'sintel'"),
        (("--adapter", "mcap"), "not recognised by mcap"),
        (("--name", "a/b"), "name: "),
        (("--subject", "none"), "expected a word other than none and ignore"),
        (("--subject", "ann", "--target", "ann"), "a subject has this name"),
    ],
)
def test_a_wrong_option_is_one_line(tmp_path: Path, options: tuple[str, ...], message: str) -> None:
    assert message in refused(scene_folder(tmp_path), *options)


def test_what_is_not_a_clip_is_refused(tmp_path: Path) -> None:
    assert refused(tmp_path / "nowhere").endswith("nowhere: no such file or folder")
    write_text(tmp_path / "notes" / "a.txt", "hello")
    assert "not recognised by mcap, sintel, stereo_folder, studio" in refused(tmp_path / "notes")


def test_an_unreadable_first_frame_writes_nothing(tmp_path: Path) -> None:
    path = scene_folder(tmp_path)
    (path / "frame_0001.png").write_bytes(b"")
    assert "frame_0001.png: the file is empty" in refused(path)


def test_the_root_follows_vfoa_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = scene_folder(tmp_path / "all" / "sintel")
    monkeypatch.setenv("VFOA_DATA", "../all")
    vfoa("add", path, "--name", "absolute")
    assert f'root = "{tmp_path}/all/sintel"' in (Path.cwd() / "datasets" / "absolute.toml").read_text()
    monkeypatch.setenv("VFOA_DATA", f"{tmp_path}/work/../all")
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
    assert (checked["problems"], checked["labels"]) == ([], 3)


PLUGIN = """
from pathlib import Path
import numpy as np
from harness.adapters import Recognised, Truth
from vfoa.settings import Settings
from vfoa.types import StereoFrame, StereoRig

class Slides:
    class Settings(Settings):
        file: str

    def __init__(self, settings, root):
        self.frames, self.rate_hz, self.notes = (1,), None, ()

    @classmethod
    def recognise(cls, path):
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


def test_the_real_set_is_added(shared_data: Path) -> None:
    added = vfoa("add", shared_data / "sintel", "--name", "again")
    assert (added["frames"], added["rate_hz"], added["rig"]["fx_px"]) == (50, 24.0, 896.0)
    (checked,) = vfoa("check", "again")
    assert checked["problems"] == []
    assert np.isfinite(checked["vertical_error_px"])
