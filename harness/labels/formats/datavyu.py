"""Datavyu: a column per subject, in it a cell per range, one of whose codes is the target.

A column may hold several subjects, if a code names them (``who``, or another name of
:data:`~harness.labels.formats.own_table.COLUMNS`). A cell holds from its onset to its offset, both included, to the
millisecond (``exportByFrame`` of ``ExportDatabaseFileController``; read, not used).
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from harness.labels.formats.datavyu_files import Cell, read_columns
from harness.labels.formats.exchange import Exchange, Imported, ReadOnly, one_line
from harness.labels.formats.tiers import Annotation, check_chosen, from_tiers, named_subject, target_code


class Datavyu(ReadOnly):
    """Reads the cells of subjects; others are left out, with a note for each column."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read them. ``exchange.modifier`` is the code that names the targets, of columns with several."""
        columns, begins_ms = read_columns(path)
        check_chosen(exchange.modifier, (cell.codes for cells in columns.values() for cell in cells), path)
        film = exchange.film_of([*begins_ms], path)
        origin_ms, notes = exchange.media_offset(0 if film is None else -begins_ms[film], path)
        tiers = _tiers(columns)

        def read(tier: str) -> list[Annotation]:
            return _annotations(tiers.get(tier, ()), exchange.modifier, f"{path}: column {tier!r}")

        sizes = {tier: len(cells) for tier, cells in tiers.items()}
        imported = from_tiers(sizes, read, exchange, path, origin_ms=origin_ms, kind="column")
        return Imported(labels=imported.labels, notes=(*imported.notes, *notes))


def _tiers(columns: Mapping[str, Sequence[Cell]]) -> dict[str, list[Cell]]:
    """The cells by the subject that a code of theirs names, or by their column."""
    tiers = defaultdict[str, list[Cell]](list)
    for name, cells in columns.items():
        tiers[name] += (cell for cell in cells if named_subject(cell.codes) is None)
        for cell in cells:
            if (subject := named_subject(cell.codes)) is not None:
                tiers[subject].append(cell)
    return dict(tiers)


def _annotations(cells: Sequence[Cell], chosen: str | None, where: str) -> list[Annotation]:
    code = target_code([cell.codes for cell in cells], chosen, where, kind="code")
    onsets = {cell.onset_ms for cell in cells}
    return [(cell.onset_ms, _end_ms(cell, onsets), one_line(cell.codes.get(code))) for cell in cells]


def _end_ms(cell: Cell, onsets: Collection[int]) -> int:
    """A cell ends after its offset, or at it if another one begins there, or it lies before the onset."""
    is_cut = cell.offset_ms < cell.onset_ms or (cell.offset_ms > cell.onset_ms and cell.offset_ms in onsets)
    return cell.offset_ms if is_cut else cell.offset_ms + 1
