"""BORIS's project file (``.boris``, JSON, also gzipped): its observations, whose state events start and stop in turn.

An event is ``[time, subject, behaviour, modifiers, comment]``, followed by a frame number since BORIS 8. The behaviour
is the target. The fields are those of BORIS's own projects (github.com/olivierfriard/BORIS, ``tests/files``; read, not
used).
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any

from harness.files.io import read_bytes
from harness.files.parsing import parse_json
from harness.labels.formats.exchange import Exchange, Imported, ReadOnly, Span, from_spans, one_line
from harness.labels.labels import Label
from vfoa.errors import VfoaError, check_known

_GZIP = b"\x1f\x8b"
_LARGEST_BYTES = 2**28
_NO_FOCAL_SUBJECT = "No focal subject"
"""BORIS's name for the subject of events without one."""


class Boris(ReadOnly):
    """State events. Point events have no length and are left out, with a note."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read the state events of one observation of a project."""
        project = _load(path)
        observations = project.get("observations")
        if not isinstance(observations, dict) or not observations:
            raise VfoaError(f"{path}: no observations; expected a BORIS project")
        name = _choose_observation(observations, exchange.observation, path)
        observation = observations[name]
        events = _events(observation, f"{path}: observation {name!r}")
        behaviours = project.get("behaviors_conf")
        kinds = {
            str(behaviour.get("code")): str(behaviour.get("type", ""))
            for behaviour in (behaviours.values() if isinstance(behaviours, dict) else ())
            if isinstance(behaviour, dict)
        }
        states = [event for event in events if not kinds.get(event[2], "").lower().startswith("point")]
        offset_ms, notes = exchange.media_offset(_media_offset_ms(observation), path)
        if n_points := len(events) - len(states):
            notes = [f"{path}: {n_points} point events have no length and are left out.", *notes]
        imported = from_spans(_pairs(states, offset_ms, exchange, f"{path}: observation {name!r}"), exchange, path)
        return Imported(labels=imported.labels, notes=(*imported.notes, *notes))


def _choose_observation(names: Collection[str], wanted: str | None, path: Path) -> str:
    """Return the wanted observation, or the only one."""
    if wanted is not None:
        check_known(wanted, names, f"{path}: --observation: no")
        return wanted
    if len(names) > 1:
        listed = ", ".join(map(repr, names))
        raise VfoaError(f"{path}: found the observations {listed}; expected --observation NAME")
    return next(iter(names))


def _load(path: Path) -> dict[str, Any]:
    data = read_bytes(path)
    try:
        if data.startswith(_GZIP):
            unpack = zlib.decompressobj(zlib.MAX_WBITS | 16)
            data = unpack.decompress(data, _LARGEST_BYTES)
    except zlib.error as error:
        raise VfoaError(f"{path}: not a BORIS project: {error}") from None
    project = parse_json(data, path)
    if not isinstance(project, dict):
        raise VfoaError(f"{path}: found {type(project).__name__}; expected a BORIS project")
    return project


def _events(observation: Any, where: str) -> list[tuple[int, str, str, str]]:
    """Time (ms), subject, behaviour and comment of every event, in order of time."""
    events = observation.get("events") if isinstance(observation, Mapping) else None
    if not isinstance(events, list):
        raise VfoaError(f"{where}: no events; expected a list of them")
    parsed = []
    for place, event in enumerate(events, start=1):
        if not isinstance(event, list) or len(event) < 3 or not _is_time(event[0]):
            raise VfoaError(
                f"{where}: event {place}: found {str(event)[:80]!r}; expected [time, subject, behaviour, ...]"
            )
        comment = one_line(str(event[4])) if len(event) > 4 else ""
        parsed.append((round(float(event[0]) * 1000), str(event[1]) or _NO_FOCAL_SUBJECT, str(event[2]), comment))
    return sorted(parsed, key=lambda event: event[0])


def _is_time(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value) and abs(value) < 1e9


def _media_offset_ms(observation: Mapping[str, Any]) -> int:
    """The time of the first player's medium in that of the observation, ms: BORIS subtracts the offset."""
    media = observation.get("media_info")
    offsets = media.get("offset") if isinstance(media, dict) else None
    offset = offsets.get("1", 0.0) if isinstance(offsets, dict) else 0.0
    return -round(offset * 1000) if _is_time(offset) else 0


def _pairs(events: list[tuple[int, str, str, str]], offset_ms: int, exchange: Exchange, where: str) -> Iterator[Span]:
    """Yield the spans between every first and second event of a subject and behaviour."""
    begun: dict[tuple[str, str], tuple[int, str]] = {}
    for time, subject, behaviour, comment in events:
        if (subject, behaviour) not in begun:
            begun[subject, behaviour] = time, comment
            continue
        start, note = begun.pop((subject, behaviour))
        here = f"{where}: {start / 1000:.3f} s"
        ours = exchange.subject(subject, here)
        label = Label(target=exchange.target(behaviour, ours, here), note=note)
        yield Span(start_ms=start + offset_ms, end_ms=time + offset_ms, subject=ours, label=label, where=here)
    for (subject, behaviour), (start, _) in begun.items():
        raise VfoaError(f"{where}: {behaviour!r} of {subject!r} starts at {start / 1000:.3f} s and never stops")
