"""Runs with a cache: the same results as without one, and nothing computed twice."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from harness.pipeline.cache_store import Store, open_store
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.run.timings import read_timings
from tests import graphs
from tests.command import vfoa
from tests.disk import write_text
from tests.experiments import BLOCKS, experiment_of
from tests.records import tables_of

FRAMES = 3
STAGES = {**BLOCKS, "heads.detector": "person_mask", "head_pose.model": "none"}


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cached")
    temporal = Path(graphs.seven_levels(folder / "levels.onnx")).as_posix()
    angles = {"horizontal": np.zeros((1, 90)), "vertical": np.zeros((1, 90))}
    single = Path(graphs.constant(folder / "l2cs.onnx", {"face": (1, 3, 448, 448)}, angles)).as_posix()
    configurations = {
        "temporal": {"gaze.model": "gaze360", "gaze.weights": temporal, "gaze.stride": 1},
        "single": {"gaze.model": "l2cs", "gaze.weights": single},
    }
    return write_text(folder / "cached.toml", experiment_of(["studio_table"], configurations, STAGES))


@pytest.fixture(scope="module")
def plain(experiment: Path, tmp_path_factory: pytest.TempPathFactory) -> RunDirectory:
    return _run(experiment, tmp_path_factory.mktemp("runs") / "plain", None)


def _run(experiment: Path, out: Path, store: Store | None, *overrides: str, limit: int = FRAMES) -> RunDirectory:
    """A run that finds outputs of stages alone: scenes of an earlier run are removed from the cache."""
    if store:
        shutil.rmtree(store.stages / "scene", ignore_errors=True)
    plan = prepare(load_experiment(str(experiment), overrides=overrides), limit=limit)
    return run_plan(plan, out, workers=1, progress=lambda clip: None, cache=store)


def _uses(directory: RunDirectory) -> dict[str, tuple[int, int, str | None]]:
    rows = directory.read_manifest().cache
    return {f"{row['slot']} {row['stage']}": (row["reused"], row["computed"], row["why"]) for row in rows}


def test_a_cache_changes_nothing_and_saves_everything(experiment: Path, plain: RunDirectory, tmp_path: Path) -> None:
    store = Store(tmp_path / "cache", 10**9)
    first, second = (_run(experiment, tmp_path / name, store) for name in ("first", "second"))
    assert tables_of(first) == tables_of(second) == tables_of(plain)
    stages = ("stereo bm", "heads person_mask", "gaze gaze360", "gaze l2cs")
    assert _uses(first) == dict.fromkeys(stages, (0, FRAMES, "first time"))
    assert _uses(second) == dict.fromkeys(stages, (FRAMES, 0, None))
    # what a stage cost when it was computed is what it costs
    stereo, again = (
        [row for row in read_timings(run).to_pylist() if row["stage"] == "stereo"] for run in (first, second)
    )
    assert len(stereo) == 2 * FRAMES
    assert stereo == again


def test_a_changed_setting_computes_its_stage_again_and_no_other(experiment: Path, tmp_path: Path) -> None:
    store = Store(tmp_path / "cache", 10**9)
    _run(experiment, tmp_path / "first", store)
    changed = _uses(_run(experiment, tmp_path / "second", store, "stereo.block_size_px=9"))
    assert changed.pop("stereo bm") == (0, FRAMES, "settings.block_size_px changed")
    assert set(changed.values()) == {(FRAMES, 0, None)}


def test_frames_that_no_earlier_run_had_are_not_called_missing(experiment: Path, tmp_path: Path) -> None:
    store = Store(tmp_path / "cache", 10**9)
    _run(experiment, tmp_path / "first", store, limit=1)
    assert _uses(_run(experiment, tmp_path / "second", store))["stereo bm"] == (1, FRAMES - 1, "not in the cache")


def test_a_damaged_result_is_named_and_made_again(
    experiment: Path, plain: RunDirectory, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    store = Store(tmp_path / "cache", 10**9)
    _run(experiment, tmp_path / "first", store)
    victim = sorted(store.stages.glob("stereo/*/*.bin"))[2]
    victim.write_bytes(victim.read_bytes()[:-7])
    second = _run(experiment, tmp_path / "second", store)
    assert f"{victim}: damaged; its result is computed again" in caplog.text
    assert _uses(second)["stereo bm"] == (FRAMES - 1, 1, "not in the cache")
    assert tables_of(second) == tables_of(plain)
    assert _uses(_run(experiment, tmp_path / "third", store))["stereo bm"] == (FRAMES, 0, None)


def test_a_cache_that_cannot_be_written_costs_no_run(
    experiment: Path, plain: RunDirectory, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    nowhere = tmp_path / "file"
    nowhere.write_text("")
    directory = _run(experiment, tmp_path / "run", Store(nowhere, 10**9))
    assert tables_of(directory) == tables_of(plain)
    assert "are not stored" in caplog.text


def test_beyond_the_limit_results_are_removed_and_computed_again(experiment: Path, tmp_path: Path) -> None:
    store = Store(tmp_path / "cache", 1)
    _run(experiment, tmp_path / "first", store)
    assert list(store.stages.rglob("*.bin")) == []
    assert _uses(_run(experiment, tmp_path / "second", store))["stereo bm"] == (0, FRAMES, "not in the cache")


def test_the_command_line_says_what_was_reused_and_shows_and_clears_the_cache(
    experiment: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def says(*words: str) -> str:
        code, said, _ = vfoa(monkeypatch, capsys, *words)
        assert not code
        return said

    options = ("--cache", str(tmp_path / "cache"))
    run = ("run", str(experiment), *options, "--limit", "2", "--recording", "none", "--workers", "1", "--out")
    assert "Cache: stereo bm: 0 reused, 2 computed (first time)\n" in says(*run, str(tmp_path / "first"))
    assert "Cache: scene tables: 2 reused, 0 computed\n" in says(*run, str(tmp_path / "second"))
    assert "second: finished already; nothing was computed\n" in says(*run, str(tmp_path / "second"))
    usage = open_store(str(tmp_path / "cache")).usage()
    stored = sum(path.stat().st_size for path in (tmp_path / "cache").rglob("*.bin"))
    assert sum(entry.bytes for entry in usage) == stored
    assert {(entry.slot, entry.files) for entry in usage} == {
        *(("stereo", 2), ("heads", 2), ("gaze", 2)),
        *(("scene", 1), ("directions", 2), ("pictures", 1)),
    }
    info = says("cache", "info", *options)
    assert "stereo bm" in info
    assert f": {stored / 1e6:.1f} MB of at most" in info
    assert "removed 0." in says("cache", "clear", *options)
    assert ": 0.0 MB of at most" in says("cache", "info", *options)


def test_matches_in_a_region_are_kept_by_that_region(experiment: Path, tmp_path: Path) -> None:
    store, region = Store(tmp_path / "cache", 10**9), "stereo.region=needed"
    plain = _run(experiment, tmp_path / "plain", None, region)
    first, second = (_run(experiment, tmp_path / name, store, region) for name in ("first", "second"))
    assert tables_of(first) == tables_of(second) == tables_of(plain)
    assert _uses(first)["stereo bm"] == (0, FRAMES, "first time")
    assert _uses(second)["stereo bm"] == (FRAMES, 0, None)
