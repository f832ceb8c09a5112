"""One configuration or one clip fails: the others are finished, scored, and the failure is said."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import typer

from harness.cli import main
from harness.cli.run import _report_failures
from harness.pipeline.perception import Perception
from harness.report.sinks import composed_sinks
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.run.table_records import read_records
from harness.score.finished_run import read_scores
from tests.disk import sintel_scene, write_text
from tests.experiments import BLOCKS, experiment_of
from tests.recorded import values_of
from tests.records import tables_of, write_manifest
from vfoa.cones import Cones
from vfoa.errors import VfoaError
from vfoa.stereo.block_matching import SemiGlobalMatcher
from vfoa.types import Disparity, Scene, StereoFrame

STAGES = {**BLOCKS, "head_pose.model": "none", "gaze.model": "truth"}
MATCHERS = {"bm": {}, "sgbm": {"stereo.matcher": "sgbm"}}


@pytest.fixture
def broken_sgbm(monkeypatch: pytest.MonkeyPatch) -> None:
    match = SemiGlobalMatcher.match

    def fails_once(self: SemiGlobalMatcher, frame: StereoFrame) -> Disparity:
        if frame.index == 2:
            raise VfoaError("out of memory")
        return match(self, frame)

    monkeypatch.setattr(SemiGlobalMatcher, "match", fails_once)


def _run(folder: Path, clips: list[str], *, retry: bool = False, recorded: bool = False) -> RunDirectory:
    file = write_text(folder / "two.toml", experiment_of(clips, MATCHERS, STAGES))
    experiment = load_experiment(str(file))
    plan = prepare(experiment, limit=2, sinks=composed_sinks(experiment.configurations, recorded=recorded))
    out = folder / "out"
    return run_plan(plan, out, workers=1, progress=lambda clip: None, retry_failed=retry)


def test_a_configuration_that_fails_is_left_out_and_said(tmp_path: Path, broken_sgbm: None) -> None:
    directory = _run(tmp_path, ["studio_table", "studio_talk"], recorded=True)
    failed = directory.read_manifest().failed
    assert [(each.clip, each.configuration, each.error) for each in failed] == [
        ("studio_table", "sgbm", "out of memory"),
        ("studio_talk", "sgbm", "out of memory"),
    ]
    assert [record.configuration for record in read_records(directory)] == ["bm"] * 4
    assert sorted(path.name for path in directory.path.glob("*.rrd")) == [
        f"{clip}{part}.rrd" for clip in ("studio_table", "studio_talk") for part in ("", "__bm", "__bm.scene")
    ]
    scores = rescore(directory)
    assert scores.configurations == ("bm",)
    assert any(note.text == "sgbm: left out, failed on studio_table: out of memory" for note in scores.notes)
    assert "out of memory" in (directory.path / "frr.md").read_text()


def test_what_failed_stays_failed_until_it_is_tried_again(
    tmp_path: Path, broken_sgbm: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    _run(tmp_path, ["studio_table"], recorded=True)
    monkeypatch.undo()
    again = _run(tmp_path, ["studio_table"], recorded=True)
    assert [each.configuration for each in again.read_manifest().failed] == ["sgbm"]
    mended = _run(tmp_path, ["studio_table"], recorded=True, retry=True)
    assert mended.read_manifest().failed == []
    assert [record.configuration for record in read_records(mended)] == ["bm"] * 2 + ["sgbm"] * 2
    assert not (mended.path / "partial").exists()
    rescore(mended)
    other = tmp_path / "other"
    other.mkdir()
    assert tables_of(mended) == tables_of(_run(other, ["studio_table"]))


@pytest.mark.parametrize("recorded", [False, True])
def test_after_a_method_failed_a_retry_only_attends(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, recorded: bool
) -> None:
    whole = tmp_path / "whole"
    whole.mkdir()
    expected = _run(whole, ["studio_table"], recorded=recorded)
    attend_frames, methods = Cones.attend_frames, list[Cones]()

    def fails_first(self: Cones, frames: Sequence[tuple[Any, Scene]]) -> Any:
        methods.append(self)
        if self is methods[0] and any(scene.index == 2 for _, scene in frames):
            raise ValueError("not today")
        return attend_frames(self, frames)

    with monkeypatch.context() as patch:
        patch.setattr(Cones, "attend_frames", fails_first)
        (failure,) = _run(tmp_path, ["studio_table"], recorded=recorded).read_manifest().failed
    expected_error = "frame 2: attention: ValueError: not today"
    assert (failure.configuration, failure.error) == ("bm", expected_error)
    kept = [*tmp_path.glob("out/answers/sgbm/*"), *tmp_path.glob("out/*__sgbm.rrd")]
    places = [path.stat().st_ino for path in kept]
    assert len(places) == 1 + recorded
    with monkeypatch.context() as patch:
        patch.setattr(Perception, "__init__", _perceives_nothing)
        mended = _run(tmp_path, ["studio_table"], retry=True, recorded=recorded)
    assert mended.read_manifest().failed == []
    assert [path.stat().st_ino for path in kept] == places
    assert tables_of(mended) == tables_of(expected)
    recordings = sorted(path.name for path in mended.path.glob("*.rrd"))
    assert recordings == sorted(path.name for path in expected.path.glob("*.rrd"))
    assert bool(recordings) == recorded
    for name in recordings:
        assert values_of(mended.path / name) == values_of(expected.path / name), name


def _perceives_nothing(*_: object, **__: object) -> None:
    raise AssertionError("the clip is perceived again")


def test_a_configuration_is_left_out_that_failed_on_one_of_two_clips(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    match = SemiGlobalMatcher.match

    def fails_on_the_second(self: SemiGlobalMatcher, frame: StereoFrame) -> Disparity:
        calls.append(frame.index)
        if len(calls) > 2:
            raise VfoaError("out of memory")
        return match(self, frame)

    calls: list[int] = []
    monkeypatch.setattr(SemiGlobalMatcher, "match", fails_on_the_second)
    directory = _run(tmp_path, ["studio_table", "studio_talk"])
    assert {(each.clip, each.configuration) for each in read_records(directory)} == {
        ("studio_table", "bm"),
        ("studio_talk", "bm"),
        ("studio_table", "sgbm"),
    }
    assert read_scores(directory).configurations == ("bm",)


def test_a_clip_on_which_all_fail_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = sintel_scene(tmp_path / "data", frames=(1, 2, 3))
    write_text(
        tmp_path / "datasets" / "plain.toml",
        f'name = "plain"\nadapter = "sintel"\nroot = "{root.as_posix()}"\n[source]\nscene = "alley"\n',
    )
    monkeypatch.chdir(tmp_path)
    directory = _run(tmp_path, ["plain", "studio_table"])
    scores = read_scores(directory)
    assert (scores.clips, scores.configurations) == (("studio_table",), ("bm", "sgbm"))
    (note,) = (note.text for note in scores.notes if note.text.startswith("plain: left out"))
    assert "every configuration failed: SintelClip, frame 1: the clip has no true instances" in note


def test_of_many_failures_the_first_ten_are_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    directory = RunDirectory(tmp_path)
    failed = [{"clip": f"clip {k}", "configuration": "bm", "error": "out of memory"} for k in range(13)]
    write_manifest(directory, {"failed": failed})
    with pytest.raises(typer.Exit):
        _report_failures(directory)
    *lines, more, again = capsys.readouterr().err.splitlines()
    assert lines == [f"vfoa: clip {k} under bm: out of memory" for k in range(10)]
    assert more == f"vfoa: and 3 more: `failed` in {tmp_path / 'manifest.json'}"
    assert again.startswith("vfoa: 13 failed; ")


def test_the_command_line_says_what_failed_and_leaves_with_1(
    tmp_path: Path, broken_sgbm: None, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write_text(tmp_path / "two.toml", experiment_of(["studio_table"], MATCHERS, STAGES))
    monkeypatch.chdir(tmp_path)
    arguments = ["vfoa", "run", file.name, "--workers", "1", "--recording", "none", "--limit", "2", "--no-cache"]
    monkeypatch.setattr(sys, "argv", arguments)
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr()
    assert ended.value.code == 1
    assert said.err.splitlines() == [
        "vfoa: studio_table under sgbm: out of memory",
        "vfoa: 1 failed; run again with --retry-failed when the cause is fixed",
    ]
    assert "bm" in said.out
