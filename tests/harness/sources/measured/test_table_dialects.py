"""Tables of people as spreadsheets, pandas, NumPy and R write them: the same values, or the cause in one line."""

from __future__ import annotations

import codecs
from pathlib import Path

import numpy as np
import pytest

from harness.sources import MeasuredClip
from harness.sources.measured.tables import MeasuredTables
from tests.measured import measured_tables, open_measured
from vfoa.errors import VfoaError

HEADER = "frame,time_s,person,x_m,y_m,z_m,head_x,head_y,head_z"
ROWS = [f"{number},{number / 10:.1f},ann,0.5,0.25,2.5,0.6,0,0.8" for number in range(1, 4)]
PLAIN = "\n".join([HEADER, *ROWS]) + "\n"
GERMAN = PLAIN.replace(",", ";").replace(".", ",")
NUMBERED = [f"{number},{row}" for number, row in enumerate(ROWS)]
QUOTED = [f'"{number}",{row}'.replace("ann", '"ann"') for number, row in enumerate(ROWS, start=1)]
QUOTED_HEADER = ",".join(f'"{name}"' for name in HEADER.split(","))

DIALECTS: dict[str, str | bytes] = {
    "semicolons": PLAIN.replace(",", ";"),
    "German Excel": GERMAN,
    "Excel's separator line": "sep=;\r\n" + GERMAN.replace("\n", "\r\n"),
    "tabs": PLAIN.replace(",", "\t"),
    "tabs and decimal commas": GERMAN.replace(";", "\t"),
    "bars": PLAIN.replace(",", "|"),
    "Unicode text of Excel": codecs.BOM_UTF16_LE + GERMAN.replace(";", "\t").encode("utf-16-le"),
    "UTF-16, big-endian": codecs.BOM_UTF16_BE + PLAIN.encode("utf-16-be"),
    "UTF-16 without a mark": PLAIN.encode("utf-16-le"),
    "UTF-8 with a mark": codecs.BOM_UTF8 + PLAIN.encode(),
    "capitals": PLAIN.replace(HEADER, "Frame,Time_s,PERSON,X_m,Y_m,Z_m,Head_X,Head_Y,Head_Z"),
    "float frames": PLAIN.replace("\n1,", "\n1.0,").replace("\n2,", "\n2.0,"),
    "NumPy's header and numbers": PLAIN.replace("frame", "# frame").replace("\n2,", "\n2.000000000000000000e+00,"),
    "blank cells at row ends": "\n".join([HEADER, *(f"{row},," for row in ROWS)]),
    "blank columns": "\n".join([f"{HEADER},,", *(f"{row},," for row in ROWS)]),
    "empty rows": f"{PLAIN},,,,,,,,\n\n",
    "pandas' index": "\n".join([f",{HEADER}", *NUMBERED]),
    "pandas' index, read and written": "\n".join([f"Unnamed: 0,{HEADER}", *NUMBERED]),
    "write.csv of R": "\n".join([f'"",{QUOTED_HEADER}', *QUOTED]),
    "write.table of R": "\n".join([QUOTED_HEADER, *QUOTED]).replace(",", " "),
    "old line ends": PLAIN.replace("\n", "\r"),
}


def _clip(folder: Path, content: str | bytes, name: str = "people.csv") -> MeasuredClip:
    (folder / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    (recognised,) = MeasuredTables.recognise(folder, {})
    return open_measured("measured", folder, **recognised.source)


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_dialect_has_the_values_of_the_plain_table(tmp_path: Path, dialect: str) -> None:
    clip = _clip(tmp_path, DIALECTS[dialect])
    assert (tuple(clip.frames), dict(clip.people)) == ((1, 2, 3), {"ann": 1})
    assert [clip.time_ns(number) for number in clip.frames] == [100_000_000, 200_000_000, 300_000_000]
    for number in clip.frames:
        (person,) = clip.scene(number).people
        assert person.view.head_pose is not None
        np.testing.assert_array_equal(person.eye_origin_left, [0.5, 0.25, 2.5])
        np.testing.assert_array_equal(person.view.head_pose.direction, [0.6, 0, 0.8])


@pytest.mark.parametrize("word", ["nan", "NaN", "NA", "None", "NULL", "<NA>", "#N/A", ""])
def test_words_for_a_missing_value_are_blanks(tmp_path: Path, word: str) -> None:
    no_head = PLAIN.replace("2,0.2,ann,0.5,0.25,2.5,0.6,0,0.8", f"2,0.2,ann,0.5,0.25,2.5,{word},{word},{word}")
    clip = _clip(tmp_path, no_head + ",".join(["4", "0.4", *[word] * 7]) + "\n")
    assert clip.scene(2).people[0].view.head_pose is None
    assert clip.scene(4).people == ()
    assert dict(clip.people) == {"ann": 1}


@pytest.mark.parametrize("word", ["nan", "NA", ""])
def test_objects_of_other_programs_are_the_plain_ones(tmp_path: Path, word: str) -> None:
    (tmp_path / "people.tsv").write_text(PLAIN.replace(",", "\t"))
    rows = [f"{word};lamp;0,5;0;2;{word}", "1,0;cup;0;0;1,5;Mug"]
    (tmp_path / "objects.csv").write_text("\n".join(["Frame;Object;x_m;y_m;z_m;category", *rows]))
    (recognised,) = MeasuredTables.recognise(tmp_path, {})
    clip = open_measured("measured", tmp_path, **recognised.source)
    assert dict(clip.categories) == {"ann": "person", "lamp": "lamp", "cup": "Mug"}
    boxes = [[target.box.center_m.tolist() for target in clip.scene(at).targets[1:] if target.box] for at in (1, 2)]
    assert boxes == [[[0.5, 0, 2], [0, 0, 1.5]], [[0.5, 0, 2]]]


@pytest.mark.parametrize(
    ("content", "line", "cause"),
    [
        (PLAIN.replace("ann", "Jürgen").encode("cp1252"), ":2: ", "CSV UTF-8.*encoding"),
        (b"PK\x03\x04" + bytes(30), ": ", "workbook"),
        (PLAIN.replace("0.25", "0,25"), ":2: ", "10 cells.*decimal commas"),
        (PLAIN.replace("0.25", '"0,25"'), ":2: y_m: ", "decimal point"),
        (GERMAN.replace("2,5", "1.234"), ":2: ", r"found '1\.234', .*'0,1' in line 2"),
        (PLAIN.replace("\n2,", "\n2.5,"), ":3: frame: ", "whole number"),
        (PLAIN.replace("time_s", "time_ns").replace(",0.1,", ",1.7E+18,"), ":2: time_ns: ", "digits were cut off"),
        (PLAIN.replace("ann", "NA"), ":2: person: ", "found 'NA' beside measurements"),
        (PLAIN.replace("ann", ""), ":2: person: ", "found nothing beside measurements"),
        ("\n".join([f"{HEADER},ok", *(f"{row},TRUE" for row in ROWS)]), ":1: ", "'ok' holds True and False"),
        ("\n".join([f",{HEADER}", *(f"a,{row}" for row in ROWS)]), ":2: column 1: ", "index=False"),
        ("a;b\n1;2\n", ":1: ", "no column 'a'"),
    ],
)
def test_what_is_ambiguous_names_its_cause(tmp_path: Path, content: str | bytes, line: str, cause: str) -> None:
    with pytest.raises(VfoaError, match=cause) as error:
        _clip(tmp_path, content)
    assert str(error.value).startswith(f"{tmp_path / 'people.csv'}{line}")


def test_a_workbook_beside_is_named(tmp_path: Path) -> None:
    (tmp_path / "people.xlsx").write_bytes(b"PK\x03\x04" + bytes(30))
    with pytest.raises(VfoaError, match=r"people\.xlsx: a workbook"):
        MeasuredTables.recognise(tmp_path, {})


def test_own_tables_in_another_dialect_are_the_same_clip(tmp_path: Path) -> None:
    own = measured_tables(tmp_path / "own")
    other = tmp_path / "other"
    other.mkdir()
    for name in ("people.csv", "objects.csv"):
        text = (own / name).read_text().replace(",", ";").replace(".", ",")
        (other / name).write_bytes(codecs.BOM_UTF16_LE + text.encode("utf-16-le"))
    clips = [open_measured("measured", folder, objects_file="objects.csv") for folder in (own, other)]
    assert clips[0].frames == clips[1].frames
    for number in clips[0].frames:
        assert repr(clips[0].scene(number)) == repr(clips[1].scene(number))
