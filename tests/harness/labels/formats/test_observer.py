"""Labels of The Observer XT: its event logs as text, in the dialects and columns of its versions."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.labels.formats.exchange import Exchange
from harness.labels.formats.observer import Observer
from harness.labels.labels import Labels, timeline_of
from tests.disk import write_text
from tests.exchanges import PlainClip, exchange, row
from vfoa.errors import VfoaError

TEN = PlainClip(frames=range(1, 11))
"""Frame n is shown at (n - 1) / 25 s."""

LOG = """\
Date_Time_Absolute_dmy_hmsf,Date_dmy,Time_Absolute_hms,Time_Relative_hmsf,Time_Relative_sf,Duration_sf,Observation,\
Event_Log,Subject,Behavior,Modifier_1,Event_Type,Comment,
03-05-2021 10:11:12.000,03-05-2021,10:11:12,00:00:00.000,0.000,0.120,talk,Event log0001,girl,looks,bird,State start,far,
03-05-2021 10:11:12.080,03-05-2021,10:11:12,00:00:00.080,0.080,0.160,talk,Event log0001,boy,looks,girl,State start,,
03-05-2021 10:11:12.100,03-05-2021,10:11:12,00:00:00.100,0.100,0.000,talk,Event log0001,girl,looks,cup,State point,,
03-05-2021 10:11:12.120,03-05-2021,10:11:12,00:00:00.120,0.120,0.000,talk,Event log0001,girl,looks,,State stop,,
03-05-2021 10:11:12.120,03-05-2021,10:11:12,00:00:00.120,0.120,0.120,talk,Event log0001,girl,looks,cup,State start,,
03-05-2021 10:11:12.200,03-05-2021,10:11:12,00:00:00.200,0.200,0.000,talk,Event log0001,girl,nods,,Point,,
03-05-2021 10:11:12.240,03-05-2021,10:11:12,00:00:00.240,0.240,0.000,talk,Event log0001,boy,looks,girl,State stop,,
03-05-2021 10:11:12.240,03-05-2021,10:11:12,00:00:00.240,0.240,0.000,talk,Event log0001,girl,looks,cup,State stop,,
03-05-2021 10:11:12.240,03-05-2021,10:11:12,00:00:00.240,0.240,0.000,talk,Event log0001,,,,,,
"""
EXPECTED = Labels([row(1, 3, "bird", note="far"), row(4, 6, "cup"), row(3, 6, "girl", "boy")])


def _decimal_commas(text: str) -> str:
    lines = (line.replace(",", ";") for line in text.splitlines())
    return "\n".join(line.replace(".0", ",0").replace(".1", ",1").replace(".2", ",2") for line in lines)


def _older(text: str) -> str:
    names = {"Time_Relative_sf": "Relative Time (seconds)", "Event_Type": "Event Type", "Modifier_1": "Modifier 1"}
    for ours, theirs in names.items():
        text = text.replace(ours, theirs)
    return text


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16-le"])
@pytest.mark.parametrize("text", [LOG, LOG.replace(",", "\t"), _decimal_commas(LOG), _older(LOG)])
def test_all_dialects_hold_the_same_labels(tmp_path: Path, text: str, encoding: str) -> None:
    path = tmp_path / "log.txt"
    path.write_text(text, encoding=encoding)
    imported = Observer().read(path, exchange(TEN, modifier="1"))
    assert imported.labels == EXPECTED
    assert [note.partition(": ")[2] for note in imported.notes] == ["left out: 2 points without a length."]


def test_behaviours_are_the_targets_where_there_are_no_modifiers(tmp_path: Path) -> None:
    """And without a column of subjects, they are those of the clip's only one."""
    text = "Time_Relative_sf,Behavior,Event_Type\n0,bird,State start\n0.12,bird,State stop\n0.12,cup,State start\n"
    alone = Exchange(timeline=timeline_of(TEN), rate_hz=25.0, subjects=("girl",), targets=("bird", "cup"))
    imported = Observer().read(write_text(tmp_path / "log.txt", text), alone)
    assert imported.labels == Labels([row(1, 3, "bird"), row(4, 10, "cup")])
    assert ["never stops" in note for note in imported.notes] == [True]
    with pytest.raises(VfoaError, match="unknown subject 'No focal subject'"):  # of several people, nobody says whose
        Observer().read(tmp_path / "log.txt", exchange(TEN))


def test_a_modifier_that_is_missing_leaves_the_behaviour(tmp_path: Path) -> None:
    text = LOG.replace("boy,looks,girl", "boy,cup,NA")
    imported = Observer().read(write_text(tmp_path / "log.txt", text), exchange(TEN, modifier="1"))
    assert imported.labels.of("boy") == (row(3, 6, "cup", "boy"),)


def test_modifiers_are_read_as_they_are(tmp_path: Path) -> None:
    """What is in brackets is the key of a modifier in BORIS, not here."""
    path = write_text(tmp_path / "log.txt", LOG.replace("bird", "toy (red)").replace("cup", "toy (blue|big)"))
    renamed = {"toy (red)": "bird", "toy (blue|big)": "cup"}
    assert Observer().read(path, exchange(TEN, modifier="1", renamed=renamed)).labels == EXPECTED


def test_one_of_several_observations_is_chosen(tmp_path: Path) -> None:
    lines = LOG.splitlines(keepends=True)
    path = write_text(tmp_path / "log.txt", LOG + "".join(lines[1:]).replace(",talk,", ",walk,").replace("bird", "cup"))
    with pytest.raises(VfoaError, match="'talk', 'walk'; expected --observation"):
        Observer().read(path, exchange(TEN, modifier="1"))
    labels = Observer().read(path, exchange(TEN, modifier="1", observation="walk")).labels
    assert labels.of("girl")[0].label.target == "cup"


@pytest.mark.parametrize(
    ("changed", "into", "place"),
    [
        ("Event_Type", "Kind", "log.txt:1: .*no event_type"),
        ("girl,looks,bird,State start", "girl,looks,bird,State begin", "log.txt:2: Event_Type: found 'State begin'"),
        ("girl,looks,bird,State start", "girl,looks,bird,Point", "log.txt:5: 'looks' of 'girl' stops"),
        ("girl,looks,,State stop", "girl,looks,,Point", "log.txt:6: 'looks' of 'girl' starts"),
        ("State start,far,", "State start", "log.txt:2: found 12 cells; expected 13"),
        ("00:00:00.080,0.080", "00:00:00.080,0:80", "log.txt:3: Time_Relative_sf: found '0:80'"),
        ("girl,looks,bird", "girl,looks,kite", "0.000 s: unknown target 'kite'"),
    ],
)
def test_what_cannot_be_read_is_refused_with_its_place(tmp_path: Path, changed: str, into: str, place: str) -> None:
    assert changed in LOG
    path = write_text(tmp_path / "log.txt", LOG.replace(changed, into, 1))
    with pytest.raises(VfoaError, match=place):
        Observer().read(path, exchange(TEN, modifier="1"))
