"""Labels in tables of one's own whose rows have the name of an image in place of a frame number."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import pytest

from harness.labels.formats.exchange import Imported
from harness.labels.formats.own_table import OwnTable
from harness.labels.labels import Labels
from tests.disk import write_text
from tests.exchanges import PlainClip, exchange, row
from vfoa.errors import VfoaError

FIVE = PlainClip(frames=range(1, 6), rate_hz=10.0)
LOOKS = ("bird", "bird", "none", "none", "none")
EXPECTED = Labels([row(1, 2, "bird"), row(3, 5, "none"), row(2, 2, "girl", "boy")])


def _read(folder: Path, text: str, clip: PlainClip = FIVE, **more: object) -> Labels:
    return OwnTable().read(write_text(folder / "mine.csv", text), exchange(clip, **more)).labels


@pytest.mark.parametrize(
    ("column", "name"),
    [
        ("image", "{n:06d}.png"),
        ("image_name", "frame_{n}.jpg"),
        ("filename", "/data/2024/p03/left/frame_{n:04d}_left.png"),
        ("Image Path", "C:\\data\\p03\\frame_{n:04d}.png"),
        ("image_id", "{n}"),
        ("frame", "frame_{n:06d}.png"),
        ("frame_name", "frame_{n:06d}"),
    ],
)
def test_the_number_in_an_image_s_name_is_its_frame(tmp_path: Path, column: str, name: str) -> None:
    rows = [f"{name.format(n=n)},girl,{look}" for n, look in enumerate(LOOKS, start=1)]
    text = "\n".join([f"{column},person,label", *rows, f"{name.format(n=2)},boy,girl"])
    assert _read(tmp_path, text) == EXPECTED


def test_images_named_by_time_stamps_are_the_frames_of_these_numbers(tmp_path: Path) -> None:
    first = 1_718_000_000_900_000
    clip = PlainClip(frames=[first, first + 100_000, first + 200_000])
    text = "image,person,label\n1718000000.900000.png,girl,bird\n1718000001.000000.png,girl,bird\n"
    assert _read(tmp_path, text, clip) == Labels([row(first, first + 100_000, "bird")])


def test_names_of_label_studio_are_those_before_the_upload(tmp_path: Path) -> None:
    """Its CSV has a column for each tag of choices, here named after a person; a date is no mark of an upload."""
    rows = [f"{n},1,{look},/data/upload/1/{n}a1b2c3d-frame_{n:06d}.png" for n, look in enumerate(LOOKS, start=1)]
    assert _read(tmp_path, "\n".join(["annotation_id,annotator,girl,image", *rows])) == Labels(
        [row(1, 2, "bird"), row(3, 5, "none")]
    )
    dated = [f"20240501-12000{n}.png,{look}" for n, look in enumerate(LOOKS, start=1)]
    seconds = range(1_714_564_801_000, 1_714_564_806_000, 1000)
    clip = PlainClip(frames=seconds)
    assert _read(tmp_path, "\n".join(["image,girl", *dated]), clip) == Labels(
        [row(seconds[0], seconds[1], "bird"), row(seconds[2], seconds[4], "none")]
    )


@pytest.mark.parametrize("name", ["{s}.{us:06d}.png", "{s}{us:06d}.png", "{s}_{us:06d}000.png"])
def test_images_of_a_recording_are_known_by_their_stamps(tmp_path: Path, name: str) -> None:
    """The clip's frames are counted from 1; each image is that of the frame at its time."""
    start_s = 1_718_000_000
    clip = PlainClip(frames=range(8, 13), rate_hz=10.0, start_ns=start_s * 10**9)
    times_us = [n * 100_000 + 300 for n in clip.frames]
    names = [name.format(s=start_s + us // 10**6, us=us % 10**6) for us in times_us]
    text = "\n".join(["image,who,label", *(f"{each},girl,{look}" for each, look in zip(names, LOOKS, strict=True))])
    assert _read(tmp_path, text, clip) == Labels([row(8, 9, "bird"), row(10, 12, "none")])


@pytest.mark.parametrize("columns", ["filename,first_frame,last_frame", "filename,start_ms,end_ms"])
def test_the_name_of_a_film_beside_frames_or_times_is_none_of_an_image(tmp_path: Path, columns: str) -> None:
    ends = "1,2" if "frame" in columns else "0,200"
    assert _read(tmp_path, f"{columns},person,label\ntalk_3.mp4,{ends},girl,bird\n") == Labels([row(1, 2, "bird")])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("image,person,label\n0001.png,girl,bird\n0009.png,girl,bird\n", "frame 9 is outside the clip"),
        ("image,person,label\np1/0001.png,girl,bird\np2/0003.png,girl,bird\n", "2 numbers differ"),
        ("filename,person,label\ntalk.mp4,girl,bird\n", "where a row holds"),
        ("image,person,label\nabc.png,girl,bird\n", "mine.csv:2: image: found 'abc.png'"),
        ("image,person,label\n1.png,girl,bird\nlast,girl,bird\n", "mine.csv:3: image: found 'last'"),
        ("file,person,label\n1.png,girl,bird\n2,girl,bird\n", "mine.csv:3: file: found '2'"),
        ("image,filename,person,label\n1.png,1.txt,girl,bird\n", "where a row holds"),
    ],
)
def test_images_that_are_no_frames_are_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(VfoaError, match=re.escape(said)):
        _read(tmp_path, text)


EVERY_OTHER = {1: "bird", 2: "ignore", 3: "bird"}


def _by_frame(labels: Labels) -> dict[int, str]:
    return {each.first_frame: each.label.target for each in labels.ranges}


def test_a_frame_beside_another_image_is_refused(tmp_path: Path) -> None:
    text = "image,frame,who,label\nleft_0001.png,1,girl,bird\nleft_0003.png,{n},girl,bird\n"
    assert _by_frame(_read(tmp_path, text.format(n=3))) == EVERY_OTHER
    with pytest.raises(VfoaError, match=r"mine\.csv:3: frame and image: found 2 and left_0003\.png, .*frame 3"):
        _read(tmp_path, text.format(n=2))


@pytest.mark.parametrize(
    ("text", "more"),
    [
        ("image_id,frame,who,label\n4,1,girl,bird\n2,3,girl,bird\n", {}),  # numbers are no names
        ("image,frame,who,label\n171.png,1,girl,bird\n173.png,3,girl,bird\n", {}),  # of no frame of the clip
        ("image,frame,who,label\na1_2.png,1,girl,bird\na2_3.png,3,girl,bird\n", {}),
        ("image,frame,who,label\n2.png,1,girl,bird\n4.png,3,girl,bird\n", {"films": {"talk.mp4": 0.0}}),
        ("image,frame,who,label\n2.png,1,girl,bird\n4.png,3,girl,bird\n", {"fps": 10.0}),
    ],
)
def test_images_that_may_be_those_of_their_frames_are_not_compared(
    tmp_path: Path, text: str, more: dict[str, object]
) -> None:
    clip = PlainClip(frames=range(5), rate_hz=10.0)
    assert _by_frame(_read(tmp_path, text, clip, **more)) == EVERY_OTHER


FILM = PlainClip(frames=range(5), rate_hz=10.0)


def _of_film(folder: Path, numbers: Sequence[int]) -> Imported:
    rows = [f"frame_{n:04d}.png,girl,bird" for n in numbers]
    path = write_text(folder / "mine.csv", "\n".join(["image,who,label", *rows]))
    return OwnTable().read(path, exchange(FILM, films={"talk.mp4": 0.0}))


def test_pictures_of_a_film_that_end_after_its_last_frame_count_from_1(tmp_path: Path) -> None:
    imported = _of_film(tmp_path, [3, 4, 5])
    assert imported == Imported(labels=Labels([row(2, 4, "bird")]))
    assert _of_film(tmp_path, [0, 1]).labels == Labels([row(0, 1, "bird")])


@pytest.mark.parametrize("numbers", [[1, 2], [3, 4]])
def test_pictures_of_a_film_that_may_count_from_1_are_noted(tmp_path: Path, numbers: list[int]) -> None:
    imported = _of_film(tmp_path, numbers)
    assert imported.labels == Labels([row(numbers[0], numbers[1], "bird")])
    (note,) = imported.notes
    assert f"frame_{numbers[0]:04d}.png" in note
    assert not _of_film(tmp_path, [*range(numbers[-1])]).notes


def test_pictures_at_another_rate_are_no_frames(tmp_path: Path) -> None:
    text = "image,who,label\nframe_0000.png,girl,bird\nframe_0001.png,girl,bird\n"
    path = write_text(tmp_path / "mine.csv", text)
    with pytest.raises(VfoaError, match=r"--fps 5.*10 frames per second.*time_s"):
        OwnTable().read(path, exchange(FIVE, fps=5.0))
    assert OwnTable().read(path, exchange(FIVE, fps=10.0)).labels == Labels([row(n, n, "bird") for n in (1, 2)])
