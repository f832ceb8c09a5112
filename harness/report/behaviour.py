"""Behaviour as tables: ``behaviour.csv``, and panels that show the labels and every configuration side by side."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from weakref import WeakKeyDictionary

from harness.report.csv_tables import ALL
from harness.report.formats import UNKNOWN, Table
from harness.run.measure_log import MeasureLog
from harness.score.behaviour import BehaviourRow, measure_behaviour
from harness.score.score import Scores
from harness.score.sequences import TRUTH

_MOST_CLIPS = 4
"""With more clips, the page shows only the values over all of them; ``behaviour.csv`` has every clip."""

_TITLES = {
    "time_share": "Time on",
    "looks_per_min": "Looks per minute at",
    "look_length_s": "Length of looks, s, at",
    "transitions_per_min": "Transitions per minute",
    "mutual_gaze_share": "Mutual gaze",
    "mutual_gaze_length_s": "Length of mutual gazes, s",
    "joint_attention_share": "Joint attention",
    "joint_attention_length_s": "Length of joint attention, s",
    "followed_share": "Looks followed",
    "following_latency_s": "Latency of following, s",
}

_NOTES = (
    "Labels and configurations side by side, with 95 % intervals by looks of these clips (from six clips on: by clips "
    "like these). Time: in which the source says what is looked at; frames labelled ignore are left out for all.",
    "Nothing hit counts as looking at nothing (none). A gap of at most 0.5 s, such as a blink, ends no look.",
    "Joint attention: both look at one target that is neither of them. Followed: the first looks at what the second "
    "began to look at, at most 2 s later. `behaviour.csv` has every measure, with numbers of looks.",
)


def behaviour_csv(scores: Scores) -> Table:
    """Every measure of every clip, subject, pair and source, for programs; unknown values are empty."""
    return Table(
        title="Behaviour",
        columns=(
            *("clip", "subject", "partner", "source", "measure", "from_target", "target"),
            *("value", "n", "interval_low", "interval_high", "interval_unit"),
        ),
        words=7,
        rows=tuple(_csv_row(row) for row in _measured(scores)),
    )


def behaviour_table(scores: Scores) -> Table:
    """One row per measure, one column per source; over all clips and, if they are few, for each clip."""
    rows = [row for row in _shown(scores) if row.measure in _TITLES]
    return _side_by_side("Behaviour", ("Clip", "Who", "Measure"), rows, _NOTES, lambda row: (_title(row),))


def transitions_table(scores: Scores) -> Table:
    """The matrix of transitions as a list: one row per pair of targets, one column per source."""
    rows = [row for row in _shown(scores) if row.measure == "transitions"]
    return _side_by_side(
        "Transitions from target to target",
        ("Clip", "Who", "From", "To"),
        rows,
        ("How often a look at one target was followed by a look at the other; with the same gaps as above.",),
        lambda row: (row.before or "", row.target or ""),
    )


def _shown(scores: Scores) -> list[BehaviourRow]:
    few = len({each.clip for each in scores.outcomes}) <= _MOST_CLIPS
    return sorted(_measured(scores, by_clip=few), key=lambda row: row.clip is not None)


_known: WeakKeyDictionary[MeasureLog, dict[bool, list[BehaviourRow]]] = WeakKeyDictionary()
"""The rows by run, and by whether those of single clips are among them: tables and panels show the same ones."""


def _measured(scores: Scores, *, by_clip: bool = True) -> list[BehaviourRow]:
    known = _known.setdefault(scores.measures, {})
    if not by_clip and True in known:
        return [row for row in known[True] if row.clip is None]
    if by_clip not in known:
        known[by_clip] = measure_behaviour(scores.outcomes, by_clip=by_clip)
    return known[by_clip]


def _side_by_side(
    title: str,
    columns: Sequence[str],
    rows: Iterable[BehaviourRow],
    notes: tuple[str, ...],
    words: Callable[[BehaviourRow], tuple[str, ...]],
) -> Table:
    sources: dict[str, None] = {}
    cells: dict[tuple[str, ...], dict[str, str]] = {}
    for row in rows:
        sources.setdefault(row.source)
        cells.setdefault((row.clip or ALL, _who(row), *words(row)), {})[row.source] = _cell(row)
    order = sorted(sources, key=lambda source: source != TRUTH)
    return Table(
        title=title,
        columns=(*columns, *("Labels" if source == TRUTH else source for source in order)),
        words=len(columns),
        rows=tuple((*key, *(found.get(source, UNKNOWN) for source in order)) for key, found in cells.items()),
        notes=notes,
    )


def _who(row: BehaviourRow) -> str:
    if row.subject is None:
        return ALL
    return row.subject if row.partner is None else f"{row.subject}, {row.partner}"


def _title(row: BehaviourRow) -> str:
    title = _TITLES[row.measure]
    if row.target is not None:
        return f"{title} {row.target}"
    return f"{title} anything" if title.endswith(" at") else title


def _cell(row: BehaviourRow) -> str:
    if math.isnan(row.value):
        return UNKNOWN
    if row.interval is None:
        return str(row.n)
    scale, digits, sign = (100, 0, " %") if row.measure.endswith("share") else (1, 2, "")
    value = f"{scale * row.value:.{digits}f}{sign}"
    if math.isnan(row.interval.low):
        return value
    return f"{value} ({scale * row.interval.low:.{digits}f}–{scale * row.interval.high:.{digits}f})"


def _csv_row(row: BehaviourRow) -> tuple[str, ...]:
    interval = row.interval
    known = interval is not None and not math.isnan(interval.low)
    ends = (_number(interval.low), _number(interval.high), interval.unit) if interval and known else ("", "", "")
    return (
        *(row.clip or ALL, row.subject or ALL, row.partner or "", row.source, row.measure),
        *(row.before or "", row.target or "", _number(row.value), str(row.n), *ends),
    )


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.6f}"
