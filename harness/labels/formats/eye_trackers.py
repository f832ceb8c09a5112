"""What eye trackers' programs export of areas of interest, as rows of a table of one's own.

Tobii Pro Lab: the data export, with a column ``AOI hit [Snapshot - cup]`` of 0 and 1 for each area. BeGaze of SMI: the
events. Data Viewer of EyeLink: the Fixation Report. Exports without times, and recordings without areas, are refused
with the export that is read.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from harness.files.dialects import Row, is_missing, plain_name
from harness.files.io import opened
from harness.labels.formats.exchange import NameLog
from harness.labels.labels import NOWHERE
from vfoa.errors import VfoaError

_SMI = {
    "stimulus": "recording_name",
    "event_start_trial_time_ms": "start_ms",
    "event_end_trial_time_ms": "end_ms",
}
_EYELINK = {
    "recording_session_label": "subject",
    "trial_index": "recording_name",
    "current_fix_start": "start_ms",
    "current_fix_end": "end_ms",
    "current_fix_interest_area_label": "target",
}
_NO_SMI_AREA, _NO_EYELINK_AREA = "-", "."
"""The area of BeGaze's saccades and blinks; that of Data Viewer's fixations in no area."""

_REFUSED = {
    "ia_dwell_time": "an Interest Area Report of Data Viewer has no times of looks; expected its Fixation Report with "
    "RECORDING_SESSION_LABEL, TRIAL_INDEX, CURRENT_FIX_START, CURRENT_FIX_END and CURRENT_FIX_INTEREST_AREA_LABEL",
    "total_duration_of_fixations": "metrics of Tobii Pro Lab have no times of looks; expected its data export with "
    "Recording timestamp, Eye movement type and AOI hit",
}
"""What to export instead, by a column that says what a table is."""
_EYELINK_RECORDING = b"** CONVERTED FROM"
"""What a recording of EyeLink as text (``.asc``) begins with."""


def check_no_recording(path: Path) -> None:
    """Raise a :class:`VfoaError` with the export to make for a recording of gaze, which is no table."""
    with opened(path) as file:
        if file.read(len(_EYELINK_RECORDING)) == _EYELINK_RECORDING:
            raise VfoaError(
                f"{path}:1: a recording of EyeLink has no areas of interest; expected Data Viewer's Fixation Report"
            )


def of_eye_tracker(rows: Sequence[Row], path: Path) -> Sequence[Row]:
    """Rows with the columns of a table of one's own, of an eye tracker's export; others as they are.

    Raises
    ------
    VfoaError
        If it is an export without looks (with the one to make instead), or no fixation is in an area.
    """
    line, header = rows[0]
    plain = [plain_name(name) for name in header]
    for name, advice in _REFUSED.items():
        if name in plain:
            raise VfoaError(f"{path}:{line}: {header[plain.index(name)]}: {advice}")
    if "event_start_trial_time_ms" in plain:
        return [(at, ["" if cell == _NO_SMI_AREA else cell for cell in cells]) for at, cells in _called(rows, _SMI)]
    if "current_fix_start" in plain:
        return _of_eyelink(_called(rows, _EYELINK), path)
    return rows


def _called(rows: Sequence[Row], names: Mapping[str, str]) -> list[Row]:
    """Rows whose columns have our names, by theirs."""
    (line, header), *lines = rows
    return [(line, [names.get(plain_name(name), name) for name in header]), *lines]


def _of_eyelink(rows: Sequence[Row], path: Path) -> Sequence[Row]:
    """Rows in which a fixation in no area is a look at nothing: all rows are fixations."""
    (line, header), *lines = rows
    if "target" not in header:
        raise VfoaError(f"{path}:{line}: no column CURRENT_FIX_INTEREST_AREA_LABEL; expected it: add it to the report")
    place = header.index("target")
    if all(cells[place] == _NO_EYELINK_AREA for _, cells in lines):
        raise VfoaError(f"{path}: no fixation is in an area; expected a report with the interest areas of the targets")
    return [
        rows[0],
        *(
            (at, [*cells[:place], NOWHERE if cells[place] == _NO_EYELINK_AREA else cells[place], *cells[place + 1 :]])
            for at, cells in lines
        ),
    ]


_AOI_HIT = re.compile(r"AOI hit \[(?:(?P<stimulus>.*) - )?(?P<area>.+)\]")
"""A column of Tobii Pro Lab's data export: of a stimulus, such as a snapshot or a film, and an area of interest."""
_SEEN, _NOT_SEEN = frozenset({"1", "1.0", "true"}), frozenset({"0", "0.0", "false"})
_MOVEMENT, _FIXATION = "eye_movement_type", "fixation"
"""Its column of what the eyes did: in no area, they look at nothing only in a fixation, not in a blink or a saccade."""
_MAPPED = "Mapped eye movement type [{}]"
"""Its column of what the eyes did on a snapshot, to which not all that the glasses saw can be mapped."""


def area_of(column: str) -> str | None:
    """The area of a column of Tobii Pro Lab; None for any other column."""
    return match["area"] if (match := _AOI_HIT.fullmatch(column)) else None


def with_target(rows: Sequence[Row], called: Mapping[int, str], names: NameLog, path: Path) -> Sequence[Row]:
    """Rows with a target each, of those with columns of 0 and 1, ``called`` as targets by their places.

    Rows without such columns stay as they are. Of an area within another one that is left out, the inner one counts.

    Raises
    ------
    VfoaError
        If some of the columns have other cells, or a row has a 1 in several.
    """
    (line, header), *lines = rows
    others = {place: found for place in called if (found := _other_cell(lines, place)) is not None}
    targets = {place: name for place, name in called.items() if place not in others}
    if not targets:
        return rows
    for place, (number, cell) in others.items():
        if names.translate(called[place]):
            raise VfoaError(f"{path}:{number}: {header[place]}: found {cell[:40]!r}; expected 0, 1 or nothing")
    movements = _movements(header, targets)
    kept = [place for place in range(len(header)) if place not in (*targets, *movements.values())]
    table: list[Row] = [(line, [*(header[place] for place in kept), "target"])]
    for number, cells in lines:
        seen = _seen(cells, targets, names, f"{path}:{number}")
        if seen == NOWHERE and not _in_fixation(cells, movements):
            seen = ""
        table.append((number, [*(cells[place] for place in kept), seen]))
    return table


def _movements(header: Sequence[str], targets: Iterable[int]) -> Mapping[int, int | None]:
    """The column of what the eyes did, by that of a target: of its snapshot, or else of all; None without one."""
    of_all = next((place for place, name in enumerate(header) if plain_name(name) == _MOVEMENT), None)
    named = {name.lower(): place for place, name in enumerate(header)}
    stimuli = {place: match["stimulus"] for place in targets if (match := _AOI_HIT.fullmatch(header[place]))}
    return {place: named.get(_MAPPED.format(stimuli.get(place)).lower(), of_all) for place in targets}


def _in_fixation(cells: Sequence[str], movements: Mapping[int, int | None]) -> bool:
    """Whether the eyes rest where one of the targets could be; so they do without a column of what they did."""
    given = [movement for place, movement in movements.items() if not is_missing(cells[place])]
    return any(movement is None or cells[movement].lower() == _FIXATION for movement in given)


def _other_cell(lines: Sequence[Row], place: int) -> tuple[int, str] | None:
    """Line and cell of the first row that does not say whether a target is looked at; None without one."""
    cells = ((number, cells[place]) for number, cells in lines if not is_missing(cells[place]))
    return next(((number, cell) for number, cell in cells if cell.lower() not in _SEEN | _NOT_SEEN), None)


def kept_areas(areas: Iterable[str], names: NameLog) -> list[str]:
    """Areas that are looked at together, one for each of our names; without those left out, if there are others."""
    by_ours = {names.translate(area): area for area in areas}
    return [area for ours, area in by_ours.items() if ours] or [*by_ours.values()]


def _seen(cells: Sequence[str], targets: Mapping[int, str], names: NameLog, where: str) -> str:
    """The only target with a 1; none where all have 0, and nothing where all are blank."""
    seen = kept_areas((name for place, name in targets.items() if cells[place].lower() in _SEEN), names)
    if len(seen) > 1:
        raise VfoaError(f"{where}: found 1 for {' and '.join(seen)}; expected one (--rename THEIRS= leaves one out)")
    return next(iter(seen), "" if all(is_missing(cells[place]) for place in targets) else NOWHERE)
