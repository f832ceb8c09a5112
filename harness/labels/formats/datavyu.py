"""Datavyu: a column per subject, in it a cell per range, one of whose codes is the target.

A column may hold several subjects, if a code names them (``who``, or another name of
:data:`~harness.labels.formats.table_columns.COLUMNS`). A cell holds from its onset to its offset, both included, to the
millisecond (``exportByFrame`` of ``ExportDatabaseFileController``; read, not used). An offset that was never set is 0.

A spreadsheet (``.opf``) is a ZIP archive: ``db`` has a line for each column and one for each of its cells, ``project``
(YAML) the films that were open. The CSV that Datavyu and its scripts export has the columns side by side
(``looks.onset``), with a row for each of their cells or for each frame, or a row for each cell of one column
(``column``, ``onset``). The forms are those of Datavyu's own code (``OpenDataStoreFileController``,
``ExportDatabaseFileController``, ``DatavyuProjectConstructor``) and of the script ``datavyu2csv.rb``; read, not used.
"""

from __future__ import annotations

import io
import re
import zipfile
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.files.dialects import check_width, table_rows, table_text
from harness.files.io import decoded, read_bytes
from harness.files.parsing import check_archive, parse_yaml
from harness.files.tables import whole_number
from harness.labels.formats.exchange import Exchange, Imported, ReadOnly, file_name, one_line
from harness.labels.formats.tiers import Annotation, check_chosen, from_tiers, named_subject, target_code
from harness.labels.labels import NOWHERE
from vfoa.errors import VfoaError, counted

_EXPECTED = "expected Datavyu's spreadsheet (.opf), or the CSV that it exports"
_COLUMN = re.compile(r"(?P<name>(?:[^\\(]|\\.)+) \((?P<kind>[A-Za-z]+)[^)]*\)(?:-(?P<codes>.*))?")
_CELL = re.compile(r"(?P<onset>[0-9:]{8,13}),(?P<offset>[0-9:]{8,13}),(?P<values>.*)")
_CLOCK = re.compile(r"([0-9]{1,4}):([0-9]{2}):([0-9]{2}):([0-9]{3})")
_CLASS = re.compile(rb"(?m)(?:^|(?<= ))!(?:project|vs|ts)(?=\s*(?:$|\{))")
"""The tag of a table in ``project``, by which Datavyu knows its class."""
_SHIFTED = " (Datavyu's export by frame leaves out columns without cells: export the cells, or import the .opf)"
_NO_CODES = ("file", "column", "ordinal", "onset", "offset")
"""What an exported row has beside the codes of a cell."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Cell:
    """From ``onset_ms`` to ``offset_ms``, both included, with its text for each code of its column, "" for none."""

    onset_ms: int
    offset_ms: int
    codes: Mapping[str, str]


_Columns = dict[str, list[_Cell]]


class Datavyu(ReadOnly):
    """Reads the cells of subjects; others are left out, with a note for each column."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read them. ``exchange.modifier`` is the code that names the targets, of columns with several."""
        columns, begins_ms = _read_columns(path)
        check_chosen(exchange.modifier, (cell.codes for cells in columns.values() for cell in cells), path)
        film = exchange.film_of([*begins_ms], path, begin=begins_ms.get)
        origin_ms, notes = exchange.media_offset(0 if film is None else -begins_ms[film], path)
        tiers = _tiers(columns)

        points = 0

        def read(tier: str) -> list[Annotation]:
            nonlocal points
            found = _annotations(tiers.get(tier, ()), exchange.modifier, f"{path}: column {tier!r}")
            kept = [each for each in found if not _is_point(each, tier, exchange)]
            points += len(found) - len(kept)
            return kept

        sizes = {tier: len(cells) for tier, cells in tiers.items()}
        imported = from_tiers(sizes, read, exchange, path, origin_ms=origin_ms, kind="column")
        if points:
            notes.append(f"{path}: left out: {counted(points, 'cell')} without an offset, of no target.")
        return Imported(labels=imported.labels, notes=(*imported.notes, *notes))


def _tiers(columns: Mapping[str, Sequence[_Cell]]) -> dict[str, list[_Cell]]:
    """The cells by the subject that a code of theirs names, or by their column."""
    tiers = defaultdict[str, list[_Cell]](list)
    for name, cells in columns.items():
        tiers[name] += (cell for cell in cells if named_subject(cell.codes) is None)
        for cell in cells:
            if (subject := named_subject(cell.codes)) is not None:
                tiers[subject].append(cell)
    return dict(tiers)


def _annotations(cells: Sequence[_Cell], chosen: str | None, where: str) -> list[Annotation]:
    code = target_code([cell.codes for cell in cells], chosen, where, kind="code")
    onsets = {cell.onset_ms for cell in cells}
    return [(cell.onset_ms, _end_ms(cell, onsets), one_line(cell.codes.get(code))) for cell in cells]


def _is_point(annotation: Annotation, tier: str, exchange: Exchange) -> bool:
    """Whether a subject's annotation without an end is of no target, and so no look that a coder has not finished."""
    start_ms, end_ms, value = annotation
    subject = exchange.names.translate(tier)
    if not end_ms == 0 < start_ms or subject not in exchange.subjects:
        return False
    return exchange.names.translate(value, subject) not in (*exchange.targets, *exchange.subjects, NOWHERE, "")


def _end_ms(cell: _Cell, onsets: Collection[int]) -> int:
    """A cell ends after its offset, or at it if another one begins there, or it lies before the onset."""
    is_cut = cell.offset_ms < cell.onset_ms or (cell.offset_ms > cell.onset_ms and cell.offset_ms in onsets)
    return cell.offset_ms if is_cut else cell.offset_ms + 1


def _read_columns(path: Path) -> tuple[_Columns, dict[str, int]]:
    """Return the cells of each column, and the time at which each film begins in them, ms, by its path.

    Raises
    ------
    VfoaError
        If it is no such file, or a cell of it has no times.
    """
    data = read_bytes(path)
    if data.startswith(b"PK\x03\x04"):
        return _of_spreadsheet(data, path)
    if re.match(rb"(\xef\xbb\xbf)?(#[0-9]\r?\n|[^,\n]+ \((MATRIX|TEXT|NOMINAL)[,)])", data):
        return _of_database(table_text(path), str(path)), {}
    return _of_table(path), {}


def _of_spreadsheet(data: bytes, path: Path) -> tuple[_Columns, dict[str, int]]:
    check_archive(data, path)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            held = {name: archive.read(name) for name in archive.namelist() if name in ("db", "project")}
    except Exception as error:  # errors of zipfile for damaged archives have no common base class
        raise VfoaError(f"{path}: a damaged archive: {error}; {_EXPECTED}") from None
    if "db" not in held:
        raise VfoaError(f"{path}: an archive without 'db'; {_EXPECTED}")
    project = parse_yaml(_CLASS.sub(b"", held.get("project", b"")), f"{path}: project")
    return _of_database(decoded(held["db"], f"{path}: db"), f"{path}: db"), _films(project, f"{path}: project")


def _films(project: Any, where: str) -> dict[str, int]:
    """The beginning of each film, ms, which the project has as text."""
    settings = project.get("viewerSettings") if isinstance(project, dict) else None
    films = dict[str, int]()
    for each in settings if isinstance(settings, list) else []:
        if isinstance(each, dict) and isinstance(feed := each.get("feed"), str):
            text = str(each.get("offset") or 0)
            if (number := whole_number(text.removeprefix("-"))) is None:
                raise VfoaError(f"{where}: {file_name(feed)}: offset: found {text[:40]!r}; expected milliseconds")
            films[feed] = -number if text.startswith("-") else number
    return films


def _of_database(text: str, where: str) -> _Columns:
    """The columns of ``db``, in every version of it."""
    columns, names, is_matrix = _Columns(), list[str](), False
    cells: list[_Cell] | None = None
    for number, line in _joined(text):
        if (cell := _CELL.fullmatch(line)) and cells is not None:
            values = (
                _parts(cell["values"].removeprefix("(").removesuffix(")")) if is_matrix else [_plain(cell["values"])]
            )
            onset_ms, offset_ms = (_clock_ms(cell[name], f"{where}:{number}: {name}") for name in ("onset", "offset"))
            cells.append(_cell(onset_ms, offset_ms, zip(names, values, strict=False)))
        elif column := _COLUMN.fullmatch(line):
            is_matrix = column["kind"].upper() == "MATRIX"
            codes = _parts(column["codes"] or "") if is_matrix else ["value"]
            names = [code.partition("|")[0].strip() for code in codes]
            cells = columns.setdefault(_plain(column["name"]).strip(), [])
        elif number > 1 or not re.fullmatch(r"#[0-9]", line):
            raise VfoaError(f"{where}:{number}: found {line[:60]!r}; expected a column or a cell of Datavyu")
    return columns


def _joined(text: str) -> Iterator[tuple[int, str]]:
    """Number and content of each line that is not blank; a backslash at its end takes the next one to it."""
    lines = enumerate(text.replace("\r\n", "\n").split("\n"), start=1)
    for number, line in lines:
        whole = line
        while (len(whole) - len(whole.rstrip("\\"))) % 2 and (more := next(lines, None)):
            whole = f"{whole[:-1]} {more[1]}"
        if whole.strip():
            yield number, whole


def _parts(text: str) -> list[str]:
    """The parts between commas; a backslash escapes the character after it."""
    parts, signs = [""], iter(text)
    for sign in signs:
        if sign == ",":
            parts.append("")
        else:
            parts[-1] += next(signs, "") if sign == "\\" else sign
    return parts


def _plain(text: str) -> str:
    return ",".join(_parts(text))


def _clock_ms(text: str, where: str) -> int:
    if (found := _CLOCK.fullmatch(text)) is None:
        raise VfoaError(f"{where}: found {text!r}; expected a time, such as 00:01:02:345")
    hours, minutes, seconds, ms = map(int, found.groups())
    return 1000 * (3600 * hours + 60 * minutes + seconds) + ms


def _cell(onset_ms: int, offset_ms: int, values: Iterable[tuple[str, str]]) -> _Cell:
    """A cell; ``<code>`` is what earlier versions wrote for a code without a text."""
    codes = {name: "" if text.strip() == f"<{name}>" else text.strip() for name, text in values}
    return _Cell(onset_ms=onset_ms, offset_ms=offset_ms, codes=codes)


def _of_table(path: Path) -> _Columns:
    """The columns of exported CSV; a cell that has a row for each of its frames counts once."""
    rows = table_rows(path)
    if not rows:
        raise VfoaError(f"{path}: an empty table; {_EXPECTED}")
    (line, header), *below = rows
    named = [name.removesuffix(".onset") for name in header if name.endswith(".onset")]
    needed = {f"{name}.offset" for name in named} or {"column", "onset", "offset"}
    if len({*header}) < len(header) or not needed <= {*header}:
        raise VfoaError(f"{path}:{line}: found {', '.join(header)[:120]}; {_EXPECTED}")
    columns: _Columns = {name: [] for name in named}
    for number, cells in below:
        where = f"{path}:{number}"
        check_width(cells, header, where, _SHIFTED)
        row = dict(zip(header, cells, strict=True))
        for name in named or [row["column"]]:
            own = _of_column(row, name) if named else row
            if own["onset"] or own["offset"]:
                onset_ms, offset_ms = (_whole(own[key], f"{where}: {name}: {key}") for key in ("onset", "offset"))
                codes = ((key, text) for key, text in own.items() if key not in _NO_CODES)
                columns.setdefault(name, []).append(_cell(onset_ms, offset_ms, codes))
    return {name: _once(cells) for name, cells in columns.items()}


def _of_column(row: Mapping[str, str], name: str) -> dict[str, str]:
    """The cells of one column of a row, by their names without the column's (``column.onset`` is ``onset``)."""
    return {key.removeprefix(f"{name}."): text for key, text in row.items() if key.startswith(f"{name}.")}


def _whole(text: str, where: str) -> int:
    if (number := whole_number(text)) is None:
        raise VfoaError(f"{where}: found {text[:40]!r}; expected milliseconds")
    return number


def _once(cells: Sequence[_Cell]) -> list[_Cell]:
    """Cells without those that are equal to the one before."""
    return [cell for place, cell in enumerate(cells) if place == 0 or cell != cells[place - 1]]
