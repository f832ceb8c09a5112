"""Whole runs, on a few rendered frames: what is written, that it is the same however it is run, and what fails how."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.api import load_run
from harness.clips.manifest import load_manifest
from harness.labels.files import write_annotations
from harness.labels.labels import NOWHERE, Label, Labels, timeline_of
from harness.pipeline.cache_store import Store
from harness.report.sinks import composed_sinks
from harness.report.write import refresh, rescore
from harness.run.directory import RunDirectory, out_folder
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.run.table_records import read_records
from harness.score.finished_run import read_scores
from scripts.measure.stage_outputs import write_coco_panoptic
from tests.disk import HEIGHT, WIDTH, labels_text, sintel_scene, write_text
from tests.records import tables_of, write_manifest
from tests.repository import REPOSITORY
from vfoa.errors import VfoaError
from vfoa.types import Instances

TABLES = ("frr.csv", "frr.md", "frr.tex", "measures.csv", "objects.csv", "comparisons.csv")


CONFIGURATIONS = ("bm-one", "bm-two", "bm-nearest", "sgbm-one", "sgbm-two", "sgbm-nearest")
"""Those of the demo."""


def _run(
    out: Path, *, workers: int = 1, recorded: bool = False, jpeg: bool = False, limit: int = 3, **override: str
) -> RunDirectory:
    overrides = tuple(f"{key.replace('__', '.')}={value}" for key, value in override.items())
    experiment = load_experiment("demo", clips=("studio_table", "studio_talk"), overrides=overrides)
    plan = prepare(
        experiment, limit=limit, sinks=composed_sinks(experiment.configurations, recorded=recorded, jpeg=jpeg)
    )
    return run_plan(plan, out, workers=workers, progress=lambda clip: None)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> RunDirectory:
    directory = _run(tmp_path_factory.mktemp("runs") / "one", recorded=True)
    rescore(directory)
    return directory


def test_a_run_holds_every_frame_of_every_configuration(finished: RunDirectory) -> None:
    found = [(record.clip, record.configuration, record.frame) for record in read_records(finished)]
    expected = [
        (clip, configuration, frame)
        for clip in ("studio_table", "studio_talk")
        for configuration in CONFIGURATIONS
        for frame in (1, 2, 3)
    ]
    assert found == expected
    assert not (finished.path / "partial").exists()
    assert all((finished.path / name).is_file() for name in TABLES)


def test_the_manifest_says_what_the_results_depend_on(finished: RunDirectory) -> None:
    manifest = json.loads(finished.manifest.read_text())
    assert [clip["frames"] for clip in manifest["clips"]] == [[1, 2, 3]] * 2
    assert manifest["configurations"]["bm-two"]["attention"]["cones_cm"] == [10.0, 25.0]
    assert manifest["configurations"]["bm-two"]["stereo"]["wls"] is False
    assert {"numpy", "rerun-sdk", "python"} <= manifest["versions"].keys()
    assert all(len(clip["sha256"]) == 64 for clip in manifest["clips"])


def test_recording_and_workers_change_nothing(finished: RunDirectory, tmp_path: Path) -> None:
    other = _run(tmp_path / "other", workers=2)
    rescore(other)
    for name in TABLES:
        assert (other.path / name).read_bytes() == (finished.path / name).read_bytes(), name
    assert tables_of(other) == tables_of(finished)


def test_sharing_stages_changes_nothing(finished: RunDirectory, tmp_path: Path) -> None:
    """A configuration among others gives what it gives alone."""
    alone = load_experiment("demo", clips=("studio_talk",))
    only = [configuration for configuration in alone.configurations if configuration.name == "sgbm-two"]
    plan = prepare(type(alone)(name="alone", clips=alone.clips, configurations=tuple(only)), limit=3)
    directory = run_plan(plan, tmp_path / "alone", workers=1, progress=lambda clip: None)
    among = [
        record
        for record in read_records(finished)
        if (record.clip, record.configuration) == ("studio_talk", "sgbm-two")
    ]
    assert list(read_records(directory)) == among


def test_a_finished_run_is_taken_over_and_another_one_is_refused(finished: RunDirectory) -> None:
    before = finished.timings.stat().st_mtime_ns
    _run(finished.path, recorded=True)
    assert finished.timings.stat().st_mtime_ns == before
    with pytest.raises(VfoaError, match=r"\(different: head_pose\.error_deg"):
        _run(finished.path, recorded=True, head_pose__error_deg="8")
    with pytest.raises(VfoaError, match=r"\(different: recording\)"):
        _run(finished.path, recorded=True, jpeg=True)
    assert finished.timings.stat().st_mtime_ns == before


def test_edited_labels_make_no_other_run_but_other_scores(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder, name in (("datasets", "studio_table.toml"), ("annotations", "studio_table.csv")):
        write_text(tmp_path / folder / name, (REPOSITORY / folder / name).read_text())
    monkeypatch.chdir(tmp_path)
    plan = prepare(load_experiment("demo", clips=("studio_table",)), limit=3)
    first = run_plan(plan, tmp_path / "out", workers=1, progress=lambda clip: None)
    before, results = rescore(first), first.timings.stat().st_mtime_ns
    write_text(tmp_path / "annotations" / "studio_table.csv", labels_text("1,4,anna,none,"))
    plan = prepare(load_experiment("demo", clips=("studio_table",)), limit=3)
    again = run_plan(plan, tmp_path / "out", workers=1, progress=lambda clip: None)
    assert again.timings.stat().st_mtime_ns == results
    assert rescore(again).rows != before.rows


def test_the_working_directory_gets_its_name(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(tmp_path)
    for out in (".", "..", Path()):
        folder = out_folder(out)
        assert folder.with_name("x").parent == folder.parent != folder


def test_beside_another_run_the_next_free_directory_is_taken(finished: RunDirectory) -> None:
    plans = [
        prepare(load_experiment("demo", clips=("studio_talk",), overrides=(change,)), limit=2)
        for change in ("attention.n_rays=8", "attention.n_rays=9", "attention.n_rays=8")
    ]
    taken = [run_plan(plan, finished.path, workers=1, progress=lambda clip: None, next_free=True) for plan in plans]
    assert [directory.path.name for directory in taken] == ["one-2", "one-3", "one-2"]


def test_a_broken_off_run_goes_on_with_what_is_missing(finished: RunDirectory, tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path / "broken")
    unfinished = json.loads(finished.manifest.read_text())
    for later in ("commit", "host", "started", "finished", "failed", "labels_sha256"):
        del unfinished[later]
    write_manifest(directory, {**unfinished, "recording": None})
    for name in ("scenes", "directions", "answers"):
        shutil.copytree(finished.path / name, directory.path / name)
    for pair in [("studio_table", name) for name in CONFIGURATIONS]:
        write_text(directory.partial(pair, "csv"), "")
    done: list[str] = []
    plan = prepare(load_experiment("demo", clips=("studio_table", "studio_talk")), limit=3)
    run_plan(plan, directory.path, workers=1, progress=done.append)
    assert tables_of(directory) == tables_of(finished)
    assert done == ["studio_table"] * 3 + ["studio_talk"] * 3


def test_scoring_again_needs_only_results_and_labels(finished: RunDirectory, tmp_path: Path) -> None:
    copy = RunDirectory(tmp_path / "copy")
    copy.path.mkdir()
    shutil.copy(finished.manifest, copy.manifest)
    for name in ("scenes", "directions", "answers"):
        shutil.copytree(finished.path / name, copy.path / name)
    rescore(copy)
    for name in TABLES:
        assert (copy.path / name).read_bytes() == (finished.path / name).read_bytes(), name


def test_a_run_is_scored_against_the_annotator_that_is_named(finished: RunDirectory, tmp_path: Path) -> None:
    copy, run = RunDirectory(tmp_path / "copy"), json.loads(finished.manifest.read_text())
    for clip in run["clips"]:
        manifest = load_manifest(clip["name"])
        labels, timeline = manifest.labels(None), timeline_of(manifest.open())
        assert labels is not None
        write_annotations(tmp_path / "annotations" / f"{clip['name']}.csv", labels)
        by_time = (replace(row, span_ns=timeline.span_ns(row.first_frame, row.last_frame)) for row in labels.ranges)
        write_annotations(tmp_path / "annotations" / f"{clip['name']}@anna.csv", Labels(by_time))
        nowhere = (replace(row, label=Label(target=NOWHERE)) for row in labels.ranges)
        write_annotations(tmp_path / "annotations" / f"{clip['name']}@ben.csv", Labels(nowhere))
        clip["manifest"] = str(tmp_path / "datasets" / f"{clip['name']}.toml")
        write_text(Path(clip["manifest"]), manifest.path.read_text())
    shutil.copytree(finished.path, copy.path)
    write_manifest(copy, run)
    rescore(copy, "anna")
    assert (copy.path / "frr.csv").read_bytes() == (finished.path / "frr.csv").read_bytes()
    assert "labels of 'anna'" in (copy.path / "frr.md").read_text()
    scores = rescore(copy, "ben")
    assert {verdict.truth for verdict in scores.verdicts} == {NOWHERE}
    assert [*read_scores(copy).rows] == [*scores.rows] == [*refresh(copy).rows]
    loaded = load_run(copy.path)
    of_pair = loaded.frames.drop_duplicates(["clip", "configuration", "subject", "frame"]).groupby("configuration")
    right = {name: int((frames["outcome"] == "correct").sum()) for name, frames in of_pair}
    assert right == {row.configuration: row.correct for row in scores.rows.overall}
    with pytest.raises(VfoaError, match="no annotations by 'bea'"):
        rescore(copy, "bea")
    rescore(copy)
    assert [*read_scores(copy).rows] == [*read_scores(finished).rows]


def test_a_run_for_an_annotator_without_labels_does_not_begin() -> None:
    experiment = replace(load_experiment("demo", clips=("studio_table",)), annotator="nobody")
    with pytest.raises(VfoaError, match=r"\(studio_table@nobody\.csv\)"):
        prepare(experiment)


@pytest.mark.parametrize("workers", [1, 2])
def test_a_frame_that_cannot_be_read_leaves_no_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, workers: int
) -> None:
    root = sintel_scene(tmp_path / "data", frames=range(1, 7))
    cut = root / "training" / "clean_left" / "alley" / "frame_0002.png"
    cut.write_bytes(cut.read_bytes()[:-20])
    nothing = Instances(ids=np.zeros((HEIGHT, WIDTH), np.uint16), instances=())
    write_coco_panoptic(tmp_path / "masks", [(frame, nothing) for frame in range(1, 7)])
    write_text(
        tmp_path / "datasets" / "cut.toml",
        f'name = "cut"\nadapter = "sintel"\nroot = "{root.as_posix()}"\n[source]\nscene = "alley"\n',
    )
    stages = (
        'stereo = { matcher = "bm", min_depth_m = 1.0 }\nheads.detector = "person_mask"\n'
        f'segmentation = {{ model = "coco_panoptic", root = "{(tmp_path / "masks").as_posix()}" }}\n'
        'head_pose.model = "none"\ngaze.model = "none"\n'
    )
    write_text(tmp_path / "mine.toml", f'clips = ["cut"]\n[[configuration]]\nname = "only"\n{stages}')
    monkeypatch.chdir(tmp_path)
    plan = prepare(load_experiment("mine.toml"))
    with pytest.raises(VfoaError, match=r"frame_0002\.png: .*clips check cut --every") as caught:
        run_plan(
            plan, tmp_path / "out", workers=workers, progress=lambda clip: None, cache=Store(tmp_path / "c", 10**9)
        )
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_a_run_that_is_not_finished_is_not_scored(tmp_path: Path) -> None:
    write_manifest(RunDirectory(tmp_path), {"experiment": "mine", "configurations": {"only": {}}})
    with pytest.raises(VfoaError, match="this run is not finished"):
        rescore(RunDirectory(tmp_path))
