"""A clip without images, from `vfoa clips add` to tables and recordings."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader
from typer.testing import CliRunner

from harness.cli.clips import app
from harness.clips.add import add_clip
from harness.clips.check import check_clip
from harness.clips.manifest import load_manifest
from harness.files.io import read_text
from harness.record.composed import find_clips
from harness.report.sinks import composed_sinks
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.notes import NoteKind
from harness.run.plan import describe
from harness.run.runner import prepare, run_plan
from harness.run.table_records import read_records
from tests.disk import labels_text, write_text
from tests.measured import ANNA, BEN, EXPERIMENT, ROBOT, measured_tables, true_labels
from tests.records import tables_of
from tests.repository import REPOSITORY
from vfoa.errors import VfoaError
from vfoa.geometry import angle_between


@pytest.fixture
def talk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with the clip ``talk``, labelled, and an experiment on it."""
    measured_tables(tmp_path / "data" / "talk")
    monkeypatch.chdir(tmp_path)
    found = CliRunner().invoke(app, ["add", str(tmp_path / "data" / "talk"), "--json"], catch_exceptions=False)
    assert json.loads(found.stdout)["subjects"] == ["anna", "ben"]
    write_text(tmp_path / "annotations" / "talk.csv", true_labels())
    write_text(tmp_path / "talk.toml", EXPERIMENT)
    return tmp_path


def _run(folder: Path, experiment: str = "talk.toml", *, workers: int = 1, clips: tuple[str, ...] = ()) -> RunDirectory:
    loaded = load_experiment(experiment, clips=clips)
    plan = prepare(loaded, sinks=composed_sinks(loaded.configurations))
    return run_plan(plan, folder / "run", workers=workers, progress=lambda clip: None)


def test_what_is_added_names_everyone_and_passes_the_check(talk: Path) -> None:
    manifest = load_manifest("talk")
    assert {name: rule.instance for name, rule in manifest.subjects.items()} == {"anna": 1, "ben": 2}
    assert {name: (rule.category, rule.instance) for name, rule in manifest.targets.items()} == {
        "robot": ("robot", 3),
        "cup": ("cup", 4),
    }
    checked = check_clip("talk")
    assert (checked.problems, checked.frames, checked.labels, checked.size_px) == ((), 12, 24, None)


def test_a_run_answers_for_people_the_origin_and_scores_all_of_it(talk: Path) -> None:
    directory = _run(talk)
    scores = rescore(directory)
    found = {(row.configuration, row.n): row.correct for row in scores.rows}
    assert found["cones", 24] == 24
    assert found["forward", 24] >= 22  # a posterior may be a frame late
    record = next(iter(read_records(directory)))
    assert [subject.head_box_px for subject in record.subjects] == [None, None]
    assert {target.name for target in record.targets} == {"anna", "ben", "robot", "cup"}
    assert all((directory.path / name).is_file() for name in ("frr.md", "report.html"))


def test_a_recording_has_the_scene_and_the_curves_and_no_image(talk: Path) -> None:
    directory = _run(talk)
    rescore(directory)
    (clip,) = find_clips(directory.path, "talk", "cones")
    files = clip.compose().files
    paths = {str(path) for file in files for path in RrdReader(file).store().schema().entity_paths()}
    assert "/world/reconstruction/cones/3/box" in paths
    assert "/world/attention/cones/anna/gaze/direction" in paths
    assert any(path.startswith("/attention/cones/anna/") for path in paths)
    assert any(path.startswith("/verdicts/cones/ben") for path in paths)
    assert not [path for path in paths if path.startswith(("/world/camera", "/stereo"))]


def test_any_experiment_runs_and_uses_no_model(talk: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VFOA_MODELS", str(talk / "nothing"))
    directory = _run(talk, "default", clips=("talk",))
    (settings,) = directory.read_manifest().configurations.values()
    assert [settings[stage] for stage in ("stereo", "segmentation", "heads")] == [None] * 3
    assert [settings[stage] for stage in ("head_pose", "gaze")] == [{"model": "measured"}] * 2
    assert len(list(read_records(directory))) == 12


def test_workers_change_nothing(talk: Path) -> None:
    one = tables_of(_run(talk))
    shutil.rmtree(talk / "run")
    assert tables_of(_run(talk, workers=2)) == one


@pytest.mark.parametrize("is_numbered", [True, False])
def test_people_and_objects_have_the_names_of_their_rows_in_any_order(talk: Path, is_numbered: bool) -> None:
    for name in ("people.csv", "objects.csv"):
        header, *rows = (talk / "data" / "talk" / name).read_text().splitlines()
        write_text(talk / "data" / "talk" / name, "\n".join([header, *reversed(rows)]) + "\n")
    path = talk / "datasets" / "talk.toml"
    text = path.read_text() if is_numbered else re.sub(r"(?m)^instance = .*\n", "", path.read_text())
    assert text.count("instance = ") == (4 if is_numbered else 0)
    path.write_text(text)
    record = next(iter(read_records(_run(talk))))
    places = {subject.name: subject.eye_origin_m for subject in record.subjects}
    np.testing.assert_allclose([places["anna"], places["ben"]], [ANNA, BEN], atol=1e-6)
    middles = {target.name: target.box.center_m for target in record.targets if target.box}
    np.testing.assert_allclose([middles["robot"], middles["anna"]], [ROBOT, ANNA], atol=1e-6)


@pytest.mark.parametrize(
    ("scale", "step_ns", "sigma_deg", "said"),
    [
        (1, 40_000_000, "5", []),
        (1000, 40_000_000, "5", ["m away from objects and others"]),
        (0.001, 40_000_000, "5", ["m away from objects and others"]),
        (1, 40_000_000_000, "5", ["40 s apart"]),
        (1, 40_000_000, "0.087", ["radians?"]),
    ],
)
def test_a_run_questions_units_without_a_check(
    talk: Path, scale: float, step_ns: int, sigma_deg: str, said: list[str]
) -> None:
    """People in millimetres are hit by no cone, and of frames 40 s apart each one is a look of its own."""
    people = measured_tables(talk / "data" / "talk", step_ns=step_ns) / "people.csv"
    header, *rows = (line.split(",") for line in people.read_text().splitlines())
    scaled = [
        [*row[:3], *(str(scale * float(cell)) for cell in row[3:6]), *row[6:9], sigma_deg, *row[10:]] for row in rows
    ]
    write_text(people, "\n".join(map(",".join, [header, *scaled])))
    plan = prepare(load_experiment("talk.toml"))
    found = [note.text for note in plan.experiment.notes if note.kind is NoteKind.DOUBT]
    assert len(found) == len(said)
    assert all("talk: " in text and words in text for text, words in zip(found, said, strict=True))
    assert describe(plan).clips[0].notes == []


def test_a_name_that_the_tables_do_not_have_is_found_by_the_check(talk: Path) -> None:
    path = talk / "datasets" / "talk.toml"
    path.write_text(path.read_text().replace("instance = 4", "instance = 3"))
    (problem,) = check_clip("talk").problems
    assert problem.startswith("targets.cup.instance: no cup has the number 3")


@pytest.mark.parametrize(("slot", "model"), [("gaze", "truth"), ("gaze", "simulated"), ("head_pose", "simulated")])
def test_a_true_direction_that_no_table_has_fails_its_configuration(talk: Path, slot: str, model: str) -> None:
    """The measured gaze was left out in its place, and the head answered alone."""
    write_text(talk / "talk.toml", f'{EXPERIMENT}[[configuration]]\nname = "true"\n{slot}.model = "{model}"\n')
    directory = _run(talk)
    (failure,) = directory.read_manifest().failed
    assert failure.configuration == "true"
    assert re.search(rf'{slot}\.model = "{model}": the clip has no true .*; expected "measured"', failure.error)
    assert {row.configuration for row in rescore(directory).rows} == {"cones", "forward"}


def test_a_subject_who_is_not_there_is_nobody_else(talk: Path) -> None:
    """Anna is no subject, and has Ben's eyes all along: his name does not become hers when he leaves."""
    people = talk / "data" / "talk" / "people.csv"
    kept = [line for line in people.read_text().splitlines() if ",ben," not in line or int(line.split(",")[0]) < 7]
    write_text(people, "\n".join(kept))
    path = talk / "datasets" / "talk.toml"
    plain = re.sub(r"(?m)^instance = .*\n", "", path.read_text())
    write_text(
        path, plain.replace('[subjects.anna]\ncategory = "person"\n', "") + '[targets.anna]\ncategory = "person"\n'
    )
    rows = [line for line in true_labels().splitlines() if ",anna," not in line or ",ben,anna" in line]
    write_text(talk / "annotations" / "talk.csv", "\n".join(rows))
    scores = rescore(_run(talk))
    row = next(row for row in scores.rows if row.configuration == "cones")
    assert (row.n, row.correct, row.error_types["no_subject"]) == (12, 6, 6)


@pytest.mark.parametrize(
    ("target", "category", "found"),
    [
        ("left", "cup", {"left", "cup#5", "person#1", "person#3"}),
        ("cup", "cup", {"cup", "person#1", "person#3"}),
        ("anna", "person", {"anna", "person#3", "left#4", "right#5"}),
    ],
)
def test_a_target_that_the_tables_name_is_nothing_else(talk: Path, target: str, category: str, found: set[str]) -> None:
    """Another cup, or person, that is no target had its name; ``cup``, which no row is called, are all cups."""
    people = talk / "data" / "talk" / "people.csv"
    carl = [line.replace("anna,-0.4", "carl,0.9") for line in people.read_text().splitlines() if ",anna," in line]
    write_text(people, "\n".join([*people.read_text().splitlines(), *carl]))
    kind = "" if category == "person" else category
    objects = f"object,frame,x_m,y_m,z_m,category\nleft,,0,0.4,0.9,{kind}\nright,,0.5,0.4,0.9,{kind}\n"
    write_text(talk / "data" / "talk" / "objects.csv", objects)
    path = talk / "datasets" / "talk.toml"
    source = path.read_text().partition("[subjects.")[0]
    named = f'[subjects.ben]\ncategory = "person"\n[targets.{target}]\ncategory = "{category}"\n'
    write_text(path, source + named)
    write_text(talk / "annotations" / "talk.csv", labels_text(f"1,12,ben,{target},"))
    names = {each.name for record in read_records(_run(talk)) for each in record.targets}
    assert names == {"ben", *found}


def test_a_subject_that_may_be_any_of_several_people_is_refused(talk: Path) -> None:
    """Spelt otherwise than in the tables, Anna was the person whom they name first, and Ben whenever she was lost."""
    path = talk / "datasets" / "talk.toml"
    plain = re.sub(r"(?m)^instance = .*\n", "", path.read_text())
    write_text(talk / "annotations" / "talk.csv", true_labels().replace("anna", "Anna"))
    numbered = plain.replace("[subjects.anna]", "[subjects.Anna]\ninstance = 1")
    for text in (plain.replace("subjects.anna", "subjects.Anna"), numbered):
        write_text(path, text)
        assert check_clip("talk").problems == ()  # Ben has his name, so that she is the other one
        prepare(load_experiment("talk.toml"))
    both = plain.replace("subjects.anna", "subjects.Anna").replace("subjects.ben", "subjects.Ben")
    write_text(talk / "annotations" / "talk.csv", true_labels().replace("anna", "Anna").replace("ben", "Ben"))
    write_text(path, both)
    said = "subjects.Anna: no person of this name; expected one of anna, ben"
    assert check_clip("talk").problems[0].startswith(said)
    with pytest.raises(VfoaError, match=rf"talk\.toml: {said}"):
        prepare(load_experiment("talk.toml"))


def test_millimetres_are_found_by_the_check(talk: Path) -> None:
    path = talk / "datasets" / "talk.toml"
    path.write_text(path.read_text().replace("[source]", "[source]\nobjects = {wall = {center_m = [0, 0, 2500]}}"))
    (problem,) = check_clip("talk").problems
    assert "frame 1: wall is 2500 m away" in problem


def test_times_in_another_unit_are_refused_or_noted(talk: Path) -> None:
    folder = talk / "data" / "talk"
    assert check_clip("talk").notes == ()
    measured_tables(folder, step_ns=40_000)  # microseconds that are called time_ns
    (problem,) = check_clip("talk").problems
    assert "found 25000 frames per second" in problem
    measured_tables(folder, step_ns=40_000_000_000)  # milliseconds that are called time_s
    (note,) = check_clip("talk").notes
    assert "40 s apart" in note


def test_the_example_of_the_documents_runs_and_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = read_text(REPOSITORY / "docs" / "sources.md")
    people, objects = re.findall(r"^```csv\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    write_text(tmp_path / "talk" / "people.csv", people)
    write_text(tmp_path / "talk" / "objects.csv", objects)
    added = add_clip(tmp_path / "talk")
    assert (added.subjects, added.targets) == (("anna", "ben"), ("lamp",))
    assert check_clip("talk").problems == ()
    found = {
        (record.frame, subject.name): record.target(subject.focus).name
        for record in read_records(_run(tmp_path, "conversation", clips=("talk",)))
        for subject in record.subjects
        if record.configuration == "nearest" and subject.focus is not None
    }
    assert found == {(1, "anna"): "ben", (2, "anna"): "lamp", (1, "ben"): "anna", (2, "ben"): "anna"}


def test_a_clip_with_images_needs_its_stages(talk: Path) -> None:
    write_text(talk / "mixed.toml", EXPERIMENT.replace("talk", "studio_table"))
    with pytest.raises(VfoaError, match=r'studio_table.*head_pose\.model = "measured"'):
        _run(talk, "mixed.toml")
    is_off = 'preset = "measured"\n[[configuration]]\nname = "off"\nhead_pose.model = "none"\ngaze.model = "none"\n'
    write_text(talk / "off.toml", f'clips = ["studio_table"]\n{is_off}')
    with pytest.raises(VfoaError, match=r'stereo\.matcher: found "none"'):
        _run(talk, "off.toml")


def test_a_measured_direction_is_left_out_where_its_stage_is_off(talk: Path) -> None:
    write_text(
        talk / "cues.toml",
        'clips = ["talk"]\npreset = "measured"\n[grid.gaze]\ngaze = {}\nno_gaze = { model = "none" }\n'
        '[grid.head_pose]\nhead = {}\nno_head = { model = "none" }\n',
    )
    found: dict[str, set[tuple[bool, bool]]] = {}
    for record in read_records(_run(talk, "cues.toml")):
        cues = {(each.gaze is not None, each.head is not None) for each in record.subjects if each.name == "anna"}
        found.setdefault(record.configuration, set()).update(cues)
    assert found == {
        "gaze-head": {(True, True)},
        "gaze-no_head": {(True, False)},
        "no_gaze-head": {(False, True)},
        "no_gaze-no_head": {(False, False)},
    }


def test_a_true_gaze_is_seen_only_through_its_stages(talk: Path) -> None:
    manifest = talk / "datasets" / "talk.toml"
    manifest.write_text(manifest.read_text().replace("[source]", '[source]\ngaze = "truth"'))
    write_text(
        talk / "gaze.toml",
        'clips = ["talk"]\npreset = "measured"\n[[configuration]]\nname = "heads"\n[[configuration]]\nname = "true"\n'
        'gaze.model = "truth"\n[[configuration]]\nname = "wrong"\ngaze = { model = "simulated", error_deg = 20 }\n',
    )
    directory = _run(talk, "gaze.toml")
    found: dict[str, list[object]] = {"heads": [], "true": [], "wrong": []}
    for record in read_records(directory):
        found[record.configuration] += [subject.gaze for subject in record.subjects if subject.name == "anna"]
    clip = load_manifest("talk").open()
    truth = [
        person.gaze_direction for n in range(1, 13) for person in clip.truth(n).people or () if person.name == "anna"
    ]
    assert found["heads"] == [None] * 12
    assert np.allclose(np.array(found["true"]), np.array(truth))
    assert 5 < np.degrees(angle_between(np.array(found["wrong"]), np.array(truth))).mean() < 40
    assert directory.read_manifest().configurations["wrong"]["gaze"]["error_deg"] == 20
