"""Results of ``vfoa fit``, as tables."""

from __future__ import annotations

from collections.abc import Sequence

from harness.report.formats import Table, number, percent
from harness.run.fitted import FittedWeights, MethodScore


def fit_tables(fitted: FittedWeights) -> list[Table]:
    """The scores of every method on what was left out, and those of the fit with fewer labels."""
    record = fitted.fit
    tables = []
    if record.held_out:
        notes = [
            "Every row has the same frames: of clips, or parts of the clip, that the fit and the limit did not see.",
            "Log loss: mean of -ln of the probability of the true answer; lower is better. ECE: expected calibration "
            "error. Balanced: mean of the rates on targets and on nowhere. forward: with earlier frames; both: with "
            "later ones, too.",
        ]
        people = "1 person" if record.people == 1 else f"{record.people} people"
        tables.append(_table(f"{record.labelled_s:g} s of {people}, left out in turn", record.held_out, notes))
    if record.curve:
        notes = ["The forward fit with so many labelled seconds, spread over the people; all of them: the table above."]
        tables.append(_table("What more labels would give", record.curve, notes))
    return tables


def _table(title: str, rows: Sequence[MethodScore], notes: Sequence[str]) -> Table:
    return Table.of(
        title,
        "Method | n | Log loss | ECE | Balanced % | FRR % | Targets %",
        (
            (
                *(row.method, row.n, number(row.log_loss, 3), number(row.calibration_error, 3)),
                *map(percent, (row.balanced_frr, row.frr, row.recall_on_targets)),
            )
            for row in rows
        ),
        words=1,
        notes=notes,
    )
