from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.labels.drawn_shapes import (
    Drawn,
    KeyedShape,
    KeyFrame,
    Kind,
    Place,
    drawn_of,
    format_drawn,
    read_drawn,
)
from tests.disk import write_text
from vfoa.errors import VfoaError

HEAD = "# vfoa drawn 1\nframe,name,kind,u0_px,v0_px,u1_px,v1_px,outside\n"
SUBJECTS, TARGETS = ("girl", "boy"), ("bird", "cup")


def _read(path: Path, frames: range | None = range(1, 51)) -> Drawn:
    return read_drawn(path, frames=frames, subjects=SUBJECTS, targets=TARGETS)


@st.composite
def places(draw: st.DrawFn, kind: Kind) -> Place:
    """In pixels: sixteenths, and whatever a hand-written file may hold."""
    number = st.integers(-64, 65_000).map(lambda n: n / 16) | st.floats(-1e4, 1e4)
    u, v = draw(number), draw(number)
    width, height = (draw(st.floats(0.25, 4096)) for _ in range(2))
    return (u, v) if kind == "point" else (u, v, u + width, v + height)


@st.composite
def tracks(draw: st.DrawFn, name: str = "bird", kind: Kind = "box") -> KeyedShape:
    frames = sorted(draw(st.sets(st.integers(1, 50), min_size=1, max_size=6)))
    keys = [KeyFrame(frame=frame, place=draw(places(kind)), outside=draw(st.booleans())) for frame in frames]
    return KeyedShape(name=name, kind=kind, keys=tuple(keys))


@given(track=tracks())
def test_a_track_is_exact_at_key_frames_linear_between_and_absent_outside(track: KeyedShape) -> None:
    firsts = [key.frame for key in track.keys]
    for frame in range(53):
        before = [key for key in track.keys if key.frame <= frame]
        after = [key for key in track.keys if key.frame > frame]
        found = track.at(frame)
        if not before or before[-1].outside:
            assert found is None
        elif frame in firsts or not after:
            assert found == before[-1].place
        else:
            ends = firsts[len(before) - 1 : len(before) + 1]
            expected = [np.interp(frame, ends, pair) for pair in zip(before[-1].place, after[0].place, strict=True)]
            assert found == pytest.approx(expected, abs=1e-9)


@given(box=tracks(), head=tracks("girl", "head"), body=tracks("girl", "box"), point=tracks("cup", "point"))
def test_what_was_written_is_read(
    box: KeyedShape, head: KeyedShape, body: KeyedShape, point: KeyedShape, tmp_path_factory: pytest.TempPathFactory
) -> None:
    drawn = drawn_of({(each.name, each.kind): each.keys for each in (head, box, point, body)})
    path = write_text(tmp_path_factory.getbasetemp() / "a.drawn.csv", format_drawn(drawn))
    assert _read(path) == drawn
    assert format_drawn(_read(path)) == path.read_text()


def test_a_frame_has_all_that_is_there(tmp_path: Path) -> None:
    bird = "1,bird,box,0,0,10,10,\n11,bird,box,10,20,20,30,\n21,bird,box,10,20,20,30,1\n"
    rows = f"{bird}1,girl,head,5,5,9,9,\n3,cup,point,7,8,,,\n"
    drawn = _read(write_text(tmp_path / "a.drawn.csv", HEAD + rows))
    shown = [[(track.name, track.kind, place) for track, place in drawn.at(frame)] for frame in (2, 25)]
    bird, girl, cup = ("bird", "box", (1, 2, 11, 12)), ("girl", "head", (5, 5, 9, 9)), ("cup", "point", (7, 8))
    assert shown == [[bird, girl], [cup, girl]]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("frame,name\n", ":1: found 'frame,name'; expected '# vfoa drawn 1'"),
        ("# vfoa drawn 1\nframe,name\n", ":2: no column 'kind'"),
        (HEAD + "1,brid,box,0,0,1,1,\n", ":3: name: no subject or target 'brid'; did you mean 'bird'"),
        (HEAD + "1,bird,cube,0,0,1,1,\n", ":3: kind: found 'cube'; expected box, point, head"),
        (HEAD + "1,bird,head,0,0,1,1,\n", ":3: 'bird' is not a subject; expected box or point for a target"),
        (HEAD + "1,bird,box,0,0,1,1,\n2,bird,point,0,0,,,\n", ":4: 'bird' is already drawn as a box"),
        (HEAD + "51,bird,box,0,0,1,1,\n", ":3: frame 51: not in the clip; its frames: 1 to 50"),
        (HEAD + ",bird,box,0,0,1,1,\n", ":3: frame: expected a whole number of 64 bits, found nothing"),
        (HEAD + "1,bird,box,0,0,1,1,\n1,bird,box,0,0,2,2,\n", ":4: the box of 'bird' has a key frame 1 already"),
        (HEAD + "1,bird,box,3,0,1,1,\n", ":3: found the box 3, 0, 1, 1; expected u0 < u1 and v0 < v1"),
        (HEAD + "1,bird,box,0,0,1,,\n", ":3: v1_px: found nothing; expected all of"),
        (HEAD + "1,bird,point,0,0,1,1,\n", ":3: u1_px: found '1'; expected nothing for a point"),
        (HEAD + "1,bird,point,0,,,,\n", ":3: v0_px: found nothing; expected all of u0_px, v0_px"),
        (HEAD + "1,bird,point,0,2e6,,,\n", ":3: found [0.0, 2000000.0]"),
        (HEAD + "1,bird,box,0,0,1,1,yes\n", ":3: outside: found 'yes'; expected 1, or nothing"),
        (HEAD + "1,bird,box,0,0,1,nan,\n", ":3: v1_px: found 'nan'; expected all of"),
    ],
)
def test_a_mistake_is_one_line_with_its_place(tmp_path: Path, text: str, message: str) -> None:
    path = write_text(tmp_path / "a.drawn.csv", text)
    with pytest.raises(VfoaError) as error:
        _read(path)
    assert str(error.value).startswith(f"{path}{message}")
    assert "\n" not in str(error.value)
