"""Answers of another system beside those of vfoa: in one run, scored by name."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from rerun.chunk import RrdReader
from typer.testing import CliRunner, Result

import vfoa
from harness.cli import app as program
from harness.clips.manifest import load_manifest
from harness.labels.labels import timeline_of
from harness.pipeline.ground_truth import truth_of
from harness.record.composed import find_clips
from harness.report.sinks import composed_sinks
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.notes import NoteKind
from harness.run.runner import prepare, run_plan
from harness.run.table_records import read_records
from harness.score.calibration import reliabilities
from harness.score.rows import ScoreRow
from harness.score.score import Scores
from harness.sources import Clip, MeasuredClip
from tests.disk import labels_text, write_text
from tests.experiments import BLOCKS, experiment_of
from tests.measured import STEP_NS, idiap_file, measured_tables, true_labels
from vfoa.errors import VfoaError
from vfoa.scoring import NO_HIT

THEIRS = {"attention.method": "answers", "attention.file": "answers/${CLIP}.csv"}


def _experiment(**configurations: dict[str, object]) -> str:
    """An experiment on the clip ``talk`` with these configurations."""
    return experiment_of(["talk"], configurations, preset="measured")


def _nearest(limit_deg: float) -> dict[str, object]:
    return {"attention.method": "nearest", "attention.limit_deg": limit_deg}


def _vfoa(*words: str) -> Result:
    """What a command did, an error of vfoa included."""
    return CliRunner().invoke(program, words)


@pytest.fixture
def talk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with the clip ``talk`` of anna, ben, a robot and a cup; 12 frames are labelled."""
    measured_tables(tmp_path / "data" / "talk")
    monkeypatch.chdir(tmp_path)
    assert _vfoa("clips", "add", str(tmp_path / "data" / "talk")).exit_code == 0
    write_text(tmp_path / "annotations" / "talk.csv", true_labels())
    write_text(tmp_path / "talk.toml", _experiment(cones={}, theirs=THEIRS))
    return tmp_path


def _labels(folder: Path) -> list[tuple[int, str, str]]:
    """Every labelled frame, subject and target."""
    labels = []
    for line in (folder / "annotations" / "talk.csv").read_text(encoding="utf-8").splitlines()[2:]:
        first, last, subject, target, *_ = line.split(",")
        labels += [(frame, subject, target) for frame in range(int(first), int(last) + 1)]
    return labels


def _answer(rows: Iterable[object], header: str = "frame,subject,target") -> None:
    write_text(Path("answers/talk.csv"), "\n".join([header, *map(str, rows)]) + "\n")


def _answer_all(folder: Path, row: str = "{frame},{subject},{target}", header: str = "frame,subject,target") -> None:
    """Answer every label with a row, in which ``before`` is the frame before and ``time_s`` just after the frame's."""
    _answer(
        (
            row.format(frame=frame, subject=subject, target=target, before=frame - 1, time_s=(frame - 1) / 25 + 0.01)
            for frame, subject, target in _labels(folder)
        ),
        header,
    )


def _run(folder: Path) -> tuple[RunDirectory, Scores]:
    loaded = load_experiment("talk.toml")
    plan = prepare(loaded, sinks=composed_sinks(loaded.configurations))
    directory = run_plan(plan, folder / "run", workers=1, progress=lambda clip: None)
    return directory, rescore(directory)


def _row(scores: Scores, configuration: str = "theirs") -> ScoreRow:
    return next(row for row in scores.rows.overall if row.configuration == configuration)


def _counts(scores: Scores) -> list[tuple[str, int, int]]:
    """Each configuration with its scored and its correct frames."""
    return [(row.configuration, row.n, row.correct) for row in scores.rows.overall]


def _errors(row: ScoreRow) -> dict[str, int]:
    return {name: count for name, count in row.error_types.items() if count}


@pytest.mark.parametrize(
    ("begin_s", "frames", "is_noted"),
    [
        (0.04, range(1, 12), True),  # a frame late each; a row of frame 12 is refused
        (0.04, range(11), False),  # from the first frame on
        (0.2, range(5, 8), True),
        (0.0, range(1, 12), False),
    ],
)
def test_times_that_may_be_of_the_clips_own_clock_are_noted(
    talk: Path, begin_s: float, frames: range, is_noted: bool
) -> None:
    people = talk / "data" / "talk" / "people.csv"
    header, *lines = (line.split(",") for line in people.read_text().splitlines())
    for cells in lines:
        cells[1] = str(round(1e9 * begin_s) + (int(cells[0]) - 1) * STEP_NS)
    write_text(people, "\n".join(map(",".join, [header, *lines])))
    _answer((f"{frame * STEP_NS / 1e9:g},anna,ben" for frame in frames), "time_s,subject,target")
    notes = [note for note in prepare(load_experiment("talk.toml")).experiment.notes if "own clock" in note.text]
    assert len(notes) == is_noted
    assert all(note.kind is NoteKind.DOUBT and f"subtract {begin_s:g}." in note.text for note in notes)


def test_right_answers_score_everything_and_the_table_has_both(talk: Path) -> None:
    _answer_all(talk)
    directory, scores = _run(talk)
    assert _counts(scores) == [("cones", 24, 24), ("theirs", 24, 24)]
    assert "theirs" in (directory.path / "frr.md").read_text(encoding="utf-8")
    (clip,) = find_clips(directory.path, "talk", "theirs")
    assert all(path.stat().st_size for path in clip.compose().files)
    assert "error_type_no_answer" in (directory.path / "frr.csv").read_text(encoding="utf-8")


def test_each_kind_of_wrong_answer_has_its_error_type(talk: Path) -> None:
    labels = _labels(talk)
    wrong = dict(zip(labels, ("missing row", "blank", "none", "another"), strict=False))
    assert all(target != "none" for *_, target in wrong)
    rows = []
    for frame, subject, target in labels:
        error = wrong.get((frame, subject, target))
        another = "robot" if target != "robot" else "cup"
        said = {"blank": "", "none": "none", "another": another}.get(error or "", target)
        if error != "missing row":
            rows.append(f"{frame},{subject},{said}")
    _answer(rows)
    row = _row(_run(talk)[1])
    assert (row.n, row.correct, row.predicted) == (24, 20, 22)
    assert _errors(row) == {"no_answer": 2, "missed": 2}


def _lose_ben(talk: Path) -> None:
    """Leave ben to the first frame alone of what was measured."""
    people = talk / "data" / "talk" / "people.csv"
    lines = people.read_text(encoding="utf-8").splitlines()
    write_text(people, "\n".join(line for line in lines if ",ben," not in line or line.startswith("1,")) + "\n")


def test_what_vfoa_did_not_find_counts_all_the_same(talk: Path) -> None:
    """A frame in which the tables of measurements have neither ben nor the cup, and the answers do."""
    _lose_ben(talk)
    _answer_all(talk)
    directory, scores = _run(talk)
    assert _row(scores).correct == 24
    assert _row(scores, "cones").error_types["no_subject"] > 0
    last = [record for record in read_records(directory) if record.configuration == "theirs"][-1]
    assert {subject.name for subject in last.subjects} == {"anna", "ben"}
    assert len({target.instance_id for target in last.targets}) == len(last.targets)


def test_arrays_get_the_scores_of_a_run(talk: Path) -> None:
    """:func:`vfoa.score` of answers and probabilities drawn by chance; of some rows, none or no hit."""
    rng = np.random.default_rng(7)
    names = {"anna": ("ben", "robot", "cup", "none"), "ben": ("anna", "robot", "cup", "none")}
    frames = [(frame, subject) for subject in names for frame in range(1, 13)]
    truth = [str(rng.choice(names[subject])) for _, subject in frames]
    labels = (f"{frame},{frame},{subject},{target}," for (frame, subject), target in zip(frames, truth, strict=True))
    write_text(talk / "annotations" / "talk.csv", labels_text(*labels))
    columns = ("anna", "ben", "robot", "cup", "none")
    chances = np.zeros((len(frames), len(columns)))
    answers: list[str | None] = []
    rows = []
    for place, (frame, subject) in enumerate(frames):
        chosen = [columns.index(name) for name in names[subject]]
        chances[place, chosen] = rng.dirichlet(np.ones(4))
        answers.append({0: None, 1: "no_hit"}.get(place % 5, columns[chances[place].argmax()]))
        if place % 5 == 1:
            rows.append(f"{frame},{subject},no_hit{',' * len(columns)}")
        elif place % 5:
            rows.append(",".join(map(str, (frame, subject, "", *chances[place]))))
    _answer(rows, f"frame,subject,target,{','.join(f'p_{name}' for name in columns)}")
    _, scores = _run(talk)
    row, scored = _row(scores), vfoa.score(truth, answers, dict(zip(columns, chances.T, strict=True)))
    (reliability,) = reliabilities(scores.judged_subjects)
    assert 0 < row.no_hit < row.n
    assert not any(each.confidence for each in scores.verdicts if each.predicted == NO_HIT)
    assert (scored.n, scored.correct, scored.frr) == (row.n, row.correct, row.frr)
    assert scored.coverage == row.coverage
    assert scored.calibration_error == pytest.approx(reliability.calibration_error, abs=1e-12)
    for name, value in row.metrics.items():
        assert getattr(scored, name) == pytest.approx(value, abs=1e-12), name


@pytest.mark.parametrize("has_targets", [True, False])
def test_probabilities_are_judged(talk: Path, has_targets: bool) -> None:
    """A blank target, or none in any row, is the likeliest one."""
    labels = _labels(talk)
    names = ("anna", "ben", "robot", "cup", "none")

    def row(frame: int, subject: str, target: str) -> str:
        chances = [0.7 if name == target else 0.0 if name == subject else 0.1 for name in names]
        return ",".join(map(str, (frame, subject, *[""] * has_targets, *chances)))

    columns = [*["target"] * has_targets, *(f"p_{name}" for name in names)]
    _answer((row(*label) for label in labels), f"frame,subject,{','.join(columns)}")
    _, scores = _run(talk)
    assert _row(scores).correct == 24
    theirs = [outcome for outcome in scores.judged_subjects if outcome.configuration == "theirs"]
    assert {round(float(value), 9) for outcome in theirs for value in outcome.on_truth} == {0.7}


@pytest.mark.parametrize(
    ("settings", "row", "header", "correct"),
    [
        ({}, "{time_s:.3f},{subject},{target}", "time_s,subject,target", 24),
        ({"attention.frame_offset": 1}, "{before},{subject},{target}", "frame,subject,target", 24),
        ({}, "{frame},{subject},cup#4", "frame,subject,target", 0),
        ({}, "{frame};{subject};{target}", "Frame;Subject;TARGET", 24),
        ({}, "left/{frame:05d}.png,{subject},{target}", "frame,subject,target", 24),
        ({"attention.frame_offset": 1}, "{before:05d}.jpg,{subject},{target}", "frame,subject,target", 24),
    ],
    ids=["times", "frames from 0", "an object without a name", "capitals", "images", "images from 0"],
)
def test_frames_and_objects_are_said_otherwise(
    talk: Path, settings: dict[str, object], row: str, header: str, correct: int
) -> None:
    write_text(talk / "talk.toml", _experiment(theirs=THEIRS | settings))
    _answer_all(talk, row, header)
    scored = _row(_run(talk)[1])
    assert (scored.correct, scored.predicted) == (correct, 24)


@pytest.mark.parametrize(
    ("header", "row", "problem"),
    [
        ("frame,subject,target", "99,anna,robot", r"talk\.csv:2: frame 99: .* 1 to 12"),
        ("frame,subject,target", "0,anna,robot", r"talk\.csv:2: frame 0: .*frame_offset = 1"),
        ("frame,subject,target", "1,Anna,robot", r"talk\.csv:2: subject 'Anna': .*'anna'"),
        ("frame,subject,target", "1,anna,Robot", r"talk\.csv:2: target 'Robot': .*'robot'"),
        ("frame,subject,target", "1,anna,lamp", r"talk\.csv:2: target 'lamp': .*robot"),
        ("frame,subject,target", "1,anna,anna", r"talk\.csv:2: 'anna' looks at 'anna'"),
        ("frame,subject,target", "1,anna,robot\n1,anna,cup", r"talk\.csv:3: frame 1, subject 'anna': .*talk\.csv:2"),
        ("frame,subject,target,p_robot,p_none", "1,anna,robot,.7,.7", r"talk\.csv:2: p_robot, p_none: .* 1\.4;"),
        ("frame,subject,target,p_robot,p_none", "1,anna,robot,.2,.2", r"talk\.csv:2: .* 0\.4; expected 1"),
        ("frame,subject,target,p_robot", "1,anna,robot,-.2", r"talk\.csv:2: p_robot: .*found -0\.2"),
        ("frame,subject,target,p_robot", "1,anna,robot,", r"talk\.csv:2: target 'robot': .*probability"),
        ("frame,subject,target,instance_id", "1,anna,robot,1.5", r"talk\.csv:2: instance_id: .*found '1\.5'"),
        ("frame,subject,target,p_lamp", "1,anna,robot,1", r"talk\.csv:1: no column 'p_lamp'"),
        ("frame,person,target", "1,anna,robot", r"talk\.csv:1: no column .*subject"),
        ("subject,target", "anna,robot", r"talk\.csv:1: .*frame and time_s"),
        ("time_s,subject,target", "7.5,anna,robot", r"talk\.csv:2: time_s: found '7\.5'"),
        ("frame,subject,u_px,v_px", "1,anna,30,40", r"talk\.csv:1: u_px, v_px: .*images"),
        ("frame,subject,target,u_px,v_px", "1,anna,robot,3,4", r"talk\.csv:1: found target beside points"),
        ("frame,subject", "1,anna", r"talk\.csv:1: found frame,subject;"),
    ],
)
def test_a_mistake_is_named_before_anything_runs(talk: Path, header: str, row: str, problem: str) -> None:
    _answer([row], header)
    with pytest.raises(VfoaError, match=problem):
        _run(talk)
    assert not (talk / "run" / "answers").exists()


def test_a_missing_table_is_named_with_the_experiment_and_the_configuration(talk: Path) -> None:
    with pytest.raises(VfoaError, match=r"talk\.toml: configuration 'theirs': attention\.file: .*talk\.csv: no such"):
        _run(talk)


STAGES = {**BLOCKS, "head_pose.model": "truth", "gaze.model": "truth"}
POINTS = experiment_of(
    ["studio_talk"],
    {"theirs": {}, "nobody_found": {"tracking.sigma_l": 2}},
    {**STAGES, "attention.method": "answers", "attention.file": "points.csv"},
)


@pytest.fixture
def masks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Clip:
    """A rendered clip; the working directory has an experiment on it with points."""
    monkeypatch.chdir(tmp_path)
    write_text(tmp_path / "talk.toml", POINTS)
    clip = load_manifest("studio_talk").open()
    assert not isinstance(clip, MeasuredClip)
    return clip


def _points(clip: Clip, out: Iterable[str]) -> list[str]:
    """For each label of the first frames a row with a pixel of the mask; what is ``out`` is said to be out."""
    manifest = load_manifest("studio_talk")
    labels = manifest.labels(timeline_of(clip), None)
    assert labels is not None
    rows = []
    for frame, subject, label in labels.labelled(clip.frames[:3]):
        truth = truth_of(clip, frame)
        assert truth.instances is not None
        rule = {**manifest.targets, **manifest.subjects}[label.target]
        of_category = [each for each in truth.instances.instances if each.label == rule.category]
        (instance,) = [each for each in of_category if rule.instance in (None, each.id)]
        v, u = np.argwhere(truth.instances.mask(instance.id))[0]
        rows.append(f"{frame},{subject},,,0" if subject in out else f"{frame},{subject},{u},{v},1")
    return rows


def _run_points(folder: Path, rows: Iterable[str]) -> Scores:
    write_text(folder / "points.csv", "\n".join(["frame,subject,u_px,v_px,in_image", *rows]) + "\n")
    plan = prepare(load_experiment("talk.toml"), limit=3)
    return rescore(run_plan(plan, folder / "run", workers=1, progress=lambda clip: None))


def test_a_point_is_the_object_whose_mask_holds_it(tmp_path: Path, masks: Clip) -> None:
    scores = _run_points(tmp_path, _points(masks, out=()))
    assert _counts(scores) == [("theirs", 6, 6), ("nobody_found", 6, 6)]


def test_a_point_out_of_the_image_is_nothing_and_one_on_no_object_an_error_of_its_own(
    tmp_path: Path, masks: Clip
) -> None:
    rows = _points(masks, out=["ben"])
    first = masks.frames[0]
    truth = truth_of(masks, first)
    assert truth.instances is not None
    wall = next(instance.id for instance in truth.instances.instances if not instance.is_thing)
    v, u = np.argwhere(truth.instances.ids == wall)[0]
    rows[0] = f"{first},anna,{u},{v},1"
    row = _row(_run_points(tmp_path, rows))
    assert _errors(row) == {"no_object": 1, "missed": 3}
    assert row.predicted == 6


def test_a_point_beyond_the_image_fails_its_configuration(tmp_path: Path, masks: Clip) -> None:
    first = masks.frames[0]
    rows = [*_points(masks, out=())[1:], f"{first},anna,5000,3,1"]
    with pytest.raises(VfoaError, match=rf"anna in frame {first} .*u_px = 5000"):
        _run_points(tmp_path, rows)


def test_shares_of_the_image_are_no_pixels(tmp_path: Path, masks: Clip) -> None:
    first, second, *_ = masks.frames
    with pytest.raises(VfoaError, match=r"points\.csv: u_px, v_px: .*0 to 1"):
        _run_points(tmp_path, [f"{first},anna,0.5,0.25,1", f"{second},anna,0.5,0.3,1"])


def test_places_in_a_heatmap_are_no_pixels(tmp_path: Path, masks: Clip) -> None:
    rows = [f"{frame},{subject},{frame % 60},33,1" for frame in masks.frames for subject in ("anna", "ben")]
    with pytest.raises(VfoaError, match=r"points\.csv: u_px, v_px: found at most 59, .* heatmap"):
        _run_points(tmp_path, rows)


def _leave_anna_alone(tables: Path, frame: int) -> None:
    people, objects = tables / "people.csv", tables / "objects.csv"
    people.write_text(re.sub(rf"^{frame},\d+,ben,.*\n", "", people.read_text(), flags=re.MULTILINE))
    header, robot, *cups = objects.read_text().splitlines()
    robots = [f"{number}{robot}" for number in range(1, frame)]
    objects.write_text("\n".join([header, *robots, *(cup for cup in cups if not cup.startswith(f"{frame},"))]) + "\n")


def test_what_is_exported_and_read_again_has_the_same_scores(talk: Path) -> None:
    """A posterior with its probabilities, a rule that can say "nowhere", and cones, which cannot: they hit nothing.

    In the last frame Anna is alone. Another system gives probabilities, but for frames in which it hits nothing.
    """
    _leave_anna_alone(talk / "data" / "talk", frame=12)
    write_text(talk / "annotations" / "talk.csv", true_labels().replace("7,12,ben,robot", "7,12,ben,none"))
    cone = {
        "attention.method": "cones",
        "attention.cones_deg": [30],
        "attention.n_rays": 1,
        "attention.axis_ray": False,
    }
    _answer(
        (f"{at},anna,{'robot,0.7' if at % 2 else 'no_hit,'}" for at in range(1, 12)), "frame,subject,target,p_robot"
    )
    methods = {"forward": {"attention.method": "bayes"}, "near": _nearest(5), "hollow": cone, "theirs": THEIRS}
    write_text(talk / "talk.toml", _experiment(**methods))
    first, scores = _run(talk)
    for name in methods:
        given = ("answers", "export", str(first.path), "--config", name, "--out", name)
        assert _vfoa(*given).stdout == f"{name}/talk.csv\n"
    read = {f"{name}_read": THEIRS | {"attention.file": f"{name}/${{CLIP}}.csv"} for name in methods}
    write_text(talk / "talk.toml", _experiment(**methods, **read))
    plan = prepare(load_experiment("talk.toml"))
    scores = rescore(run_plan(plan, talk / "again", workers=1, progress=lambda clip: None))
    for name in methods:
        own, theirs = (
            [outcome for outcome in scores.judged_subjects if outcome.configuration == each]
            for each in (name, f"{name}_read")
        )
        for a, b in zip(own, theirs, strict=True):
            for column in (
                "frames",
                "correct",
                "predicted",
                "no_hit",
                "says_nowhere",
                "confidence",
                "on_truth",
                "brier",
            ):
                np.testing.assert_array_equal(getattr(a, column), getattr(b, column), err_msg=f"{name} {column}")
        assert _row(scores, name).coverage == _row(scores, f"{name}_read").coverage
    hollow = [outcome for outcome in scores.judged_subjects if outcome.configuration == "hollow_read"]
    assert any((of_subject.no_hit & ~of_subject.nowhere).any() for of_subject in hollow)
    assert any((of_subject.no_hit & of_subject.nowhere & of_subject.correct).any() for of_subject in hollow)
    assert not all(outcome.correct.all() for outcome in scores.judged_subjects)


def test_recordings_say_what_the_tables_say(talk: Path) -> None:
    """Of a rule that can say "nowhere", and of answers by name, some of them missing and one of nobody found."""
    _lose_ben(talk)
    objects = talk / "data" / "talk" / "objects.csv"
    _, placed = (text := objects.read_text(encoding="utf-8")).split(",robot,robot,")
    x = placed.partition(",")[0]
    write_text(objects, text.replace(f",robot,robot,{x},", f",robot,robot,{float(x) + 0.5},"))
    write_text(talk / "talk.toml", _experiment(theirs=THEIRS, near=_nearest(1)))
    _answer(f"{frame},{subject},cup" for frame, subject, _ in _labels(talk)[::2])
    directory, scores = _run(talk)
    told = {(verdict.configuration, verdict.error_type) for verdict in scores.verdicts}
    assert {("theirs", "no_answer"), ("theirs", "missed"), ("near", "no_subject"), ("near", "missed")} <= told
    for name in ("near", "theirs"):
        (clip,) = find_clips(directory.path, "talk", name)
        recorded = _recorded(clip.files.verdicts(name))
        for verdict in (each for each in scores.verdicts if each.configuration == name):
            states = recorded[name, verdict.subject, verdict.frame]
            assert states.get("error_type") == verdict.error_type
            assert states["predicted"] == (verdict.predicted or "no prediction")


def _recorded(layer: Path) -> dict[tuple[str, str, int], dict[str, str]]:
    """What a layer of verdicts says of a configuration's subjects by frame: states, and the error type."""
    found: dict[tuple[str, str, int], dict[str, str]] = {}
    for chunk in RrdReader(layer).stream():
        batch, (*_, configuration, subject, what) = chunk.to_record_batch(), ["", *chunk.entity_path.split("/")]
        values = {"error_type": "TextDocument:text"}.get(what, "StateChange:state")
        if not chunk.is_static and values in batch.schema.names:
            frames, texts = batch.column("frame").to_pylist(), batch.column(values).to_pylist()
            for frame, text in zip(frames, texts, strict=True):
                if text:
                    found.setdefault((configuration, subject, frame), {})[what] = text[0]
    return found


def test_an_export_overwrites_nothing_unasked(talk: Path) -> None:
    _answer_all(talk)
    directory, _ = _run(talk)
    given = ("answers", "export", str(directory.path), "--config", "cones")
    assert _vfoa(*given).exit_code == 0
    written = directory.path / "exported" / "cones" / "talk.csv"
    write_text(written, "mine")
    assert isinstance(_vfoa(*given).exception, VfoaError)
    assert written.read_text() == "mine"
    assert _vfoa(*given, "--replace").exit_code == 0
    assert written.read_text().startswith("frame,subject,target,instance_id\n1,anna,ben,\n")
    assert "--out mine.csv: " in str(_vfoa(*given, "--out", "mine.csv").exception)
    assert not Path("mine.csv").exists()


def test_every_attention_value_is_written_as_one_table(talk: Path) -> None:
    _answer_all(talk)
    directory, scores = _run(talk)
    given = ("answers", "export", str(directory.path), "--format", "frames")
    assert _vfoa(*given).exit_code == 0
    with (directory.path / "exported" / "frames.csv").open(newline="") as file:
        rows = [*csv.DictReader(file)]
    judged = {(row["configuration"], row["frame"], row["subject"]): row["outcome"] for row in rows}
    assert judged == {(v.configuration, str(v.frame), v.subject): v.outcome for v in scores.verdicts}
    for more, says in (((), "exists already"), (("--config", "cones"), "does not go with --format frames")):
        assert says in str(_vfoa(*given, *more).exception)


@pytest.fixture
def tracked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of a clip of Idiap's tracker, labelled: 1 looks at the robot, 2 at nothing. Its answers: both at it."""
    monkeypatch.chdir(tmp_path)
    path = idiap_file(tmp_path / "talk")
    lines = path.read_text(encoding="utf-8").splitlines()
    other = {"1": "Person 2", "2": "Person 1"}
    said = "Robot,0.7,Unfocused,0.25"
    write_text(path, "\n".join(f"{','.join(c[:13])},{said},{other[c[1]]},0.05" for c in (x.split(",") for x in lines)))
    assert _vfoa("clips", "add", str(path), "--name", "talk").exit_code == 0
    write_text(tmp_path / "annotations" / "talk.csv", labels_text("0,5,1,robot,", "0,5,2,none,"))
    write_text(tmp_path / "talk.toml", _experiment(hmm=THEIRS | {"attention.file": "talk/tracker.csv"}))
    return path


def test_the_answers_in_the_file_of_idiaps_tracker(tracked: Path, tmp_path: Path) -> None:
    _, scores = _run(tmp_path)
    of_people = {outcome.subject: outcome for outcome in scores.judged_subjects}
    assert {name: outcome.correct.all() for name, outcome in of_people.items()} == {"1": True, "2": False}
    np.testing.assert_allclose(of_people["1"].on_truth, 0.7)
    np.testing.assert_allclose(of_people["2"].on_truth, 0.25)


@pytest.mark.parametrize(
    ("theirs", "problem"),
    [
        ("Person 9,0.05", r"tracker\.csv:1: no column 'p_9'"),
        ("Robot,0.05", r"tracker\.csv:1: found .*; expected pairs"),
        ("Person 2,much", r"tracker\.csv:1: p_2: .*found 'much'"),
    ],
)
def test_a_wrong_answer_of_idiaps_tracker_is_named(tracked: Path, tmp_path: Path, theirs: str, problem: str) -> None:
    write_text(tracked, tracked.read_text(encoding="utf-8").replace("Person 2,0.05", theirs))
    with pytest.raises(VfoaError, match=problem):
        _run(tmp_path)
