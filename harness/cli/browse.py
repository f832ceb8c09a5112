"""Recordings, and perhaps a page that leads to them, served until Ctrl-C."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import typer


def browse(
    recordings: Iterable[Path],
    paths: Sequence[str],
    *,
    page: Callable[[], str] | None = None,
    port: int = 0,
    no_open: bool = False,
) -> None:
    """Serve recordings by the names of their files; print the addresses of ``paths``, and open the first of them."""
    from harness.local_server import ended_by_sigterm, listen, open_browser, serve
    from harness.recording.catalogue import Catalogue
    from harness.recording.site import site
    from harness.recording.web_viewer import web_viewer_files

    with ended_by_sigterm(), listen(port) as listener, Catalogue() as catalogue:
        app = site({path.stem: path for path in recordings}, catalogue, web_viewer_files(), page=page)
        host, bound = listener.getsockname()
        addresses = [f"http://{host}:{bound}{path}" for path in paths]
        typer.echo("\n".join(["Serving until Ctrl-C:", *addresses]))
        if not no_open:
            open_browser(addresses[0])
        serve(app, listener)
