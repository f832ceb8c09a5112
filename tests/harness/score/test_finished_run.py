from __future__ import annotations

import re
import shlex
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from harness.annotate.correction import choices
from harness.annotate.history import History
from harness.clips.manifest import load_manifest
from harness.labels.labels import timeline_of
from harness.report.write import rescore
from harness.run.directory import LOCK, RunDirectory
from harness.run.manifest import AnswerTraits, RunManifest
from harness.run.notes import Note, NoteKind
from harness.score.finished_run import FinishedRun, read_scores
from harness.score.score import score
from tests.disk import labels_text, write_text
from tests.records import answers, write_clip, write_run
from vfoa.errors import VfoaError


def _finished(folder: Path, **manifest: Any) -> FinishedRun:
    return FinishedRun(directory=RunDirectory(folder), manifest=RunManifest.model_validate(manifest))


def _unfinished(folder: Path) -> RunDirectory:
    """A run of the clips a and b under two configurations that goes on: its tables are there, and none is complete."""
    records = [
        record
        for clip in ("a", "b")
        for name in ("one", "two")
        for record in answers(["cup", None], clip=clip, configuration=name)
    ]
    clips = [write_clip(folder, clip, ["cup", "cup"]) for clip in ("a", "b")]
    directory = write_run(folder / "run", records, clips=clips, notes=[])
    directory.write_manifest(directory.read_manifest().model_copy(update={"finished": None}))
    return directory


def test_of_a_run_that_goes_on_the_clips_are_read_that_are_complete_under_what_has_begun(tmp_path: Path) -> None:
    directory = _unfinished(tmp_path)
    with pytest.raises(VfoaError, match="no complete clip yet; repeat the same"):
        FinishedRun.read_so_far(directory)
    (directory.path / LOCK).write_text("process 7 on box")
    with pytest.raises(VfoaError, match=r"this run is not finished: process 7 on box writes it .*report .*--serve"):
        FinishedRun.read(directory)
    found = []
    for pair in [("a", "one"), ("a", "two"), ("b", "two"), ("b", "one")]:
        write_text(directory.partial(pair, "csv"), "")
        run = FinishedRun.read_so_far(directory)
        (note,) = run.manifest.notes
        assert note.kind == NoteKind.UNFINISHED
        scored = score(run.columns(), run.reference())
        found.append((scored.clips, scored.configurations, re.findall(r"\d of \d", note.text)))
    assert found == [
        (("a",), ("one",), ["1 of 2", "1 of 2"]),
        (("a",), ("one", "two"), ["1 of 2", "2 of 2"]),
        (("a",), ("one", "two"), ["1 of 2", "2 of 2"]),
        (("a", "b"), ("one", "two"), ["2 of 2", "2 of 2"]),
    ]


@pytest.mark.parametrize(
    ("subjects", "first"),
    [('[subjects.ann]\ncategory = "person"\n', ""), ("", "write [subjects.NAME] into new.toml, then ")],
)
def test_a_clip_without_a_single_label_is_named_with_what_labels_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, subjects: str, first: str
) -> None:
    monkeypatch.chdir(tmp_path)
    write_text(tmp_path / "datasets" / "new.toml", f'name = "new"\nadapter = "studio"\n{subjects}')
    write_text(tmp_path / "annotations" / "new.csv", labels_text())
    clip = {"name": "new", "manifest": "", "frames": [1], "notes": []}
    manifest = {"notes": [], "clips": [clip], "configurations": {"one": {}}, "finished": "now"}
    directory = write_run(tmp_path / "run", answers(["cup"], clip="new"), **manifest)
    reference = FinishedRun.read(directory).reference()
    assert reference.labels == {}
    (note,) = reference.notes
    assert (note.kind, note.clip) == (NoteKind.UNLABELLED, "new")
    assert note.text == (
        f"new: no labels, not scored; one person at most found in its frames; {first}`vfoa annotate new` labels it."
    )


@pytest.mark.parametrize("has_other", [False, True])
@pytest.mark.parametrize("is_placeholder", [False, True])
def test_a_clip_of_another_folder_is_named_by_its_file_in_the_command_that_labels_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_other: bool, is_placeholder: bool
) -> None:
    """By its name no clip would be found, or another one labelled."""
    monkeypatch.chdir(tmp_path)
    text = 'name = "new"\nadapter = "studio"\n[subjects.ann]\ncategory = "person"\n'
    path = write_text(tmp_path / "it's elsewhere" / "datasets" / "new.toml", text)
    if has_other:
        write_text(tmp_path / "datasets" / "new.toml", text)
    if is_placeholder:  # as vfoa clips add writes it
        write_text(
            tmp_path / "it's elsewhere" / "annotations" / "new.csv", labels_text("1,1,ann,ignore,not labelled yet")
        )
    clip = {"name": "new", "manifest": str(path), "frames": [1], "notes": []}
    manifest = {"notes": [], "clips": [clip], "configurations": {"one": {}}, "finished": "now"}
    (note,) = FinishedRun.read(write_run(tmp_path / "run", answers(["cup"], clip="new"), **manifest)).reference().notes
    command = shlex.split(note.text.partition("`")[2].rpartition("`")[0])
    assert command == ["vfoa", "annotate", str(path)]
    assert load_manifest(command[2]).path == path


@pytest.mark.parametrize("digests", [("a", "a", "b"), ("a", "b", "c"), (None, None, None)])
def test_a_recording_under_two_names_is_told(tmp_path: Path, digests: tuple[str | None, ...]) -> None:
    """Its looks would count twice in intervals and tests; of a run of an earlier version nothing is known."""
    names = ("studio_table", "studio_talk", "studio_split")
    clips = [{"name": name, "frames": [1], "sha256": digest} for name, digest in zip(names, digests, strict=True)]
    notes = _finished(tmp_path, clips=clips, configurations={"one": {}}, finished="now").reference().notes
    doubts = [note.text for note in notes if note.kind == NoteKind.DOUBT]
    assert [text.partition(":")[0] for text in doubts] == ["studio_table, studio_talk"] * (
        digests[0] == "a" == digests[1]
    )


def test_what_is_true_of_several_clips_is_said_once(tmp_path: Path) -> None:
    clips = [
        {"name": name, "manifest": "", "frames": [1], "notes": notes}
        for name, notes in (("studio_table", ["Rendered."]), ("studio_talk", ["Rendered.", "Two people."]))
    ]
    ours = [{"text": "Theirs."}, {"text": "Ours.", "kind": "doubt"}]
    manifest = {"notes": ours, "clips": clips, "configurations": {"one": {}}, "finished": "now"}
    run = _finished(tmp_path, **manifest)
    assert run.reference().notes == (
        Note("Theirs."),
        Note("Ours.", NoteKind.DOUBT),
        Note("studio_table, studio_talk: Rendered."),
        Note("studio_talk: Two people."),
    )


def test_a_run_of_a_built_in_clip_has_the_names_of_a_copy_of_its_manifest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its targets cannot be renamed in place: the page advises to copy the manifest."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VFOA_CACHE", str(tmp_path / "cache"))
    built_in = load_manifest("studio_talk")
    looks = ["bear", "bear", "bowl"]
    records = answers(looks, subject="ben", clip="studio_talk")
    clip = {"name": "studio_talk", "manifest": str(built_in.path), "frames": [1, 2, 3], "names": built_in.naming()}
    directory = write_run(tmp_path / "run", records, clips=[clip])

    def of_ben() -> list[tuple[str | None, str | None]]:
        verdicts = read_scores(directory).verdicts
        return [(verdict.truth, verdict.predicted) for verdict in verdicts if verdict.subject == "ben"]

    before = [("bear", "bear"), ("bear", "bear"), ("bear", "bowl")]
    assert of_ben() == before
    copy = write_text(tmp_path / "datasets" / "studio_talk.toml", built_in.path.read_text())
    assert of_ben() == before  # there are no labels yet beside the copy
    assert copy not in directory.inputs
    labels = built_in.annotations.find()
    assert labels is not None
    write_text(tmp_path / "annotations" / "studio_talk.csv", labels.read_text())
    mine = load_manifest("studio_talk")
    with closing(History(mine, None, timeline_of(mine.open()))) as history:
        history.change_target("bear", new_name="teddy", key=None, colour="olive plain")
    assert of_ben() == [("teddy", "teddy"), ("teddy", "teddy"), ("teddy", "bowl")]
    assert copy in directory.inputs
    assert "teddy" in choices(directory, "studio_talk", "ben")


def test_a_configuration_that_lost_a_seed_is_left_out(tmp_path: Path) -> None:
    """Its rates would be of other frames, and it could not be compared with the others."""
    names = ("one.seed1", "one.seed2", "two.seed1", "two.seed2")
    records = [of for name in names[:3] for of in answers(["cup", "can"], clip="a", configuration=name)]
    failed = {"clip": "a", "configuration": names[3], "error": "out of memory"}
    about = {"configurations": {name: {} for name in names}, "failed": [failed], "notes": []}
    directory = write_run(tmp_path / "run", records, clips=[write_clip(tmp_path, "a", ["cup", "cup"])], **about)
    scored = rescore(directory)
    assert scored.scored_configurations == ("one",)
    assert [note.text for note in scored.notes] == ["two: left out, failed on a under two.seed2: out of memory"]
    directory.write_manifest(directory.read_manifest().model_copy(update={"finished": None, "failed": []}))
    write_text(directory.partial(("a", "one.seed1"), "csv"), "")
    with pytest.raises(VfoaError, match="no complete clip yet"):
        FinishedRun.read_so_far(directory)
    for name in names[1:3]:
        write_text(directory.partial(("a", name), "csv"), "")
        assert [*FinishedRun.read_so_far(directory).manifest.configurations] == ["one.seed1", "one.seed2"]


def test_the_columns_of_a_configuration_are_those_of_its_seeds(tmp_path: Path) -> None:
    names = ("one.seed1", "one.seed2", "two")
    records = [of for name in names for of in answers(["cup", "can"], clip="studio_table", configuration=name)]
    clips = [{"name": "studio_table", "manifest": "", "frames": [1, 2]}]
    run = FinishedRun.read(write_run(tmp_path, records, clips=clips))
    assert [*run.records()] == records
    assert [each.configuration for each in run.columns(["one"])] == ["one.seed1", "one.seed2"]


def test_a_run_that_does_not_say_what_the_answers_of_a_method_are_is_refused(tmp_path: Path) -> None:
    clip = {"name": "studio_table", "manifest": "", "frames": [1], "notes": []}
    configurations = {"one": {"attention": {"method": "bayes"}}}
    manifest = {"notes": [], "clips": [clip], "configurations": configurations, "finished": "now"}
    with pytest.raises(VfoaError, match=r"manifest\.json: methods\.one: missing"):
        _finished(tmp_path, **manifest).reference()
    methods = {"one": {"probabilistic": True, "says_nowhere": False}}
    run = _finished(tmp_path, **manifest, methods=methods)
    assert run.reference().traits == {"one": AnswerTraits(probabilistic=True)}
