"""A name is the same whether its accents stand in its letters (Unicode's NFC) or after them (NFD, as on macOS)."""

from __future__ import annotations

import tomllib
from pathlib import Path
from unicodedata import normalize

import pytest

from harness.cli.options import composed_name
from harness.clips.add import add_clip
from harness.clips.manifest import load_manifest
from harness.clips.manifest_text import with_change
from harness.labels.formats.exchange import NameLog, file_name
from harness.report.experiment_run import run_plainly
from harness.report.write import rescore
from harness.run.experiment import load_experiment
from harness.score.subset import Condition
from tests.disk import write_text
from tests.experiments import experiment_of
from tests.measured import measured_tables, motive_file, open_measured, pose, ros_file, true_labels
from vfoa.errors import VfoaError

COMPOSED, APART = (normalize(form, "José") for form in ("NFC", "NFD"))
FILES = ("data/talk/people.csv", "datasets/talk.toml", "annotations/talk.csv", "answers/talk.csv")


def _talk(folder: Path, apart: str | None) -> None:
    """The measured clip with José in place of Anna; in one of the files the accent stands after its letter."""
    add_clip(measured_tables(folder / "data" / "talk"), name="talk")
    write_text(folder / "annotations" / "talk.csv", true_labels())
    rows = [f"{frame},anna,{'ben' if frame < 7 else 'robot'}" for frame in range(1, 13)]
    rows += [f"{frame},ben,{'anna' if frame < 7 else 'robot'}" for frame in range(1, 13)]
    write_text(folder / "answers" / "talk.csv", "\n".join(["frame,subject,target", *rows]) + "\n")
    for name in FILES:
        text = (folder / name).read_text(encoding="utf-8")
        assert "anna" in text
        spelt = APART if name == apart else COMPOSED
        write_text(folder / name, text.replace("[subjects.anna]", f'[subjects."{spelt}"]').replace("anna", spelt))
    theirs = {"attention.method": "answers", "attention.file": "answers/talk.csv"}
    write_text(folder / "talk.toml", experiment_of(["talk"], {"cones": {}, "theirs": theirs}, preset="measured"))


@pytest.mark.parametrize("apart", [None, *FILES])
def test_a_name_is_the_same_in_either_form(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, apart: str | None) -> None:
    monkeypatch.chdir(tmp_path)
    _talk(tmp_path, apart)
    scores = rescore(run_plainly(load_experiment("talk.toml"), tmp_path / "run", cache=None))
    assert {(row.configuration, row.n, row.correct) for row in scores.rows.overall} == {
        ("cones", 24, 24),
        ("theirs", 24, 24),
    }
    assert {verdict.subject for verdict in scores.verdicts} == {COMPOSED, "ben"}


def test_another_programs_name_is_ours_in_either_form() -> None:
    names = NameLog(renamed={APART: "ben", f"ben:{COMPOSED}x": APART})
    assert names.translate(COMPOSED) == names.translate(APART) == "ben"
    assert names.translate(f"{APART}x", "ben") == COMPOSED
    assert NameLog(renamed={}).expect(APART, {COMPOSED}, "subject", "file") == COMPOSED
    assert file_name(f"file:///films/{APART}.mp4") == f"{COMPOSED}.mp4"


def test_a_manifest_has_a_name_once_and_can_be_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    _talk(tmp_path, "datasets/talk.toml")
    path = tmp_path / "datasets" / "talk.toml"
    changed = with_change(path, COMPOSED, new_name=COMPOSED, key=None, colour="blue plain")
    assert tomllib.loads(changed)["subjects"][COMPOSED]["colour"] == "blue plain"
    write_text(path, path.read_text(encoding="utf-8") + f'\n[targets."{COMPOSED}"]\ncategory = "cup"\n')
    with pytest.raises(VfoaError, match=r"a subject has this name"):
        load_manifest("talk")
    write_text(path, path.read_text(encoding="utf-8") + f'\n[targets."{APART}"]\ncategory = "bowl"\n')
    with pytest.raises(VfoaError, match=r"twice, with accents in two forms"):
        load_manifest("talk")


@pytest.mark.parametrize(("in_file", "in_source"), [(COMPOSED, APART), (APART, COMPOSED)])
def test_a_source_finds_its_bodies_in_either_form(tmp_path: Path, in_file: str, in_source: str) -> None:
    bodies = {in_file: pose([0, 1.6, 0]), f"{in_file}'s cup": pose([1, 1, 0])}
    heads, cup = {"anna": {"body": in_source}}, f"{in_source}'s cup"
    fixed = {f"{in_source}'s door": {"center_m": [0, 0, 3]}}
    take = motive_file(tmp_path / "take.csv", bodies)
    clip = open_measured("motive", tmp_path, file=take.name, heads=heads, sizes_m={cup: [1, 1, 1]}, objects=fixed)
    assert set(clip.objects) == {f"{COMPOSED}'s cup", f"{COMPOSED}'s door"}
    bag = ros_file(tmp_path / "take.bag", bodies)
    clip = open_measured("ros_poses", tmp_path, file=bag.name, heads=heads, bodies=[cup])
    assert set(clip.objects) == {f"{COMPOSED}'s cup"}
    both = {f"{COMPOSED}": {"center_m": [0, 0, 3]}, f"{APART}": {"center_m": [0, 0, 4]}}
    with pytest.raises(ValueError, match=r"twice, with accents in two forms"):
        open_measured("motive", tmp_path, file=take.name, heads=heads, objects=both)


def test_a_name_on_the_command_line_is_that_of_the_tables_in_either_form() -> None:
    assert Condition.parse(f"target=mug|{APART}").values == ("mug", COMPOSED)
    assert composed_name(APART) == COMPOSED
    assert composed_name(None) is None
