"""ELAN (.eaf): a tier per subject, an annotation per range, its value the target.

Notes, image points and suggestions are in tiers of their own beside a subject's (``girl:note``, ``girl:point_px``,
``girl:state``), in annotations of the same times. Through pympi (Lubbers and Torreira, pympi-ling).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from harness.files.io import atomic_write, read_bytes
from harness.files.parsing import parse_xml
from harness.labels.formats.exchange import Exchange, Imported, Span, from_spans, one_line, to_spans
from harness.labels.labels import Label, Labels
from harness.labels.rows import SUGGESTED, parse_point
from vfoa.errors import VfoaError

_NOTE, _POINT, _STATE = ":note", ":point_px", ":state"
_DATE = "1970-01-01T00:00:00+00:00"
"""The format needs a date; a constant one gives the same bytes for the same labels."""


_FARTHEST_MS = 2**53
"""Beyond it, seconds as a floating point number are not exact."""


class Elan:
    """Reads tiers named after subjects; others are left out, with a note. Writes format 2.8."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read a file's annotations; referring annotations have the times of the ones they refer to."""
        document = _parse(path)
        names = {tier: exchange.names.translate(tier) for tier in document.tiers}
        tiers = {tier: name for tier, name in names.items() if name in exchange.subjects}
        beside = {f"{tier}{suffix}" for tier in tiers for suffix in (_NOTE, _POINT, _STATE)}
        filled = [tier for tier, (aligned, referring, *_) in document.tiers.items() if aligned or referring]
        others = [tier for tier in filled if tier not in tiers and tier not in beside]
        if not tiers:
            present = ", ".join(map(repr, document.tiers)) or "none"
            raise VfoaError(
                f"{path}: no tier is named after a subject; found {present}; "
                f"expected {', '.join(map(repr, exchange.subjects))} (--rename TIER=OURS)"
            )
        origin_ms, notes = exchange.media_offset(_film_offset_ms(document, exchange, path), path)
        spans = [span for tier, name in tiers.items() for span in _spans(document, tier, name, exchange, path)]
        moved = [replace(span, start_ms=span.start_ms + origin_ms, end_ms=span.end_ms + origin_ms) for span in spans]
        imported = from_spans(moved, exchange, path)
        notes += [f"{path}: tier {tier!r} belongs to no subject and is left out." for tier in others]
        return Imported(labels=imported.labels, notes=(*imported.notes, *notes))

    def write(self, path: Path, labels: Labels, exchange: Exchange) -> tuple[str, ...]:
        """Write a document without media; nothing is lost."""
        from pympi.Elan import Eaf, to_string

        document = Eaf(author="vfoa")
        document.adocument["DATE"] = _DATE
        for subject in labels.subjects:
            document.add_tier(subject)
        document.remove_tier("default")
        for start, end, row in to_spans(labels, exchange):
            label = row.label
            point = "" if label.point_px is None else ",".join(repr(coordinate) for coordinate in label.point_px)
            beside = {_NOTE: label.note, _POINT: point, _STATE: SUGGESTED if label.is_suggested else ""}
            document.add_annotation(row.subject, start, end, label.target)
            for tier, value in ((f"{row.subject}{suffix}", value) for suffix, value in beside.items() if value):
                if tier not in document.tiers:
                    document.add_tier(tier)
                document.add_annotation(tier, start, end, value)
        atomic_write(path, b"<?xml version='1.0' encoding='UTF-8'?>\n" + to_string(document, encoding="UTF-8"))
        return ()


def _parse(path: Path) -> Any:
    from pympi.Elan import Eaf

    root = parse_xml(read_bytes(path), path)
    if root.tag != "ANNOTATION_DOCUMENT":
        raise VfoaError(f"{path}: found <{root.tag}>; expected ELAN's <ANNOTATION_DOCUMENT>")
    try:
        return Eaf(str(path), suppress_version_warning=True)
    except (KeyError, ValueError, IndexError) as error:
        raise VfoaError(f"{path}: not an ELAN document that can be read: {type(error).__name__}: {error}") from None


def _spans(document: Any, tier: str, subject: str, exchange: Exchange, path: Path) -> Iterator[Span]:
    notes, points, states = (_beside(document, tier + suffix, path) for suffix in (_NOTE, _POINT, _STATE))
    for start, end, value in _aligned(document, tier, path):
        where = f"{path}: tier {tier!r}, {start / 1000:.3f} to {end / 1000:.3f} s"
        label = Label(
            target=exchange.target(value.strip(), subject, where),
            note=one_line(notes.get((start, end))),
            point_px=parse_point(points.get((start, end), "").split(","), where),
            is_suggested=states.get((start, end)) == SUGGESTED,
        )
        yield Span(start_ms=start, end_ms=end, subject=subject, label=label, where=where)


def _film_offset_ms(document: Any, exchange: Exchange, path: Path) -> int:
    """The offset of the film that shows the clip to the document's time, ms, which ELAN stores as ``TIME_ORIGIN``."""
    origins: dict[str, str] = {}
    for medium in document.media_descriptors:
        if not medium.get("MIME_TYPE", "").startswith("audio"):
            address = medium.get("MEDIA_URL") or medium.get("RELATIVE_MEDIA_URL") or ""
            origins.setdefault(address, medium.get("TIME_ORIGIN") or "0")
    film = exchange.film_of([*origins], path)
    origin = "0" if film is None else origins[film]
    try:
        return int(origin)
    except ValueError:
        raise VfoaError(f"{path}: TIME_ORIGIN: found {origin!r}; expected milliseconds") from None


def _aligned(document: Any, tier: str, path: Path) -> list[tuple[int, int, str]]:
    annotations = _annotations(document, tier, path)
    if any(start is None or end is None for start, end, _ in annotations):
        raise VfoaError(f"{path}: tier {tier!r} has an annotation without times; expected time-aligned annotations")
    if far := next((times for *times, _ in annotations if max(map(abs, times)) > _FARTHEST_MS), None):
        raise VfoaError(
            f"{path}: tier {tier!r} has an annotation at {far[0]} to {far[1]} ms; expected a time in a film"
        )
    return annotations


def _beside(document: Any, tier: str, path: Path) -> dict[tuple[int, int], str]:
    if tier not in document.tiers:
        return {}
    return {(start, end): value for start, end, value in _annotations(document, tier, path)}


def _annotations(document: Any, tier: str, path: Path) -> list[tuple[int, int, str]]:
    """Start, end (ms) and value of a tier's annotations."""
    try:
        aligned, referring = document.tiers[tier][:2]
        times = document.timeslots
        annotations = [(times[first], times[last], value) for first, last, value, _ in aligned.values()]
        return annotations + [_referring(document, tier, name) for name in referring]
    except (KeyError, RecursionError) as error:
        raise VfoaError(
            f"{path}: tier {tier!r} refers to the time slot or annotation {error}, which the file does not have"
        ) from None


def _referring(document: Any, tier: str, name: str) -> tuple[Any, Any, str]:
    """An annotation that refers to another one has its times, or an equal share if several refer to it."""
    parent, value, *_ = document.tiers[tier][1][name]
    start, end = _times_of(document, parent)
    if start is None or end is None:
        return start, end, value
    siblings = [sibling for sibling, (other, *_) in document.tiers[tier][1].items() if other == parent]
    place, count = siblings.index(name), len(siblings)
    return start + (end - start) * place // count, start + (end - start) * (place + 1) // count, value


def _times_of(document: Any, name: str) -> tuple[Any, Any]:
    tier = document.annotations[name]
    aligned, referring = document.tiers[tier][:2]
    if name in referring:
        start, end, _ = _referring(document, tier, name)
        return start, end
    first, last, *_ = aligned[name]
    return document.timeslots[first], document.timeslots[last]
