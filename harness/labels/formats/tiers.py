"""Labels in tiers: a tier for each subject, in it an annotation for each range, whose value is the target.

People also give each target a tier, whose annotations have no value. The user names such a tier ``SUBJECT:TARGET``
(``--rename host=girl:cup``).

Notes, image points, tags and suggestions are in tiers of their own beside a subject's (``girl:note``,
``girl:point_px``, ``girl:tag``, ``girl:state``), in annotations of the same times.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from harness.labels.formats.exchange import Exchange, Imported, one_line
from harness.labels.formats.spans import Span, from_spans
from harness.labels.formats.table_columns import COLUMNS
from harness.labels.labels import Label
from harness.labels.rows import SUGGESTED, parse_point, parse_tags
from vfoa.errors import VfoaError, check_known, counted

_EXTRAS = NOTE, POINT, TAG, STATE = ":note", ":point_px", ":tag", ":state"
"""What follows a subject's name in the names of the tiers beside it."""

_FARTHEST_MS = 2**53
"""Beyond it, seconds as a floating point number are not exact."""

Annotation = tuple[int, int, str]
"""Start and end, ms, and value."""
Read = Callable[[str], Sequence[Annotation]]
"""The annotations of a tier by its name; none of an unknown one."""
Codes = Mapping[str, str]
"""What an annotation of several values has: the text of each, "" for none, by the name of a code or attribute."""


def from_tiers(
    sizes: Mapping[str, int], read: Read, exchange: Exchange, path: Path, *, origin_ms: int = 0, kind: str = "tier"
) -> Imported:
    """Return the labels of the tiers named after subjects, or after one's looks at a target; note those left out.

    Parameters
    ----------
    sizes, read
        The number of annotations of each tier by name, and their reader, which is asked for subjects' tiers alone.
    origin_ms
        What is added to their times.
    kind
        What the program calls a tier.

    Raises
    ------
    VfoaError
        If no tier is a subject's, or an annotation has no time in a film, or is no label.
    """
    looks = {tier: found for tier in sizes if (found := _looks(tier, exchange))}
    if not looks:
        present = ", ".join(map(repr, sizes)) or "none"
        raise VfoaError(
            f"{path}: no {kind} is named after a subject; found {present}; expected "
            f"{', '.join(map(repr, exchange.subjects))} (--rename {kind.upper()}=OURS; of looks at one target: "
            f"--rename {kind.upper()}=OURS:TARGET)"
        )

    held = {tier: read(tier) for tier in looks}
    spans = [
        span
        for tier, (subject, target) in looks.items()
        for span in _spans(
            [(start, end, target or value) for start, end, value in held[tier]],
            *(tier, subject, read, exchange, f"{path}: {kind} {tier!r}", origin_ms),
        )
    ]
    imported = from_spans(spans, exchange, path)
    notes = [
        f"{path}: {kind} {tier!r}: {note}"
        for tier, (_, target) in looks.items()
        if (note := _unread(held[tier], target, f"--rename {tier}=SUBJECT:TARGET"))
    ]
    extras = {f"{tier}{suffix}" for tier in looks for suffix in _EXTRAS}
    others = (tier for tier, size in sizes.items() if size and tier not in looks and tier not in extras)
    notes += [f"{path}: {kind} {tier!r} belongs to no subject and is left out." for tier in others]
    return Imported(labels=imported.labels, notes=(*imported.notes, *notes))


def _looks(tier: str, exchange: Exchange) -> tuple[str, str] | None:
    """The subject of a tier, and the target of all its looks, "" if their values are the targets."""
    if (name := exchange.names.translate(tier)) in exchange.subjects:
        return name, ""
    found = exchange.looks_of(tier)
    return None if found and f":{found[1]}" in _EXTRAS else found


def _unread(annotations: Sequence[Annotation], target: str, option: str) -> str:
    """What of a tier is not read: annotations without a value, or the values of looks at one target; "" if nothing."""
    valued = sum(bool(value) for *_, value in annotations)
    if target:
        return f"not read: the values of {counted(valued, 'look')} at {target!r}." if valued else ""
    if not (empty := len(annotations) - valued):
        return ""
    hint = "" if valued else f"; if all are looks at one target: {option}"
    return f"left out: {counted(empty, 'annotation')} without a value{hint}."


def _spans(
    annotations: Sequence[Annotation],
    tier: str,
    subject: str,
    read: Read,
    exchange: Exchange,
    place: str,
    origin_ms: int,
) -> Iterator[Span]:
    notes, points, tags, states = (
        {(start, end): value for start, end, value in read(tier + suffix)} for suffix in _EXTRAS
    )
    for start, end, value in annotations:
        if max(abs(start), abs(end)) > _FARTHEST_MS:
            raise VfoaError(f"{place} has an annotation at {start} to {end} ms; expected a time in a film")
        if value and not exchange.names.leaves_out(tier, value):
            where = f"{place}, {start / 1000:.3f} to {end / 1000:.3f} s"
            label = Label(
                target=exchange.target(value, subject, where),
                note=one_line(notes.get((start, end))),
                point_px=parse_point(points.get((start, end), "").split(","), where),
                is_suggested=states.get((start, end)) == SUGGESTED,
                tags=parse_tags(tags.get((start, end), ""), where),
            )
            yield Span(start_ms=start + origin_ms, end_ms=end + origin_ms, subject=subject, label=label, where=where)


def check_chosen(chosen: str | None, annotations: Iterable[Codes], path: Path) -> None:
    """Raise a :class:`VfoaError` if no annotation has the chosen code (``--modifier``)."""
    if chosen is not None:
        check_known(chosen, {code for codes in annotations for code in codes}, f"{path}: --modifier: no")


def named_subject(codes: Codes) -> str | None:
    """The subject that a code of an annotation names, such as ``who``; None if the annotation is its tier's."""
    return next((text for code, text in codes.items() if text and _is("subject", code)), None)


def target_code(annotations: Collection[Codes], chosen: str | None, where: str, *, kind: str) -> str:
    """The code that names the targets: the chosen one, the only one, or the only one with a name such as ``target``.

    ``kind`` is what the program calls a code. A :class:`VfoaError` lists the codes if there is no such one.
    """
    codes = [*dict.fromkeys(code for each in annotations for code in each)]
    others = [code for code in codes if not _is("subject", code)]
    named = [code for code in others if _is("target", code)]
    kinds = ([code for code in codes if code == chosen], others, named)
    found = next((each for each in kinds if len(each) == 1), None)
    if annotations and found is None:
        listed = ", ".join(codes) or "none"
        expected = f"expected --modifier {kind.upper()}, the one that names the targets"
        raise VfoaError(f"{where}: found the {kind}s {listed}; {expected}")
    return found[0] if found else ""


def _is(kind: str, code: str) -> bool:
    return code.lower() in COLUMNS[kind]
