"""A clip's rectified images as files: read again, they are the same frames of the same cameras."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from harness.clips.export import export_film, export_images
from harness.clips.manifest import load_manifest
from harness.sources.calibration_files.one_camera import read_one_camera
from harness.sources.calibration_files.read import Options, read_cameras
from harness.sources.media.images import read_rgb
from harness.sources.media.listed_times import find_times
from harness.sources.media.video import Video
from harness.sources.stereo_folder import StereoFolderClip, StereoFolderSettings
from tests.command import vfoa
from tests.disk import moving_picture, write_text
from tests.exchanges import PlainClip
from tests.scenes import make_rig
from vfoa.errors import VfoaError
from vfoa.types import Image, StereoFrame

RIG = replace(make_rig(64, 48), fy_px=51.25, cx_right_px=30.1, baseline_m=0.0601)


@dataclass
class Pictures(PlainClip):
    """Pictures at random, each of its frame; that of the frame ``damaged`` cannot be read."""

    frames: tuple[int, ...] = (3, 7, 100_000)
    has_right: bool = True
    damaged: int = 0

    def frame(self, number: int) -> StereoFrame:
        if number == self.damaged:
            raise VfoaError(f"frame {number} is damaged")
        left, right = np.random.default_rng(number).integers(0, 256, (2, 48, 64, 3), dtype=np.uint8)
        depth = None if self.has_right else np.ones((48, 64), np.float32)
        right = right if self.has_right else None
        time_ns = 1_700_000_000_123_456_789 + number
        return StereoFrame(index=number, time_ns=time_ns, left=left, right=right, depth_m=depth, rig=RIG)


def test_they_are_read_again_as_the_same_frames(tmp_path: Path) -> None:
    clip, done = Pictures(), list[None]()
    export_images(clip, tmp_path / "out", clip.frames, with_right=True, progress=lambda: done.append(None))
    assert len(done) == 3
    pattern = {"left": "left/%05d.png", "right": "right/%05d.png", "calibration": "calib.txt"}
    settings = {**pattern, "times": find_times(tmp_path / "out", "left")}
    again = StereoFolderClip(StereoFolderSettings.model_validate(settings), tmp_path / "out")
    assert tuple(again.frames) == clip.frames
    for number in clip.frames:
        expected, found = clip.frame(number), again.frame(number)
        assert found.time_ns == expected.time_ns
        assert found.right is not None
        assert np.array_equal(found.left, expected.left)
        assert np.array_equal(found.right, expected.right)
        for name in ("fx_px", "fy_px", "cx_px", "cy_px", "baseline_m", "cx_right_px", "width_px", "height_px"):
            assert getattr(found.rig, name) == pytest.approx(getattr(RIG, name), rel=1e-12), name


def test_without_right_images_there_is_the_camera_alone(tmp_path: Path) -> None:
    clip = Pictures(has_right=False)
    export_images(clip, tmp_path / "out", clip.frames[:1], as_jpeg=True)
    assert sorted(path.relative_to(tmp_path / "out").as_posix() for path in tmp_path.rglob("*.*")) == [
        "K.txt",
        "left/00003.jpg",
        "times.csv",
    ]
    camera = read_one_camera(tmp_path / "out" / "K.txt", (64, 48))
    assert np.array_equal(camera.k, RIG.camera_matrix)
    with pytest.raises(VfoaError, match="frame 3: no right image"):
        export_images(clip, tmp_path / "other", clip.frames, with_right=True)


def test_frames_of_several_cameras_have_one_each(tmp_path: Path) -> None:
    @dataclass
    class OfTwoCameras(Pictures):
        def frame(self, number: int) -> StereoFrame:
            frame = super().frame(number)
            return replace(frame, rig=replace(RIG, fx_px=50.0 + number)) if number == 7 else frame

    export_images(OfTwoCameras(), tmp_path / "out", (3, 7))
    names = sorted(path.relative_to(tmp_path / "out").as_posix() for path in tmp_path.rglob("*.txt"))
    assert names == ["calib/00003.txt", "calib/00007.txt"]
    found = [read_cameras([tmp_path / "out" / name], lambda: (64, 48), Options()) for name in names]
    assert [cameras.rig(64, 48).fx_px for cameras in found] == [RIG.fx_px, 57.0]


def test_a_jpeg_has_the_colours_of_its_picture(tmp_path: Path) -> None:
    clip = Pictures()
    export_images(clip, tmp_path / "out", (3,), as_jpeg=True)
    found = cv2.cvtColor(cv2.imread(str(tmp_path / "out" / "left" / "00003.jpg")), cv2.COLOR_BGR2RGB)
    means = [picture.reshape(-1, 3).mean(axis=0) for picture in (found, clip.frame(3).left)]
    assert means[0] == pytest.approx(means[1], abs=3)


@dataclass
class Uneven(PlainClip):
    """Smooth pictures of 63 x 47 pixels at times that are not evenly apart; the size of the last one can differ."""

    frames: tuple[int, ...] = (2, 3, 5, 6, 9)
    last: tuple[int, int] = (63, 47)

    def frame(self, number: int) -> StereoFrame:
        size = self.last if number == 9 else (63, 47)
        left = moving_picture(number, *size)
        return StereoFrame(index=number, time_ns=self.time_ns(number), left=left, right=left, rig=make_rig(*size))


def test_a_film_has_every_picture_at_its_time(tmp_path: Path) -> None:
    clip = Uneven(rate_hz=29.97)
    export_film(clip, tmp_path / "left.mp4", clip.frames)
    film = Video(tmp_path / "left.mp4")
    assert len(film.frames) == 5
    for place, number in zip(film.frames, clip.frames, strict=True):
        assert film.times_ns[place] == pytest.approx(clip.time_ns(number) - clip.time_ns(2), abs=20_000)
        found = film.read(place)[:47, :63].astype(float)
        apart = {other: np.abs(found - moving_picture(other, 63, 47)).mean() for other in clip.frames}
        assert min(apart, key=lambda other: apart[other]) == number
        assert apart[number] < 4


def test_a_film_states_how_its_colours_are_coded(tmp_path: Path) -> None:
    class Green(Uneven):
        def left(self, number: int) -> Image:
            return np.full((48, 64, 3), (0, 255, 0), np.uint8)

    export_film(Green(), tmp_path / "left.mp4", (2, 3))
    with av.open(str(tmp_path / "left.mp4")) as film:
        picture = next(film.decode(video=0))
    assert picture.colorspace == 6  # BT.601 (ITU-T H.273, table 4)
    luma = np.frombuffer(bytes(picture.planes[0]), np.uint8).reshape(48, -1)[:, :64]
    assert luma.mean() == pytest.approx(16 + 219 * 0.587, abs=2)


def test_a_film_needs_no_right_image(tmp_path: Path) -> None:
    class OnlyLeft(Uneven):
        def left(self, number: int) -> Image:
            return moving_picture(number, 63, 47)

        def frame(self, number: int) -> StereoFrame:
            raise VfoaError("the right image is missing")

    export_film(OnlyLeft(), tmp_path / "left.mp4", (2, 3))
    assert len(Video(tmp_path / "left.mp4").frames) == 2


def test_what_no_film_can_be_made_of_is_refused(tmp_path: Path) -> None:
    write_text(tmp_path / "mine.mp4", "mine")
    for clip, name, what in (
        (Uneven(), "mine.mp4", "exists already"),
        (Uneven(rate_hz=None), "new.mp4", "rate_hz"),
        (Uneven(last=(64, 48)), "new.mp4", "frame 9 has another size than frame 2"),
    ):
        with pytest.raises(VfoaError, match=what):
            export_film(clip, tmp_path / name, clip.frames)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.mp4"]
    assert (tmp_path / "mine.mp4").read_text() == "mine"


def test_nothing_is_left_of_an_export_that_fails_and_nothing_is_replaced(tmp_path: Path) -> None:
    clip = Pictures(damaged=7)
    (tmp_path / "empty").mkdir()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    for name in ("out", "empty"):
        with pytest.raises(VfoaError, match="frame 7 is damaged"):
            export_images(clip, tmp_path / name, clip.frames)
    for name in ("mine", "mine/notes.txt"):
        with pytest.raises(VfoaError, match=f"{name}: exists already"):
            export_images(clip, tmp_path / name, (3,))
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["empty", "mine", "notes.txt"]
    export_images(clip, tmp_path / "empty", (3,))
    assert (tmp_path / "empty" / "left" / "00003.png").is_file()


def test_the_working_directory_is_no_new_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for here in (Path(), tmp_path):
        with pytest.raises(VfoaError, match="exists already"):
            export_images(Pictures(), here, (3,))
    assert [*tmp_path.iterdir()] == []


def test_the_command_writes_the_frames_of_a_clip_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert vfoa(monkeypatch, capsys, "clips", "export", "demo_1", "out", "--right", "--limit", "2")[0] == 0
    clip = load_manifest("demo_1").open()
    for number in clip.frames[:2]:
        frame = clip.frame(number)
        for view, expected in (("left", frame.left), ("right", frame.right)):
            assert np.array_equal(read_rgb(tmp_path / "out" / view / f"{number:05d}.png"), expected), view
    assert vfoa(monkeypatch, capsys, "clips", "export", "demo_1", "left.mp4", "--limit", "2")[0] == 0
    assert len(Video(tmp_path / "left.mp4").frames) == 2
    assert vfoa(monkeypatch, capsys, "clips", "export", "demo_1", "both.mp4", "--right")[0] == 2
    code, _, said = vfoa(monkeypatch, capsys, "clips", "export", "demo_1", "out")
    assert (code, said) == (2, "vfoa: out: exists already; expected a new folder, or an empty one\n")
    head = 'name = "people"\nadapter = "measured"\nroot = "."\n[source]\npeople_file = "people.csv"\n'
    write_text(tmp_path / "people.toml", f'{head}[subjects.ann]\ncategory = "person"\n')
    write_text(tmp_path / "people.csv", "frame,time_s,person,x_m,y_m,z_m\n1,0,ann,0,0,2\n")
    code, _, said = vfoa(monkeypatch, capsys, "clips", "export", "people.toml", "other")
    assert (code, said) == (2, "vfoa: people.toml: found a clip of measurements; expected one with images\n")
