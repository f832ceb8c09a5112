"""Tables that BORIS exports (TSV, CSV), as the project of which they are a part.

Aggregated events have a row for each state (``Start (s)``, ``Stop (s)``). Tabular events have a row for its start and
one for its stop (``Time``), in older versions below lines about the observation. ``Source`` and ``Media duration (s)``
list the films of each player. A player's own offset and the names of the sets of modifiers are not in them. The forms
are those of BORIS's own writer and files (github.com/olivierfriard/BORIS, ``boris/export_observation.py``,
``tests/files``; read, not used).
"""

from __future__ import annotations

import csv
import io
import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.files.dialects import Row, is_missing, table_text
from vfoa.errors import VfoaError

_WORKBOOKS = (b"PK\x03\x04", b"\xd0\xcf\x11\xe0")
_OTHERS = re.compile(rb"<(table|html|tr|td)\b.*Behaviou?r|INSERT INTO .*aggregated_events|^% SDIS ", re.DOTALL | re.I)
_KINDS = {"STATE": "State event", "START": "State event", "STOP": "State event", "POINT": "Point event"}
_FILMS = ("Media file name", "Media file path", "Media file")
_OF_PICTURES = ("From directories of images", "From pictures")
"""An observation of pictures in tabular and in aggregated events: times in it, where it has some, are not a film's."""
_EXPECTED = "expected TSV or CSV in BORIS's export, or its project (.boris)"


def read_export(path: Path, data: bytes) -> dict[str, Any] | None:
    """Return the project of an exported table; None if the file is none.

    Raises
    ------
    VfoaError
        If it is a workbook, HTML, SQL or SDIS, or a cell of it is not what its column says.
    """
    if data.startswith(_WORKBOOKS) or _OTHERS.search(data[:4096]):
        raise VfoaError(f"{path}: a workbook, HTML, SQL or SDIS, such as BORIS exports; {_EXPECTED}")
    head = data[:4096].replace(b"\0", b"").lstrip(b"\xef\xbb\xbf\xff\xfe \r\n\t")
    if head.startswith((b"{", b"[")) or b"Behavior" not in data[:65536].replace(b"\0", b""):
        return None
    rows = _rows(path)
    at = next((n for n, (_, cells) in enumerate(rows) if {"Subject", "Behavior"} <= {*cells}), None)
    if at is None:
        return None
    names = rows[at][1]
    if not {"Start (s)", "Time"} & {*names}:
        raise VfoaError(f"{path}:{rows[at][0]}: found no column 'Start (s)' or 'Time', so no events; {_EXPECTED}")
    above = {cells[0]: cells[1] for _, cells in rows[:at] if len(cells) > 1}
    below = [(line, above | dict(zip(names, cells, strict=False))) for line, cells in rows[at + 1 :]]
    sets = [name for name in names if name == "Modifiers" or re.fullmatch(r"Modifier #?[0-9]+", name)]
    return _project(path, below, sets)


def _rows(path: Path) -> list[Row]:
    text = table_text(path)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=max("\t,;", key=text.partition("\n")[0].count))
    try:
        return [(reader.line_num, [cell.strip() for cell in cells]) for cells in reader if any(map(str.strip, cells))]
    except csv.Error as error:
        raise VfoaError(f"{path}:{reader.line_num}: not a table: {error}") from None


def _project(path: Path, rows: Sequence[tuple[int, Mapping[str, str]]], sets: Sequence[str]) -> dict[str, Any]:
    behaviours: dict[str, dict[str, str]] = {}
    observations: dict[str, dict[str, Any]] = {}
    films = defaultdict[str, list[tuple[float, str]]](list)
    for line, cells in rows:
        name = cells.get("Observation id", "")
        observation = observations.setdefault(name, {**_source(cells), "events": []})
        kind = (cells.get("Behavior type") or cells.get("Status") or "").upper()
        if kind not in _KINDS:
            raise VfoaError(f"{path}:{line}: the type of a behaviour: found {kind!r}; expected {', '.join(_KINDS)}")
        behaviour = cells["Behavior"]
        behaviours[behaviour] = {"code": behaviour, "type": _KINDS[kind]}
        modifiers = "|".join(cells.get(column, "") for column in sets)
        ends = [("Time", "Image index", "Comment")]
        if "Start (s)" in cells:
            ends = [
                ("Start (s)", "Image index start", "Comment start"),
                ("Stop (s)", "Image index stop", "Comment stop"),
            ]
        for time, image, comment in ends if kind == "STATE" else ends[:1]:
            column = image if observation["type"] == "IMAGES" else time
            at = _number(cells.get(column, ""), f"{path}:{line}: {column}")
            event = [at, cells["Subject"], behaviour, modifiers, cells.get(comment, "")]
            observation["events"].append([*event, at, ""] if observation["type"] == "IMAGES" else event)
            film = next((cells[column] for column in _FILMS if not is_missing(cells.get(column, ""))), None)
            if film not in (None, "LIVE", "Not found"):
                films[name].append((at, film))
    for name, found in films.items():
        if observations[name]["type"] == "MEDIA" and not observations[name]["file"].get("1"):
            played = list(dict.fromkeys(film for _, film in sorted(found)))
            observations[name] |= _queue(played, observations[name]["lengths"])
    return {
        "behaviors_conf": {str(n): each for n, each in enumerate(behaviours.values())},
        "observations": observations,
    }


def _source(cells: Mapping[str, str]) -> dict[str, Any]:
    """What is known of an observation beside its events: its kind, its films with their lengths, its time offset."""
    offset = cells.get("Time offset (s)", "")
    found: dict[str, Any] = {"time offset": 0.0 if is_missing(offset) else offset}
    times = [cells.get(name, "") for name in ("Start (s)", "Time") if name in cells]
    if cells.get("Observation type", "").startswith(_OF_PICTURES) or all(map(is_missing, times)):
        return {**found, "type": "IMAGES"}
    players = [
        [film for film in re.sub(r"^player #[0-9]+: ?", "", films).split(";") if film and not is_missing(film)]
        for films in cells.get("Source", "").split("|")
        if not cells.get("Observation type", "").startswith("Live")
    ]
    listed = cells.get("Media duration (s)", "")
    lengths = [of_player.split(";") for of_player in listed.split("|")] if not is_missing(listed) else [[]]
    pairs = zip(players, lengths, strict=False)
    return {
        **found,
        "type": "MEDIA",
        "lengths": lengths[0],
        "file": {str(n): films for n, films in enumerate(players, start=1)},
        "media_info": {"length": {film: s for films, own in pairs for film, s in zip(films, own, strict=False)}},
    }


def _queue(films: Sequence[str], lengths: Sequence[str]) -> dict[str, Any]:
    """The films of a player in the order in which events name them, and their lengths, as they are in a project.

    Films that no event names may have come first: they have no length, so that the clip's film is asked for.
    """
    known = dict(zip(films, lengths, strict=True)) if len(lengths) == len(films) else {}
    unnamed = [f"film {n} of those that no event names" for n in range(1, len(lengths) - len(films) + 1)]
    return {"file": {"1": [*unnamed, *films]}, "media_info": {"length": known}}


def _number(cell: str, where: str) -> float:
    try:
        return float(cell)
    except ValueError:
        raise VfoaError(f"{where}: found {cell[:40]!r}; expected a number; {_EXPECTED}") from None
