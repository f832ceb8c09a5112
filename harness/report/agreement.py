"""Agreement of annotators, as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from harness.labels.labels import Labels
from harness.report.formats import Table, interval_range, number, percent
from harness.score.agreement import Agreement, differences

_NOTE = (
    "Frames that both annotators judged: no ignore, no suggestion. Kappa: Cohen 1960; its interval: 95 %, from "
    "resampled looks of the first annotator, because the frames of a look are not independent; unknown with few "
    "looks. Specific agreement: 2 both / (first + second)."
)


def agreement_tables(
    clip: str, labels: Mapping[str, Labels], found: Sequence[Agreement], frames: Sequence[int]
) -> dict[str, Table]:
    """Return all tables of the agreement of annotators on a clip, by the name of their file.

    Kappa of every pair of annotators, pooled and by subject; agreement by target; the confusion of each pair (the first
    in rows, the second in columns); and every range in which two of them differ.
    """
    pooled = [each for each in found if each.subject is None]
    kappas = Table.of(
        f"{clip}: agreement of annotators",
        "First | Second | Subject | n | Not compared | Same % | Kappa | 95 %",
        (
            (
                *(each.first, each.second, each.subject or "(all)", each.n, each.skipped),
                *(percent(each.agreed / each.n if each.n else None), number(each.kappa, 2)),
                interval_range(each.interval, ".2f"),
            )
            for each in found
        ),
        words=3,
        notes=(_NOTE,),
    )
    targets = Table.of(
        f"{clip}: agreement by target",
        "First | Second | Target | n first | n second | n both | Specific % | Kappa",
        (
            (
                *(pair.first, pair.second, each.target, each.first, each.second, each.both),
                *(percent(each.share), number(each.kappa, 2)),
            )
            for pair in pooled
            for each in pair.by_target()
        ),
        words=3,
    )
    confusions = {
        f"confusion_{pair.first}_{pair.second}": Table(
            title=f"{clip}: {pair.first} (rows) and {pair.second} (columns), frames",
            columns=("", *pair.targets),
            rows=tuple(
                (name, *map(str, counts)) for name, counts in zip(pair.targets, pair.confusion.tolist(), strict=True)
            ),
            words=1,
        )
        for pair in pooled
    }
    ranges = Table.of(
        f"{clip}: where annotators differ",
        "First | Second | Subject | First says | Second says | From frame | To frame | Frames",
        (
            (
                *(pair.first, pair.second, each.subject, each.first, each.second),
                *(each.first_frame, each.last_frame, each.frames),
            )
            for pair in pooled
            for each in differences(labels[pair.first], labels[pair.second], frames)
        ),
        words=5,
    )
    return {"agreement": kappas, "agreement_by_target": targets, **confusions, "differences": ranges}
