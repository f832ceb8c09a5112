"""What several verbs take or say in the same words."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

Run = Annotated[Path, typer.Argument(metavar="RUN", help="A run's directory.")]
Recordings = Annotated[Path, typer.Argument(metavar="RUN", help="A run's directory, or one .rrd file.")]
Clip = Annotated[str, typer.Argument(metavar="CLIP", help="The clip's name, or its .toml file.")]
OneClip = Annotated[str | None, typer.Option("--clip", metavar="CLIP", help="Only recordings of this clip.")]
OneConfiguration = Annotated[
    str | None, typer.Option("--config", metavar="CONFIGURATION", help="Only recordings under this configuration.")
]
RunConfiguration = Annotated[
    str | None, typer.Option("--config", metavar="CONFIGURATION", help="The run's configuration, where it has several.")
]
Out = Annotated[
    Path | None,
    typer.Option(
        help="The run's directory; if not given, runs/<experiment>, or beside it where that holds another run."
    ),
]
Workers = Annotated[int, typer.Option(min=0, help="Processes, one thread each; 0 means one a core.")]
Cache = Annotated[
    Path | None,
    typer.Option(help="Where results of perception are kept; $VFOA_CACHE or the user's cache folder if not given."),
]
Port = Annotated[int, typer.Option(min=0, max=65535, help="Port to serve on; 0 means any that is free.")]
NoOpen = Annotated[bool, typer.Option("--no-open", help="Print the address alone; open no browser.")]
Replace = Annotated[bool, typer.Option("--replace", help="Write over labels that are there.")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead.")]
