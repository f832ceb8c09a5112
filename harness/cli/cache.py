"""``vfoa cache``: the stage cache."""

from __future__ import annotations

import typer

from harness.cli.options import Cache, Json
from harness.cli.terminal import print_json, print_table, say

app = typer.Typer(help="Show and clear the stage cache.", no_args_is_help=True)


@app.command(short_help="Show where the cache is and what it holds.")
def info(
    cache: Cache = None,
    as_json: Json = False,
) -> None:
    """Show where the cache is, its limit, and the size of each stage and clip."""
    from dataclasses import asdict

    from harness.stages.cache.store import open_store

    store = open_store(cache)
    usage = store.usage()
    total = sum(each.bytes for each in usage)
    if as_json:
        where = {"path": str(store.stages), "limit_bytes": store.limit_bytes, "bytes": total}
        print_json({**where, "stages": [asdict(each) for each in usage]})
        return
    if usage:
        print_table(
            ["stage", "clip", "results", "MB"],
            [[f"{each.slot} {each.name}", each.clip, each.files, f"{each.bytes / 1e6:.1f}"] for each in usage],
        )
    say(f"{store.stages}: {total / 1e6:.1f} MB of at most {store.limit_bytes / 1e6:.0f} MB ($VFOA_CACHE_GB)")


@app.command()
def clear(cache: Cache = None) -> None:
    """Remove every cached result."""
    from harness.stages.cache.store import open_store

    store = open_store(cache)
    total = sum(each.bytes for each in store.usage())
    store.clear()
    say(f"{store.stages}: removed {total / 1e6:.1f} MB")
