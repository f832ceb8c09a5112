from __future__ import annotations

import re
import subprocess
import sys

import numpy as np
import pytest
from rerun.chunk import RrdReader

from harness.cli import main
from harness.recording import entities, find_recordings, viewer
from harness.recording.blueprint import eye_for
from harness.recording.side_by_side import _first_clouds
from harness.recording.viewer import viewer_binary

SUMMARY = "TextDocument:text"


@pytest.fixture
def run(frames, record_run):
    """Two configurations of one clip; the second has not seen the last frame."""
    first = record_run(frames)
    second = first.with_name("clip__four cones.rrd")
    kept = first.read_bytes()
    record_run(frames[:3]).rename(second)
    first.write_bytes(kept)
    return first.parent


def _vfoa(monkeypatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["vfoa", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


def _compare(monkeypatch, run) -> tuple[int, list]:
    shown: list = []
    monkeypatch.setattr(viewer, "show", lambda recordings, frame: shown.append((recordings, frame)))
    code = _vfoa(monkeypatch, "view", str(run), "--clip", "clip", "--compare", "two", "four cones", "--frame", "11")
    return code, shown


def test_the_eye_is_where_it_sees_what_the_recordings_have(run, frames):
    scene = frames[0].result.scene
    low, high = (of([of(each.points_left, axis=0) for each in scene.targets], axis=0) for of in (np.min, np.max))
    clouds = _first_clouds(run / "clip__two.rrd")
    assert len(clouds) >= len(scene.targets)
    position, look_target = eye_for(clouds)
    assert np.all((look_target > low - 0.5) & (look_target < high + 0.5))
    assert position[2] < look_target[2]  # from the camera's side


def test_both_are_whole_under_their_names_and_share_the_time(run, read_back, monkeypatch):
    before = find_recordings(run, None, None)
    code, shown = _compare(monkeypatch, run)
    both = run / "clip__two__vs__four cones.rrd"
    assert (code, shown) == (0, [([both], 11)])
    done = subprocess.run([viewer_binary(), "rrd", "verify", both], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert len(RrdReader(both).recordings()) == 1

    columns, expected = read_back(both), set()
    for configuration, prefix in (("two", "/two"), ("four cones", r"/four\ cones")):
        alone = read_back(run / f"clip__{configuration}.rrd")
        own = {path for path in alone.paths if not path.startswith("/__properties")}
        expected |= {prefix + path for path in own}
        assert columns.at(prefix + entities.SUMMARY, SUMMARY) == alone.at(entities.SUMMARY, SUMMARY)
        assert all(columns.timelines(prefix + path) == alone.timelines(path) for path in own)
    assert {path for path in columns.paths if not path.startswith("/__properties")} == expected
    assert set(columns.at("/two" + entities.SUMMARY, SUMMARY)) == {10, 11, 13, 14}
    assert set(columns.at(r"/four\ cones" + entities.SUMMARY, SUMMARY)) == {10, 11, 13}

    # it is nobody's recording: a run lists the same as before
    assert find_recordings(run, None, None) == before


def test_it_can_be_written_again(run, monkeypatch):
    assert _compare(monkeypatch, run)[0] == _compare(monkeypatch, run)[0] == 0
    assert not list(run.glob("*.partial"))
    assert not list(run.glob(".*"))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--compare", "two", "four cones"), "--clip"),
        (("--clip", "clip", "--compare", "two", "two"), "two configurations"),
        (("--clip", "clip", "--compare", "two", "tow"), "did you mean 'two'?"),
    ],
)
def test_a_mistake_is_one_line_and_writes_nothing(run, arguments, said, monkeypatch, capsys):
    assert _vfoa(monkeypatch, "view", str(run), *arguments) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not list(run.glob("*__vs__*"))


def test_a_recording_that_was_cut_is_one_line(run, monkeypatch, capsys):
    recording = run / "clip__four cones.rrd"
    recording.write_bytes(recording.read_bytes()[:-200])
    assert _compare(monkeypatch, run)[0] == 2
    assert re.fullmatch(r"vfoa: .*clip__four cones\.rrd: not a whole recording: .+\n", capsys.readouterr().err)
    recording.write_bytes(b"no recording")
    assert _compare(monkeypatch, run)[0] == 2
    assert not list(run.glob("*__vs__*"))
