"""A web server for one person on one machine: bound to 127.0.0.1, and ended with the process that runs it."""

from __future__ import annotations

import os
import signal
import socket
import sys
import webbrowser
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING

from vfoa.errors import VfoaError

if TYPE_CHECKING:
    import uvicorn
    from starlette.applications import Starlette
    from starlette.routing import BaseRoute

HOST = "127.0.0.1"
NAMES = (HOST, "localhost")
"""What a request may call this machine. A page from elsewhere whose name leads here calls it by that name."""


def local_app(routes: Sequence[BaseRoute]) -> Starlette:
    """An application that answers only to this machine's own names."""
    from starlette.applications import Starlette
    from starlette.middleware import Middleware
    from starlette.middleware.trustedhost import TrustedHostMiddleware

    return Starlette(
        routes=list(routes), middleware=[Middleware(TrustedHostMiddleware, allowed_hosts=NAMES, www_redirect=False)]
    )


def listen(port: int) -> socket.socket:
    """A socket that listens on 127.0.0.1; port 0 is any that is free.

    Raises
    ------
    VfoaError
        If the port is taken or not allowed.
    """
    listener = socket.socket()
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((HOST, port))
    except OSError as error:
        listener.close()
        raise VfoaError(f"--port {port}: cannot listen on {HOST}: {error.strerror}") from None
    listener.listen()
    return listener


def make_server(app: Starlette, *, patience_s: int = 1) -> uvicorn.Server:
    """A server; its end waits this long for what it is answering."""
    import uvicorn

    config = uvicorn.Config(
        app, log_level="warning", access_log=False, lifespan="off", ws="none", timeout_graceful_shutdown=patience_s
    )
    return uvicorn.Server(config)


def serve(app: Starlette, listener: socket.socket) -> None:
    """Answer until Ctrl-C, or until SIGTERM where :func:`ended_by_sigterm` is on."""
    make_server(app).run(sockets=[listener])


@contextmanager
def ended_by_sigterm() -> Iterator[None]:
    """Within the block SIGTERM is like Ctrl-C: what was started is stopped on the way out. Both end the block."""
    with suppress(KeyboardInterrupt), sigterm_as_ctrl_c():
        yield


@contextmanager
def sigterm_as_ctrl_c() -> Iterator[None]:
    """Within the block SIGTERM raises :class:`KeyboardInterrupt`: it would leave a process that was started here."""
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def open_browser(address: str) -> None:
    """Open the person's own browser, where there is a screen to show it on."""
    if sys.platform != "linux" or os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"):
        webbrowser.open(address)
