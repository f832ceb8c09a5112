"""``vfoa fit``."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from harness.cli.options import Overrides, Replace, configuration_names, experiment_and_clip_names
from harness.cli.run import experiment_of
from harness.cli.terminal import exit_if_interrupted, frames_bar, print_reports, say
from harness.files.safe_names import vfoa_command
from vfoa.errors import VfoaError

if TYPE_CHECKING:
    from harness.run.directory import RunDirectory


def fit(
    what: Annotated[
        str,
        typer.Argument(
            metavar="EXPERIMENT | CLIP | RUN",
            help="An experiment with labelled clips, a labelled clip, or the directory of a run.",
            autocompletion=experiment_and_clip_names,
        ),
    ],
    out: Annotated[Path | None, typer.Option(metavar="FILE", help="File to write. Default: NAME-fitted.toml.")] = None,
    config: Annotated[
        str | None,
        typer.Option(
            "--config",
            metavar="CONFIGURATION",
            help="Configuration to fit. Default: the first with a logit, else the first.",
            autocompletion=configuration_names,
        ),
    ] = None,
    first: Annotated[
        str | None,
        typer.Option(
            metavar="SECONDS",
            help="Use only the first labelled seconds of each clip, such as 20s. A clip's fit is scored on the other "
            "clips, or on the rest of the only clip.",
        ),
    ] = None,
    even_if_worse: Annotated[
        bool, typer.Option("--even-if-worse", help="Write the file even if the default weights are better.")
    ] = False,
    tables: Annotated[Path | None, typer.Option(metavar="FILE.md", help="Also write the tables as Markdown.")] = None,
    overrides: Overrides = None,
    replace: Replace = False,
) -> None:
    """Fit attention to labelled clips: the weights of a conditional logit over the targets and nowhere.

    The fit is scored on clips, or parts of one clip, that were left out. Use it with `vfoa run CLIP --preset FILE`.
    """
    from harness.files.io import atomic_write, check_new
    from harness.report.fit import fit_tables
    from harness.report.formats import to_markdown
    from harness.run.executors import cores
    from harness.run.fitted import fitted_text
    from harness.run.runner import executor
    from harness.score.fit_logit import DEFAULT, FITTED, UnscoredError, fit_logit
    from harness.score.labelled_run import read_labelled

    first_s = _seconds(first)
    notices: list[str] = []
    name, inputs, directory = _source(what, tuple(overrides or ()), notices.append)
    path = out or Path(f"{name}-fitted.toml")
    for option, place in (("--out", path), ("--tables", tables)):
        if place is not None:
            check_new(place, replace=replace, hint=f", or another {option}", inputs=inputs)
    if path.suffix != ".toml":
        raise VfoaError(f"fit: --out: found {str(path)!r}; expected a name that ends in .toml, as that of a preset")
    with exit_if_interrupted(notices), executor(cores()) as workers:
        finished = directory()
        notices[:] = [f"interrupted: {finished.path} is finished and kept; the same command continues"]
        run = read_labelled(finished, config, executor=workers, bar=frames_bar)
    try:
        fitted = fit_logit(run, first_s=first_s)
    except UnscoredError as error:
        if not even_if_worse:
            raise VfoaError(f"{error} (--even-if-worse writes a file without a score)") from None
        fitted = fit_logit(run, first_s=first_s, scored=False)
    reports = fit_tables(fitted)
    print_reports(reports)
    if tables is not None:
        atomic_write(tables, "\n".join(map(to_markdown, reports)))
    own = fitted.fit.score_of(f"{FITTED}, forward")
    rival = f"{DEFAULT}, forward"
    least = fitted.fit.score_of(rival)
    if own and least and (own.log_loss or 0) > (least.log_loss or 0) and not even_if_worse:
        raise VfoaError(
            f"fit: {path}: not written: on what was left out its log loss is {own.log_loss}, and that of {rival} "
            f"{least.log_loss}; label more, or add --even-if-worse"
        )
    atomic_write(path, fitted_text(fitted))
    asked = run.experiment if _is_run(what) else what
    clips = [clip.name for clip in finished.read_manifest().clips]
    say(f"{path}: {_next_command(asked, clips, tuple(overrides or ()), path)}")


def _next_command(asked: str, clips: list[str], overrides: tuple[str, ...], path: Path) -> str:
    """The first command that runs here and takes the weights: on what was asked for, else on its clips.

    A method that was set, or the experiment of a run that is not here or chooses other methods, cannot stay.
    """
    from harness.run.experiment import has_weights
    from harness.run.fitted import read_fitted

    fitted = read_fitted(path)
    others = tuple(change for change in overrides if not change.startswith("attention."))
    for what, changes in (([asked], overrides), ([asked], others), (clips, overrides), (clips, others)):
        try:
            experiment = experiment_of(what, (), changes, str(path))
        except VfoaError:
            continue
        if not any(has_weights(configuration, fitted) for configuration in experiment.configurations):
            continue
        sets = (word for change in changes for word in ("--set", change))
        return vfoa_command("run", *what, *sets, "--preset", path)
    return 'preset of a configuration with attention.method = "logit"'


def _seconds(text: str | None) -> float | None:
    if text is None:
        return None
    try:
        seconds = float(text.removesuffix("s"))
    except ValueError:
        seconds = 0.0
    if not seconds > 0:
        raise VfoaError(f"fit: --first: found {text!r}; expected seconds, such as 20s")
    return seconds


def _is_run(what: str) -> bool:
    return (Path(what) / "manifest.json").is_file()


def _source(
    what: str, overrides: tuple[str, ...], tell: Callable[[str], None]
) -> tuple[str, list[Path], Callable[[], RunDirectory]]:
    """The experiment's name, the files that are read, and a function that returns the run, made if there is none.

    ``tell`` is called with a line about what is reused, or kept if it is interrupted.
    """
    from harness.files.folders import find
    from harness.pipeline.cache_store import open_store
    from harness.report.experiment_run import run_plainly
    from harness.run.directory import RunDirectory
    from harness.run.executors import cores
    from harness.run.plan import manifest_of

    if _is_run(what):
        if overrides:
            raise VfoaError(f"fit: found --set {overrides[0]} for a finished run; expected an experiment or a clip")
        run = RunDirectory(Path(what))
        return run.read_manifest().experiment, list(run.inputs), lambda: run
    experiment = experiment_of([what], (), overrides, None)
    files = [find("experiments", what) or Path(what)]
    files += [file for clip in experiment.clips for file in manifest_of(clip, experiment).files]
    folder, workers = Path("runs") / experiment.name, cores()
    make = partial(run_plainly, experiment, folder, cache=open_store(None), bar=frames_bar, tell=tell)
    return experiment.name, files, partial(make, workers=workers, threads=workers)
