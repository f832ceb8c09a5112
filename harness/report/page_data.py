"""What the report page draws from: strips of verdicts, attention over frames, confusions. Plain values for JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

from harness.record.labels import Colours, attention_by_name
from harness.report.formats import UNKNOWN, Table
from harness.report.thumbnails.reader import Thumbnails
from harness.run.directory import Pair
from harness.run.results import FrameRecord
from harness.score.outcomes import answer
from harness.score.verdicts import ERROR_TYPES, NO_HIT, Verdict, find_subject

STATES = ("correct", "unscored", *ERROR_TYPES)
"""What a cell of a strip can say; the page's data holds the place in this list."""

_Key = tuple[str, str, int, str]
_Values = dict[str, tuple[int | None, int | None, int]]


class AttentionLog:
    """Keeps every named subject's attention while records pass by: see :meth:`watch`."""

    def __init__(self) -> None:
        self._values: dict[_Key, _Values] = {}
        self._colours: dict[str, Colours] = {}

    def watch(self, records: Iterable[FrameRecord]) -> Iterator[FrameRecord]:
        """Hand the records on and keep, by target's name, gaze, head and total in thousandths."""
        for record in records:
            colours = self._colours.setdefault(record.clip, Colours(()))
            for target in record.targets:
                colours.class_of(target.name)
            for name in dict.fromkeys(subject.name for subject in record.subjects if subject.name is not None):
                if (found := find_subject(record, name)) is not None:
                    self._values[record.clip, record.configuration, record.frame, name] = {
                        target: (_thousandths(value.gaze), _thousandths(value.head), round(1000 * value.total))
                        for target, value in attention_by_name(record, found).items()
                    }
            yield record

    def of(self, verdict: Verdict) -> _Values:
        """The attention behind a verdict, by target's name; empty where there was none."""
        return self._values.get((verdict.clip, verdict.configuration, verdict.frame, verdict.subject), {})

    def colours(self, clip: str) -> Colours:
        """The colours of a clip's targets, by the order in which they appear."""
        return self._colours.setdefault(clip, Colours(()))


@dataclass(frozen=True, slots=True, kw_only=True)
class Served:
    """What a page knows that a server gives out: its run's directory, and under which name each recording opens."""

    run: str
    recordings: Mapping[Pair, str]


def page_data(
    verdicts: Sequence[Verdict], attention: AttentionLog, thumbnails: Thumbnails, served: Served | None
) -> dict[str, Any]:
    """Everything the page's script draws, each (clip, subject) with one strip per configuration.

    A strip holds equally long lists over its frames; ``values`` is, by target, the lists of gaze, head and total in
    thousandths, None where unknown. Colours are CSS. ``recording`` is the name of the one that the cells lead to.
    ``pictures`` are by clip and frame; what a configuration saw in them is in its strips, by frame.
    """
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for (clip, configuration, subject), each in groupby(verdicts, key=lambda v: (v.clip, v.configuration, v.subject)):
        judged = list(each)
        strip = _strip(configuration, judged, attention)
        strip["seen"] = _seen(judged, thumbnails)
        strip["recording"] = served and served.recordings.get((clip, configuration))
        groups.setdefault((clip, subject), []).append(strip)
    pictures: dict[str, dict[int, str]] = {}
    for (clip, frame), picture in thumbnails.pictures.items():
        pictures.setdefault(clip, {})[frame] = picture
    return {
        "states": STATES,
        "run": served and served.run,
        "pictures": pictures,
        "groups": [
            {"clip": clip, "subject": subject, "strips": strips, "colours": _colours(attention.colours(clip), strips)}
            for (clip, subject), strips in groups.items()
        ],
    }


def _strip(configuration: str, verdicts: list[Verdict], attention: AttentionLog) -> dict[str, Any]:
    values = [attention.of(verdict) for verdict in verdicts]
    names = dict.fromkeys(name for each in values for name in each)
    unknown = (None, None, None)
    return {
        "config": configuration,
        "frames": [verdict.frame for verdict in verdicts],
        "states": [STATES.index(verdict.error_type or verdict.outcome) for verdict in verdicts],
        "truth": [verdict.truth for verdict in verdicts],
        "predicted": [verdict.predicted for verdict in verdicts],
        "values": {name: list(zip(*(each.get(name, unknown) for each in values), strict=True)) for name in names},
    }


def _seen(verdicts: list[Verdict], thumbnails: Thumbnails) -> dict[int, dict[str, Any]]:
    """By frame, what is drawn over the picture of a subject who was judged wrong."""
    drawn = {}
    for each in verdicts:
        thumbnail = thumbnails.seen.get((each.clip, each.configuration, each.frame))
        if thumbnail is not None and each.outcome == "wrong":
            subject = next((found for found in thumbnail.subjects if found.name == each.subject), None)
            drawn[each.frame] = {
                "size": thumbnail.size,
                "boxes": thumbnail.boxes,
                "head": subject and subject.head,
                "focus": subject and subject.focus,
                "lines": subject.lines if subject else [],
            }
    return drawn


def _colours(colours: Colours, strips: list[dict[str, Any]]) -> dict[str, str]:
    truths = {name for strip in strips for name in strip["truth"] if name is not None}
    names = dict.fromkeys((*(name for strip in strips for name in strip["values"]), *sorted(truths)))
    return {name: "rgb({} {} {})".format(*colours.of(name)) for name in names}


def _thousandths(value: float | None) -> int | None:
    return None if value is None else round(1000 * value)


@dataclass(frozen=True, slots=True, kw_only=True)
class Confusion:
    """Counts of one configuration on one clip; ``rows`` are a true label and its counts, as ``answers`` are ordered."""

    configuration: str
    answers: tuple[str, ...]
    rows: tuple[tuple[str, tuple[int, ...]], ...]


def confusions(verdicts: Iterable[Verdict]) -> dict[str, list[Confusion]]:
    """By clip, the scored frames of each configuration: truth by answer, "no prediction" last."""
    counts: dict[str, dict[str, Counter[tuple[str, str]]]] = {}
    for verdict in verdicts:
        if verdict.outcome != "unscored":
            of_clip = counts.setdefault(verdict.clip, {}).setdefault(verdict.configuration, Counter())
            of_clip[str(verdict.truth), _answered(verdict)] += 1
    return {
        clip: [_confusion(configuration, each) for configuration, each in by_configuration.items()]
        for clip, by_configuration in counts.items()
    }


_NO_PREDICTION = "no prediction"


def _answered(verdict: Verdict) -> str:
    if verdict.outcome == "wrong" and verdict.predicted == NO_HIT:
        return NO_HIT
    return answer(verdict) or _NO_PREDICTION


def _confusion(configuration: str, counts: Counter[tuple[str, str]]) -> Confusion:
    truths = sorted({truth for truth, _ in counts})
    others = {given for _, given in counts} - {*truths, _NO_PREDICTION}
    answers = (*truths, *sorted(others), *([_NO_PREDICTION] if any(b == _NO_PREDICTION for _, b in counts) else []))
    rows = tuple((truth, tuple(counts[truth, given] for given in answers)) for truth in truths)
    return Confusion(configuration=configuration, answers=answers, rows=rows)


def differing_settings(configurations: Mapping[str, Mapping[str, Any]]) -> Table:
    """The settings in which a run's configurations differ, a row per setting and a column per configuration."""
    flat = {name: dict(_flatten(settings)) for name, settings in configurations.items()}
    keys = dict.fromkeys(key for settings in flat.values() for key in settings)
    rows = [(key, *(settings.get(key, UNKNOWN) for settings in flat.values())) for key in keys]
    return Table(
        title="Where the configurations differ",
        columns=("Setting", *flat),
        words=1,
        rows=tuple(row for row in rows if len(set(row[1:])) > 1),
    )


def _flatten(settings: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, str]]:
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from _flatten(value, f"{above}{key}.")
        else:
            yield f"{above}{key}", ", ".join(map(str, value)) if isinstance(value, list) else str(value)
