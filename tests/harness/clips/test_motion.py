"""Views that were not taken at the same time are found by what moves in them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.clips.matching import ROWS_FRAMES, MovingRows, motion, right_offset
from harness.sources.media.images import read_rgb
from tests.disk import write_image, write_video
from tests.harness.clips.adding import NUMBERS, vfoa
from tests.scenes import make_rig
from vfoa.types import Image, StereoFrame

HEIGHT, WIDTH = 96, 160


def _film(count: int, seed: int, *, is_still: bool = False) -> list[tuple[Image, Image]]:
    """Pairs in which a bright square moves at a speed that changes, before a wall 8 pixels apart."""
    random = np.random.default_rng(seed)
    wall = random.integers(0, 120, (HEIGHT, WIDTH + 8, 3), dtype=np.uint8)
    at, speed, pairs = 40.0, 0.0, []
    for _ in range(count):
        speed = 0.0 if is_still else 0.8 * speed + random.normal(0, 2)
        at = float(np.clip(at + speed, 0, WIDTH - 40))
        noise = random.integers(0, 6, (2, HEIGHT, WIDTH, 3), dtype=np.uint8)
        views = [wall[:, :WIDTH] + noise[0], wall[:, 8:] + noise[1]]
        for view, left in zip(views, (int(at) + 16, int(at)), strict=True):
            view[30:60, left : left + 24] = 250
        pairs.append((views[0], views[1]))
    return pairs


def _frames(pairs: Sequence[tuple[Image, Image]], late: int) -> list[StereoFrame]:
    """Frames whose right views are those of ``late`` frames before."""
    height, width = pairs[0][0].shape[:2]
    rig = make_rig(width, height)
    lefts, rights = pairs[max(late, 0) :], pairs[max(-late, 0) :]
    return [
        StereoFrame(index=number, time_ns=number, left=left, right=right, rig=rig)
        for number, ((left, _), (_, right)) in enumerate(zip(lefts, rights, strict=False))
    ]


@pytest.mark.parametrize("late", [-16, -5, -2, 0, 3, 16])
def test_right_views_of_another_time_are_told_by_how_many_frames(late: int) -> None:
    assert right_offset(motion(_frames(_film(80, 3), late)), 16) == (late or None)


def test_where_nothing_moves_nothing_is_told() -> None:
    assert right_offset(motion(_frames(_film(80, 4, is_still=True), 5)), 16) is None
    assert right_offset(np.zeros((2, 80)), 16) is None


def test_views_of_other_places_are_not_told(tmp_path: Path) -> None:
    one, other = _film(80, 5), _film(80, 6)
    pairs = [(left, right) for (left, _), (_, right) in zip(one, other, strict=True)]
    assert right_offset(motion(_frames(pairs, 0)), 16) is None


def _poster(seed: int, step: tuple[int, int], count: int = ROWS_FRAMES + 2) -> list[tuple[Image, Image]]:
    """Pairs in which a poster moves by (columns, rows) in each frame, before a wall 8 pixels apart."""
    random = np.random.default_rng(seed)
    wall, poster = (cv2.resize(random.integers(0, 255, (30, 40, 3), np.uint8), size) for size in ((208, 170), (80, 60)))
    pairs = []
    for number in range(count):
        views = wall[:, :200].copy(), wall[:, 8:].copy()
        for view, disparity in zip(views, (24, 0), strict=True):
            row, column = 10 + step[1] * number, 10 + step[0] * number + disparity
            view[row : row + 60, column : column + 80] = poster
        pairs.append(views)
    return pairs


def _rows(frames: Sequence[StereoFrame]) -> MovingRows:
    pairs = [(frame.left, frame.right) for frame in frames[:ROWS_FRAMES] if frame.right is not None]
    return MovingRows(pairs.__getitem__)


@pytest.mark.parametrize("late", [-2, 0, 1])  # -1 and 2: the real views below
def test_what_moves_as_fast_in_each_frame_is_told_by_its_rows(late: int) -> None:
    frames = _frames(_poster(1, (2, 3)), late)[:ROWS_FRAMES]
    assert right_offset(motion(frames), 7) is None
    rows = _rows(frames)
    assert (rows.agree(), rows.offset()) == (late == 0, late)


def test_where_the_rows_agree_no_more_frames_are_read_than_that_takes_and_in_their_order() -> None:
    pairs, read = _poster(1, (2, 3)), list[int]()
    assert MovingRows(lambda place: (read.append(place), pairs[place])[1]).agree()
    assert read == [*range(3, 12)]  # in their order, as a film is read


def test_rows_tell_nothing_of_what_moves_sideways() -> None:
    rows = _rows(_frames(_poster(2, (3, 0)), 1))
    assert (rows.agree(), rows.offset()) == (True, None)


def test_where_nothing_moves_no_features_are_looked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """They take most of the time of a check."""
    monkeypatch.setattr("harness.clips.matching._features", None)
    rows = _rows(_frames([_poster(3, (0, 0))[0]] * (ROWS_FRAMES + 2), 1))
    assert (rows.agree(), rows.offset()) == (True, None)


@pytest.mark.parametrize(("beside_px", "told"), [(0.5, -1), (0.3, None)])
def test_an_offset_is_told_if_both_beside_it_are_clearly_worse(
    monkeypatch: pytest.MonkeyPatch, beside_px: float, told: int | None
) -> None:
    apart_px = {-1: 0.2, -2: beside_px}
    monkeypatch.setattr(MovingRows, "_measured_px", lambda self, by: np.full(100, apart_px.get(by, 5.0)))
    assert _rows([]).offset() == told


@pytest.mark.parametrize("late", [-1, 0, 2])
def test_real_views_of_other_frames_are_told_by_their_rows(shared_data: Path, late: int) -> None:
    training = shared_data / "sintel" / "training"
    pairs = [
        (
            read_rgb(training / "clean_left" / "bandage_2" / f"frame_{number:04d}.png")[:, 256:768],
            read_rgb(training / "clean_right" / "bandage_2" / f"frame_{number:04d}.png")[:, 256:768],
        )
        for number in range(15, 15 + ROWS_FRAMES + 2)
    ]
    rows = _rows(_frames(pairs, late))
    assert (rows.agree(), rows.offset()) == (late == 0, late)


@pytest.mark.usefixtures("work_here")
@pytest.mark.parametrize(("lost", "words"), [(None, []), (15, [(0, "at the same time"), (31, "1 frame earlier")])])
def test_a_camera_that_loses_an_image_is_out_of_step_from_there_on(
    tmp_path: Path, lost: int | None, words: list[tuple[int, str]]
) -> None:
    """The names of both cameras' images count on."""
    pairs = _poster(1, (1, 2), 3 * ROWS_FRAMES + 2)
    rights = [right for place, (_, right) in enumerate(pairs) if place != lost]
    for number, ((left, _), right) in enumerate(zip(pairs, rights, strict=False)):
        write_image(tmp_path / "data" / "left" / f"{number:03d}.png", left)
        write_image(tmp_path / "data" / "right" / f"{number:03d}.png", right)
    vfoa("add", tmp_path / "data", *NUMBERS, "--name", "mine")
    (checked,) = vfoa("check", "mine")
    told = [note for note in checked["notes"] if "what moves" in note]
    assert len(told) == bool(words)
    for begin, word in words:
        assert f"{word} in frames {begin} to {begin + ROWS_FRAMES - 1}" in told[0]


def test_frames_that_cannot_be_read_are_no_motion() -> None:
    frames: list[StereoFrame | None] = [*_frames(_film(120, 7), 4)]
    for lost in (10, 11, 60):
        frames[lost] = None
    changes = motion(frames)
    assert np.isnan(changes[0]).nonzero()[0].tolist() == [9, 10, 11, 59, 60]
    assert right_offset(changes, 16) == 4
    assert motion([]).shape == motion(frames[:1]).shape == (2, 0)


@given(st.lists(st.integers(0, 255), min_size=2, max_size=6))
def test_motion_is_the_mean_change_of_gray(grays: list[int]) -> None:
    rig = make_rig(WIDTH, HEIGHT)
    views = [np.full((HEIGHT, WIDTH, 3), gray, np.uint8) for gray in grays]
    frames = [StereoFrame(index=n, time_ns=n, left=view, right=view, rig=rig) for n, view in enumerate(views)]
    expected = [float(abs(one - other)) for one, other in pairwise(grays)]
    assert motion(frames).tolist() == [expected, expected]


@pytest.mark.usefixtures("work_here")
@pytest.mark.parametrize(("late", "given", "swap"), [(5, 0, False), (-5, 2, False), (40, 0, False), (5, 2, True)])
def test_two_videos_that_were_not_started_together_are_told_their_offset(
    tmp_path: Path, late: int, given: int, swap: bool
) -> None:
    """The check says the setting with which it passes; an offset of seconds is found over all frames."""
    pairs = _film(64 + 2 * abs(late), 8)
    firsts, others = pairs[max(late, 0) :], pairs[max(-late, 0) :]
    write_video(tmp_path / "data" / "left.avi", [views[swap] for views in firsts])
    write_video(tmp_path / "data" / "right.avi", [views[not swap] for views in others])
    words = ("add", tmp_path / "data", *NUMBERS, "--set", f"swap={swap}".lower(), "--set", f"right_offset={given}")
    vfoa(*words, "--name", "mine")
    every = ("--every-frame",) * (abs(late) > 16)
    (checked,) = vfoa("check", "mine", *every)
    told = [note for note in checked["notes"] if "right_offset" in note]
    assert [note.rpartition(": ")[2] for note in told] == [f"say right_offset = {late} in [source]"]
    vfoa(*words[:-1], f"right_offset={late}", "--name", "right")
    (checked,) = vfoa("check", "right", *every)
    assert [note for note in checked["notes"] if "right_offset" in note] == []


@pytest.mark.usefixtures("work_here")
def test_folders_of_images_are_told_their_offset_by_number_and_asked_for_their_clock(tmp_path: Path) -> None:
    pairs = _film(60, 9)
    for number, ((left, _), (_, right)) in enumerate(zip(pairs[3:], pairs, strict=False)):
        write_image(tmp_path / "data" / "left" / f"{number:03d}.png", left)
        write_image(tmp_path / "data" / "right" / f"{number:03d}.png", right)
    vfoa("add", tmp_path / "data", *NUMBERS, "--name", "mine")
    (checked,) = vfoa("check", "mine")
    assert [
        note.rpartition(": ")[2] for note in checked["notes"] if "moves 3 frames later in the right one" in note
    ] == ["say right_offset = 3 in [source]"]
    vfoa("add", tmp_path / "data", *NUMBERS, "--name", "right", "--set", "right_offset=3")
    (checked,) = vfoa("check", "right")
    assert not [note for note in checked["notes"] if "moves" in note]
    for file in sorted((tmp_path / "data").glob("*/*.png")):
        file.rename(file.with_stem(f"{1718000000000 + 40 * int(file.stem)}"))
    vfoa("add", tmp_path / "data", *NUMBERS, "--name", "stamped")
    (checked,) = vfoa("check", "stamped")
    assert [note for note in checked["notes"] if note.endswith("of both cameras of one clock?")]
