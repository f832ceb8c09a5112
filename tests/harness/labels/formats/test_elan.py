from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest
from pympi.Elan import Eaf

from harness.labels.formats.elan import Elan
from harness.labels.labels import Labels
from tests.disk import write_text
from tests.exchanges import PlainClip, exchange, row
from vfoa.errors import VfoaError


def _document(path: Path, *annotations: tuple[str, int, int, str]) -> Path:
    """A document as ELAN's users make it through pympi, with the tier that every new one has."""
    document = Eaf(author="somebody")
    for tier, start, end, value in annotations:
        if tier not in document.tiers:
            document.add_tier(tier)
        document.add_annotation(tier, start, end, value)
    document.to_file(str(path))
    return path


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
    assert imported.notes == (f"{path}: tier 'camera' belongs to no subject and is left out.",)


def test_a_rename_holds_for_one_subject_or_tier(tmp_path: Path) -> None:
    path = _document(
        tmp_path / "a.eaf", ("Left", 0, 80, "Participant"), ("boy", 0, 80, "Participant"), ("boy", 80, 120, "Kunst")
    )
    tiers = {"Left": "girl", "Left:Participant": "boy", "boy:Participant": "girl", "Kunst": "bird", "Roboter": "cup"}
    imported = Elan().read(path, exchange(renamed=tiers))
    assert imported.labels.ranges == (row(1, 2, "girl", "boy"), row(1, 2, "boy"), row(3, 3, "bird", "boy"))
    (unused,) = [note for note in imported.notes if "--rename" in note]
    assert "--rename Roboter: no such name in it" in unused
    subjects = {"Left": "girl", "girl:Participant": "boy", "boy:Participant": "girl", "Kunst": "bird"}
    assert Elan().read(path, exchange(renamed=subjects)).labels == imported.labels


@pytest.mark.parametrize(
    ("gaps", "filled"), [("ignore", row(3, 5, "ignore", note="not labelled yet")), ("none", row(3, 5, "none"))]
)
def test_frames_without_a_label_are_filled_and_counted(tmp_path: Path, gaps: str, filled: object) -> None:
    path = _document(
        tmp_path / "a.eaf", ("girl", 0, 80, "bird"), ("girl", 200, 240, "cup"), ("girl", 9000, 9100, "cup")
    )
    imported = Elan().read(path, exchange(gaps=gaps))
    assert imported.labels.ranges == (row(1, 2, "bird"), filled, row(6, 6, "cup"))
    assert imported.notes[0] == f"{path}: girl: 3 frames between labels have none: {gaps!r}."
    assert "1 labels hold no frame of the clip and are left out, the first at" in imported.notes[1]
    assert "9.000 to 9.100 s" in imported.notes[1]


@pytest.mark.parametrize(
    ("annotations", "message"),
    [
        ([("gril", 0, 40, "bird")], r"a\.eaf: no tier is named after a subject; found 'default', 'gril'"),
        (
            [("girl", 0, 40, "brid")],
            r"a\.eaf: tier 'girl', 0.000 to 0.040 s: unknown target 'brid'; did you mean 'bird'",
        ),
        ([("girl", 0, 40, "girl")], r"'girl' looks at 'girl'"),
        (
            [("girl", 0, 80, "bird"), ("girl", 40, 90, "cup")],
            r"two labels in frame 2: overlaps with .*0.000 to 0.080 s",
        ),
        ([("girl", 0, 80, "bird"), ("girl:point_px", 0, 80, "here")], r"u_px,v_px: found 'here'; expected two numbers"),
    ],
)
def test_a_mistake_is_one_line_with_its_place(
    tmp_path: Path, annotations: list[tuple[str, int, int, str]], message: str
) -> None:
    with pytest.raises(VfoaError, match=message) as error:
        Elan().read(_document(tmp_path / "a.eaf", *annotations), exchange())
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<ANNOTATION_DOCUMENT>\n<TIER", r"a\.eaf:2: not XML"),
        ("<annotations/>", r"a\.eaf: found <annotations>; expected ELAN's"),
        ("<ANNOTATION_DOCUMENT/>", r"a\.eaf: no tier is named after a subject; found none"),
        ("<ANNOTATION_DOCUMENT><TIER/></ANNOTATION_DOCUMENT>", r"a\.eaf: <TIER> without TIER_ID"),
        ("girl\tsomething\tbird\n", r"a\.eaf: no two columns of times"),
    ],
)
def test_another_file_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(VfoaError, match=message):
        Elan().read(write_text(tmp_path / "a.eaf", text), exchange())


def test_a_clip_without_a_rate_needs_one(tmp_path: Path) -> None:
    path = _document(tmp_path / "a.eaf", ("girl", 0, 80, "bird"))
    with pytest.raises(VfoaError, match="--fps: the clip does not know its rate"):
        Elan().read(path, exchange(PlainClip(rate_hz=None)))
    assert Elan().read(path, exchange(PlainClip(rate_hz=None), fps=25)).labels.ranges == (row(1, 2, "bird"),)


@pytest.mark.parametrize(("name", "option"), [("fps", "--fps"), ("offset", "--offset")])
@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_rate_or_an_offset_that_is_no_number_is_refused(name: str, option: str, value: float) -> None:
    with pytest.raises(VfoaError, match=f"{option}: found {value}"):
        exchange(**{name: value})


def test_what_we_write_is_read_by_the_library(tmp_path: Path) -> None:
    from harness.labels.labels import Labels

    path = tmp_path / "a.eaf"
    Elan().write(path, Labels([row(1, 2, "bird"), row(3, 50, "cup", note="both hands")]), exchange())
    document = Eaf(str(path))
    assert document.get_annotation_data_for_tier("girl") == [(0, 80, "bird"), (80, 2000, "cup")]
    assert document.get_annotation_data_for_tier("girl:note") == [(80, 2000, "both hands")]


def test_the_offset_of_the_medium_is_added_and_said(tmp_path: Path) -> None:
    document = Eaf(author="somebody")
    document.add_linked_file("file:///talk.mp4", mimetype="video/mp4", time_origin=2000)
    document.add_tier("girl")
    document.add_annotation("girl", 0, 80, "bird")
    document.to_file(str(tmp_path / "a.eaf"))
    clip = PlainClip(frames=range(1, 101))
    imported = Elan().read(tmp_path / "a.eaf", exchange(clip))
    assert imported.labels.ranges == (row(51, 52, "bird"),)
    assert imported.notes == (f"{tmp_path / 'a.eaf'}: an offset of 2 s is added to its times.",)
    told = Elan().read(tmp_path / "a.eaf", exchange(clip, offset=-1.0))
    assert told.labels.ranges == (row(26, 27, "bird"),)
    assert "is not used: --offset says where the clip begins" in told.notes[0]


def test_the_film_that_shows_the_clip_counts(tmp_path: Path) -> None:
    document = Eaf(author="somebody")
    document.add_linked_file("file:///C:/v/the%20sound.wav", mimetype="audio/x-wav", time_origin=7000)
    document.add_linked_file("file:///C:/v/side.mp4", mimetype="video/mp4")
    document.add_linked_file("file:///C:/v/the%20front.mp4", mimetype="video/mp4", time_origin=2000)
    document.add_tier("girl")
    document.add_annotation("girl", 0, 80, "bird")
    document.to_file(str(tmp_path / "a.eaf"))
    clip = PlainClip(frames=range(1, 101))
    own = Elan().read(tmp_path / "a.eaf", exchange(clip, films={"the front.mp4": 0.0}))
    assert own.labels.ranges == (row(51, 52, "bird"),)
    with pytest.raises(VfoaError, match=r"found the films side\.mp4, the front\.mp4.*--film NAME"):
        Elan().read(tmp_path / "a.eaf", exchange(clip))
    assert Elan().read(tmp_path / "a.eaf", exchange(clip, film="side.mp4")).labels.ranges == (row(1, 2, "bird"),)


def test_labels_are_in_the_times_of_a_player_where_the_pictures_begin_later(tmp_path: Path) -> None:
    clip, film = PlainClip(frames=range(1, 101)), {"talk.mp4": 2.0}
    document = Eaf(author="somebody")
    document.add_tier("girl")
    document.add_annotation("girl", 2000, 2080, "bird")
    document.to_file(str(tmp_path / "a.eaf"))
    assert Elan().read(tmp_path / "a.eaf", exchange(clip, films=film)).labels.ranges == (row(1, 2, "bird"),)
    assert Elan().read(tmp_path / "a.eaf", exchange(clip, films=film, offset=0.0)).labels.ranges == (
        row(51, 52, "bird"),
    )
    Elan().write(tmp_path / "b.eaf", Labels([row(1, 2, "bird")]), exchange(clip, films=film))
    assert Eaf(str(tmp_path / "b.eaf")).get_annotation_data_for_tier("girl") == [(2000, 2080, "bird")]


def _unaligned(slots: list[int | None], annotations: list[tuple[int, int, str]], *, prefix: str = "a") -> str:
    """A document without a schema's address: a tier of annotations from slot to slot."""
    times = "".join(
        f'<TIME_SLOT TIME_SLOT_ID="ts{n}"' + ("/>" if time is None else f' TIME_VALUE="{time}"/>')
        for n, time in enumerate(slots)
    )
    held = "".join(
        f'<ANNOTATION><ALIGNABLE_ANNOTATION ANNOTATION_ID="{prefix}{chr(97 + n)}" TIME_SLOT_REF1="ts{first}" '
        f'TIME_SLOT_REF2="ts{last}"><ANNOTATION_VALUE>{value}</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION>'
        for n, (first, last, value) in enumerate(annotations)
    )
    tier = f'<TIER LINGUISTIC_TYPE_REF="s" TIER_ID="girl">{held}</TIER>'
    return f"<ANNOTATION_DOCUMENT><HEADER/><TIME_ORDER>{times}</TIME_ORDER>{tier}</ANNOTATION_DOCUMENT>"


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
    imported = Elan().read(write_text(tmp_path / "a.eaf", _unaligned(slots, annotations)), exchange())
    assert [(label.first_frame, label.last_frame) for label in imported.labels.ranges] == expected
    ordered = sorted(annotations)
    assert [label.label.target for label in imported.labels.ranges] == [value for *_, value in ordered]


@pytest.mark.parametrize("slots", [[0, None, None], [None, 80, 160], [0, None, 160]])
def test_slots_that_no_neighbour_gives_a_time_are_refused(slots: list[int | None], tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.eaf", _unaligned(slots, [(0, 1, "bird"), (2, 2, "cup")]))
    with pytest.raises(VfoaError, match=r"a\.eaf: tier 'girl' has an annotation without times"):
        Elan().read(path, exchange())


def test_annotations_without_a_value_are_left_out_and_counted(tmp_path: Path) -> None:
    text = _unaligned([0, 80, 160, 240], [(0, 1, "bird"), (1, 2, " "), (2, 3, "")], prefix="made-by-hand-")
    path = write_text(tmp_path / "a.eaf", text.replace("<ANNOTATION_VALUE></ANNOTATION_VALUE>", ""))
    imported = Elan().read(path, exchange())
    assert imported.labels.ranges == (row(1, 2, "bird"),)
    assert imported.notes == (f"{path}: tier 'girl': 2 annotations without a value are left out.",)


def test_referring_tiers_have_the_times_of_what_they_refer_to(tmp_path: Path) -> None:
    document = Eaf(author="somebody")
    document.add_linguistic_type("symbolic", constraints="Symbolic_Association", timealignable=False)
    document.add_tier("looks")
    document.add_tier("girl", ling="symbolic", parent="looks")
    for start, end, value in ((0, 80, "bird"), (80, 200, "none")):
        document.add_annotation("looks", start, end, "a look")
        document.add_ref_annotation("girl", "looks", start + 10, value)
    document.to_file(str(tmp_path / "a.eaf"))
    imported = Elan().read(tmp_path / "a.eaf", exchange())
    assert imported.labels.ranges == (row(1, 2, "bird"), row(3, 5, "none"))


def test_annotations_that_divide_another_one_have_equal_parts_of_it(tmp_path: Path) -> None:
    document = Eaf(author="somebody")
    document.add_linguistic_type("divided", constraints="Symbolic_Subdivision", timealignable=False)
    document.add_tier("looks")
    document.add_tier("girl", ling="divided", parent="looks")
    document.add_annotation("looks", 0, 240, "three looks")
    for value in ("bird", "cup", "none"):
        document.add_ref_annotation("girl", "looks", 100, value)
    document.to_file(str(tmp_path / "a.eaf"))
    imported = Elan().read(tmp_path / "a.eaf", exchange())
    assert imported.labels.ranges == (row(1, 2, "bird"), row(3, 4, "cup"), row(5, 6, "none"))


MANY = 20_000


def _divided(*tiers: list[tuple[str, str, str]]) -> str:
    """A document with an annotation "top" of 240 ms, and tiers of (id, id it refers to, value), the last one girl's."""
    names = [*(f"between {number}" for number in range(1, len(tiers))), "girl"]
    body = "".join(
        f'<TIER TIER_ID="{name}" LINGUISTIC_TYPE_REF="divided">'
        + "".join(
            f'<ANNOTATION><REF_ANNOTATION ANNOTATION_ID="{own}" ANNOTATION_REF="{other}"><ANNOTATION_VALUE>{value}'
            "</ANNOTATION_VALUE></REF_ANNOTATION></ANNOTATION>"
            for own, other, value in annotations
        )
        + "</TIER>"
        for name, annotations in zip(names, tiers, strict=True)
    )
    return (
        '<ANNOTATION_DOCUMENT><TIME_ORDER><TIME_SLOT TIME_SLOT_ID="a" TIME_VALUE="0"/><TIME_SLOT TIME_SLOT_ID="b" '
        'TIME_VALUE="240"/></TIME_ORDER><TIER TIER_ID="looks"><ANNOTATION><ALIGNABLE_ANNOTATION ANNOTATION_ID="top" '
        'TIME_SLOT_REF1="a" TIME_SLOT_REF2="b"><ANNOTATION_VALUE>all</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION>'
        f"</ANNOTATION></TIER>{body}</ANNOTATION_DOCUMENT>"
    )


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
    tiers: list[list[tuple[str, str, str]]], expected: list[str], tmp_path: Path
) -> None:
    imported = Elan().read(write_text(tmp_path / "a.eaf", _divided(*tiers)), exchange())
    labels = [imported.labels.at(frame, "girl") for frame in range(1, 7)]
    assert [label and label.target for label in labels] == expected


def test_annotations_that_refer_to_each_other_are_refused(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.eaf", _divided([("1", "2", "bird"), ("2", "1", "cup")]))
    with pytest.raises(VfoaError, match=r"a\.eaf: tier 'girl' refers to"):
        Elan().read(path, exchange())


def test_an_offset_before_the_beginning_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match="--offset: the clip's first frame would be at -2 s"):
        Elan().write(tmp_path / "a.eaf", Labels([row(1, 2, "bird")]), exchange(offset=-2.0))


GENUINE = """<?xml version="1.0" encoding="UTF-8"?>
<ANNOTATION_DOCUMENT AUTHOR="" DATE="2014-10-28T10:14:04+01:00" FORMAT="2.8" VERSION="2.8"
  xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
  xsi:noNamespaceSchemaLocation="http://www.mpi.nl/tools/elan/EAFv2.8.xsd">
  <LICENSE LICENSE_URL="http://www.mpi.nl/license.txt">Terms of use</LICENSE>
  <HEADER MEDIA_FILE="" TIME_UNITS="milliseconds">
    <MEDIA_DESCRIPTOR MEDIA_URL="file:///Users/Shared/MPI/DemoMaterial/yele/r03_v20_s5.wav" MIME_TYPE="audio/x-wav"
      RELATIVE_MEDIA_URL="../../DemoMaterial/yele/r03_v20_s5.wav"/>
    <PROPERTY NAME="URN">urn:nl-mpi-tools-elan-eaf:5ed4d207-dd3b-4852-84a2-4bddb9e0102b</PROPERTY>
    <PROPERTY NAME="lastUsedAnnotationId">8778</PROPERTY>
  </HEADER>
  <TIME_ORDER>
    <TIME_SLOT TIME_SLOT_ID="ts35" TIME_VALUE="7800"/><TIME_SLOT TIME_SLOT_ID="ts38" TIME_VALUE="8000"/>
    <TIME_SLOT TIME_SLOT_ID="ts39"/><TIME_SLOT TIME_SLOT_ID="ts40"/><TIME_SLOT TIME_SLOT_ID="ts41"/>
    <TIME_SLOT TIME_SLOT_ID="ts42"/><TIME_SLOT TIME_SLOT_ID="ts44" TIME_VALUE="8400"/>
    <TIME_SLOT TIME_SLOT_ID="ts46" TIME_VALUE="9000"/><TIME_SLOT TIME_SLOT_ID="ts48" TIME_VALUE="9600"/>
    <TIME_SLOT TIME_SLOT_ID="ts55" TIME_VALUE="11000"/>
  </TIME_ORDER>
  <TIER LANG_REF="eng" LINGUISTIC_TYPE_REF="text" TIER_ID="text">
    <ANNOTATION><ALIGNABLE_ANNOTATION ANNOTATION_ID="a3" TIME_SLOT_REF1="ts38" TIME_SLOT_REF2="ts55"
      ><ANNOTATION_VALUE>The quick brown fox 003</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION>
  </TIER>
  <TIER LANG_REF="eng" LINGUISTIC_TYPE_REF="words_timesub" PARENT_REF="text" TIER_ID="words-timesub">
    <ANNOTATION><ALIGNABLE_ANNOTATION ANNOTATION_ID="a410" TIME_SLOT_REF1="ts38" TIME_SLOT_REF2="ts39"
      ><ANNOTATION_VALUE>The</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION>
    <ANNOTATION><ALIGNABLE_ANNOTATION ANNOTATION_ID="a411" TIME_SLOT_REF1="ts39" TIME_SLOT_REF2="ts40"
      ><ANNOTATION_VALUE>quick</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION>
    <ANNOTATION><ALIGNABLE_ANNOTATION ANNOTATION_ID="a412" TIME_SLOT_REF1="ts40" TIME_SLOT_REF2="ts41"
      ><ANNOTATION_VALUE>brown</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION>
    <ANNOTATION><ALIGNABLE_ANNOTATION ANNOTATION_ID="a413" TIME_SLOT_REF1="ts41" TIME_SLOT_REF2="ts42"
      ><ANNOTATION_VALUE>fox</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION>
    <ANNOTATION><ALIGNABLE_ANNOTATION ANNOTATION_ID="a414" TIME_SLOT_REF1="ts42" TIME_SLOT_REF2="ts55"
      ><ANNOTATION_VALUE>003</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION>
  </TIER>
  <TIER DEFAULT_LOCALE="en" LANG_REF="eng" LINGUISTIC_TYPE_REF="words_symsub" PARENT_REF="text" TIER_ID="words-symsub">
    <ANNOTATION><REF_ANNOTATION ANNOTATION_ID="a2405" ANNOTATION_REF="a3"
      ><ANNOTATION_VALUE>The</ANNOTATION_VALUE></REF_ANNOTATION></ANNOTATION>
    <ANNOTATION><REF_ANNOTATION ANNOTATION_ID="a2406" ANNOTATION_REF="a3" PREVIOUS_ANNOTATION="a2405"
      ><ANNOTATION_VALUE>quick</ANNOTATION_VALUE></REF_ANNOTATION></ANNOTATION>
    <ANNOTATION><REF_ANNOTATION ANNOTATION_ID="a2407" ANNOTATION_REF="a3" PREVIOUS_ANNOTATION="a2406"
      ><ANNOTATION_VALUE>brown</ANNOTATION_VALUE></REF_ANNOTATION></ANNOTATION>
    <ANNOTATION><REF_ANNOTATION ANNOTATION_ID="a2408" ANNOTATION_REF="a3" PREVIOUS_ANNOTATION="a2407"
      ><ANNOTATION_VALUE>fox</ANNOTATION_VALUE></REF_ANNOTATION></ANNOTATION>
    <ANNOTATION><REF_ANNOTATION ANNOTATION_ID="a2409" ANNOTATION_REF="a3" PREVIOUS_ANNOTATION="a2408"
      ><ANNOTATION_VALUE>003</ANNOTATION_VALUE></REF_ANNOTATION></ANNOTATION>
  </TIER>
  <TIER LINGUISTIC_TYPE_REF="gesture" TIER_ID="gestures">
    <ANNOTATION><ALIGNABLE_ANNOTATION ANNOTATION_ID="a4396" CVE_REF="cveid1" TIME_SLOT_REF1="ts35" TIME_SLOT_REF2="ts44"
      ><ANNOTATION_VALUE>hold</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION>
    <ANNOTATION><ALIGNABLE_ANNOTATION ANNOTATION_ID="a4397" CVE_REF="cveid2" TIME_SLOT_REF1="ts46" TIME_SLOT_REF2="ts48"
      ><ANNOTATION_VALUE>stroke</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION>
  </TIER>
  <TIER LANG_REF="eng" LINGUISTIC_TYPE_REF="pos" PARENT_REF="words-symsub" TIER_ID="words-pos">
    <ANNOTATION><REF_ANNOTATION ANNOTATION_ID="a6794" ANNOTATION_REF="a2405"
      ><ANNOTATION_VALUE></ANNOTATION_VALUE></REF_ANNOTATION></ANNOTATION>
    <ANNOTATION><REF_ANNOTATION ANNOTATION_ID="a6795" ANNOTATION_REF="a2406"
      ><ANNOTATION_VALUE></ANNOTATION_VALUE></REF_ANNOTATION></ANNOTATION>
  </TIER>
  <LINGUISTIC_TYPE GRAPHIC_REFERENCES="false" LINGUISTIC_TYPE_ID="text" TIME_ALIGNABLE="true"/>
  <LINGUISTIC_TYPE CONSTRAINTS="Time_Subdivision" LINGUISTIC_TYPE_ID="words_timesub" TIME_ALIGNABLE="true"/>
  <LINGUISTIC_TYPE CONSTRAINTS="Symbolic_Subdivision" LINGUISTIC_TYPE_ID="words_symsub" TIME_ALIGNABLE="false"/>
  <LINGUISTIC_TYPE CONSTRAINTS="Symbolic_Association" LINGUISTIC_TYPE_ID="pos" TIME_ALIGNABLE="false"/>
  <LINGUISTIC_TYPE CONTROLLED_VOCABULARY_REF="Gesture" LINGUISTIC_TYPE_ID="gesture" TIME_ALIGNABLE="true"/>
</ANNOTATION_DOCUMENT>
"""
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
def test_a_document_that_elan_saved_is_read(
    tier: str, frames: tuple[int, ...], targets: tuple[str, ...], tmp_path: Path
) -> None:
    path = write_text(tmp_path / "a.eaf", GENUINE)
    clip = PlainClip(frames=range(1, 76))  # of 3 s at 25 Hz: the phrase lasts from 8 to 11 s, the gestures from 7.8 s
    imported = Elan().read(path, exchange(clip, offset=8.0, renamed={tier: "girl", **WORDS}))
    rows = [(row.first_frame, row.last_frame, row.label.target) for row in imported.labels.ranges]
    assert rows == [(first, end - 1, target) for (first, end), target in zip(pairwise(frames), targets, strict=True)]
    unread = {"text", "words-timesub", "words-symsub", "gestures", "words-pos"} - {tier}
    assert {note for note in imported.notes if "belongs to no subject" in note} == {
        f"{path}: tier {other!r} belongs to no subject and is left out." for other in unread
    }


def test_annotations_without_a_value_that_elan_saved_are_counted(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.eaf", GENUINE)
    imported = Elan().read(path, exchange(offset=8.0, renamed={"words-pos": "girl"}))
    assert imported.labels.ranges == ()
    assert f"{path}: tier 'words-pos': 2 annotations without a value are left out." in imported.notes


TEXT_ROWS = (("girl", 30, 130, "bird"), ("camera", 0, 240, "pan"), ("girl", 130, 200, "none"), ("boy", 0, 40, "girl"))
"""Annotations as ELAN exports them: those of the first test here, and another tier."""
UNITS = {
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
        message = r"a\.txt:1: time codes .* no header states; expected --fps 25 \(PAL\), 50 or 29\.97"
        for other in (None, 24.0):
            with pytest.raises(VfoaError, match=message):
                Elan().read(path, exchange(fps=other, offset=begin_s))


@pytest.mark.parametrize(
    ("standard", "code"),
    [("PAL", "00:00:01:25"), ("NTSC", "00:00:01:30"), ("NTSC", "00:01:00:01"), ("PAL", "00:00:01.00")],
)
def test_a_time_code_that_its_rate_does_not_have_is_refused(standard: str, code: str, tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.txt", _codes(f"00:00:00:00 {code} 00:00:01:00 bird", standard=standard))
    with pytest.raises(VfoaError, match=rf"a\.txt:2: found .*{code}"):
        Elan().read(path, exchange())


def test_exact_times_count_where_there_are_time_codes_too(tmp_path: Path) -> None:
    header = "\t".join(f"{word} - {unit}" for word in ENGLISH for unit in ("ss.msec", "PAL")) + "\tgirl\n"
    cells = "0.15\t00:00:00:03\t0.24\t00:00:00:06\t0.09\t00:00:00:02\tbird\n"
    assert Elan().read(write_text(tmp_path / "a.txt", header + cells), exchange()).labels.ranges == (row(5, 6, "bird"),)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("girl\t\t00:00:00.030\tbird\n", "no two columns of times; expected begin and end: in ELAN's export"),
        ("girl\t\t0.03\t0.1\t0.5\tbird\n", r"a\.txt:1: times \[30, 100, 500\] ms; expected begin, end and duration"),
        ("girl\t\t0.3\t0.1\tbird\n", r"a\.txt:1: times \[300, 100\] ms; expected begin, end"),
        ("00:00:00.030\t00:00:00.130\tbird\n", "no column of tiers before the times"),
        ("Begin Time - ss.msec\tDuration - ss.msec\tgirl\n0.03\t0.1\tbird\n", "expected begin and end"),
        ('"#file:///a.mp4 -- offset: 500"\ngirl\t\t0.03\t0.1\t0.07\tbird\n', r"a\.txt:1: .* 500 ms.*--offset SECONDS"),
    ],
)
def test_exported_text_that_is_ambiguous_says_what_to_export(text: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=message) as error:
        Elan().read(write_text(tmp_path / "a.txt", text), exchange())
    assert "\n" not in str(error.value)
