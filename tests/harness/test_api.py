from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pandas as pd
import pytest

import harness
from harness.report.csv_tables import COMPARISON_COLUMNS, FRAMES_COLUMNS, frr_columns
from tests.repository import REPOSITORY
from vfoa.errors import VfoaError

EXPERIMENT = """
clips = ["studio_table"]

[defaults]
stereo = { matcher = "truth" }
segmentation = { model = "truth" }
heads = { detector = "truth" }
head_pose = { model = "simulated" }
gaze = { model = "simulated" }

[grid]
"attention.cones_cm" = { one = [10], two = [10, 25] }
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> harness.RunResults:
    folder = tmp_path_factory.mktemp("api")
    (folder / "cones.toml").write_text(EXPERIMENT, encoding="utf-8")
    return harness.run_experiment(
        folder / "cones.toml",
        settings={"attention.n_rays": 10},
        out=folder / "run",
        limit=6,
        recordings=False,
        cache=False,
    )


def test_an_experiment_runs_with_changed_settings(run: harness.RunResults) -> None:
    assert (run.clips, run.configurations) == (("studio_table",), ("one", "two"))
    assert [each["attention"]["n_rays"] for each in run.manifest["configurations"].values()] == [10, 10]


def test_every_column_of_every_table_is_documented(run: harness.RunResults) -> None:
    assert list(run.frr.columns) == list(frr_columns())
    assert list(run.frames.columns) == list(FRAMES_COLUMNS)
    assert list(run.comparisons.columns) == list(COMPARISON_COLUMNS)


def test_the_tables_agree_with_each_other(run: harness.RunResults) -> None:
    whole = run.frr[run.frr["subject"] == "(all)"].set_index("configuration")
    wrong = run.failures.groupby("configuration").size().reindex(whole.index, fill_value=0)
    pd.testing.assert_series_equal(wrong, whole["wrong"], check_names=False)
    assert ((whole["frr"] >= whole["wilson_low"]) & (whole["frr"] <= whole["wilson_high"])).all()
    focused = run.frames[run.frames["focus"] == 1]
    assert (focused["target"] == focused["predicted"]).all()


def test_a_run_is_loaded_and_scored_again(run: harness.RunResults) -> None:
    loaded = harness.load_run(run.path)
    pd.testing.assert_frame_equal(loaded.frr, run.frr)
    pd.testing.assert_frame_equal(loaded.rescore().frr, run.frr)


def test_runs_are_compared_with_a_baseline(run: harness.RunResults, tmp_path: Path) -> None:
    (tmp_path / "cones.toml").write_text(EXPERIMENT, encoding="utf-8")
    other = harness.run_experiment(tmp_path / "cones.toml", out=tmp_path / "b", limit=6, recordings=False, cache=False)
    compared = harness.compare_runs([other.path], baseline=run.path)
    assert list(compared.columns) == list(COMPARISON_COLUMNS)
    assert (compared["better"] + compared["worse"] <= compared["n"]).all()
    assert len(compared) == 2


def test_what_is_not_there_is_one_line(run: harness.RunResults, tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match="run's directory"):
        harness.load_run(tmp_path)
    with pytest.raises(VfoaError, match="recording"):
        run.recording("studio_table", "one")


def test_a_rig_is_read_from_a_calibration_file(shared_data: Path) -> None:
    rig = harness.read_rig(shared_data / "kitti_pair/calib.txt", size_px=(1242, 375))
    assert (rig.width_px, rig.height_px) == (1242, 375)
    assert 0.5 < rig.baseline_m < 0.6


def test_importing_harness_imports_nothing_heavy() -> None:
    code = "import sys, harness; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"numpy", "pandas", "pydantic", "rerun"} & set(done.stdout.split())


def test_type_checkers_know_every_public_name() -> None:
    stub = ast.parse((REPOSITORY / "harness/__init__.pyi").read_text(encoding="utf-8"))
    assert {a.asname for node in stub.body if isinstance(node, ast.ImportFrom) for a in node.names} == {
        *harness.__all__
    }
