"""Serve recordings, and optionally a page that links to them, until Ctrl-C."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING

from harness.cli.terminal import say

if TYPE_CHECKING:
    from harness.record.composed import Composed
    from harness.record.web_app import Routes


def browse(
    recordings: Iterable[Composed],
    paths: Sequence[str],
    *,
    page: Callable[[], str] | None = None,
    more: Routes = (),
    port: int = 0,
    no_open: bool = False,
) -> None:
    """Serve recordings by their names, and ``more``; print the addresses of ``paths``, and open the first one."""
    from harness.record.web_app import site
    from harness.record.web_viewer import web_viewer_files
    from harness.server.local_server import LocalServer, ended_by_sigterm, open_browser

    with ended_by_sigterm():
        app = site({each.name: each for each in recordings}, web_viewer_files(), page=page, more=more)
        server = LocalServer(app, port)
        addresses = [server.address_of(path) for path in paths]
        say("\n".join(["Serving until Ctrl-C:", *addresses]))
        if not no_open:
            open_browser(addresses[0])
        server.run()
