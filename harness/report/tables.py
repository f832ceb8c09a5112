"""The tables of a run: the FRR for the paper, every frame for the curious, and which configuration is better."""

from __future__ import annotations

import math
from collections.abc import Sequence

from harness.report.all_scores import ALL, scores_table
from harness.report.compared import compare_configurations, comparison_table, comparisons_csv
from harness.report.formats import LATEX_HEAD, UNKNOWN, Table, to_csv, to_latex, to_markdown
from harness.report.oracle import ladder_csv, ladder_table, terminal_ladder
from harness.report.published import published_table
from harness.report.reliability import reliability_table
from harness.report.stage_measures import stage_measures_table, terminal_measures, thing_measures_table
from harness.scores.baselines import RULES
from harness.scores.ladder import without_rungs
from harness.scores.reliability import Reliability
from harness.scores.score import CAUSES, ScoreRow, Scores
from harness.scores.statistics import LEVEL, REPLICATES, Interval

FRR_NOTES = (
    "FRR: correct / annotated (frame, subject) pairs that are not marked ignore; n counts these pairs. "
    "A pair without a prediction is wrong.",
    f"Intervals: {100 * LEVEL:.0f} %. Wilson's takes frames as independent. The bootstrap's, by percentiles of "
    f"{REPLICATES} resamples of moving blocks of one second (at most a fifth of a sequence) within each subject and "
    "clip, does not; it has no width where all frames agree.",
    "Coverage: share of pairs with a prediction. FRR given a prediction: correct / pairs with one.",
    f"{ALL}: the pairs of all clips together, so that longer clips weigh more.",
)

TERMINAL_NOTE = (
    "n: labelled (frame, subject) pairs. FRR: share of them with the right answer; no answer is wrong. "
    "Coverage: share with an answer."
)


def render_tables(scores: Scores, reliabilities: Sequence[Reliability] = ()) -> dict[str, str]:
    """Every table but ``frames.csv``, by file name; those of the ladder and of the truth only where there is one."""
    comparisons = compare_configurations(scores)
    compared = comparison_table(comparisons)
    sections = (paper_table, measures_table, baselines_table, causes_table, subjects_table)
    pages = [to_markdown(frr_table(scores)), *(to_markdown(make(scores), level=2) for make in sections)]
    ladder, measures = ladder_table(scores), stage_measures_table(scores)
    more = (published_table(scores), ladder, measures, reliability_table(reliabilities))
    pages += [to_markdown(table, level=2) for table in more if table.rows]
    programs = {"ladder.csv": ladder_csv(scores), "measures.csv": measures, "things.csv": thing_measures_table(scores)}
    return {
        "frr.csv": to_csv(scores_table(scores)),
        "frr.md": "\n".join(pages),
        "frr.tex": _latex_tables(scores),
        **{name: to_csv(table) for name, table in programs.items() if table.rows},
        "compared.csv": to_csv(comparisons_csv(comparisons)),
        "compared.md": to_markdown(compared),
    }


def _latex_tables(scores: Scores) -> str:
    """The tables that fit a page of paper."""
    papers = {
        "frr": terminal_table(scores),
        "paper": paper_table(scores),
        "ladder": terminal_ladder(scores),
        "measures": terminal_measures(scores),
    }
    return LATEX_HEAD + "\n".join(to_latex(table, label=f"tab:{name}") for name, table in papers.items() if table.rows)


def frr_table(scores: Scores) -> Table:
    """The main table: FRR of every configuration on every clip, with its intervals and coverage."""
    return Table(
        title="Focus recognition rate (FRR) by clip and configuration, 95 % intervals",
        columns=("Clip", "Configuration", "n", "FRR %", "Wilson", "Bootstrap", "Coverage %", "FRR given pred. %"),
        words=2,
        rows=tuple(
            (
                *_names(row),
                str(row.n),
                _percent(row.frr),
                _range(row.wilson),
                _range(row.bootstrap),
                _percent(row.coverage),
                _percent(row.frr_predicted),
            )
            for row in scores.by_clip()
        ),
        notes=(*_remarks(scores), *FRR_NOTES),
    )


def terminal_table(scores: Scores) -> Table:
    """What fits a terminal of 100 columns, without oracle rungs: the words that are needed, and the run's own notes."""
    table, shown = frr_table(scores), without_rungs(scores.configurations)
    return Table(
        title=table.title,
        columns=table.columns[:-1],
        rows=tuple(row[:-1] for row in table.rows if row[1] in shown),
        words=table.words,
        notes=(*([TERMINAL_NOTE] if scores.rows else []), *_remarks(scores)),
    )


def paper_table(scores: Scores) -> Table:
    """Configurations by correct and wrong frames, over all clips, as papers on the subject print it."""
    shown = without_rungs(scores.configurations)
    rows = [row for row in scores.by_clip() if row.configuration in shown]
    pooled = [row for row in rows if row.clip is None] or rows
    return Table(
        title="Correct and wrong frames by configuration",
        columns=("Configuration", "Correct", "Wrong", "FRR %"),
        words=1,
        rows=tuple(
            (row.configuration, str(row.correct), str(row.n - row.correct), _percent(row.frr)) for row in pooled
        ),
    )


def measures_table(scores: Scores) -> Table:
    """Agreement beyond the share of correct frames."""
    return Table(
        title="Agreement and events",
        columns=("Clip", "Configuration", "Macro F1", "Kappa", "Event recall", "Event precision", "Event F"),
        words=2,
        rows=tuple(
            (*_names(row), *map(_decimal, (row.macro_f1, row.kappa)), *map(_decimal, row.events.rates))
            for row in scores.by_clip()
        ),
        notes=(
            "Macro F1: mean over the labels that occur in the truth. Kappa: Cohen's, with no prediction as an answer "
            "of its own. Events: longest runs of one label; a true and a found one match if they have the same label "
            "and overlap, each used once.",
        ),
    )


def baselines_table(scores: Scores) -> Table:
    """What trivial rules score on the same frames."""
    return Table(
        title="Trivial rules on the same frames, FRR %",
        columns=("Clip", "Configuration", "Pipeline", *(rule.capitalize() for rule in RULES)),
        words=2,
        rows=tuple(
            (*_names(row), _percent(row.frr), *(_percent(row.baselines[rule]) for rule in RULES))
            for row in scores.by_clip()
        ),
        notes=(
            "Commonest: always the subject's commonest label in the clip. Nearest: the box nearest to the eyes. "
            "Largest: in the image. Central: the box nearest to the camera's axis. The last three choose among what "
            "the configuration segmented.",
        ),
    )


def causes_table(scores: Scores) -> Table:
    """Why frames are wrong; causes that never occur are left out."""
    rows = scores.by_clip()
    seen = [cause for cause in CAUSES if any(row.causes[cause] for row in rows)]
    return Table(
        title="Causes of wrong frames",
        columns=("Clip", "Configuration", "Wrong", *(cause.replace("_", " ") for cause in seen)),
        words=2,
        rows=tuple(
            (*_names(row), str(row.n - row.correct), *(str(row.causes[cause]) for cause in seen)) for row in rows
        ),
        notes=tuple(f"{cause.replace('_', ' ').capitalize()}: {CAUSES[cause]}." for cause in seen),
    )


def subjects_table(scores: Scores) -> Table:
    """FRR of every subject."""
    return Table(
        title="FRR by subject, 95 % intervals",
        columns=("Clip", "Subject", "Configuration", "n", "FRR %", "Wilson", "Bootstrap", "Coverage %"),
        words=3,
        rows=tuple(
            (
                str(row.clip),
                str(row.subject),
                row.configuration,
                str(row.n),
                _percent(row.frr),
                _range(row.wilson),
                _range(row.bootstrap),
                _percent(row.coverage),
            )
            for row in scores.by_subject()
        ),
    )


def _remarks(scores: Scores) -> list[str]:
    """The run's own notes, and what its numbers ask for: clips without labels, clips that a trivial rule solves."""
    rows = scores.by_clip()
    remarks = list(scores.notes)
    for clip in scores.clips:
        of_clip = [row for row in rows if row.clip == clip]
        if not of_clip:
            if not any(note.startswith(f"{clip}: no labels") for note in remarks):
                remarks.append(f"{clip}: no frame is labelled, not scored; `vfoa annotate {clip}` labels it.")
            continue
        rate, rule = max((max(row.baselines[rule] for row in of_clip), rule) for rule in RULES)
        best = max(row.frr for row in of_clip)
        if rate >= best:
            remarks.append(
                f"{clip}: the trivial rule {rule!r} is right in {_percent(rate)} % of the frames, the best "
                f"configuration in {_percent(best)} %."
            )
    return remarks


def _names(row: ScoreRow) -> tuple[str, str]:
    return row.clip or ALL, row.configuration


def _percent(share: float) -> str:
    return UNKNOWN if math.isnan(share) else f"{100 * share:.1f}"


def _range(interval: Interval) -> str:
    return UNKNOWN if math.isnan(interval.low) else f"{100 * interval.low:.0f}–{100 * interval.high:.0f}"


def _decimal(value: float) -> str:
    return UNKNOWN if math.isnan(value) else f"{value + 0.0:.2f}"
