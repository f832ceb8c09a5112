"""``vfoa doctor``."""

from __future__ import annotations

import platform
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import typer

from harness.cli.options import Json
from harness.cli.terminal import print_json, print_table

_MODULES = ("numpy", "pandas", "cv2", "cv2.ximgproc", "open3d", "onnxruntime", "filterpy", "rerun", "mcap")
_LIBRARIES = {
    "cv2.ximgproc": "pip uninstall opencv-python-headless, then reinstall opencv-contrib-python-headless",
    "open3d": "sh system-libraries.sh python, or on Debian: libgl1 libx11-6 libgomp1 libegl1 libusb-1.0-0",
}
"""What to do for a package that is installed and cannot be imported."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One line: the state of one thing, whether running stops without it, and what mends it (None: nothing to do)."""

    what: str
    state: str
    fix: str | None = None
    required: bool = False


def doctor(as_json: Json = False) -> None:
    """Check what running needs: packages, write access, weights, providers, browser; exit 2 if it cannot work."""
    findings = [*_python(), *_packages(), *_folders(), *_weights(), *_providers(), *_browser()]
    if as_json:
        print_json([asdict(finding) for finding in findings])
    else:
        print_table(
            ["check", "state", "to mend it"],
            [[finding.what, finding.state, finding.fix] for finding in findings],
            wrapped={"state", "to mend it"},
        )
    if any(finding.required and finding.fix for finding in findings):
        raise typer.Exit(2)


def _python() -> Iterator[Finding]:
    old = sys.version_info < (3, 11)
    yield Finding(
        what="Python",
        state=f"{platform.python_version()}, {platform.machine()}",
        fix="install Python 3.11 or newer" if old else None,
        required=True,
    )


def _packages() -> Iterator[Finding]:
    """Import each package: one that is installed can still lack a library of the system."""
    from importlib import import_module

    for name in _MODULES:
        try:
            module = import_module(name)
        except ImportError as error:
            fix = _LIBRARIES.get(name, "pip install --requirement requirements.lock")
            yield Finding(what=name, state=str(error).splitlines()[0], fix=fix, required=True)
        else:
            yield Finding(what=name, state=getattr(module, "__version__", "ready"))


def _folders() -> Iterator[Finding]:
    import os

    from harness.files.cache import VARIABLE, cache_root
    from vfoa.weights import cache_directory

    mends = {
        "working directory": (Path.cwd(), "cd to a folder of your own"),
        "stage cache": (cache_root(), f"set {VARIABLE} to a folder of your own"),
        "fetched weights": (cache_directory(), "set XDG_CACHE_HOME to a folder of your own"),
    }
    for what, (folder, fix) in mends.items():
        there = next(parent for parent in (folder, *folder.parents) if parent.exists())
        writable = os.access(there, os.W_OK | os.X_OK)
        state = f"{folder}: {'writable' if writable else 'cannot be written'}"
        yield Finding(what=what, state=state, fix=None if writable else fix, required=what == "working directory")


def _weights() -> Iterator[Finding]:
    """For each slot, the stages that can run; and how to get the weights of the one that `vfoa run CLIP` takes."""
    from harness.run.experiment import load_experiment
    from harness.stages.slots import SLOTS
    from harness.stages.weights.readiness import missing_weights, ready_stages

    (default,) = load_experiment("default", clips=("any",)).configurations
    for slot, choice in default.choices.items():
        missing = missing_weights([choice] if choice else [])
        fix = " or ".join((missing.fetch, *missing.instead)) if missing else None
        ready = ", ".join(stage.name for stage in ready_stages(SLOTS[slot])) or "none"
        yield Finding(what=f"{slot} (default {choice.name if choice else 'none'})", state=f"ready: {ready}", fix=fix)


def _providers() -> Iterator[Finding]:
    from vfoa.onnx import available_providers

    providers = available_providers()
    fix = None if len(providers) > 1 else "for CUDA: onnxruntime-gpu in place of onnxruntime; then --provider cuda"
    yield Finding(what="providers of networks", state=", ".join(providers), fix=fix)


def _browser() -> Iterator[Finding]:
    import webbrowser

    try:
        state, fix = webbrowser.get().__class__.__name__, None
    except webbrowser.Error:
        state, fix = "none", "open the address that `vfoa annotate` and `vfoa report --serve` print in any browser"
    yield Finding(what="browser", state=state, fix=fix)
