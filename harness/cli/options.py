"""Arguments and options that several commands share, and their completion in a shell."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from harness.files.safe_names import composed
from vfoa.errors import VfoaError

if TYPE_CHECKING:
    from harness.run.manifest import RunManifest
    from harness.score.subset import Condition


def composed_name(name: str | None) -> str | None:
    """A name from the command line in the form that tables have (:func:`harness.files.safe_names.composed`)."""
    return name and composed(name)


def named_once(option: str, pairs: Iterable[tuple[str, str]]) -> dict[str, str]:
    """The values, by name, of an option that may be repeated; raises VfoaError if a name is given twice."""
    values: dict[str, str] = {}
    for name, value in pairs:
        if name in values:
            raise VfoaError(f"{option}: {name!r} is given twice; expected each name once")
        values[name] = value
    return values


def clip_names(incomplete: str) -> list[str]:
    """Clips by name."""
    from harness.clips.families import clip_files

    return _matching(clip_files(), incomplete)


def clip_and_family_names(incomplete: str) -> list[str]:
    """Clips and families of clips by name."""
    from harness.clips.families import clip_files
    from harness.files.folders import names

    return _matching([*names("datasets"), *clip_files()], incomplete)


def experiment_and_clip_names(incomplete: str) -> list[str]:
    """Experiments, clips and families of clips by name."""
    from harness.files.folders import OTHER_RUNS, names

    return [
        *_matching([*OTHER_RUNS, *names("experiments")], incomplete),
        *clip_and_family_names(incomplete),
    ]


def clip_names_and_run_directories(incomplete: str) -> list[str]:
    """Clips by name, and runs."""
    return [*clip_names(incomplete), *run_directories(incomplete)]


def model_names(incomplete: str) -> list[str]:
    """Models of the catalogue by name."""
    from harness.pipeline.weights import catalogue

    return _matching(catalogue(), incomplete)


def preset_names(incomplete: str) -> list[str]:
    """Presets by name."""
    from harness.run.experiment import PRESETS

    return _matching(PRESETS, incomplete)


def setting_assignments(incomplete: str) -> list[str]:
    """Dotted keys, each with its equals sign."""
    from harness.pipeline.settings_reference import setting_keys

    return _matching([f"{key}=" for key in setting_keys()], incomplete)


def stage_names(incomplete: str) -> list[str]:
    """Stages and steps that have settings, each also with its choices (``stereo.sgbm``)."""
    from harness.pipeline.configuration import TABLES
    from harness.pipeline.settings_reference import choice_names

    return _matching([*TABLES, *choice_names()], incomplete)


def run_directories(incomplete: str) -> list[str]:
    """Runs in ``runs/`` and in the path typed so far."""
    places = {Path("runs"), Path(os.path.dirname(incomplete) or ".")}
    directories = (manifest.parent.as_posix() for place in places for manifest in place.glob("*/manifest.json"))
    return _matching(directories, incomplete)


def configuration_names(context: typer.Context, incomplete: str) -> list[str]:
    """The configurations of the run that the command names, or of the experiment."""
    from harness.run.experiment import load_experiment

    if manifest := _named_manifest(context):
        return _matching(manifest.configurations, incomplete)
    try:
        configurations = load_experiment(_named(context)).configurations
    except (VfoaError, OSError):
        return []
    return _matching((configuration.name for configuration in configurations), incomplete)


def recorded_clip_names(context: typer.Context, incomplete: str) -> list[str]:
    """The clips of the run that the command names."""
    manifest = _named_manifest(context)
    return _matching((clip.name for clip in manifest.clips), incomplete) if manifest else []


def bench_sections(incomplete: str) -> list[str]:
    """Sections of `vfoa bench`."""
    from harness.bench import SECTIONS

    return _matching(SECTIONS, incomplete)


def annotation_formats(incomplete: str) -> list[str]:
    """Formats of annotations by name."""
    from harness.labels.formats import FORMATS

    return _matching(FORMATS.names(), incomplete)


def written_formats(incomplete: str) -> list[str]:
    """Formats of annotations that can be written, by name."""
    from harness.labels.formats import FORMATS, SUFFIXES

    return [name for name in annotation_formats(incomplete) if name in SUFFIXES or name not in FORMATS.builtin]


def _named_manifest(context: typer.Context) -> RunManifest | None:
    """The manifest of the run that the command names; None if it names none."""
    from harness.run.directory import RunDirectory

    try:
        return RunDirectory(Path(_named(context))).read_manifest()
    except (VfoaError, OSError):
        return None


def _named(context: typer.Context) -> str:
    """The first argument of a command; the parser stops at an option without a value, and leaves those before it."""
    params = context.params
    return str(params.get("run") or params.get("what") or next(iter(context.args), ""))


def _matching(names: Iterable[str], incomplete: str) -> list[str]:
    return sorted({name for name in names if name.startswith(incomplete)})


def run_folder(run: str) -> Path:
    """The folder of a run. Raises a :class:`vfoa.errors.VfoaError` if it is given as an address."""
    from harness.files.remote import local_folder

    return local_folder(run, "RUN")


Run = Annotated[
    str, typer.Argument(metavar="RUN", help="Directory of a run, such as runs/demo.", autocompletion=run_directories)
]
Runs = Annotated[
    list[str],
    typer.Argument(metavar="RUN", help="Directories of finished runs.", autocompletion=run_directories),
]
Recordings = Annotated[
    str, typer.Argument(metavar="RUN", help="Directory of a run, or one .rrd file.", autocompletion=run_directories)
]
Clip = Annotated[
    str, typer.Argument(metavar="CLIP", help="Clip by name, or its .toml file.", autocompletion=clip_names)
]
OneClip = Annotated[
    str | None,
    typer.Option("--clip", metavar="CLIP", help="Only recordings of this clip.", autocompletion=recorded_clip_names),
]
_chosen = partial(typer.Option, "--config", metavar="CONFIGURATION", autocompletion=configuration_names)
OneConfiguration = Annotated[str | None, _chosen(help="Only recordings under this configuration.")]
RunConfiguration = Annotated[str | None, _chosen(help="Configuration of the run, if it has several.")]
Out = Annotated[
    str | None,
    typer.Option(
        metavar="DIRECTORY",
        help="Directory of the run. Default: runs/<experiment>, or the next free runs/<experiment>-N if that holds "
        "another run.",
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="Change a setting in every configuration (`vfoa settings` lists all).",
        autocompletion=setting_assignments,
    ),
]
Workers = Annotated[
    int, typer.Option(metavar="N", min=0, help="Number of processes, one thread each; 0: one per core.")
]
Limit = Annotated[int | None, typer.Option(metavar="N", min=1, help="Run only the first N frames of each clip.")]
Cache = Annotated[
    str | None,
    typer.Option(
        metavar="DIRECTORY", help="Directory of the stage cache. Default: $VFOA_CACHE, or the user's cache directory."
    ),
]
Port = Annotated[int, typer.Option(metavar="PORT", min=0, max=65535, help="Port to serve on; 0: any free port.")]
NoOpen = Annotated[bool, typer.Option("--no-open", help="Print the address; do not open a browser.")]
Replace = Annotated[bool, typer.Option("--replace", help="Overwrite an existing file.")]
Where = Annotated[
    list[str] | None,
    typer.Option(
        metavar="CONDITION",
        help="Only labelled frames that meet this, such as target=mug|book, subject!=ann, clip=talk, "
        "tag=occluded, note=shut (a word of the label's note), time>=2.5 (s, since the clip's first frame), frame<100, "
        "from_change>0.3 (s, to the nearest change of the label), distance<3 (m, camera to eyes) or target_distance<1 "
        "(m, eyes to target). Several: all of them.",
    ),
]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Print the tables by clip and of the stages, too.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]
ProviderName = Annotated[
    Literal["cpu", "cuda", "tensorrt", "openvino", "coreml"],
    typer.Option(help="Run the networks on this provider of ONNX Runtime."),
]
"""Providers of ONNX Runtime that a network can run on."""


def conditions(where: Sequence[str] | None) -> tuple[Condition, ...]:
    """The conditions of ``--where``. Raises a :class:`VfoaError` for one that is none."""
    from harness.score.subset import Condition

    return tuple(Condition.parse(text) for text in where or ())
