"""BORIS's projects, as its own tests have them, and the tables that it exports."""

from __future__ import annotations

import gzip
import json
from collections.abc import Sequence
from itertools import pairwise
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

LOOKS = ((0.0, "look", "bird"), (0.08, "look", "bird"), (0.08, "look", "cup"), (0.16, "look", "cup"))
TURNS = (row(1, 2, "bird"), row(3, 4, "cup"))


def _project(*, sets: Sequence[str] = (), **observations: Any) -> str:
    """A project; its behaviours are states with these sets of modifiers, but for "nod", which has no length."""
    modifiers = {str(n): {"name": name, "type": 0, "values": []} for n, name in enumerate(sets)}
    behaviours = {
        str(n): {"code": code, "type": "Point event" if code == "nod" else "State event", "modifiers": modifiers}
        for n, code in enumerate(("bird", "cup", "look", "nod"))
    }
    project = {"project_format_version": "7.0", "behaviors_conf": behaviours, "observations": observations}
    return json.dumps(project)


def _events(*events: tuple[float, str, str], begin_s: float = 0.0) -> list[list[Any]]:
    """Events ``(seconds, behaviour, modifiers)`` of the girl."""
    return [[begin_s + time, "girl", behaviour, modifiers, "", -1] for time, behaviour, modifiers in events]


def _looks(sets: Sequence[str] = ("what",), *events: tuple[float, str, str]) -> str:
    return _project(sets=sets, o={"type": "MEDIA", "events": _events(*(events or LOOKS))})


def _turns(begin_s: float, **observation: Any) -> str:
    """The turns as behaviours, from a time on, with more of the observation."""
    events = _events(*((time, what, "") for time, _, what in LOOKS), begin_s=begin_s)
    return _project(o={"type": "MEDIA", "events": events, **observation})


def _without_focal_subject() -> str:
    return _project(o={"events": [[time, str(who).replace("girl", ""), *more] for time, who, *more in TALK]})


def test_a_project_is_read(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.boris", _project(talk={"type": "MEDIA", "events": TALK}))
    imported = Boris().read(path, exchange())
    assert imported.labels.ranges == ROWS
    assert imported.notes == (f"{path}: left out: 1 point event without a length.",)
    packed = write_bytes(tmp_path / "b.boris.gz", gzip.compress(path.read_bytes()))
    assert Boris().read(packed, exchange()).labels.ranges == ROWS


def test_subjects_and_behaviours_may_be_left_out(tmp_path: Path) -> None:
    """A project of a study holds more than looks: in public ones, postures and speech of animals and of parents."""
    more = [[0.02, "aunt", "cup", "", ""], [0.05, "girl", "talks", "", ""], [0.09, "girl", "talks", "", ""]]
    path = write_text(tmp_path / "a.boris", _project(talk={"type": "MEDIA", "events": TALK + more}))
    with pytest.raises(VfoaError, match=r"unknown target 'talks'; .* 'aunt'; .*--rename THEIRS=OURS, or THEIRS= "):
        Boris().read(path, exchange())
    imported = Boris().read(path, exchange(renamed={"aunt": "", "talks": ""}))
    assert imported.labels.ranges == ROWS
    assert {note for note in imported.notes if "--rename" in note} == {
        f"{path}: left out: 1 label of {name!r} (--rename)." for name in ("aunt", "talks")
    }
    assert Boris().read(path, exchange(renamed={"aunt": "", "girl:talks": ""})).labels == imported.labels


def test_every_unknown_name_is_told_at_once(tmp_path: Path) -> None:
    names = [("gril", "brid"), ("gril", "brid"), ("boy", "x"), ("boy", "x")]
    talk = {"events": [[time, *pair] for time, pair in enumerate(names)]}
    path = write_text(tmp_path / "a.boris", _project(talk=talk))
    with pytest.raises(VfoaError) as error:
        Boris().read(path, exchange(PlainClip(frames=range(1, 200))))
    said = str(error.value)
    assert said.startswith(f"{path}: ")
    assert all(name in said for name in ("'gril'", "'brid'", "'x'", "did you mean 'girl'"))


@pytest.mark.parametrize(
    ("content", "how", "expected"),
    [
        (_project(monday={"events": TALK}, tuesday={"events": []}), {"observation": "monday"}, ROWS),
        (_without_focal_subject(), {"renamed": {"No focal subject": "girl"}}, ROWS),
        (_looks(), {"modifier": "what"}, TURNS),
        (_looks([""]), {"modifier": "1"}, TURNS),
        (_looks(["how", "what"], *((t, b, f"fast|{m}") for t, b, m in LOOKS)), {"modifier": "what"}, TURNS),
        (_looks(["what", "how"], *((t, b, f" {m} (k)|None") for t, b, m in LOOKS)), {"modifier": "what"}, TURNS),
        (_looks(["what"], (0.0, "bird", ""), (0.079, "bird", ""), *LOOKS[2:]), {"modifier": "what"}, TURNS),
        (_looks(["what", "how"], *((t, m, "None|fast") for t, _, m in LOOKS)), {"modifier": "what"}, TURNS),
        (
            _looks(["how"], *((time, "bird", modifiers) for time, _, modifiers in LOOKS)),
            {"modifier": "none"},
            (row(1, 2, "bird"), row(3, 4, "bird")),
        ),
    ],
    ids=[
        "one of several observations",
        "no focal subject",
        "modifiers",
        "a set without a name",
        "second set",
        "spaces, a key, nothing chosen",
        "some behaviours without modifiers",
        "none chosen of the set",
        "modifiers left out still pair states",
    ],
)
def test_what_names_the_targets_is_chosen(
    content: str, how: dict[str, Any], expected: tuple[LabelRange, ...], tmp_path: Path
) -> None:
    assert Boris().read(write_text(tmp_path / "a.boris", content), exchange(**how)).labels.ranges == expected


def test_a_state_without_a_stop_lasts_to_the_end_of_the_clip(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.boris", _looks(["what"], *((time, what, "") for time, _, what in LOOKS[:3])))
    imported = Boris().read(path, exchange())
    assert imported.labels.ranges == (row(1, 2, "bird"), row(3, 50, "cup"))
    (note,) = (note for note in imported.notes if "never stops" in note)
    assert "0.080 s: 'cup' of 'girl'" in note


def test_a_state_that_begins_after_the_clip_and_never_stops_is_left_out(tmp_path: Path) -> None:
    events = [*LOOKS[:2], (2.0, "look", "cup")]  # the clip's last frame lasts until 2 s
    path = write_text(tmp_path / "a.boris", _looks(["what"], *((time, what, "") for time, _, what in events)))
    imported = Boris().read(path, exchange())
    assert imported.labels.ranges == (row(1, 2, "bird"),)
    assert "left out: 1 label without a frame of the clip" in imported.notes[0]


def test_times_are_read_to_the_millisecond(tmp_path: Path) -> None:
    """As floating point numbers, 64.24 and 64.4 s are a little less, or more, than so many milliseconds."""
    events = [(time_s, "cup", "") for time_s in (64.24, 64.28, 64.4, 64.44)]
    path = write_text(tmp_path / "a.boris", _project(o={"type": "MEDIA", "events": _events(*events)}))
    imported = Boris().read(path, exchange(PlainClip(frames=range(2000)), gaps="none"))
    cups = [each for each in imported.labels.ranges if each.label.target == "cup"]
    assert cups == [row(1606, 1606, "cup"), row(1610, 1610, "cup")]


CREATED = {"media_info": {"media_creation_time": {"/v/a.mp4": 1_718_000_000}}, "file": {"1": ["/v/a.mp4"]}}


@pytest.mark.parametrize(
    ("begin_s", "observation"),
    [
        (5.0, {"time offset": 5.0}),
        (45_296.5, {"time offset": "45296.5"}),
        (-2.0, {"time offset": -2.0}),
        (2.5, {"media_info": {"offset": {"1": 2.5}}}),
        (9.0, {"type": "LIVE", "file": {}, "time offset": 9.0}),
        (7.5, {"time offset": 5.0, "file": {"1": ["a.mp4"]}, "media_info": {"offset": {"1": 2.5}}}),
        (1_718_000_002.0, {"time offset": 2.0, **CREATED, "media_creation_date_as_offset": True}),
        (13.0, {"time offset": 13.0, **CREATED, "media_creation_date_as_offset": False}),
    ],
    ids=["seconds", "time of day", "negative", "a player's", "live", "and a player's", "epoch", "creation not used"],
)
def test_what_boris_adds_to_each_time_is_taken_off_and_said(
    begin_s: float, observation: dict[str, Any], tmp_path: Path
) -> None:
    path = write_text(tmp_path / "a.boris", _turns(begin_s, **observation))
    imported = Boris().read(path, exchange())
    assert imported.labels.ranges == TURNS
    assert f"{path}: an offset of {-begin_s!r} s is added to its times.".replace(".0 s", " s") in imported.notes
    assert Boris().read(path, exchange(offset=begin_s)).labels.ranges == TURNS


FILMS = {"side.mp4": 10.0, "front.mp4": 20.0, "C:\\v\\left.mp4": 30.0, "/v/right.mp4": 40.0}
OTHERS = {"file": {"1": ["side.mp4"], "2": ["front.mp4"]}, "media_info": {"length": FILMS, "offset": {"2": 3.0}}}


@pytest.mark.parametrize(
    ("begin_s", "players", "offsets", "own"),
    [
        (3.0, {"1": ["side.mp4"], "2": ["front.mp4"]}, {"1": 0.0, "2": 3.0}, ["front.mp4"]),
        (10.0, {"1": ["side.mp4", "front.mp4"]}, {"1": 0.0}, ["front.mp4"]),  # one after the other
        (31.5, {"1": ["front.mp4"], "2": ["side.mp4", "front.mp4", "/v/right.mp4"]}, {"2": 1.5}, ["right.mp4"]),
        (2.0, {"1": ["/v/right.mp4"], "2": ["C:\\v\\left.mp4"]}, {"1": 9.0, "2": 2.0}, ["left.mp4", "right.mp4"]),
        (
            2.0,
            {"1": ["another.mp4"], "2": [], "3": 5},
            {"1": 2.0},
            ["front.mp4"],
        ),  # the only film: a copy of the clip's
    ],
    ids=["second player", "queue", "queue of the second", "left of two views", "another name"],
)
def test_the_film_that_shows_the_clip_counts(
    begin_s: float, players: dict[str, Any], offsets: dict[str, float], own: list[str], tmp_path: Path
) -> None:
    content = _turns(begin_s, file=players, media_info={"length": FILMS, "offset": offsets})
    path = write_text(tmp_path / "a.boris", content)
    assert Boris().read(path, exchange(films=dict.fromkeys(own, 0.0))).labels.ranges == TURNS


TWO_CREATED = {
    "media_info": {"media_creation_time": {"side.mp4": 3, "front.mp4": 70}, "length": FILMS},
    "media_creation_date_as_offset": True,
}


def test_times_count_from_the_creation_of_the_first_players_film(tmp_path: Path) -> None:
    """As ``boris/write_event.py`` adds it, whichever film shows the clip."""
    players = {"1": ["side.mp4"], "2": ["front.mp4"]}
    path = write_text(tmp_path / "a.boris", _turns(3.0, file=players, **TWO_CREATED))
    assert Boris().read(path, exchange(film="front.mp4")).labels.ranges == TURNS


@pytest.mark.parametrize(
    "observation",
    [
        {"time offset": "noon"},
        {"file": {"1": ["side.mp4", "front.mp4"]}, **TWO_CREATED},
        {"file": {"1": ["side.mp4"]}, "media_creation_date_as_offset": True},
        {"file": {"1": ["unknown.mp4", "front.mp4"]}},
    ],
    ids=["no time offset", "creation of several", "no creation", "no length"],
)
def test_a_given_offset_replaces_what_an_observation_does_not_say(observation: dict[str, Any], tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.boris", _turns(3.0, **observation))
    with pytest.raises(VfoaError, match=r"expected .*--offset SECONDS"):
        Boris().read(path, exchange(films={"front.mp4": 0.0}))
    assert Boris().read(path, exchange(films={"front.mp4": 0.0}, offset=3.0)).labels.ranges == TURNS


def test_films_of_one_name_are_told_apart_by_their_time_alone(tmp_path: Path) -> None:
    """Cameras give the same names to their films."""
    players, front = {"1": ["/side/a.mp4"], "2": ["/front/a.mp4"]}, {"films": {"a.mp4": 0.0}}
    path = write_text(tmp_path / "a.boris", _turns(3.0, file=players, media_info={"offset": {"2": 3.0}}))
    for how in (front, {"film": "a.mp4"}):
        with pytest.raises(VfoaError, match=r"/side/a\.mp4, /front/a\.mp4; expected --offset SECONDS"):
            Boris().read(path, exchange(**how))
        assert Boris().read(path, exchange(**how, offset=3.0)).labels.ranges == TURNS
    write_text(path, _turns(0.0, file=players))
    assert Boris().read(path, exchange(**front)).labels.ranges == TURNS


@pytest.mark.parametrize("how", [{"film": "front.mp4"}, {"offset": 3.0}])
def test_the_film_or_its_time_is_given_where_none_is_the_clips_own(how: dict[str, Any], tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.boris", _turns(3.0, **OTHERS))
    assert Boris().read(path, exchange(**how)).labels.ranges == TURNS


def test_films_before_the_clip_last_fractions_of_a_millisecond(tmp_path: Path) -> None:
    """Events are rounded to the millisecond."""
    clip, length_s = PlainClip(frames=range(31), rate_hz=30.0), 10.4774
    ends = [round(length_s + clip.time_ns(number) / 1e9, 3) for number in clip.frames]
    events = [
        (time_s, "bird" if number % 2 else "cup", "") for number, pair in enumerate(pairwise(ends)) for time_s in pair
    ]
    media = {"file": {"1": ["a.mp4", "front.mp4"]}, "media_info": {"length": {"a.mp4": length_s}}}
    path = write_text(tmp_path / "a.boris", _project(o={"type": "MEDIA", "events": _events(*events), **media}))
    labels = Boris().read(path, exchange(clip, films={"front.mp4": 0.0})).labels
    assert [(each.first_frame, each.last_frame) for each in labels.ranges] == [(n, n) for n in range(30)]


def test_pictures_are_found_by_their_numbers(tmp_path: Path) -> None:
    rows = [(1, "bird"), (3, "bird"), (3, "cup"), (5, "cup")]
    events = [[float("nan"), "girl", what, "", "", number, f"p/{number}.png"] for number, what in rows]
    observation = {"type": "IMAGES", "events": events, "directories_list": ["p"], "time offset": 7.0}
    path = write_text(tmp_path / "a.boris", json.dumps({"observations": {"o": observation}}))
    every_tenth = PlainClip(frames=range(10, 510, 10), rate_hz=None)
    imported = Boris().read(path, exchange(every_tenth))
    assert imported.labels.ranges == (row(10, 20, "bird"), row(30, 40, "cup"))


GENUINE = {name: Path(__file__).with_name(f"boris_8_{name}.tsv") for name in ("tabular", "aggregated")}
"""What the code of BORIS 8.27.4 wrote of a project of the test's; only date and description are filled in."""


@pytest.mark.parametrize("separator", ["\t", ","])
@pytest.mark.parametrize(
    ("name", "how", "ranges", "notes"),
    [
        ("tabular", {"observation": "talk"}, ROWS, ["left out: 1 point event without a length."]),
        ("tabular", {"observation": "later"}, (row(1, 5, "cup"),), ["an offset of -100 s is added to its times."]),
        ("tabular", {"observation": "queue"}, (row(1, 5, "cup"),), ["an offset of -2 s is added to its times."]),
        ("aggregated", {"modifier": "1"}, (row(1, 2, "bird"), row(3, 5, "cup")), []),
    ],
)
def test_what_boris_8_exported_is_read(
    name: str, how: dict[str, Any], ranges: tuple[LabelRange, ...], notes: list[str], separator: str, tmp_path: Path
) -> None:
    path = write_bytes(tmp_path / "a.tsv", GENUINE[name].read_bytes().replace(b"\t", separator.encode()))
    imported = Boris().read(path, exchange(**how, films={"talk.mp4": 0.0}))
    assert (imported.labels.ranges, imported.notes) == (ranges, tuple(f"{path}: {note}" for note in notes))


def _columns(name: str, sets: str) -> list[str]:
    """The columns of an export of BORIS 8 and 9 with these sets of modifiers."""
    columns = GENUINE[name].read_text(encoding="utf-8").splitlines()[0].replace("\tModifier #1", "")
    return columns.replace("\tBehavior type", f"\t{sets}\tBehavior type").split("\t")


AGGREGATED = _columns("aggregated", "Modifier #1\tModifier #2")
TABULAR = _columns("tabular", "Modifier #1")
AGGREGATED_7 = [
    *("Observation id", "Observation date", "Description", "Media file", "Total length", "FPS", "a", "Subject"),
    *("Behavior", "Behavioral category", "Modifiers", "Behavior type"),
    *("Start (s)", "Stop (s)", "Duration (s)", "Comment start", "Comment stop"),
]
TABULAR_7 = ["Time", "Media file path", "Total length", "FPS", "Subject", "Behavior", "Comment", "Status"]
ABOVE_7 = (
    "Observation id\to\t\t\n\t\t\t\nMedia file(s)\t\t\t\n\t\t\t\nPlayer #1\tfront.mp4\t\t\n\t\t\t\n"
    "Time offset (s)\t2.0\t\t\n"
)
ALL_OF_TALK = (
    ("girl", "cup", 0.0, 0.08, ""),
    ("girl", "bird", 0.08, 0.16, "eyes shut"),
    ("boy", "cup", 0.03, 0.12, ""),
)
"""Subject, behaviour, start and stop (s), and comment."""
Row = dict[str, object]


def _table(names: Sequence[str], *rows: Row, separator: str = "\t", above: str = "") -> str:
    cells = (names, *([str(row.get(name, "")) for name in names] for row in rows))
    return above + "".join(separator.join(each) + "\n" for each in cells)


def _aggregated(begin_s: float = 0.0, **more: object) -> list[Row]:
    """A row for each state, and one for a nod."""
    states: list[Row] = [
        {"Start (s)": f"{begin_s + start:.3f}", "Stop (s)": f"{begin_s + stop:.3f}", "Behavior type": "STATE"}
        | {"Subject": who, "Behavior": what, "Comment start": said, "Observation id": "o", **more}
        for who, what, start, stop, said in ALL_OF_TALK
    ]
    nod = {"Behavior type": "POINT", "Start (s)": "0.1", "Stop (s)": "0.1", "Behavior": "nod", "Subject": "girl"}
    return [*states, {"Observation id": "o", **more, **nod}]


def _tabular(begin_s: float = 0.0, type_column: str = "Behavior type", **more: object) -> list[Row]:
    """A row for each start, each stop, and a nod."""
    ends: list[tuple[float, Row]] = [
        (begin_s + time, {type_column: kind, "Subject": who, "Behavior": what, "Comment": said})
        for who, what, start, stop, said in ALL_OF_TALK
        for time, kind in ((start, "START"), (stop, "STOP"))
    ]
    nod: tuple[float, Row] = (begin_s + 0.1, {type_column: "POINT", "Subject": "girl", "Behavior": "nod"})
    return [
        {"Observation id": "o", "Time": f"{time:.3f}", **cells, **more}
        for time, cells in sorted([*ends, nod], key=lambda end: end[0])
    ]


def _with_modifiers() -> list[Row]:
    """A row for each state, with the target as the second modifier."""
    return [
        {**each, "Modifier #1": "fast", "Modifier #2": each["Behavior"], "Behavior": "look"}
        for each in _aggregated()[:3]
    ]


FRONT = {"films": {"front.mp4": 0.0}}
QUEUE = {
    "Source": "player #1:C:\\v\\side.mp4;/v/front.mp4|player #2:other.mp4",
    "Media duration (s)": "10.000;5.000|15.000",
}
LENGTHS = {"Media duration (s)": "10.000;5.000"}
SIDE = _aggregated(0.0, **LENGTHS, **{"Media file name": "side.mp4"})
QUEUED = _aggregated(10.0, **LENGTHS, **{"Media file name": "front.mp4"})
SIDE_FIRST_7 = [*_aggregated(10.0, **{"Media file": "front.mp4"}), *_aggregated(0.0, **{"Media file": "side.mp4"})]
EXPORTS = {
    "aggregated": _table(AGGREGATED, *_aggregated()),
    "aggregated CSV": _table(AGGREGATED, *_aggregated(5.0, **{"Time offset (s)": "5.0"}), separator=","),
    "aggregated, a queue": _table(AGGREGATED, *_aggregated(10.0, **QUEUE)),
    "aggregated of BORIS 7": _table(AGGREGATED_7, *_aggregated(0.0, **{"Media file": "/v/front.mp4"})),
    "live": _table(
        AGGREGATED, *_aggregated(0.0, **{"Observation type": "Live observation", "Source": "NA"}), separator=","
    ),
    "tabular": _table(TABULAR, *_tabular(), separator=","),
    "tabular, offset and queue": _table(TABULAR, *_tabular(13.0, **QUEUE, **{"Time offset (s)": "3"})),
    "tabular of BORIS 7": _table(TABULAR_7, *_tabular(2.0, "Status"), above=ABOVE_7),
}


@pytest.mark.parametrize("name", EXPORTS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_exported_tables_are_read_as_the_project(name: str, encoding: str, tmp_path: Path) -> None:
    path = write_bytes(tmp_path / "a.tsv", EXPORTS[name].encode(encoding))
    imported = Boris().read(path, exchange(films={"front.mp4": 0.0}))
    assert imported.labels.ranges == ROWS
    assert f"{path}: left out: 1 point event without a length." in imported.notes


@pytest.mark.parametrize(
    ("content", "how"),
    [
        (_table(AGGREGATED, *_with_modifiers()), {"modifier": "2"}),
        (_table(AGGREGATED_7, *SIDE_FIRST_7), {"offset": 10.0}),
        (_table(AGGREGATED, *QUEUED), {"offset": 10.0}),
        (_table(AGGREGATED, *SIDE, *QUEUED), FRONT),  # its lengths are known: events name all of its films
    ],
    ids=["modifiers", "a queue of BORIS 7", "a queue", "a whole queue"],
)
def test_an_export_is_read_with_what_the_user_says(content: str, how: dict[str, Any], tmp_path: Path) -> None:
    assert Boris().read(write_text(tmp_path / "a.tsv", content), exchange(**how)).labels.ranges == ROWS


def test_comments_have_other_signs_that_end_a_line(tmp_path: Path) -> None:
    content = _table(AGGREGATED, *_aggregated()).replace("eyes shut", "eyes\u2028\x0bshut")
    assert Boris().read(write_text(tmp_path / "a.tsv", content), exchange()).labels.ranges == ROWS


@pytest.mark.parametrize(("kind", "every_s"), [("", None), ("From pictures", 0.0), ("From pictures", 2.0)])
def test_exported_pictures_are_found_by_their_numbers(kind: str, every_s: float | None, tmp_path: Path) -> None:
    """A time lapse, if the observation has one, and the dates of pictures are written as times."""
    rows: list[Row] = [
        {"Observation id": "o", "Observation type": kind, "Subject": "girl", "Behavior": what, "Behavior type": "STATE"}
        | {f"{end} (s)": "NA" if every_s is None else n * every_s for end, n in (("Start", first), ("Stop", stop))}
        | {"Image index start": first, "Image index stop": stop}
        for what, first, stop in (("bird", 1, 3), ("cup", 3, 5))
    ]
    path = write_text(tmp_path / "a.tsv", _table(AGGREGATED, *rows))
    assert Boris().read(path, exchange()).labels.ranges == (row(1, 2, "bird"), row(3, 4, "cup"))


TWO = _project(monday={"events": TALK}, tuesday={"events": []})
LOOKS_AT = _looks(["looks at"])


@pytest.mark.parametrize(
    ("content", "how", "message"),
    [
        ("{", {}, ": not JSON"),
        ('{"a": 1}', {}, ": no observations"),
        (_project(a={}), {}, ": observation 'a': no events"),
        (_project(a={"events": [["x", "girl", "bird"]]}), {}, ": .*event 1: found"),
        (_project(a={"type": "IMAGES", "events": [[float("nan"), "girl", "bird", "", ""]]}), {}, ": .*event 1: found"),
        (_project(a={"time offset": "noon", "events": []}), {}, ": .*time offset: found 'noon'"),
        (_project(a={"events": [[1, "gril", "bird"], [2, "gril", "bird"]]}), {}, ": .*'gril'; did you mean 'girl'"),
        (_without_focal_subject(), {}, ": .*unknown subject 'No focal subject'"),
        (_project(a={"events": [[0, "girl", "bird"], [1, "girl", "cup"]]}), {}, ": .*overlap"),
        *(
            (
                _looks(["what"], *zip((0.0, 0.04, 0.08, 0.12), ["look"] * 4, each, strict=True)),
                {"modifier": "what"},
                ": .*overlap",
            )
            for each in (("bird", "cup", "bird", "cup"), ("bird", "cup", "cup", "bird"))
        ),
        (TWO, {}, ": .*'monday', 'tuesday'.*--observation NAME"),
        (TWO, {"observation": "mnday"}, ": --observation: no 'mnday'.*'monday'"),
        (LOOKS_AT, {}, r": .*\(bird, cup\).*--modifier 'looks at' .* --modifier none"),
        (LOOKS_AT, {"modifier": "looksat"}, ": .*--modifier: no 'looksat'.*'looks at'"),
        (_turns(3.0, **OTHERS), {}, r": .*side\.mp4, front\.mp4.*--film NAME"),
        (_turns(3.0, **OTHERS), {"film": "frnt.mp4"}, r": .*--film: no 'frnt\.mp4'.*'front\.mp4'"),
        # exports
        ("PK\x03\x04 a workbook", {}, ": a workbook"),
        ("<table><tr><td>Behavior</td></tr></table>", {}, ": .*HTML.*TSV or CSV"),
        (
            "Observation id\tSubject\tBehavior\tDuration mean (s)\no\tgirl\tbird\t1\n",
            {},
            r":1: found no column 'Start \(s\)'",
        ),
        (_table(AGGREGATED, {**_aggregated()[0], "Stop (s)": "0:01"}), {}, r":2: Stop \(s\): found '0:01'"),
        (_table(AGGREGATED, {**_aggregated()[0], "Behavior type": "x"}), {}, ":2: the type of a behaviour: found 'X'"),
        # BORIS leaves out events beyond the film: all of them, if the observation has a time offset
        (_table(TABULAR), {}, ": no observations with events"),
        (_table(AGGREGATED, *_with_modifiers()), {}, ": .*--modifier 1 .* --modifier none"),
        (_table(AGGREGATED_7, *SIDE_FIRST_7), FRONT, r": .*side\.mp4: found 'None'.*--offset SECONDS"),
        (_table(AGGREGATED, *QUEUED), FRONT, ": .*film 1 of .*: found 'None'; .* --offset SECONDS"),
    ],
)
def test_a_mistake_is_one_line(content: str, how: dict[str, Any], message: str, tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=rf"a\.boris{message}") as error:
        Boris().read(write_text(tmp_path / "a.boris", content), exchange(**how))
    assert "\n" not in str(error.value)


def test_it_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"a\.boris: .*cannot be written.*--format"):
        Boris().write(tmp_path / "a.boris", Labels(ROWS), exchange())
