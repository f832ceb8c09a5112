"""What `make` would run: on a system whose C library is too old for the locked Open3D, the lock without it."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parent.parent
LOCKS = ("requirements.lock", "requirements-dev.lock")


def _commands(folder: Path, libc: str) -> list[str]:
    """What `make .venv/.ready-dev` runs in a fresh clone, on a system that names its C library so."""
    bin_ = folder / "bin"
    bin_.mkdir()
    (bin_ / "getconf").write_text(f"#!/bin/sh\n{libc}\n")
    (bin_ / "getconf").chmod(0o755)
    for name in ("make", "sh", "awk"):
        (bin_ / name).symlink_to(shutil.which(name) or pytest.skip(f"needs {name}"))
    for name in ("Makefile", "pyproject.toml", "system-libraries.sh", *LOCKS):
        shutil.copy(REPOSITORY / name, folder)
    arguments = ["make", "--dry-run", "--no-print-directory", ".venv/.ready-dev"]
    done = subprocess.run(arguments, cwd=folder, env={"PATH": str(bin_)}, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def _packages(lock: str) -> dict[str, list[str]]:
    """The hashes of each package with its version."""
    entries = re.findall(r"^([^\s#][^\n]*)\n((?:    --hash[^\n]*\n)*)", lock, re.MULTILINE)
    return {name.rstrip(" \\"): re.findall(r"sha256:\w+", hashes) for name, hashes in entries}


@pytest.mark.parametrize("libc", ["echo glibc 2.35", "echo glibc 2.41", "echo glibc 3.1", "exit 1"])
def test_the_lock_is_installed_as_it_is(tmp_path: Path, libc: str) -> None:
    commands = _commands(tmp_path, libc)
    for lock in LOCKS:
        assert [line for line in commands if line.endswith(f"--require-hashes --requirement {lock}")] != [], lock
    assert [line for line in commands if line.endswith("--no-deps --editable .")] != []


@pytest.mark.parametrize("libc", ["echo glibc 2.34", "echo glibc 2.31"])
def test_an_old_system_takes_the_lock_without_open3d(tmp_path: Path, libc: str) -> None:
    commands = _commands(tmp_path, libc)
    assert [line for line in commands if line.endswith('--editable ".[harness]"')] != []
    (tmp_path / ".venv").mkdir()
    for lock in LOCKS:
        (line,) = (line for line in commands if line.endswith(f"--require-hashes --requirement .venv/{lock}"))
        subprocess.run(["sh", "-c", line.partition(" && ")[0]], cwd=tmp_path, check=True)
        every, kept = (_packages((tmp_path / folder / lock).read_text()) for folder in ("", ".venv"))
        assert kept == {name: hashes for name, hashes in every.items() if not name.startswith("open3d")}
        assert len(every) - len(kept) == 2
        assert all(kept.values())
