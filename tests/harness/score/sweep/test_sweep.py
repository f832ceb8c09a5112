"""Sweeps: the counts that whole runs would have come to, and nothing of their frames."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from harness.clips.add import add_clip
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.score.finished_run import read_scores
from harness.score.sweep.runner import sweep_plan
from tests.command import vfoa
from tests.disk import write_text
from tests.measured import measured_tables
from tests.plugins import install
from vfoa.errors import VfoaError

SWEEP = """
clips = ["studio_table", "studio_crowd"]
{sweep}
[defaults]
stereo = {{ matcher = "truth" }}
segmentation = {{ model = "truth" }}
heads = {{ detector = "truth" }}
head_pose = {{ model = "simulated" }}
gaze = {{ model = "simulated" }}

[grid]
"gaze.error_deg" = [5.0, 20.0]
"reconstruction.boxes" = ["aabb", "oriented"]
"attention.weighting" = ["adaptive", "head"]
"attention.occlusion" = ["ignore", "first_hit"]
"attention.cones_deg" = {{ narrow = [5.0], both = [10.0, 40.0] }}
"""
VIEW = '[sweep]\nper = "gaze.error_deg"\nacross = "attention.cones_deg"\n'
FRAMES = 2
FAULTY = """
from vfoa.settings import Settings

class Faulty:
    Settings = Settings

    def __init__(self, settings):
        pass

    def match(self, frame):
        return frame.depth
"""


def experiment_file(folder: Path, sweep: str = VIEW) -> str:
    return str(write_text(folder / "mine.toml", SWEEP.format(sweep=sweep)))


def test_a_sweep_counts_what_a_run_of_every_configuration_counts(tmp_path: Path) -> None:
    experiment = load_experiment(experiment_file(tmp_path))
    plan = prepare(experiment, limit=FRAMES)
    run = read_scores(run_plan(plan, tmp_path / "run", workers=1, progress=lambda clip: None))
    sweep = sweep_plan(plan, tmp_path / "sweep", workers=1, progress=lambda clip: None)
    pooled = {row.configuration: row for row in run.rows if row.clip is None and row.subject is None}
    assert len(sweep.rows) == 32
    for row in sweep.rows:
        expected = pooled["-".join(row.factors.values())]
        assert (row.n, row.correct, row.predicted) == (expected.n, expected.correct, expected.predicted)
    assert len({row.correct for row in sweep.rows}) > 1


MEASURED = """
clips = ["talk"]
preset = "measured"
[sweep]
per = "attention.weighting"
across = "attention.cones_deg"
[grid]
"attention.weighting" = ["adaptive", "head"]
"attention.cones_deg" = { narrow = [5.0], wide = [20.0], both = [10.0, 60.0] }
"""


def test_a_sweep_over_measurements_counts_what_a_run_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    added = add_clip(measured_tables(tmp_path / "talk"))
    wrong = "1,12,anna,ben,\n1,12,ben,anna,\n"  # in half of the frames
    write_text(added.annotations, f"# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note\n{wrong}")
    plan = prepare(load_experiment(str(write_text(tmp_path / "mine.toml", MEASURED))))
    run = read_scores(run_plan(plan, tmp_path / "run", workers=1, progress=lambda clip: None))
    sweep = sweep_plan(plan, tmp_path / "sweep", workers=1, progress=lambda clip: None)
    of_run = {row.configuration: row for row in run.rows if row.subject is None}
    for row in sweep.rows:
        expected = of_run["-".join(row.factors.values())]
        assert (row.n, row.correct, row.predicted) == (expected.n, expected.correct, expected.predicted)
    assert (24, 12) in {(row.n, row.correct) for row in sweep.rows}


def test_the_command_writes_the_table_the_answers_and_the_figure(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("run", experiment_file(tmp_path), "--limit", "1", "--workers", "1", "--out")
    code, said, _ = vfoa(monkeypatch, capsys, *words, str(tmp_path / "a"))
    assert code == 0
    assert "32 configurations x 2 frames" in said
    rows = list(csv.DictReader((tmp_path / "a" / "sweep.csv").read_text().splitlines()))
    assert len(rows) == 32
    assert {row["attention.cones_deg"] for row in rows} == {"narrow", "both"}
    best = {
        label: max(int(row["correct"]) for row in rows if row["gaze.error_deg"] == label) for label in ("5.0", "20.0")
    }
    page = (tmp_path / "a" / "sweep.md").read_text()
    for label, correct in best.items():
        (line,) = [line for line in page.splitlines() if line.startswith(f"| {label} ")]
        assert f"| {correct / int(rows[0]['n']):.1%} |" in line.replace("  ", " ").replace("  ", " ")
    vfoa(monkeypatch, capsys, *words, str(tmp_path / "b"))
    written = {path.name for path in (tmp_path / "a").iterdir()}
    assert written == {"sweep.csv", "sweep.md", "sweep.json", "sweep.svg", "sweep.png", "report.html"}
    for name in written:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert vfoa(monkeypatch, capsys, *words, str(tmp_path / "a"))[0] == 0, "the same sweep again"
    code, _, said = vfoa(monkeypatch, capsys, *words, str(tmp_path / "a"), "--set", "gaze.seed=5")
    assert (code, said.count("\n")) == (2, 1)
    assert "a: holds another sweep (different: configurations_sha256); expected an empty directory" in said
    write_text(tmp_path / "mine" / "notes.md", "mine")
    code, _, said = vfoa(monkeypatch, capsys, *words, str(tmp_path / "mine"))
    assert code == 2
    assert "mine: holds other files; expected an empty directory" in said


@pytest.mark.parametrize(
    ("sweep", "expected"),
    [
        (
            VIEW.replace("gaze.error", "gaze.eror"),
            "sweep.per: 'gaze.eror_deg' is not in the grid; did you mean 'gaze.e",
        ),
        ('[sweep]\nper = "gaze.error_deg"\n', "sweep.across"),
    ],
)
def test_a_wrong_view_is_said_by_file_and_key(tmp_path: Path, sweep: str, expected: str) -> None:
    with pytest.raises(VfoaError) as refused:
        load_experiment(experiment_file(tmp_path, sweep))
    assert expected in str(refused.value)
    assert "mine.toml" in str(refused.value)


def test_only_cones_can_be_swept_over(tmp_path: Path) -> None:
    text = SWEEP.format(sweep=VIEW).split("[grid]")[0] + (
        '[grid]\n"gaze.error_deg" = [5.0]\n"attention.method" = ["bayes"]\n'
    )
    path = write_text(tmp_path / "mine.toml", text.replace("attention.cones_deg", "attention.method"))
    plan = prepare(load_experiment(str(path)), limit=1)
    with pytest.raises(VfoaError, match="a sweep is over cones"):
        sweep_plan(plan, tmp_path / "sweep", workers=1, progress=lambda clip: None)


def test_what_a_sweep_does_not_keep_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("run", experiment_file(tmp_path), "--oracle", "--out", str(tmp_path / "out"))
    code, _, said = vfoa(monkeypatch, capsys, *words)
    assert code == 2
    assert "--oracle" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("workers", ["1", "2"])
def test_a_bug_in_a_stage_keeps_its_traceback_where_no_run_keeps_it(
    workers: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    site = install(tmp_path / "site", "vfoa_faulty", FAULTY, group="vfoa.stereo", name="faulty", cls="Faulty")
    monkeypatch.syspath_prepend(str(site))
    experiment = write_text(
        tmp_path / "mine.toml", SWEEP.format(sweep=VIEW).replace('matcher = "truth"', 'matcher = "faulty"')
    )
    words = ("run", str(experiment), "--limit", "1", "--workers", workers, "--no-cache", "--out", str(tmp_path / "a"))
    code, _, complaint = vfoa(monkeypatch, capsys, *words)
    assert code == 2
    assert complaint.startswith("Traceback (most recent call last):\n")
    assert "return frame.depth" in complaint
    assert complaint.splitlines()[-1].startswith('vfoa: frame 1: stereo.matcher = "faulty", match: AttributeError: ')
