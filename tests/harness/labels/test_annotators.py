from __future__ import annotations

from pathlib import Path

import pytest

from harness.clips.manifest import ClipManifest, load_manifest
from harness.files import folders
from harness.labels.files import read_annotations
from tests.disk import labels_text, write_text
from vfoa.errors import VfoaError

ROWS = labels_text("1,2,girl,{},")


@pytest.fixture
def manifest(tmp_path: Path) -> ClipManifest:
    text = (
        'name = "clip"\nadapter = "sintel"\n[subjects.girl]\ncategory = "person"\n[targets.bird]\ncategory = "bird"\n'
    )
    write_text(tmp_path / "annotations" / "clip.csv", ROWS.format("bird"))
    write_text(tmp_path / "annotations" / "clip@anna.csv", ROWS.format("none"))
    write_text(tmp_path / "annotations" / "clip2@zoe.csv", ROWS.format("none"))
    return load_manifest(write_text(tmp_path / "datasets" / "clip.toml", text))


def _target(manifest: ClipManifest, annotator: str | None) -> str:
    labels = manifest.labels(None, annotator)
    assert labels is not None
    return labels.ranges[0].label.target


def test_each_annotator_has_a_file_and_the_clip_has_one_that_is_scored(manifest: ClipManifest) -> None:
    assert manifest.annotations.annotators() == ("anna",)
    assert (_target(manifest, None), _target(manifest, "anna")) == ("bird", "none")


def test_an_annotator_without_a_file_is_never_replaced_by_another(manifest: ClipManifest) -> None:
    with pytest.raises(VfoaError, match=r"clip: .*\(clip@ana\.csv\).*'anna'"):
        manifest.labels(None, "ana")


@pytest.mark.parametrize("name", ["", "../x", "a b", "a@b"])
def test_an_annotators_name_is_one_word(manifest: ClipManifest, name: str) -> None:
    with pytest.raises(VfoaError, match="expected a name of letters"):
        manifest.annotations.place(name)


def test_a_file_of_another_name_is_named(manifest: ClipManifest, tmp_path: Path) -> None:
    write_text(tmp_path / "annotations" / "clip@Ben B.csv", ROWS.format("none"))
    with pytest.raises(VfoaError, match=r"annotations/clip@Ben B\.csv: found the annotator 'Ben B'"):
        manifest.annotations.annotators()


def test_a_new_file_goes_beside_the_manifest(manifest: ClipManifest, tmp_path: Path) -> None:
    assert manifest.annotations.place("ben") == tmp_path / "annotations" / "clip@ben.csv"
    assert manifest.annotations.place() == tmp_path / "annotations" / "clip.csv"


def test_labels_of_a_packaged_clip_are_written_where_one_works_and_come_first_from_then_on(
    manifest: ClipManifest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "_data").mkdir()
    for kind in ("datasets", "annotations"):
        (tmp_path / kind).rename(tmp_path / "_data" / kind)
    monkeypatch.setattr(folders, "_PACKAGE", tmp_path)
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    packaged = load_manifest("clip")
    assert _target(packaged, None) == "bird"
    own = packaged.annotations.place()
    assert own == work / "annotations" / "clip.csv"
    write_text(own, ROWS.format("none"))
    assert _target(packaged, None) == "none"
    assert packaged.annotations.annotators() == ("anna",)


def test_a_suggestion_is_in_the_file_but_not_in_the_labels_that_count(manifest: ClipManifest) -> None:
    text = ROWS.format("bird").replace("note\n", "note,state\n").replace("bird,\n", "bird,,suggested\n")
    path = write_text(manifest.annotations.place(), text)
    assert _target(manifest, None) == "ignore"
    raw = read_annotations(path, timeline=None, subjects=manifest.subjects, targets=manifest.targets)
    assert raw.ranges[0].label.target == "bird"


def test_the_labels_of_another_clip_of_this_name_that_came_with_the_program_are_not_used(tmp_path: Path) -> None:
    text = 'name = "studio_table"\nadapter = "studio"\n[source]\nscenario = "table"\n'
    mine = load_manifest(write_text(tmp_path / "datasets" / "studio_table.toml", text))
    assert mine.annotations.find() is None
    assert mine.annotations.place() == tmp_path / "annotations" / "studio_table.csv"


@pytest.mark.parametrize("has_namesake", [False, True])
def test_labels_of_another_project_are_not_those_of_its_clip_of_the_same_name(
    has_namesake: bool, manifest: ClipManifest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "annotations" / "clip.csv").unlink()
    other = tmp_path / "other"
    labels = write_text(other / "annotations" / "clip.csv", "# vfoa annotations 1\n")
    if has_namesake:
        write_text(other / "datasets" / "clip.toml", manifest.path.read_text(encoding="utf-8"))
    monkeypatch.chdir(other)
    assert manifest.annotations.find() == (None if has_namesake else labels)


def test_two_clips_of_one_name_in_two_folders_do_not_share_labels(manifest: ClipManifest, tmp_path: Path) -> None:
    text = manifest.path.read_text(encoding="utf-8")
    one, other = (load_manifest(write_text(tmp_path / day / "clip.toml", text)) for day in ("monday", "tuesday"))
    for clip, namesake in ((one, other), (other, one)):
        with pytest.raises(
            VfoaError, match=rf"^{clip.path}: .*annotations/clip\.csv.*(datasets|{namesake.path.parent})"
        ):
            clip.annotations.find()
        with pytest.raises(VfoaError, match="expected a name of its own"):
            clip.annotations.place("anna")
    assert _target(manifest, None) == "bird"
    manifest.annotations.expect(None).unlink()
    assert one.annotations.find() is None


def test_labels_that_came_with_the_program_are_not_those_of_another_clip_of_the_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A clip of one's own called like a built-in one, whose annotation file is missing, has no labels."""
    monkeypatch.chdir(tmp_path)
    assert load_manifest("studio_table").annotations.find() is not None
    write_text(
        tmp_path / "datasets" / "studio_table.toml",
        'name = "studio_table"\nadapter = "studio"\n[subjects.ann]\ncategory = "person"\n',
    )
    assert load_manifest("studio_table").annotations.find() is None
