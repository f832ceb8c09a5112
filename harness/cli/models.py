"""``vfoa models``: list, fetch, check and export models."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from harness.cli.options import ProviderName, Replace, experiment_and_clip_names, model_names
from harness.cli.run import experiment_of
from harness.cli.terminal import bytes_bar, print_table, say
from vfoa.errors import VfoaError

if TYPE_CHECKING:
    from harness.pipeline.weights import ModelCheck

_OF_MOBILEGAZE = (
    "gaze: ADAS-0002; with --accept-licence MobileGaze, more exact on faces that turn, and not for commercial use"
)

app = typer.Typer(help="List the models, fetch them, check that they work, export checkpoints.", no_args_is_help=True)


@app.command(name="list", short_help="List every model: licence, size, whether it is on this machine.")
def list_models() -> None:
    """List every model of the catalogue: its stage, licence, size, and whether it is on this machine."""
    from harness.pipeline.configuration import STAGES
    from harness.pipeline.weights import catalogue, ready_stages

    models = catalogue()
    print_table(
        ["model", "stage", "size", "here", "licence"],
        [
            [name, entry.stage, entry.size, "yes" if entry.find() else None, entry.licence]
            for name, entry in models.items()
        ],
        wrapped=("licence",),
    )
    ready = [(slot.name, stages) for slot in STAGES.values() for stages in [ready_stages(slot)]]
    rows = [(name, stage.name, stage.options) for name, stages in ready for stage in stages]
    rows += [(name, "", "") for name, stages in ready if not stages]
    print_table(["stage", "ready to run", "chosen by"], rows, wrapped=("chosen by",))


@app.command(name="fetch", short_help="Fetch models from their own sites.")
def fetch(
    names: Annotated[
        list[str] | None,
        typer.Argument(metavar="MODEL", help="Names of the catalogue.", autocompletion=model_names),
    ] = None,
    what: Annotated[
        str | None,
        typer.Option(
            "--for",
            metavar="EXPERIMENT | CLIP",
            help="Fetch what `vfoa run` needs for this experiment, or for this clip by default.",
            autocompletion=experiment_and_clip_names,
        ),
    ] = None,
    accept_licence: Annotated[
        bool, typer.Option("--accept-licence", help="Accept terms that allow no commercial use.")
    ] = False,
) -> None:
    """Fetch models from their own sites into the cache directory; an interrupted download resumes.

    For a clip's default run, --accept-licence fetches MobileGaze in place of ADAS-0002.
    Licences and sizes are printed first. Networks in OpenVINO's format, and 3DDFA_V2's checkpoint, are converted
    to ONNX. A model that cannot be fetched is named and does not stop the others; the exit code is 2 then.
    """
    from harness.pipeline.weights import fetch_model, find_model, models_of
    from harness.run.experiment import is_experiment
    from harness.run.plan import needed_stages

    if not names and what is None:
        raise VfoaError("models fetch: found no MODEL; expected names of `vfoa models list`, or --for CLIP")
    models = {name: find_model(name) for name in names or ()}
    if what is not None:
        is_default = not is_experiment(what)
        overrides = ("gaze.model=l2cs",) if is_default and accept_licence else ()
        models |= models_of(needed_stages(experiment_of([what], (), overrides, None)))
        if not models:
            say(f"{what}: a run of it needs no models")
        elif is_default and "adas-0002" in models:
            say(_OF_MOBILEGAZE)
    for name, entry in models.items():
        say(f"{name}: licence: {entry.licence}; {entry.size or 'size not known'}; {entry.home}")
    failed = False
    for name, entry in models.items():
        try:
            with bytes_bar(name) as progress:
                path = fetch_model(name, entry, accept_licence=accept_licence, progress=progress)
        except VfoaError as error:
            say(f"vfoa: {error}", err=True)
            failed = True
        else:
            say(f"{name}: {path}")
    if failed:
        raise typer.Exit(2)


@app.command(name="check", short_help="Load models, check their signatures, run each once.")
def check(
    names: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="MODEL",
            help="Names of the catalogue. Default: all that are on this machine.",
            autocompletion=model_names,
        ),
    ] = None,
    provider: ProviderName = "cpu",
) -> None:
    """Load models, check their signatures, run each once and print provider and ms; exit 2 if one fails."""
    from harness.pipeline.weights import catalogue, check_model, find_model
    from vfoa.onnx import RuntimeSettings

    settings = RuntimeSettings(provider=provider)
    chosen = {name: find_model(name) for name in names} if names else catalogue()
    wrong = ("fails", "absent") if names else ("fails",)
    failed = False
    for name, entry in chosen.items():
        model_check = check_model(name, entry, settings)
        say(_line(model_check))
        failed |= model_check.verdict in wrong
    if failed:
        raise typer.Exit(2)


@app.command(name="export", short_help="Export a PyTorch checkpoint to an ONNX file.")
def export(
    name: Annotated[Literal["gaze360"], typer.Argument(metavar="NAME", help="Network of the checkpoint.")],
    checkpoint: Annotated[
        Path, typer.Option(metavar="FILE", help="The PyTorch checkpoint, or its name in the folders of weights.")
    ],
    out: Annotated[Path, typer.Option(metavar="FILE", help="The ONNX file to write.")],
    replace: Replace = False,
) -> None:
    """Export a checkpoint to an ONNX file and compare its answers with PyTorch's; needs vfoa[export]."""
    from harness.files.io import check_new
    from harness.pipeline.export import export_gaze360
    from vfoa.weights import locate

    check_new(out, replace=replace, hint=", or another --out", inputs=[checkpoint])
    source = locate(str(checkpoint))
    check_new(out, replace=replace, hint=", or another --out", inputs=[source])
    difference_rad = export_gaze360(source, out)
    say(f"{name}: {out}: ONNX and PyTorch differ by {difference_rad:.1e} rad at most on 20 random inputs")


def _line(model: ModelCheck) -> str:
    if model.verdict != "ok":
        return f"{model.name}: {model.verdict}: {model.message}"
    checksum = "checksum correct" if model.checksum_known else "checksum unknown"
    run = "" if model.inference_ms is None else f"{model.provider}, {model.inference_ms:.1f} ms, "
    return f"{model.name}: ok: {run}{checksum}" + (f"; {model.message}" if model.message else "")
