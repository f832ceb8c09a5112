"""The tables of a run: rates by clip, person and seed, errors, baselines, and the calibration of probabilities."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial

from harness.files.groups import grouped
from harness.report.formats import UNKNOWN, Table, interval_range, number, percent, percent_range
from harness.report.verdict import compared_rows, next_steps
from harness.run.notes import WARNINGS, Note, NoteKind, unlabelled
from harness.score.baselines import BASELINES
from harness.score.calibration import (
    MOST_SHARE,
    MOST_SURPRISES,
    MOST_TIMES_CLAIMED,
    SMALL_TAIL,
    DirectionCheck,
    Reliability,
    SetCoverage,
    calibration_errors,
)
from harness.score.finished_run import how_to_label
from harness.score.intervals import LEAST_CLIPS
from harness.score.judged_subjects import JudgedSubject
from harness.score.metrics import load_metrics
from harness.score.oracle_ablation import without_oracles
from harness.score.rows import ScoreRow
from harness.score.score import Scores
from harness.score.verdicts import ERROR_TYPES, SET_LEVEL
from vfoa.errors import listed
from vfoa.scoring import ALL, BINS, LEAST_PROBABILITY

FRR_NOTES = (
    "FRR: correct / annotated (frame, subject) pairs that are not marked ignore; n counts these pairs. A pair "
    "without a prediction is wrong, unless no ray hit anything and its label is none.",
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

_TERMINAL_NOTES = {
    "FRR %": "FRR: right ones of n labelled (frame, subject) pairs",
    "Balanced %": "Balanced: mean with and without a target",
    "Log loss": "Log loss: lower is better",
    "Baseline %": "Baseline: best simple rule",
    "No hit %": "No hit: no ray hit anything",
}
"""What the terminal says of the columns that need it."""


SHARES, LOSSES = ("balanced_frr", "recall_targets", "recall_nowhere"), ("log_loss", "brier")
"""The metrics of the main table, beside the FRR, which alone would reward the answer "nowhere"."""
MOST_SHOWN = 12
"""Most configurations that the terminal shows unasked."""
MOST_REMARKS = 12
"""Most clips that a sentence of their own says are no better than a baseline."""
_MOST_CLIPS = 4
"""Most clips that a sentence on many of them names."""
MOST_PRINTED_ROWS = 40
"""Most rows of a table that floats on a printed page: LaTeX cuts off what is beyond its end."""

_Cell = Callable[[ScoreRow], str]
_CELLS: Mapping[str, _Cell] = {
    "Clip": lambda row: row.clip or ALL,
    "Subject": lambda row: str(row.subject),
    "Configuration": lambda row: row.configuration,
    "n": lambda row: str(row.n),
    "Units": lambda row: str(row.looks),
    "Correct": lambda row: str(row.correct),
    "Wrong": lambda row: str(row.n - row.correct),
    "FRR %": lambda row: percent(row.frr),
    "FRR": lambda row: percent(row.frr),
    "95 %": lambda row: percent_range(row.interval),
    "Balanced %": lambda row: percent(row.metrics["balanced_frr"]),
    "Targets %": lambda row: percent(row.metrics["recall_targets"]),
    "Nowhere %": lambda row: percent(row.metrics["recall_nowhere"]),
    "Log loss": lambda row: number(row.metrics["log_loss"], 3),
    "Brier": lambda row: number(row.metrics["brier"], 3),
    "Baseline %": lambda row: percent(row.baselines[row.best_baseline]),
    "Best": lambda row: _words(row.best_baseline).lower(),
    "Beaten": lambda row: row.beats,
    "Coverage %": lambda row: percent(row.coverage),
    "No hit %": lambda row: percent(row.no_hit / row.n),
    "FRR given answer %": lambda row: percent(row.frr_predicted),
    "Wilson": lambda row: percent_range(row.wilson),
    "Seeds": lambda row: str(len(row.seed_rates)),
    "Mean FRR %": lambda row: percent(row.frr),
    "SD over seeds": lambda row: percent(statistics.stdev(row.seed_rates)),
    "Lowest %": lambda row: percent(min(row.seed_rates)),
    "Highest %": lambda row: percent(max(row.seed_rates)),
    "Blocked": lambda row: str(row.n - row.visible),
    "FRR % without blocked": lambda row: percent(row.frr_visible),
    "FRR % of blocked": lambda row: percent((row.correct - row.visible_correct) / (row.n - row.visible)),
}
"""The columns of the tables of rates, by heading."""


def _rates(
    title: str,
    columns: str,
    rows: Iterable[ScoreRow],
    notes: Sequence[str] = (),
    *,
    words: int = 2,
    more: Mapping[str, _Cell] | None = None,
) -> Table:
    """A table of rates; ``columns`` are keys of :data:`_CELLS`, separated by ``|``, or of ``more``."""
    known = {**_CELLS, **(more or {})}
    cells = [known[column.strip()] for column in columns.split("|")]
    return Table.of(title, columns, ([cell(row) for cell in cells] for row in rows), words=words, notes=notes)


def frr_table(scores: Scores) -> Table:
    """The main table: FRR of every configuration on every clip, with its interval, its best baseline and coverage."""
    return _rates(
        "Focus recognition rate (FRR) by clip and configuration",
        "Clip | Configuration | n | Units | FRR % | 95 % | Balanced % | Targets % | Nowhere % | Log loss | Brier | "
        "Baseline % | Beaten | Coverage % | No hit % | FRR given answer % | Wilson",
        scores.rows.by_clip,
        (*map(str, remarks(scores)), *FRR_NOTES),
    )


def summary_table(scores: Scores) -> tuple[Table, int | None]:
    """A row for each configuration over all clips, at most :data:`MOST_SHOWN`, and the place of the best one in it."""
    rows = compared_rows(scores)
    kept = sorted(sorted(range(len(rows)), key=lambda place: -rows[place].frr)[:MOST_SHOWN])
    shown = [rows[place] for place in kept]
    left_out = f" The best {MOST_SHOWN} of {len(rows)} configurations." if len(rows) > MOST_SHOWN else ""
    has_losses = any(not math.isnan(row.metrics["log_loss"]) for row in shown)
    warnings = [note.text for note in scores.notes if note.kind in WARNINGS]
    columns = "Log loss | Baseline % | Beaten" if has_losses else "Baseline % | Beaten | No hit %"  # all do not fit
    table = _rates(
        "FRR of each configuration over all clips",
        f"Configuration | n | FRR % | 95 % | Balanced % | {columns}",
        shown,
        words=1,
    )
    notes = (_terminal_note(table) + left_out, *warnings) if rows else ()
    table = replace(table, notes=notes)
    return table, shown.index(max(shown, key=lambda row: row.frr)) if shown else None


def terminal_table(scores: Scores) -> Table:
    """The columns that fit a terminal of 100 characters, without the oracle ablation; short notes, and what is next."""
    table = _short_table(scores)
    return replace(table, notes=(*table.notes, *_steps(scores)))


def _short_table(scores: Scores) -> Table:
    compared, rows = without_oracles(scores.scored_configurations), scores.rows.by_clip
    losses = "" if all(math.isnan(row.metrics["log_loss"]) for row in rows) else " | Log loss"
    table = _rates(
        "Focus recognition rate (FRR) by clip and configuration",
        f"Clip | Configuration | n | FRR % | 95 % | Balanced %{losses} | Baseline % | Beaten | No hit %",
        [row for row in rows if row.configuration in compared],
    )
    columns = [_terminal_note(table)] if scores.rows else []
    return replace(table, notes=(*columns, *map(str, remarks(scores))))


def printed_table(scores: Scores) -> Table:
    """The same for a page of paper: without what is next, and the rows by clip if there are more than fit one."""
    table = _short_table(scores)
    if len(table.rows) <= MOST_PRINTED_ROWS:
        return table
    over_all = tuple(row for row in table.rows if row[0] == ALL)
    return replace(
        replace(table, rows=over_all).only(table.columns[1:]), title="FRR of each configuration over all clips", words=1
    )


def _terminal_note(table: Table) -> str:
    return "; ".join(note for column, note in _TERMINAL_NOTES.items() if column in table.columns) + "."


def _steps(scores: Scores) -> list[str]:
    return next_steps(scores, without_oracles(scores.configurations))


def paper_table(scores: Scores) -> Table:
    """Numbers of correct and wrong frames by configuration, over all clips, as papers on the subject print them."""
    columns = "Configuration | Correct | Wrong | FRR %"
    return _rates("Correct and wrong frames by configuration", columns, compared_rows(scores), words=1)


def measures_table(scores: Scores) -> Table:
    """Agreement beyond the share of correct frames: the metrics that the main table lacks, then events."""
    metrics = {name: metric for name, metric in load_metrics().items() if name not in (*SHARES, *LOSSES)}
    titles = (*(metric.title for metric in metrics.values()), "Event recall", "Event precision", "Event F")
    rows = (
        (row.clip or ALL, row.configuration, *(number(value + 0.0, 2) for value in values))  # no minus before a zero
        for row in scores.rows.by_clip
        for values in [(*(row.metrics[name] for name in metrics), *row.events.rates)]
    )
    note = (
        " ".join(metric.meaning for metric in metrics.values()) + " Events: longest runs of one label; a true and a "
        "found one match if they have the same label and overlap, each used once."
    )
    columns = ("Clip", "Configuration", *titles)
    return Table(title="Agreement and events", columns=columns, rows=tuple(rows), words=2, notes=(note,))


def baselines_table(scores: Scores) -> Table:
    """Rates of the baselines on the same frames."""
    cells: dict[str, _Cell] = {
        _words(name): partial(lambda name, row: percent(row.baselines[name]), name) for name in BASELINES
    }
    return _rates(
        "Baselines on the same frames, FRR %",
        " | ".join(["Clip | Configuration | FRR", *cells, "Best | Beaten"]),
        scores.rows.by_clip,
        (
            "Commonest: always the commonest label of the other clips (one clip: none). Nearest: the box nearest to "
            "the eyes. "
            "Largest: in the image. Central: the box nearest to the camera's axis. Nearest in angle: the box nearest "
            "in angle to the measured gaze, or nothing beyond a limit that is best on the other clips (one clip: no "
            "limit). Constant: always the subject's commonest label in the clip itself; it has seen the labels, so it "
            "is never the best one here. The others choose among what the configuration segmented. Beaten: see the "
            "first table.",
        ),
        more=cells,
    )


def phases_table(scores: Scores) -> Table:
    """Rates of each phase of the clips that have some, over all clips; no rows without phases."""
    rates = ("n", "FRR %", "95 %", "Balanced %", "Targets %", "Nowhere %", "Log loss")
    rows = []
    for phase, of_phase in scores.phases.items():
        errors = calibration_errors(of_phase.judged_subjects)
        rows += [
            (
                *(phase, row.configuration),
                *(_CELLS[name](row) for name in rates),
                number(errors.get(row.configuration), 3),
                *(_words(row.best_baseline).lower(), percent(row.baselines[row.best_baseline])),
                *(percent(row.baselines_balanced[row.best_baseline]), row.beats),
            )
            for row in of_phase.rows.overall
        ]
    return Table.of(
        "FRR by phase",
        f"Phase | Configuration | {' | '.join(rates)} | ECE | Baseline | Baseline % | Baseline balanced % | Beaten",
        rows,
        words=2,
        notes=(
            "Phases: parts of a recording in which people do something else, by [phases] of the clip's manifest. The "
            "baseline is fitted to the same phase of the other clips. ECE: see the calibration of the probabilities.",
        ),
    )


def seeds_table(scores: Scores) -> Table:
    """Variation of rates between the seeds of the simulated errors; no rows for a run with one seed."""
    return _rates(
        "Over seeds",
        "Clip | Configuration | Seeds | Mean FRR % | 95 % | SD over seeds | Lowest % | Highest %",
        [row for row in scores.rows.by_clip if row.seed_rates],
        (
            "Each configuration ran under several seeds of its simulated errors. Rates are means over them, and n "
            "counts all. 95 %: over seeds and clips (below 6 clips, looks); each clip has errors of its own under "
            "every seed. SD: what one seed more or less does, in points.",
        ),
    )


def nowhere_table(scores: Scores) -> Table:
    """Precision and recall of "looks at nothing"; no rows if no method can say it, or nobody looks at nothing."""
    return Table.of(
        "Looking at nothing",
        "Clip | Configuration | True | Said | Both | Precision % | Recall %",
        (
            (row.clip or ALL, row.configuration, *matches, percent(matches.precision), percent(matches.recall))
            for row in scores.rows.by_clip
            if (matches := row.nowhere) and (matches.true or matches.predicted)
        ),
        words=2,
        notes=("Of the configurations whose method can answer that a subject looks at nothing in the scene.",),
    )


def visible_table(scores: Scores) -> Table:
    """FRR with and without the frames in which something blocks the line of sight; no rows without such labels."""
    return _rates(
        "FRR with and without blocked lines of sight",
        "Clip | Configuration | n | Blocked | FRR % | FRR % without blocked | FRR % of blocked",
        [row for row in scores.rows.by_clip if row.visible < row.n],
        (
            "Blocked: the label's note says that something stands between the eyes and the target. The label says "
            "where the subject's gaze was aimed, which is then not what the subject sees.",
        ),
    )


def error_types_table(scores: Scores) -> Table:
    """Numbers of wrong frames by error type; error types that never occur are left out."""
    rows = scores.rows.by_clip
    seen = [error_type for error_type in ERROR_TYPES if any(row.error_types[error_type] for row in rows)]
    return Table.of(
        "Error types",
        " | ".join(["Clip | Configuration | Wrong", *(error_type.replace("_", " ") for error_type in seen)]),
        (
            (row.clip or ALL, row.configuration, row.n - row.correct, *(row.error_types[name] for name in seen))
            for row in rows
        ),
        words=2,
        notes=[*(f"{_words(error_type)}: {ERROR_TYPES[error_type]}." for error_type in seen), *_steps(scores)],
    )


def unlabelled_table(scores: Scores) -> Table:
    """What people look at in clips without labels: nothing is scored there, and it may be all that is asked."""
    labelled = {each.clip for each in scores.judged_subjects if len(each.truth)}
    return Table.of(
        "Answers in clips without labels",
        "Clip | Configuration | Subject | Looks at, % of the answers | n | Coverage %",
        (_answers_row(each) for each in scores.judged_subjects if each.clip not in labelled),
        words=4,
        notes=(
            "n: frames in which the person was found. Coverage: share of them with an answer. Only labels say whether "
            "answers are right.",
        ),
    )


def _answers_row(subject: JudgedSubject) -> tuple[str, ...]:
    judged = subject.judged
    counts = Counter(judged.words.counts(judged.answers()))
    most_first = sorted(counts.items(), key=lambda pair: (-pair[1], pair[0]))
    shares = ", ".join(f"{name} {percent(count / counts.total())}" for name, count in most_first)
    n = len(judged.frames)
    coverage = percent(counts.total() / n if n else None)
    return subject.clip, subject.configuration, subject.subject, shares or UNKNOWN, str(n), coverage


def subjects_table(scores: Scores) -> Table:
    """FRR of every subject."""
    columns = "Clip | Subject | Configuration | n | Units | FRR % | 95 % | Coverage % | No hit %"
    return _rates("FRR by subject", columns, scores.rows.by_subject, words=3)


def remarks(scores: Scores) -> list[Note]:
    """The run's own notes, and further ones: clips without labels, clips on which a baseline is as good."""
    asked = without_oracles(scores.scored_configurations)
    by_clip = grouped((row.clip, row) for row in scores.rows.by_clip if row.configuration in asked)
    noted = {note.clip for note in scores.notes if note.kind == NoteKind.UNLABELLED}
    notes, as_good = list(scores.notes), list[tuple[str, str, float, float]]()
    for clip in scores.clips:
        if of_clip := by_clip.get(clip):
            rate, name = max((max(row.baselines[name] for row in of_clip), name) for name in BASELINES)
            best = max(row.frr for row in of_clip)
            if rate >= best:
                as_good.append((clip, _words(name).lower(), rate, best))
        elif clip not in noted:
            how = how_to_label(clip, scores.settings.values())
            notes.append(unlabelled(clip, f"no frame is labelled, not scored; {how}."))
    return [*notes, *map(Note, _as_good_baselines(as_good))]


def _as_good_baselines(found: Sequence[tuple[str, str, float, float]]) -> list[str]:
    """A sentence for each clip, baseline, its rate and that of the best configuration; one sentence for many clips."""
    if len(found) <= MOST_REMARKS:
        return [
            f"{clip}: the baseline {name!r} is right in {percent(rate)} % of the frames, the best configuration in "
            f"{percent(best)} %."
            for clip, name, rate, best in found
        ]
    clips = grouped((name, clip) for clip, name, *_ in found)
    most_first = sorted(clips.items(), key=lambda item: -len(item[1]))
    counts = "; ".join(f"{name!r} in {len(having)} ({listed(having, _MOST_CLIPS)})" for name, having in most_first)
    return [f"In {len(found)} clips a baseline is right as often as the best configuration, or more often: {counts}."]


def _words(name: str) -> str:
    return name.replace("_", " ").capitalize()


def reliability_table(found: Sequence[Reliability]) -> Table:
    """One row for each configuration that gives probabilities, over all clips."""
    return Table.of(
        "Calibration of the probabilities",
        "Configuration | n | Right % | Mean confidence % | ECE | 95 % | ECE, adaptive | Brier",
        ((row.configuration, *_means(row), interval_range(row.interval, ".3f"), *_errors(row)) for row in found),
        words=1,
        notes=(
            f"Over the scored frames with a prediction. ECE: expected calibration error, {BINS} equal bins of the "
            f"probability of what was predicted; 95 %: clips resampled, from {LEAST_CLIPS} clips on. Adaptive: bins "
            "of as many frames each. Brier: squared distance of all probabilities from the truth, 0 to 2.",
        ),
    )


def subject_reliability_table(found: Sequence[tuple[str, str, Reliability]]) -> Table:
    """One row for each subject of a clip and configuration that gives probabilities."""
    return Table.of(
        "Calibration by subject",
        "Clip | Subject | Configuration | n | Right % | Mean confidence % | ECE | ECE, adaptive | Brier",
        ((*place, row.configuration, *_means(row), *_errors(row)) for *place, row in found),
        words=3,
    )


def _means(row: Reliability) -> tuple[object, ...]:
    return row.n, percent(row.share_right), percent(row.mean_confidence), number(row.calibration_error, 3)


def _errors(row: Reliability) -> tuple[str, str]:
    return number(row.adaptive_error, 3), number(row.brier, 3)


def prediction_set_table(coverages: Sequence[SetCoverage]) -> Table:
    """One row for each configuration that gives probabilities, over all clips."""
    return Table.of(
        f"Answers in sets of {100 * SET_LEVEL:.0f} % probability",
        "Configuration | n | Coverage % | Mean size",
        ((row.configuration, row.n, percent(row.covered / row.n), number(row.mean_size, 2)) for row in coverages),
        words=1,
        notes=(
            f"The fewest objects, nowhere among them, with {100 * SET_LEVEL:.0f} % of the probability together. "
            "Coverage: share of the scored frames in which the set holds the truth; size: how many it holds.",
        ),
    )


def direction_check_table(checks: Sequence[DirectionCheck]) -> Table:
    """One row for each clip and configuration with a posterior."""
    return Table.of(
        "Do the measured directions fit the posterior?",
        "Clip | Configuration | n | Surprising % | Claimed deg | Implied deg | Head share | Fit",
        (
            (
                *(check.clip, check.configuration, check.n, percent(check.surprises), number(check.claimed_deg, 1)),
                *(number(check.implied_deg, 1), number(check.share, 2), "yes" if check.fits else "no"),
            )
            for check in checks
        ),
        words=2,
        notes=(
            f"Surprising: frames whose directions fit worse than all but {100 * SMALL_TAIL:.0f} % of those that the "
            "posterior expected. Claimed: the median of the gaze error that its source states; implied: what the "
            f"directions imply, bias included. Head share: share of the way to the targets that heads turn, as the "
            f"directions imply; people turn them 0.35 to 0.75. No fit: above {100 * MOST_SURPRISES:.0f} % surprises, "
            f"errors that differ by more than {MOST_TIMES_CLAIMED:g} times, or a share above {MOST_SHARE:g}: targets "
            "do not explain the heads. A fit does not show that the probabilities are right: only labels do. Of "
            "configurations with the same posterior, the first is listed.",
        ),
    )
