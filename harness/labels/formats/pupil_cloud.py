"""Pupil Cloud's fixations on areas of interest: ``aoi_fixations.csv`` of an enrichment (Neon, Invisible).

The folder of the enrichment has three tables, whose columns are those of Pupil Labs' documents:

- ``aoi_fixations.csv``: ``aoi name`` (newer: ``aoi label``), ``recording id``, ``fixation id``
- ``fixations.csv``: the times of each fixation, ns since 1970, and whether it is in the reference image or surface
- ``sections.csv``, if it is there: the name of each recording and of its wearer

A fixation of the image that is in no area is a look at nothing; what was not found in the image is not known.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path

from harness.files.dialects import Row, plain_name
from harness.labels.formats.exchange import Exchange, Imported, ReadOnly
from harness.labels.formats.eye_trackers import kept_areas
from harness.labels.formats.own_table import even_rows, from_rows
from harness.labels.labels import NOWHERE
from vfoa.errors import VfoaError, check_known

_Key = tuple[str, str]
"""The ids of a recording and of one of its fixations, which are counted in each recording."""

_AREAS = ("aoi_name", "aoi_label")
_DETECTED = ("fixation_detected_in_reference_image", "fixation_detected_on_surface")


class PupilCloud(ReadOnly):
    """Reads the fixations of the wearer of an eye tracker."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read labels. The subject is the recording's wearer, or the clip's only one if there is one recording."""
        areas = _areas(path)
        fixations = path.with_name("fixations.csv")
        if not fixations.is_file():
            raise VfoaError(f"{path}: no fixations.csv beside it; expected the folder that Pupil Cloud exported")
        (line, header), *rows = even_rows(fixations)
        recording, fixation, start, end = (
            _column(header, (name,), f"{fixations}:{line}")
            for name in ("recording_id", "fixation_id", "start_timestamp_ns", "end_timestamp_ns")
        )
        detected = _column(header, _DETECTED, f"{fixations}:{line}")
        wearers = _wearers(path.with_name("sections.csv"), [cells[recording] for _, cells in rows], exchange)
        subjects = _subjects(wearers, exchange)
        table: list[Row] = [(line, ["subject", "target", "start_ns", "end_ns"])]
        for number, cells in rows:
            if cells[recording] in subjects:
                names = kept_areas(areas.get((cells[recording], cells[fixation]), ()), exchange.names)
                if len(names) > 1:
                    found = f"fixation {cells[fixation]} is in {' and '.join(names)}"
                    raise VfoaError(
                        f"{fixations}:{number}: {found}; expected one area: leave one out (--rename THEIRS=), or give "
                        "both one name (--rename THEIRS=OURS)"
                    )
                nowhere = NOWHERE if cells[detected].lower() == "true" else ""
                area = next(iter(names), nowhere)
                table.append((number, [subjects[cells[recording]], area, cells[start], cells[end]]))
        for key in areas.keys() - {(cells[recording], cells[fixation]) for _, cells in rows}:
            raise VfoaError(
                f"{path}: fixation {key[1]} of recording {key[0]} is not in {fixations.name}; expected the tables of "
                "one export"
            )
        return from_rows(table, exchange, fixations)


def _column(header: Sequence[str], names: Sequence[str], where: str, hint: str = "") -> int:
    """The place of the column that has one of these names; an error ends with ``hint``."""
    plain = [plain_name(name) for name in header]
    if (found := next((plain.index(name) for name in names if name in plain), None)) is None:
        expected = f"Pupil Cloud's column {' or '.join(names)}{hint}"
        raise VfoaError(f"{where}: found {', '.join(header)[:120]}; expected {expected}")
    return found


def _areas(path: Path) -> dict[_Key, list[str]]:
    """The areas of each fixation that is in one."""
    (line, header), *rows = even_rows(path)
    area = _column(header, _AREAS, f"{path}:{line}", ", of aoi_fixations.csv")
    key = [_column(header, (name,), f"{path}:{line}") for name in ("recording_id", "fixation_id")]
    found = defaultdict[_Key, list[str]](list)
    for _, cells in rows:
        found[cells[key[0]], cells[key[1]]].append(cells[area])
    return found


def _wearers(path: Path, recordings: Sequence[str], exchange: Exchange) -> dict[str, str]:
    """The wearer of each recording that is read, or its id if that is not known."""
    wearers = {recording: recording for recording in recordings}
    ids = dict(wearers)
    if path.is_file():
        (line, header), *rows = even_rows(path)
        recording, name = (_column(header, (each,), f"{path}:{line}") for each in ("recording_id", "recording_name"))
        wearer = next((place for place, each in enumerate(header) if plain_name(each) == "wearer_name"), None)
        for at, cells in rows:
            if cells[recording] in wearers:
                other = ids.setdefault(cells[name], cells[recording])
                if other != cells[recording] and cells[name] == exchange.observation:
                    both = f"both {other} and {cells[recording]}"
                    raise VfoaError(f"{path}:{at}: {cells[name]!r} is the name of {both}; expected --observation ID")
                if wearer is not None and cells[wearer]:
                    wearers[cells[recording]] = cells[wearer]
    if exchange.observation is None:
        return wearers
    check_known(exchange.observation, ids, f"{path.parent}: --observation: no recording")
    return {ids[exchange.observation]: wearers[ids[exchange.observation]]}


def _subjects(wearers: Mapping[str, str], exchange: Exchange) -> Mapping[str, str]:
    """The subject of each recording: the wearer, or the clip's only subject if there is one recording."""
    for wearer in wearers.values():
        exchange.names.translate(wearer)  # its rename is not one of an unknown name
    if len(wearers) == len(exchange.subjects) == 1:
        return dict.fromkeys(wearers, next(iter(exchange.subjects)))
    return wearers
