"""Labels in Praat's TextGrids: both text forms, as an independent writer and as other programs write them."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pympi.Praat import TextGrid

from harness.labels.formats.praat import Praat
from harness.labels.labels import Labels
from tests.disk import write_text
from tests.exchanges import FRAMES, PlainClip, exchange, labels_of, row
from vfoa.errors import VfoaError

LONG = """File type = "ooTextFile"
Object class = "TextGrid"

xmin = 0{blank}
xmax = 0.4{blank}
tiers? <exists>{blank}
size = 3{blank}
item []:{blank}
    item [1]:
        class = "IntervalTier"{blank}
        name = "girl"{blank}
        xmin = 0{blank}
        xmax = 0.4{blank}
        intervals: size = 3{blank}
        intervals [1]:
            xmin = 0{blank}
            xmax = 0.08{blank}
            text = "bird"{blank}
        intervals [2]:
            xmin = 0.08{blank}
            xmax = 0.24{blank}
            text = ""{blank}
        intervals [3]:
            xmin = 0.24{blank}
            xmax = 0.4{blank}
            text = "the ""old""
cup"{blank}
    item [2]:
        class = "TextTier"{blank}
        name = "clicks"{blank}
        xmin = 0{blank}
        xmax = 0.4{blank}
        points: size = 1{blank}
        points [1]:
            number = 0.1{blank}
            mark = "x"{blank}
    item [3]:
        class = "IntervalTier"{blank}
        name = "speech"{blank}
        xmin = 0{blank}
        xmax = 0.4{blank}
        intervals: size = 1{blank}
        intervals [1]:
            xmin = 0{blank}
            xmax = 0.4{blank}
            text = "well"{blank}
"""
SHORT = """File type = "ooTextFile short"
"TextGrid"

0 0.4 <exists> 3 ! times, tiers
"IntervalTier" "girl" 0 0.4 3
0 0.08 "bird"
0.08 0.24 ""
0.24 0.4 "the ""old"" cup"
"TextTier" "clicks" 0 0.4 1
0.1 "x"
"IntervalTier" "speech" 0 0.4 1
0 0.4 "well"
"""
ELAN = LONG.replace("item [", "item[").replace("]:", "]")
TEN = PlainClip(frames=range(1, 11))
"""Frame n is shown at (n - 1) / 25 s."""


def _read(path: Path, **more: object) -> tuple[Labels, tuple[str, ...]]:
    imported = Praat().read(path, exchange(TEN, renamed={'the "old" cup': "cup"}, **more))
    return imported.labels, imported.notes


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16"])
@pytest.mark.parametrize("text", [LONG.format(blank=" "), LONG.format(blank=""), SHORT, ELAN.format(blank=" ")])
def test_all_text_forms_hold_the_same_labels(tmp_path: Path, text: str, encoding: str) -> None:
    path = tmp_path / "mine.TextGrid"
    path.write_text(text, encoding=encoding)
    labels, notes = _read(path, gaps="none")
    assert labels == Labels([row(1, 2, "bird"), row(3, 6, "none"), row(7, 10, "cup")])
    assert ["'speech'" in note for note in notes] == [False, True, False]
    assert "'clicks'" in notes[-1]


@pytest.mark.parametrize("form", ["normal", "short"])
@given(frames=FRAMES, rate=st.sampled_from([24.0, 29.97, 60.0]), data=st.data())
def test_what_another_writer_wrote_is_read(
    tmp_path: Path, form: str, frames: list[int], rate: float, data: st.DataObject
) -> None:
    labels = data.draw(labels_of(frames, notes=False, points=False, tags=False, suggested=False))
    clip = exchange(PlainClip(frames=frames, rate_hz=rate))
    grid = TextGrid(xmax=1000.0)
    for subject in labels.subjects:
        tier = grid.add_tier(subject)
        for each in labels.of(subject):
            start, end = clip.shown.span_ns(each.first_frame, each.last_frame)
            tier.add_interval(start / 1e9, end / 1e9, each.label.target)
    path = tmp_path / "theirs.TextGrid"
    grid.to_file(str(path), mode=form)
    assert Praat().read(path, clip).labels == labels


def test_times_are_read_to_the_millisecond(tmp_path: Path) -> None:
    """As floating point numbers, 64.24 and 64.4 s are a little less, or more, than so many milliseconds."""
    grid = TextGrid(xmax=1000.0)
    tier = grid.add_tier("girl")
    for start in (64.24, 64.4):
        tier.add_interval(start, start + 0.04, "cup")
    path = tmp_path / "theirs.TextGrid"
    grid.to_file(str(path))
    found = Praat().read(path, exchange(PlainClip(frames=range(2000)), gaps="none")).labels.ranges
    assert [each for each in found if each.label.target == "cup"] == [row(1606, 1606, "cup"), row(1610, 1610, "cup")]


@pytest.mark.parametrize(
    ("changed", "into", "place"),
    [
        ('"ooTextFile short"', '"ooTextFile short', "mine.TextGrid:4: "),
        ('"TextGrid"', '"Collection"', "Collection"),
        ("<exists>", "3", "mine.TextGrid:4: "),
        ("<exists> 3", "<exists> 2.5", "mine.TextGrid:4: "),
        ("<exists> 3", "<exists> 4", "mine.TextGrid:12: "),
        ("<exists> 3", "<exists> -3", "mine.TextGrid:4: "),
        ('0 0.08 "bird"', '-1e300 0.08 "bird"', "mine.TextGrid:6: "),
        ('0.08 0.24 ""', '0.08 0.24 "" 7', "mine.TextGrid:8: "),
        ('"IntervalTier" "speech"', '"PitchTier" "speech"', "'speech'"),
        ('0 0.08 "bird"', '0 1e300 "bird"', "mine.TextGrid:6: "),
        ('0 0.08 "bird"', '0 0.08 "kite"', "0.000 to 0.080 s"),
        ('"girl"', '"mother"', "'mother', 'speech'"),
    ],
)
def test_what_is_no_textgrid_is_refused_with_its_line(tmp_path: Path, changed: str, into: str, place: str) -> None:
    assert changed in SHORT
    path = write_text(tmp_path / "mine.TextGrid", SHORT.replace(changed, into))
    with pytest.raises(VfoaError, match=place.replace(".", r"\.")):
        _read(path)


def test_binary_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / "mine.TextGrid"
    path.write_bytes(b"ooBinaryFile\x08TextGrid\0\0\0")
    with pytest.raises(VfoaError, match="binary"):
        _read(path)
