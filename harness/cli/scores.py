"""``vfoa score``, ``report``, ``compare``, ``plan``: commands on the scores of finished runs."""

from __future__ import annotations

import gc
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar
from urllib.parse import urlencode

import typer

from harness.cli.options import (
    Json,
    NoOpen,
    Port,
    Replace,
    Run,
    Runs,
    Verbose,
    Where,
    conditions,
    run_directories,
    run_folder,
)
from harness.cli.terminal import (
    MOST_ROWS,
    first_rows,
    print_json,
    print_reports,
    print_scores,
    say,
    say_relabelled,
    say_unknown_names,
    verdict_of_run,
    verdicts_bar,
)
from vfoa.errors import VfoaError, counted

if TYPE_CHECKING:
    from harness.record.composed import Composed
    from harness.report.comparisons import PlannedPair
    from harness.run.directory import RunDirectory
    from harness.score.compared_runs import ComparedRuns
    from harness.score.comparison import Comparison


def score(
    run: Run,
    annotator: Annotated[
        str | None,
        typer.Option(
            metavar="ANNOTATOR",
            help="Score against CLIP@ANNOTATOR.csv; report, comparisons and figures of the run then use it, too. "
            "Default: the labels that the run names.",
        ),
    ] = None,
    where: Where = None,
    verbose: Verbose = False,
) -> None:
    """Score a run again from its results and the present labels; needs no images and no models.

    With --where, nothing is written: the table of these frames is printed.
    """
    from harness.report.tables import summary_table
    from harness.report.write import rescore
    from harness.run.directory import RunDirectory
    from harness.score.finished_run import read_scores

    folder = run_folder(run)
    if where:
        if annotator is not None:
            raise VfoaError("score: --where does not go with --annotator; expected one of them")
        scores = read_scores(RunDirectory(folder), conditions(where))
        print_reports([summary_table(scores)[0]])
        say("\n".join([f"Only frames with {' and '.join(where)}.", *verdict_of_run(scores, folder)]))
        return
    scores = rescore(RunDirectory(folder), annotator, bar=verdicts_bar)
    gc.freeze()  # the verdicts of all frames live to the end: without this, the collector visits them once more at exit
    print_scores(scores, folder, verbose=verbose)
    say_unknown_names(scores)


def report(
    run: Run,
    page: Annotated[
        Path | None, typer.Option("--page", metavar="HTML", help="Write the page there, and no other file.")
    ] = None,
    serve: Annotated[
        bool,
        typer.Option(
            "--serve", help="Serve the page on this machine: a click on a frame opens its recording; Ctrl-C ends it."
        ),
    ] = False,
    port: Port = 0,
    no_open: NoOpen = False,
    where: Where = None,
    replace: Replace = False,
) -> None:
    """Write a run's report page from its results and the present labels.

    With --where, the page of these frames: to the file of --page, or served.
    """
    from harness.files.io import atomic_write, check_new
    from harness.report.page.render import address_of
    from harness.report.write import refresh, report_page
    from harness.run.directory import RunDirectory

    directory = RunDirectory(run_folder(run))
    chosen = ",".join(where or ())
    if not serve and (port or no_open):
        raise VfoaError("report: --port and --no-open are for --serve: leave them out, or add it")
    if serve and page is not None:
        raise VfoaError("report: --serve does not go with --page; expected one of them")
    if chosen and not serve and page is None:
        raise VfoaError("report: --where needs --page HTML or --serve, since report.html is that of all frames")
    if serve:
        _serve_report(directory, chosen, port, no_open=no_open)
    elif page is not None:
        check_new(page, replace=replace, hint=", or another --page", inputs=directory.inputs)
        atomic_write(page, report_page(directory, None, chosen, f"{address_of(directory.path, page)}/"))
        say(f"Page: {page}")
    else:
        refresh(directory)
        say(f"Page: {directory.path / 'report.html'}")


def _serve_report(directory: RunDirectory, where: str, port: int, *, no_open: bool) -> None:
    """Serve a run's page, with its recordings and the form that sets labels right."""
    from harness.annotate.correction import correction_routes
    from harness.cli.serving import browse
    from harness.record.composed import by_name, served_recordings
    from harness.report.write import report_page

    served: dict[str, Composed] = {}

    def page(conditions: str) -> str:
        recordings = served_recordings(directory.path)  # a run that goes on has more of them each time
        served.update(by_name(recordings.values()))
        return report_page(directory, {pair: recording.name for pair, recording in recordings.items()}, conditions)

    page(where)  # so that an error in the run is reported here, and not in the browser
    if served:
        say_relabelled(directory.path)
    if not directory.read_manifest().finished:
        say("vfoa: the run is not finished; the page has what is complete: reload it for more", err=True)
    more = correction_routes(directory)
    browse(served, [_path(where)], page=page, more=more, port=port, no_open=no_open)


def _path(where: str) -> str:
    """The path of a served page whose frames meet these conditions."""
    return f"/?{urlencode({'where': where})}" if where else "/"


_KINDS = "significant-drop[=POINTS], drop=POINTS or possible-drop=POINTS"


def compare(
    runs: Runs,
    baseline: Annotated[
        str | None,
        typer.Option(
            metavar="RUN",
            help="Compare each configuration with this run's of the same name.",
            autocompletion=run_directories,
        ),
    ] = None,
    fail_on: Annotated[
        str | None,
        typer.Option(
            metavar="KIND",
            help="Exit with 1 on a drop against --baseline. significant-drop: one that is significant after "
            "correction (=POINTS: and larger than this). drop=POINTS: a larger one on these frames, whatever its "
            "chance. possible-drop=POINTS: a larger one that these clips cannot rule out (non-inferiority test at "
            "5 %). A check that cannot fail, or cannot pass, is refused.",
        ),
    ] = None,
    page: Annotated[
        Path | None,
        typer.Option("--page", metavar="HTML", help="Write a page: ranking, differences, frames that changed."),
    ] = None,
    serve: Annotated[
        bool,
        typer.Option(
            "--serve", help="Serve that page on this machine: a frame opens in its recordings; Ctrl-C ends it."
        ),
    ] = False,
    port: Port = 0,
    no_open: NoOpen = False,
    where: Where = None,
    replace: Replace = False,
    as_json: Json = False,
) -> None:
    """Rank the configurations of runs, and compare them on the same frames: difference, exact test, interval.

    With several runs, configurations of the same name are compared. Tests and intervals are corrected for the number
    of comparisons by Holm's method.
    """
    from harness.files.io import atomic_write, check_new
    from harness.report.compared_runs import compared_lines, ranking_table
    from harness.report.comparisons import terminal_comparisons
    from harness.report.page.compare import render_comparison, report_link
    from harness.run.directory import RunDirectory
    from harness.score.compared_runs import compare_runs

    if fail_on is not None and baseline is None:
        raise VfoaError("compare: --fail-on needs --baseline RUN, found none")
    check = None if fail_on is None else _parsed(fail_on)
    if page is not None and as_json:
        raise VfoaError("compare: --page does not go with --json")
    if serve and (page is not None or as_json or fail_on is not None):
        raise VfoaError("compare: --serve does not go with --page, --json and --fail-on: leave them out")
    if not serve and (port or no_open):
        raise VfoaError("compare: --port and --no-open are for --serve: leave them out, or add it")
    folders = [run_folder(run) for run in runs]
    against = None if baseline is None else run_folder(baseline)
    if page is not None:
        inputs = [file for run in [*folders, *([against] if against else [])] for file in RunDirectory(run).inputs]
        check_new(page, replace=replace, hint=", or another --page", inputs=inputs)
    if serve:
        _serve_comparison(folders, against, ",".join(where or ()), port, no_open=no_open)
        return
    compared = compare_runs(folders, against, conditions(where))
    failing = [] if check is None else _failing(compared.comparisons, *check)
    if as_json:
        print_json(_as_json(compared))
    else:
        say("\n".join(compared_lines(compared)))
        if ranked := compared.ranked():
            comparisons = terminal_comparisons(_best_first(compared.comparisons, [row.name for row in ranked]))
            all_of_them = "--json prints all, and --page FILE shows them"
            print_reports(
                [
                    first_rows(ranking_table(compared), f"configurations; {all_of_them}"),
                    first_rows(comparisons, f"pairs, the best configurations first; {all_of_them}"),
                ]
            )
        if page is not None:
            atomic_write(page, render_comparison(compared, report_link(page), where=" and ".join(where or ())))
            say(f"Page: {page}")
    for line in failing:
        say(f"vfoa: --fail-on {fail_on}: {line}", err=True)
    if failing:
        raise typer.Exit(1)


def _serve_comparison(runs: Sequence[Path], baseline: Path | None, where: str, port: int, *, no_open: bool) -> None:
    """Serve the page of runs side by side, and their recordings; other conditions make another page."""
    from dataclasses import replace

    from harness.cli.serving import browse
    from harness.record.composed import by_name, served_recordings
    from harness.record.web_app import open_path
    from harness.report.page.compare import render_comparison
    from harness.score.compared_runs import compare_runs
    from harness.score.subset import conditions_of
    from harness.score.verdicts import Verdict

    folders = [*([] if baseline is None else [baseline]), *runs]
    recordings = {
        (run, *pair): replace(recording, name=f"{number}__{recording.name}")
        for number, run in enumerate(folders, start=1)
        for pair, recording in served_recordings(run).items()
    }

    def link(run: Path, verdict: Verdict) -> str | None:
        recording = recordings.get((run, verdict.clip, verdict.configuration))
        return None if recording is None else open_path(recording.name, verdict.frame, verdict.subject)

    def page(conditions: str) -> str:
        compared = compare_runs(runs, baseline, conditions_of(conditions))
        return render_comparison(compared, link, is_served=True, where=conditions)

    page(where)  # so that an error in a run is reported here, and not in the browser
    browse(by_name(recordings.values()), [_path(where)], page=page, port=port, no_open=no_open)


def _as_json(compared: ComparedRuns) -> dict[str, Any]:
    """The ranking, the comparisons, and the frames that changed their verdict."""
    from dataclasses import asdict, replace

    from harness.score.verdicts import answer

    return {
        "configurations": [
            {
                "name": row.name,
                "run": str(row.run),
                "configuration": row.scores.configuration,
                **{key: getattr(row.scores, key) for key in ("frr", "n", "looks", "clips")},
                "interval": asdict(row.scores.interval),
            }
            for row in compared.ranked()
        ],
        "comparisons": [
            asdict(replace(comparison, units=None)) | {"verdict": comparison.verdict, "sentence": comparison.sentence}
            for comparison in compared.comparisons
        ],
        "changes": [
            {
                "reference": change.reference,
                "configuration": change.configuration,
                "clip": change.before.clip,
                "subject": change.before.subject,
                "frames": change.frames,
                "truth": change.before.truth,
                # what it counts as: "none" of no hit that is right, and another object of the true name
                "before": answer(change.before) or change.before.predicted,
                "after": answer(change.after) or change.after.predicted,
                "is_better": change.is_better,
            }
            for change in compared.changes()
        ],
    }


def _parsed(fail_on: str) -> tuple[str, float]:
    """The kind of a check and its points."""
    match = re.fullmatch(r"(significant-drop|drop(?==)|possible-drop(?==))(?:=(\d*\.?\d+))?", fail_on)
    points = float(match[2] or 0) if match else -1.0
    if not match or not 0 <= points <= 100 or (match[1] == "possible-drop" and points == 0):
        raise VfoaError(f"compare: --fail-on: found {fail_on!r}; expected {_KINDS}, in points of FRR up to 100")
    return match[1], points


def _failing(comparisons: Sequence[Comparison], kind: str, points: float) -> list[str]:
    """A line for each comparison on which a check fails.

    Raises
    ------
    VfoaError
        If no result could make the check fail, or none could make it pass.
    """
    from harness.score.comparison import format_p
    from harness.score.statistics import SIGNIFICANCE

    if kind == "significant-drop" and not any(comparison.can_be_significant for comparison in comparisons):
        least, number = min(comparison.smallest_p for comparison in comparisons), len(comparisons)
        raise VfoaError(
            f"compare: --fail-on significant-drop: cannot fail: with {comparisons[0].counted_units} and "
            f"{counted(number, 'comparison')} the smallest corrected p is {min(least * number, 1.0):.2g}; "
            f"expected below {SIGNIFICANCE:g}. Use --fail-on drop=POINTS, more clips, or fewer configurations"
        )
    lines = []
    for comparison in comparisons:
        line = f"{comparison.configuration}: {100 * comparison.difference:+.1f} points against {comparison.reference}"
        fails = comparison.difference < -points / 100 and (kind == "drop" or comparison.verdict == "worse")
        if kind == "possible-drop":
            if comparison.smallest_p / 2 >= SIGNIFICANCE:
                raise VfoaError(
                    f"compare: --fail-on possible-drop: cannot pass: {comparison.configuration} has "
                    f"{comparison.counted_units}; expected at least 5. Use --fail-on drop=POINTS, or more clips"
                )
            p = comparison.inferiority_p(points / 100)
            fails = p >= SIGNIFICANCE
            line += f"; a drop of {points:g} is not ruled out (one-sided {format_p(p)})"
        lines += [line] if fails else []
    return lines


def plan(
    run: Run,
    points: Annotated[
        float, typer.Option(metavar="POINTS", min=0.1, max=100, help="Difference to detect, in points of FRR.")
    ] = 5.0,
) -> None:
    """Print how many clips and looks are needed to detect a difference, from the spread of this run."""
    from harness.report.comparisons import plan_pairs, plan_sentence, plan_table
    from harness.run.directory import RunDirectory
    from harness.score.finished_run import read_scores

    scores = read_scores(RunDirectory(run_folder(run)))
    planned = plan_pairs(scores, points / 100)
    say(plan_sentence(planned, points / 100))
    ranked = sorted(scores.rows.overall, key=lambda row: -row.frr)
    table = plan_table(_best_first(planned, [row.configuration for row in ranked]), points / 100)
    print_reports([first_rows(table, "pairs, the best configurations first")])


_Pair = TypeVar("_Pair", "Comparison", "PlannedPair")


def _best_first(pairs: Sequence[_Pair], ranked: Sequence[str]) -> Sequence[_Pair]:
    """Pairs of configurations; if not all are printed, pairs of the best configurations come first."""
    if len(pairs) <= MOST_ROWS:
        return pairs
    rank = {name: place for place, name in enumerate(ranked)}
    return sorted(pairs, key=lambda pair: sorted(rank[name] for name in pair.names))
