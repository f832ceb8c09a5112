"""`vfoa fit` from a run to the file that another run takes as a preset, and weights of left-out clips."""

from __future__ import annotations

import contextlib
import math
import re
import shlex
import shutil
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest

import harness
from harness.cli.fit import fit
from harness.cli.run import experiment_of
from harness.clips.add import add_clip
from harness.pipeline.cache_store import Store
from harness.report.experiment_run import run_plainly, run_whole
from harness.run.directory import RunDirectory
from harness.run.executors import Progress
from harness.run.experiment import load_experiment
from harness.run.fitted import FitRecord, fitted_text, notes_on_fits, read_fitted
from harness.run.notes import NoteKind
from harness.run.plan import Fit, describe
from harness.run.runner import executor, prepare, run_plan
from harness.run.table_scenes import SceneFrame
from harness.score.finished_run import read_scores
from harness.score.fit_logit import fit_logit, folds_of
from harness.score.labelled_run import (
    FoundFeatures,
    LabelledPair,
    LabelledPerson,
    LabelTruth,
    PairCase,
    features_of,
    labelled_people,
    read_labelled,
)
from tests.command import vfoa
from tests.disk import labels_text, write_text
from tests.measured import EXPERIMENT, measured_tables, true_labels
from tests.records import tables_of, write_manifest
from tests.repository import REPOSITORY
from vfoa import __version__
from vfoa.errors import VfoaError
from vfoa.geometry import unit
from vfoa.logit import LogitSettings, LogitWeights, default_weights
from vfoa.logit_cues import LOGIT_CUES, Case
from vfoa.methods import MethodSettings
from vfoa.pipeline import AttendSettings
from vfoa.tracking import Tracked
from vfoa.types import Box3D, Cues, Gaze, HeadPose, Instance, Map, Person, Scene, Target

STEP_NS = 200_000_000
"""Time between frames: long clips of few frames."""
TWO_CLIPS = EXPERIMENT.replace('"talk"', '"one", "two"').replace('"bayes"', '"logit"')


def labelled_clips(folder: Path, names: tuple[str, ...], frames: int, step_ns: int = STEP_NS) -> None:
    for name in names:
        add_clip(measured_tables(folder / "data" / name, range(1, frames + 1), step_ns), name=name)
        write_text(folder / "annotations" / f"{name}.csv", true_labels(frames))
    clips = ", ".join(f'"{name}"' for name in names)
    write_text(folder / "talk.toml", TWO_CLIPS.replace('"one", "two"', clips))


@pytest.fixture(scope="module", autouse=True)
def _one_process() -> Iterator[None]:
    """Clips of some seconds are no work for a process on each core."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("harness.run.executors.cores", lambda: 1)
        yield


@pytest.fixture(scope="module")
def fitted_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two clips in which heads and gaze point exactly where people look, and weights fitted on them."""
    folder = tmp_path_factory.mktemp("fitted")
    with contextlib.chdir(folder):
        labelled_clips(folder, ("one", "two"), 30)
        fit("talk.toml", Path("fitted.toml"))
    return folder


@pytest.fixture
def fitted(fitted_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The file of weights, in a copy of the folder of its own."""
    shutil.copytree(fitted_folder, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return Path("fitted.toml")


def test_a_fit_says_what_it_rests_on_and_what_it_is_worth(fitted: Path) -> None:
    found = read_fitted(fitted)
    assert (found.fit.experiment, found.fit.configuration, found.fit.clips) == ("talk", "forward", ("one", "two"))
    scores = {each.method: each for each in found.fit.held_out}
    assert {"commonest", "nearest within a limit", "two cones", "cones", "fitted, both"} <= set(scores)
    assert [name for name in scores if name.startswith("default weights")] == ["default weights, forward"]
    assert scores["fitted, forward"].n == scores["commonest"].n == 120
    assert scores["nearest within a limit"].frr == 1
    assert scores["nearest within a limit"].log_loss is None
    assert scores["fitted, forward"].log_loss < scores["default weights, forward"].log_loss


def test_any_object_of_the_name_that_a_label_has_is_right(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in the scores of a run: there are two robots beside each other, and people look at the second one."""
    monkeypatch.chdir(tmp_path)
    labelled_clips(tmp_path, ("one", "two"), 30)
    for name in ("one", "two"):
        objects, manifest = tmp_path / "data" / name / "objects.csv", tmp_path / "datasets" / f"{name}.toml"
        header, *rows = objects.read_text(encoding="utf-8").splitlines()
        write_text(objects, "\n".join([header, ",other,robot,-0.2,0,0,0.3,0.3,0.3", *rows]) + "\n")
        numbered = manifest.read_text(encoding="utf-8")
        write_text(manifest, re.sub(r'(category = "(?:robot|cup)"\n)instance = \d+\n', r"\1", numbered))
    found = fit_logit(read_labelled(_plain_run(tmp_path)))
    scores = {each.method: each for each in found.fit.held_out}
    assert scores["two cones"].frr == 1
    assert scores["default weights, forward"].frr == scores["forward"].frr
    for value in ("log_loss", "calibration_error"):
        expected = getattr(scores["forward"], value)
        assert getattr(scores["default weights, forward"], value) == pytest.approx(expected, abs=1e-3)
    assert scores["fitted, forward"].log_loss < scores["default weights, forward"].log_loss


def test_the_commonest_answer_is_the_label_that_the_others_have_most(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is neither the first object nor nowhere, which has fewer labels than the cup alone, and more than a fifth."""
    monkeypatch.chdir(tmp_path)
    labelled_clips(tmp_path, ("one", "two"), 30)
    rows = [
        f"{first},{last},{subject},{target},"
        for subject in ("anna", "ben")
        for first, last, target in ((1, 15, "cup"), (16, 25, "none"), (26, 30, "robot"))
    ]
    for name in ("one", "two"):
        write_text(tmp_path / "annotations" / f"{name}.csv", labels_text(*rows))
    found = fit_logit(read_labelled(_plain_run(tmp_path))).fit.held_out
    (commonest,) = (each for each in found if each.method == "commonest")
    assert (commonest.n, commonest.frr, commonest.recall_on_targets) == (120, 0.5, 0.75)
    nowhere, of_targets = 21 / 62, 31 + 11 + 1  # of the 60 frames of the other clip; each sees three targets
    chances = {"cup": (1 - nowhere) * 31 / of_targets, "none": nowhere, "robot": (1 - nowhere) * 11 / of_targets}
    frames = {"cup": 15, "none": 10, "robot": 5}
    expected = -sum(count * math.log(chances[name]) for name, count in frames.items()) / 30
    assert commonest.log_loss == pytest.approx(expected, abs=1e-3)
    assert commonest.calibration_error == pytest.approx(abs(0.5 - chances["cup"]), abs=1e-3)


def test_a_system_that_leaves_frames_out_has_the_log_loss_that_it_has_in_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    labelled_clips(tmp_path, ("one", "two"), 30)
    with Path("talk.toml").open("a", encoding="utf-8") as file:
        file.write('[[configuration]]\nname = "theirs"\nattention.method = "answers"\nattention.file = "theirs.csv"\n')
    answers = (f"{frame},{name},robot,0.6" for frame in range(1, 31) if frame % 5 for name in ("anna", "ben"))
    write_text(Path("theirs.csv"), "\n".join(["frame,subject,target,p_robot", *answers, ""]))
    directory = _plain_run(tmp_path)
    (expected,) = (row for row in read_scores(directory).rows.overall if row.configuration == "theirs")
    (found,) = (each for each in fit_logit(read_labelled(directory)).fit.held_out if each.method == "theirs")
    assert (found.n, found.frr) == (expected.n, pytest.approx(expected.frr, abs=1e-4))
    assert found.log_loss == pytest.approx(expected.metrics["log_loss"], abs=1e-4)
    assert found.calibration_error == pytest.approx(0.1, abs=1e-4)  # robot in half of the frames


def test_a_file_that_could_be_no_preset_is_refused_before_anything_is_run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = vfoa(monkeypatch, capsys, "fit", "demo", "--out", "weights")
    assert (code, err.count("\n")) == (2, 1)
    assert "--out: found 'weights'; expected" in err
    assert ".toml" in err


def test_the_file_is_a_preset_of_logits_alone(fitted: Path) -> None:
    cones, forward = load_experiment("talk.toml", preset=str(fitted)).configurations
    assert isinstance(forward.attend.attention, LogitSettings)
    assert forward.attend.attention.weights == read_fitted(fitted).attention.weights != default_weights()
    assert cones.attend.attention.method == "cones"


def test_a_change_of_fitted_weights_leaves_other_methods_alone_and_a_note_names_them(fitted: Path) -> None:
    experiment = load_experiment("talk.toml", preset=str(fitted), overrides=("attention.smoothing=both",))
    _, forward = experiment.configurations
    assert isinstance(forward.attend.attention, LogitSettings)
    assert forward.attend.attention.smoothing == "both"
    assert "attention.smoothing is not set in cones: no such setting there." in map(str, experiment.notes)


def test_fitted_weights_come_before_the_method_of_the_default_run(fitted: Path) -> None:
    def chosen(*overrides: str, preset: str | None = str(fitted)) -> MethodSettings:
        experiment = load_experiment("default", clips=("one",), overrides=overrides, preset=preset)
        return experiment.configurations[0].attend.attention

    weights = read_fitted(fitted).attention.weights
    for found in (chosen(), smoothed := chosen("attention.smoothing=both")):
        assert isinstance(found, LogitSettings)
        assert found.weights == weights
    assert isinstance(smoothed, LogitSettings)
    assert smoothed.smoothing == "both"
    assert chosen("attention.method=cones").method == "cones"
    assert chosen(preset=None).method == chosen(preset="realtime").method == "logit"


def test_a_clip_without_labels_gets_a_line_on_what_to_expect(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "400")
    add_clip(measured_tables(tmp_path / "data" / "one"), name="one")
    capsys.readouterr()
    code, said, err = vfoa(monkeypatch, capsys, "run", "one", "--workers", "1", "--recording", "none")
    assert code == 0, err
    expected = LogitSettings(method="logit").expectation
    (line,) = (line for line in said.splitlines() if line.startswith("one has no labels."))
    assert expected in line
    assert re.findall("`(.*?)`", line) == [f"vfoa fit {Path('runs', 'one')}"]
    labelling = "`vfoa labels import FILE --clip one --format FORMAT`"  # there is no picture to label
    assert said.count(labelling) == 1
    cones = ("run", "one", "--workers", "1", "--recording", "none", "--out", "cones", "--set", "attention.method=cones")
    assert "calibration error" not in vfoa(monkeypatch, capsys, *cones)[1]


def test_a_table_says_whether_it_reports_a_clip_that_was_fitted_on(fitted: Path) -> None:
    (on_itself,) = describe(prepare(load_experiment("talk.toml", preset=str(fitted)))).notes
    assert on_itself.kind is NoteKind.FITTED_ON_REPORTED
    assert on_itself.text == "FITTED ON WHAT IS REPORTED: the weights of fitted.toml were fitted on one, two."


def test_a_clip_that_was_fitted_on_is_told_by_its_content_after_it_was_renamed(
    fitted: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    add_clip(measured_tables(Path("data", "other"), range(1, 32), STEP_NS), name="other")
    for file in (Path("datasets", "one.toml"), Path("annotations", "one.csv")):
        text = file.read_text().replace('name = "one"', 'name = "uno"')
        write_text(file.with_name(f"uno{file.suffix}"), text)
        file.unlink()
    write_text(Path("annotations", "other.csv"), true_labels(31))
    write_text(Path("talk.toml"), TWO_CLIPS.replace('"one", "two"', '"uno", "other"'))
    code, said, err = vfoa(
        monkeypatch, capsys, "run", "talk.toml", "--workers", "1", "--recording", "none", "--preset", str(fitted)
    )
    assert code == 0, err
    (warning,) = (line for line in said.splitlines() if line.startswith("FITTED"))
    assert re.fullmatch(
        r".*the weights of fitted\.toml were fitted on uno \(then (one|two)\)\.", warning
    )  # the same files


def test_another_clip_of_a_name_that_was_fitted_on_is_in_question(
    fitted: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Such as a colleague's, whose rates are right: the warning is left to a clip of the same content."""
    monkeypatch.setenv("COLUMNS", "200")
    for file in (Path("datasets", "one.toml"), Path("annotations", "one.csv")):
        file.unlink()
    add_clip(measured_tables(Path("colleague"), range(1, 32), STEP_NS), name="one")
    write_text(Path("annotations", "one.csv"), true_labels(31))
    command = ("run", "talk.toml", "--workers", "1", "--recording", "none", "--preset", str(fitted))
    code, said, err = vfoa(monkeypatch, capsys, *command)
    assert code == 0, err
    (warning,) = (line for line in said.splitlines() if line.startswith("FITTED"))
    assert warning.endswith("the weights of fitted.toml were fitted on two.")
    (doubt,) = (line for line in said.splitlines() if line.startswith("one: the weights of fitted.toml"))
    assert "content differs" in doubt


@pytest.mark.parametrize(
    ("digests", "clips", "expected"),
    [
        (("a", "b"), {"one": "a", "two": "b"}, [(NoteKind.FITTED_ON_REPORTED, "one, two")]),
        (("a", "b"), {"two": "a"}, [(NoteKind.FITTED_ON_REPORTED, "two (then one)")]),
        (("a", "b"), {"one": "c", "three": "d"}, [(NoteKind.DOUBT, "one: ")]),
        (("a", "b"), {"one": "c", "two": "b"}, [(NoteKind.FITTED_ON_REPORTED, "on two."), (NoteKind.DOUBT, "one: ")]),
        (("", "b"), {"one": "c", "three": ""}, [(NoteKind.FITTED_ON_REPORTED, "on one.")]),  # not known of one
        ((), {"one": "c", "three": "d"}, [(NoteKind.FITTED_ON_REPORTED, "on one.")]),  # of an earlier version
        (("a", "b"), {"three": "c"}, [(NoteKind.FACT, "one, two")]),
    ],
)
def test_a_clip_is_the_one_fitted_on_if_its_content_is(
    digests: tuple[str, ...], clips: Mapping[str, str], expected: list[tuple[NoteKind, str]]
) -> None:
    origin = {"experiment": "e", "configuration": "c", "people": 1, "labelled_s": 1, "version": "1"}
    record = FitRecord.model_validate({**origin, "clips": ("one", "two"), "clips_sha256": digests})
    found = [*notes_on_fits({Path("my.toml"): record}, clips)]
    assert [note.kind for note in found] == [kind for kind, _ in expected]
    for note, (_, words) in zip(found, expected, strict=True):
        assert words in note.text


def test_a_wrong_weight_is_named(fitted: Path) -> None:
    fitted.write_text(fitted.read_text().replace("head_swing", "head_shear"))
    with pytest.raises(VfoaError, match=r"attention.*head_shear"):
        load_experiment("talk.toml", preset=str(fitted))


def test_the_terminal_says_that_a_clip_was_fitted_on(
    fitted: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    words = ("run", "talk.toml", "--workers", "1", "--recording", "none", "--out", "out")
    warning = "FITTED ON WHAT IS REPORTED: the weights of fitted.toml were fitted on one, two."
    _, said, _ = vfoa(monkeypatch, capsys, *words, "--preset", str(fitted))
    assert said.splitlines().count(warning) == 1
    assert vfoa(monkeypatch, capsys, "score", "out")[1].splitlines().count(warning) == 1
    assert "FITTED" not in vfoa(monkeypatch, capsys, *words[:-1], "default")[1]


def test_the_default_weights_say_what_to_expect_and_fitted_ones_do_not(fitted: Path) -> None:
    assert "calibration error" in LogitSettings(method="logit").expectation
    assert read_fitted(fitted).attention.expectation == ""


def test_a_file_holds_cases_that_nobody_fitted(fitted: Path) -> None:
    """Their constant is 0."""
    found = read_fitted(fitted)
    plain = found.model_copy(update={"attention": LogitSettings(method="logit")})
    fitted.write_text(fitted_text(plain), encoding="utf-8")
    assert read_fitted(fitted) == plain


@pytest.mark.parametrize("version", ["99.9", f"{__version__}.1", "newest", ""])
def test_weights_of_a_version_that_this_program_does_not_know_are_refused(version: str, fitted: Path) -> None:
    text = fitted.read_text()
    assert f'version = "{__version__}"' in text
    fitted.write_text(text.replace(f'version = "{__version__}"', f'version = "{version}"\nof_later = 1'))
    with pytest.raises(VfoaError, match=rf"fit\.version: found '{version}'.*{__version__}"):
        load_experiment("talk.toml", preset=str(fitted))


def test_weights_of_an_earlier_version_are_taken(fitted: Path) -> None:
    fitted.write_text(fitted.read_text().replace(f'version = "{__version__}"', 'version = "0.0.9"'))
    assert read_fitted(fitted).fit.version == "0.0.9"


def test_one_clip_is_divided_into_blocks_that_share_no_label(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    labelled_clips(tmp_path, ("one",), 78, 2 * STEP_NS)
    labelled = read_labelled(_plain_run(tmp_path))
    folds = folds_of(labelled, None)
    assert len(folds) == 3  # 31 s
    scored = [set(person.labelled) for _, test in folds for person in test[:1]]
    assert set.union(*scored) == set(labelled.people[0].labelled)
    for train, test in folds:
        for of_train, of_test in zip(train, test, strict=True):
            assert not set(of_train.labelled) & set(of_test.labelled)
            times = [of_test.sequence.times_s[k] for k in of_test.labelled]
            assert times[-1] - times[0] >= 9.9
    (first,) = folds_of(labelled, 20.0)
    assert sum(person.labelled_s for person in first.train) == pytest.approx(2 * 20, abs=0.1)
    assert not set(first.train[0].labelled) & set(first.test[0].labelled)


def test_labels_of_every_fifth_frame_are_as_many_seconds_as_those_of_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    labelled_clips(tmp_path, ("one",), 40)
    directory = _plain_run(tmp_path)
    dense = read_labelled(directory)
    path = tmp_path / "annotations" / "one.csv"
    rows = {name: [name] * 20 + ["robot"] * 20 for name in ("ben", "anna")}
    sparse_rows = [
        f"{frame},{frame},{subject},{target if frame % 5 == 1 else 'ignore'},"
        for subject, of_subject in (("anna", rows["ben"]), ("ben", rows["anna"]))
        for frame, target in enumerate(of_subject, start=1)
    ]
    write_text(path, labels_text(*sparse_rows))
    sparse = read_labelled(directory)
    assert [len(person.labelled) for person in sparse.people] == [8, 8]
    assert [person.labelled_s for person in sparse.people] == pytest.approx([8.0] * 2)
    assert [person.labelled_s for person in dense.people] == pytest.approx([8.0] * 2)
    assert [len(person.first(4.0).labelled) for person in sparse.people] == [4, 4]


@pytest.mark.parametrize(("frames", "blocks"), [(50, 2), (49, 0)])
def test_twenty_labelled_seconds_are_enough_the_last_frame_included(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, frames: int, blocks: int
) -> None:
    monkeypatch.chdir(tmp_path)
    labelled_clips(tmp_path, ("one",), frames, 2 * STEP_NS)  # each frame lasts 0.4 s
    labelled = read_labelled(_plain_run(tmp_path))
    if blocks:
        assert len(folds_of(labelled, None)) == blocks
    else:
        with pytest.raises(VfoaError, match=r"19\.6 s are labelled; expected at least 20 s"):
            folds_of(labelled, None)


@pytest.mark.parametrize("workers", [1, 2])
def test_workers_read_the_features_and_every_frame_of_every_case_is_reported(
    workers: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    labelled_clips(tmp_path, ("one", "two"), 16)
    directory = _plain_run(tmp_path)
    asked, told = [], list[str]()

    @contextlib.contextmanager
    def bar(total: int, what: str) -> Iterator[Progress]:
        asked.append(total)
        yield told.append

    with executor(workers) as chosen:
        labelled = read_labelled(directory, executor=chosen, bar=bar)
    assert fit_logit(labelled) == fit_logit(read_labelled(directory))
    assert asked == [2 * 3 * 16]  # as measured, the gaze alone, the head alone
    assert Counter(told) == {"one": 3 * 16, "two": 3 * 16}


def test_what_comes_long_after_the_last_label_is_not_read_and_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    labelled_clips(tmp_path, ("one",), 40, 5 * STEP_NS)  # each frame lasts 1 s
    write_text(tmp_path / "annotations" / "one.csv", true_labels(24))
    directory = _plain_run(tmp_path)
    parts, told = list[PairCase](), list[str]()
    read = harness.score.labelled_run.read_features

    def noted(part: PairCase, progress: Progress) -> FoundFeatures:
        parts.append(part)
        return read(part, progress)

    monkeypatch.setattr("harness.score.labelled_run.read_features", noted)
    short = read_labelled(directory, bar=lambda total, what: contextlib.nullcontext(told.append))
    assert len(told) == len(parts) * 40
    assert {max(read(part, lambda clip: None).times_s) for part in parts} == {24 + 10}
    monkeypatch.setattr("harness.score.labelled_run.AFTER_S", 1000.0)
    assert max(read(parts[0], lambda clip: None).times_s) == 40
    assert fit_logit(read_labelled(directory)).attention == fit_logit(short).attention


def _plain_run(folder: Path) -> RunDirectory:
    """A run of the experiment, which several fits can read."""
    return run_plainly(load_experiment("talk.toml"), folder / "run", cache=None)


def test_first_seconds_that_are_all_labelled_ones_leave_nothing_to_score_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    labelled_clips(tmp_path, ("one",), 40)  # 8 s
    run = str(_plain_run(tmp_path).path)
    for first in ("8s", "20s"):
        with pytest.raises(VfoaError, match=rf"--first {first}: .*8\.0 .*--even-if-worse"):
            fit(run, Path("fitted.toml"), first=first)
    with pytest.raises(VfoaError, match=r"--first 0\.1s: .*expected more seconds"):
        fit(run, Path("fitted.toml"), first="0.1s", even_if_worse=True)
    assert not Path("fitted.toml").exists()
    fit(run, Path("fitted.toml"), first="20s", even_if_worse=True)
    assert read_fitted(Path("fitted.toml")).fit.held_out == ()


def test_a_clip_is_fitted_under_changed_settings_and_the_command_it_prints_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    labelled_clips(tmp_path, ("one",), 28, 5 * STEP_NS)
    capsys.readouterr()
    changed = ("--set", "gaze_filter.max_missing=7")
    code, said, err = vfoa(monkeypatch, capsys, "fit", "one", "--even-if-worse", *changed)
    assert code == 0, err
    run = RunDirectory(Path("runs", "one")).read_manifest()
    assert run.configurations["default"]["gaze_filter"]["max_missing"] == 7
    command = shlex.split(said.splitlines()[-1].partition(": ")[2])
    assert set(changed) < set(command)
    assert vfoa(monkeypatch, capsys, *command[1:], "--workers", "1", "--recording", "none")[0] == 0
    code, _, err = vfoa(monkeypatch, capsys, "fit", "runs/one", *changed)
    assert (code, err.count("\n")) == (2, 1)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("talk.toml",), "vfoa run talk.toml --preset"),
        (("bayes.toml",), "vfoa run one --preset"),
        (("runs/talk",), "vfoa run one --preset"),
        (("one", "--set", "attention.method=bayes", "--set", "gaze_filter.max_missing=7"), "vfoa run one --set gaze"),
    ],
)
def test_the_command_that_a_fit_prints_runs_and_uses_the_weights(
    words: tuple[str, ...],
    expected: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Of an experiment that is no file of the project's, and of methods that would replace the weights."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")
    labelled_clips(tmp_path, ("one",), 24)
    talk = Path("talk.toml").read_text(encoding="utf-8")
    write_text(tmp_path / "bayes.toml", talk.replace('"logit"', '"bayes"'))
    run_plainly(load_experiment("talk.toml"), Path("runs", "talk"), cache=None)
    capsys.readouterr()
    code, said, err = vfoa(monkeypatch, capsys, "fit", *words, "--even-if-worse", "--out", "weights.toml")
    assert code == 0, err
    printed = said.splitlines()[-1].partition(": ")[2]
    assert printed.startswith(expected)
    code, _, err = vfoa(
        monkeypatch, capsys, *shlex.split(printed)[1:], "--workers", "1", "--recording", "none", "--out", "next"
    )
    assert code == 0, err
    used = RunDirectory(Path("next")).read_manifest().configurations.values()
    weights = read_fitted(Path("weights.toml")).attention.model_dump(mode="json")["weights"]
    assert weights in [configuration["attention"].get("weights") for configuration in used]


def test_weights_that_no_configuration_takes_are_named_in_a_note(fitted: Path) -> None:
    write_text(Path("bayes.toml"), Path("talk.toml").read_text(encoding="utf-8").replace('"logit"', '"bayes"'))
    (note,) = load_experiment("bayes.toml", preset=str(fitted)).notes
    assert note.text == "No configuration uses the weights of fitted.toml: attention.method is set to cones, bayes."


def test_without_labels_nothing_is_perceived(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    labelled_clips(tmp_path, ("one",), 12)
    labels = tmp_path / "annotations" / "one.csv"
    finished = _plain_run(tmp_path)
    labels.write_text(re.sub("(,(?:anna|ben)),[^,]+", r"\1,ignore", labels.read_text()))
    for _ in ("only ignored", "none"):
        with pytest.raises(VfoaError, match=r"talk: found no label .*--clip one"):
            fit("talk.toml", Path("fitted.toml"))
        with pytest.raises(VfoaError, match=r"talk: found no label .*--clip one"):
            read_labelled(finished)
        labels.unlink(missing_ok=True)
    elsewhere = tmp_path / "clips" / "one.toml"
    write_text(elsewhere, (tmp_path / "datasets" / "one.toml").read_text())
    (tmp_path / "datasets" / "one.toml").unlink()
    write_text(Path("talk.toml"), Path("talk.toml").read_text().replace('"one"', f'"{elsewhere}"'))
    with pytest.raises(VfoaError, match=rf"--clip {elsewhere}"):
        fit("talk.toml", Path("fitted.toml"))
    assert not (tmp_path / "runs").exists()


def test_a_run_whose_manifest_has_no_settings_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    labelled_clips(tmp_path, ("talk",), 12)
    directory = _plain_run(tmp_path)
    manifest = directory.read_manifest().plain()
    write_manifest(directory, {**manifest, "configurations": {name: {} for name in manifest["configurations"]}})
    with pytest.raises(VfoaError, match=r"manifest\.json: .*tracking: missing"):
        read_labelled(directory)
    with pytest.raises(VfoaError, match=r"attend: forward: tracking: missing"):
        harness.load_run(directory.path).attend({}, ["forward"])


def test_a_fit_that_is_worse_than_the_default_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The labels of the first 2 of 8 seconds are wrong."""
    monkeypatch.chdir(tmp_path)
    labelled_clips(tmp_path, ("one",), 40)
    wrong = true_labels(40)
    for name in ("anna", "ben"):
        wrong = wrong.replace(f"1,20,{name},", f"1,10,{name},none,\n11,20,{name},")
    write_text(tmp_path / "annotations" / "one.csv", wrong)
    run = str(_plain_run(tmp_path).path)
    with pytest.raises(VfoaError, match="not written"):
        fit(run, Path("fitted.toml"), first="2s")
    assert not Path("fitted.toml").exists()
    fit(run, Path("fitted.toml"), first="2s", even_if_worse=True)
    assert read_fitted(Path("fitted.toml")).fit.labelled_s == pytest.approx(4, abs=0.1)


def test_every_clip_gets_weights_of_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    labelled_clips(tmp_path, ("one", "two", "three"), 24)
    text = Path("talk.toml").read_text()
    write_text(tmp_path / "talk.toml", text + 'attention.weights = "left-out"\n')
    first = _fitted(tmp_path / "first")
    assert set(first.by_clip) == {"one", "two", "three"}
    assert all(isinstance(each, LogitWeights) for each in first.by_clip.values())
    assert not list(tmp_path.glob("*-fit"))
    # labels of a clip do not reach its own weights
    write_text(tmp_path / "annotations" / "one.csv", true_labels(24).replace("robot", "none"))
    other = _fitted(tmp_path / "other")
    assert other.by_clip["one"] == first.by_clip["one"]
    assert other.by_clip["two"] != first.by_clip["two"]


def _run(out: Path, workers: int = 1, cache: Store | None = None) -> RunDirectory:
    experiment = load_experiment("talk.toml")
    return run_whole(experiment, out, workers=workers, cache=cache, next_free=False, recording="none")[1]


def _fitted(out: Path) -> LogitSettings:
    """The weights of the first configuration that has left-out ones, after a run."""
    manifest = _run(out).read_manifest().plain()
    assert manifest["configurations"]["forward"]["attention"]["weights"] == "left-out"
    return LogitSettings.model_validate(manifest["fitted"]["forward"])


@pytest.fixture
def left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A working directory with an experiment on two labelled clips, whose second configuration has left-out weights."""
    monkeypatch.chdir(tmp_path)
    labelled_clips(tmp_path, ("one", "two"), 16)
    with Path("talk.toml").open("a", encoding="utf-8") as file:
        file.write('attention.weights = "left-out"\n')


def test_workers_and_interrupts_change_nothing_of_left_out_weights(
    left_out: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = _run(tmp_path / "whole")
    shared = _run(tmp_path / "shared", 2, Store(tmp_path / "cache", 10**9))
    assert tables_of(shared) == tables_of(whole)
    assert shared.read_manifest().fitted == whole.read_manifest().fitted
    for place in ("harness.score.fit_logit.left_out_weights", "harness.run.runner._finish"):
        with monkeypatch.context() as patch:
            patch.setattr(place, _interrupted)
            with pytest.raises(KeyboardInterrupt):
                _run(tmp_path / "continued")
    continued = _run(tmp_path / "continued")
    assert tables_of(continued) == tables_of(whole)
    assert continued.read_manifest().fitted == whole.read_manifest().fitted


def _interrupted(*_: object, **__: object) -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize("place", ["harness.run.loop.attend_clip", "harness.score.labelled_run.read_labelled"])
def test_an_interrupted_fit_says_what_is_kept_and_goes_on(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    labelled_clips(tmp_path, ("one", "two"), 20)
    with monkeypatch.context() as patch:
        patch.setattr(place, _interrupted)
        code, _, said = vfoa(monkeypatch, capsys, "fit", "talk.toml")
    assert (code, len(said.splitlines())) == (130, 1)
    assert str(Path("runs", "talk")) in said
    assert vfoa(monkeypatch, capsys, "fit", "talk.toml")[0] == 0
    assert RunDirectory(Path("runs", "talk")).read_manifest().finished


def test_a_script_attends_again_with_the_weights_of_the_run(left_out: None, tmp_path: Path) -> None:
    run = harness.load_run(_run(tmp_path / "run").path)
    assert run.attend({}).astype(str).equals(run.answers.astype(str))


def test_a_run_is_another_one_when_the_code_that_fits_its_left_out_weights_has_changed(left_out: None) -> None:
    plan = prepare(load_experiment("talk.toml"), fit=Fit(lambda *_: {}, ("harness.score.fit_logit",)))
    assert "harness.score.fit_logit" in plan.deciding_modules
    write_text(Path("talk.toml"), Path("talk.toml").read_text().replace('attention.weights = "left-out"\n', ""))
    plan = prepare(load_experiment("talk.toml"), fit=plan.fit)
    assert "harness.score.fit_logit" not in plan.deciding_modules


def test_weights_are_not_left_out_of_one_clip_and_not_fitted_by_a_plain_run(left_out: None, tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"talk: forward: .*fitted"):
        run_plan(prepare(load_experiment("talk.toml")), tmp_path / "plain", workers=1, progress=lambda clip: None)
    assert not (tmp_path / "plain").exists()
    (tmp_path / "annotations" / "two.csv").unlink()
    with pytest.raises(VfoaError, match=r'attention\.weights = "left-out": found labels of one alone'):
        _run(tmp_path / "alone")
    assert not (tmp_path / "alone").exists()  # nothing was perceived


def a_course(clouds: Mapping[int, Map] | None = None, *, heads: bool = False) -> list[SceneFrame]:
    """Ann turns gaze and head between three cups, with clouds (N, 3) or without any, and looks at the second one."""
    generator = np.random.default_rng(1)
    boxes = {
        n: Box3D(center_m=np.array([0.5 * n - 1, 0.2, 2.0]), half_size_m=np.full(3, 0.05), left_from_box=np.eye(3))
        for n in (1, 2, 3)
    }
    targets = tuple(
        Target(
            instance=Instance(id=n, label="cup", category_id=0, is_thing=True, score=1.0),
            box_px=None,
            points_left=np.zeros((0, 3), np.float32) if clouds is None else clouds[n],
            box=box,
        )
        for n, box in boxes.items()
    )
    frames = []
    for number in range(1, 31):
        gaze, head = (unit([x, y, 1.0]) for x, y in generator.normal(0, 0.4, (2, 2)))
        view = Cues(gaze=Gaze(direction=gaze) if number % 5 and not heads else None, head_pose=HeadPose(direction=head))
        people = (Person(view=view, instance_id=9, eye_origin_left=np.zeros(3)),)
        scene = Scene(index=number, time_ns=number * 40_000_000, targets=targets, people=people)
        tracked = Tracked(ids=(7,), open=frozenset({7}))
        frames.append(SceneFrame(scene=scene, tracked=tracked, names={7: "ann"}, camera=None, targets=()))
    return frames


def of_the_second_cup(course: Sequence[SceneFrame], alone: Collection[Case] = ()) -> LabelledPerson:
    """Ann, who looks at it in all frames of a course."""
    truths = {"ann": {number: LabelTruth((2,), 0.1, True) for number in range(1, 31)}}
    settings = AttendSettings(attention=LogitSettings(method="logit"))
    pair = LabelledPair(clip="talk", configuration="one", tables={}, settings=settings, truths=truths, alone=alone)
    (ann,) = labelled_people(pair, {case: features_of(PairCase(pair, case), course) for case in (None, *alone)}, {})
    return ann


def test_the_case_of_one_direction_sees_nothing_of_the_other() -> None:
    """Features of the head alone are those of a person whose gaze was never measured, the posterior's among them."""
    both = of_the_second_cup(a_course(), ("gaze", "head"))
    alone = of_the_second_cup(a_course(heads=True))
    for masked, measured in zip(both.sequence.alone["head"], alone.sequence.seen, strict=True):
        assert masked is not None
        np.testing.assert_array_equal(masked.now, measured.now)
        np.testing.assert_array_equal(masked.before, measured.before)
    gazes = [None if seen is None else seen.case for seen in both.sequence.alone["gaze"]]
    assert gazes == ["gaze" if number % 5 else None for number in range(1, 31)]


def test_the_tutorial_shows_what_its_commands_print(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    shared_data: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VFOA_DATA", str(shared_data))
    monkeypatch.setenv("COLUMNS", "80")
    page = (REPOSITORY / "docs/tutorials/label-fit-run.md").read_text(encoding="utf-8")
    code, said, _ = vfoa(monkeypatch, capsys, "fit", "kitchen_p12", "--first", "20s")
    assert code == 0
    shown = page.split("$ vfoa fit kitchen_p12 --first 20s\n")[1].split("```")[0]
    assert [line.rstrip() for line in said.strip().splitlines()] == shown.rstrip().splitlines()
    experiment = experiment_of(["kitchen_p12"], (), (), "kitchen_p12-fitted.toml")
    assert [note.text for note in describe(prepare(experiment)).notes] == [
        "FITTED ON WHAT IS REPORTED: the weights of kitchen_p12-fitted.toml were fitted on kitchen_p12."
    ]
    assert experiment.configurations[0].attend.attention.method == "logit"


def test_features_of_a_fit_see_clouds_as_a_run_does() -> None:
    """The posterior, one of the cues, takes the points of a target that has some, and its box otherwise."""
    centers = {target.instance.id: target.box.center_m for target in a_course()[0].scene.targets if target.box}
    near, off = (
        {number: np.array([center + shift] * 4, np.float32) for number, center in centers.items()} for shift in (0, 0.5)
    )
    posterior = LOGIT_CUES.index("posterior")
    boxed, nearby, aside = (
        np.array([seen.now[posterior] for seen in of_the_second_cup(course).sequence.seen])
        for course in (a_course(), a_course(near), a_course(off))
    )
    assert nearby == pytest.approx(boxed, abs=0.2)
    assert np.abs(aside - boxed).max() > 1
