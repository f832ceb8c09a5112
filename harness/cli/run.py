"""``vfoa run``."""

from __future__ import annotations

import os
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import Cache, Out, Workers

if TYPE_CHECKING:
    from harness.recording import Size
    from harness.runs.directory import RunDirectory
    from harness.runs.experiment import Experiment


class Recording(StrEnum):
    """How much a recording holds."""

    light = "light"
    full = "full"
    none = "none"

    @property
    def size(self) -> Size | None:
        """The size as the harness has it: None for no recording."""
        sizes: dict[Recording, Size] = {Recording.light: "light", Recording.full: "full"}
        return sizes.get(self)


def run(
    what: Annotated[
        list[str], typer.Argument(help="An experiment (name or .toml file), or clips.", metavar="EXPERIMENT | CLIP")
    ],
    overrides: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="Change a setting in every configuration.")
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(
            metavar="NAME", help="A bundle of settings over the defaults of every configuration, such as realtime."
        ),
    ] = None,
    clips: Annotated[
        list[str] | None, typer.Option("--clip", metavar="CLIP", help="Run this clip instead of the experiment's own.")
    ] = None,
    out: Out = None,
    workers: Workers = 0,
    threads: Annotated[
        int, typer.Option(min=0, help="Threads of a single process (--workers 1): read ahead; 0 means one a core.")
    ] = 0,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Work on the cluster of this Dask scheduler, tcp://HOST:PORT, instead."),
    ] = None,
    limit: Annotated[int | None, typer.Option(min=1, help="Run only the first frames of each clip.")] = None,
    recording: Annotated[Recording, typer.Option(help="Size of the Rerun recordings.")] = Recording.light,
    oracle: Annotated[
        bool, typer.Option("--oracle", help="Also replace one stage after another by truth: what does each cost?")
    ] = False,
    save_signals: Annotated[
        bool, typer.Option("--save-signals", help="Also save what every stage found, to run from without models.")
    ] = False,
    cache: Cache = None,
    no_cache: Annotated[
        bool, typer.Option("--no-cache", help="Compute everything, and keep nothing for later.")
    ] = False,
    annotator: Annotated[
        str | None, typer.Option(metavar="ANNOTATOR", help="Score against CLIP@ANNOTATOR.csv, not CLIP.csv.")
    ] = None,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Try again what failed the last time; all else is taken over.")
    ] = False,
) -> None:
    """Run clips under configurations; write recordings, results and tables, and print the FRR table."""
    from harness.cache.store import Store, cache_limit, cache_root
    from harness.cli.progress import frames_bar
    from harness.cli.scores import print_scores
    from harness.report.rescore import rescore
    from harness.runs.conduct import conduct, prepare

    experiment = _experiment(what, tuple(clips or ()), tuple(overrides or ()), preset)
    if annotator:
        experiment = replace(experiment, annotator=annotator)
    store = None if no_cache else Store(cache or cache_root(), cache_limit())
    wanted, workers = out or Path("runs") / experiment.name, workers or os.cpu_count() or 1
    if experiment.sweep:
        from harness.cli.sweep import run_sweep

        run_sweep(
            experiment,
            out=wanted,
            workers=workers,
            limit=limit,
            oracle=oracle,
            save_signals=save_signals,
            cache=store,
        )
        return
    if oracle:
        from harness.scores.ladder import with_ladder

        experiment = with_ladder(experiment)
    plan = prepare(experiment, limit=limit, recording=recording.size, save_signals=save_signals)
    notices: list[str] = []
    with frames_bar(plan.frames, experiment.name) as progress:
        directory = conduct(
            plan,
            wanted,
            workers=workers,
            threads=threads or os.cpu_count() or 1,
            scheduler=scheduler,
            progress=progress,
            cache=store,
            tell=notices.append,
            beside=out is None,
            retry_failed=retry_failed,
        )
    scores = rescore(directory)
    print_scores(scores)
    for notice in notices:
        typer.echo(notice)
    if save_signals:
        typer.echo(f"\nSignals: {directory.signals}  (run from them: its {experiment.name}.toml says how)")
    typer.echo(
        f"\nPage: {directory.path / 'report.html'}"
        f"\nTables: {directory.path / 'frr.md'} (all of them), frr.csv, frr.tex, compared.md (paired tests)"
        f"\n{'Scrub a failure' if scores.rows else 'Scrub'}: vfoa view {directory.path}"
        f"{' --failures' if scores.rows else ''}"
    )
    _report_failures(directory)


def _report_failures(directory: RunDirectory) -> None:
    """Say what could not be finished, and leave with exit code 1 if there is anything."""
    failed = directory.read_manifest()["failed"]
    for each in failed:
        typer.echo(f"vfoa: {directory.told(each)}", err=True)
    if failed:
        typer.echo(f"vfoa: {len(failed)} failed; again with --retry-failed, when it is mended", err=True)
        raise typer.Exit(1)


def _experiment(what: list[str], clips: tuple[str, ...], overrides: tuple[str, ...], preset: str | None) -> Experiment:
    """The experiment that is meant: one by name or file, or the default one on the clips that are named."""
    from harness.clips.locate import find
    from harness.runs.experiment import is_experiment, load_experiment
    from vfoa.errors import VfoaError

    if len(what) == 1 and is_experiment(what[0]):
        return load_experiment(what[0], clips=clips, overrides=overrides, preset=preset)
    if both := [name for name in what if is_experiment(name)]:
        raise VfoaError(
            f"run: expected one experiment, or clips; found {' '.join(what)} ({both[0]!r} is an experiment)"
        )
    for name in what:
        if not name.endswith(".toml") and find("datasets", name) is None:
            raise VfoaError(_said_of_unknown(name))
    default = load_experiment("default", clips=(*what, *clips), overrides=overrides, preset=preset)
    return replace(default, name=Path(what[0]).stem) if len(default.clips) == 1 else default


def _said_of_unknown(name: str) -> str:
    from difflib import get_close_matches

    from harness.clips.locate import names

    experiments, clips = names("experiments"), names("datasets")
    near = get_close_matches(name, [*experiments, *clips], n=1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    return (
        f"run: no experiment or clip {name!r}; {hint}expected one of: {', '.join(experiments)}, an experiment's .toml "
        "file, or clips (`vfoa clips list`)"
    )
