"""Times of day, time codes and times since 1970 in tables of one's own: of spreadsheets, Datavyu, editors, scripts."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from harness.labels.formats.own_table import OwnTable
from harness.labels.labels import Labels
from tests.disk import write_text
from tests.exchanges import PlainClip, exchange, row
from vfoa.errors import VfoaError

HUNDRED = PlainClip(frames=range(1, 101), rate_hz=25.0)
"""Frame n is the picture n - 1 of a film of 25 per second."""


def _read(folder: Path, *rows: str, columns: str = "start,end", **more: object) -> Labels:
    lines = [f"{cells},girl,{look}" for cells, look in zip(rows, ("bird", "cup"), strict=False)]
    text = "\n".join([f"{columns},who,what", *lines])
    return OwnTable().read(write_text(folder / "mine.csv", text), exchange(HUNDRED, **more)).labels


EXPECTED = Labels([row(11, 30, "bird"), row(31, 60, "cup")])


@pytest.mark.parametrize(
    ("rows", "fps"),
    [
        (("0:00:00.4,0:00:01.2", "0:00:01.2,0:00:02.4"), None),
        (("00:00:00:400,00:00:01:200", "00:00:01:200,00:00:02:400"), None),  # Datavyu
        (("00:00:00:10,00:00:01:05", "00:00:01:05,00:00:02:10"), 25.0),
        (("00:00:00:10,00:00:01:10", "00:00:01:10,00:00:03:00"), 20.0),
        (("00:00:00:10,00:00:01:06", "00:00:01:06,00:00:02:12"), 23.976),
        (("00:00:00:10,00:00:01:00", "00:00:01:00,00:00:02:00"), 29.97),
    ],
)
def test_clocks_and_time_codes_say_the_same(tmp_path: Path, rows: tuple[str, str], fps: float | None) -> None:
    """At another rate, a time code is that of the picture that the film shows then."""
    assert _read(tmp_path, *rows, fps=fps) == EXPECTED


@pytest.mark.parametrize("fps", [25.0, 29.97])
@pytest.mark.parametrize(
    ("rows", "ends"),
    [
        (("00:00:00:10,00:00:01:04", "00:00:01:05,00:00:02:09"), 1),  # the next one begins one picture later
        (("00:00:00:10,00:00:01:04", "00:00:01:07,00:00:01:07"), 1),  # one picture
        (("00:00:00:10,00:00:01:05", "00:00:01:05,00:00:02:09"), 0),  # the next one begins where it ends
        (("00:00:00:10,00:00:01:05", "00:00:01:08,00:00:02:09"), 0),
    ],
)
def test_the_last_picture_of_a_row_is_in_it_where_the_next_one_begins_after_it(
    tmp_path: Path, rows: tuple[str, str], ends: int, fps: float
) -> None:
    """INTERACT's rows end with their last picture, those of editors with the next one."""
    clip, codes = PlainClip(frames=range(100), rate_hz=fps), [cells.split(",") for cells in rows]
    text = "\n".join(
        ["start,end,who,what", f"{rows[0]},girl,bird", f"{rows[1]},girl,cup", "0:00:00:11,0:00:02:20,boy,cup"]
    )
    imported = OwnTable().read(write_text(tmp_path / "mine.csv", text), exchange(clip, fps=fps))
    rate = math.ceil(fps)
    places = [[rate * int(code[6:8]) + int(code[9:]) for code in pair] for pair in codes]
    expected = [row(first, last - 1 + ends, name) for (first, last), name in zip(places, ("bird", "cup"), strict=True)]
    assert [each for each in imported.labels.of("girl") if each.label.target != "ignore"] == expected
    assert any("INTERACT" in note for note in imported.notes) == bool(ends)
    assert not any("--fps" in note for note in imported.notes)  # it is the clip's own rate


def test_time_codes_of_onsets_and_of_single_frames_are_read(tmp_path: Path) -> None:
    onsets = _read(tmp_path, "00:00:00:10", "00:00:01:05", columns="onset", until_next=True, fps=25.0)
    assert onsets == Labels([row(11, 30, "bird"), row(31, 100, "cup")])
    single = _read(tmp_path, "00:00:00:10", "00:00:00:11", columns="time", fps=25.0)
    assert single == Labels([row(11, 11, "bird"), row(12, 12, "cup")])


def test_every_picture_has_its_own_time_code(tmp_path: Path) -> None:
    """Also after the minutes in which 29.97 drops two numbers."""
    clip = PlainClip(frames=range(1, 4000), rate_hz=29.97)
    for code, frame in (("00:00:59;29", 1800), ("00:01:00;02", 1801), ("00:02:00;02", 3599), ("00:01:00:00", 1801)):
        text = f"time,who,what\n{code},girl,bird\n"
        read = OwnTable().read(write_text(tmp_path / "mine.csv", text), exchange(clip, fps=29.97))
        assert read.labels == Labels([row(frame, frame, "bird")])


@pytest.mark.parametrize(("code", "fps"), [("00:00:00:10", None), ("00:00:00:25", 25.0), ("00:61:00:10", 25.0)])
def test_time_codes_that_are_none_are_refused(tmp_path: Path, code: str, fps: float | None) -> None:
    with pytest.raises(VfoaError, match=r"mine\.csv:2: start_s: found.*(--fps|expected a time)"):
        _read(tmp_path, f"{code},00:00:03:00", fps=fps)


DATED = PlainClip(frames=range(10), rate_hz=10.0, start_ns=1_714_564_803_250_000_000)
"""Its first frame is at 2024-05-01 12:00:03.25 UTC."""
SECONDS = 1_714_564_803


@pytest.mark.parametrize(
    ("columns", "first", "second"),
    [
        ("timestamp", "2024-05-01T12:00:03.450", "2024-05-01T12:00:03.550"),
        ("timestamp", "2024-05-01 12:00:03.450000+00:00", "2024-05-01 14:00:03.550000+02:00"),
        ("timestamp", f"{SECONDS}.45", f"{SECONDS}.55"),
        ("timestamp", f"{SECONDS}450", f"{SECONDS}550"),
        ("timestamp", f"{SECONDS}450000000", f"{SECONDS}550000000"),
        ("time_ms", f"{SECONDS}450", f"{SECONDS}550.0"),
        ("time_us", f"{SECONDS}450000", f"{SECONDS}550000"),
        ("start,end", f"{SECONDS}.45,{SECONDS}.55", f"{SECONDS}.55,{SECONDS}.65"),
        ("start,duration", "2024-05-01T12:00:03.45Z,0.1", "2024-05-01T12:00:03.55Z,0.1"),
        ("start_ms,duration_ms", f"{SECONDS}450,100", f"{SECONDS}550,100"),
    ],
)
def test_times_since_1970_are_those_of_a_clip_with_such_times(
    tmp_path: Path, columns: str, first: str, second: str
) -> None:
    text = f"{columns},who,what\n{first},girl,bird\n{second},girl,cup\n"
    path, expected = write_text(tmp_path / "mine.csv", text), Labels([row(2, 2, "bird"), row(3, 3, "cup")])
    assert OwnTable().read(path, exchange(DATED)).labels == expected
    film = exchange(PlainClip(frames=range(10), rate_hz=10.0), offset=SECONDS + 0.25)
    assert OwnTable().read(path, film).labels == expected


def test_times_since_the_beginning_are_no_times_since_1970(tmp_path: Path) -> None:
    path = write_text(tmp_path / "mine.csv", "time,who,what\n0.2,girl,bird\n0.3,girl,cup\n")
    assert OwnTable().read(path, exchange(DATED)).labels == Labels([row(2, 2, "bird"), row(3, 3, "cup")])
    late = write_text(tmp_path / "late.csv", "time,who,what\n2024-05-01T12:00:09,girl,bird\n")
    assert not OwnTable().read(late, exchange(DATED)).labels.ranges
    with pytest.raises(VfoaError, match="expected a time"):
        OwnTable().read(write_text(late, "time,who,what\n2024-05-41T12:00:09,girl,bird\n"), exchange(DATED))


@pytest.mark.parametrize("columns", ["start,end", "time_ms"])
@pytest.mark.parametrize(
    ("begin_s", "first_s", "has_images", "is_noted"),
    [
        (0.04, 0.04, False, True),  # a frame of 25 per second
        (0.04, 0.04, True, False),  # images that are numbered from 1 on
        (3.2, 3.2, True, True),
        (3.2, 4.0, False, True),
        (3.2, 0.0, False, False),  # before the clip on its own clock
        (3.2, 6.0, False, False),  # beyond its end
        (0.0, 0.0, False, False),
    ],
)
def test_times_that_may_be_of_the_clips_own_clock_are_noted(
    tmp_path: Path, columns: str, begin_s: float, first_s: float, has_images: bool, is_noted: bool
) -> None:
    clip = PlainClip(frames=range(100), start_ns=round(begin_s * 1e9))
    last_s = first_s + 1.5
    cells = [f"{first_s},{last_s}"] if columns == "start,end" else [f"{1000 * at:.0f}" for at in (first_s, last_s)]
    text = "\n".join([f"{columns},who,what", *(f"{cell},girl,bird" for cell in cells)])
    path, notes = write_text(tmp_path / "mine.csv", text), list[str]()
    for offset in (None, begin_s):
        imported = OwnTable().read(path, exchange(clip, has_images=has_images, offset=offset))
        notes += [note for note in imported.notes if "own clock" in note]
    assert len(notes) == is_noted
    assert all(f"--offset {begin_s:g}." in note for note in notes)
