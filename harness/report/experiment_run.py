"""Run an experiment as ``vfoa run`` and ``harness.run_experiment`` do: fit its weights, run its clips, record them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from harness.labels.labels import IGNORED
from harness.pipeline.cache_store import Store
from harness.report.sinks import composed_sinks
from harness.run.directory import Pair, RunDirectory
from harness.run.executors import Bar, Executor, no_bar
from harness.run.experiment import Experiment, RecordingKind
from harness.run.plan import Fit, Plan, PreparedClip
from harness.run.runner import prepare, run_plan
from vfoa.methods import MethodSettings


def run_whole(
    experiment: Experiment,
    out: Path,
    *,
    workers: int,
    cache: Store | None,
    next_free: bool,
    limit: int | None = None,
    recording: RecordingKind | None = None,
    bar: Bar = no_bar,
    threads: int = 1,
    scheduler: str | None = None,
    tell: Callable[[str], None] = lambda line: None,
    retry_failed: bool = False,
) -> tuple[Plan, RunDirectory]:
    """Run an experiment with thumbnails and recordings; return what was run, and the directory of the results.

    Weights that are ``"left-out"`` are fitted when all clips are perceived.

    Parameters
    ----------
    limit
        Run only the first frames of each clip.
    recording
        The kind of Rerun recordings to write; None: as the experiment says.

    The others are those of :func:`harness.run.runner.run_plan`, which also lists the errors.
    """
    kind = recording or experiment.recording
    sinks = composed_sinks(experiment.configurations, recorded=kind != "none", jpeg=kind == "jpeg")
    plan = prepare(experiment, limit=limit, sinks=sinks, fit=_LEFT_OUT)
    if plan.unfitted:
        from harness.score.fit_logit import check_left_out

        check_left_out(experiment.name, [each.manifest.name for each in plan.clips if _has_labels(each)])
    with bar(plan.frames, experiment.name) as progress:
        directory = run_plan(
            plan,
            out,
            workers=workers,
            threads=threads,
            scheduler=scheduler,
            progress=progress,
            cache=cache,
            tell=tell,
            next_free=next_free,
            retry_failed=retry_failed,
        )
    return plan, directory


def _has_labels(clip: PreparedClip) -> bool:
    """Whether a frame that is run has a label that counts."""
    return clip.labels is not None and any(label.target != IGNORED for _, _, label in clip.labels.labelled(clip.frames))


def _fitted(plan: Plan, tables: Mapping[Pair, Mapping[str, Path]], executor: Executor) -> Mapping[str, MethodSettings]:
    from harness.score.fit_logit import left_out_weights

    labels = {each.manifest.name: each.labels for each in plan.clips if each.labels is not None and each.labels.ranges}
    return left_out_weights(plan.experiment, tables, labels, executor)


_LEFT_OUT = Fit(_fitted, ("harness.score.fit_logit",))


def run_plainly(
    experiment: Experiment,
    out: Path,
    *,
    cache: Store | None,
    workers: int = 1,
    threads: int = 1,
    bar: Bar = no_bar,
    tell: Callable[[str], None] = lambda line: None,
) -> RunDirectory:
    """Run an experiment for a fit, without recordings, or reuse its results.

    The parameters are those of :func:`harness.run.runner.run_plan`.

    Raises
    ------
    VfoaError
        If nobody is labelled: before anything is perceived. Or as :func:`harness.run.runner.run_plan`.
    """
    from harness.score.labelled_run import check_labelled

    plan = prepare(experiment, fit=_LEFT_OUT)
    labels = {each.manifest.word: each.labels for each in plan.clips}
    check_labelled(experiment.name, labels, [each.plain() for each in plan.experiment.configurations])
    with bar(plan.frames, experiment.name) as progress:
        return run_plan(
            plan, out, workers=workers, threads=threads, progress=progress, cache=cache, tell=tell, next_free=True
        )
