"""Segments of VIA 3: its project and both tables that it exports, in the form of genuine ones."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.labels.formats.exchange import Imported
from harness.labels.formats.via import Via
from harness.labels.labels import Labels
from tests.disk import write_text
from tests.exchanges import FRAMES, PlainClip, exchange, labels_of, row
from vfoa.errors import VfoaError

TEN = PlainClip(frames=range(1, 11))
"""Frame n is shown at (n - 1) / 25 s."""
TEXT, CHECK_BOX, SELECT = 1, 2, 4
GIRL = {"1": ("girl", TEXT, {})}


@dataclass(frozen=True, kw_only=True)
class Annotated:
    """What somebody annotated: attributes (name, type, options) by id, and entries, each of a film of the list."""

    entries: Sequence[tuple[int, Sequence[float], Sequence[float], Mapping[str, Any]]]
    attributes: Mapping[str, tuple[str, int, Mapping[str, str]]] = field(default_factory=lambda: GIRL)
    films: Sequence[str] = ("talk.mp4",)

    def _attributes(self) -> dict[str, Any]:
        rest = {"anchor_id": "FILE1_Z2_XY0", "desc": "", "default_option_id": ""}
        return {
            key: {"aname": name, "type": kind, "options": options, **rest}
            for key, (name, kind, options) in self.attributes.items()
        }

    def project(self) -> str:
        views = {str(n): name for n, name in enumerate(self.films, start=1)}
        metadata = {
            f"{film + 1}_{n:08d}": {"vid": str(film + 1), "flg": 0, "z": times, "xy": region, "av": values}
            for n, (film, times, region, values) in enumerate(self.entries)
        }
        document = {
            "project": {"pid": "__VIA_PROJECT_ID__", "pname": "looks", "vid_list": [*views]},
            "config": {"file": {"loc_prefix": {"1": ""}}, "ui": {"gtimeline_visible_row_count": "4"}},
            "attribute": self._attributes(),
            "file": {n: {"fid": n, "fname": name, "type": 4, "loc": 1, "src": ""} for n, name in views.items()},
            "metadata": metadata,
            "view": {n: {"fid_list": [n]} for n in views},
        }
        return json.dumps(document, ensure_ascii=False)

    def table(self) -> str:
        rows = [
            (f"{film + 1}_{n}", [self.films[film]], 0, times, region, values)
            for n, (film, times, region, values) in enumerate(self.entries)
        ]
        columns = "metadata_id,file_list,flags,temporal_coordinates,spatial_coordinates,metadata"
        return _exported({"SHAPE_ID": {"POINT": 1}, "ATTRIBUTE": self._attributes()}, columns, rows)

    def segments(self) -> str:
        """The table of segments; a time that is missing is a blank cell."""
        rows = [
            (f"{film + 1}_{n}", [self.films[film]], *(*times, "", "")[:2], self._named(values))
            for n, (film, times, _, values) in enumerate(self.entries)
        ]
        return _exported({}, "metadata_id,file_list,temporal_segment_start,temporal_segment_end,metadata", rows)

    def _named(self, values: Mapping[str, Any]) -> dict[str, Any]:
        return {self.attributes[key][0]: value for key, value in values.items()}


def _exported(comments: Mapping[str, Any], columns: str, rows: Sequence[Sequence[Any]]) -> str:
    text = io.StringIO()
    text.write("# Exported using VGG Image Annotator (http://www.robots.ox.ac.uk/~vgg/software/via)\n# Notes:\n")
    text.writelines(f"# {key} = {json.dumps(value)}\n" for key, value in comments.items())
    text.write(f"# CSV_HEADER = {columns}\n")
    for cells in rows:
        csv.writer(text, lineterminator="\n").writerow(
            json.dumps(cell) if isinstance(cell, (dict, list, tuple)) else cell for cell in cells
        )
    return text.getvalue()


FORMS = {"looks.json": Annotated.project, "looks.csv": Annotated.table, "segments.csv": Annotated.segments}
LOOKS = Annotated(entries=[(0, [0, 0.08], [], {"1": "bird"}), (0, [0.24, 0.4], [], {"1": "cup"})])


def _read(path: Path, text: str, **more: Any) -> Imported:
    return Via().read(write_text(path, text), exchange(TEN, **more))


@pytest.mark.parametrize("name", FORMS)
def test_all_forms_hold_the_same_labels(tmp_path: Path, name: str) -> None:
    imported = _read(tmp_path / name, FORMS[name](LOOKS), gaps="none")
    assert imported.labels == Labels([row(1, 2, "bird"), row(3, 6, "none"), row(7, 10, "cup")])


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16"])
def test_tables_of_other_encodings_are_read(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "looks.csv"
    path.write_text(LOOKS.table().replace("\n", "\r\n"), encoding=encoding, newline="")
    assert Via().read(path, exchange(TEN)).labels.of("girl")[0] == row(1, 2, "bird")


@given(frames=FRAMES, rate=st.sampled_from([24.0, 29.97, 60.0]), name=st.sampled_from([*FORMS]), data=st.data())
def test_the_segments_of_labels_are_these_labels(
    tmp_path_factory: pytest.TempPathFactory, frames: list[int], rate: float, name: str, data: st.DataObject
) -> None:
    labels = data.draw(labels_of(frames, notes=False, points=False, tags=False, suggested=False))
    clip = exchange(PlainClip(frames=frames, rate_hz=rate))
    attributes = {subject: (subject, TEXT, {}) for subject in labels.subjects}
    entries = [
        (0, [ns / 1e9 for ns in clip.shown.span_ns(each.first_frame, each.last_frame)], [], {subject: target})
        for subject in labels.subjects
        for each in labels.of(subject)
        for target in [each.label.target]
    ]
    text = FORMS[name](Annotated(entries=entries, attributes=attributes))
    path = write_text(tmp_path_factory.mktemp("via") / name, text)
    assert Via().read(path, clip).labels == labels


@pytest.mark.parametrize("form", [Annotated.project, Annotated.table])
def test_the_ids_of_options_are_looked_up(tmp_path: Path, form: Any) -> None:
    """A value that is no option is the name of a row of the timeline, also where there are options."""
    options = {"0": "bird", "1": "cup"}
    attributes = {"1": ("girl", SELECT, options), "2": ("boy", CHECK_BOX, options)}
    values: list[dict[str, Any]] = [{"1": "1"}, {"1": "none"}, {"2": "0"}]
    entries = [(0, [0.08 * n, 0.08 * (n + 1)], [], each) for n, each in enumerate(values)]
    imported = _read(tmp_path / "looks", form(Annotated(entries=entries, attributes=attributes)))
    assert imported.labels == Labels([row(1, 2, "cup"), row(3, 4, "none"), row(5, 6, "bird", "boy")])


@pytest.mark.parametrize(("ids", "target"), [("0,1", "bird, cup"), ("0,7", "0,7")])
def test_several_ticked_boxes_are_no_target(tmp_path: Path, ids: str, target: str) -> None:
    attributes = {"1": ("girl", CHECK_BOX, {"0": "bird", "1": "cup"})}
    text = Annotated(entries=[(0, [0, 0.4], [], {"1": ids})], attributes=attributes).project()
    with pytest.raises(VfoaError, match=f"'{target}'"):
        _read(tmp_path / "looks.json", text)


def test_a_script_may_have_given_options_ids_with_a_comma(tmp_path: Path) -> None:
    attributes = {"1": ("girl", SELECT, {"toy, red": "cup", "toy": "bird"})}
    text = Annotated(entries=[(0, [0, 0.4], [], {"1": "toy, red"})], attributes=attributes).project()
    assert _read(tmp_path / "looks.json", text).labels == Labels([row(1, 10, "cup")])


@pytest.mark.parametrize("name", FORMS)
def test_times_are_read_to_the_millisecond(tmp_path: Path, name: str) -> None:
    """As floating point numbers, 64.24 and 64.4 s are a little less, or more, than so many milliseconds."""
    entries: list[Any] = [(0, times, [], {"1": "cup"}) for times in ([64.24, 64.28], [64.4, 64.44])]
    path = write_text(tmp_path / name, FORMS[name](Annotated(entries=entries)))
    found = Via().read(path, exchange(PlainClip(frames=range(2000)), gaps="none")).labels.ranges
    assert [each for each in found if each.label.target == "cup"] == [row(1606, 1606, "cup"), row(1610, 1610, "cup")]


@pytest.mark.parametrize("blank", [",,", ", ,"])
def test_blank_cells_at_the_end_of_rows_are_no_cells(tmp_path: Path, blank: str) -> None:
    """A spreadsheet program makes all rows as long as the longest one."""
    text = "".join(f"{line}{blank}\n" for line in LOOKS.segments().splitlines())
    assert _read(tmp_path / "looks.csv", text, gaps="none").labels.of("girl")[0] == row(1, 2, "bird")


def test_an_attribute_without_a_name_is_known_by_its_id(tmp_path: Path) -> None:
    attributes: Any = {"girl": ("", TEXT, {})}
    entries: list[Any] = [(0, [0, 0.2], [], {"girl": "cup"}), (0, [0.2, 0.4], [], {"girl": None})]
    text = Annotated(entries=entries, attributes=attributes).project()
    assert _read(tmp_path / "looks.json", text).labels == Labels([row(1, 5, "cup")])


def test_texts_are_no_ids_of_options(tmp_path: Path) -> None:
    attributes = {"1": ("girl", TEXT, {"bird": "Default"})}
    text = Annotated(entries=[(0, [0, 0.4], [], {"1": "bird"})], attributes=attributes).project()
    assert _read(tmp_path / "looks.json", text).labels == Labels([row(1, 10, "bird")])


def test_the_table_of_segments_has_ids_which_are_renamed(tmp_path: Path) -> None:
    attributes = {"1": ("girl", SELECT, {"0": "bird"})}
    text = Annotated(entries=[(0, [0, 0.4], [], {"1": "0"})], attributes=attributes).segments()
    imported = _read(tmp_path / "looks.csv", text, renamed={"0": "bird"})
    assert imported.labels == Labels([row(1, 10, "bird")])


def test_an_early_table_has_the_names_of_attributes_alone(tmp_path: Path) -> None:
    text = LOOKS.table().replace("# ATTRIBUTE = ", '# ATTRIBUTES = {"1": "girl"}\n# Left out: ')
    assert _read(tmp_path / "looks.csv", text, gaps="none").labels.of("girl")[0] == row(1, 2, "bird")


@pytest.mark.parametrize(("name", "modifier"), [("looks_at", None), ("attention", "attention")])
def test_rows_of_the_timeline_are_subjects_if_their_attribute_says_so(
    tmp_path: Path, name: str, modifier: str | None
) -> None:
    attributes = {"1": ("who", TEXT, {}), "2": (name, SELECT, {"0": "bird", "1": "girl"}), "3": ("mood", TEXT, {})}
    entries: list[Any] = [
        (0, [0, 0.2], [], {"1": "girl", "2": "0", "3": "calm"}),
        (0, [0.2, 0.4], [], {"1": "boy", "2": "1", "3": ""}),
    ]
    text = Annotated(entries=entries, attributes=attributes).project()
    imported = _read(tmp_path / "looks.json", text, modifier=modifier)
    assert imported.labels == Labels([row(1, 5, "bird"), row(6, 10, "girl", "boy")])


def test_an_attribute_of_targets_is_asked_for(tmp_path: Path) -> None:
    attributes = {"1": ("who", TEXT, {}), "2": ("eyes", TEXT, {}), "3": ("mood", TEXT, {})}
    text = Annotated(
        entries=[(0, [0, 0.2], [], {"1": "girl", "2": "bird", "3": "calm"})], attributes=attributes
    ).project()
    with pytest.raises(VfoaError, match=r"'girl'.* who, eyes, mood.*--modifier ATTRIBUTE"):
        _read(tmp_path / "looks.json", text)
    with pytest.raises(VfoaError, match="--modifier: no 'eye'; did you mean 'eyes'"):
        _read(tmp_path / "looks.json", text, modifier="eye")


@pytest.mark.parametrize("name", FORMS)
def test_one_of_several_films_is_chosen(tmp_path: Path, name: str) -> None:
    """An offset holds for one film: it does not choose."""
    text = FORMS[name](
        Annotated(entries=[(0, [0, 0.4], [], {"1": "cup"}), (1, [0, 0.4], [], {"1": "bird"})], films=["a.mp4", "b.mp4"])
    )
    bird = Labels([row(1, 10, "bird")])
    assert _read(tmp_path / name, text, film="b.mp4").labels == bird
    chosen = _read(tmp_path / name, text, films={"b.mp4": 0.0})
    assert chosen.labels == bird
    assert any("1 segment or region" in note for note in chosen.notes)
    for more in ({}, {"offset": 0.0}):
        with pytest.raises(VfoaError, match=r"a\.mp4, b\.mp4; expected --film NAME"):
            _read(tmp_path / name, text, **more)


def test_segments_of_two_films_of_one_name_are_not_mixed(tmp_path: Path) -> None:
    entries: list[Any] = [(0, [0, 0.2], [], {"1": "cup"}), (1, [0.2, 0.4], [], {"1": "bird"})]
    films = ["a.mp4", "a.mp4"]
    with pytest.raises(VfoaError, match=r"looks\.json: found segments of 2 films called 'a\.mp4'"):
        _read(tmp_path / "looks.json", Annotated(entries=entries, films=films).project())
    one = _read(tmp_path / "looks.json", Annotated(entries=entries[:1], films=films).project())
    assert one.labels == Labels([row(1, 5, "cup")])


@pytest.mark.parametrize(("name", "counts"), [("looks.json", (2, 1)), ("looks.csv", (2, 1)), ("segments.csv", (0, 3))])
def test_regions_and_times_without_an_end_are_counted(tmp_path: Path, name: str, counts: tuple[int, int]) -> None:
    """The table of segments does not say what is a region."""
    box = [2, 10, 20, 30.5, 40]
    left_out: list[Any] = [(0, [0.1], box, {"1": "bird"}), (0, [], box, {"1": "bird"}), (0, [0.1], [], {"1": "x"})]
    imported = _read(tmp_path / name, FORMS[name](Annotated(entries=[*LOOKS.entries, *left_out])), gaps="none")
    assert imported.labels.of("girl") == (row(1, 2, "bird"), row(3, 6, "none"), row(7, 10, "cup"))
    found = tuple(
        next((int(found[1]) for note in imported.notes if (found := re.search(rf"left out: (\d+) {what}", note))), 0)
        for what in ("regions? of images", "segments? without a start and an end")
    )
    assert found == counts


@pytest.mark.parametrize(
    ("changed", "into", "place"),
    [
        ('"metadata": {"1', '"metadata": {1', "not JSON"),
        ('"metadata"', '"metadatas"', "metadata"),
        ('"fname"', '"name"', r"file\[\.\.\.\].*fname"),
        ("[0, 0.08]", "[0.08, 0]", r"'1_00000000'.*\[0\.08, 0\.0\]"),
        ("[0, 0.08]", '[0, "nan"]', r"'1_00000000'.*\[0\.0, nan\]"),
        ("[0, 0.08]", "[0, 1e300]", "'1_00000000'"),
        ("[0, 0.08]", "0.08", "metadata.*z"),
        ('{"1": "cup"}', '{"1": ["cup"]}', "metadata.*av"),
        ('{"1": "cup"}', '{"1": "kite"}', r"0\.240 to 0\.400 s.*'kite'"),
        ('"vid": "1"', '"vid": "2"', "'1_00000000': vid: found '2'"),
        ('"fid_list": ["1"]', '"fid_list": ["7"]', "view '1': fid_list: found '7'"),
        ('"aname": "girl"', '"aname": "mother"', "found 'mother'"),
    ],
)
def test_a_wrong_project_is_refused_with_its_key(tmp_path: Path, changed: str, into: str, place: str) -> None:
    text = LOOKS.project()
    assert changed in text
    with pytest.raises(VfoaError, match=rf"looks\.json: .*({place})") as caught:
        _read(tmp_path / "looks.json", text.replace(changed, into))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "changed", "into", "place"),
    [
        ("looks.csv", "CSV_HEADER", "HEADER", "looks.csv: .*Exported"),
        ("looks.csv", "temporal_coordinates", "time", "looks.csv: .*time"),
        ("looks.csv", '"[0, 0.08]"', '"[0.08, 0]"', r"looks.csv:6: .*\[0\.08, 0\.0\]"),
        ("looks.csv", '"[0, 0.08]"', "x", "looks.csv:6: temporal_coordinates: not JSON"),
        ("looks.csv", '"[0, 0.08]",[]', '"[0, 0.08]"', "looks.csv:6: found 5 cells; expected 6"),
        ("looks.csv", '# ATTRIBUTE = {"1"', "# ATTRIBUTE = {1", "looks.csv: # ATTRIBUTE"),
        ("looks.csv", '"{""1"": ""cup""}"', '"cup', "looks.csv:7: not CSV"),
        ("looks.csv", '"{""1"": ""cup""}"', '"[""cup""]"', "looks.csv:7: metadata"),
        ("segments.csv", "0.08", "0:08", "segments.csv:4: temporal_segment_end"),
        ("segments.csv", '""bird""}"', '""bird""}",1', "segments.csv:4: found 6 cells; expected 5"),
        ("segments.csv", "0.08", "-0.08", "segments.csv:4: "),
    ],
)
def test_a_wrong_table_is_refused_with_its_line(tmp_path: Path, name: str, changed: str, into: str, place: str) -> None:
    text = FORMS[name](LOOKS)
    assert changed in text
    with pytest.raises(VfoaError, match=place) as caught:
        _read(tmp_path / name, text.replace(changed, into))
    assert "\n" not in str(caught.value)


def test_attributes_of_one_name_do_not_hide_each_other(tmp_path: Path) -> None:
    attributes = {"1": ("girl", TEXT, {}), "2": ("girl", TEXT, {})}
    values: list[dict[str, Any]] = [{"1": "bird", "2": ""}, {"1": "", "2": "cup"}]
    entries = [(0, [0.2 * n, 0.2 * (n + 1)], [], each) for n, each in enumerate(values)]
    imported = _read(tmp_path / "looks.json", Annotated(entries=entries, attributes=attributes).project())
    assert imported.labels == Labels([row(1, 5, "bird"), row(6, 10, "cup")])
    both = Annotated(entries=[(0, [0, 0.4], [], {"1": "bird", "2": "cup"})], attributes=attributes)
    with pytest.raises(VfoaError, match="called 'girl'"):
        _read(tmp_path / "looks.json", both.project())


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b'{"_via_settings": {}, "_via_img_metadata": {}}', "VIA 2"),
        (b'{"1.png55": {"filename": "1.png", "regions": [{"region_attributes": {}}]}}', "VIA 2"),
        (b"#filename,file_size,file_attributes\nimg_0001.png,55,{}\n", "VIA 2"),
        (b"filename,file_size,file_attributes\nimg_0001.png,55,{}\n", "VIA 2"),
        (b"[]", "Expected `object`"),
        (LOOKS.project().encode().replace(b"cup", b"\xe9"), "not JSON"),
        (LOOKS.table().encode().replace(b"cup", b"\xe9"), "not UTF-8"),
        (b"", "not JSON"),
    ],
)
def test_other_files_are_named(tmp_path: Path, content: bytes, found: str) -> None:
    path = tmp_path / "theirs"
    path.write_bytes(content)
    with pytest.raises(VfoaError, match=f"theirs.*{found}.*expected"):
        Via().read(path, exchange(TEN))
