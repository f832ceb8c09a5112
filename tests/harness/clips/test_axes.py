"""Directions in another program's axes are noticed, and right ones are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.clips.axes import FAR_DEG, FEWEST, other_axes, other_forward
from harness.clips.check import check_clip
from harness.report.tables import terminal_table
from harness.report.write import rescore
from harness.run.experiment import load_experiment
from harness.run.notes import NoteKind
from harness.run.runner import prepare, run_plan
from tests.disk import labels_text, write_text
from vfoa.geometry import angle_between
from vfoa.types import Float

WRONG = {
    "x negated": lambda v: v * [-1, 1, 1],
    "y negated": lambda v: v * [1, -1, 1],
    "z negated": lambda v: v * [1, 1, -1],
    "x and y and z negated": lambda v: -v,  # from the target to the eyes
    "x and y exchanged": lambda v: v[:, [1, 0, 2]],
    "y and z exchanged": lambda v: v[:, [0, 2, 1]],
}
PLACES = np.array([[-0.8, 0.6, 1.0], [0.9, 0.1, 1.2], [-0.3, -0.7, 0.5], [0.4, 0.5, 1.6]])
FILES = '[source]\npeople_file = "people.csv"\nobjects_file = "objects.csv"\n'
EYES = np.array([0.1, 0.0, 3.0])


def _looks(count: int = 80, error_deg: float = 8.0, seed: int = 0) -> tuple[Float, Float]:
    """Directions with an error, and the vectors from the eyes to what is looked at."""
    rng = np.random.default_rng(seed)
    to_targets = PLACES[np.arange(count) // 10 % len(PLACES)] - EYES
    aims = to_targets / np.linalg.norm(to_targets, axis=1, keepdims=True)
    measured = aims + rng.normal(0, np.radians(error_deg), aims.shape)
    return measured / np.linalg.norm(measured, axis=1, keepdims=True), to_targets


@pytest.mark.parametrize("change", WRONG)
@given(seed=st.integers(0, 99))
def test_axes_that_are_not_ours_are_named(change: str, seed: int) -> None:
    directions, to_targets = _looks(seed=seed)
    found = other_axes(WRONG[change](directions), to_targets)
    assert found is not None
    assert found.change == change
    assert found.share > found.share_as_they_are


@given(error_deg=st.floats(0, 40), seed=st.integers(0, 99))
def test_right_axes_are_not_questioned_however_large_the_error(error_deg: float, seed: int) -> None:
    assert other_axes(*_looks(error_deg=error_deg, seed=seed)) is None


def test_few_directions_and_none_tell_nothing() -> None:
    directions, to_targets = _looks(FEWEST - 1)
    assert other_axes(-directions, to_targets) is None
    assert other_axes(np.empty((0, 3)), np.empty((0, 3))) is None


@given(st.sampled_from([[1, 0, 0], [0, -1, 0], [0, 0, -1], [0.6, 0, -0.8]]), st.integers(0, 2**32 - 1))
def test_a_face_that_is_elsewhere_on_its_body_is_found(forward: list[float], seed: int) -> None:
    """Looks scatter by 15 degrees about the face, and a third of the labels are of anything."""
    rng = np.random.default_rng(seed)
    aims = np.array(forward) + rng.normal(0, np.radians(15) / np.sqrt(2), (90, 3))
    aims[:30] = rng.normal(0, 1, (30, 3))
    found = other_forward(aims * rng.uniform(0.5, 3, (90, 1)), np.array([0.0, 0.0, 1.0]))
    assert found is not None
    assert angle_between(found, np.array(forward)) < np.radians(15)
    assert other_forward(aims, found) is None


@given(st.floats(0, 1), st.integers(0, 2**32 - 1))
def test_a_face_that_is_where_it_is_said_to_be_is_not_questioned(share: float, seed: int) -> None:
    """However many labels are of anything; eyes that look aside by less than the limit say nothing either."""
    rng = np.random.default_rng(seed)
    aside = np.radians(FAR_DEG - 10)
    aims = np.array([np.sin(aside), 0, np.cos(aside)]) + rng.normal(0, 0.1, (200, 3))
    aims[: int(200 * share)] = rng.normal(0, 1, (int(200 * share), 3))
    assert other_forward(aims, np.array([0.0, 0.0, 1.0])) is None
    assert other_forward(aims[: FEWEST - 1], np.array([0.0, 0.0, -1.0])) is None


def _clip(folder: Path, name: str, directions: Float) -> None:
    rows = [f"{n},{n / 10},ann,0.1,0,3,{x:.6f},{y:.6f},{z:.6f},8\n" for n, (x, y, z) in enumerate(directions)]
    header = "frame,time_s,person,x_m,y_m,z_m,gaze_x,gaze_y,gaze_z,gaze_sigma_deg\n"
    write_text(folder / name / "people.csv", header + "".join(rows))
    objects = "".join(f",thing{n},{x},{y},{z},0.2,0.2,0.2\n" for n, (x, y, z) in enumerate(PLACES))
    write_text(folder / name / "objects.csv", "frame,object,x_m,y_m,z_m,size_x_m,size_y_m,size_z_m\n" + objects)
    targets = "".join(f'thing{n} = {{ category = "thing{n}", instance = {n + 2} }}\n' for n in range(len(PLACES)))
    source = f'name = "{name}"\nadapter = "measured"\nroot = "../{name}"\n{FILES}'
    names = f'[subjects]\nann = {{ category = "person" }}\n[targets]\n{targets}'
    write_text(folder / "datasets" / f"{name}.toml", source + names)
    looks = (f"{n},{n + 9},ann,thing{n // 10 % len(PLACES)}," for n in range(0, len(directions), 10))
    write_text(folder / "annotations" / f"{name}.csv", labels_text(*looks))


def test_the_check_of_a_clip_and_the_table_say_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    directions, _ = _looks()
    _clip(tmp_path, "right", directions)
    _clip(tmp_path, "wrong", directions * [-1, 1, 1])
    assert check_clip("right").notes == ()
    (note,) = check_clip("wrong").notes
    assert note.startswith("with x negated, ")
    experiment = write_text(tmp_path / "both.toml", 'clips = ["right", "wrong"]\npreset = "measured"\n')
    run = run_plan(prepare(load_experiment(str(experiment))), tmp_path / "run", workers=1, progress=lambda clip: None)
    scores = rescore(run)
    (said,) = (note.text for note in scores.notes if note.kind is NoteKind.DOUBT)
    assert said.startswith("wrong under default: with x negated, ")
    assert said in terminal_table(scores).notes


@pytest.mark.parametrize(("category", "is_questioned"), [("book", True), ("cup", False)])
def test_a_label_that_several_objects_have_does_not_question_the_axes(
    category: str, is_questioned: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ann looks at one of two things on both sides, and at a lamp; the label is of the other one, or of any cup."""
    monkeypatch.chdir(tmp_path)
    looks = [((0, 0.28, -0.96), (0.6, 0, -0.8))[n // 4 % 2] for n in range(160)]
    rows = [f"{n},{n / 10},ann,0,0,3,{x},{y},{z}\n" for n, (x, y, z) in enumerate(looks)]
    write_text(
        tmp_path / "talk" / "people.csv", f"frame,time_s,person,x_m,y_m,z_m,gaze_x,gaze_y,gaze_z\n{''.join(rows)}"
    )
    objects = f",a,cup,-0.8,0,2\n,b,{category},0.8,0,2\n,c,lamp,0,0.3,2\n"
    write_text(tmp_path / "talk" / "objects.csv", f"frame,object,category,x_m,y_m,z_m\n{objects}")
    names = "".join(f"[targets.{name}]\ncategory = '{name}'\n" for name in dict.fromkeys(("cup", category, "lamp")))
    source = f'name = "talk"\nadapter = "measured"\nroot = "../talk"\n{FILES}'
    write_text(tmp_path / "datasets" / "talk.toml", f"{source}[subjects.ann]\ncategory = 'person'\n{names}")
    rows = [f"{n},{n + 3},ann,{('lamp', 'cup')[n // 4 % 2]}," for n in range(0, 160, 4)]
    write_text(tmp_path / "annotations" / "talk.csv", labels_text(*rows))
    checked = check_clip("talk")
    assert checked.problems == ()
    assert [note.partition(",")[0] for note in checked.notes] == ["with x negated"] * is_questioned
