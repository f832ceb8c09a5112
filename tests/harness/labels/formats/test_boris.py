"""BORIS tables in the layouts of its versions 7 and 9, as its export and its own test files have them."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.labels.formats.boris import Boris
from harness.labels.labels import Labels
from tests.disk import write_text
from tests.exchanges import exchange, row
from vfoa.errors import VfoaError

TABULAR_7 = """Observation id,talk,,,,,,,
,,,,,,,,
Media file(s),,,,,,,,
Player #1,talk.mp4,,,,,,,
Time offset (s),0.0,,,,,,,
independent variables,,,,,,,,
variable,value,,,,,,,
Time,Media file path,Total length,FPS,Subject,Behavior,Behavioral category,Comment,Status
0.000,talk.mp4,2.000,25.0,girl,bird,,eyes shut,START
0.030,talk.mp4,2.000,25.0,boy,cup,,,START
0.080,talk.mp4,2.000,25.0,girl,bird,,,STOP
0.080,talk.mp4,2.000,25.0,girl,cup,,,START
0.100,talk.mp4,2.000,25.0,girl,nod,,,POINT
0.120,talk.mp4,2.000,25.0,boy,cup,,,STOP
0.160,talk.mp4,2.000,25.0,girl,cup,,,STOP
"""
HEAD_8 = (
    "Observation id\tObservation date\tDescription\tObservation duration\tObservation type\tSource\tTime offset (s)\t"
    "Media duration (s)\tFPS\tSubject\tBehavior\tBehavioral category\tBehavior type\tTime\tMedia file name\t"
    "Image index\tImage file path\tComment\n"
)
BEFORE_8 = "talk\t2026-01-02 03:04:05\t\t2.000\tMedia file(s)\tplayer #1:talk.mp4\t0\t2.000\t25.000\t"
TABULAR_8 = HEAD_8 + "".join(
    f"{BEFORE_8}{who}\t{what}\t\t{status}\t{time}\ttalk.mp4\t0\tNA\t{note}\n"
    for time, who, what, status, note in [
        ("0.000", "girl", "bird", "START", "eyes shut"),
        ("0.030", "boy", "cup", "START", ""),
        ("0.080", "girl", "bird", "STOP", ""),
        ("0.080", "girl", "cup", "START", ""),
        ("0.100", "girl", "nod", "POINT", ""),
        ("0.120", "boy", "cup", "STOP", ""),
        ("0.160", "girl", "cup", "STOP", ""),
    ]
)
HEAD_AGGREGATED = (
    "Observation id\tObservation date\tDescription\tMedia file\tTotal length\tFPS\tage\tSubject\tBehavior\t"
    "Behavioral category\tModifiers\tBehavior type\tStart (s)\tStop (s)\tDuration (s)\tComment start\tComment stop\n"
)
AGGREGATED = HEAD_AGGREGATED + "".join(
    f"talk\t2026-01-02\t\ttalk.mp4\t2.000\t25.0\t7\t{who}\t{what}\t\t\t{kind}\t{start}\t{stop}\t{length}\t{note}\t\n"
    for who, what, kind, start, stop, length, note in [
        ("girl", "bird", "STATE", "0.000", "0.080", "0.080", "eyes shut"),
        ("girl", "cup", "STATE", "0.080", "0.160", "0.080", ""),
        ("girl", "nod", "POINT", "0.100", "0.100", "NA", ""),
        ("boy", "cup", "STATE", "0.030", "0.120", "0.090", ""),
    ]
)
HEAD_AGGREGATED_9 = (
    "Observation id\tObservation date\tDescription\tObservation type\tSource\tTime offset (s)\tCoding duration\t"
    "Media duration (s)\tFPS (frame/s)\tage\tSubject\tObservation duration by subject by observation\tBehavior\t"
    "Behavioral category\tModifier #1\tBehavior type\tStart (s)\tStop (s)\tDuration (s)\tMedia file name\t"
    "Image index start\tImage index stop\tImage file path start\tImage file path stop\tComment start\tComment stop\n"
)
BEFORE_9 = "talk\t2026-01-02 03:04:05\t\tMedia file(s)\tplayer #1:talk.mp4\t0.000\t0.160\t2.000\t25.000\t7\t"
AGGREGATED_9 = HEAD_AGGREGATED_9 + "".join(
    f"{BEFORE_9}{who}\t0.160\t{what}\tNot defined\t\t{kind}\t{start}\t{stop}\t{length}\ttalk.mp4\t{frame}"
    f"\t\t\t\t{note}\t\n"
    for who, what, kind, start, stop, length, frame, note in [
        ("girl", "bird", "STATE", "0.000", "0.080", "0.080", "0", "eyes shut"),
        ("girl", "cup", "STATE", "0.080", "0.160", "0.080", "2", ""),
        ("girl", "nod", "POINT", "0.100", "0.100", "NA", "2", ""),
        ("boy", "cup", "STATE", "0.030", "0.120", "0.090", "1", ""),
    ]
)
ROWS = (row(1, 2, "bird", note="eyes shut"), row(2, 3, "cup", "boy"), row(3, 4, "cup"))


@pytest.mark.parametrize(("text", "line"), [(TABULAR_7, 13), (TABULAR_8, 6), (AGGREGATED, 4), (AGGREGATED_9, 4)])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_its_layouts_are_read(tmp_path: Path, text: str, line: int, mark: str) -> None:
    path = write_text(tmp_path / "a.tsv", mark + text)
    imported = Boris().read(path, exchange())
    assert imported.labels == Labels(ROWS)
    assert imported.notes == (f"{path}: 1 point events have no length and are left out, line {line} first.",)


def test_its_windows_line_ends_change_nothing(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.csv", TABULAR_7.replace("\n", "\r\n"))
    assert Boris().read(path, exchange()).labels == Labels(ROWS)


def test_a_tab_in_a_note_does_not_make_a_tsv_of_a_csv(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.csv", TABULAR_7.replace("eyes shut", "eyes\tshut"))
    assert Boris().read(path, exchange()).labels == Labels(ROWS)


@pytest.mark.parametrize(("text", "nobody"), [(TABULAR_8, ""), (AGGREGATED_9, "No focal subject")])
def test_events_without_a_focal_subject_can_be_given_one(tmp_path: Path, text: str, nobody: str) -> None:
    """BORIS leaves the cell empty in one export, and has words for it in the other."""
    path = write_text(tmp_path / "a.tsv", text.replace("\tgirl\t", f"\t{nobody}\t"))
    with pytest.raises(VfoaError, match="unknown subject 'No focal subject'"):
        Boris().read(path, exchange())
    assert Boris().read(path, exchange(renamed={"No focal subject": "girl"})).labels == Labels(ROWS)


@pytest.mark.parametrize(
    "text",
    [
        TABULAR_7.replace("Time offset (s),0.0", "Time offset (s),60"),
        TABULAR_8.replace("talk.mp4\t0\t2.000", "talk.mp4\t60\t2.000"),
        AGGREGATED_9.replace("talk.mp4\t0.000\t", "talk.mp4\t60\t"),
    ],
)
def test_a_time_offset_that_was_not_told_is_said(tmp_path: Path, text: str) -> None:
    path = write_text(tmp_path / "a.csv", text)
    assert Boris().read(path, exchange()).notes[-1] == (
        f"{path}: the observation's time offset is 60 s, which BORIS adds to all times; --offset 60 takes it off."
    )
    assert "time offset" not in " ".join(Boris().read(path, exchange(offset=60.0)).notes)


def test_modifiers_are_left_out_and_counted(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.tsv", AGGREGATED_9.replace("cup\tNot defined\t\t", "cup\tNot defined\tred\t"))
    imported = Boris().read(path, exchange())
    assert imported.labels == Labels(ROWS)
    assert f"{path}: modifiers in 2 rows are left out, line 3 first." in imported.notes


@pytest.mark.parametrize("text", [TABULAR_8, AGGREGATED_9])
def test_one_of_two_observations_must_be_chosen(tmp_path: Path, text: str) -> None:
    path = write_text(tmp_path / "a.tsv", text + text.splitlines()[-1].replace("talk", "walk", 1) + "\n")
    with pytest.raises(VfoaError, match="found the observations 'talk', 'walk'; expected --observation NAME"):
        Boris().read(path, exchange())
    assert Boris().read(path, exchange(observation="talk")).labels == Labels(ROWS)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "0.080,talk.mp4,2.000,25.0,girl,bird,,,STOP",
            "0.080,,,,girl,bird,,,START",
            r":11: 'bird' of 'girl' starts again; expected its STOP after line 9",
        ),
        ("girl,bird,,,STOP", "girl,cup,,,STOP", r":11: 'cup' of 'girl' stops; expected its START before"),
        ("boy,cup,,,STOP", "boy,cup,,,POINT", r":10: 'cup' of 'boy' starts and never stops"),
        ("boy,cup", "bob,cup", r":10: unknown subject 'bob'; did you mean 'boy'"),
        ("boy,cup", "boy,cap", r":10: unknown target 'cap'; did you mean 'cup'"),
        ("0.030", "00:00:03", r":10: Time: found '00:00:03'; expected seconds"),
        ("0.160", "0.060", r":12: ends at 0.06 s, before it begins"),
        ("STOP", "HALT", r":11: found the status 'HALT'; expected START, STOP or POINT"),
        ("Behavior,", "Verhalten,", r"no header with the columns Time, Subject, Behavior"),
    ],
)
def test_a_mistake_is_one_line_with_its_place(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in TABULAR_7
    path = write_text(tmp_path / "a.csv", TABULAR_7.replace(old, new))
    with pytest.raises(VfoaError, match=message) as error:
        Boris().read(path, exchange())
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


def test_what_it_cannot_hold_is_said(tmp_path: Path) -> None:
    labels = Labels([row(1, 2, "bird", point_px=(3.0, 4.0)), row(3, 4, "cup", is_suggested=True)])
    assert Boris().write(tmp_path / "a.boris", labels, exchange()) == (
        "BORIS cannot hold it: 1 suggested labels stand in it as if a person had confirmed them.",
        "BORIS cannot hold it: 1 image points are left out.",
    )


def test_an_offset_before_the_beginning_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"--offset: the clip's first frame would be at -2 s; expected 0 or later"):
        Boris().write(tmp_path / "a.boris", Labels(ROWS), exchange(offset=-2.0))
