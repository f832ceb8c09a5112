"""Predictions of a run are exported to other programs and imported again, exact to the frame."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pympi.Elan import Eaf

from harness.annotate import actions
from harness.annotate.convert import export_predictions, open_exchange, predicted_labels
from harness.annotate.history import History
from harness.clips.manifest import load_manifest
from harness.labels.formats import FORMATS
from harness.labels.labels import Timeline
from harness.run.records import FrameRecord
from harness.run.results import read_clip_records
from tests import records as of_records
from tests.annotating import FRAMES, make_work
from tests.command import vfoa
from tests.disk import write_image, write_text, write_video
from tests.exchanges import SUBJECTS, TARGETS, PlainClip, exchange
from tests.records import frame_record, subject_record, target_record
from vfoa.errors import VfoaError

RATE_HZ = 29.97
IDS = {"bird": 1, "cup": 2, "thing#9": 9}


def frames_of(girl: list[str | None], first: int = 1) -> dict[int, FrameRecord]:
    """Records in which the girl is predicted to look at these: None is no prediction, ``none`` nowhere."""
    targets = [target_record(number, name) for name, number in IDS.items()]
    found = {}
    for frame, name in enumerate(girl, start=first):
        focus = IDS.get(name or "")
        totals = {} if focus is None else {focus: 0.75}
        missing = "no_direction" if name is None else None
        person = subject_record("girl", totals=totals, focus=focus, missing=missing)
        found[frame] = frame_record(targets, [person], frame=frame)
    return found


def write_run(
    folder: Path,
    girl: list[str | None],
    *,
    probabilistic: bool = True,
    films: dict[str, float] | None = None,
    times_ns: Sequence[int] | None = (),
    passer_by: bool = False,
    has_images: bool = True,
) -> Path:
    records = frames_of(girl)
    if passer_by:
        other = subject_record(None, totals={1: 0.75}, focus=1, track_id=2)
        records = {frame: replace(each, subjects=(*each.subjects, other)) for frame, each in records.items()}
    names = {"subjects": {each: {} for each in SUBJECTS}, "targets": {each: {} for each in TARGETS}}
    times = None if times_ns is None else [*times_ns] or [round(frame * 1e9 / RATE_HZ) for frame in records]
    clip = {"name": "clip", "names": names, "frames": list(records), "times_ns": times, "rate_hz": RATE_HZ}
    clip |= {"films": films} if films else {}
    method = {"probabilistic": probabilistic, "says_nowhere": probabilistic}
    configurations: dict[str, Any] = {"one": {} if has_images else {"stereo": None}}
    of_records.write_run(folder, records.values(), clips=[clip], configurations=configurations, methods={"one": method})
    return folder


MANIFEST = """
name = "talk"
adapter = "stereo_folder"
root = "films"
source = { layout = "videos", left = "left.mkv", right = "right.mkv", right_offset = -30, camera = CAMERA }
subjects = { girl = { category = "person" } }
targets = { bird = { category = "bird" } }
""".replace("CAMERA", "{ fx_px = 50, cx_px = 7.5, cy_px = 7.5, baseline_m = 0.1 }")


@pytest.mark.parametrize(("options", "first", "last"), [({}, 50, 59), ({"fps": 25}, 50, 59), ({"offset": 0.0}, 80, 89)])
def test_times_of_a_clip_that_begins_within_its_film_are_the_film_s(
    tmp_path: Path, options: dict[str, float], first: int, last: int
) -> None:
    """The right camera was started 30 frames later."""
    for side, count in (("left", 100), ("right", 70)):
        write_video(tmp_path / "films" / f"{side}.mkv", [np.full((16, 16, 3), n, np.uint8) for n in range(count)])
    manifest = load_manifest(write_text(tmp_path / "talk.toml", MANIFEST))
    document = Eaf(author="somebody")
    document.add_linked_file("file:///C:/v/left.mkv", mimetype="video/x-matroska")
    document.add_tier("girl")
    document.add_annotation("girl", 2000, 2400, "bird")
    document.to_file(str(tmp_path / "a.eaf"))
    format_ = FORMATS.load("elan")()
    (found,) = format_.read(tmp_path / "a.eaf", open_exchange(manifest, **options)).labels.ranges
    assert (found.first_frame, found.last_frame) == (first, last)


def test_predictions_are_suggestions_with_their_probability(tmp_path: Path) -> None:
    run = write_run(tmp_path, ["bird", "bird", None, "none", "thing#9"])
    found = predicted_labels(read_clip_records(run, "clip", None), TARGETS)
    told = [(row.first_frame, row.last_frame, row.label.target, row.label.note) for row in found.labels.ranges]
    assert told == [
        (1, 2, "bird", "probability 0.75"),
        (4, 4, "none", "probability 1.00"),
        (5, 5, "ignore", "predicted thing#9; probability 0.75"),
    ]
    assert all(row.label.is_suggested for row in found.labels.ranges)
    assert found.notes == (
        "1 frame of girl without a prediction (no_direction): no label.",
        "1 label set to 'ignore': the manifest has no name for what was predicted.",
    )


def test_the_probability_of_a_name_is_that_of_all_its_objects(tmp_path: Path) -> None:
    birds = [target_record(1, "bird"), target_record(2, "bird")]
    record = frame_record(birds, [subject_record("girl", totals={1: 0.4, 2: 0.35}, focus=1)])
    traits = {record.configuration: {"probabilistic": True, "says_nowhere": True}}
    of_records.write_run(tmp_path, [record], methods=traits)
    (row,) = predicted_labels(read_clip_records(tmp_path, record.clip, None), TARGETS).labels.ranges
    assert row.label.note == "probability 0.75"


def test_predictions_are_at_the_times_of_the_film_that_shows_the_clip(tmp_path: Path) -> None:
    run = write_run(tmp_path, ["bird"] * 3, films={"left.mp4": 1.2})
    ((path, _),) = export_predictions(run, "elan")
    ((begin, *_),) = Eaf(str(path)).get_annotation_data_for_tier("girl")
    assert begin == 1200


def test_predictions_of_a_run_that_saved_no_times_need_a_rate(tmp_path: Path) -> None:
    run = write_run(tmp_path, ["bird"] * 3, times_ns=None)
    with pytest.raises(VfoaError, match=r"--fps: missing; .* times of the clip's frames"):
        [*export_predictions(run, "elan")]
    ((path, _),) = export_predictions(run, "elan", fps=25.0)
    assert Eaf(str(path)).get_annotation_data_for_tier("girl")[0][:2] == (0, 100)


@pytest.mark.parametrize("has_images", [True, False])
def test_with_a_rate_predictions_are_at_the_times_at_which_an_import_takes_them(
    tmp_path: Path, has_images: bool
) -> None:
    """Of a clip without images, it is the rate of another camera's film, whose times are the clip's."""
    run = write_run(tmp_path, ["bird"] * 20 + ["cup"] * 20, has_images=has_images)
    ((path, _),) = export_predictions(run, "elan", fps=50.0)
    clip = exchange(PlainClip(frames=range(1, 41), rate_hz=RATE_HZ), has_images=has_images, fps=50.0)
    found = FORMATS.load("elan")().read(path, clip).labels.ranges
    assert [(row.first_frame, row.last_frame, row.label.target) for row in found] == [(1, 20, "bird"), (21, 40, "cup")]
    _, end_ms, *_ = Eaf(str(path)).get_annotation_data_for_tier("girl")[-1]
    assert end_ms == pytest.approx(40_000 / (50.0 if has_images else RATE_HZ), abs=35)


def test_cones_that_hit_nothing_are_no_label(tmp_path: Path) -> None:
    run = write_run(tmp_path, ["bird", "none", "cup"], probabilistic=False)
    found = predicted_labels(read_clip_records(run, "clip", None), TARGETS)
    assert [(row.first_frame, row.label.target) for row in found.labels.ranges] == [(1, "bird"), (3, "cup")]
    assert found.notes == ("1 frame of girl without a prediction (nothing hit): no label.",)


@pytest.mark.parametrize("name", ["elan", "csv"])
def test_a_passer_by_without_a_name_does_not_prevent_the_import(name: str, tmp_path: Path) -> None:
    ((written, _),) = export_predictions(write_run(tmp_path, ["cup"], passer_by=True), name)
    imported = FORMATS.load(name)().read(written, exchange(PlainClip(frames=range(1, 2), rate_hz=RATE_HZ)))
    assert [(row.subject, row.label.target) for row in imported.labels.ranges] == [("girl", "cup")]


@pytest.mark.parametrize("name", ["elan", "csv"])
@given(girl=st.lists(st.sampled_from(["bird", "cup", "none", None]), min_size=1, max_size=60).filter(any))
def test_the_round_trip_is_exact_to_the_frame(name: str, tmp_path: Path, girl: list[str | None]) -> None:
    run = write_run(tmp_path / "run", girl)
    ((written, _),) = export_predictions(run, name, replace=True)
    clip = PlainClip(frames=range(1, len(girl) + 1), rate_hz=RATE_HZ)
    imported = FORMATS.load(name)().read(written, exchange(clip))
    again = [imported.labels.at(frame, "girl") for frame in clip.frames]
    assert [label.target if label and label.note != "not labelled yet" else None for label in again] == girl


@pytest.mark.parametrize("count", [1, 3])
def test_a_run_of_the_first_frames_labels_no_other_frame(count: int, tmp_path: Path) -> None:
    """A camera's steps vary: the next frame may come sooner than the usual step after the last one of the run."""
    times_ns = [number * 10**6 for number in (0, 40, 80, 113, 153)]
    run = write_run(tmp_path, ["bird"] * count, times_ns=times_ns[:count])
    ((written, _),) = export_predictions(run, "elan")
    whole = replace(
        exchange(PlainClip(frames=range(1, 6), rate_hz=25.0)), timeline=Timeline(frames=range(1, 6), times_ns=times_ns)
    )
    (row,) = FORMATS.load("elan")().read(written, whole).labels.ranges
    assert (row.first_frame, row.last_frame) == (1, count)


def test_pympi_reads_what_was_predicted(tmp_path: Path) -> None:
    ((written, _),) = export_predictions(write_run(tmp_path, ["bird", "bird", "cup"]), "elan")
    assert written == tmp_path / "labels" / "clip__one.eaf"
    document = Eaf(str(written))
    assert document.get_annotation_data_for_tier("girl") == [(0, 67, "bird"), (67, 84, "cup")]
    assert [value for *_, value in document.get_annotation_data_for_tier("girl:state")] == ["suggested"] * 2
    assert document.get_annotation_data_for_tier("girl:note")[0][2] == "probability 0.75"


def test_notes_on_several_clips_name_theirs(tmp_path: Path) -> None:
    girl = ["bird", None]
    records = [replace(record, clip=clip) for clip in ("a", "b") for record in frames_of(girl).values()]
    names = {"subjects": {each: {} for each in SUBJECTS}, "targets": {each: {} for each in TARGETS}}
    clips = [
        {"name": clip, "names": names, "frames": [1, 2], "times_ns": [0, 10**9], "rate_hz": 1.0} for clip in ("a", "b")
    ]
    of_records.write_run(tmp_path, records, clips=clips, configurations={"one": {}})
    notes = [notes for _, notes in export_predictions(tmp_path, "csv")]
    cut = [[note.partition(" of girl")[0] for note in of_clip] for of_clip in notes]
    assert cut == [["a: 1 frame"], ["b: 1 frame"]]


def test_a_corrected_file_is_not_written_over(tmp_path: Path) -> None:
    run = write_run(tmp_path, ["bird", "cup"])
    list(export_predictions(run, "elan"))
    with pytest.raises(VfoaError, match=r"clip__one\.eaf: .*--replace"):
        list(export_predictions(run, "elan"))


def test_attention_without_probabilities_has_none(tmp_path: Path) -> None:
    ((written, _),) = export_predictions(write_run(tmp_path, ["bird"], probabilistic=False), "csv")
    assert "probability" not in written.read_text()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"clip": "clop"}, "no clip 'clop'; did you mean 'clip'"),
        ({"configuration": "two"}, "no configuration 'two'"),
    ],
)
def test_a_wrong_choice_is_one_line(tmp_path: Path, options: dict[str, str], said: str) -> None:
    with pytest.raises(VfoaError, match=said):
        list(export_predictions(write_run(tmp_path, ["bird"]), "elan", **options))  # type: ignore[arg-type]


def test_predictions_are_corrected_and_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for side in ("left", "right"):
        for number in (1, 2, 3):
            write_image(tmp_path / "pairs" / side / f"{number}.png", np.full((4, 6, 3), 90, np.uint8))
    camera = "[source.camera]\nfx_px = 9\ncx_px = 3\ncy_px = 2\nbaseline_m = 0.1\n"
    names = '[subjects.girl]\ncategory = "person"\n[targets.bird]\ncategory = "bird"\n[targets.cup]\ncategory = "cup"\n'
    head = 'name = "clip"\nadapter = "stereo_folder"\nroot = "../pairs"\n[source]\nleft = "left"\nright = "right"\n'
    write_text(tmp_path / "datasets" / "clip.toml", f"{head}rate_hz = {RATE_HZ}\n{camera}{names}")
    write_run(tmp_path / "run", ["bird", "bird", "cup"])
    code, out, _ = vfoa(monkeypatch, capsys, "labels", "export", "run", "--config", "one", "--format", "elan")
    assert code == 0
    document = Eaf(out.strip())
    document.remove_annotation("girl", 80)
    document.add_annotation("girl", 67, 100, "none")
    document.to_file(out.strip())
    told = ("labels", "import", out.strip(), "--format", "elan", "--clip", "clip")
    code, _, said = vfoa(monkeypatch, capsys, *told)
    assert code == 0
    assert "--confirm confirms them" in said
    assert vfoa(monkeypatch, capsys, *told, "--confirm", "--replace")[0] == 0
    assert (tmp_path / "annotations" / "clip.csv").read_text().splitlines()[2:] == [
        "1,2,girl,bird,probability 0.75",
        "3,3,girl,none,",
    ]


def test_an_import_counts_the_labels_that_are_in_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest = load_manifest(str(make_work(tmp_path) / "datasets" / "noise.toml"))
    with closing(History(manifest, None, Timeline(frames=FRAMES, times_ns=()))) as history:
        store = history.labels
        store.put("ann", actions.look(store.track("ann"), 2, "cup"), seen=4)  # and carried to the end, in the page
    table = write_text(tmp_path / "looks.csv", "subject,target,onset,duration\nann,book,0,0.4\n")
    monkeypatch.chdir(tmp_path)
    told = ("labels", "import", str(table), "--format", "table", "--clip", "noise", "--fps", "25")
    code, _, said = vfoa(monkeypatch, capsys, *told)
    assert code == 2
    assert "ann (3 frames)" in said
    code, _, said = vfoa(monkeypatch, capsys, *told, "--replace")
    assert code == 0
    assert "ann (3 frames)" in said
