"""CVAT's tracks and images as drawn shapes, and an attribute of people as their looks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import chain, groupby, pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from harness.labels.drawn_shapes import Drawn
from harness.labels.formats.cvat import Cvat
from harness.labels.formats.exchange import Imported
from harness.labels.labels import Labels
from tests.disk import write_text
from tests.exchanges import Box, PlainClip, cvat_box, cvat_document, cvat_track, exchange, row
from vfoa.errors import VfoaError

FIRST, COUNT = 1, 50
"""The clip's frames are 1 to 50; those of a task are 0 to 49."""
WHOLE = range(FIRST, FIRST + COUNT)


def read(tmp_path: Path, *elements: str, frames: Sequence[int] = WHOLE, **more: object) -> Imported:
    return Cvat().read(
        write_text(tmp_path / "annotations.xml", cvat_document(*elements)), exchange(PlainClip(frames=frames), **more)
    )


def places(drawn: Drawn, frames: Sequence[int] = WHOLE) -> dict[tuple[str, str, int], Box]:
    return {
        (shape.name, shape.kind, frame): (place[0], place[1], place[-2], place[-1])
        for frame in frames
        for shape, place in drawn.at(frame)
    }


@st.composite
def stretches(draw: st.DrawFn) -> dict[int, Box]:
    """Key frames of one stretch in which an object is visible, at least two frames from the next stretch."""
    coordinates = st.integers(0, 20)
    keys = sorted(draw(st.sets(st.integers(0, COUNT - 1), min_size=1, max_size=4)))
    u0, v0 = draw(coordinates), draw(coordinates)
    return {at: (u0 + draw(coordinates), v0, u0 + 21 + draw(coordinates), v0 + 10) for at in keys}


def _as_cvat_writes(keys: Mapping[int, Box], last: int, *, number: int, label: str) -> tuple[str, dict[int, Box]]:
    """A track up to the frame ``last``, written at every frame, and its place in each."""
    frames = dict(keys)
    for before, after in pairwise(keys):
        for at in range(before + 1, after):
            share = (at - before) / (after - before)
            frames[at] = tuple((1 - share) * a + share * b for a, b in zip(keys[before], keys[after], strict=True))
    for at in range(max(keys) + 1, last + 1):
        frames[at] = keys[max(keys)]
    shapes = [cvat_box(at, frames[at], key=at in keys) for at in sorted(frames)]
    if last + 1 < COUNT:
        shapes.append(cvat_box(last + 1, frames[last], outside=True))
    return cvat_track(label, *shapes, number=number), frames


@given(st.lists(stretches(), min_size=1, max_size=3), st.booleans())
def test_tracks_have_their_places_in_every_frame(
    tmp_path_factory: pytest.TempPathFactory, drawn: list[dict[int, Box]], is_one_name: bool
) -> None:
    """Tracks of one name follow each other: those that would overlap are left out."""
    elements, expected, end = [], dict[tuple[str, str, int], Box](), -1
    for number, keys in enumerate(drawn):
        name = "bird" if is_one_name else ("bird", "cup", "girl")[number]
        if is_one_name and min(keys) <= end:
            continue
        end = min(max(keys) + number, COUNT - 1)
        element, frames = _as_cvat_writes(keys, end, number=number, label=name)
        elements.append(element)
        for at, place in frames.items():
            expected[name, "box", at + FIRST] = place
    found = places(read(tmp_path_factory.mktemp("cvat"), *elements).drawn)
    assert found.keys() == expected.keys()
    for key, place in expected.items():
        assert found[key] == pytest.approx([coordinate - 0.5 for coordinate in place], abs=0.011)


def test_only_key_frames_are_kept(tmp_path: Path) -> None:
    element, _ = _as_cvat_writes({3: (0, 0, 10, 10), 20: (17, 0, 27, 10)}, 30, number=0, label="bird")
    (shape,) = read(tmp_path, element).drawn.tracks
    assert [(key.frame, key.outside) for key in shape.keys] == [(4, False), (21, False), (31, False), (32, True)]


@pytest.mark.parametrize(
    ("shape", "keys"),
    [
        ('<points frame="{at}" keyframe="{key}" points="7.5,8.5"/>', [1, 3]),  # moves linearly, as a box does
        ('<box frame="{at}" keyframe="{key}" xtl="1" ytl="2" xbr="9" ybr="12"/>', [1, 3]),
        ('<box frame="{at}" keyframe="{key}" xtl="1" ytl="2" xbr="9" ybr="12" rotation="9"/>', [1, 2, 3]),
        ('<polygon frame="{at}" keyframe="{key}" points="1,2;9,3;4,12"/>', [1, 2, 3]),
    ],
)
def test_what_does_not_move_linearly_is_a_key_frame_everywhere(tmp_path: Path, shape: str, keys: list[int]) -> None:
    element = cvat_track("bird", *(shape.format(at=at, key=int(at != 1)) for at in range(3)))
    (track,) = read(tmp_path, element, frames=range(1, 4)).drawn.tracks
    assert [key.frame for key in track.keys] == keys


def test_where_frames_are_missing_shapes_stay_at_their_places_in_the_film(tmp_path: Path) -> None:
    numbers = (1, 2, 3, 10, 11, 12)
    element, frames = _as_cvat_writes({0: (0, 0, 10, 10), 5: (50, 0, 60, 10)}, 5, number=0, label="bird")
    found = places(read(tmp_path, element, frames=numbers).drawn, numbers)
    for at, place in frames.items():
        assert found["bird", "box", numbers[at]] == pytest.approx([coordinate - 0.5 for coordinate in place], abs=0.011)


def test_labels_of_a_look_at_one_target_are_looks(tmp_path: Path) -> None:
    """As of eye contact: boxes of a face, whose label says where it looks, one track for each look."""
    tracks = [
        cvat_track("eye_contact", *(cvat_box(at, (0, 0, 9, 9)) for at in (2, 3)), number=0),
        cvat_track("no_eye_contact", cvat_box(4, (0, 0, 9, 9)), cvat_box(5, (0, 0, 9, 9), outside=True), number=1),
        cvat_track("eye_contact", cvat_box(5, (0, 0, 9, 9)), number=2),
        cvat_track("girl:head", *(cvat_box(at, (0, 0, 9, 9)) for at in (2, 3)), number=3),
    ]
    renamed = {"eye_contact": "girl:cup", "no_eye_contact": "girl:none"}
    imported = read(tmp_path, *tracks, renamed=renamed)
    assert imported.labels == Labels([row(3, 4, "cup"), row(5, 5, "none"), row(6, 6, "cup")])
    assert {(name, kind) for name, kind, _ in places(imported.drawn)} == {("girl", "head")}
    assert imported.notes == ()
    assert read(tmp_path, *tracks[:3], renamed=renamed).labels == imported.labels
    with_hand = read(tmp_path, *tracks, cvat_track("girl:hand", cvat_box(2, (0, 0, 9, 9)), number=4), renamed=renamed)
    assert with_hand.labels == imported.labels
    assert [note.partition("left out: ")[2] for note in with_hand.notes] == ["girl:hand#4."]
    with pytest.raises(VfoaError, match=r"found 'none'; expected 'cup', which another shape has"):
        read(tmp_path, *tracks, cvat_track("no_eye_contact", cvat_box(3, (0, 0, 9, 9)), number=4), renamed=renamed)
    with pytest.raises(VfoaError, match=r"unknown target 'mug'"):
        read(tmp_path, *tracks, renamed=renamed | {"eye_contact": "girl:mug"})
    with pytest.raises(VfoaError, match=r"found shapes of eye_contact#0, .*--rename .*THEIRS=SUBJECT:TARGET"):
        read(tmp_path, *tracks[:3])


def test_tags_of_images_are_looks(tmp_path: Path) -> None:
    """By the name of a look, or as an attribute of a tag that is called as the person; a tag has no place."""

    def image(number: int, tags: str) -> str:
        return f'<image id="{number}" name="{number:05d}.png" width="64" height="48">{tags}</image>'

    tags = [f'<tag label="{label}" source="manual"></tag>' for label in ("cup", "bird", "away")]
    person = '<tag label="boy"><attribute name="looks_at">{}</attribute></tag>'
    bird = '<box label="bird" xtl="0" ytl="0" xbr="9" ybr="9"/>'
    images = [image(3, tags[0] + bird), image(4, tags[0]), image(5, tags[2] + person.format("cup"))]
    imported = read(tmp_path, *images, renamed={"cup": "girl:cup", "away": "girl:none"})
    assert imported.labels == Labels([row(3, 4, "cup"), row(5, 5, "none"), row(5, 5, "cup", "boy")])
    assert [name for name, kind, frame in places(imported.drawn) if frame == 3] == ["bird"]
    assert not [note for note in imported.notes if "tags" in note]
    with pytest.raises(VfoaError, match=r"found shapes of bird, cup; .*--rename .*THEIRS=SUBJECT:TARGET"):
        read(tmp_path, image(3, tags[1]), image(4, tags[0]))
    known = read(tmp_path, image(3, tags[0] + bird))
    assert [note.partition("left out: ")[2] for note in known.notes] == ["cup."]


def test_a_person_s_attribute_has_the_looks(tmp_path: Path) -> None:
    values = ["bird"] * 3 + ["none"] * 2 + ["__undefined__"] + ["cup"] * 2
    shapes = [cvat_box(at, (0, 0, 9, 9), looks_at=value, mood="glad") for at, value in enumerate(values)]
    imported = read(tmp_path, cvat_track("girl", *shapes, cvat_box(8, (0, 0, 9, 9), outside=True, looks_at="bird")))
    assert imported.labels == Labels(
        [row(1, 3, "bird"), row(4, 5, "none"), row(6, 6, "ignore", note="not labelled yet"), row(7, 8, "cup")]
    )
    assert {(name, kind) for name, kind, _ in places(imported.drawn)} == {("girl", "box")}


def test_who_gets_the_name_of_somebody_who_is_left_out_keeps_the_looks(tmp_path: Path) -> None:
    tracks = [
        cvat_track(name, cvat_box(0, (20 * number, 0, 20 * number + 9, 9), looks_at=target), number=number)
        for number, (name, target) in enumerate((("left", "cup"), ("girl", "bird")))
    ]
    imported = read(tmp_path, *tracks, renamed={"left": "girl", "girl": ""})
    assert imported.labels == Labels([row(1, 1, "cup")])


def test_names_of_objects_and_heads(tmp_path: Path) -> None:
    elements = [
        cvat_track("cup", cvat_box(0, (0, 0, 5, 5)), number=3),
        cvat_track("cup", cvat_box(0, (10, 0, 15, 5)), number=5),
        cvat_track("head", cvat_box(0, (20, 0, 25, 5), name="girl"), number=6),
        cvat_track("boy_head", cvat_box(0, (30, 0, 35, 5)), number=7),
        cvat_track("boy", cvat_box(0, (30, 0, 40, 40)), number=8),
        cvat_track("chair", cvat_box(0, (40, 0, 45, 5)), number=9),
        cvat_track("face", cvat_box(0, (40, 0, 45, 5), name="bird"), number=10),
    ]
    with pytest.raises(VfoaError, match=r"track 5, frame 0.*cup#5"):
        read(tmp_path, *elements)
    imported = read(tmp_path, *elements[:6], renamed={"cup#5": "bird"})
    assert {(name, kind) for name, kind, _ in places(imported.drawn)} == {
        ("cup", "box"), ("bird", "box"), ("girl", "head"), ("boy", "head"), ("boy", "box")
    }  # fmt: skip
    assert [note for note in imported.notes if "chair#9" in note]
    assert {(name, kind) for name, kind, _ in places(read(tmp_path, elements[6]).drawn)} == {("bird", "box")}


def test_images_are_known_by_their_numbers(tmp_path: Path) -> None:
    """Between images that are not in the file a shape moves on; it is gone from one that does not have it."""

    def image(number: int, *shapes: str) -> str:
        name = f'id="{number - 1}" name="left/{number:05d}.jpg" width="64" height="48"'
        return f"<image {name}>{''.join(shapes)}</image>"

    def shape(left: int, label: str = "bird") -> str:
        sides = f'xtl="{left}" ytl="0" xbr="{left + 10}" ybr="10"'
        return f'<box label="{label}" {sides}><attribute name="target">cup</attribute></box>'

    with_shapes = {5: [shape(10)], 9: [shape(14), shape(30, "girl")], 20: [], 30: [shape(40)], 99: []}
    imported = read(tmp_path, *(image(number, *shapes) for number, shapes in with_shapes.items()))
    found = {frame: place[0] + 0.5 for (name, _, frame), place in places(imported.drawn).items() if name == "bird"}
    assert [*found] == [*range(5, 20), *range(30, 51)]
    assert (found[5], found[7], found[9], found[30]) == (10, 12, 14, 40)
    assert imported.labels == Labels([row(9, 9, "cup")])
    assert imported.size_px == (64, 48)


@pytest.mark.parametrize(
    ("element", "kind", "place"),
    [
        ('<box frame="0" rotation="90.0" xtl="10" ytl="20" xbr="30" ybr="24"/>', "box", (18, 12, 22, 32)),
        ('<ellipse frame="0" cx="20" cy="20" rx="8" ry="3" rotation="30"/>', "box", None),
        ('<mask frame="0" rle="0, 30" left="3" top="4" width="5" height="6"/>', "box", (3, 4, 8, 10)),
        ('<polygon frame="0" points="1.0,2.0;9.0,3.0;4.0,12.5"/>', "box", (1, 2, 9, 12.5)),
        ('<polyline frame="0" points="1.0,2.0;9.0,3.0"/>', "box", (1, 2, 9, 3)),
        ('<points frame="0" points="7.5,8.5"/>', "point", (7.5, 8.5, 7.5, 8.5)),
    ],
)
def test_every_kind_of_shape(tmp_path: Path, element: str, kind: str, place: Box | None) -> None:
    ((key, found),) = places(read(tmp_path, cvat_track("bird", element)).drawn, [1]).items()
    assert key == ("bird", kind, 1)
    if place is None:  # the widest and highest of the ellipse's points
        turn, steps = math.radians(30), [math.radians(step / 10) for step in range(3600)]
        across = max(8 * math.cos(at) * math.cos(turn) - 3 * math.sin(at) * math.sin(turn) for at in steps)
        down = max(8 * math.cos(at) * math.sin(turn) + 3 * math.sin(at) * math.cos(turn) for at in steps)
        place = (20 - across, 20 - down, 20 + across, 20 + down)
    assert found == pytest.approx([coordinate - 0.5 for coordinate in place], abs=0.011)


def _pictures(numbers: Sequence[int], suffix: str = "") -> list[str]:
    """Images called as CVAT calls pictures of a film, each with a bird whose left side is at the number."""
    return [
        f'<image id="{number}" name="frame_{number:06d}{suffix}" width="64" height="48">'
        f'<box label="bird" xtl="{number}" ytl="0" xbr="{number + 10}" ybr="10"/></image>'
        for number in numbers
    ]


@pytest.mark.parametrize("suffix", ["", ".png", ".PNG"])
@pytest.mark.parametrize(
    ("frames", "numbers", "options", "expected"),
    [
        (range(1, 7), range(6), {}, {1: 0, 2: 1, 3: 2, 4: 3, 5: 4, 6: 5}),
        (range(1, 7), range(40), {"offset": 1.0}, {1: 25, 2: 26, 3: 27, 4: 28, 5: 29, 6: 30}),
        ((0, 2, 4), (0, 1, 2), {}, {0: 0, 2: 1, 4: 2}),
        ((0, 2, 4), (0, 2, 4), {}, {0: 0, 2: 2, 4: 4}),  # the clip's own files
        (range(1, 7), (1, 2, 3), {}, {1: 1, 2: 2, 3: 3, 4: 3, 5: 3, 6: 3}),
        ((3, 4, 6), range(8), {"films": {"left.mp4": 0.12}}, {3: 3, 4: 4, 6: 6}),  # read from that film
        ((3, 4, 6), range(8), {"films": {"left.mp4": 0.12}, "offset": 0.0}, {3: 0, 4: 1, 6: 3}),
    ],
)
def test_pictures_of_a_film_are_known_by_their_places(
    tmp_path: Path, frames: Sequence[int], numbers: Sequence[int], options: Any, expected: dict[int, int], suffix: str
) -> None:
    drawn = read(tmp_path, *_pictures(numbers, suffix), frames=frames, **options).drawn
    assert {frame: place[0] + 0.5 for (_, _, frame), place in places(drawn, frames).items()} == expected


def test_pictures_of_a_film_s_later_part_are_known_by_their_places(tmp_path: Path) -> None:
    """Of a job; that it is of a film is in its meta."""
    text = cvat_document(*_pictures(range(2, 6))).replace("<job>", "<job><mode>interpolation</mode>")
    imported = Cvat().read(write_text(tmp_path / "a.xml", text), exchange(PlainClip(frames=range(1, 7))))
    found = places(imported.drawn, range(1, 7))
    assert {frame: place[0] + 0.5 for (_, _, frame), place in found.items()} == {3: 2, 4: 3, 5: 4, 6: 5}


MASKS = st.lists(st.lists(st.booleans(), min_size=4, max_size=4), min_size=1, max_size=5)


@given(MASKS.filter(lambda rows: any(map(any, rows))))
@example(
    [[False] * 4, [False, False, True, True], [True, False, True, False]]
)  # a run of two rows, one of a single row
def test_the_box_of_a_mask_is_that_of_its_pixels(
    tmp_path_factory: pytest.TempPathFactory, rows: list[list[bool]]
) -> None:
    """Datumaro writes masks in a rectangle as large as the image."""
    pixels = [False, *chain.from_iterable(rows)]  # runs begin outside
    lengths = [len([*run]) for _, run in groupby(pixels)]
    rle = ", ".join(map(str, (lengths[0] - 1, *lengths[1:])))
    mask = f'<mask frame="0" rle="{rle}" left="10" top="20" width="4" height="{len(rows)}"/>'
    (found,) = places(read(tmp_path_factory.mktemp("cvat"), cvat_track("bird", mask)).drawn, [1]).values()
    down, across = np.nonzero(rows)
    ends = (across.min(), down.min(), across.max() + 1, down.max() + 1)
    assert found == tuple(begin + end - 0.5 for begin, end in zip((10, 20, 10, 20), ends, strict=True))


def test_shapes_of_images_are_key_frames_whatever_is_written(tmp_path: Path) -> None:
    """Datumaro writes ``keyframe="0"`` in each."""
    lefts = {1: 10, 2: 30, 3: 12}
    images = (
        f'<image id="{number - 1}" name="{number:05d}.jpg" width="64" height="48"><box label="bird" keyframe="0" '
        f'outside="0" xtl="{left}" ytl="0" xbr="{left + 10}" ybr="10"/></image>'
        for number, left in lefts.items()
    )
    found = places(read(tmp_path, *images).drawn, [*lefts])
    assert {frame: place[0] + 0.5 for (_, _, frame), place in found.items()} == lefts


def test_what_has_no_box_is_counted(tmp_path: Path) -> None:
    skeleton = '<skeleton frame="1" keyframe="1"><points label="nose" frame="1" points="3,4"/></skeleton>'
    cuboid = '<cuboid frame="2" keyframe="1" xtl1="1" ytl1="2"/>'
    imported = read(tmp_path, cvat_track("bird", cvat_box(0, (0, 0, 9, 9)), skeleton, cuboid))
    assert [note for note in imported.notes if ": left out: skeletons, cuboids and tags: 2" in note]
    assert {frame for _, _, frame in places(imported.drawn)} == {*range(1, 51)}


def test_an_offset_is_in_seconds_of_the_film(tmp_path: Path) -> None:
    element = cvat_track("bird", *(cvat_box(at, (at, 0, at + 9, 9)) for at in range(100)))
    found = places(read(tmp_path, element, offset=1.0).drawn)
    assert found["bird", "box", 1][0] == 25 - 0.5
    assert found["bird", "box", 50][0] == 74 - 0.5


@pytest.mark.parametrize(
    ("elements", "words"),
    [
        ([cvat_track("horse", cvat_box(0, (0, 0, 9, 9)))], ["horse#0", "bird", "girl"]),
        ([cvat_track("bird", cvat_box(0, (9, 0, 0, 9)), number=4)], ["track 4, frame 0"]),
        ([cvat_track("bird", '<box frame="x"/>')], ["track 0", "frame", "'x'"]),
        (
            [cvat_track("bird", '<box frame="0" xtl="nan" ytl="0" xbr="1" ybr="1"/>')],
            ["track 0, frame 0", "xtl", "'nan'"],
        ),
        ([cvat_track("bird", '<box frame="0" rotation="a" xtl="0" ytl="0" xbr="1" ybr="1"/>')], ["rotation", "'a'"]),
        ([cvat_track("bird", '<polygon frame="0" points="1,2;3"/>')], ["points", "1,2;3"]),
        *(
            ([cvat_track("bird", f'<mask frame="0" rle="{rle}" left="0" top="0" width="2" height="2"/>')], ["rle", rle])
            for rle in ("4", "1, 4", "-1, 3", "1.5, 1", "a")
        ),
        (
            [
                cvat_track("bird", cvat_box(0, (0, 0, 9, 9))),
                cvat_track("bird", '<points frame="1" points="1,2"/>', number=1),
            ],
            ["frame 1"],
        ),
        ([cvat_track("girl", cvat_box(0, (0, 0, 9, 9), looks_at="horse"))], ["'horse'"]),
        (
            [cvat_track("girl", cvat_box(0, (0, 0, 9, 9), looks_at="cup", target="cup"))],
            ["looks_at, target", "--modifier"],
        ),
        (
            [
                cvat_track("girl", cvat_box(0, (0, 0, 9, 9), target="cup")),
                cvat_track("girl_head", cvat_box(0, (0, 0, 9, 9), target="bird"), number=1),
            ],
            ["track 1, frame 0", "'bird'", "'cup'"],
        ),
        (['<image id="0" name="a.png" width="8" height="8"/>'], ["64 x 48", "8 x 8"]),
    ],
)
def test_a_wrong_file_is_named_with_its_place(tmp_path: Path, elements: list[str], words: list[str]) -> None:
    with pytest.raises(VfoaError) as error:
        read(tmp_path, *elements)
    assert str(error.value).startswith(str(tmp_path / "annotations.xml"))
    assert [word for word in words if word not in str(error.value)] == []


@pytest.mark.parametrize("tasks", [("talk", "dinner"), ("talk",)])
def test_a_project_of_several_films_is_refused(tmp_path: Path, tasks: Sequence[str]) -> None:
    listed = "".join(f"<task><id>{10 + n}</id><name>{name}</name></task>" for n, name in enumerate(tasks))
    track = cvat_track("bird", cvat_box(0, (0, 0, 9, 9))).replace("<track ", '<track task_id="10" ')
    document = cvat_document(track).replace("<job><size>50</size></job>", f"<project><tasks>{listed}</tasks></project>")
    path = write_text(tmp_path / "annotations.xml", document)
    if len(tasks) == 1:
        assert Cvat().read(path, exchange(PlainClip(frames=WHOLE))).drawn.names == ("bird",)
        return
    with pytest.raises(VfoaError, match=r"annotations\.xml: .* the tasks talk, dinner; expected .* one task"):
        Cvat().read(path, exchange(PlainClip(frames=WHOLE)))


@pytest.mark.parametrize("content", [b"PK\x03\x04", b"<annotation><folder/></annotation>", b"{}", b""])
def test_another_file_is_refused(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "annotations.xml"
    path.write_bytes(content)
    with pytest.raises(VfoaError, match=str(path)):
        Cvat().read(path, exchange())


def test_the_documents_are_xml() -> None:
    assert (
        ElementTree.fromstring(cvat_document(cvat_track("bird", cvat_box(0, (0, 0, 1, 1), a="b"))).encode()).tag
        == "annotations"
    )
