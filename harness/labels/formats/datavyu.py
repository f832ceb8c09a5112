"""Datavyu: a column per subject, in it a cell per range, one of whose codes is the target.

A column may hold several subjects, if a code names them (``who``, or another name of :data:`COLUMNS`). A cell holds
from its onset to its offset, both included, to the millisecond (``exportByFrame`` of ``ExportDatabaseFileController``;
read, not used).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from harness.labels.formats.datavyu_files import Cell, read_columns
from harness.labels.formats.exchange import Exchange, Imported, ReadOnly, one_line
from harness.labels.formats.own_table import COLUMNS
from harness.labels.formats.tiers import Annotation, from_tiers
from vfoa.errors import VfoaError, check_known


class Datavyu(ReadOnly):
    """Reads the cells of subjects; others are left out, with a note for each column."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read them. ``exchange.modifier`` is the code that names the targets, of columns with several."""
        columns, begins_ms = read_columns(path)
        _check_chosen(exchange.modifier, columns, path)
        film = exchange.film_of([*begins_ms], path)
        origin_ms, notes = exchange.media_offset(0 if film is None else -begins_ms[film], path)
        tiers = _tiers(columns)

        def read(tier: str) -> list[Annotation]:
            return _annotations(tiers.get(tier, ()), exchange.modifier, f"{path}: column {tier!r}")

        sizes = {tier: len(cells) for tier, cells in tiers.items()}
        imported = from_tiers(sizes, read, exchange, path, origin_ms=origin_ms, kind="column")
        return Imported(labels=imported.labels, notes=(*imported.notes, *notes))


def _check_chosen(code: str | None, columns: Mapping[str, Sequence[Cell]], path: Path) -> None:
    if code is not None:
        known = {each for cells in columns.values() for cell in cells for each in cell.codes}
        check_known(code, known, f"{path}: --modifier: no")


def _tiers(columns: Mapping[str, Sequence[Cell]]) -> dict[str, list[Cell]]:
    """The cells by the subject that a code of theirs names, or by their column."""
    tiers = defaultdict[str, list[Cell]](list)
    for name, cells in columns.items():
        tiers[name] += (cell for cell in cells if _subject(cell) is None)
        for cell in cells:
            if (subject := _subject(cell)) is not None:
                tiers[subject].append(cell)
    return dict(tiers)


def _subject(cell: Cell) -> str | None:
    return next((text for code, text in cell.codes.items() if text and _is("subject", code)), None)


def _is(kind: str, code: str) -> bool:
    return code.lower() in COLUMNS[kind]


def _annotations(cells: Sequence[Cell], chosen: str | None, where: str) -> list[Annotation]:
    code = _target_code(cells, chosen, where)
    onsets = {cell.onset_ms for cell in cells}
    return [(cell.onset_ms, _end_ms(cell, onsets), one_line(cell.codes.get(code))) for cell in cells]


def _end_ms(cell: Cell, onsets: Collection[int]) -> int:
    """A cell ends after its offset, or at it if another one begins there, or it lies before the onset."""
    is_cut = cell.offset_ms < cell.onset_ms or (cell.offset_ms > cell.onset_ms and cell.offset_ms in onsets)
    return cell.offset_ms if is_cut else cell.offset_ms + 1


def _target_code(cells: Sequence[Cell], chosen: str | None, where: str) -> str:
    """The code that names the targets: the chosen one, the only one, or the only one with a name such as target."""
    codes = [*dict.fromkeys(code for cell in cells for code in cell.codes)]
    others = [code for code in codes if not _is("subject", code)]
    named = [code for code in others if _is("target", code)]
    kinds = ([code for code in codes if code == chosen], others, named)
    found = next((each for each in kinds if len(each) == 1), None)
    if cells and found is None:
        listed = ", ".join(codes) or "none"
        raise VfoaError(f"{where}: found the codes {listed}; expected --modifier CODE, the one that names the targets")
    return found[0] if found else ""
