"""``vfoa cache``: results of perception that are kept."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

app = typer.Typer(help="Results of perception that are kept.", no_args_is_help=True)

CACHE_HELP = "The cache; $VFOA_CACHE or the user's cache folder if not given."


@app.command()
def info(
    cache: Annotated[Path | None, typer.Option(help=CACHE_HELP)] = None,
    as_json: Annotated[bool, typer.Option("--json", help="For a program.")] = False,
) -> None:
    """Show where the cache is, its limit, and what each stage and clip takes."""
    from dataclasses import asdict

    from rich.console import Console
    from rich.table import Table

    from harness.cache.store import Store, cache_limit, cache_root

    store = Store(cache or cache_root(), cache_limit())
    usage = store.usage()
    total = sum(each.bytes for each in usage)
    if as_json:
        where = {"path": str(store.stages), "limit_bytes": store.limit_bytes, "bytes": total}
        typer.echo(json.dumps({**where, "stages": [asdict(each) for each in usage]}))
        return
    table = Table("Stage", "Clip", "Results", "MB")
    for each in usage:
        table.add_row(f"{each.slot} {each.name}", each.clip, str(each.files), f"{each.bytes / 1e6:.1f}")
    if usage:
        Console().print(table)
    typer.echo(f"{store.stages}: {total / 1e6:.1f} MB of at most {store.limit_bytes / 1e6:.0f} MB ($VFOA_CACHE_GB)")


@app.command()
def clear(cache: Annotated[Path | None, typer.Option(help=CACHE_HELP)] = None) -> None:
    """Remove every result; what is needed is computed again."""
    from harness.cache.store import Store, cache_limit, cache_root

    store = Store(cache or cache_root(), cache_limit())
    total = sum(each.bytes for each in store.usage())
    store.clear()
    typer.echo(f"{store.stages}: removed {total / 1e6:.1f} MB")
