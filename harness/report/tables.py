"""The tables of a run: FRR for the paper, every frame, and the comparisons of configurations."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterable

from harness.report.csv_tables import ALL
from harness.report.formats import UNKNOWN, Table, number, percent
from harness.report.verdict import compared_rows, next_steps
from harness.score.baselines import BASELINES
from harness.score.intervals import LEAST_CLIPS
from harness.score.metrics import LEAST_PROBABILITY, load_metrics
from harness.score.oracle_ablation import without_oracles
from harness.score.score import ScoreRow, Scores
from harness.score.statistics import Interval
from harness.score.verdicts import ERROR_TYPES

FRR_NOTES = (
    "FRR: correct / annotated (frame, subject) pairs that are not marked ignore; n counts these pairs. A pair "
    "without a prediction is wrong.",
    "Units: looks, the longest runs of one true target of a subject, joined until they last 2 s, twice as long as "
    f"verdicts stay alike and, below {LEAST_CLIPS} clips, a sixteenth of all. Each counts as one observation, because "
    "the frames of a look are right or wrong together.",
    f"95 %: confidence interval. From {LEAST_CLIPS} clips on it resamples clips, then looks within them, and speaks "
    "of clips like these. Below that, and in the row of one clip, it resamples looks and speaks of these clips only. "
    "Percentiles are expanded for small samples; few or equal units get an exact interval. One look has none.",
    "Balanced: mean of the shares of right pairs among those with a true target (Targets) and among those whose label "
    "is none (Nowhere); always answering none gets 50 at most. Log loss, Brier: of methods that give probabilities, "
    f"lower is better; a probability of the truth below {LEAST_PROBABILITY:g} counts as this.",
    "Baseline: the best one, see the table of baselines. Beaten: by a sign-flip test by clips or looks, uncorrected: "
    "'not shown' where the FRR is higher and p is not below 0.05, 'no' where it is not higher.",
    "Coverage: share of pairs with an answer. No hit: share of pairs in which nothing got any attention (no ray hit "
    "anything); that is no answer, though right where the label is none. FRR given an answer: of the pairs with one.",
    "Wilson: the 95 % interval if frames were independent. They are not: read the other one.",
    f"{ALL}: the pairs of all clips together, so that longer clips weigh more.",
)
TERMINAL_NOTE = (
    "n: labelled (frame, subject) pairs; FRR: right ones; Balanced: mean of those with and without a target. 95 %, and "
    f"the test of whether the best baseline is beaten: by clips from {LEAST_CLIPS} clips on, else by looks of these "
    "clips only. No hit: no ray hit anything."
)


BALANCED = ("Balanced %", "Targets %", "Nowhere %", "Log loss", "Brier")
"""The columns beside the FRR, which alone would reward the answer "nowhere"."""
SHARES, LOSSES = ("balanced_frr", "recall_targets", "recall_nowhere"), ("log_loss", "brier")
"""The metrics in these columns."""
TERMINAL_COLUMNS = (
    *("Clip", "Configuration", "n", "FRR %", "95 %", "Balanced %", "Log loss", "Baseline %", "Beaten", "No hit %"),
)


def frr_table(scores: Scores) -> Table:
    """The main table: FRR of every configuration on every clip, with its interval, its best baseline and coverage."""
    return _table(
        "Focus recognition rate (FRR) by clip and configuration",
        (
            *("n", "Units", "FRR %", "95 %", *BALANCED),
            *("Baseline %", "Beaten", "Coverage %", "No hit %", "FRR given answer %", "Wilson"),
        ),
        scores.by_clip(),
        lambda row: (
            *(str(row.n), str(row.looks), percent(row.frr), _range(row.interval)),
            *(percent(row.metrics[name]) for name in SHARES),
            *(number(row.metrics[name], 3) for name in LOSSES),
            *(percent(row.baselines[row.best_baseline]), row.beats),
            *(percent(row.coverage), percent(row.no_hit / row.n), percent(row.frr_predicted), _range(row.wilson)),
        ),
        (*remarks(scores), *FRR_NOTES),
    )


def summary_table(scores: Scores) -> tuple[Table, int | None]:
    """A row for each configuration over all clips, at most :data:`MOST_ROWS`, and the place of the best one in it."""
    rows = compared_rows(scores)
    kept = set(map(id, sorted(rows, key=lambda row: -row.frr)[:MOST_ROWS]))
    places = [row for row in rows if id(row) in kept]
    left_out = f" The best {MOST_ROWS} of {len(rows)} configurations." if len(rows) > MOST_ROWS else ""
    columns: dict[str, list[str]] = {
        "Configuration": [row.configuration for row in places],
        "n": [str(row.n) for row in places],
        "FRR %": [percent(row.frr) for row in places],
        "95 %": [_range(row.interval) for row in places],
        "Balanced %": [percent(row.metrics["balanced_frr"]) for row in places],
        "Log loss": [number(row.metrics["log_loss"], 3) for row in places],
        "Baseline %": [percent(row.baselines[row.best_baseline]) for row in places],
        "Beaten": [row.beats for row in places],
        "No hit %": [percent(row.no_hit / row.n) for row in places],
    }
    has_losses = any(not math.isnan(row.metrics["log_loss"]) for row in places)
    columns.pop("No hit %" if has_losses else "Log loss")  # both do not fit
    table = Table(
        title="FRR of each configuration over all clips",
        columns=tuple(columns),
        words=1,
        rows=tuple(zip(*columns.values(), strict=True)),
        notes=(TERMINAL_NOTE + left_out,) if rows else (),
    )
    return table, places.index(max(places, key=lambda row: row.frr)) if places else None


MOST_ROWS = 12
"""Most configurations that the terminal shows unasked."""


def terminal_table(scores: Scores) -> Table:
    """The columns that fit a terminal of 100 characters, without the oracle ablation, and with short notes."""
    table, shown = frr_table(scores), without_oracles(scores.scored_configurations)
    chosen = [table.columns.index(name) for name in TERMINAL_COLUMNS]
    if all(row[table.columns.index("Log loss")] == UNKNOWN for row in table.rows):
        chosen.remove(table.columns.index("Log loss"))
    return Table(
        title=table.title,
        columns=tuple(table.columns[place] for place in chosen),
        rows=tuple(tuple(row[place] for place in chosen) for row in table.rows if row[1] in shown),
        words=table.words,
        notes=(
            *([TERMINAL_NOTE] if scores.rows else []),
            *remarks(scores),
            *next_steps(each for each in scores.verdicts if each.configuration in shown),
        ),
    )


def paper_table(scores: Scores) -> Table:
    """Numbers of correct and wrong frames by configuration, over all clips, as papers on the subject print them."""
    return Table(
        title="Correct and wrong frames by configuration",
        columns=("Configuration", "Correct", "Wrong", "FRR %"),
        words=1,
        rows=tuple(
            (row.configuration, str(row.correct), str(row.n - row.correct), percent(row.frr))
            for row in compared_rows(scores)
        ),
    )


def measures_table(scores: Scores) -> Table:
    """Agreement beyond the share of correct frames: every metric that the main table has not, then events."""
    metrics = {name: metric for name, metric in load_metrics().items() if name not in (*SHARES, *LOSSES)}
    return _table(
        "Agreement and events",
        (*(metric.title for metric in metrics.values()), "Event recall", "Event precision", "Event F"),
        scores.by_clip(),
        lambda row: (
            number(value + 0.0, 2)  # no minus before a zero
            for value in (*(row.metrics[name] for name in metrics), *row.events.rates)
        ),
        (
            " ".join(metric.meaning for metric in metrics.values()) + " Events: longest runs of one label; a true and "
            "a found one match if they have the same label and overlap, each used once.",
        ),
    )


def baselines_table(scores: Scores) -> Table:
    """Rates of the baselines on the same frames."""
    return _table(
        "Baselines on the same frames, FRR %",
        ("FRR", *(_words(name) for name in BASELINES), "Best", "Beaten"),
        scores.by_clip(),
        lambda row: (
            *(percent(share) for share in (row.frr, *(row.baselines[name] for name in BASELINES))),
            *(_words(row.best_baseline).lower(), row.beats),
        ),
        (
            "Commonest: always the subject's commonest label in the clip. Nearest: the box nearest to the eyes. "
            "Largest: in the image. Central: the box nearest to the camera's axis. Nearest in angle: the box nearest "
            "in angle to the measured gaze, or nothing beyond a limit that is best on the other clips (one clip: no "
            "limit). All but the first choose among what the configuration segmented. Beaten: see the first table.",
        ),
    )


def seeds_table(scores: Scores) -> Table:
    """Variation of rates between the seeds of the simulated errors; no rows for a run under one seed."""
    return _table(
        "Over seeds",
        ("Seeds", "Mean FRR %", "95 %", "SD over seeds", "Lowest %", "Highest %"),
        [row for row in scores.by_clip() if row.seed_rates],
        lambda row: (
            *(str(len(row.seed_rates)), percent(row.frr), _range(row.interval)),
            *map(percent, (statistics.stdev(row.seed_rates), min(row.seed_rates), max(row.seed_rates))),
        ),
        (
            "Each configuration ran under several seeds of its simulated errors. Rates are means over them, and n "
            "counts all. 95 %: over seeds and clips (below 6 clips, looks); each clip has errors of its own under "
            "every seed. SD: what one seed more or less does, in points.",
        ),
    )


def nowhere_table(scores: Scores) -> Table:
    """Precision and recall of "looks at nothing"; no rows if no method can say it, or nobody looks at nothing."""
    found = [(row, row.nowhere) for row in scores.by_clip() if row.nowhere and (row.nowhere.true or row.nowhere.said)]
    return Table(
        title="Looking at nothing",
        columns=("Clip", "Configuration", "True", "Said", "Both", "Precision %", "Recall %"),
        words=2,
        rows=tuple(
            (*_names(row), *map(str, (of.true, of.said, of.right)), *map(percent, (of.precision, of.recall)))
            for row, of in found
        ),
        notes=("Of the configurations whose method can answer that a subject looks at nothing in the scene.",),
    )


def visible_table(scores: Scores) -> Table:
    """FRR with and without the frames in which something blocks the line of sight; no rows without such labels."""
    return _table(
        "FRR with and without blocked lines of sight",
        ("n", "Blocked", "FRR %", "FRR % without blocked", "FRR % of blocked"),
        [row for row in scores.by_clip() if row.visible < row.n],
        lambda row: (
            *(str(row.n), str(row.n - row.visible), percent(row.frr), percent(row.frr_visible)),
            percent((row.correct - row.visible_correct) / (row.n - row.visible)),
        ),
        (
            "Blocked: the label's note says that something stands between the eyes and the target. The label says "
            "where the subject's gaze was aimed, which is then not what the subject sees.",
        ),
    )


def error_types_table(scores: Scores) -> Table:
    """Numbers of wrong frames by error type; error types that never occur are left out."""
    rows = scores.by_clip()
    seen = [error_type for error_type in ERROR_TYPES if any(row.error_types[error_type] for row in rows)]
    return _table(
        "Error types",
        ("Wrong", *(error_type.replace("_", " ") for error_type in seen)),
        rows,
        lambda row: (str(row.n - row.correct), *(str(row.error_types[error_type]) for error_type in seen)),
        tuple(f"{_words(error_type)}: {ERROR_TYPES[error_type]}." for error_type in seen),
    )


def subjects_table(scores: Scores) -> Table:
    """FRR of every subject."""
    return Table(
        title="FRR by subject",
        columns=("Clip", "Subject", "Configuration", "n", "Units", "FRR %", "95 %", "Coverage %", "No hit %"),
        words=3,
        rows=tuple(
            (
                *(str(row.clip), str(row.subject), row.configuration, str(row.n), str(row.looks), percent(row.frr)),
                *(_range(row.interval), percent(row.coverage), percent(row.no_hit / row.n)),
            )
            for row in scores.by_subject()
        ),
    )


def remarks(scores: Scores) -> list[str]:
    """The run's own notes, and further ones: clips without labels, clips on which a baseline is as good."""
    asked = without_oracles(scores.scored_configurations)
    rows = [row for row in scores.by_clip() if row.configuration in asked]
    found = list(scores.notes)
    for clip in scores.clips:
        of_clip = [row for row in rows if row.clip == clip]
        if not of_clip:
            if not any(note.startswith(f"{clip}: no labels") for note in found):
                found.append(f"{clip}: no frame is labelled, not scored; `vfoa annotate {clip}` labels it.")
            continue
        rate, name = max((max(row.baselines[name] for row in of_clip), name) for name in BASELINES)
        best = max(row.frr for row in of_clip)
        if rate >= best:
            found.append(
                f"{clip}: the baseline {_words(name).lower()!r} is right in {percent(rate)} % of the frames, the "
                f"best configuration in {percent(best)} %."
            )
    return found


def _table(
    title: str,
    columns: tuple[str, ...],
    rows: Iterable[ScoreRow],
    cells: Callable[[ScoreRow], Iterable[str]],
    notes: tuple[str, ...],
) -> Table:
    """A table of rates: every row begins with its clip and its configuration."""
    return Table(
        title=title,
        columns=("Clip", "Configuration", *columns),
        words=2,
        rows=tuple((*_names(row), *cells(row)) for row in rows),
        notes=notes,
    )


def _names(row: ScoreRow) -> tuple[str, str]:
    return row.clip or ALL, row.configuration


def _words(name: str) -> str:
    return name.replace("_", " ").capitalize()


def _range(interval: Interval) -> str:
    return UNKNOWN if math.isnan(interval.low) else f"{100 * interval.low:.0f}–{100 * interval.high:.0f}"
