"""Fixations on areas of interest as Pupil Cloud exports them: three tables of one enrichment."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from harness.labels.formats import format_of
from harness.labels.formats.exchange import Exchange
from harness.labels.formats.own_table import OwnTable
from harness.labels.formats.pupil_cloud import PupilCloud
from harness.labels.labels import Labels
from tests.disk import write_text
from tests.exchanges import SUBJECTS, PlainClip, exchange, row
from vfoa.errors import VfoaError

START_NS = 1_718_000_000_123_456_789
"""The time of a recording's first fixation, since 1970: more digits than a float has."""
MINE, OTHER = "0b1e7b43-5d2c-4a86-a5c8-3ff5ad0be9cc", "6a2c9d10-77f0-4f0e-8e3e-1f2d3c4b5a69"
AREAS = "aoi id,aoi name,section id,recording id,fixation id,fixation duration [ms]\n"
FIXATIONS = (
    "section id,recording id,fixation id,start timestamp [ns],end timestamp [ns],duration [ms],"
    "fixation detected in reference image,fixation x [px],fixation y [px]\n"
)
SECTIONS = (
    "section id,recording id,recording name,wearer id,wearer name,section start time [ns],section end time [ns],"
    "start event name,end event name\n"
)


def _export(folder: Path, *, recordings: tuple[str, ...] = (MINE,), areas: str = AREAS, wearers: str = "") -> Path:
    """Each recording: 0.2 s on a bird, 0.1 s on none of the areas, 0.1 s outside of the image, 0.1 s on a cup."""
    spans = ((7, 0, 200, "True"), (8, 200, 300, "true"), (9, 300, 400, "False"), (10, 400, 500, "True"))
    rows = [
        f"s,{name},{number},{START_NS + start * 10**6},{START_NS + end * 10**6},{end - start},{seen},10.5,20.25\n"
        for name in recordings
        for number, start, end, seen in spans
    ]
    write_text(folder / "fixations.csv", FIXATIONS + "".join(rows))
    if wearers:
        write_text(folder / "sections.csv", SECTIONS + wearers)
    hits = [f"a{n},{area},s,{name},{n},100\n" for name in recordings for n, area in ((7, "bird"), (10, "brown cup"))]
    return write_text(folder / "aoi_fixations.csv", areas + "".join(hits))


def _exchange(subjects: tuple[str, ...] = SUBJECTS, **more: Any) -> Exchange:
    """Of a clip whose frame n is (n - 1) / 10 s after the first fixation began, on the same clock."""
    clip = PlainClip(frames=range(1, 7), rate_hz=10.0, start_ns=START_NS - 10**8)
    return replace(exchange(clip, **{"renamed": {"brown cup": "cup"}, **more}), subjects=subjects)


def _read(path: Path, **more: Any) -> tuple[Labels, tuple[str, ...]]:
    assert format_of(path) == "pupil_cloud"
    imported = PupilCloud().read(path, _exchange(**more))
    return imported.labels, imported.notes


EXPECTED = [(1, 2, "bird"), (3, 3, "none"), (4, 4, "ignore"), (5, 5, "cup")]
"""What is in the image and in no area is a look at nothing; what is outside of the image is not known."""


def _targets(labels: Labels, subject: str) -> list[tuple[int, int, str]]:
    return [(each.first_frame, each.last_frame, each.label.target) for each in labels.of(subject)]


@pytest.mark.parametrize("areas", [AREAS, AREAS.replace("aoi id,aoi name", "label id,aoi label")])
def test_fixations_have_the_times_of_their_own_table(tmp_path: Path, areas: str) -> None:
    labels, notes = _read(_export(tmp_path, areas=areas), renamed={MINE: "girl", "brown cup": "cup"})
    assert labels.subjects == ("girl",)
    assert _targets(labels, "girl") == EXPECTED
    assert any("1 row without a target" in note for note in notes)


def test_without_a_common_clock_the_offset_says_when_the_clip_begins(tmp_path: Path) -> None:
    """The second frame of the clip is shown when the first fixation begins."""
    labels, _ = _read(_export(tmp_path), renamed={MINE: "girl", "brown cup": "cup"}, offset=START_NS / 1e9 - 0.1)
    assert _targets(labels, "girl") == [(first + 1, last + 1, target) for first, last, target in EXPECTED]


def test_a_wearer_is_a_subject_and_one_recording_may_be_chosen(tmp_path: Path) -> None:
    wearers = f"s,{MINE},trial 1,w1,Anna,1,2,,\ns,{OTHER},trial 2,w2,Ben,1,2,,\n"
    path = _export(tmp_path, recordings=(MINE, OTHER), wearers=wearers)
    names = {"brown cup": "cup", "Anna": "girl", "Ben": "boy"}
    labels, _ = _read(path, renamed=names)
    assert [_targets(labels, subject) for subject in labels.subjects] == [EXPECTED, EXPECTED]
    labels, _ = _read(path, renamed=names, observation="trial 2")
    assert labels.subjects == ("boy",)
    with pytest.raises(VfoaError, match=r"--observation: no recording 'trial 3'"):
        _read(path, observation="trial 3")
    with pytest.raises(VfoaError, match=r"fixations\.csv:2: unknown subject 'Anna'.*'Ben'"):
        _read(path)
    write_text(path, path.read_text(encoding="utf-8") + f"a9,bird,s,{MINE},10,100\n")
    with pytest.raises(VfoaError, match=r"fixations\.csv:5: fixation 10 is in brown cup and bird; expected one"):
        _read(path, renamed=names, observation="trial 1")
    labels, _ = _read(path, renamed=names, observation=OTHER)
    assert _targets(labels, "boy") == EXPECTED
    labels, _ = _read(path, renamed=names | {"bird": ""}, observation="trial 1")
    assert _targets(labels, "girl") == [(3, 3, "none"), (4, 4, "ignore"), (5, 5, "cup")]


@pytest.mark.parametrize("wearer", ["wearer name", "other name"])
def test_a_wearer_without_a_name_is_known_by_the_recording(tmp_path: Path, wearer: str) -> None:
    """Other recordings of the project, of which there is no fixation, are none of the clip's."""
    path = _export(tmp_path, wearers=f"s,{MINE},trial 1,w1,,1,2,,\ns,{OTHER},trial 2,w2,Ben,1,2,,\n")
    sections = tmp_path / "sections.csv"
    write_text(sections, sections.read_text(encoding="utf-8").replace("wearer name", wearer))
    labels, notes = _read(path, renamed={MINE: "girl", "brown cup": "cup"})
    assert _targets(labels, "girl") == EXPECTED
    assert not any("--rename" in note for note in notes)
    alone, notes = _read(path, renamed={MINE: "girl", "brown cup": "cup"}, subjects=("girl",))
    assert (alone, any("--rename" in note for note in notes)) == (labels, False)


def test_recordings_of_one_name_are_chosen_by_id(tmp_path: Path) -> None:
    wearers = "".join(f"s{n},{each},trial,w,Anna,1,2,,\n" for n, each in enumerate((MINE, MINE, OTHER)))
    path = _export(tmp_path, recordings=(MINE, OTHER), wearers=wearers)
    names = {"brown cup": "cup", "Anna": "girl"}
    with pytest.raises(VfoaError, match=rf"sections\.csv:4: 'trial' .*{MINE} and {OTHER}; expected --observation ID"):
        _read(path, renamed=names, observation="trial")
    assert _targets(_read(path, renamed=names, observation=MINE)[0], "girl") == EXPECTED


def test_the_only_subject_of_a_clip_is_the_wearer_of_the_only_recording(tmp_path: Path) -> None:
    labels, _ = _read(_export(tmp_path), subjects=("girl",))
    assert _targets(labels, "girl") == EXPECTED


@pytest.mark.parametrize(
    ("file", "text", "message"),
    [
        ("aoi_fixations.csv", f"a9,bird,s,{MINE},77,100\n", r": fixation 77 of recording .* is not in fixations\.csv"),
        ("fixations.csv", f"s,{MINE},11,soon,{START_NS},1,True,1,1\n", r":6: start_ns: found 'soon'; expected ns"),
        ("fixations.csv", f"s,{MINE},11,1.718e18,{START_NS},1,True,1,1\n", r":6: start_ns: found '1\.718e18'.*cut off"),
    ],
)
def test_what_is_wrong_is_named_with_its_table(tmp_path: Path, file: str, text: str, message: str) -> None:
    path = _export(tmp_path)
    write_text(tmp_path / file, (tmp_path / file).read_text(encoding="utf-8") + text)
    with pytest.raises(VfoaError, match=rf"^[^\n]*{file}{message}[^\n]*$"):
        _read(path, renamed={MINE: "girl", "brown cup": "cup"})


def test_tables_that_are_missing_or_of_another_kind_are_named(tmp_path: Path) -> None:
    path = write_text(tmp_path / "aoi_fixations.csv", "frame,aoi\n1,bird\n")
    with pytest.raises(VfoaError, match=r"aoi_fixations\.csv:1: found frame, aoi; .*aoi_name or aoi_label"):
        _read(path)
    write_text(path, AREAS)
    with pytest.raises(VfoaError, match=r"no fixations\.csv beside it"):
        _read(path)


def test_one_subject_has_the_labels_of_a_table_in_nanoseconds(tmp_path: Path) -> None:
    """A table of one's own with the same columns, on the clip's own clock."""
    text = "subject,aoi name,start timestamp [ns],end timestamp [ns]\n" + "".join(
        f"girl,{target},{START_NS + start},{START_NS + end}\n"
        for target, start, end in (("bird", 0, 2 * 10**8), ("cup", 2 * 10**8, 5 * 10**8))
    )
    imported = OwnTable().read(write_text(tmp_path / "mine.csv", text), _exchange())
    assert imported.labels == Labels([row(1, 2, "bird"), row(3, 5, "cup")])
