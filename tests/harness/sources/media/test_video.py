from __future__ import annotations

import os
import pickle
from pathlib import Path

import numpy as np
import pytest

from harness.sources.media.video import STEP, Video
from tests.disk import moving_picture, write_bytes, write_text, write_video
from vfoa.errors import VfoaError

COUNT = 3 * STEP
KINDS = [("a.mp4", "mp4v"), ("a.avi", "MJPG"), ("a.mkv", "XVID"), ("a.mkv", "FFV1")]
IMAGES = [moving_picture(number) for number in range(COUNT)]


@pytest.mark.parametrize(("name", "fourcc"), KINDS)
def test_a_frame_found_by_seeking_is_the_frame_found_by_reading(tmp_path: Path, name: str, fourcc: str) -> None:
    path = write_video(tmp_path / name, IMAGES, fourcc)
    in_order = Video(path)
    frames = [in_order.read(place) for place in range(COUNT)]
    anywhere = Video(path)
    for place in np.random.default_rng(0).permutation(COUNT):
        assert np.array_equal(anywhere.read(int(place)), frames[place])
    differences = [[np.abs(frame.astype(int) - image).mean() for image in IMAGES] for frame in frames]
    assert np.argmin(differences, axis=1).tolist() == list(range(COUNT))


def test_what_the_container_says_is_read(tmp_path: Path) -> None:
    video = Video(write_video(tmp_path / "a.mp4", IMAGES[:10], "mp4v", rate_hz=12.5))
    assert (video.frames, video.rate_hz, video.notes) == (range(10), 12.5, ())
    assert list(video.times_ns) == [80_000_000 * place for place in range(10)]


@pytest.mark.parametrize(("name", "fourcc"), [("a.avi", "MJPG"), ("a.mkv", "FFV1")])
def test_a_cut_file_has_the_frames_before_the_cut_and_says_so(tmp_path: Path, name: str, fourcc: str) -> None:
    path = write_video(tmp_path / name, IMAGES, fourcc)
    whole = Video(path)
    frames = [whole.read(place) for place in range(COUNT)]
    cut = Video(write_bytes(tmp_path / "cut" / name, path.read_bytes()[: path.stat().st_size * 6 // 10]))
    count = len(cut.frames)
    assert COUNT / 2 < count < COUNT
    assert cut.notes == (f"{name}: the container says {COUNT} frames, {count} can be read",)
    assert all(np.array_equal(cut.read(place), frames[place]) for place in range(count - 1))
    with pytest.raises(VfoaError, match=rf"{name}: no frame {count}; expected 0 to {count - 1}"):
        cut.read(count)


def test_it_travels_to_other_processes(tmp_path: Path) -> None:
    video = Video(write_video(tmp_path / "a.mkv", IMAGES[:5]))
    third = video.read(3)
    assert np.array_equal(pickle.loads(pickle.dumps(video)).read(3), third)


def test_files_that_are_no_video_are_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(VfoaError, match=r"a\.mp4: not a readable video"):
        Video(write_text(tmp_path / "a.mp4", "no video"))
    with pytest.raises(VfoaError, match=r"b\.mp4: no such file"):
        Video(tmp_path / "b.mp4")
    assert capfd.readouterr() == ("", "")


def test_a_name_that_is_not_utf_8_does_not_end_the_process(tmp_path: Path) -> None:
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/caf\xe9.mkv"))
    write_video(tmp_path / "a.mkv", [moving_picture(0)]).rename(path)
    with pytest.raises(VfoaError, match=r"its name is not UTF-8, which FFmpeg cannot open; rename it"):
        Video(path)
