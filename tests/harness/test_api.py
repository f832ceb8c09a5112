from __future__ import annotations

import ast
import re
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import harness
from harness.clips.add import add_clip
from harness.report.csv_tables import COMPARISON_COLUMNS, frr_columns
from harness.report.frames_csv import FRAMES_COLUMNS
from harness.run.directory import RunDirectory
from harness.run.experiment import RecordingKind
from harness.run.table_records import read_records
from harness.run.tables import TABLES
from tests.command import vfoa
from tests.disk import write_text
from tests.measured import EXPERIMENT as TALK
from tests.measured import measured_tables, true_labels
from tests.repository import REPOSITORY
from vfoa.errors import VfoaError
from vfoa.types import Attention

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
        settings={"attention.n_rays": np.int64(10)},
        out=folder / "run",
        limit=6,
        recordings=False,
        cache=False,
    )


def test_an_experiment_runs_with_changed_settings(run: harness.RunResults) -> None:
    assert (run.clips, run.configurations) == (("studio_table",), ("one", "two"))
    assert [each["attention"]["n_rays"] for each in run.manifest["configurations"].values()] == [10, 10]


def test_every_column_of_every_table_is_documented(run: harness.RunResults) -> None:
    assert list(run.frr.columns) == [
        name for name in frr_columns() if name not in ("error_type_no_answer", "error_type_no_object")
    ]
    assert list(run.frames.columns) == list(FRAMES_COLUMNS)
    assert list(run.comparisons.columns) == list(COMPARISON_COLUMNS)
    assert {"answers": run.answers, **run.scenes}.keys() == TABLES.keys() - {"clouds"}
    for name, table in {"answers": run.answers, **run.scenes}.items():
        assert list(table.columns) == list(TABLES[name])
    frames = run.timings.groupby(["clip", "configuration"])["frame"].nunique()
    assert frames.to_dict() == {("studio_table", "one"): 6, ("studio_table", "two"): 6}
    assert (run.timings["ms"] >= 0).all()


def test_the_frames_of_a_run_are_read_back_from_their_tables(run: harness.RunResults) -> None:
    records = list(read_records(run.directory))
    assert list(read_records(run.directory)) == records
    subjects = [subject for record in records for subject in record.subjects]
    assert run.answers["focus"].tolist() == [subject.focus or pd.NA for subject in subjects]
    assert run.answers["focus"].dtype == "Int32"
    assert len(run.scenes["frames"]) == 6  # both configurations share a scene
    assert run.scenes["objects"]["mask_iou"].tolist() == [1.0] * len(run.scenes["instances"])


def _blocks(heading: str) -> list[str]:
    """The code below a heading of the tutorial."""
    text = (REPOSITORY / "docs/tutorials/python.md").read_text(encoding="utf-8")
    (section,) = re.findall(rf"^## {heading}$(.*?)(?=^## |\Z)", text, re.DOTALL | re.MULTILINE)
    return re.findall(r"^```python\n(.*?)^```", section, re.DOTALL | re.MULTILINE)


BLOCKS = _blocks("A table of your own")


@pytest.mark.parametrize("block", BLOCKS, ids=lambda block: re.findall(r"import (\w+)", block)[0])
def test_a_table_of_ones_own_is_made_as_documented(
    block: str, run: harness.RunResults, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip(re.findall(r"import (\w+)", block)[0])
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "demo").symlink_to(run.path)
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {}
    exec(block, names)
    table = names["table"]
    if not isinstance(table, pd.Series):
        table = (table.df() if hasattr(table, "df") else table.to_pandas()).set_index(list(KEYS))["share"]
    frames = run.frames[["clip", "configuration", "frame", "subject", "predicted"]].drop_duplicates()
    shares = frames.groupby(["configuration", "clip", "subject"])["predicted"].value_counts(normalize=True)
    assert {
        (*key[:3], key[3].replace("(nothing hit)", "none")): share for key, share in shares.items()
    } == pytest.approx(dict(table.items()))


KEYS = ("configuration", "clip", "name", "target")


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


@pytest.fixture
def two_people(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An experiment on two labelled clips without images, whose logit is fitted to the other clip's labels."""
    monkeypatch.chdir(tmp_path)
    for name in ("one", "two"):
        add_clip(measured_tables(tmp_path / "data" / name, range(1, 41), 200_000_000), name=name)
        write_text(tmp_path / "annotations" / f"{name}.csv", true_labels(40))
    logit = '[[configuration]]\nname = "logit"\nattention = { method = "logit", weights = "left-out" }\n'
    text = TALK.replace('"talk"', '"one", "two"')
    return write_text(tmp_path / "two.toml", f'recording = "none"\n{text}{logit}')


def test_a_script_gets_every_row_of_the_command(
    two_people: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert vfoa(monkeypatch, capsys, "run", str(two_people), "--out", "command", "--workers", "1")[0] == 0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = harness.run_experiment(two_people, out="script", cache=False)
    assert set(run.frr["configuration"]) == {"cones", "forward", "logit"}
    assert (run.path / "frr.csv").read_bytes() == Path("command/frr.csv").read_bytes()
    assert run.failed.empty
    assert run.recordings == {}


@pytest.mark.parametrize(
    ("asked", "written"), [(None, None), (False, None), (True, "light"), ("light", "light"), ("jpeg", "jpeg")]
)
def test_a_script_chooses_the_kind_of_recordings(
    two_people: Path, asked: bool | RecordingKind | None, written: str | None
) -> None:
    run = harness.run_experiment(two_people, out="run", cache=False, limit=2, recordings=asked)
    assert RunDirectory(run.path).read_manifest().recording == written
    assert bool(run.recordings) == bool(written)


def test_the_command_chooses_the_kind_of_recordings(
    two_people: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--recording", "jpeg", "--limit", "2", "--workers", "1", "--no-cache", "--out", "run")
    assert vfoa(monkeypatch, capsys, "run", str(two_people), *options)[0] == 0
    assert RunDirectory(Path("run")).read_manifest().recording == "jpeg"


def test_what_fails_is_warned_of_by_name(two_people: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*inputs: object) -> Attention:
        raise VfoaError("no room")

    monkeypatch.setattr("vfoa.cones.attend_people", fails)
    with pytest.warns(harness.IncompleteRunWarning) as warned:
        run = harness.run_experiment(two_people, out="run", cache=False)
    (warning,) = (each.message for each in warned if isinstance(each.message, harness.IncompleteRunWarning))
    assert [(each["clip"], each["configuration"]) for each in warning.failures] == [("one", "cones"), ("two", "cones")]
    assert "one under cones: no room" in str(warning)
    assert run.failed["error"].tolist() == ["no room"] * 2
    assert set(run.frr["configuration"]) == {"forward", "logit"}


def test_what_is_not_there_is_one_line(run: harness.RunResults, tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match="run's directory"):
        harness.load_run(tmp_path)
    with pytest.raises(VfoaError, match="run's directory, found a file"):
        harness.load_run(run.path / "frr.csv")
    with pytest.raises(VfoaError, match="recording"):
        run.recording("studio_table", "one")


@pytest.mark.parametrize(
    ("given", "name"),
    [({"limit": 0}, "limit"), ({"limit": -1}, "limit"), ({"limit": "6"}, "limit"), ({"workers": -1}, "workers")],
)
def test_a_number_that_no_run_can_have_is_refused_before_anything_runs(
    given: dict[str, Any], name: str, tmp_path: Path
) -> None:
    with pytest.raises(VfoaError, match=f"run_experiment: {name}: .*{next(iter(given.values()))}"):
        harness.run_experiment("demo", out=tmp_path / "run", **given)
    assert not (tmp_path / "run").exists()


def test_one_clip_and_one_run_are_given_by_their_names(run: harness.RunResults, tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match="no clip 'nowhere'"):
        harness.run_experiment("demo", clips="nowhere", out=tmp_path / "run")
    assert harness.compare_runs(run.path).equals(harness.compare_runs([run.path]))
    with pytest.raises(VfoaError, match=r"compare_runs: .*none"):
        harness.compare_runs([])
    with pytest.raises(VfoaError, match=r"read_rig: .*none"):
        harness.read_rig(size_px=(640, 480))


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


def test_measurements_are_attended_to_as_documented(capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = _blocks("Without images")
    exec(block, {})
    anna, ben = capsys.readouterr().out.splitlines()
    assert anna.startswith("anna looks at cup ")
    assert ben.startswith("ben looks at anna ")


def test_arrays_are_scored_as_documented(capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = _blocks("A score from arrays")
    exec(block, {})
    assert capsys.readouterr().out.strip() == block.rpartition("# ")[2].strip()


def test_other_settings_of_attention_are_tried_as_documented(run: harness.RunResults) -> None:
    (block,) = _blocks("Other settings of attention")
    names: dict[str, Any] = {"run": run}
    exec(block, names)
    wide, nearest = names["wide"], names["nearest"]
    expected = run.answers[run.answers["configuration"] == "two"]["total"].astype(str).tolist()
    assert [wide[wide["configuration"] == name]["total"].astype(str).tolist() for name in ("one", "two")] == [
        expected
    ] * 2
    assert set(nearest["configuration"]) == {"one"}
    assert set(nearest["total"].map(max)) == {1.0}
