"""BORIS's project file (``.boris``, JSON, also gzipped): its observations, whose state events start and stop in turn.

Tables that BORIS exports are read as a part of their project (:mod:`harness.labels.formats.boris_exports`).

An event is ``[time, subject, behaviour, modifiers, comment]``, since BORIS 8 with a frame number, and in an observation
of pictures with the number of the picture, from 1, and its path. The start and the stop of a state have the same
subject, behaviour and modifiers. Times hold the time offset of the observation and, if it says so, the creation time of
the film. The target is the behaviour, or the modifier of one set. The fields are those of BORIS's own projects and
program (github.com/olivierfriard/BORIS, ``tests/files``, ``boris/write_event.py``; read, not used).
"""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shlex import quote
from typing import Any

from harness.files.io import read_bytes
from harness.files.parsing import parse_json
from harness.labels.formats.boris_exports import read_export
from harness.labels.formats.exchange import MS, Exchange, Imported, ReadOnly, one_line
from harness.labels.formats.spans import Span, from_spans
from harness.labels.labels import Label, Timeline
from vfoa.errors import VfoaError, check_known, counted

NO_MODIFIER = "none"
"""Given as the set of modifiers: behaviours are the targets, and modifiers are left out."""

_GZIP = b"\x1f\x8b"
_LARGEST_BYTES = 2**28
_NO_FOCAL_SUBJECT = "No focal subject"
"""BORIS's name for the subject of events without one."""
_NOT_CHOSEN = ("", "None")
_KEY = re.compile(r" \(.*\)$")
"""The key of a modifier, which older versions write behind it."""
_SHOWN = 4


@dataclass(frozen=True, slots=True, kw_only=True)
class _Behaviour:
    """A behaviour of the ethogram: whether its events have no length, and the names of its sets of modifiers."""

    is_point: bool = False
    sets: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _BorisEvent:
    """An event at a time, ms, or at the number of a picture; one modifier for each set, "" where none was chosen."""

    at: int
    subject: str
    behaviour: str
    modifiers: tuple[str, ...]
    comment: str


class Boris(ReadOnly):
    """State events. Point events have no length and are left out, with a note."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read the state events of one observation of a project."""
        return from_project(_load(path), exchange, path)


def from_project(project: Mapping[str, Any], exchange: Exchange, path: Path) -> Imported:
    """Return the labels of the state events of one observation.

    Raises
    ------
    VfoaError
        If the observation, film or modifiers are to be chosen, or something in it is no event or no label.
    """
    observation, where = _choose_observation(project, exchange.observation, path)
    behaviours = _behaviours(project)
    events = _events(observation, where)
    states = [event for event in events if not behaviours.get(event.behaviour, _Behaviour()).is_point]
    notes = (
        [f"{path}: left out: {counted(n, 'point event')} without a length."] if (n := len(events) - len(states)) else []
    )
    _check_modifiers(states, behaviours, exchange.modifier, where)
    if _is_of_pictures(observation):
        shown, offset_ms = _numbered(exchange.frames), 0
    else:
        shown = exchange.shown
        offset_ms, added = exchange.media_offset(_film_offset_ms(observation, exchange, where), path)
        notes += added
    end = shown.span_ns(shown.frames[0], shown.frames[-1])[1] // MS
    spans = []
    for event, stop in _pairs(states):
        here = f"{where}: {'picture ' if _is_of_pictures(observation) else ''}{_shown(event.at, observation)}"
        start, named = event.at + offset_ms, _target(event, behaviours, exchange.modifier)
        if exchange.names.leaves_out(event.subject, named):
            continue
        if stop is None:
            notes.append(f"{here}: {event.behaviour!r} of {event.subject!r} never stops: it lasts to the clip's end.")
        subject = exchange.subject(event.subject, here)
        target = exchange.target(named, subject, here)
        spans.append(
            Span(
                start_ms=start,
                end_ms=max(start, end) if stop is None else stop + offset_ms,
                subject=subject,
                label=Label(target=target, note=event.comment),
                where=here,
            )
        )
    imported = from_spans(spans, exchange, path, shown=shown)
    return Imported(labels=imported.labels, notes=(*imported.notes, *notes))


def _load(path: Path) -> dict[str, Any]:
    data = read_bytes(path)
    try:
        if data.startswith(_GZIP):
            unpack = zlib.decompressobj(zlib.MAX_WBITS | 16)
            data = unpack.decompress(data, _LARGEST_BYTES)
    except zlib.error as error:
        raise VfoaError(f"{path}: not a BORIS project: {error}") from None
    if (exported := read_export(path, data)) is not None:
        return exported
    project = parse_json(data, path)
    if not isinstance(project, dict):
        raise VfoaError(f"{path}: found {type(project).__name__}; expected a BORIS project")
    return project


def _choose_observation(project: Mapping[str, Any], wanted: str | None, path: Path) -> tuple[Mapping[str, Any], str]:
    """Return the wanted observation, or the only one, and its place for messages."""
    observations = project.get("observations")
    if not isinstance(observations, dict) or not observations:
        raise VfoaError(
            f"{path}: no observations with events; expected a BORIS project, or an export of events of the whole "
            "observation"
        )
    if wanted is not None:
        check_known(wanted, observations, f"{path}: --observation: no")
    elif len(observations) > 1:
        listed = ", ".join(map(repr, observations))
        raise VfoaError(f"{path}: found the observations {listed}; expected --observation NAME")
    name = next(iter(observations)) if wanted is None else wanted
    where = f"{path}: observation {name!r}"
    if not isinstance(observations[name], dict):
        raise VfoaError(f"{where}: found {type(observations[name]).__name__}; expected an observation")
    return observations[name], where


def _behaviours(project: Mapping[str, Any]) -> dict[str, _Behaviour]:
    """The behaviours of the ethogram by name."""
    listed = project.get("behaviors_conf")
    behaviours = {}
    for behaviour in listed.values() if isinstance(listed, dict) else ():
        if isinstance(behaviour, dict):
            sets = behaviour.get("modifiers")
            names = (
                [one.get("name") for one in sets.values() if isinstance(one, dict)] if isinstance(sets, dict) else []
            )
            is_point = str(behaviour.get("type", "")).lower().startswith("point")
            behaviours[str(behaviour.get("code"))] = _Behaviour(is_point=is_point, sets=tuple(map(str, names)))
    return behaviours


def _is_of_pictures(observation: Mapping[str, Any]) -> bool:
    return observation.get("type") == "IMAGES"


def _events(observation: Mapping[str, Any], where: str) -> list[_BorisEvent]:
    """Every event of an observation, in order."""
    events = observation.get("events")
    if not isinstance(events, list):
        raise VfoaError(f"{where}: no events; expected a list of them")
    place_of, scale = (5, 1) if _is_of_pictures(observation) else (0, 1000)
    parsed = []
    for number, event in enumerate(events, start=1):
        if not isinstance(event, list) or len(event) < max(3, place_of + 1) or not _is_number(event[place_of]):
            fields = (
                "time, subject, behaviour, ..." if scale == 1000 else "time, subject, ..., number of the picture, path"
            )
            raise VfoaError(f"{where}: event {number}: found {str(event)[:80]!r}; expected [{fields}]")
        parsed.append(
            _BorisEvent(
                at=round(float(event[place_of]) * scale),
                subject=str(event[1]) or _NO_FOCAL_SUBJECT,
                behaviour=str(event[2]),
                modifiers=_modifiers(event[3] if len(event) > 3 else ""),
                comment=one_line(str(event[4])) if len(event) > 4 else "",
            )
        )
    return sorted(parsed, key=lambda event: event.at)


def _modifiers(joined: object) -> tuple[str, ...]:
    """The modifier of each set, as BORIS joins them or one by one; none if no set has one."""
    parts = (
        joined if isinstance(joined, tuple) else [_KEY.sub("", each.strip()) for each in str(joined or "").split("|")]
    )
    cleaned = tuple("" if part in _NOT_CHOSEN else part for part in parts)
    return cleaned if any(cleaned) else ()


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value) and abs(value) < 1e10


def _shown(at: int, observation: Mapping[str, Any]) -> str:
    return str(at) if _is_of_pictures(observation) else f"{at / 1000:.3f} s"


def _check_modifiers(
    states: Iterable[_BorisEvent], behaviours: Mapping[str, _Behaviour], modifier: str | None, where: str
) -> None:
    """Refuse modifiers unless the user says whether they are the targets, and a set that no state has."""
    modified = [event for event in states if event.modifiers]
    if not modified or modifier == NO_MODIFIER:
        return
    first = modified[0]
    if modifier is None:
        name = next(n for n, value in zip(_set_names(first, behaviours), first.modifiers, strict=True) if value)
        values = dict.fromkeys(value for event in modified for value in event.modifiers if value)
        listed = ", ".join([*values][:_SHOWN]) + (", ..." if len(values) > _SHOWN else "")
        raise VfoaError(
            f"{where}: states of {first.behaviour!r} have modifiers ({listed}); expected --modifier {quote(name)} if "
            f"they are the targets, or --modifier {NO_MODIFIER} to leave them out"
        )
    known = dict.fromkeys(name for event in modified for name in _set_names(event, behaviours))
    check_known(modifier, known, f"{where}: --modifier: no")


def _set_names(event: _BorisEvent, behaviours: Mapping[str, _Behaviour]) -> list[str]:
    """The names of an event's sets of modifiers; a set without a name has its number, from 1."""
    names = behaviours.get(event.behaviour, _Behaviour()).sets
    return [(names[n] if n < len(names) else "") or str(n + 1) for n in range(len(event.modifiers))]


def _target(event: _BorisEvent, behaviours: Mapping[str, _Behaviour], modifier: str | None) -> str:
    """The modifier of the chosen set; the behaviour where there is none."""
    names = _set_names(event, behaviours)
    return (modifier in names and event.modifiers[names.index(modifier)]) or event.behaviour


def _pairs(states: Sequence[_BorisEvent]) -> Iterator[tuple[_BorisEvent, int | None]]:
    """Yield every start with the time of its stop; None for a state that never stops."""
    begun: dict[tuple[str, str, tuple[str, ...]], _BorisEvent] = {}
    for event in states:
        key = event.subject, event.behaviour, event.modifiers
        if key in begun:
            yield begun.pop(key), event.at
        else:
            begun[key] = event
    for event in begun.values():
        yield event, None


def _numbered(frames: Sequence[int]) -> Timeline:
    """A clip as pictures, numbered from 1: one each millisecond."""
    return Timeline(frames=frames, times_ns=[MS * number for number in range(1, len(frames) + 1)])


def _film_offset_ms(observation: Mapping[str, Any], exchange: Exchange, where: str) -> int:
    """What is added to the time of an event to get the time in the film that shows the clip, whole ms, rounded down.

    Events are rounded to the millisecond, and lengths are not: rounded down, no label begins after its frame.

    BORIS adds an observation's time offset to each event and, if the observation says so, the creation time of the film
    in the first player. A player begins at its offset, and plays the films of its list one after the other. With
    ``--offset``, which replaces all this, nothing is added.
    """
    media = observation.get("media_info")
    media = media if isinstance(media, dict) else {}
    lists = observation.get("file")
    lists = lists if isinstance(lists, dict) else {}
    players = {str(player): films for player, films in lists.items() if films and isinstance(films, list)}
    places: dict[str, tuple[str, int]] = {}
    for player, films in players.items():
        for place, film in enumerate(films):
            places.setdefault(str(film), (player, place))

    def begin_s(film: str) -> float:
        player, place = places.get(film, ("1", 0))
        before = [str(other) for other in players.get(player, ())[:place]]
        lengths_s = [_number(media.get("length"), other, where, needed=True) for other in before]
        return _number(media.get("offset"), player, where) + sum(lengths_s)

    chosen = exchange.film_of([*places], where, begin=begin_s) or ""
    if exchange.offset is not None:
        return 0
    offset_s = _number(observation, "time offset", where) + begin_s(chosen)
    if observation.get("media_creation_date_as_offset"):
        created, *others = players.get("1", [chosen])
        if others:
            raise VfoaError(
                f"{where}: times count from the creation of each of several films; expected --offset SECONDS"
            )
        offset_s += _number(media.get("media_creation_time"), str(created), where, needed=True)
    return math.floor(round(-offset_s * 1000, 3))


def _number(table: Any, key: str, where: str, *, needed: bool = False) -> float:
    """A number of seconds in a table; 0 where there is none, unless it is needed."""
    value = table.get(key) if isinstance(table, dict) else None
    if value is None and not needed:
        return 0.0
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        number = math.nan
    if not _is_number(number):
        raise VfoaError(f"{where}: {key}: found {str(value)[:40]!r}; expected seconds, or --offset SECONDS")
    return number
