"""The command line, called in this process."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from harness.cli import main


def vfoa(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    """Exit code, stdout and stderr. An exception that is not an exit ends the test: it would be a traceback."""
    monkeypatch.setattr(sys, "argv", ["vfoa", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    said = capsys.readouterr()
    return int(ended.value.code or 0), said.out, said.err


def run_in(folder: Path, *words: str) -> None:
    """Run a command in a folder, for a fixture that several tests read: it must succeed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(sys, "argv", ["vfoa", *words])
        with pytest.raises(SystemExit) as ended:
            main()
    assert not ended.value.code
