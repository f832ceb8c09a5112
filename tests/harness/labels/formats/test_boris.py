"""BORIS's projects, as its own tests have them."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import pytest

from harness.labels.formats.boris import Boris
from harness.labels.labels import LabelRange, Labels
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
    with pytest.raises(VfoaError, match=r"found the observations 'monday', 'tuesday'.*--observation NAME"):
        Boris().read(path, exchange())
    with pytest.raises(VfoaError, match=r"--observation: no 'mnday'.*'monday'"):
        Boris().read(path, exchange(observation="mnday"))
    assert Boris().read(path, exchange(observation="monday")).labels.ranges == ROWS


def test_the_offset_of_the_medium_is_taken_off_and_said(tmp_path: Path) -> None:
    later = [[event[0] + 2, *event[1:]] for event in TALK]
    path = project(tmp_path / "a.boris", offset=2.0, talk=later)
    imported = Boris().read(path, exchange())
    assert imported.labels.ranges == ROWS
    assert f"{path}: an offset of -2 s is added to its times." in imported.notes
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
        ('{"observations": {"a": {"events": [[0, "girl", "bird"], [1, "girl", "cup"]]}}}', "overlap"),
        ('{"observations": {"a": {"type": "IMAGES", "events": [[NaN, "girl", "bird", "", ""]]}}}', "event 1: found"),
        ('{"observations": {"a": {"time offset": "noon", "events": []}}}', "time offset: found 'noon'"),
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


def _observed(path: Path, *events: tuple[float, str, str], sets: tuple[str, ...] = (), **observation: Any) -> Path:
    """A project with one observation: ``(seconds, behaviour, modifiers)`` of the girl."""
    rows = [[time, "girl", behaviour, modifiers, "", -1] for time, behaviour, modifiers in events]
    modifiers = {str(n): {"name": name, "type": 0, "values": []} for n, name in enumerate(sets)}
    codes = sorted({behaviour for _, behaviour, _ in events})
    ethogram = {str(n): {"code": code, "type": "State event", "modifiers": modifiers} for n, code in enumerate(codes)}
    observed = {"type": "MEDIA", "events": rows, **observation}
    return write_text(path, json.dumps({"behaviors_conf": ethogram, "observations": {"o": observed}}))


LOOKS = ((0.0, "look", "bird"), (0.08, "look", "bird"), (0.08, "look", "cup"), (0.16, "look", "cup"))
TURNS = (row(1, 2, "bird"), row(3, 4, "cup"))


@pytest.mark.parametrize(
    ("events", "sets", "modifier"),
    [
        (LOOKS, ("what",), "what"),
        (LOOKS, ("",), "1"),  # a set without a name
        ([(t, b, f"fast|{m}") for t, b, m in LOOKS], ("how", "what"), "what"),
        ([(t, b, f" {m} (k)|None") for t, b, m in LOOKS], ("what", "how"), "what"),  # spaces, a key, nothing chosen
        ([(0.0, "bird", ""), (0.079, "bird", ""), (0.08, "look", "cup"), (0.16, "look", "cup")], ("what",), "what"),
    ],
    ids=["one set", "no name", "second set", "spaces and key", "some behaviours without"],
)
def test_a_set_of_modifiers_names_the_targets(
    events: list[tuple[float, str, str]], sets: tuple[str, ...], modifier: str, tmp_path: Path
) -> None:
    path = _observed(tmp_path / "a.boris", *events, sets=sets)
    assert Boris().read(path, exchange(modifier=modifier)).labels.ranges == TURNS


def test_modifiers_that_nobody_said_anything_about_are_refused(tmp_path: Path) -> None:
    path = _observed(tmp_path / "a.boris", *LOOKS, sets=("looks at",))
    with pytest.raises(VfoaError, match=r"\(bird, cup\).*--modifier 'looks at' .* --modifier"):
        Boris().read(path, exchange())
    with pytest.raises(VfoaError, match=r"--modifier: no 'looksat'.*'looks at'"):
        Boris().read(path, exchange(modifier="looksat"))


def test_modifiers_are_left_out_on_demand_and_still_pair_states(tmp_path: Path) -> None:
    events = [(0.0, "bird", "fast"), (0.08, "bird", "fast"), (0.08, "bird", "slow"), (0.16, "bird", "slow")]
    path = _observed(tmp_path / "a.boris", *events, sets=("how",))
    assert Boris().read(path, exchange(modifier="none")).labels.ranges == (row(1, 2, "bird"), row(3, 4, "bird"))


@pytest.mark.parametrize("modifiers", [("bird", "cup", "bird", "cup"), ("bird", "cup", "cup", "bird")])
def test_states_of_one_subject_that_overlap_are_refused(modifiers: tuple[str, ...], tmp_path: Path) -> None:
    events = [(time, "look", modifier) for time, modifier in zip((0.0, 0.04, 0.08, 0.12), modifiers, strict=True)]
    with pytest.raises(VfoaError, match="overlap"):
        Boris().read(_observed(tmp_path / "a.boris", *events, sets=("what",)), exchange(modifier="what"))


def test_a_state_without_a_stop_lasts_to_the_end_of_the_clip(tmp_path: Path) -> None:
    path = _observed(tmp_path / "a.boris", (0.0, "bird", ""), (0.08, "bird", ""), (0.08, "cup", ""))
    imported = Boris().read(path, exchange())
    assert imported.labels.ranges == (row(1, 2, "bird"), row(3, 50, "cup"))
    (note,) = (note for note in imported.notes if "never stops" in note)
    assert "0.080 s: 'cup' of 'girl'" in note


def _at(begin_s: float) -> list[tuple[float, str, str]]:
    return [(begin_s + time, modifier, "") for time, _, modifier in LOOKS]


@pytest.mark.parametrize(
    ("begin_s", "observation"),
    [
        (5.0, {"time offset": 5.0}),
        (45_296.5, {"time offset": "45296.5"}),  # the time of day
        (-2.0, {"time offset": -2.0}),
        (9.0, {"type": "LIVE", "file": {}, "time offset": 9.0}),
        (7.5, {"time offset": 5.0, "file": {"1": ["a.mp4"]}, "media_info": {"offset": {"1": 2.5}}}),
        (
            1_718_000_002.0,
            {
                "time offset": 2.0,
                "file": {"1": ["/v/a.mp4"]},
                "media_creation_date_as_offset": True,
                "media_info": {"media_creation_time": {"/v/a.mp4": 1_718_000_000}},
            },
        ),
        (
            13.0,  # not asked for: its times are those of the film
            {
                "time offset": 13.0,
                "file": {"1": ["a.mp4"]},
                "media_creation_date_as_offset": False,
                "media_info": {"media_creation_time": {"a.mp4": 1_718_000_000}},
            },
        ),
    ],
    ids=["seconds", "time of day", "negative", "live", "and a player's", "epoch", "creation not used"],
)
def test_what_boris_adds_to_each_time_is_taken_off_and_said(
    begin_s: float, observation: dict[str, Any], tmp_path: Path
) -> None:
    path = _observed(tmp_path / "a.boris", *_at(begin_s), **observation)
    imported = Boris().read(path, exchange())
    assert imported.labels.ranges == TURNS
    assert f"{path}: an offset of {-begin_s!r} s is added to its times.".replace(".0 s", " s") in imported.notes
    assert Boris().read(path, exchange(offset=begin_s)).labels.ranges == TURNS


FILMS = {"side.mp4": 10.0, "front.mp4": 20.0, "C:\\v\\left.mp4": 30.0, "/v/right.mp4": 40.0}


@pytest.mark.parametrize(
    ("begin_s", "players", "offsets", "own"),
    [
        (3.0, {"1": ["side.mp4"], "2": ["front.mp4"]}, {"1": 0.0, "2": 3.0}, ["front.mp4"]),
        (10.0, {"1": ["side.mp4", "front.mp4"]}, {"1": 0.0}, ["front.mp4"]),  # one after the other
        (31.5, {"1": ["front.mp4"], "2": ["side.mp4", "front.mp4", "/v/right.mp4"]}, {"2": 1.5}, ["right.mp4"]),
        (2.0, {"1": ["/v/right.mp4"], "2": ["C:\\v\\left.mp4"]}, {"1": 9.0, "2": 2.0}, ["left.mp4", "right.mp4"]),
        (2.0, {"1": ["another.mp4"], "2": []}, {"1": 2.0}, ["front.mp4"]),  # the only film: a copy of the clip's
    ],
    ids=["second player", "queue", "queue of the second", "left of two views", "another name"],
)
def test_the_film_that_shows_the_clip_counts(
    begin_s: float, players: dict[str, list[str]], offsets: dict[str, float], own: list[str], tmp_path: Path
) -> None:
    media = {"length": FILMS, "offset": offsets}
    path = _observed(tmp_path / "a.boris", *_at(begin_s), file=players, media_info=media)
    assert Boris().read(path, exchange(films=dict.fromkeys(own, 0.0))).labels.ranges == TURNS


def test_the_film_is_asked_for_where_none_is_the_clips_own(tmp_path: Path) -> None:
    media = {"length": FILMS, "offset": {"1": 0.0, "2": 3.0}}
    files = {"1": ["side.mp4"], "2": ["front.mp4"]}
    path = _observed(tmp_path / "a.boris", *_at(3.0), file=files, media_info=media)
    with pytest.raises(VfoaError, match=r"found the films side\.mp4, front\.mp4.*--film NAME"):
        Boris().read(path, exchange())
    with pytest.raises(VfoaError, match=r"--film: no 'frnt\.mp4'.*'front\.mp4'"):
        Boris().read(path, exchange(film="frnt.mp4"))
    assert Boris().read(path, exchange(film="front.mp4")).labels.ranges == TURNS
    assert Boris().read(path, exchange(offset=3.0)).labels.ranges == TURNS


def test_pictures_are_found_by_their_numbers(tmp_path: Path) -> None:
    rows = [(1, "bird"), (3, "bird"), (3, "cup"), (5, "cup")]
    events = [[float("nan"), "girl", what, "", "", number, f"p/{number}.png"] for number, what in rows]
    observation = {"type": "IMAGES", "events": events, "directories_list": ["p"], "time offset": 7.0}
    path = write_text(tmp_path / "a.boris", json.dumps({"observations": {"o": observation}}))
    every_tenth = PlainClip(frames=range(10, 510, 10), rate_hz=None)
    imported = Boris().read(path, exchange(every_tenth))
    assert imported.labels.ranges == (row(10, 20, "bird"), row(30, 40, "cup"))


AGGREGATED = "Observation id,Observation date,Description,Observation type,Source,Time offset (s),Coding duration,"
AGGREGATED += "Media duration (s),FPS (frame/s),Subject,Observation duration by subject by observation,Behavior,"
AGGREGATED += (
    "Behavioral category,Modifier #1,Modifier #2,Behavior type,Start (s),Stop (s),Duration (s),Media file name,"
)
AGGREGATED += "Image index start,Image index stop,Image file path start,Image file path stop,Comment start,Comment stop"
TABULAR = "Observation id,Observation date,Description,Observation duration,Observation type,Source,Time offset (s),"
TABULAR += "Media duration (s),FPS,Subject,Behavior,Behavioral category,Modifier #1,Behavior type,Time,Media file name,"
TABULAR += "Image index,Image file path,Comment"
"""The columns of BORIS 8 and 9, of two sets of modifiers and of one."""
NAMES_7 = (
    "Observation id,Observation date,Description,Media file,Total length,FPS,a,Subject,Behavior,Behavioral category,"
)
NAMES_7 += "Modifiers,Behavior type,Start (s),Stop (s),Duration (s),Comment start,Comment stop"
ABOVE_7 = (
    "Observation id\to\t\t\n\t\t\t\nMedia file(s)\t\t\t\n\t\t\t\nPlayer #1\tfront.mp4\t\t\n\t\t\t\n"
    "Time offset (s)\t2.0\t\t\n"
)
NAMES_7_TABULAR = "Time\tMedia file path\tTotal length\tFPS\tSubject\tBehavior\tBehavioral category\tComment\tStatus"
ALL_OF_TALK = (
    ("girl", "cup", 0.0, 0.08, ""),
    ("girl", "bird", 0.08, 0.16, "eyes shut"),
    ("boy", "cup", 0.03, 0.12, ""),
)


def _table(names: str, separator: str, *rows: dict[str, object], above: str = "") -> str:
    listed = names.split("," if "," in names else "\t")
    cells = (listed, *([str(row.get(name, "")) for name in listed] for row in rows))
    return above + "".join(separator.join(each) + "\n" for each in cells)


def _aggregated(begin_s: float = 0.0, **more: object) -> list[dict[str, object]]:
    states = [
        {"Start (s)": f"{begin_s + start:.3f}", "Stop (s)": f"{begin_s + stop:.3f}", "Behavior type": "STATE"}
        | {"Subject": who, "Behavior": what, "Comment start": said, "Observation id": "o", **more}
        for who, what, start, stop, said in ALL_OF_TALK
    ]
    nod = {"Behavior type": "POINT", "Start (s)": "0.1", "Stop (s)": "0.1", "Behavior": "nod", "Subject": "girl"}
    return [*states, {"Observation id": "o", **more, **nod}]


def _tabular(begin_s: float = 0.0, type_column: str = "Behavior type", **more: object) -> list[dict[str, object]]:
    ends = [
        (begin_s + time, {type_column: kind, "Subject": who, "Behavior": what, "Comment": said})
        for who, what, start, stop, said in ALL_OF_TALK
        for time, kind in ((start, "START"), (stop, "STOP"))
    ]
    nod = (begin_s + 0.1, {type_column: "POINT", "Subject": "girl", "Behavior": "nod"})
    return [
        {"Observation id": "o", "Time": f"{time:.3f}", **cells, **more}
        for time, cells in sorted([*ends, nod], key=lambda end: end[0])
    ]


SOURCE = {
    "Source": "player #1:C:\\v\\side.mp4;/v/front.mp4|player #2:other.mp4",
    "Media duration (s)": "10.000;5.000|15.000",
}
EXPORTS = {
    "aggregated": _table(AGGREGATED, "\t", *_aggregated()),
    "aggregated CSV": _table(AGGREGATED, ",", *_aggregated(5.0, **{"Time offset (s)": "5.0"})),
    "aggregated, a queue": _table(AGGREGATED, "\t", *_aggregated(10.0, **SOURCE)),
    "aggregated of BORIS 7": _table(NAMES_7, "\t", *_aggregated(**{"Media file": "/v/front.mp4"})),
    "live": _table(AGGREGATED, ",", *_aggregated(**{"Observation type": "Live observation", "Source": "NA"})),
    "tabular": _table(TABULAR, ",", *_tabular()),
    "tabular, offset and queue": _table(TABULAR, "\t", *_tabular(13.0, **SOURCE, **{"Time offset (s)": "3"})),
    "tabular of BORIS 7": _table(NAMES_7_TABULAR, "\t", *_tabular(2.0, "Status"), above=ABOVE_7),
}


@pytest.mark.parametrize("name", EXPORTS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_exported_tables_are_read_as_the_project(name: str, encoding: str, tmp_path: Path) -> None:
    path = write_bytes(tmp_path / "a.tsv", EXPORTS[name].encode(encoding))
    imported = Boris().read(path, exchange(films={"front.mp4": 0.0}))
    assert imported.labels.ranges == ROWS
    assert f"{path}: 1 point events have no length and are left out." in imported.notes


BORIS_8_TABULAR = """\
talk 0.160 Media_file(s) #talk.mp4 0.0 2.000 25.000 girl cup . START 0.000 talk.mp4 0 NA .
talk 0.160 Media_file(s) #talk.mp4 0.0 2.000 25.000 boy cup . START 0.030 talk.mp4 0 NA .
talk 0.160 Media_file(s) #talk.mp4 0.0 2.000 25.000 girl bird . START 0.080 talk.mp4 2 NA eyes_shut
talk 0.160 Media_file(s) #talk.mp4 0.0 2.000 25.000 girl cup . STOP 0.080 talk.mp4 2 NA .
talk 0.160 Media_file(s) #talk.mp4 0.0 2.000 25.000 girl nod . POINT 0.100 talk.mp4 2 NA .
talk 0.160 Media_file(s) #talk.mp4 0.0 2.000 25.000 boy cup . STOP 0.120 talk.mp4 3 NA .
talk 0.160 Media_file(s) #talk.mp4 0.0 2.000 25.000 girl bird . STOP 0.160 talk.mp4 4 NA .
later 0.200 Media_file(s) #talk.mp4 100.0 2.000 25.000 girl cup . START 100.000 Not_found 0 NA .
later 0.200 Media_file(s) #talk.mp4 100.0 2.000 25.000 girl cup . STOP 100.200 Not_found 0 NA .
queue 0.200 Media_file(s) #first.mp4;talk.mp4 0.0 2.000;2.000 25.000;25.000 girl cup . START 2.000 talk.mp4 0 NA .
queue 0.200 Media_file(s) #first.mp4;talk.mp4 0.0 2.000;2.000 25.000;25.000 girl cup . STOP 2.200 talk.mp4 0 NA .
"""
BORIS_8_AGGREGATED = """\
looks Media_file #talk.mp4 0.0 0.200 2.000 25.000 girl 0.2 look Not_defined bird STATE 0.000 0.080 0.080 talk.mp4 0 0
looks Media_file #talk.mp4 0.0 0.200 2.000 25.000 girl 0.2 look Not_defined cup STATE 0.080 0.200 0.120 talk.mp4 0 0
"""
"""What the code of BORIS 8.27.4 wrote of a project of the test's; of each row, date and description are left out here,
a blank is ``_``, ``player #1:`` is ``#``, and a cell without text is ``.``."""


def _of_boris_8(names: str, rows: str, separator: str) -> str:
    cells = [
        ["" if cell == "." else cell.replace("_", " ").replace("#", "player #1:") for cell in row.split(" ")]
        for row in rows.splitlines()
    ]
    whole = [[row[0], "2024-09-01 10:00:00.000", "d", *row[1:]] for row in cells]
    columns = names.split(",")
    lines = [columns, *([*row, *[""] * (len(columns) - len(row))] for row in whole)]
    return "".join(separator.join(line) + "\r\n" for line in lines)


@pytest.mark.parametrize("separator", ["\t", ","])
@pytest.mark.parametrize(
    ("observation", "ranges", "note"),
    [
        ("talk", ROWS, "1 point events have no length and are left out."),
        ("later", (row(1, 5, "cup"),), "an offset of -100 s is added to its times."),
        ("queue", (row(1, 5, "cup"),), "an offset of -2 s is added to its times."),
    ],
)
def test_events_that_boris_8_exported_are_read(
    observation: str, ranges: tuple[LabelRange, ...], note: str, separator: str, tmp_path: Path
) -> None:
    columns = TABULAR.replace("Modifier #1,", "")
    path = write_text(tmp_path / "a.tsv", _of_boris_8(columns, BORIS_8_TABULAR, separator))
    imported = Boris().read(path, exchange(observation=observation, films={"talk.mp4": 0.0}))
    assert (imported.labels.ranges, imported.notes) == (ranges, (f"{path}: {note}",))


@pytest.mark.parametrize("separator", ["\t", ","])
def test_states_that_boris_8_aggregated_are_read(separator: str, tmp_path: Path) -> None:
    columns = AGGREGATED.replace("Modifier #2,", "")
    path = write_text(tmp_path / "a.tsv", _of_boris_8(columns, BORIS_8_AGGREGATED, separator))
    imported = Boris().read(path, exchange(modifier="1", films={"talk.mp4": 0.0}))
    assert (imported.labels.ranges, imported.notes) == ((row(1, 2, "bird"), row(3, 5, "cup")), ())


def test_an_export_without_an_event_says_so(tmp_path: Path) -> None:
    """BORIS leaves out events beyond the film, all of them if the observation has a time offset."""
    path = write_text(tmp_path / "a.tsv", _of_boris_8(TABULAR, "", "\t"))
    with pytest.raises(VfoaError, match=r"a\.tsv: no observations with events"):
        Boris().read(path, exchange())


def test_modifiers_of_an_export_are_chosen_by_number(tmp_path: Path) -> None:
    rows = _aggregated(**{"Modifier #1": "fast"})
    for each in rows:
        each |= {"Modifier #2": each["Behavior"], "Behavior": "look"}
    path = write_text(tmp_path / "a.tsv", _table(AGGREGATED, "\t", *rows[:3]))
    with pytest.raises(VfoaError, match=r"expected --modifier 1 .* --modifier none"):
        Boris().read(path, exchange())
    assert Boris().read(path, exchange(modifier="2")).labels.ranges == ROWS


def test_an_observation_of_an_export_is_chosen(tmp_path: Path) -> None:
    other = _aggregated(1.0, **{"Observation id": "p"})
    path = write_text(tmp_path / "a.csv", _table(AGGREGATED, ",", *_aggregated(), *other))
    with pytest.raises(VfoaError, match=r"found the observations 'o', 'p'.*--observation NAME"):
        Boris().read(path, exchange())
    assert Boris().read(path, exchange(observation="o")).labels.ranges == ROWS


def test_exported_pictures_are_found_by_their_numbers(tmp_path: Path) -> None:
    rows = [
        {"Observation id": "o", "Subject": "girl", "Behavior": what, "Behavior type": "STATE"}
        | {"Start (s)": "NA", "Stop (s)": "NA", "Image index start": first, "Image index stop": stop}
        for what, first, stop in (("bird", 1, 3), ("cup", 3, 5))
    ]
    path = write_text(tmp_path / "a.tsv", _table(AGGREGATED, "\t", *rows))
    assert Boris().read(path, exchange()).labels.ranges == (row(1, 2, "bird"), row(3, 4, "cup"))


def test_the_film_of_an_old_export_without_lengths_is_asked_for(tmp_path: Path) -> None:
    later = _aggregated(10.0, **{"Media file": "front.mp4"})
    path = write_text(tmp_path / "a.tsv", _table(NAMES_7, "\t", *later, *_aggregated(**{"Media file": "side.mp4"})))
    with pytest.raises(VfoaError, match=r"side\.mp4: found 'None'.*--offset SECONDS"):
        Boris().read(path, exchange(films={"front.mp4": 0.0}))
    assert Boris().read(path, exchange(offset=10.0)).labels.ranges == ROWS


def test_a_queue_is_known_by_its_lengths_where_events_name_all_of_its_films(tmp_path: Path) -> None:
    lengths = {"Media duration (s)": "10.000;5.000"}
    before = _aggregated(0.0, **lengths, **{"Media file name": "side.mp4"})
    after = _aggregated(10.0, **lengths, **{"Media file name": "front.mp4"})
    path = write_text(tmp_path / "a.tsv", _table(AGGREGATED, "\t", *before, *after))
    imported = Boris().read(path, exchange(films={"front.mp4": 0.0}))
    assert imported.labels.ranges == ROWS
    path = write_text(tmp_path / "b.tsv", _table(AGGREGATED, "\t", *after))
    with pytest.raises(VfoaError, match=r"film 1 of those that no event names: found 'None'; .* --offset SECONDS"):
        Boris().read(path, exchange(films={"front.mp4": 0.0}))
    assert Boris().read(path, exchange(offset=10.0)).labels.ranges == ROWS


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("PK\x03\x04 a workbook", "a workbook, HTML, SQL or SDIS, such as BORIS exports; expected TSV or CSV"),
        ("<table><tr><td>Behavior</td></tr></table>", "expected TSV or CSV in BORIS's export, or its project"),
        ("Observation id\tSubject\tBehavior\tDuration mean (s)\no\tgirl\tbird\t1\n", "a.tsv:1: no column 'Start (s)'"),
        (_table(AGGREGATED, "\t", {**_aggregated()[0], "Stop (s)": "0:01"}), "a.tsv:2: Stop (s): found '0:01'"),
        (
            _table(AGGREGATED, "\t", {**_aggregated()[0], "Behavior type": "x"}),
            "a.tsv:2: the type of a behaviour: found 'X'",
        ),
    ],
    ids=["workbook", "HTML", "time budget", "a time", "a type"],
)
def test_other_tables_are_named_with_what_to_export(content: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(VfoaError) as error:
        Boris().read(write_text(tmp_path / "a.tsv", content), exchange())
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_it_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"a\.boris: this format cannot be written.*--format"):
        Boris().write(tmp_path / "a.boris", Labels(ROWS), exchange())


@pytest.mark.parametrize("offset", [1e300, -1e300, float("nan"), float("inf")])
def test_an_offset_beyond_all_clips_is_refused(offset: float) -> None:
    with pytest.raises(VfoaError, match=r"--offset: found .*1e"):
        exchange(offset=offset)
