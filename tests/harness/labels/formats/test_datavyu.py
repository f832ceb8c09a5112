"""Labels of Datavyu: its spreadsheets and every export, the same cells in each."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

from harness.labels.formats.datavyu import Datavyu
from harness.labels.labels import Labels
from tests.disk import write_text
from tests.exchanges import PlainClip, exchange, row
from vfoa.errors import VfoaError

TEN = PlainClip(frames=range(1, 11))
"""Frame n is shown at (n - 1) / 25 s."""

DATABASE = r"""#4
trial (MATRIX,true,)-number|NOMINAL,kind|NOMINAL
00:00:00:000,00:00:00:400,(1,a\,b)
girl (MATRIX,false,seen from the left)-code01|NOMINAL
00:00:00:000,00:00:00:079,(bird)
00:00:00:080,00:00:00:240,(cup)
00:00:00:240,00:00:00:360,()
boy (MATRIX,true,)-where|NOMINAL,target|NOMINAL,note|NOMINAL
00:00:00:040,00:00:00:120,(left,girl,well\, \(so\)\
and so)
remarks (TEXT,true,)
00:00:00:000,00:00:00:400,a girl\, a boy
"""
CELLS = """boy.ordinal,boy.onset,boy.offset,boy.where,boy.target,girl.ordinal,girl.onset,girl.offset,girl.code01,
0,40,120,"left,
above",girl,0,0,79,bird,
,,,,,1,80,240,cup,
,,,,,2,240,360,,
"""
FRAMES = """nFrame,time,girl.ordinal,girl.onset,girl.offset,girl.code,boy.ordinal,boy.onset,boy.offset,boy.a,boy.target,
1,0,1,0,79,bird,,,,,,
2,40,1,0,79,bird,1,40,120,left,girl,
3,80,2,80,240,cup,1,40,120,left,girl,
4,120,2,80,240,cup,1,40,120,left,girl,
5,160,2,80,240,cup,,,,,,
10,360,3,240,360,,,,,,,
"""
EXPECTED = Labels([row(1, 2, "bird"), row(3, 6, "cup"), row(2, 4, "girl", "boy")])
PROJECT = """!project
dbFile: db
name: talk
version: 5
viewerSettings:
- !vs
  classifier: ''
  feed: /films/talk.mp4
  offset: '{offset}'
  plugin: db3fc496-58a7-3706-8538-3f61278b5bec
  settingsId: '1'
  trackSettings: !ts
    bookmarks: []
    locked: false
    version: 2
  version: 3
"""


def _opf(path: Path, database: str = DATABASE, project: str = PROJECT.format(offset=0)) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("db", database)
        archive.writestr("project", project)
        archive.writestr("1", "")
    return path


def _read(path: Path, **more: object) -> tuple[Labels, tuple[str, ...]]:
    imported = Datavyu().read(path, exchange(TEN, **more))
    return imported.labels, imported.notes


def test_a_spreadsheet_and_its_exports_hold_the_same_labels(tmp_path: Path) -> None:
    """Cells end with their offset, here a frame's own time, unless another cell begins there."""
    files = [
        _opf(tmp_path / "talk.opf"),
        write_text(tmp_path / "db", DATABASE),
        write_text(tmp_path / "cells.csv", CELLS),
        write_text(tmp_path / "frames.csv", FRAMES),
    ]
    for path in files:
        labels, notes = _read(path)
        assert labels == EXPECTED, path
        places = ("'trial'", "'remarks'", "'girl': left out: 1 ")
        assert [place for place in places if any(place in note for note in notes)] == [
            *places[0 if path in files[:2] else 2 :]
        ]


@pytest.mark.parametrize("version", ["#2", "#3", ""])
def test_earlier_versions_are_read(tmp_path: Path, version: str) -> None:
    """They have no comment, no visibility, and ``<code>`` for a code without a text."""
    kinds = "(MATRIX,true)" if version == "#3" else "(MATRIX)"
    text = DATABASE.replace("#4", version).lstrip().replace("(MATRIX,true,)", kinds).replace("()", "(<code01>)")
    text = text.replace("(MATRIX,false,seen from the left)", kinds).replace("(TEXT,true,)", "(TEXT)")
    labels, _ = _read(write_text(tmp_path / "db", text))
    assert labels == EXPECTED


def test_a_file_of_the_script_has_one_column(tmp_path: Path) -> None:
    text = """file,column,onset,offset,ordinal,who,looks_at
talk,looks,0,79,1,girl,bird
talk,looks,80,239,2,girl,cup
talk,looks,40,120,3,boy,girl
"""
    path = write_text(tmp_path / "looks.csv", text)
    assert _read(path) == (EXPECTED, ())


def test_cells_of_no_target_whose_offset_was_never_set_are_left_out(tmp_path: Path) -> None:
    """Of a coder who marks the begin and stop of each trial with a key; Datavyu writes 0 for such an offset."""
    text = """looks.ordinal,looks.onset,looks.offset,looks.code01,
0,40,0,"B",
1,40,120,"L",
2,160,280,"R",
3,280,0,"S",
"""
    renamed = {"looks": "girl", "L": "bird", "R": "cup"}
    path = write_text(tmp_path / "coder.csv", text)
    labels, notes = _read(path, renamed=renamed)
    assert labels == Labels([row(2, 4, "bird"), row(5, 7, "cup")])
    assert [note.partition(": ")[2] for note in notes if "2 cells" in note] == [
        "left out: 2 cells without an offset, of no target."
    ]
    for left_out in (["B"], ["B", "S"]):
        again, notes = _read(path, renamed=renamed | dict.fromkeys(left_out, ""))
        assert again == labels
        counted = [note.partition(": ")[2] for note in notes if "--rename" in note]
        assert counted == [f"left out: 1 label of '{name}' (--rename)." for name in left_out]
    for cell in ("40,20", "40,0"):
        with pytest.raises(VfoaError, match=r"column 'looks', 0\.040 to 0\.0.0 s: ends .* before it begins"):
            _read(write_text(tmp_path / "wrong.csv", text.replace("40,120", cell)), renamed=renamed)
    with pytest.raises(VfoaError, match=r"column 'looks', 0\.040 to 0\.000 s: ends .* before it begins"):
        _read(path, renamed={"looks": "girl:cup"})
    labels, notes = _read(write_text(tmp_path / "empty.csv", text.replace('"B"', '""')), renamed=renamed)
    assert labels == Labels([row(2, 4, "bird"), row(5, 7, "cup")])
    assert not any("--rename" in note for note in notes)


@pytest.mark.parametrize(("begins_ms", "offset", "first"), [(-80, None, 3), (40, None, 1), (-80, 0.0, 1)])
def test_the_beginning_of_the_film_is_subtracted(
    tmp_path: Path, begins_ms: int, offset: float | None, first: int
) -> None:
    """``--offset`` says where the clip begins in the spreadsheet's own time."""
    labels, notes = _read(_opf(tmp_path / "talk.opf", project=PROJECT.format(offset=begins_ms)), offset=offset)
    assert labels.of("girl")[0].first_frame == first
    assert any("offset" in note for note in notes)


def test_films_of_one_name_that_begin_at_different_times_are_refused(tmp_path: Path) -> None:
    one = PROJECT.format(offset=0)
    second = one.partition("viewerSettings:\n")[2].replace("/films/", "/side/").replace("'0'", "'-80'")
    path = _opf(tmp_path / "talk.opf", project=one + second)
    with pytest.raises(VfoaError, match=r"/films/talk\.mp4, /side/talk\.mp4; expected --offset SECONDS"):
        _read(path, film="talk.mp4")
    assert _read(path, film="talk.mp4", offset=0.0)[0] == EXPECTED


def test_times_have_hours_minutes_and_seconds(tmp_path: Path) -> None:
    text = DATABASE.replace("00:00:00:000,00:00:00:079", "01:02:03:040,01:02:03:119")
    labels, _ = _read(write_text(tmp_path / "db", text), offset=3723.0)
    assert labels == Labels([row(2, 3, "bird")])


def test_codes_that_may_be_targets_are_asked_for(tmp_path: Path) -> None:
    path = write_text(tmp_path / "db", DATABASE.replace("target|NOMINAL", "toward|NOMINAL"))
    with pytest.raises(VfoaError, match=r"'boy': found the codes where, toward, note; .*--modifier CODE"):
        _read(path)
    with pytest.raises(VfoaError, match="--modifier: no 'to'"):
        _read(path, modifier="to")
    assert _read(path, modifier="toward")[0] == EXPECTED  # the girl's column has one code


@pytest.mark.parametrize(
    ("changed", "into", "place"),
    [
        ("00:00:00:000,00:00:00:079", "00:00:00:000,00:00:79", r"db:5: offset: found '00:00:79'"),
        ("00:00:00:080,00:00:00:240", "00:00:00:080,00:00:00:000", r"'girl', 0\.080 to 0\.000 s: ends"),
        ("00:00:00:080,00:00:00:240", "00:00:00:040,00:00:00:240", r"'girl', 0\.040 to 0\.240 s: .*frame"),
        ("girl (MATRIX", "girl MATRIX", r"db:4: found 'girl MATRIX"),
        ("(bird)", "(kite)", r"'girl', 0\.000 to 0\.080 s: unknown target 'kite'"),
    ],
)
def test_what_cannot_be_read_is_refused_with_its_place(tmp_path: Path, changed: str, into: str, place: str) -> None:
    assert changed in DATABASE
    with pytest.raises(VfoaError, match=place):
        _read(write_text(tmp_path / "db", DATABASE.replace(changed, into, 1)))


def test_other_files_are_named(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "book.xlsx", "w") as archive:
        archive.writestr("xl/workbook.xml", "")
    shifted = FRAMES.replace("1,0,1,0,79,bird,,,,,,", "1,0,1,0,79,bird")
    for path, found in (
        (tmp_path / "book.xlsx", "without 'db'"),
        (write_text(tmp_path / "looks.csv", "start,end,target\n0,1,bird\n"), "looks.csv:1: found start, end, target"),
        (
            write_text(tmp_path / "ends.csv", CELLS.replace("girl.offset", "girl.ofset")),
            "ends.csv:1: found boy.ord",
        ),
        (write_text(tmp_path / "frames.csv", shifted), "frames.csv:2: found 6 cells; expected 11"),
    ):
        with pytest.raises(VfoaError, match=found):
            _read(path)
