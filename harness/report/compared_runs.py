"""Runs side by side: the answer in a few sentences, the ranking, and the frames that changed their verdict."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

from harness.files.groups import grouped
from harness.files.safe_names import vfoa_command
from harness.report.comparisons import run_in_words, shared_folder
from harness.report.formats import Table, percent, percent_range
from harness.report.verdict import NOTHING_SCORED, best_of
from harness.score.compared_runs import ComparedRuns, VerdictChange
from harness.score.comparison import NO_COMMON_FRAME, Comparison, identical_on
from harness.score.verdicts import answered
from vfoa.errors import counted, listed

MOST_SENTENCES = 3
"""Most sentences on differences; the table has all."""


def compared_lines(compared: ComparedRuns) -> list[str]:
    """The answer: the runs that are identical, the significant differences, then the best configuration."""
    shared, comparisons = shared_folder(compared.places), compared.comparisons
    found = [
        *_identical_runs(compared, shared),
        *(f"{_short(comparison, shared).sentence}." for comparison in comparisons if comparison.is_significant),
    ]
    lines = found[:MOST_SENTENCES]
    if len(found) > MOST_SENTENCES:
        lines.append(f"{len(found) - MOST_SENTENCES} more are in the table.")
    if not found and comparisons:
        pairs = "the only pair" if len(comparisons) == 1 else f"{len(comparisons)} pairs"
        same = sum(comparison.is_identical for comparison in comparisons)
        apart = sum(comparison.n == 0 for comparison in comparisons)
        more = f"{f'; {same} identical' if same else ''}{f'; {apart} with {NO_COMMON_FRAME}' if apart else ''}"
        lines.append(f"No significant difference in {pairs}{more}.")
    ranked = compared.ranked()
    if not ranked:
        return [NOTHING_SCORED]
    if len(compared.places) == 1:
        lines.append("Nothing to compare: one configuration; add another run, or --baseline RUN.")
    for best in ranked[:1]:
        ends = percent_range(best.scores.interval)
        who = f"{best_of([row.scores for row in ranked])}: {best.name.removeprefix(shared)}"
        lines.append(f"{who}, right in {percent(best.scores.frr)} % of the frames (95 %: {ends}).")
    return lines


def _identical_runs(compared: ComparedRuns, shared: str) -> Iterator[str]:
    """A sentence for every two runs that are right on the same frames in all configurations that are compared."""
    of_runs = grouped(
        (tuple(compared.places[name][0] for name in comparison.names), comparison)
        for comparison in compared.comparisons
    )
    for runs, comparisons in of_runs.items():
        if len({*runs}) > 1 and all(comparison.is_identical for comparison in comparisons):
            names = " and ".join(run_in_words(run, shared) for run in runs)
            many = counted(len(comparisons), "configuration")
            yield f"{names}: {identical_on(sum(comparison.n for comparison in comparisons))} of {many}."


def _short(comparison: Comparison, shared: str) -> Comparison:
    names = comparison.reference.removeprefix(shared), comparison.configuration.removeprefix(shared)
    return replace(comparison, reference=names[0], configuration=names[1])


def ranking_table(compared: ComparedRuns) -> Table:
    """Every configuration of every run by its FRR, the best first."""
    shared, rows = shared_folder(compared.places), compared.ranked()
    notes = ["FRR %: on all labelled frames of the run. 95 %: its interval by clips or, below 6 clips, by looks."]
    if len({row.scores.n for row in rows}) > 1:
        notes.append("n differs: these rates are on different frames. The differences below are on common frames.")
    if compared.comparisons and (alone := compared.uncompared):
        names = ", ".join(name.removeprefix(shared) for name in alone)
        notes.append(f"In one run only, so ranked and not compared: {names}.")
    first = next(iter(compared.scores))
    notes += (f"{run} differs from {first} in {what}." for run, what in compared.made_otherwise().items())
    notes += (
        f"{run}: labels of {listed(clips)} have changed since its own tables were written: rates and "
        f"comparisons here have the present ones. `{vfoa_command('score', run)}` updates its tables."
        for run, clips in compared.relabelled().items()
    )
    return Table.of(
        "Configurations by FRR",
        "Configuration | FRR % | 95 % | n | Clips",
        (
            (
                *(row.name.removeprefix(shared), percent(row.scores.frr), percent_range(row.scores.interval)),
                *(row.scores.n, row.scores.clips),
            )
            for row in rows
        ),
        words=1,
        notes=notes,
    )


def changes_table(changes: Iterable[VerdictChange], shared: str) -> Table:
    """Frames that are right in one configuration and wrong in the other, a row for each stretch; ``shared`` is cut."""
    return Table.of(
        "Frames that changed their verdict",
        "Configuration | Against | Change | Clip | Subject | Frames | Truth | Then | Now | Error type | Count",
        (
            (
                *(change.configuration.removeprefix(shared), change.reference.removeprefix(shared)),
                "better" if change.is_better else "worse",
                *(change.before.clip, change.before.subject, _frames(change)),
                *(change.before.truth, answered(change.before), answered(change.after)),
                (change.before.error_type or change.after.error_type or "").replace("_", " "),
                len(change.frames),
            )
            for change in changes
        ),
        words=10,
        notes=(
            "A row is a stretch of labelled frames, one after the other, with the same answers. Then: the answer of "
            "the configuration in the column Against. Error type: that of the wrong answer.",
        ),
    )


def _frames(change: VerdictChange) -> str:
    first, last = change.frames[0], change.frames[-1]
    return str(first) if first == last else f"{first}–{last}"
