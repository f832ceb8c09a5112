"""The command ``vfoa``: Ctrl-C ends it without a traceback, even while it is imported.

This module is the first that the command imports, and imports nothing: before :func:`main` is called, Python itself
would print a traceback.
"""

from __future__ import annotations


def main() -> None:
    """Run the command line.

    While it is imported there is nothing to clean up, so that Ctrl-C ends the process at once. After that, Ctrl-C calls
    :func:`harness.processes.interrupt`.
    """
    try:
        import signal
        import sys

        if sys.platform == "win32":
            from harness.processes import NOT_ON_WINDOWS

            raise SystemExit(f"vfoa: {NOT_ON_WINDOWS}")
        from harness.processes import interrupt

        handler = signal.getsignal(signal.SIGINT)
        if handler is signal.default_int_handler:  # a job in the background ignores Ctrl-C
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            handler = interrupt
        from harness import cli

        signal.signal(signal.SIGINT, handler)
        cli.main()
    except KeyboardInterrupt:
        raise SystemExit(130) from None
    except ModuleNotFoundError as error:
        raise _explained(error) from None


def _explained(error: ModuleNotFoundError) -> BaseException:
    """The error; one line in its place if this program itself has imported a package that the extra would bring."""
    place = error.__traceback__
    while place is not None and place.tb_next is not None:
        place = place.tb_next
    importer = place.tb_frame.f_globals.get("__name__", "") if place else ""
    rooms, package = ("harness", "vfoa"), (error.name or "").partition(".")[0]
    if importer.partition(".")[0] not in rooms or package in ("", *rooms):
        return error
    return SystemExit(
        f"vfoa: found no package {package}: the library is installed, which the command is not part of; expected: "
        "pip install 'vfoa[harness]'"
    )


if __name__ == "__main__":
    main()
