"""VIA 3, VGG's annotator of videos: an attribute for each subject, whose segments have the targets as values.

An attribute may hold several subjects, if it is called ``subject`` or another name of
:data:`~harness.labels.formats.table_columns.COLUMNS`: a row of VIA's timeline is then a subject, and another attribute
of the same segments has the targets.

A project (JSON) has the names of its attributes with their options, its files, its views (each one film), and its
metadata: entries with a view, times ``z`` in seconds (a segment has two), a region ``xy`` and the values ``av`` of
attributes. VIA exports two tables (CSV). That of all entries has the attributes in a comment (``# ATTRIBUTE``; in early
versions ``# ATTRIBUTES``, their names alone). That of segments (``temporal_segment_start``) has the attributes' names,
and no options. The forms are those of VIA's own code (github.com/ox-vgg/via,
``via-3.x.y/src/js/_via_import_export.js``; read, not used).
"""

from __future__ import annotations

import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from msgspec import Struct, field

from harness.files.dialects import check_width, csv_lines, table_text
from harness.files.io import read_bytes
from harness.files.parsing import parse_json_as
from harness.labels.formats.exchange import Exchange, Imported, ReadOnly, one_line
from harness.labels.formats.tiers import Annotation, check_chosen, from_tiers, named_subject, target_code
from vfoa.errors import VfoaError, counted

_EXPECTED = "expected a project (JSON) of VIA 3, or the CSV that it exports"
_OF_IMAGES = re.compile(rb'"_via_img_metadata"|"region_attributes"|\A#?filename,file_size')
"""What a project, JSON or CSV of VIA 2 has."""
_COMMENTS = re.compile(r"(?:#[^\n]*+\n?)*+")
_COMMENT = re.compile(r"# *([A-Z_]+) = ([^\n]*)")
_COLUMNS = (
    ("metadata_id", "file_list", "metadata", "temporal_coordinates", "spatial_coordinates"),
    ("metadata_id", "file_list", "metadata", "temporal_segment_start", "temporal_segment_end"),
)
_OPTIONS = (2, 3, 4, 5)
"""The types of attributes whose values are ids of options: check box, radio button, drop-down list, image."""
_LARGEST_S = 1e9

_Kind = TypeVar("_Kind")
_Value = str | int | float | bool | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Entry:
    """An entry of the metadata: a segment of a film, from ``times_s[0]`` to ``times_s[1]``, or something else.

    ``values`` has the text of each attribute by its name, "" for none; ``where`` is the entry's place in the file.
    """

    where: str
    film: str
    times_s: Sequence[float]
    has_region: bool
    values: Mapping[str, str]

    @property
    def is_segment(self) -> bool:
        """Whether it has a start and an end, and no region of the image."""
        return len(self.times_s) == 2 and not self.has_region


class Via(ReadOnly):
    """Reads the segments of subjects; other entries are left out, with a note."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read them. ``exchange.modifier`` is the attribute that names the targets, of segments with several."""
        entries, films = _read_entries(path)
        film = exchange.film_of(films, path, has_own_times=True)
        shown = [entry for entry in entries if entry.film == film]
        segments = [entry for entry in shown if entry.is_segment]
        check_chosen(exchange.modifier, (segment.values for segment in segments), path)
        tiers = _tiers(segments, exchange.modifier, path)
        sizes = {tier: len(annotations) for tier, annotations in tiers.items()}
        imported = from_tiers(sizes, lambda tier: tiers.get(tier, ()), exchange, path, kind="attribute")
        regions = sum(entry.has_region for entry in shown)
        left_out = {
            ("segment or region", "of other films"): len(entries) - len(shown),
            ("region", "of images"): regions,
            ("segment", "without a start and an end"): len(shown) - len(segments) - regions,
        }
        notes = (f"{path}: left out: {counted(n, noun)} {more}." for (noun, more), n in left_out.items() if n)
        return Imported(labels=imported.labels, notes=(*imported.notes, *notes))


def _tiers(segments: Sequence[_Entry], chosen: str | None, path: Path) -> dict[str, list[Annotation]]:
    """The annotations by the subject that an attribute of theirs names, or by their attribute."""
    tiers, named = defaultdict[str, list[Annotation]](list), defaultdict[str, list[_Entry]](list)
    for segment in segments:
        if (subject := named_subject(segment.values)) is not None:
            named[subject].append(segment)
        else:
            for attribute, text in segment.values.items():
                tiers[attribute].append(_annotation(segment, text))
    for subject, held in named.items():
        attribute = target_code(
            [segment.values for segment in held], chosen, f"{path}: subject {subject!r}", kind="attribute"
        )
        tiers[subject] += (_annotation(segment, segment.values.get(attribute, "")) for segment in held)
    return dict(tiers)


def _annotation(segment: _Entry, text: str) -> Annotation:
    start_ms, end_ms = (round(1000 * time) for time in segment.times_s)
    return start_ms, end_ms, text


class _ViaAttribute(Struct):
    aname: str
    type: int = 1
    options: dict[str, str | int | float] = field(default_factory=dict)

    def text(self, value: str) -> str:
        """The names of the options whose ids, separated by commas, are the value; else the value itself.

        A row of the timeline that the user has named is a value that is no option, also of an attribute with some.
        """
        chosen = [value] if value in self.options else value.split(",")
        is_of_options = self.type in _OPTIONS and all(each in self.options for each in chosen)
        return ", ".join(str(self.options[each]) for each in chosen) if is_of_options else value


class _ViaFile(Struct):
    fname: str


class _ViaView(Struct):
    fid_list: list[str | int]


class _ViaMetadata(Struct):
    vid: str | int
    z: list[float]
    xy: list[float]
    av: dict[str, _Value]


class _ViaProject(Struct):
    attribute: dict[str, _ViaAttribute]
    file: dict[str, _ViaFile]
    view: dict[str, _ViaView]
    metadata: dict[str, _ViaMetadata]


def _read_entries(path: Path) -> tuple[list[_Entry], list[str]]:
    """Return the entries of a file, and the names of its films.

    Raises
    ------
    VfoaError
        If it is no such file, or a value of it is not of its type, or a segment ends before it begins.
    """
    data = read_bytes(path)
    if _OF_IMAGES.search(data):
        raise VfoaError(
            f"{path}: found regions of images (VIA 2); expected its export in COCO's format, with --format coco (an "
            "attribute with options, such as a dropdown, has the names), or looks of VIA 3"
        )
    if data[:8].replace(b"\0", b"").lstrip(b"\xef\xbb\xbf\xff\xfe \r\n\t").startswith(b"#"):
        entries = list(_of_table(path))
        films = list(dict.fromkeys(entry.film for entry in entries))
    else:
        entries, films = _of_project(data, path)
    for entry in entries:
        _check_times(entry)
    return entries, films


def _of_project(data: bytes, path: Path) -> tuple[list[_Entry], list[str]]:
    project = _parsed(_ViaProject, data, path)
    films = {vid: _film(view, project.file, f"{path}: view {vid!r}") for vid, view in project.view.items()}
    entries = []
    for name, held in project.metadata.items():
        where = f"{path}: metadata {name!r}"
        if (vid := str(held.vid)) not in films:
            raise VfoaError(f"{where}: vid: found {vid!r}; expected a view: {', '.join(map(repr, films)) or 'none'}")
        entries.append(
            _Entry(
                where=where,
                film=films[vid],
                times_s=held.z,
                has_region=bool(held.xy),
                values=_texts(held.av, project.attribute, where),
            )
        )
    shown = Counter(films[vid] for vid in {str(held.vid) for held in project.metadata.values()})
    if twice := next((name for name, count in shown.items() if count > 1), None):
        raise VfoaError(
            f"{path}: found segments of {shown[twice]} films called {twice!r}; expected one: remove the others in VIA"
        )
    return entries, list(dict.fromkeys(films.values()))


def _film(view: _ViaView, files: Mapping[str, _ViaFile], where: str) -> str:
    """The name of a view's first file; segments are those of a view of one film."""
    fid = str(view.fid_list[0]) if view.fid_list else "none"
    if fid not in files:
        raise VfoaError(f"{where}: fid_list: found {fid!r}; expected a file: {', '.join(map(repr, files)) or 'none'}")
    return files[fid].fname


def _of_table(path: Path) -> Iterator[_Entry]:
    text = table_text(path)
    head = match[0] if (match := _COMMENTS.match(text)) else ""
    comments = dict(_COMMENT.findall(head))
    columns = [name for cell in comments.get("CSV_HEADER", "").split(",") if (name := cell.strip(' \r"'))]
    if not any({*needed} <= {*columns} for needed in _COLUMNS):
        found = ", ".join(columns) or head.partition("\n")[0][:60]
        listed = " or ".join(",".join(needed) for needed in _COLUMNS)
        raise VfoaError(f"{path}: found {found!r}; {_EXPECTED}: # CSV_HEADER = {listed}")
    attributes = _attributes(comments, path)
    for line, cells in csv_lines(text[len(head) :], path, head.count("\n"), ","):
        while len(cells) > len(columns) and not cells[-1].strip():
            cells.pop()
        where = f"{path}:{line}"
        check_width(cells, columns, where)
        row = dict(zip(columns, cells, strict=True))
        films = _cell(list[str], row, "file_list", where)
        ends = [name for name in ("temporal_segment_start", "temporal_segment_end") if row.get(name, "").strip()]
        yield _Entry(
            where=where,
            film=films[0] if films else "",
            times_s=(
                _cell(list[float], row, "temporal_coordinates", where)
                if "temporal_coordinates" in row
                else [_cell(float, row, name, where) for name in ends]
            ),
            has_region="spatial_coordinates" in row and bool(_cell(list[float], row, "spatial_coordinates", where)),
            values=_texts(_cell(dict[str, _Value], row, "metadata", where), attributes, where),
        )


def _attributes(comments: Mapping[str, str], path: Path) -> dict[str, _ViaAttribute]:
    """The attributes by id, which the table of segments does not have."""
    where = f"{path}: # ATTRIBUTE (a spreadsheet program damages it)"
    if "ATTRIBUTE" in comments:
        return _parsed(dict[str, _ViaAttribute], comments["ATTRIBUTE"].encode(), where)
    names = _parsed(dict[str, str], comments.get("ATTRIBUTES", "{}").encode(), where)
    return {key: _ViaAttribute(aname=name) for key, name in names.items()}


def _cell(kind: type[_Kind], row: Mapping[str, str], column: str, where: str) -> _Kind:
    return _parsed(kind, row[column].encode(), f"{where}: {column}")


def _parsed(kind: type[_Kind], data: bytes, where: object) -> _Kind:
    try:
        return parse_json_as(kind, data, where)
    except VfoaError as error:
        raise VfoaError(f"{error}; {_EXPECTED}") from None


def _texts(values: Mapping[str, _Value], attributes: Mapping[str, _ViaAttribute], where: str) -> dict[str, str]:
    """The text of each attribute by its name; an id without an attribute names itself."""
    texts = dict[str, str]()
    for key, value in values.items():
        attribute = attributes.get(key) or _ViaAttribute(aname=key)
        name, text = attribute.aname or key, one_line("" if value is None else attribute.text(str(value)))
        if text and texts.get(name):
            raise VfoaError(f"{where}: two values of attributes called {name!r}; expected one: rename one in VIA")
        texts[name] = texts.get(name) or text
    return texts


def _check_times(entry: _Entry) -> None:
    times = entry.times_s
    is_ordered = all(abs(time) <= _LARGEST_S for time in times) and list(times) == sorted(times)
    if entry.is_segment and not is_ordered:
        raise VfoaError(f"{entry.where}: found the times {list(times)}; expected start and end, seconds, in this order")
