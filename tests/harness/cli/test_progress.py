"""How far a run is, where nobody watches a terminal."""

from __future__ import annotations

import re
from collections.abc import Callable

import pytest

from harness.cli import terminal


@pytest.fixture
def now(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The clock of the progress, seconds."""
    clock = [100.0]
    monkeypatch.setattr(terminal.time, "monotonic", lambda: clock[0])
    return clock


def _advance_twice_a_second(advance: Callable[[str], None], count: int, now: list[float]) -> None:
    for _ in range(count):
        now[0] += 0.5
        advance("kitchen")


def test_a_log_gets_a_line_a_minute_with_rate_and_time_left(
    now: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    with terminal.frames_bar(600, "run") as advance:
        _advance_twice_a_second(advance, 600, now)
    out, err = capsys.readouterr()
    assert out == ""
    lines = [tuple(map(float, re.findall(r"[0-9.]+", line))) for line in err.splitlines()]
    # frames, of all, frames a second, minutes left
    assert lines == [(120, 600, 2, 4), (240, 600, 2, 3), (360, 600, 2, 2), (480, 600, 2, 1)]
    assert all(line.startswith("kitchen: ") for line in err.splitlines())


def test_the_verdicts_of_recordings_are_counted_by_recording(
    now: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    with terminal.verdicts_bar(600, "run") as advance:
        _advance_twice_a_second(advance, 200, now)
    assert capsys.readouterr().err == "kitchen: 120 of 600 recordings, 2.0 recordings/s, about 4 min left\n"


def test_what_comes_before_the_first_frame_does_not_count_for_the_rate(
    now: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    with terminal.frames_bar(1000, "run") as advance:
        now[0] += 3600  # a clip of a day is opened
        for _ in range(100):
            advance("kitchen")
            now[0] += 1
    assert _rates(capsys) == [1, 1]


def test_frames_of_an_earlier_run_do_not_count_for_the_rate(
    now: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    with terminal.frames_bar(1000, "run") as advance:
        for _ in range(500):
            advance("kitchen")
        for _ in range(200):
            now[0] += 0.5
            advance("kitchen")
    assert _rates(capsys) == [2]


def test_frames_of_half_a_minute_have_a_rate(now: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    with terminal.frames_bar(10, "run") as advance:
        for _ in range(5):
            advance("kitchen")
            now[0] += 30
    assert _rates(capsys) == pytest.approx([1 / 30, 1 / 30], abs=0.05)


def _rates(capsys: pytest.CaptureFixture[str]) -> list[float]:
    """The frames a second of each line."""
    return [float(rate) for rate in re.findall(r"([0-9.]+) frames/s", capsys.readouterr().err)]


def test_a_short_run_prints_no_progress(now: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    with terminal.frames_bar(3, "run") as advance:
        for _ in range(3):
            now[0] += 19
            advance("kitchen")
    assert capsys.readouterr() == ("", "")


def test_the_last_frame_prints_nothing_since_the_table_follows(
    now: list[float], capsys: pytest.CaptureFixture[str]
) -> None:
    with terminal.frames_bar(1, "run") as advance:
        now[0] += 1000
        advance("kitchen")
    assert capsys.readouterr() == ("", "")
