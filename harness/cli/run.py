"""``vfoa run`` and ``vfoa demo``."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from harness.cli.options import (
    Cache,
    Limit,
    Out,
    Overrides,
    Verbose,
    Workers,
    clip_names,
    experiment_and_clip_names,
    preset_names,
)
from harness.cli.terminal import exit_if_interrupted, frames_bar, print_reports, print_scores, say, verdicts_bar
from harness.files.safe_names import vfoa_command
from vfoa.errors import VfoaError, did_you_mean

if TYPE_CHECKING:
    from harness.run.directory import RunDirectory
    from harness.run.experiment import Experiment
    from harness.run.plan import Plan


def run(
    context: typer.Context,
    what: Annotated[
        list[str] | None,
        typer.Argument(
            help="An experiment (name or .toml file), clips, benchmark or paper_cases. "
            "Default: the one in ./experiments.",
            metavar="EXPERIMENT | CLIP",
            autocompletion=experiment_and_clip_names,
        ),
    ] = None,
    overrides: Overrides = None,
    preset: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="A bundle of settings over the defaults of every configuration, such as realtime.",
            autocompletion=preset_names,
        ),
    ] = None,
    clips: Annotated[
        list[str] | None,
        typer.Option(
            "--clip",
            metavar="CLIP",
            help="Run this clip, not the experiment's own (several times for more).",
            autocompletion=clip_names,
        ),
    ] = None,
    out: Out = None,
    workers: Workers = 0,
    threads: Annotated[
        int,
        typer.Option(
            metavar="N", min=0, help="Threads of a single process (--workers 1): read ahead; 0: one per core."
        ),
    ] = 0,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Run on the cluster of this Dask scheduler, tcp://HOST:PORT, instead."),
    ] = None,
    limit: Limit = None,
    recording: Annotated[
        Literal["light", "jpeg", "none"] | None,
        typer.Option(
            help="Rerun recordings: with AV1 video (light), with JPEG pictures for viewers that do not decode AV1 "
            "(jpeg: larger), or none. Default: the experiment's, else light."
        ),
    ] = None,
    oracle: Annotated[
        bool, typer.Option("--oracle", help="Oracle ablation: replace one stage after another by ground truth.")
    ] = False,
    cache: Cache = None,
    no_cache: Annotated[bool, typer.Option("--no-cache", help="Do not use the stage cache.")] = False,
    annotator: Annotated[
        str | None, typer.Option(metavar="ANNOTATOR", help="Score against CLIP@ANNOTATOR.csv, not CLIP.csv.")
    ] = None,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Repeat what failed in the last run; reuse finished results.")
    ] = False,
    verbose: Verbose = False,
) -> None:
    """Run clips under configurations; write recordings, results and tables, and print the FRR table.

    With benchmark, run every method on every material at hand, each into a folder of its own, and print one table;
    --set NAME.key=value changes a method's setting or adds one. With paper_cases, print the paper's simulated cases,
    without a clip; --out writes them as paper_cases.md.
    """
    from harness.pipeline.cache_store import open_store
    from harness.run.directory import out_folder
    from harness.run.executors import cores

    if what == ["benchmark"]:
        _refuse_options(context, "benchmark", _OF_BENCHMARK)
        _run_benchmark(
            out_folder(out or Path("runs") / "benchmark"),
            overrides or [],
            workers=workers or cores(),
            threads=threads or cores(),
            limit=limit,
            recording=recording,
            cache=None if no_cache else open_store(cache),
        )
        return
    if what == ["paper_cases"]:
        _refuse_options(context, "paper_cases", ("out",))
        _run_paper_cases(out)
        return
    from harness.report.experiment_run import run_whole
    from harness.report.write import rescore

    experiment = _experiment(what, tuple(clips or ()), tuple(overrides or ()), preset, annotator, oracle=oracle)
    notices: list[str] = []
    with exit_if_interrupted(notices):
        plan, directory = run_whole(
            experiment,
            out_folder(out or Path("runs") / experiment.name),
            workers=workers or cores(),
            threads=threads or cores(),
            scheduler=scheduler,
            limit=limit,
            recording=recording,
            bar=frames_bar,
            cache=None if no_cache else open_store(cache),
            tell=notices.append,
            next_free=out is None,
            retry_failed=retry_failed,
        )
    scores = rescore(directory, bar=verdicts_bar)
    for notice in (*experiment.missing, *notices):
        say(notice)
    if advice := _advice(plan, directory.path):
        say(advice)
    print_scores(scores, directory.path, verbose=verbose)
    _report_failures(directory)


_OF_BENCHMARK = ("overrides", "out", "workers", "threads", "limit", "recording", "cache", "no_cache", "verbose")
"""Parameters of ``vfoa run`` that the benchmark uses."""


def _refuse_options(context: typer.Context, what: str, used: Collection[str]) -> None:
    """Refuse every given option except those in ``used``."""
    options = {param.name: param.opts[0] for param in context.command.params if param.name not in (None, "what")}
    given = [
        option
        for name, option in options.items()
        if name not in used and (source := context.get_parameter_source(name)) and source.name == "COMMANDLINE"
    ]
    if given:
        expected = ", ".join(options[name] for name in used)
        raise VfoaError(f"run {what}: found {', '.join(given)}; expected no option but {expected}")


def _run_benchmark(out: Path, overrides: list[str], **options: Any) -> None:
    """Run the materials of the benchmark that are here, print the table and write it; exit with 1 if none is here."""
    from harness.report.benchmark import MATERIALS, changed_methods, material_experiment
    from harness.report.benchmark_tables import (
        benchmark_lines,
        benchmark_table,
        unlabelled_settings_table,
        write_benchmark,
    )
    from harness.report.experiment_run import run_whole
    from harness.report.write import rescore

    changes = changed_methods(overrides)
    scores, left_out = {}, []
    notices = deque[str](maxlen=1)
    with exit_if_interrupted(notices):
        for name, material in MATERIALS.items():
            try:
                experiment, missing = material_experiment(name, material, changes)
                _, directory = run_whole(
                    experiment, out / name, bar=frames_bar, tell=notices.append, next_free=False, **options
                )
                notices.append(f"interrupted: finished materials are kept in {out}; the same command continues")
                scores[name] = rescore(directory, bar=verdicts_bar)
                left_out += [f"{name}: {each}" for each in missing]
            except VfoaError as error:
                left_out.append(f"{name}: not run: {error}.")
    table = benchmark_table(scores, left_out)
    if not scores:
        print_reports([table])
        raise typer.Exit(1)
    tables = table, unlabelled_settings_table(scores)
    print_reports(tables)
    for line in benchmark_lines(scores, tables[1]):
        say(line)
    say(f"Page: {write_benchmark(out, scores, tables)} (table: benchmark.md, benchmark.csv)")


def _run_paper_cases(out: str | None) -> None:
    """Print the paper's simulated cases; with ``out``, write them as paper_cases.md there."""
    from harness.files.io import atomic_write
    from harness.report.formats import to_markdown
    from harness.report.paper_cases import paper_cases
    from harness.run.directory import out_folder

    table = paper_cases()
    if out is not None:
        atomic_write(out_folder(out) / "paper_cases.md", to_markdown(table))
    print_reports([table])


def _advice(plan: Plan, run: Path) -> str | None:
    """A line for a clip without labels: what calibration error to expect, and what a few labels would change."""
    expected = [configuration.attend.attention.expectation for configuration in plan.experiment.configurations]
    unlabelled = (each.manifest.name for each in plan.clips if each.labels is None or not each.labels.are_scored)
    clip = next(unlabelled, None)
    if clip is None or not any(expected):
        return None
    sentences = " ".join(dict.fromkeys(filter(None, expected)))
    return f"{clip} has no labels. {sentences} When it has some, `{vfoa_command('fit', run)}` fits to them."


_MOST_FAILURES = 10
"""Most clips under configurations that failed of which the terminal has the errors."""


def _report_failures(directory: RunDirectory) -> None:
    """Print what could not be finished, and exit with code 1 if there is anything."""
    failed = directory.read_manifest().failed
    for failure in failed[:_MOST_FAILURES]:
        say(f"vfoa: {directory.line_of(failure)}", err=True)
    if more := failed[_MOST_FAILURES:]:
        say(f"vfoa: and {len(more)} more: `failed` in {directory.manifest}", err=True)
    if failed:
        say(f"vfoa: {len(failed)} failed; run again with --retry-failed when the cause is fixed", err=True)
        raise typer.Exit(1)


def _experiment(
    what: list[str] | None,
    clips: tuple[str, ...],
    overrides: tuple[str, ...],
    preset: str | None,
    annotator: str | None,
    *,
    oracle: bool,
) -> Experiment:
    """The experiment of these arguments of ``vfoa run``; without a name, that of the working directory."""
    from harness.files.folders import OTHER_RUNS
    from harness.score.oracle_ablation import with_oracle_ablation

    experiment = experiment_of(what or [_only_experiment(clips)], clips, overrides, preset, more=OTHER_RUNS)
    if annotator:
        experiment = replace(experiment, annotator=annotator, given=experiment.given | {"annotator"})
    return with_oracle_ablation(experiment) if oracle else experiment


def experiment_of(
    what: list[str],
    clips: tuple[str, ...],
    overrides: tuple[str, ...],
    preset: str | None,
    *,
    more: tuple[str, ...] = (),
) -> Experiment:
    """The experiment: one by name or file, or the default one on the named clips; messages name ``more``, too."""
    from harness.clips.families import clip_files, families, is_pattern, unknown_name
    from harness.files.folders import find, is_run_of_program, names
    from harness.run.experiment import is_experiment, load_experiment

    if len(what) == 1 and is_experiment(what[0]):
        clip = find("datasets", what[0])
        if clip is not None and not clips and is_run_of_program(what[0]):
            raise VfoaError(
                f"{clip}: found the name of an experiment of vfoa; expected another name of this clip, or vfoa run "
                f"default --clip {what[0]}"
            )
        return load_experiment(what[0], clips=clips, overrides=overrides, preset=preset)
    if both := [name for name in what if is_experiment(name)]:
        raise VfoaError(f"expected one experiment, or clips; found {' '.join(what)} ({both[0]!r} is an experiment)")
    clips_known = {*clip_files(), *families()}
    for name in what:
        if not name.endswith(".toml") and name not in clips_known and not is_pattern(name):
            hint = did_you_mean(name, [*more, *names("experiments"), *clips_known])
            expected = f"{hint}, or a .toml file; vfoa clips add PATH makes a clip"
            raise unknown_name(name, "experiment or clip", expected)
    default = load_experiment("default", clips=(*what, *clips), overrides=overrides, preset=preset)
    return replace(default, name=Path(what[0]).stem) if len(default.clips) == 1 else default


def _only_experiment(clips: tuple[str, ...]) -> str:
    """The experiment of the working directory, if it has just one; else the error names something that can be run."""
    here, own = (sorted(Path(folder).glob("[!.]*.toml")) for folder in ("experiments", "datasets"))
    if len(here) != 1:
        present = ", ".join(path.stem for path in here) or "no experiment"
        command = vfoa_command("run", *(clips or [path.stem for path in (*here, *own)][:1] or ["demo"]))
        raise VfoaError(f"run: found {present} in ./experiments; expected an experiment or clips: {command}")
    return str(here[0])


def demo(
    context: typer.Context,
    out: Out = None,
    workers: Workers = 0,
    limit: Limit = None,
    verbose: Verbose = False,
) -> None:
    """Run the paper's table on rendered clips: {BM, SGBM} x {one cone, two, nearest object}. Downloads nothing."""
    run(context, ["demo"], out=out, workers=workers, limit=limit, verbose=verbose)
