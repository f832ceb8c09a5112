"""Arguments and options that several commands share."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from harness.cli.completion import clip_names, configuration_names, run_directories, setting_assignments


def run_folder(run: str) -> Path:
    """The folder of a run. Raises a :class:`vfoa.errors.VfoaError` if it is given as an address."""
    from harness.remote import local_folder

    return local_folder(run, "RUN")


Run = Annotated[
    str,
    typer.Argument(
        metavar="RUN",
        help="Directory of a run, such as runs/demo.",
        autocompletion=run_directories,
    ),
]
Recordings = Annotated[
    str,
    typer.Argument(
        metavar="RUN",
        help="Directory of a run, or one .rrd file.",
        autocompletion=run_directories,
    ),
]
Clip = Annotated[
    str, typer.Argument(metavar="CLIP", help="Clip by name, or its .toml file.", autocompletion=clip_names)
]
OneClip = Annotated[
    str | None,
    typer.Option("--clip", metavar="CLIP", help="Only recordings of this clip.", autocompletion=clip_names),
]
OneConfiguration = Annotated[
    str | None,
    typer.Option(
        "--config",
        metavar="CONFIGURATION",
        help="Only recordings under this configuration.",
        autocompletion=configuration_names,
    ),
]
RunConfiguration = Annotated[
    str | None,
    typer.Option(
        "--config",
        metavar="CONFIGURATION",
        help="Configuration of the run, if it has several.",
        autocompletion=configuration_names,
    ),
]
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
Workers = Annotated[int, typer.Option(min=0, help="Number of processes, one thread each; 0: one per core.")]
Cache = Annotated[
    str | None,
    typer.Option(
        metavar="DIRECTORY",
        help="Directory of the stage cache. Default: $VFOA_CACHE, or the user's cache directory.",
    ),
]
Port = Annotated[int, typer.Option(min=0, max=65535, help="Port to serve on; 0: any free port.")]
NoOpen = Annotated[bool, typer.Option("--no-open", help="Print the address; do not open a browser.")]
Replace = Annotated[bool, typer.Option("--replace", help="Overwrite an existing file.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Print the tables by clip and of the stages, too.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]


class ProviderName(StrEnum):
    """Providers of ONNX Runtime that a network can run on."""

    cpu = "cpu"
    cuda = "cuda"
    tensorrt = "tensorrt"
    openvino = "openvino"
    coreml = "coreml"
