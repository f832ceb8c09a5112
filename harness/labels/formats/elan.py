"""ELAN (.eaf; also its exported text, read only): labels in tiers.

Written through pympi (Lubbers and Torreira, pympi-ling), which reads fewer documents than ELAN writes: those with a
schema's address, and annotations with a value and a number in their id.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from xml.etree.ElementTree import Element

from harness.files.io import atomic_write, read_bytes
from harness.files.parsing import parse_xml
from harness.labels.formats.elan_text import TextAnnotation, is_elan_text, read_elan_text
from harness.labels.formats.exchange import Exchange, Imported
from harness.labels.formats.spans import to_spans
from harness.labels.formats.tiers import NOTE, POINT, STATE, TAG, from_tiers
from harness.labels.labels import Labels
from harness.labels.rows import SUGGESTED
from vfoa.errors import VfoaError

_DATE = "1970-01-01T00:00:00+00:00"
"""The format needs a date; a constant one gives the same bytes for the same labels."""
_MILLISECONDS = "milliseconds"
"""The unit of ELAN's own documents; the format also has frames of PAL and of NTSC."""


class Elan:
    """Reads tiers named after subjects; others are left out, with a note. Writes format 2.8."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read a file's annotations; referring annotations have the times of the ones they refer to."""
        document = _parse(path, exchange)
        origin_ms, notes = exchange.media_offset(_film_offset_ms(document, exchange), path)
        sizes = {tier: len(held) for tier, held in document.tiers.items()}
        imported = from_tiers(sizes, document.annotations, exchange, path, origin_ms=origin_ms)
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
            state = SUGGESTED if label.is_suggested else ""
            extras = {NOTE: label.note, POINT: point, TAG: " ".join(label.tags), STATE: state}
            document.add_annotation(row.subject, start, end, label.target)
            for tier, value in ((f"{row.subject}{suffix}", value) for suffix, value in extras.items() if value):
                if tier not in document.tiers:
                    document.add_tier(tier)
                document.add_annotation(tier, start, end, value)
        atomic_write(path, b"<?xml version='1.0' encoding='UTF-8'?>\n" + to_string(document, encoding="UTF-8"))
        return ()


@dataclass(frozen=True, slots=True, kw_only=True)
class _Annotation:
    """An annotation between two time slots, or one that refers to another annotation.

    ``previous`` is the annotation after which it comes, of those that refer to the same one.
    """

    value: str
    slots: tuple[str, str] | None = None
    parent: str | None = None
    previous: str | None = None


@dataclass(frozen=True, kw_only=True)
class _Document:
    """What is read of a document: times by slot, ms, tiers of annotations by id, and each film's offset by address."""

    path: Path
    times: dict[str, int | None]
    tiers: dict[str, dict[str, _Annotation]]
    films: dict[str, str]

    def annotations(self, tier: str) -> list[tuple[int, int, str]]:
        """Start, end (ms) and value of a tier's annotations.

        Raises
        ------
        VfoaError
            If one has no times, or refers to something that is not there.
        """
        annotations = []
        for name, annotation in self.tiers.get(tier, {}).items():
            try:
                start, end = self._times_of(name)
            except (KeyError, RecursionError) as error:
                what = f"refers to the time slot or annotation {error}, which the file does not have"
                raise VfoaError(f"{self.path}: tier {tier!r} {what}") from None
            if start is None or end is None:
                raise VfoaError(
                    f"{self.path}: tier {tier!r} has an annotation without times; expected time-aligned annotations"
                )
            annotations.append((start, end, annotation.value))
        return annotations

    def _times_of(self, name: str) -> tuple[int | None, int | None]:
        """An annotation that refers to another one has its times, or an equal share if several refer to it."""
        annotation, place, count = self._places[name]
        if annotation.parent is None:
            first, last = annotation.slots or ("", "")
            return self.times[first], self.times[last]
        start, end = self._times_of(annotation.parent)
        if start is None or end is None:
            return None, None
        return start + (end - start) * place // count, start + (end - start) * (place + 1) // count

    @cached_property
    def _places(self) -> dict[str, tuple[_Annotation, int, int]]:
        """Each annotation by id, its place among those of its tier that refer to the same one, and their number.

        Those that are each other's previous one have no place.
        """
        places = {}
        for tier in reversed(self.tiers.values()):  # the first tier with an id counts
            siblings = defaultdict[str | None, list[str]](list)
            for name, annotation in tier.items():
                siblings[annotation.parent].append(name)
            for names in siblings.values():
                places.update(
                    {name: (tier[name], place, len(names)) for place, name in enumerate(_chained(names, tier))}
                )
        return places


def _chained(names: Collection[str], tier: Mapping[str, _Annotation]) -> Iterator[str]:
    """Annotations in their order, each after its previous one; those without one are in the order of the file."""
    known, followers = frozenset(names), defaultdict[str | None, list[str]](list)
    for name in names:
        previous = tier[name].previous
        followers[previous if previous in known else None].append(name)
    waiting = followers[None][::-1]
    while waiting:
        yield (name := waiting.pop())
        waiting += reversed(followers[name])


def _parse(path: Path, exchange: Exchange) -> _Document:
    data = read_bytes(path)
    if is_elan_text(data[:4096]):
        return _of_text(path, read_elan_text(path, has_offset=exchange.offset is not None, fps=exchange.fps))
    root = parse_xml(data, path)
    if root.tag != "ANNOTATION_DOCUMENT":
        raise VfoaError(f"{path}: found <{root.tag}>; expected ELAN's <ANNOTATION_DOCUMENT>")
    units = {header.get("TIME_UNITS", _MILLISECONDS) for header in root.iter("HEADER")}
    if other := units - {_MILLISECONDS}:
        raise VfoaError(f"{path}: TIME_UNITS: found {', '.join(sorted(other))!r}; expected {_MILLISECONDS}")
    times = {_given(slot, "TIME_SLOT_ID", path): _time(slot, path) for slot in root.iter("TIME_SLOT")}
    tiers = {_given(tier, "TIER_ID", path): _tier(tier, path) for tier in root.iter("TIER")}
    for tier in tiers.values():
        _share_times(tier.values(), times)
    films: dict[str, str] = {}
    for medium in root.iter("MEDIA_DESCRIPTOR"):
        if not medium.get("MIME_TYPE", "").startswith("audio"):
            address = medium.get("MEDIA_URL") or medium.get("RELATIVE_MEDIA_URL") or ""
            films.setdefault(address, medium.get("TIME_ORIGIN") or "0")
    return _Document(path=path, times=times, tiers=tiers, films=films)


def _of_text(path: Path, annotations: Iterable[TextAnnotation]) -> _Document:
    """The document of exported annotations: a time slot for each of their ends."""
    times: dict[str, int | None] = {}
    tiers = defaultdict[str, dict[str, _Annotation]](dict)
    for number, annotation in enumerate(annotations):
        slots = f"{number} start", f"{number} end"
        times.update(zip(slots, (annotation.start_ms, annotation.end_ms), strict=True))
        tiers[annotation.tier][f"{number}"] = _Annotation(value=annotation.value, slots=slots)
    return _Document(path=path, times=times, tiers=tiers, films={})


def _tier(tier: Element, path: Path) -> dict[str, _Annotation]:
    annotations = {}
    for element in tier.iter():
        if element.tag in ("ALIGNABLE_ANNOTATION", "REF_ANNOTATION"):
            value = element.find("ANNOTATION_VALUE")
            is_aligned = element.tag == "ALIGNABLE_ANNOTATION"
            annotations[_given(element, "ANNOTATION_ID", path)] = _Annotation(
                value="" if value is None else "".join(value.itertext()).strip(),
                slots=(_given(element, "TIME_SLOT_REF1", path), _given(element, "TIME_SLOT_REF2", path))
                if is_aligned
                else None,
                parent=None if is_aligned else _given(element, "ANNOTATION_REF", path),
                previous=element.get("PREVIOUS_ANNOTATION"),
            )
    return annotations


def _given(element: Element, key: str, path: Path) -> str:
    if (value := element.get(key)) is None:
        raise VfoaError(f"{path}: <{element.tag}> without {key}; expected an ELAN document")
    return value


def _time(slot: Element, path: Path) -> int | None:
    """The time of a slot, ms; None for one without a time."""
    if (value := slot.get("TIME_VALUE")) is None:
        return None
    try:
        return int(value)
    except ValueError:
        raise VfoaError(f"{path}: TIME_VALUE: found {value[:40]!r}; expected milliseconds") from None


def _share_times(annotations: Iterable[_Annotation], times: dict[str, int | None]) -> None:
    """Give times to the slots without one: evenly between their neighbours in a tier, as ELAN shows a subdivision."""
    next_from = {annotation.slots[0]: annotation.slots[1] for annotation in annotations if annotation.slots}
    for first in [slot for slot in next_from if times.get(slot) is not None]:
        chain, last = {first: None}, first
        while last in next_from and times.get(slot := next_from[last]) is None and slot not in chain:
            chain[slot], last = None, slot
        start, end = times[first], times.get(next_from.get(last, ""))
        if len(chain) > 1 and start is not None and end is not None:
            times.update({slot: start + (end - start) * place // len(chain) for place, slot in enumerate(chain)})


def _film_offset_ms(document: _Document, exchange: Exchange) -> int:
    """The offset of the film that shows the clip to the document's time, ms, which ELAN stores as ``TIME_ORIGIN``."""
    film = exchange.film_of([*document.films], document.path, begin=document.films.get)
    origin = "0" if film is None else document.films[film]
    try:
        return int(origin)
    except ValueError:
        raise VfoaError(f"{document.path}: TIME_ORIGIN: found {origin!r}; expected milliseconds") from None
