"""Times of day and time codes in tables of one's own: of spreadsheets, Datavyu, and editors of films."""

from __future__ import annotations

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
