from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from pympi.Elan import Eaf

from harness.labels.formats.elan import Elan
from harness.labels.labels import Labels
from tests.disk import write_text
from tests.exchanges import PlainClip, exchange, row
from vfoa.errors import VfoaError


def _document(
    path: Path, *annotations: tuple[str, int, int, str], films: Sequence[tuple[str, int | None]] = ()
) -> Path:
    """A document as ELAN's users make it through pympi, with the tier that every new one has.

    ``annotations`` are tier, start and end (ms) and value; ``films`` are names with their time origin, ms.
    """
    document = Eaf(author="somebody")
    for name, origin_ms in films:
        mimetype = "audio/x-wav" if name.endswith(".wav") else "video/mp4"
        document.add_linked_file(f"file:///C:/v/{name}", mimetype=mimetype, time_origin=origin_ms)
    for tier, start, end, value in annotations:
        if tier not in document.tiers:
            document.add_tier(tier)
        document.add_annotation(tier, start, end, value)
    document.to_file(str(path))
    return path


Places = tuple[str, tuple[int, int] | str, str]
"""An annotation: its id, the numbers of its two slots or the id of the annotation that it refers to, and its value."""


def _xml(slots: Sequence[int | None], *tiers: Sequence[Places]) -> str:
    """A document without a schema's address, of slots at these times (ms) and tiers of which the last one is girl's."""

    def annotation(own: str, place: tuple[int, int] | str, value: str) -> str:
        is_aligned = not isinstance(place, str)
        kind = "ALIGNABLE_ANNOTATION" if is_aligned else "REF_ANNOTATION"
        where = (
            'TIME_SLOT_REF1="ts{}" TIME_SLOT_REF2="ts{}"'.format(*place) if is_aligned else f'ANNOTATION_REF="{place}"'
        )
        inner = f"<ANNOTATION_VALUE>{value}</ANNOTATION_VALUE>"
        return f'<ANNOTATION><{kind} ANNOTATION_ID="{own}" {where}>{inner}</{kind}></ANNOTATION>'

    times = "".join(
        f'<TIME_SLOT TIME_SLOT_ID="ts{n}"' + ("/>" if time is None else f' TIME_VALUE="{time}"/>')
        for n, time in enumerate(slots)
    )
    body = "".join(
        f'<TIER TIER_ID="{name}">{"".join(annotation(*each) for each in annotations)}</TIER>'
        for name, annotations in zip([*map(str, range(1, len(tiers))), "girl"], tiers, strict=True)
    )
    return f"<ANNOTATION_DOCUMENT><TIME_ORDER>{times}</TIME_ORDER>{body}</ANNOTATION_DOCUMENT>"


def _aligned(*annotations: tuple[int, int, str]) -> list[Places]:
    """Annotations from slot to slot, by ids without a number."""
    return [(f"by hand {chr(97 + n)}", (first, last), value) for n, (first, last, value) in enumerate(annotations)]


WHOLE: list[Places] = [("top", (0, 1), "all")]


def _divided(*tiers: Sequence[Places]) -> str:
    """A document of 240 ms, with an annotation "top" as long as it, and tiers of annotations that refer to others."""
    return _xml([0, 240], WHOLE, *tiers)


def test_times_become_the_frames_that_are_shown_then(tmp_path: Path) -> None:
    # 25 frames a second from frame 1: frame n is shown from (n - 1) * 40 ms on
    path = _document(
        tmp_path / "a.eaf", ("girl", 30, 130, "bird"), ("girl", 130, 200, " none "), ("boy", 0, 40, "girl")
    )
    imported = Elan().read(path, exchange())
    assert imported.labels.ranges == (row(1, 1, "girl", "boy"), row(2, 4, "bird"), row(5, 5, "none"))
    assert imported.notes == ()


def test_rate_offset_and_names_are_stated(tmp_path: Path) -> None:
    path = _document(tmp_path / "a.eaf", ("Person 1", 2000, 2100, "Vogel"), ("camera", 0, 9000, "pan"))
    renamed = {"Person 1": "girl", "Vogel": "bird"}
    imported = Elan().read(path, exchange(fps=50, offset=2.0, renamed=renamed))
    assert imported.labels.ranges == (row(1, 5, "bird"),)
    assert f"{path}: tier 'camera' belongs to no subject and is left out." in imported.notes


def test_a_rename_holds_for_one_subject_or_tier(tmp_path: Path) -> None:
    path = _document(
        tmp_path / "a.eaf", ("Left", 0, 80, "Participant"), ("boy", 0, 80, "Participant"), ("boy", 80, 120, "Kunst")
    )
    tiers = {"Left": "girl", "Left:Participant": "boy", "boy:Participant": "girl", "Kunst": "bird", "Kunt": "cup"}
    imported = Elan().read(path, exchange(renamed=tiers))
    assert imported.labels.ranges == (row(1, 2, "girl", "boy"), row(1, 2, "boy"), row(3, 3, "bird", "boy"))
    (unused,) = [note for note in imported.notes if "--rename" in note]
    assert "--rename Kunt: no such name in it; did you mean 'Kunst'" in unused
    subjects = {"Left": "girl", "girl:Participant": "boy", "boy:Participant": "girl", "Kunst": "bird"}
    assert Elan().read(path, exchange(renamed=subjects)).labels == imported.labels


def test_a_tier_may_be_of_one_person_s_looks_at_one_target(tmp_path: Path) -> None:
    """As people export eye contact from ELAN: tiers named after what is looked at, of annotations without a value."""
    path = write_text(tmp_path / "a.txt", "host\t\t0.0\t0.08\t\nhost\t\t0.2\t0.24\t\ncamera\t\t0.08\t0.2\twide\n")
    renamed = {"host": "girl:boy", "camera": "girl:cup"}
    imported = Elan().read(path, exchange(renamed=renamed))
    assert imported.labels.ranges == (row(1, 2, "boy"), row(3, 5, "cup"), row(6, 6, "boy"))
    assert imported.notes == (f"{path}: tier 'camera': not read: the values of 1 look at 'cup'.",)
    own = write_text(tmp_path / "b.txt", "cup\t\t0.08\t0.2\t\nbird\t\t0.2\t0.24\t\n")  # called as the targets
    looks = Elan().read(own, exchange(renamed={"cup": "girl:cup", "bird": "girl:bird"}))
    assert (looks.labels.ranges, looks.notes) == ((row(3, 5, "cup"), row(6, 6, "bird")), ())
    (note, _) = Elan().read(path, exchange(renamed={"host": "girl"})).notes
    assert note.endswith(
        "left out: 2 annotations without a value; if all are looks at one target: --rename host=SUBJECT:TARGET."
    )
    with pytest.raises(VfoaError, match=r"found 'host', 'camera'; .*--rename TIER=OURS:TARGET"):
        Elan().read(path, exchange())
    with pytest.raises(VfoaError, match=r"tier 'host', 0\.000 to 0\.080 s: unknown target 'pub'"):
        Elan().read(path, exchange(renamed={"host": "girl:pub"}))


def test_a_tier_named_after_a_subject_and_no_target_is_of_something_else(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.txt", "girl:cup\t\t0.0\t0.08\t\ngirl:speech\t\t0.1\t0.2\tmy cup\n")
    imported = Elan().read(path, exchange())
    assert imported.labels.ranges == (row(1, 2, "cup"),)
    assert imported.notes == (f"{path}: tier 'girl:speech' belongs to no subject and is left out.",)


@pytest.mark.parametrize(
    ("gaps", "filled"), [("ignore", row(3, 5, "ignore", note="not labelled yet")), ("none", row(3, 5, "none"))]
)
def test_frames_without_a_label_are_filled_and_counted(tmp_path: Path, gaps: str, filled: object) -> None:
    path = _document(
        tmp_path / "a.eaf", ("girl", 0, 80, "bird"), ("girl", 200, 240, "cup"), ("girl", 9000, 9100, "cup")
    )
    imported = Elan().read(path, exchange(gaps=gaps))
    assert imported.labels.ranges == (row(1, 2, "bird"), filled, row(6, 6, "cup"))
    assert imported.notes[0] == f"{path}: girl: 3 frames without a label, between labels: {gaps!r} (--gaps)."
    assert "left out: 1 label without a frame of the clip, the first at" in imported.notes[1]
    assert "9.000 to 9.100 s" in imported.notes[1]


def test_a_clip_without_a_rate_needs_one(tmp_path: Path) -> None:
    path = _document(tmp_path / "a.eaf", ("girl", 0, 80, "bird"))
    with pytest.raises(VfoaError, match=r"--fps: .*rate"):
        Elan().read(path, exchange(PlainClip(rate_hz=None)))
    assert Elan().read(path, exchange(PlainClip(rate_hz=None), fps=25)).labels.ranges == (row(1, 2, "bird"),)


@pytest.mark.parametrize("name", ["fps", "offset"])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e300, -1e300])
def test_a_rate_or_an_offset_beyond_all_clips_is_refused(name: str, value: float) -> None:
    with pytest.raises(VfoaError, match=re.escape(f"--{name}: found {value:g};")):
        exchange(None, **{name: value})


@pytest.mark.parametrize("begin_s", [0.0, 2.0])
def test_what_we_write_is_read_by_the_library(begin_s: float, tmp_path: Path) -> None:
    """In the times of a player, where the film's pictures begin later."""
    path, begin = tmp_path / "a.eaf", round(1000 * begin_s)
    labels = Labels([row(1, 2, "bird"), row(3, 50, "cup", note="both hands")])
    Elan().write(path, labels, exchange(films={"talk.mp4": begin_s}))
    document = Eaf(str(path))
    looks = [(begin, begin + 80, "bird"), (begin + 80, begin + 2000, "cup")]
    assert document.get_annotation_data_for_tier("girl") == looks
    assert document.get_annotation_data_for_tier("girl:note") == [(begin + 80, begin + 2000, "both hands")]


TALK = [("talk.mp4", 2000)]
SEVERAL = [("the%20sound.wav", 7000), ("side.mp4", None), ("the%20front.mp4", 2000)]


@pytest.mark.parametrize(
    ("films", "how", "first"),
    [
        ([], {}, 51),
        ([], {"films": {"talk.mp4": 2.0}}, 1),  # the clip's pictures begin later than its film
        ([], {"films": {"talk.mp4": 2.0}, "offset": 0.0}, 51),
        (TALK, {}, 101),
        ([("sound.wav", 7000), *TALK], {}, 101),
        (TALK, {"offset": -1.0}, 76),
        (SEVERAL, {"films": {"the front.mp4": 0.0}}, 101),
        (SEVERAL, {"film": "side.mp4"}, 51),
    ],
)
def test_times_are_those_of_the_film_that_shows_the_clip(
    films: list[tuple[str, int | None]], how: dict[str, Any], first: int, tmp_path: Path
) -> None:
    path = _document(tmp_path / "a.eaf", ("girl", 2000, 2080, "bird"), films=films)
    imported = Elan().read(path, exchange(PlainClip(frames=range(1, 151)), **how))
    assert imported.labels.ranges == (row(first, first + 1, "bird"),)


LATE = {"late.mkv": 1.48}
"""A film in which the clip begins at 1.48 s."""


@pytest.mark.parametrize(
    ("film", "how", "first"),
    [("left.mp4", {"offset": 0.0}, 51), ("left.mp4", {"offset": 1.48}, 14), ("c:/1f-late.mkv", {}, 14)],
)
def test_labels_of_a_film_that_is_not_the_clip_s_need_the_time_at_which_it_begins(
    film: str, how: dict[str, float], first: int, tmp_path: Path
) -> None:
    """One by ``clips export`` begins with the clip, a copy of the clip's own film does not."""
    path = _document(tmp_path / "a.eaf", ("girl", 2000, 2080, "bird"), films=[(film, None)])
    clip = PlainClip(frames=range(1, 151))
    assert Elan().read(path, exchange(clip, films=LATE, **how)).labels.ranges == (row(first, first + 1, "bird"),)
    if how:
        with pytest.raises(VfoaError, match=r"left\.mp4; expected late\.mkv.* 1\.48 s, or --offset"):
            Elan().read(path, exchange(clip, films=LATE))
        assert Elan().read(path, exchange(clip, films={"late.mkv": 0.01})).labels.ranges == (row(51, 52, "bird"),)


def test_the_offset_of_a_film_is_told_and_a_choice_of_films_asked_for(tmp_path: Path) -> None:
    path = _document(tmp_path / "a.eaf", ("girl", 0, 80, "bird"), films=TALK)
    assert f"{path}: an offset of 2 s is added to its times." in Elan().read(path, exchange()).notes
    assert "is not used: --offset" in Elan().read(path, exchange(offset=-1.0)).notes[0]
    twice = [("side/talk.mp4", 0), ("front/talk.mp4", 2000)]
    with pytest.raises(VfoaError, match=r"side/talk\.mp4, .*front/talk\.mp4; expected --offset"):
        Elan().read(_document(tmp_path / "c.eaf", ("girl", 0, 80, "bird"), films=twice), exchange(film="talk.mp4"))
    with pytest.raises(VfoaError, match=r"side\.mp4, the front\.mp4.*--film NAME"):
        Elan().read(_document(tmp_path / "b.eaf", ("girl", 0, 80, "bird"), films=SEVERAL), exchange())


@pytest.mark.parametrize(
    ("slots", "annotations", "expected"),
    [
        ([0, None, None, 240], [(0, 1, "bird"), (1, 2, "cup"), (2, 3, "none")], [(1, 2), (3, 4), (5, 6)]),
        # the times of a subdivision are those of its tier: other slots lie between, and a second one follows
        (
            [0, None, 100, None, 160, None, 240],
            [(0, 1, "bird"), (1, 4, "cup"), (4, 5, "none"), (5, 6, "bird")],
            [(1, 2), (3, 4), (5, 5), (6, 6)],
        ),
        ([0, 80, None, 200], [(2, 3, "none"), (1, 2, "cup"), (0, 1, "bird")], [(1, 2), (3, 4), (5, 5)]),
    ],
    ids=["thirds", "two subdivisions", "another order"],
)
def test_slots_without_times_lie_evenly_between_their_neighbours(
    slots: list[int | None],
    annotations: list[tuple[int, int, str]],
    expected: list[tuple[int, int]],
    tmp_path: Path,
) -> None:
    imported = Elan().read(write_text(tmp_path / "a.eaf", _xml(slots, _aligned(*annotations))), exchange())
    assert [(label.first_frame, label.last_frame) for label in imported.labels.ranges] == expected
    ordered = sorted(annotations)
    assert [label.label.target for label in imported.labels.ranges] == [value for *_, value in ordered]


@pytest.mark.parametrize(
    "text",
    [
        _xml([0, None], WHOLE, [("1", "top", "bird")]),
        _xml([None, 240], WHOLE, [("1", "top", "bird")]),
        _xml([0, None, None], _aligned((0, 1, "bird"), (1, 2, "cup"), (2, 1, "none"))),
    ],
    ids=["of one without an end", "of one without a start", "slots in a circle"],
)
def test_annotations_without_times_are_refused(text: str, tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"a\.eaf: tier 'girl' has an annotation without times"):
        Elan().read(write_text(tmp_path / "a.eaf", text), exchange())


def test_annotations_without_a_value_are_left_out_and_counted(tmp_path: Path) -> None:
    text = _xml([0, 80, 160, 240], _aligned((0, 1, "bird"), (1, 2, " "), (2, 3, "")))
    path = write_text(tmp_path / "a.eaf", text.replace("<ANNOTATION_VALUE></ANNOTATION_VALUE>", ""))
    imported = Elan().read(path, exchange())
    assert imported.labels.ranges == (row(1, 2, "bird"),)
    assert imported.notes == (f"{path}: tier 'girl': left out: 2 annotations without a value.",)


MANY = 2_000


@pytest.mark.parametrize(
    ("tiers", "expected"),
    [
        # a division of a division: thirds of 240 ms, of which the last has two halves
        (
            [
                [("1", "top", ""), ("2", "top", ""), ("3", "top", "")],
                [("4", "1", "bird"), ("5", "2", "cup"), ("6", "3", "none"), ("7", "3", "bird")],
            ],
            ["bird", "bird", "cup", "cup", "none", "bird"],
        ),
        # far more parts than frames: those without one are left out
        (
            [[(str(part), "top", "cup" if 3 * part < MANY else "none") for part in range(MANY)]],
            ["cup", "cup", "none", "none", "none", "none"],
        ),
    ],
    ids=["nested", "many"],
)
def test_divisions_of_any_number_and_depth_are_read(
    tiers: list[list[Places]], expected: list[str], tmp_path: Path
) -> None:
    imported = Elan().read(write_text(tmp_path / "a.eaf", _divided(*tiers)), exchange())
    labels = [imported.labels.at(frame, "girl") for frame in range(1, 7)]
    assert [label and label.target for label in labels] == expected


@pytest.mark.parametrize(
    ("previous", "expected"),
    [
        ({"1": "3", "2": "1"}, ["none", "none", "bird", "bird", "cup", "cup"]),  # a division before the first one
        ({"2": "1", "3": "1"}, ["bird", "bird", "cup", "cup", "none", "none"]),  # two after the same one
        ({"1": "of another tier"}, ["bird", "bird", "cup", "cup", "none", "none"]),
    ],
)
def test_a_division_comes_after_its_previous_one(previous: dict[str, str], expected: list[str], tmp_path: Path) -> None:
    text = _divided([("1", "top", "bird"), ("2", "top", "cup"), ("3", "top", "none")])
    for name, before in previous.items():
        text = text.replace(f'ANNOTATION_ID="{name}"', f'ANNOTATION_ID="{name}" PREVIOUS_ANNOTATION="{before}"')
    imported = Elan().read(write_text(tmp_path / "a.eaf", text), exchange())
    labels = [imported.labels.at(frame, "girl") for frame in range(1, 7)]
    assert [label and label.target for label in labels] == expected


def test_divisions_in_a_circle_are_refused(tmp_path: Path) -> None:
    text = _divided([("1", "top", "bird"), ("2", "top", "cup")])
    for name, before in (("1", "2"), ("2", "1")):
        text = text.replace(f'ANNOTATION_ID="{name}"', f'ANNOTATION_ID="{name}" PREVIOUS_ANNOTATION="{before}"')
    with pytest.raises(VfoaError, match=r"a\.eaf: tier 'girl' refers to"):
        Elan().read(write_text(tmp_path / "a.eaf", text), exchange())


def test_times_in_frames_are_refused(tmp_path: Path) -> None:
    path = _document(tmp_path / "a.eaf", ("girl", 0, 80, "bird"))
    assert Elan().read(path, exchange()).labels.ranges == (row(1, 2, "bird"),)
    text = path.read_text().replace("<HEADER", '<HEADER TIME_UNITS="PAL-frames"')
    with pytest.raises(VfoaError, match=r"a\.eaf: TIME_UNITS: found 'PAL-frames'; expected milliseconds"):
        Elan().read(write_text(path, text), exchange())


def test_an_offset_before_the_beginning_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"--offset: .*-2 s"):
        Elan().write(tmp_path / "a.eaf", Labels([row(1, 2, "bird")]), exchange(offset=-2.0))


ELAN_2_8 = Path(__file__).parent / "elan_2_8.eaf"
"""A phrase (18 of 8,778 annotations) of ``test/sample_2.8.eaf`` of pympi-ling 1.71 (MIT licence), which ELAN saved."""
WORDS = {"The": "bird", "quick": "cup", "brown": "none", "fox": "bird", "003": "boy", "hold": "cup", "stroke": "none"}


@pytest.mark.parametrize(
    ("tier", "frames", "targets"),
    [
        ("words-timesub", (1, 16, 31, 46, 61, 76), ("bird", "cup", "none", "bird", "boy")),  # slots without a time
        ("words-symsub", (1, 16, 31, 46, 61, 76), ("bird", "cup", "none", "bird", "boy")),  # parts of the phrase
        ("gestures", (1, 11, 26, 41), ("cup", "ignore", "none")),
    ],
)
def test_a_document_that_elan_saved_is_read(tier: str, frames: tuple[int, ...], targets: tuple[str, ...]) -> None:
    clip = PlainClip(frames=range(1, 76))  # of 3 s at 25 Hz: the phrase lasts from 8 to 11 s, the gestures from 7.8 s
    imported = Elan().read(ELAN_2_8, exchange(clip, offset=8.0, renamed={tier: "girl", **WORDS}))
    rows = [(row.first_frame, row.last_frame, row.label.target) for row in imported.labels.ranges]
    assert rows == [(first, end - 1, target) for (first, end), target in zip(pairwise(frames), targets, strict=True)]
    unread = {"text", "words-timesub", "words-symsub", "gestures", "words-pos"} - {tier}
    assert {note for note in imported.notes if "belongs to no subject" in note} == {
        f"{ELAN_2_8}: tier {other!r} belongs to no subject and is left out." for other in unread
    }


def test_annotations_without_a_value_that_elan_saved_are_counted() -> None:
    imported = Elan().read(ELAN_2_8, exchange(offset=8.0, renamed={"words-pos": "girl"}))
    assert imported.labels.ranges == ()
    assert f"{ELAN_2_8}: tier 'words-pos': left out: 2 annotations without a value" in imported.notes[0]


FILM = "file:///a.mov -- offset: 500, duration: 00:00:02.000 / 2.000 / 2000"
"""What ELAN writes of a film, on a Mac at least, before the size of its samples."""
TEXT_ROWS = (("girl", 30, 130, "bird"), ("camera", 0, 240, "pan"), ("girl", 130, 200, "none"), ("boy", 0, 40, "girl"))
"""Annotations as ELAN exports them: those of the first test here, and another tier."""
UNITS: dict[str, Callable[[int], str]] = {
    "hh:mm:ss.ms": lambda ms: f"00:00:{ms / 1000:06.3f}",
    "ss.msec": lambda ms: str(ms / 1000),
    "msec": str,
}


def _row_of(start: int, end: int, units: tuple[str, ...], kinds: int) -> list[str]:
    return [UNITS[unit](ms) for ms in (start, end, end - start)[:kinds] for unit in units]


def _exported(units: tuple[str, ...], kinds: int, *, has_participant: bool = True) -> str:
    between = [""] if has_participant else []
    rows = [[tier, *between, *_row_of(start, end, units, kinds), value] for tier, start, end, value in TEXT_ROWS]
    return "".join("\t".join(cells) + "\n" for cells in rows)


def _by_tier(units: tuple[str, ...], words: tuple[str, str, str], separator: str) -> str:
    tiers = ["girl", "boy", "camera"]
    header = [f"{word} - {unit}" for word in words for unit in units] + tiers
    rows = [
        [*_row_of(start, end, units, 3), *(value if tier == other else "" for other in tiers)]
        for tier, start, end, value in TEXT_ROWS
    ]
    films = '"#file:///C:/a.mp4 -- offset: 0"\n'
    return films + "".join(separator.join(cells) + "\n" for cells in (header, *rows))


ENGLISH, FRENCH = ("Begin Time", "End Time", "Duration"), ("Temps de départ", "temps de fin", "Durée")


@pytest.mark.parametrize(
    "text",
    [
        _exported(("hh:mm:ss.ms", "ss.msec"), 3),  # what ELAN offers
        _exported(("hh:mm:ss.ms",), 2, has_participant=False),
        _exported(("ss.msec", "msec"), 3),
        _exported(("msec",), 3),
        _by_tier(("hh:mm:ss.ms", "ss.msec", "msec"), ENGLISH, "\t"),
        _by_tier(("msec",), FRENCH, "\t"),
        _by_tier(("hh:mm:ss.ms",), FRENCH, ","),
    ],
    ids=["as offered", "no participant", "seconds", "milliseconds", "columns", "French", "CSV"],
)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
def test_exported_text_is_read_as_the_document(text: str, encoding: str, tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_bytes(text.encode(encoding))
    imported = Elan().read(path, exchange())
    assert imported.labels.ranges == (row(1, 1, "girl", "boy"), row(2, 4, "bird"), row(5, 5, "none"))
    assert imported.notes == (f"{path}: tier 'camera' belongs to no subject and is left out.",)
    moved = Elan().read(path, exchange(offset=0.04))
    assert moved.labels.ranges == (row(1, 3, "bird"), row(4, 4, "none"))


def test_exported_numbers_are_values_after_times(tmp_path: Path) -> None:
    text = _exported(("hh:mm:ss.ms", "ss.msec"), 3).replace("bird", "7").replace("none", "12").replace("pan", "3")
    names = {"7": "bird", "12": "none"}
    path = write_text(tmp_path / "a.txt", text.replace("boy", "other"))
    assert Elan().read(path, exchange(renamed=names)).labels.ranges == (row(2, 4, "bird"), row(5, 5, "none"))


def test_exported_lines_end_with_line_breaks_alone(tmp_path: Path) -> None:
    """Text that people paste has other signs that end a line in Unicode."""
    rows = ["girl\t\t0.0\t0.08\tbird", "girl:note\t\t0.0\t0.08\tone\u2028two\x0bthree\x85four", ""]
    path = write_text(tmp_path / "a.txt", "\n".join(rows))
    assert Elan().read(path, exchange()).labels.ranges == (row(1, 2, "bird", note="one two three four"),)


def _codes(*rows: str, standard: str | None) -> str:
    """Begin, end and duration as time codes: with a column for each tier, or without headers."""
    if standard is None:
        return "".join("girl\t\t" + row.replace(" ", "\t") + "\n" for row in rows)
    header = "\t".join([*(f"{word} - {standard}" for word in FRENCH), "girl"])
    return "\n".join([header, *(row.replace(" ", "\t") for row in rows), ""])


@pytest.mark.parametrize(
    ("standard", "rate", "rows", "ranges"),
    [
        # frame n of the clip is shown from (n - 1) / rate on, in a film that began a minute before
        ("PAL", 25.0, ("00:01:00:00 00:01:00:02 00:00:00:02 bird", "00:01:00:02 00:01:00:05 00:00:00:03 cup"), (2, 5)),
        (
            "PAL-50fps",
            50.0,
            ("00:01:00:00 00:01:00:04 00:00:00:04 bird", "00:01:00:04 00:01:00:05 00:00:00:00 cup"),
            (4, 5),
        ),
        # NTSC has no frames 0 and 1 in this minute: its first one is number 1800, at 60.060 s
        (
            "NTSC",
            29.97,
            ("00:00:59:29 00:01:00:05 00:00:00:04 bird", "00:01:00:05 00:01:00:07 00:00:00:02 cup"),
            (3, 5),
        ),
        (
            "NTSC",
            29.97,
            ("00:00:59;29 00:01:00;05 00:00:00;04 bird", "00:01:00;05 00:01:00;07 00:00:00;02 cup"),
            (3, 5),
        ),
    ],
)
@pytest.mark.parametrize("has_header", [True, False])
def test_time_codes_are_the_times_at_which_their_frames_begin(
    standard: str, rate: float, rows: tuple[str, ...], ranges: tuple[int, int], has_header: bool, tmp_path: Path
) -> None:
    path = write_text(tmp_path / "a.txt", _codes(*rows, standard=standard if has_header else None))
    begin_s = 60.06 if rate == 29.97 else 60.0
    mapping = exchange(fps=rate, offset=begin_s)
    last_bird, last_cup = ranges
    assert Elan().read(path, mapping).labels.ranges == (row(1, last_bird, "bird"), row(last_bird + 1, last_cup, "cup"))
    if not has_header:
        message = r"a\.txt:1: .*--fps 25 .*50 or 29\.97"
        for other in (None, 24.0):
            with pytest.raises(VfoaError, match=message):
                Elan().read(path, exchange(fps=other, offset=begin_s))


def test_exact_times_count_where_there_are_time_codes_too(tmp_path: Path) -> None:
    header = "\t".join(f"{word} - {unit}" for word in ENGLISH for unit in ("ss.msec", "PAL")) + "\tgirl\n"
    cells = "0.15\t00:00:00:03\t0.24\t00:00:00:06\t0.09\t00:00:00:02\tbird\n"
    assert Elan().read(write_text(tmp_path / "a.txt", header + cells), exchange()).labels.ranges == (row(5, 6, "bird"),)


@pytest.mark.parametrize(
    ("annotations", "message"),
    [
        ([("gril", 0, 40, "bird")], r"a\.eaf: .* found 'default', 'gril'"),
        ([("girl", 0, 40, "brid")], r"a\.eaf: tier 'girl', 0.000 to 0.040 s: .*'brid'.*'bird'"),
        ([("girl", 0, 40, "girl")], r"'girl' looks at 'girl'"),
        ([("girl", 0, 80, "bird"), ("girl", 40, 90, "cup")], r"frame 2: overlaps .*0.000 to 0.080 s"),
        ([("girl", 0, 80, "bird"), ("girl:point_px", 0, 80, "here")], r"u_px,v_px: found 'here'"),
    ],
)
def test_a_mistake_is_one_line_with_its_place(
    tmp_path: Path, annotations: list[tuple[str, int, int, str]], message: str
) -> None:
    with pytest.raises(VfoaError, match=message) as error:
        Elan().read(_document(tmp_path / "a.eaf", *annotations), exchange())
    assert "\n" not in str(error.value)


def _with_code(standard: str, code: str) -> str:
    return _codes(f"00:00:00:00 {code} 00:00:01:00 bird", standard=standard)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<ANNOTATION_DOCUMENT>\n<TIER", r"a\.eaf:2: not XML"),
        ("<annotations/>", r"a\.eaf: found <annotations>"),
        ("<ANNOTATION_DOCUMENT/>", r"a\.eaf: .* found none"),
        ("<ANNOTATION_DOCUMENT><TIER/></ANNOTATION_DOCUMENT>", r"a\.eaf: <TIER> without TIER_ID"),
        # slots that no neighbour gives a time, and annotations that refer to each other
        *(
            (_xml(slots, _aligned((0, 1, "bird"), (2, 2, "cup"))), r"a\.eaf: tier 'girl' .*without times")
            for slots in ([0, None, None], [None, 80, 160], [0, None, 160])
        ),
        (_divided([("1", "2", "bird"), ("2", "1", "cup")]), r"a\.eaf: tier 'girl' refers to"),
        # exported text
        ("girl\tsomething\tbird\n", r"a\.eaf: no two columns of times"),
        ("girl\t\t00:00:00.030\tbird\n", r"a\.eaf: no two columns of times.*Begin Time"),
        ("girl\t\t0.03\t0.1\t0.5\tbird\n", r"a\.eaf:1: found the times \[30, 100, 500\] ms"),
        ("girl\t\t0.3\t0.1\tbird\n", r"a\.eaf:1: found the times \[300, 100\] ms"),
        ("00:00:00.030\t00:00:00.130\tbird\n", r"a\.eaf: no column of tiers"),
        ("Begin Time - ss.msec\tDuration - ss.msec\tgirl\n0.03\t0.1\tbird\n", r"a\.eaf: columns 'Begin Time"),
        ('"#file:///a.mp4 -- offset: 500"\ngirl\t\t0.03\t0.1\t0.07\tbird\n', r"a\.eaf:1: .* 500 ms.*--offset"),
        (f'"#{FILM}, ms per sample: 40.0"\n\ngirl\t\t0.03\t0.1\t0.07\tbird\n', r"a\.eaf:1: .* 500 ms.*--offset"),
        # time codes that their rates do not have
        (_with_code("PAL", "00:00:01:25"), r"a\.eaf:2: found .*00:00:01:25"),
        (_with_code("NTSC", "00:00:01:30"), r"a\.eaf:2: found .*00:00:01:30"),
        (_with_code("NTSC", "00:01:00:01"), r"a\.eaf:2: found .*00:01:00:01"),
        (_with_code("PAL", "00:00:01.00"), r"a\.eaf:2: found .*00:00:01\.00"),
    ],
)
def test_a_file_without_tiers_or_times_is_refused(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=message) as error:
        Elan().read(write_text(tmp_path / "a.eaf", text), exchange())
    assert "\n" not in str(error.value)
