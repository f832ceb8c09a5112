"""Runs that are killed behind a checkpoint: no frame is attended to again, and every byte is the same."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from harness.report.sinks import composed_sinks
from harness.run import loop, resume
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from tests import graphs
from tests.disk import write_text

FRAMES = 9
RECORDED_FRAMES = 12
"""With key frames at 1, 6 and 11."""
KILLS = ((1, 2), (5, 7), (8, 8))
"""After how many frames there is the last checkpoint, and a kill."""

# tracks, filtered gazes, a window over frames, beliefs, frames that wait for later ones: all that is carried along
EXPERIMENT = """
clips = ["studio_table"]
defaults.stereo.matcher = "truth"
defaults.segmentation.model = "truth"
defaults.heads.detector = "truth"
defaults.head_pose.model = "simulated"

[[configuration]]
name = "filtered"
gaze.model = "simulated"
gaze_filter.cues = "both"

[[configuration]]
name = "window"
gaze = {{ model = "gaze360", weights = "{weights}", stride = 1 }}
attention = {{ method = "bayes", smoothing = "forward" }}

[[configuration]]
name = "late"
gaze.model = "simulated"
attention = {{ method = "bayes", smoothing = "both", look_ahead_s = 0.12 }}
"""


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("checkpoint")
    weights = Path(graphs.seven_levels(folder / "levels.onnx")).as_posix()
    return write_text(folder / "stateful.toml", EXPERIMENT.format(weights=weights))


def _run(
    experiment: Path, out: Path, told: list[str] | None = None, recorded: bool = False, **more: Any
) -> RunDirectory:
    loaded = load_experiment(str(experiment))
    limit = RECORDED_FRAMES if recorded else FRAMES
    plan = prepare(loaded, limit=limit, sinks=composed_sinks(loaded.configurations, recorded=recorded))
    tell = told.append if told is not None else lambda line: None
    return run_plan(plan, out, workers=1, progress=more.get("progress", lambda clip: None), tell=tell)


class _Kills:
    """Progress of a run that copies its directory as a kill would leave it: ``(kept, killed)`` -> the copy.

    There are checkpoints after every frame up to ``kept``, and none from there to the kill after ``killed`` frames.
    """

    def __init__(self, out: Path, kills: dict[tuple[int, int], Path]) -> None:
        self._out, self._kills, self._done = out, kills, 0

    def __call__(self, clip: str) -> None:
        self._done += 1
        for (kept, killed), copy in self._kills.items():
            if self._done == kept:
                resume.SECONDS = 1e9
            if self._done == killed:
                shutil.copytree(self._out, copy)
                resume.SECONDS = 0.0


@pytest.fixture(scope="module")
def runs(
    experiment: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[RunDirectory, dict[tuple[int, int], Path]]:
    """A whole run, and what it would have left if it had been killed."""
    folder = tmp_path_factory.mktemp("runs")
    kills = {pair: folder / f"killed {pair}" for pair in KILLS}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(resume, "SECONDS", 0.0)
        return _run(experiment, folder / "whole", progress=_Kills(folder / "whole", kills)), kills


@pytest.fixture(scope="module")
def unbroken(runs: tuple[RunDirectory, dict[tuple[int, int], Path]]) -> RunDirectory:
    return runs[0]


def _files(directory: RunDirectory) -> dict[str, bytes]:
    """All that a run leaves and that does not tell the time."""
    told = {directory.timings, directory.manifest}
    found = (path for path in directory.path.rglob("*") if path.is_file() and path not in told)
    return {path.relative_to(directory.path).as_posix(): path.read_bytes() for path in found}


@pytest.mark.parametrize(("kept", "killed"), KILLS)
def test_a_killed_run_goes_on_from_its_checkpoint(
    kept: int,
    killed: int,
    experiment: Path,
    runs: tuple[RunDirectory, dict[tuple[int, int], Path]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told, attended, unbroken = list[str](), list[int](), runs[0]
    out = shutil.copytree(runs[1][kept, killed], tmp_path / "out")
    real = loop.attend

    def counted(scene: Any, *rest: Any) -> Any:
        attended.append(scene.index)
        return real(scene, *rest)

    monkeypatch.setattr(loop, "attend", counted)
    directory = _run(experiment, out, told)
    assert _files(directory) == _files(unbroken)
    assert directory.timings.read_text().count(",attention,") == 3 * FRAMES
    for name in ("filtered", "window"):
        assert f"studio_table under {name}: continues after frame {kept}" in told
    # two configurations go on behind the checkpoint, the one that looks ahead from the frames that still waited
    again = [frame for frame in attended if frame <= kept]
    assert len(attended) - len(again) == 3 * (FRAMES - kept)
    assert len(again) == len(set(again)) < FRAMES


@pytest.fixture(scope="module")
def killed(runs: tuple[RunDirectory, dict[tuple[int, int], Path]]) -> Path:
    return runs[1][KILLS[1]]


@pytest.mark.parametrize(
    ("damage", "expected"),
    [
        (lambda head, body: head.replace(b" 1 ", b" 0 ") + body, "expected format 1"),
        (lambda head, body: head + body[:-1] + bytes([body[-1] ^ 1]), "expected format 1 with a right checksum"),
    ],
    ids=["version", "content"],
)
def test_a_checkpoint_that_cannot_be_read_is_left_out(
    damage: Any, expected: str, experiment: Path, unbroken: RunDirectory, killed: Path, tmp_path: Path
) -> None:
    told: list[str] = []
    shutil.copytree(killed, tmp_path / "out")
    path = RunDirectory(tmp_path / "out").checkpoint(("studio_table", "filtered"))
    head, _, body = path.read_bytes().partition(b"\n")
    path.write_bytes(damage(head + b"\n", body))
    directory = _run(experiment, tmp_path / "out", told)
    assert _files(directory) == _files(unbroken)
    (line,) = [line for line in told if "does not fit" in line]
    assert line.startswith(f"studio_table under filtered: its checkpoint does not fit ({expected}")


def test_a_checkpoint_whose_results_were_changed_is_left_out(
    experiment: Path, unbroken: RunDirectory, killed: Path, tmp_path: Path
) -> None:
    told: list[str] = []
    shutil.copytree(killed, tmp_path / "out")
    results = RunDirectory(tmp_path / "out").partial(("studio_table", "filtered"), "jsonl.partial")
    results.write_bytes(b"".join(results.read_bytes().splitlines(keepends=True)[:3]))
    directory = _run(experiment, tmp_path / "out", told)
    assert _files(directory) == _files(unbroken)
    assert any("filtered.jsonl.partial has changed since it was written" in line for line in told)


def _logged(recording: Path) -> set[tuple[str, int, str]]:
    """The rows of a recording that have data: entity, frame and component."""
    found = set()
    for chunk in RrdReader(recording).stream():
        batch = chunk.to_record_batch()
        if "frame" not in batch.schema.names:
            continue
        frames = batch.column("frame").cast("int64").to_pylist()
        for name in batch.schema.names:
            if ":" in name:
                rows = batch.column(name).is_valid().to_pylist()
                kept = [frame for frame, row in zip(frames, rows, strict=True) if row]
                found |= {(chunk.entity_path, frame, name) for frame in kept}
    return found


def test_a_recording_goes_on_behind_a_key_frame(
    experiment: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("harness.record.images.KEY_FRAME_S", 0.2)  # five frames
    monkeypatch.setattr(resume, "SECONDS", 0.0)
    told, whole, once = list[str](), tmp_path / "whole", tmp_path / "once"  # killed twice: three partial files are one
    progress = _Kills(whole, {(5, 7): once})
    whole = _run(experiment, whole, recorded=True, progress=progress)
    progress = _Kills(once, {(10, 11): tmp_path / "out"})
    _run(experiment, once, recorded=True, progress=progress)
    assert len(list((tmp_path / "out").glob("studio_table.rrd.partial*"))) == 2
    directory = _run(experiment, tmp_path / "out", told, recorded=True)
    assert "studio_table under filtered: continues after frame 10" in told
    assert directory.results.read_bytes() == whole.results.read_bytes()
    names = sorted(path.name for path in whole.path.glob("*.rrd*"))
    assert sorted(path.name for path in directory.path.glob("*.rrd*")) == names
    for name in names:
        found, expected = _logged(directory.path / name), _logged(whole.path / name)
        assert expected <= found, name
        assert {component.partition(":")[0] for _, _, component in found - expected} <= {"Pinhole"}  # logged once more


def test_an_array_keeps_the_order_of_its_axes(tmp_path: Path) -> None:
    values = np.random.default_rng(0).normal(size=(3, 4, 5))
    for array in (values, values.T, values.transpose(1, 0, 2), values[:, 1], values[::2], np.float64(0.1)):
        back = resume._codec.decode(resume._codec.encode(array))
        assert back.dtype == array.dtype
        assert np.array_equal(back, array)
        assert np.argsort(back.strides).tolist() == np.argsort(array.strides).tolist()
