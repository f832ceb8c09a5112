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
        if error.name is None or error.name.partition(".")[0] in ("harness", "vfoa"):
            raise
        package = error.name.partition(".")[0]
        raise SystemExit(
            f"vfoa: found no package {package}: the library is installed, which the command is not part of; expected: "
            "pip install 'vfoa[harness]'"
        ) from None


if __name__ == "__main__":
    main()
