"""Runs that are killed at any moment, and go on: the same tables as if nothing had happened.

Two kills by default, at seeded moments, the second of a run with two workers; ``VFOA_KILLS=20`` for more.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, cast

import numpy as np
import pyarrow.parquet as pq
import pytest

from harness.report.sinks import composed_sinks
from harness.report.write import rescore
from harness.run.answers import AnswerWriter
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.frame_sink import FinishedFrame
from harness.run.runner import prepare, run_plan
from harness.run.timings import read_timings
from tests import graphs
from tests.disk import write_text
from tests.experiments import TRUTH, experiment_of
from tests.recorded import values_of
from tests.records import frame_record, subject_record, target_record
from vfoa.errors import VfoaError

KILLS = int(os.environ.get("VFOA_KILLS", "2"))
FRAMES = 7
TABLES = ("frr.csv", "comparisons.csv")

# tracks, filtered gazes, a window over frames, beliefs: all that a stage can carry from frame to frame
FILTERED = {"stereo.matcher": "bm", "stereo.wls": False, "segmentation.every": 3}
WINDOW = {"gaze.model": "gaze360", "gaze.stride": 1, "attention.method": "bayes", "attention.smoothing": "forward"}


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("resume")
    weights = Path(graphs.seven_levels(folder / "levels.onnx")).as_posix()
    configurations = {"filtered": FILTERED, "window": {**WINDOW, "gaze.weights": weights}}
    text = experiment_of(["studio_table"], configurations, {**TRUTH, "stereo.min_depth_m": 0.8})
    return write_text(folder / "stateful.toml", text)


def _finish(experiment: Path, out: Path) -> RunDirectory:
    loaded = load_experiment(str(experiment))
    plan = prepare(loaded, limit=FRAMES, sinks=composed_sinks(loaded.configurations))
    directory = run_plan(plan, out, workers=1, progress=lambda clip: None)
    rescore(directory)
    return directory


@pytest.fixture(scope="module")
def unbroken(experiment: Path, tmp_path_factory: pytest.TempPathFactory) -> RunDirectory:
    """A whole run."""
    return _finish(experiment, tmp_path_factory.mktemp("runs") / "unbroken")


def _start(experiment: Path, out: Path, workers: int) -> subprocess.Popen[bytes]:
    how = ["--workers", str(workers), "--limit", str(FRAMES), "--cache", str(out.with_name("cache"))]
    arguments = ["vfoa", "run", str(experiment), "--out", str(out), *how]
    code = f"import sys; sys.argv = {arguments!r}\nfrom harness.cli import main; main()"
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _lines(partial: Path) -> int:
    with suppress(OSError):  # a part that is complete gets another name
        return sum(path.read_bytes().count(b"\n") for path in partial.glob("*.csv*"))
    return 0


@pytest.mark.parametrize("kill", range(KILLS))
def test_a_killed_run_goes_on_to_the_same_tables(
    kill: int, experiment: Path, unbroken: RunDirectory, tmp_path: Path
) -> None:
    whole, chance = unbroken, np.random.default_rng([8, kill])
    written = int(chance.integers(0, 2 * FRAMES - 4))
    process = _start(experiment, tmp_path / "out", workers=1 + kill % 2)
    partial = tmp_path / "out" / "partial"
    while process.poll() is None and not (partial.exists() and _lines(partial) >= written):
        time.sleep(0.005)
    time.sleep(float(chance.uniform(0, 0.1)))
    process.send_signal(signal.SIGKILL)
    process.wait()
    directory = _finish(experiment, tmp_path / "out")
    frames = [path.relative_to(whole.path).as_posix() for path in whole.path.glob("*/**/*.parquet")]
    assert len(frames) == 16
    for name in (*TABLES, *frames):
        assert (directory.path / name).read_bytes() == (whole.path / name).read_bytes(), name
    recordings = sorted(path.name for path in directory.path.glob("*.rrd"))
    assert recordings == sorted(path.name for path in whole.path.glob("*.rrd"))
    for recording in recordings:
        values = values_of(directory.path / recording)
        assert values == values_of(whole.path / recording), recording
        assert {frame for _, _, frame in values} == {None, *range(1, FRAMES + 1)}
    assert list(directory.path.glob("*.partial")) == []
    assert read_timings(directory).column("stage").to_pylist().count("attention") == 2 * FRAMES


PAIR = ("clip", "conf")


def _frame(number: int, **seconds: float) -> FinishedFrame:
    things = [target_record(1, "cup")], [subject_record("girl", totals={1: 0.5}, focus=1)]
    record = frame_record(*things, frame=number, clip=PAIR[0], configuration=PAIR[1])
    return FinishedFrame(camera=None, result=cast("Any", None), record=record, timings=seconds)


def test_times_are_on_disk_as_soon_as_a_frame_is_done_and_all_is_written_anew_after_a_kill(tmp_path: Path) -> None:
    directory, keys = RunDirectory(tmp_path), {"scene": "a", "directions": "b"}
    times = directory.partial(PAIR, "csv.partial")
    with suppress(KeyboardInterrupt), AnswerWriter(directory, PAIR, keys) as answers:
        for number in (1, 2, 3):
            answers.write(_frame(number, stereo=number, gaze=number))
            assert times.read_text().endswith(
                f"clip,conf,{number},stereo,{number}000.000\nclip,conf,{number},gaze,{number}000.000\n"
            )
        raise KeyboardInterrupt
    with AnswerWriter(directory, PAIR, keys) as answers:
        for number in (1, 2):
            answers.write(_frame(number, stereo=9.0))
    assert not directory.is_finished(PAIR)
    answers.finish()
    assert directory.is_finished(PAIR)
    table = pq.read_table(directory.answers(PAIR)).select(["clip", "scene", "directions", "configuration", "frame"])
    assert table.to_pylist() == [
        {"clip": "clip", "scene": "a", "directions": "b", "configuration": "conf", "frame": number} for number in (1, 2)
    ]
    assert directory.partial(PAIR, "csv").read_text() == "clip,conf,1,stereo,9000.000\nclip,conf,2,stereo,9000.000\n"
    directory.unmark(PAIR)
    assert not directory.is_finished(PAIR)
    assert not directory.answers(PAIR).exists()


def test_a_part_has_one_writer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("harness.run.answers.LOCK_SECONDS", 0.0)
    directory = RunDirectory(tmp_path)
    with (
        AnswerWriter(directory, PAIR, {}),
        pytest.raises(VfoaError, match="another process is writing it"),
        AnswerWriter(directory, PAIR, {}),
    ):
        pass


def test_a_directory_that_was_killed_at_birth_is_new(tmp_path: Path) -> None:
    write_text(tmp_path / ".manifest.json.abc", '{"exper')
    assert RunDirectory(tmp_path).is_new()
