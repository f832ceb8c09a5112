"""`vfoa clips add PATH --openface FILE`: from a table of faces to a run, with the commands that are printed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.pipeline.weights import models_of
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.plan import needed_stages
from harness.run.table_records import read_records
from tests.command import vfoa
from tests.disk import picture, write_text, write_video
from tests.harness.clips.adding import NUMBERS, images
from tests.measured import measured_tables, openface_file

Run = Callable[..., tuple[int, str, str]]
LOOKS = {f"gaze_{eye}_{axis}": value for eye in "01" for axis, value in (("x", -0.6), ("z", -0.8))}
DRAWN = """\
# vfoa drawn 1
frame,name,kind,u0_px,v0_px,u1_px,v1_px,outside
1,mug,box,2,2,14,14,
1,ann,box,20,4,50,44,
"""


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """A command as a user gives it, in an empty folder without weights."""
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setenv("VFOA_MODELS", str(tmp_path))
    monkeypatch.setattr("vfoa.weights.cache_directory", lambda: tmp_path / "models")
    return lambda *words: vfoa(monkeypatch, capsys, *words)


def pairs(folder: Path) -> tuple[str, ...]:
    """The words that add three pairs, whose person is ann and whose object a mug."""
    source = images(folder / "source", "left/{}.png", "right/{}.png")
    return ("clips", "add", str(source), "--name", "mine", *NUMBERS, "--subject", "ann", "--target", "mug=cup")


def table(folder: Path, frames: int = 3) -> Path:
    rows = [
        {"frame": number, "timestamp": number / 25, "box_px": (26, 12, 44, 34), "pose_Ry": 0.3, "pose_Tz": 900, **LOOKS}
        for number in range(1, frames + 1)
    ]
    return openface_file(folder / "faces.csv", rows)


def test_openfaces_heads_and_gazes_are_those_of_the_run(tmp_path: Path, run: Run) -> None:
    code, said, err = run(*pairs(tmp_path), "--openface", str(table(tmp_path)))
    assert (code, err) == (0, "")
    assert said.splitlines()[-2:] == ["next: vfoa models fetch --for mine", "next: vfoa run mine"]
    experiment = load_experiment("mine")
    assert models_of(needed_stages(experiment)).keys() == {"rf-detr-seg-medium"}
    (own,), (default,) = experiment.configurations, load_experiment("default", clips=("mine",)).configurations
    assert own.attend == default.attend
    (cones,) = load_experiment("mine", overrides=("attention.method=cones",)).configurations
    assert cones.attend.attention.method == "cones"

    write_text(Path("annotations/mine.drawn.csv"), DRAWN)
    code, _, err = run("run", "mine", "--set", "segmentation.model=drawn", "--recording", "none", "--workers", "1")
    assert (code, err) == (0, "")
    records = list(read_records(RunDirectory(Path("runs/mine"))))
    assert len(records) == 3
    for record in records:
        (subject,) = record.subjects
        assert subject.name == "ann"
        np.testing.assert_allclose(subject.gaze, (-0.6, 0, -0.8), atol=1e-6)  # type: ignore[arg-type]
        np.testing.assert_allclose(subject.head, (-np.sin(0.3), 0, -np.cos(0.3)), atol=1e-3)  # type: ignore[arg-type]


def test_a_clip_is_added_again_and_another_experiment_of_its_name_is_kept(tmp_path: Path, run: Run) -> None:
    faces = str(table(tmp_path))
    words = pairs(tmp_path)
    bare = words[: words.index("--subject")]
    assert run(*bare, "--openface", faces)[0] == 0
    assert run(*words, "--openface", faces)[0] == 0  # with the names that were missing
    write_text(Path("experiments/other.toml"), "mine")
    code, _, err = run(*(word if word != "mine" else "other" for word in words), "--openface", faces)
    assert code == 2
    assert "other.toml: an experiment of this name exists; expected another name: --name NAME" in err
    assert not Path("datasets/other.toml").exists()


def test_a_table_of_more_frames_or_another_program_adds_nothing(tmp_path: Path, run: Run) -> None:
    longer = table(tmp_path, frames=4)
    for options, said in (
        (("--openface", str(longer)), "faces.csv:5: frame 4: the clip has 3 frames; expected 1 to 3"),
        (("--gaze3d", str(longer)), "faces.csv:1: a table of openface; expected that of gaze3d"),
        (("--gaze3d", str(longer), "--openface", str(longer)), "--openface and --gaze3d: found both"),
    ):
        code, _, err = run(*pairs(tmp_path), *options)
        assert (code, said in err, err.count("\n")) == (2, True, 1), err
    assert not list(Path.cwd().rglob("*.toml"))


def test_a_table_of_few_frames_is_noted(tmp_path: Path, run: Run) -> None:
    code, _, err = run(*pairs(tmp_path), "--openface", str(table(tmp_path, frames=1)))
    assert code == 0
    assert "faces.csv: no face after frame 1 of the clip's 3" in err


def test_measurements_take_no_faces(tmp_path: Path, run: Run) -> None:
    code, _, err = run("clips", "add", str(measured_tables(tmp_path / "talk")), "--openface", str(table(tmp_path)))
    assert code == 2
    assert "a clip of measurements; expected a clip with images" in err


def test_the_film_of_one_camera_is_a_clip_by_openfaces_table_alone(tmp_path: Path, run: Run) -> None:
    film = write_video(tmp_path / "film.avi", [picture(number) for number in (1, 2, 3)])
    code, _, err = run("clips", "add", str(film), "--openface", str(table(tmp_path)))
    assert (code, err.count("\n")) == (2, 1)
    alone = f"vfoa clips add {tmp_path / 'faces.csv'}"
    assert err.endswith(f"; or, for a film of one camera, a clip without images: {alone}\n")
    assert run(*alone.split()[1:])[0] == 0
