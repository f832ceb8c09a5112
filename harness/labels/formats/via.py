"""VIA 3, VGG's annotator of videos: an attribute for each subject, whose segments have the targets as values.

An attribute may hold several subjects, if it is called ``subject`` or another name of
:data:`~harness.labels.formats.own_table.COLUMNS`: a row of VIA's timeline is then a subject, and another attribute of
the same segments has the targets.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from harness.labels.formats.exchange import Exchange, Imported, ReadOnly
from harness.labels.formats.tiers import Annotation, check_chosen, from_tiers, named_subject, target_code
from harness.labels.formats.via_files import Entry, read_entries


class Via(ReadOnly):
    """Reads the segments of subjects; other entries are left out, with a note."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read them. ``exchange.modifier`` is the attribute that names the targets, of segments with several."""
        entries, films = read_entries(path)
        # each film has times of its own: an offset does not choose between them, as it does in ELAN's documents
        film = replace(exchange, offset=None).film_of(films, path)
        shown = [entry for entry in entries if entry.film == film]
        segments = [entry for entry in shown if entry.is_segment]
        check_chosen(exchange.modifier, (segment.values for segment in segments), path)
        tiers = _tiers(segments, exchange.modifier, path)
        sizes = {tier: len(annotations) for tier, annotations in tiers.items()}
        imported = from_tiers(sizes, lambda tier: tiers.get(tier, ()), exchange, path, kind="attribute")
        regions = sum(entry.has_region for entry in shown)
        left_out = {
            "segments or regions of other films": len(entries) - len(shown),
            "regions of images": regions,
            "entries without a start and an end": len(shown) - len(segments) - regions,
        }
        notes = (f"{path}: {count} {what} are left out." for what, count in left_out.items() if count)
        return Imported(labels=imported.labels, notes=(*imported.notes, *notes))


def _tiers(segments: Sequence[Entry], chosen: str | None, path: Path) -> dict[str, list[Annotation]]:
    """The annotations by the subject that an attribute of theirs names, or by their attribute."""
    tiers, named = defaultdict[str, list[Annotation]](list), defaultdict[str, list[Entry]](list)
    for segment in segments:
        if (subject := named_subject(segment.values)) is not None:
            named[subject].append(segment)
        else:
            for attribute, text in segment.values.items():
                tiers[attribute].append(_annotation(segment, text))
    for subject, held in named.items():
        attribute = target_code(
            [segment.values for segment in held], chosen, f"{path}: subject {subject!r}", kind="attribute"
        )
        tiers[subject] += (_annotation(segment, segment.values.get(attribute, "")) for segment in held)
    return dict(tiers)


def _annotation(segment: Entry, text: str) -> Annotation:
    start_ms, end_ms = (round(1000 * time) for time in segment.times_s)
    return start_ms, end_ms, text
