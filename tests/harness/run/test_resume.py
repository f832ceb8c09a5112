"""Runs that are killed at any moment, and go on: the same tables as if nothing had happened.

Two kills by default, at seeded moments, the second of a run with two workers; ``VFOA_KILLS=20`` for more.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader

from harness.report.sinks import composed_sinks
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.resume import PartialResults
from harness.run.runner import prepare, run_plan
from tests import graphs
from tests.disk import write_text
from vfoa.errors import VfoaError

KILLS = int(os.environ.get("VFOA_KILLS", "2"))
FRAMES = 12
TABLES = ("results.jsonl", "frr.csv", "frames.csv", "comparisons.csv")

# tracks, filtered gazes, a window over frames, beliefs: all that a stage can carry from frame to frame
EXPERIMENT = """
clips = ["studio_table"]
defaults.stereo.min_depth_m = 0.8
defaults.segmentation.model = "truth"
defaults.heads.detector = "truth"
defaults.head_pose.model = "simulated"

[[configuration]]
name = "filtered"
stereo.matcher = "bm"
segmentation.every = 3
segmentation.delay = 2
gaze.model = "simulated"

[[configuration]]
name = "window"
stereo.matcher = "truth"
gaze = {{ model = "gaze360", weights = "{weights}", stride = 1 }}
attention = {{ method = "bayes", smoothing = "forward" }}
"""


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("resume")
    weights = Path(graphs.seven_levels(folder / "levels.onnx")).as_posix()
    return write_text(folder / "stateful.toml", EXPERIMENT.format(weights=weights))


def _finish(experiment: Path, out: Path) -> RunDirectory:
    loaded = load_experiment(str(experiment))
    plan = prepare(loaded, limit=FRAMES, sinks=composed_sinks(loaded.configurations, "light"))
    directory = run_plan(plan, out, workers=1, progress=lambda clip: None)
    rescore(directory)
    return directory


@pytest.fixture(scope="module")
def unbroken(experiment: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[RunDirectory, float]:
    """A whole run, and the seconds it took."""
    out = tmp_path_factory.mktemp("runs") / "unbroken"
    _finish(experiment, out.with_name("warm"))
    started = time.monotonic()
    return _finish(experiment, out), time.monotonic() - started


def _start(experiment: Path, out: Path, workers: int) -> subprocess.Popen[bytes]:
    how = ["--workers", str(workers), "--limit", str(FRAMES), "--cache", str(out.with_name("cache"))]
    arguments = ["vfoa", "run", str(experiment), "--out", str(out), *how]
    code = f"import sys; sys.argv = {arguments!r}\nfrom harness.cli import main; main()"
    return subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _values_of(recording: Path) -> dict[tuple[str, str, int], object]:
    """Every value of a recording by entity, component and frame."""
    found: dict[tuple[str, str, int], object] = {}
    for chunk in RrdReader(recording).stream():
        batch = chunk.to_record_batch()
        if "frame" in batch.schema.names:
            frames = batch.column("frame").cast("int64").to_pylist()
            for name in (each for each in batch.schema.names if ":" in each):
                rows = zip(frames, batch.column(name).to_pylist(), strict=True)
                found |= {(chunk.entity_path, name, frame): value for frame, value in rows if value is not None}
    return found


@pytest.mark.parametrize("kill", range(KILLS))
def test_a_killed_run_goes_on_to_the_same_tables(
    kill: int, experiment: Path, unbroken: tuple[RunDirectory, float], tmp_path: Path
) -> None:
    whole, seconds = unbroken
    process = _start(experiment, tmp_path / "out", workers=1 + kill % 2)
    while process.poll() is None and not (tmp_path / "out" / "partial").exists():
        time.sleep(0.005)
    time.sleep(float(np.random.default_rng([8, kill]).uniform(0, seconds)))
    process.send_signal(signal.SIGKILL)
    process.wait()
    directory = _finish(experiment, tmp_path / "out")
    for name in TABLES:
        assert (directory.path / name).read_bytes() == (whole.path / name).read_bytes(), name
    recordings = sorted(path.name for path in directory.path.glob("*.rrd"))
    assert recordings == sorted(path.name for path in whole.path.glob("*.rrd"))
    for recording in recordings:
        values = _values_of(directory.path / recording)
        assert values == _values_of(whole.path / recording), recording
        assert {frame for _, _, frame in values} == set(range(1, FRAMES + 1))
    assert list(directory.path.glob("*.partial")) == []
    assert directory.timings.read_text().count(",attention,") == 2 * FRAMES


def test_what_a_kill_cut_off_is_dropped_and_the_rest_is_kept(tmp_path: Path) -> None:
    results, timings = tmp_path / "a.jsonl", tmp_path / "a.csv"
    with PartialResults(results, timings) as part:
        for frame in (1, 2, 3):
            part.write(f"line {frame}\n", {"stereo": frame, "gaze": frame}, f"clip,conf,{frame}")
    kept = timings.read_text()
    results.write_text("line 1\nline 2\nli")
    with PartialResults(results, timings) as part:
        assert not part.goes_on
        part.write("line 1\n", {"stereo": 9.0}, "clip,conf,1")
        part.write("line 2\n", {"stereo": 9.0}, "clip,conf,2")
        assert part.goes_on
        part.write("line 3\n", {"stereo": 3.0, "gaze": 3.0}, "clip,conf,3")
    assert results.read_text() == "line 1\nline 2\nline 3\n"
    assert timings.read_text() == kept


def test_a_frame_survives_its_process_as_soon_as_it_is_done(tmp_path: Path) -> None:
    results, timings = tmp_path / "runs" / "partial" / "a.jsonl", tmp_path / "runs" / "partial" / "a.csv"
    with PartialResults(results, timings) as part:
        for frame in (1, 2):
            part.write(f"line {frame}\n", {"stereo": frame}, f"clip,conf,{frame}")
            assert results.read_text().endswith(f"line {frame}\n")
            assert timings.read_text().endswith(f"clip,conf,{frame},stereo,{frame}.000\n")


def test_a_kept_frame_that_comes_out_differently_is_refused(tmp_path: Path) -> None:
    paths = tmp_path / "a.jsonl", tmp_path / "a.csv"
    with PartialResults(*paths) as part:
        part.write("line 1\n", {}, "clip,conf,1")
    with (
        PartialResults(*paths) as part,
        pytest.raises(VfoaError, match=r"a\.jsonl, line 1: expected what this program"),
    ):
        part.write("another line\n", {}, "clip,conf,1")


def test_a_part_has_one_writer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("harness.run.resume.LOCK_SECONDS", 0.0)
    paths = tmp_path / "a.jsonl", tmp_path / "a.csv"
    with (
        PartialResults(*paths),
        pytest.raises(VfoaError, match="another process is writing it"),
        PartialResults(*paths),
    ):
        pass


def test_a_directory_that_was_killed_at_birth_is_new(tmp_path: Path) -> None:
    write_text(tmp_path / ".manifest.json.abc", '{"exper')
    assert RunDirectory(tmp_path).is_new()
