from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.labels.drawn import (
    Drawn,
    KeyFrame,
    Kind,
    Place,
    Shape,
    Track,
    drawn_of,
    format_drawn,
    read_drawn,
)
from harness.labels.formats.cvat import read_cvat_drawn, write_cvat_drawn
from tests.disk import write_text
from tests.exchanges import PlainClip, exchange
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
def tracks(draw: st.DrawFn, name: str = "bird", kind: Kind = "box") -> Track:
    frames = sorted(draw(st.sets(st.integers(1, 50), min_size=1, max_size=6)))
    keys = [KeyFrame(frame=each, place=draw(places(kind)), outside=draw(st.booleans())) for each in frames]
    return Track(name=name, kind=kind, keys=tuple(keys))


@given(track=tracks())
def test_a_track_is_exact_at_key_frames_linear_between_and_absent_outside(track: Track) -> None:
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
    box: Track, head: Track, body: Track, point: Track, tmp_path_factory: pytest.TempPathFactory
) -> None:
    drawn = drawn_of({(each.name, each.kind): each.keys for each in (head, box, point, body)})
    path = write_text(tmp_path_factory.getbasetemp() / "a.drawn.csv", format_drawn(drawn))
    assert _read(path) == drawn
    assert format_drawn(_read(path)) == path.read_text()


def test_a_frame_has_all_that_is_there(tmp_path: Path) -> None:
    bird = "1,bird,box,0,0,10,10,\n11,bird,box,10,20,20,30,\n21,bird,box,10,20,20,30,1\n"
    rows = f"{bird}1,girl,head,5,5,9,9,\n3,cup,point,7,8,,,\n"
    drawn = _read(write_text(tmp_path / "a.drawn.csv", HEAD + rows))
    girl, cup = Shape(name="girl", kind="head", place=(5, 5, 9, 9)), Shape(name="cup", kind="point", place=(7, 8))
    assert drawn.at(2) == (Shape(name="bird", kind="box", place=(1, 2, 11, 12)), girl)
    assert drawn.at(25) == (cup, girl)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("frame,name\n", ":1: found 'frame,name'; expected '# vfoa drawn 1'"),
        ("# vfoa drawn 1\nframe,name\n", ":2: no column 'kind'"),
        (HEAD + "1,brid,box,0,0,1,1,\n", ":3: name: no subject or target 'brid'; did you mean 'bird'"),
        (HEAD + "1,bird,cube,0,0,1,1,\n", ":3: kind: found 'cube'; expected box, point, head"),
        (HEAD + "1,bird,head,0,0,1,1,\n", ":3: 'bird' is no subject; expected box or point for a target"),
        (HEAD + "1,bird,box,0,0,1,1,\n2,bird,point,0,0,,,\n", ":4: 'bird' is already drawn as a box"),
        (HEAD + "51,bird,box,0,0,1,1,\n", ":3: frame 51: not in the clip; its frames: 1 to 50"),
        (HEAD + ",bird,box,0,0,1,1,\n", ":3: frame: found nothing"),
        (HEAD + "1,bird,box,0,0,1,1,\n1,bird,box,0,0,2,2,\n", ":4: the box of 'bird' has a key frame 1 already"),
        (HEAD + "1,bird,box,3,0,1,1,\n", ":3: found the box 3, 0, 1, 1; expected u0 < u1 and v0 < v1"),
        (HEAD + "1,bird,box,0,0,1,,\n", ":3: v1_px: found nothing; expected all of"),
        (HEAD + "1,bird,point,0,0,1,1,\n", ":3: u1_px: found '1'; expected nothing for a point"),
        (HEAD + "1,bird,box,0,0,1,1,yes\n", ":3: outside: found 'yes'; expected 1, or nothing"),
        (HEAD + "1,bird,box,0,0,1,nan,\n", ":3: v1_px: expected a finite number, found 'nan'"),
    ],
)
def test_a_mistake_is_one_line_with_its_place(tmp_path: Path, text: str, message: str) -> None:
    path = write_text(tmp_path / "a.drawn.csv", text)
    with pytest.raises(VfoaError) as error:
        _read(path)
    assert str(error.value).startswith(f"{path}{message}")
    assert "\n" not in str(error.value)


def _cvat(path: Path, *tracks: tuple[str, str]) -> Path:
    found = "".join(f'<track id="{n}" label="{label}">{shapes}</track>' for n, (label, shapes) in enumerate(tracks))
    return write_text(path, f"<annotations><version>1.1</version>{found}</annotations>")


def _box(frame: int, u0: float, *, key: int = 1, outside: int = 0) -> str:
    corners = f'xtl="{u0}" ytl="10.5" xbr="{u0 + 20}" ybr="30.5"'
    return f'<box frame="{frame}" keyframe="{key}" outside="{outside}" occluded="0" {corners}/>'


def test_cvat_s_tracks_move_as_they_do_there(tmp_path: Path) -> None:
    """Every frame is listed by CVAT, and which are key frames; what it lists between them must come out."""
    listed = [_box(frame, 100.5 + 4 * frame, key=int(frame in (0, 10))) for frame in range(11)]
    gone = [_box(20, 140.5, outside=1), _box(30, 60.5), _box(31, 60.5, key=0, outside=1)]
    path = _cvat(
        tmp_path / "a.xml",
        ("bird", "".join(listed + gone)),
        ("lamp", '<points frame="2" keyframe="1" outside="0" points="7.5,8.5"/>'),
        ("girl", _box(0, 0.5)),
        ("car", _box(0, 0.5)),
    )
    drawn, notes = read_cvat_drawn(path, exchange(renamed={"lamp": "cup"}))
    drawn = drawn
    assert [drawn.at(frame)[0].place for frame in range(1, 12)] == [
        (100 + 4 * frame, 10, 120 + 4 * frame, 30) for frame in range(11)
    ]
    assert [frame for frame in range(1, 51) if drawn.tracks[0].at(frame)] == [*range(1, 21), 31]
    assert drawn.of("cup", "point") == Track(name="cup", kind="point", keys=(KeyFrame(frame=3, place=(7, 8)),))
    assert drawn.of("girl", "head") is not None
    assert notes == (f"{path}: tracks of other labels are left out: 1 of 'car'.",)
    write_text(tmp_path / "b.drawn.csv", format_drawn(drawn))
    assert _read(tmp_path / "b.drawn.csv") == drawn


@pytest.mark.parametrize("frames", [range(1, 51), (*range(1, 7), 9, *range(20, 41, 2), 50)], ids=["all", "with gaps"])
@given(data=st.data(), offset=st.sampled_from([0, 7]))
def test_what_is_written_for_cvat_is_read_from_it(
    frames: Sequence[int], data: st.DataObject, offset: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    """To a hundredth of a pixel, in every frame, heads and whole people apart, frames missing or not."""
    kinds: list[tuple[str, Kind]] = [("bird", "box"), ("girl", "head"), ("girl", "box"), ("cup", "point")]
    found = {each: data.draw(tracks(*each)) for each in kinds}
    keys = {each: [key for key in track.keys if key.frame in frames] for each, track in found.items()}
    drawn = drawn_of({each: own for each, own in keys.items() if not all(key.outside for key in own)})
    path = tmp_path_factory.getbasetemp() / "out.xml"
    clip = exchange(PlainClip(frames), offset=offset)
    said = write_cvat_drawn(path, drawn, clip)
    assert bool(said) == (drawn.of("girl", "box") is not None)
    if not drawn.tracks:
        with pytest.raises(VfoaError, match="found <annotations> without tracks"):
            read_cvat_drawn(path, clip)
        return
    read = read_cvat_drawn(path, clip)[0]
    for frame in frames:
        one, other = ({(shape.name, shape.kind): shape.place for shape in each.at(frame)} for each in (drawn, read))
        assert one.keys() == other.keys()
        assert [*other.values()] == [pytest.approx(one[each], abs=0.011) for each in other]


def test_a_track_of_cvat_that_began_before_the_clip_is_cut(tmp_path: Path) -> None:
    path = _cvat(tmp_path / "a.xml", ("bird", _box(0, 0.5) + _box(20, 40.5) + _box(100, 0.5)), ("cup", _box(3, 0.5)))
    drawn = read_cvat_drawn(path, exchange(offset=10))[0]
    bird = drawn.of("bird", "box")
    assert bird is not None
    assert [key.frame for key in bird.keys] == [1, 11, 50]
    assert bird.at(1) == (20, 10, 40, 30)
    assert drawn.of("cup", "box") == Track(name="cup", kind="box", keys=(KeyFrame(frame=1, place=(0, 10, 20, 30)),))


def test_two_tracks_of_cvat_are_one_where_they_follow_each_other(tmp_path: Path) -> None:
    first, second = _box(0, 0.5) + _box(5, 0.5, outside=1), _box(5, 9.5) + _box(7, 9.5, outside=1)
    drawn = read_cvat_drawn(_cvat(tmp_path / "a.xml", ("bird", second), ("bird", first)), exchange())[0]
    assert [frame for frame in range(1, 51) if drawn.at(frame)] == [*range(1, 8)]
    with pytest.raises(VfoaError, match="'bird' has two tracks in frame 6 of the clip"):
        read_cvat_drawn(_cvat(tmp_path / "b.xml", ("bird", _box(0, 0.5)), ("bird", second)), exchange())
    with pytest.raises(VfoaError, match="no track is labelled with a target or a subject of this clip; found 'car'"):
        read_cvat_drawn(_cvat(tmp_path / "c.xml", ("car", _box(0, 0.5))), exchange())
    polygon = '<polygon frame="0" points="1,2;3,4;5,6"/>'
    with pytest.raises(VfoaError, match="found <polygon> of 3 points; expected a box, or one point"):
        read_cvat_drawn(_cvat(tmp_path / "d.xml", ("bird", polygon)), exchange())
