"""Every registered adapter keeps the contract of a clip, and a broken promise is found."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from harness.processes import spawning
from harness.sources import ADAPTERS, Clip, MeasuredClip, PersonTruth, Truth
from tests.adapter_contract import check_contract
from tests.depth_recordings import Lens, Shot, write_take
from tests.disk import (
    HEIGHT,
    WIDTH,
    moving_picture,
    picture,
    sintel_disparity,
    sintel_scene,
    stereo_pair_folder,
    write_image,
    write_video,
)
from tests.examples import few
from tests.kinect import kinect_recording
from tests.measured import (
    idiap_file,
    measured_tables,
    motive_file,
    open_measured,
    openface_file,
    pose,
    qualisys_file,
    ros_file,
    vicon_file,
)
from tests.recordings import rectified_camera, write_pairs
from tests.scenes import make_rig
from vfoa.errors import VfoaError
from vfoa.types import Disparity, Instances, StereoFrame

CAMERA = {"fx_px": 100.0, "cx_px": 31.5, "cy_px": 23.5, "baseline_m": 0.12}
FRAMES = (3, 4, 9)


def sintel(root: Path, frames: tuple[int, ...]) -> Clip:
    sintel_scene(root, frames=frames)
    disparity = np.random.default_rng(0).uniform(0.1, 20, (HEIGHT, WIDTH))
    for n in frames:
        write_image(root / f"training/disparities/alley/frame_{n:04d}.png", sintel_disparity(disparity))
        write_image(root / f"training/segmentation/alley/frame_{n:04d}.png", picture(n) // 128)
    return opened("sintel", {"scene": "alley"}, root)


def stereo_folder(root: Path, frames: tuple[int, ...]) -> Clip:
    stereo_pair_folder(root, frames)
    return opened("stereo_folder", {"left": "left", "right": "right", "camera": CAMERA}, root)


def packed_video(root: Path, frames: tuple[int, ...]) -> Clip:
    """Numbered from 0 whatever the frames were."""
    images = [np.concatenate([moving_picture(n), moving_picture(n + 1)], axis=1) for n in frames]
    write_video(root / "wide.avi", images, "MJPG")
    return opened("stereo_folder", {"layout": "video_side_by_side", "both": "wide.avi", "camera": CAMERA}, root)


def mcap(root: Path, frames: tuple[int, ...]) -> Clip:
    """Numbered from 1 whatever the frames were."""
    left, right = (rectified_camera(WIDTH, HEIGHT, 100.0, 31.5, 23.5, baseline) for baseline in (0.0, 0.12))
    write_pairs(root / "a.mcap", ((n * 10**8, picture(n), picture(1000 + n), left, right) for n in frames))
    return opened("mcap", {"recording": "a.mcap"}, root)


def rosbag(root: Path, frames: tuple[int, ...]) -> Clip:
    """Colour and depth, numbered from 1 whatever the frames were."""
    lens = Lens(width=WIDTH, height=HEIGHT, fx=100.0, cx=31.5, cy=23.5)
    depth = np.full((HEIGHT, WIDTH), 1500, np.uint16)
    root.mkdir(parents=True)
    shots = (Shot(stamp_ns=n * 10**8, colour=picture(n), depth_mm=depth + n, lens=lens) for n in frames)
    return opened("rosbag", {"recording": write_take(root, "bag", shots).name}, root)


def depth_folder(root: Path, frames: tuple[int, ...]) -> Clip:
    for n in frames:
        write_image(root / "rgb" / f"{n:06d}.png", picture(n))
        write_image(root / "depth" / f"{n:06d}.png", np.full((HEIGHT, WIDTH), 1500 + n, np.uint16))
    camera = {name: value for name, value in CAMERA.items() if name != "baseline_m"}
    return opened("depth_folder", {"colour": "rgb", "depth": "depth", "camera": camera}, root)


def studio(root: Path, frames: tuple[int, ...]) -> Clip:
    return opened("studio", {"scenario": "table", "frames": len(frames)}, None)


def measured(root: Path, frames: tuple[int, ...]) -> MeasuredClip:
    return open_measured("measured", measured_tables(root, frames), objects_file="objects.csv")


def idiap_vfoa(root: Path, frames: tuple[int, ...]) -> MeasuredClip:
    """Numbered from 0 whatever the frames were."""
    return open_measured("idiap_vfoa", root, file=idiap_file(root, len(frames)).name)


def openface(root: Path, frames: tuple[int, ...]) -> MeasuredClip:
    """Numbered from 1 without gaps whatever the frames were, as OpenFace does."""
    rows = [{"frame": number, "timestamp": number / 25, "pose_Tz": 800} for number, _ in enumerate(frames, start=1)]
    return open_measured("openface", root, file=openface_file(root / "faces.csv", rows).name)


def bodies(count: int) -> dict[str, NDArray[Any]]:
    """Poses at rest."""
    return {name: pose([x, 1.6, 2], frames=count) for name, x in (("anna", -0.4), ("ben", 0.4))}


def motive(root: Path, frames: tuple[int, ...]) -> MeasuredClip:
    """Numbered from 0 without gaps whatever the frames were."""
    file = motive_file(root / "take.csv", bodies(len(frames)))
    return open_measured("motive", root, file=file.name, heads={"anna": {}})


def qualisys(root: Path, frames: tuple[int, ...]) -> MeasuredClip:
    """Numbered from 1 without gaps whatever the frames were."""
    file = qualisys_file(root / "take.tsv", bodies(len(frames)))
    return open_measured("qualisys", root, file=file.name, heads={"anna": {}})


def ros_poses(root: Path, frames: tuple[int, ...]) -> MeasuredClip:
    """Numbered from 1 without gaps whatever the frames were."""
    file = ros_file(root / "take.bag", bodies(len(frames)))
    return open_measured("ros_poses", root, file=file.name, heads={"anna": {}})


def vicon(root: Path, frames: tuple[int, ...]) -> MeasuredClip:
    """Numbered from 1 without gaps whatever the frames were."""
    file = vicon_file(root / "take.csv", bodies(len(frames)))
    return open_measured("vicon", root, file=file.name, heads={"anna": {}})


def opened(name: str, source: dict[str, Any], root: Path | None) -> Clip:
    adapter = ADAPTERS.load(name)
    clip: Clip = adapter(adapter.Settings.model_validate(source), root)
    return clip


def azure_kinect(root: Path, frames: tuple[int, ...]) -> Clip:
    """The three frames of a genuine recording."""
    return opened("azure_kinect", {"recording": kinect_recording(root).name}, root)


Builder = Callable[[Path, tuple[int, ...]], Clip | MeasuredClip]

BUILDERS: dict[str, Builder] = {
    "azure_kinect": azure_kinect,
    "depth_folder": depth_folder,
    "idiap_vfoa": idiap_vfoa,
    "measured": measured,
    "mcap": mcap,
    "motive": motive,
    "openface": openface,
    "qualisys": qualisys,
    "ros_poses": ros_poses,
    "rosbag": rosbag,
    "sintel": sintel,
    "stereo_folder": stereo_folder,
    "studio": studio,
    "vicon": vicon,
}


def test_every_adapter_is_among_them() -> None:
    assert {*BUILDERS, "vr_objects"} == set(ADAPTERS.builtin)  # whose frames are those of a recorded session


@pytest.fixture(scope="module")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Executor]:
    """A process of its own, with the same cache."""
    with pytest.MonkeyPatch.context() as patch, ProcessPoolExecutor(1, mp_context=spawning()) as pool:
        patch.setenv("VFOA_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield pool


@pytest.mark.parametrize("build", [*BUILDERS.values(), packed_video])
def test_an_adapter_keeps_the_contract(build: Builder, tmp_path: Path, elsewhere: Executor) -> None:
    clip = build(tmp_path / "clip", FRAMES)
    assert len(clip.frames) == len(FRAMES)
    check_contract(clip, spawn=elsewhere)


@pytest.mark.parametrize("name", ["depth_folder", "measured", "mcap", "sintel", "stereo_folder"])
@few
@given(frames=st.sets(st.integers(1, 9999), min_size=1, max_size=4).map(sorted).map(tuple))
def test_whatever_frames_there_are(
    name: str, tmp_path_factory: pytest.TempPathFactory, frames: tuple[int, ...]
) -> None:
    clip = BUILDERS[name](tmp_path_factory.mktemp(name), frames)
    assert list(clip.frames) == (list(range(1, len(frames) + 1)) if name == "mcap" else list(frames))
    check_contract(clip)


class Good:
    """A clip in memory that keeps every promise."""

    frames: Sequence[int] = (2, 5)
    rate_hz: float | None = 10.0
    notes: tuple[str, ...] = ("made up",)

    def time_ns(self, number: int) -> int:
        return number * 10**8

    def frame(self, number: int) -> StereoFrame:
        if number not in (2, 5):
            raise VfoaError(f"made up: no frame {number}; expected 2 or 5")
        rig = make_rig(WIDTH, HEIGHT)
        return StereoFrame(
            index=number, time_ns=number * 10**8, left=picture(number), right=picture(-number % 97), rig=rig
        )

    def truth(self, number: int) -> Truth:
        return Truth()

    def digest(self) -> str:
        return "0" * 64


def test_a_good_clip_passes() -> None:
    check_contract(Good(), spawn=True)


class Descending(Good):
    frames = (5, 2)


class Empty(Good):
    frames = ()


class NumpyNumbers(Good):
    frames = tuple(np.array([2, 5]))


class NoRate(Good):
    rate_hz = 0.0


class TwoLines(Good):
    notes = ("one\ntwo",)


class WrongIndex(Good):
    def frame(self, number: int) -> StereoFrame:
        return replace(super().frame(number), index=7)


class Mirrored(Good):
    def frame(self, number: int) -> StereoFrame:
        good = super().frame(number)
        return replace(good, left=good.left[:, ::-1])


class Drifting(Good):
    reads = 0

    def frame(self, number: int) -> StereoFrame:
        self.reads += 1
        return replace(super().frame(number), left=picture(self.reads))


class Timeless(Good):
    def frame(self, number: int) -> StereoFrame:
        return replace(super().frame(number), time_ns=0)


class AnotherClock(Good):
    def time_ns(self, number: int) -> int:
        return number


class Endless(Good):
    def frame(self, number: int) -> StereoFrame:
        return replace(super().frame(2), index=number, time_ns=number)


class Nameless(Good):
    def frame(self, number: int) -> StereoFrame:
        if number not in (2, 5):
            raise VfoaError(f"no frame {number}")
        return super().frame(number)


class Digestless(Good):
    def digest(self) -> str:
        return "abc"


class Placed(Good):
    """Its digest is of the object, not of its content."""

    def digest(self) -> str:
        return f"{id(self):064x}"


class ZeroDisparity(Good):
    def truth(self, number: int) -> Truth:
        return Truth(disparity=Disparity(disparity_px=np.zeros((HEIGHT, WIDTH), np.float32)))


class SmallMasks(Good):
    def truth(self, number: int) -> Truth:
        return Truth(instances=Instances(ids=np.zeros((2, 2), np.uint16), instances=()))


class Twins(Good):
    def truth(self, number: int) -> Truth:
        ann = PersonTruth(name="ann", instance_id=1, head_box_px=np.array([0.0, 0, 1, 1]))
        return Truth(people=(ann, ann))


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (Descending, "do not ascend"),
        (Empty, "frames: found none"),
        (NumpyNumbers, "expected int"),
        (NoRate, "rate_hz: found 0"),
        (TwoLines, "expected a tuple of single lines"),
        (WrongIndex, "frame 2: its index is 7"),
        (Mirrored, "the left image is not contiguous"),
        (Drifting, "when a frame was read again"),
        (Timeless, "do not ascend"),
        (AnotherClock, "time_ns: found [2, "),
        (Endless, "frame 1, which is not in frames: expected a VfoaError"),
        (Nameless, "expected one line that names the clip and 'frame 1'"),
        (Digestless, "expected a hexadecimal sha256"),
        (Placed, "digest: found another one after pickling"),
        (ZeroDisparity, "expected positive disparities"),
        (SmallMasks, "ids of"),
        (Twins, "people of one name"),
    ],
)
def test_a_broken_promise_is_found(broken: type[Good], message: str) -> None:
    with pytest.raises(AssertionError) as error:
        check_contract(broken())
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", sorted({*ADAPTERS.builtin} - {"studio"}))
def test_files_are_not_looked_for_where_the_program_runs(name: str) -> None:
    with pytest.raises(VfoaError, match=r"^root: missing; expected the path"):
        ADAPTERS.load(name)(MagicMock(), None)
