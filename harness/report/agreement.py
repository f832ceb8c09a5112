"""Agreement of annotators, as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from harness.labels.labels import Labels
from harness.report.formats import Table, interval_range, number, percent
from harness.score.agreement import Agreement, differences
from vfoa.scoring import ALL

_NOTE = (
    "Frames that both annotators judged: no ignore, no suggestion. Kappa: Cohen 1960; its interval: 95 %, from "
    "resampled looks of the first annotator, because the frames of a look are not independent; unknown with few "
    "looks. Specific agreement: 2 both / (first + second)."
)


def agreement_tables(
    clip: str, labels: Mapping[str, Labels], agreements: Sequence[Agreement], frames: Sequence[int], away_s: float = 0.0
) -> dict[str, Table]:
    """Return all tables of the agreement of annotators on a clip, by the name of their file.

    Kappa of every pair of annotators, pooled and by subject; agreement by target; the confusion of each pair (the first
    in rows, the second in columns); and every range in which two of them differ, also near a change. ``away_s`` is what
    the agreements were made with.
    """
    away = (f"Only frames farther than {away_s:g} s from any change of a label.",) if away_s else ()
    pooled = [agreement for agreement in agreements if agreement.subject is None]
    kappas = Table.of(
        f"{clip}: agreement of annotators",
        "First | Second | Subject | n | Not compared | Same % | Kappa | 95 %",
        (
            (
                *(agreement.first, agreement.second, agreement.subject or ALL, agreement.n, agreement.skipped),
                *(percent(agreement.agreed / agreement.n if agreement.n else None), number(agreement.kappa, 2)),
                interval_range(agreement.interval, ".2f"),
            )
            for agreement in agreements
        ),
        words=3,
        notes=(*away, _NOTE),
    )
    targets = Table.of(
        f"{clip}: agreement by target",
        "First | Second | Target | n first | n second | n both | Specific % | Kappa",
        (
            (pair.first, pair.second, *target[:4], percent(target.share), number(target.kappa, 2))
            for pair in pooled
            for target in pair.by_target()
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
            (pair.first, pair.second, *difference)
            for pair in pooled
            for difference in differences(labels[pair.first], labels[pair.second], frames)
        ),
        words=5,
    )
    return {"agreement": kappas, "agreement_by_target": targets, **confusions, "differences": ranges}
