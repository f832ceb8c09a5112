"""Serve recordings in the browser, for the commands that show them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

from harness.cli.terminal import ended_by_signals, say, say_forwarding

if TYPE_CHECKING:
    from harness.record.composed import Composed
    from harness.record.web_app import Routes


def browse(
    recordings: Mapping[str, Composed],
    paths: Sequence[str],
    *,
    page: Callable[[str], str] | None = None,
    more: Routes = (),
    port: int = 0,
    no_open: bool = False,
) -> None:
    """Serve recordings by their names, and ``more``; print the addresses of ``paths``, and open the first one.

    ``page`` may add recordings.
    """
    from harness.record.viewer import web_viewer_files
    from harness.record.web_app import site
    from harness.server.local_server import LocalServer, open_browser

    with ended_by_signals():
        app = site(recordings, web_viewer_files(), page=page, more=more)
        server = LocalServer(app, port)
        addresses = [server.address_of(path) for path in paths]
        say("\n".join(["Serving until Ctrl-C:", *addresses]))
        say_forwarding(server.port)
        if not no_open:
            open_browser(addresses[0])
        server.run()
