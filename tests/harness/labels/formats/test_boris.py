"""BORIS's projects, as its own tests have them."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import pytest

from harness.labels.formats.boris import Boris
from harness.labels.labels import Labels
from tests.disk import write_bytes, write_text
from tests.exchanges import PlainClip, exchange, row
from vfoa.errors import VfoaError

TALK = [
    [0.08, "girl", "bird", "", "eyes shut", 2],
    [0.03, "boy", "cup", "", "", 0],
    [0.0, "girl", "cup", "", "", 0],
    [0.08, "girl", "cup", "", "", 2],
    [0.1, "girl", "nod", "", "", 3],
    [0.12, "boy", "cup", "", "", 3],
    [0.16, "girl", "bird", "", "", 4],
]
ROWS = (row(1, 2, "cup"), row(2, 3, "cup", "boy"), row(3, 4, "bird", note="eyes shut"))


def project(path: Path, *, offset: float = 0.0, **observations: list[list[Any]]) -> Path:
    behaviours = [("bird", "State event"), ("cup", "State event"), ("nod", "Point event")]
    return write_text(
        path,
        json.dumps(
            {
                "project_format_version": "7.0",
                "behaviors_conf": {str(n): {"code": code, "type": kind} for n, (code, kind) in enumerate(behaviours)},
                "observations": {
                    name: {"type": "MEDIA", "events": events, "media_info": {"offset": {"1": offset}}}
                    for name, events in observations.items()
                },
            }
        ),
    )


def test_a_project_is_read(tmp_path: Path) -> None:
    path = project(tmp_path / "a.boris", talk=TALK)
    imported = Boris().read(path, exchange())
    assert imported.labels.ranges == ROWS
    assert imported.notes == (f"{path}: 1 point events have no length and are left out.",)
    packed = write_bytes(tmp_path / "b.boris.gz", gzip.compress(path.read_bytes()))
    assert Boris().read(packed, exchange()).labels.ranges == ROWS


def test_one_of_several_observations_is_chosen(tmp_path: Path) -> None:
    path = project(tmp_path / "a.boris", monday=TALK, tuesday=[])
    with pytest.raises(VfoaError, match="found the observations 'monday', 'tuesday'; expected --observation NAME"):
        Boris().read(path, exchange())
    with pytest.raises(VfoaError, match="--observation: no 'mnday'; did you mean 'monday'"):
        Boris().read(path, exchange(observation="mnday"))
    assert Boris().read(path, exchange(observation="monday")).labels.ranges == ROWS


def test_the_offset_of_the_medium_is_taken_off_and_said(tmp_path: Path) -> None:
    later = [[event[0] + 2, *event[1:]] for event in TALK]
    path = project(tmp_path / "a.boris", offset=2.0, talk=later)
    imported = Boris().read(path, exchange())
    assert imported.labels.ranges == ROWS
    assert f"{path}: the media offset of -2 s is added." in imported.notes
    told = Boris().read(path, exchange(offset=2.0))
    assert told.labels.ranges == ROWS
    assert "is not used" in told.notes[-1]


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("{", "not JSON"),
        ('{"a": 1}', "no observations"),
        ('{"observations": {"a": {}}}', "observation 'a': no events"),
        ('{"observations": {"a": {"events": [["x", "girl", "bird"]]}}}', "event 1: found"),
        ('{"observations": {"a": {"events": [[1, "girl", "bird"]]}}}', "starts at 1.000 s and never stops"),
        ('{"observations": {"a": {"events": [[1, "gril", "bird"], [2, "gril", "bird"]]}}}', "did you mean 'girl'"),
    ],
)
def test_a_mistake_is_one_line(tmp_path: Path, content: str, said: str) -> None:
    with pytest.raises(VfoaError, match=r"a\.boris: ") as error:
        Boris().read(write_text(tmp_path / "a.boris", content), exchange())
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_every_unknown_name_is_told_at_once(tmp_path: Path) -> None:
    events = [
        [n, who, what] for n, who, what in [(0, "gril", "brid"), (1, "gril", "brid"), (2, "boy", "x"), (3, "boy", "x")]
    ]
    path = project(tmp_path / "a.boris", talk=events)
    with pytest.raises(VfoaError) as error:
        Boris().read(path, exchange(PlainClip(frames=range(1, 200))))
    said = str(error.value)
    assert said.startswith(f"{path}: ")
    assert all(name in said for name in ("'gril'", "'brid'", "'x'", "did you mean 'girl'"))


def test_a_rename_of_no_use_is_a_note(tmp_path: Path) -> None:
    path = project(tmp_path / "a.boris", talk=TALK)
    notes = Boris().read(path, exchange(renamed={"brid": "cup"})).notes
    assert any("--rename brid: no such name in it; did you mean 'bird'" in note for note in notes)


def test_events_without_a_focal_subject_can_be_given_one(tmp_path: Path) -> None:
    path = project(tmp_path / "a.boris", talk=[[time, who.replace("girl", ""), *more] for time, who, *more in TALK])
    with pytest.raises(VfoaError, match="unknown subject 'No focal subject'"):
        Boris().read(path, exchange())
    assert Boris().read(path, exchange(renamed={"No focal subject": "girl"})).labels.ranges == ROWS


def test_it_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"a\.boris: this format cannot be written; expected another --format"):
        Boris().write(tmp_path / "a.boris", Labels(ROWS), exchange())


@pytest.mark.parametrize("offset", [1e300, -1e300, float("nan"), float("inf")])
def test_an_offset_beyond_all_clips_is_refused(offset: float) -> None:
    with pytest.raises(VfoaError, match=r"--offset: found .*; expected a number within 1e"):
        exchange(offset=offset)
