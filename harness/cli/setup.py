"""``vfoa init``, ``doctor``, ``settings``, ``cache``: the working directory, and what this machine has."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from shutil import which
from typing import Annotated

import typer

from harness.cli.options import Cache, stage_names
from harness.cli.terminal import print_table, say
from vfoa.errors import VfoaError, first_line

_EXAMPLE = Path(__file__).with_name("example")
"""What ``vfoa init`` leaves; ``scripts/example_clip.py`` has made its data."""


def init(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="Directory; it is made if it does not exist.")],
) -> None:
    """Make a working directory: the data folders, and an example clip with labels and an experiment.

    Files that exist stay as they are.
    """
    from harness.files.io import atomic_write

    for name in ("datasets", "annotations", "experiments"):
        try:
            (folder / name).mkdir(parents=True, exist_ok=True)
        except (FileExistsError, NotADirectoryError):
            raise VfoaError(f"{folder / name}: found a file; expected a folder") from None
    for path in sorted(path for path in _EXAMPLE.rglob("*") if path.is_file()):
        target = folder / path.relative_to(_EXAMPLE)
        if not target.exists():
            atomic_write(target, path.read_bytes())
    say((folder / "README.md").read_text(encoding="utf-8"), nl=False)
    inside = "" if folder.resolve() == Path.cwd() else f"cd {folder} && "
    say(f"next: {inside}vfoa run")


_MODULES = ("numpy", "pandas", "cv2", "cv2.ximgproc", "open3d", "onnxruntime", "filterpy", "rerun", "mcap")
_LIBRARIES = {
    "cv2.ximgproc": "pip uninstall opencv-python-headless, then reinstall opencv-contrib-python-headless",
    "open3d": "sh system-libraries.sh python, or on Debian: libgl1 libx11-6 libgomp1 libegl1 libusb-1.0-0",
}
"""What to do for a package that is installed and cannot be imported."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One line: what was checked, its state, what to do (None: nothing to do), and whether a run needs it."""

    what: str
    state: str
    fix: str | None = None
    required: bool = False


def doctor() -> None:
    """Check what running needs: packages, write access, weights, providers, browser; exit 2 if it cannot work.

    `vfoa run CLIP` cannot work if a stage has no model that is ready; `vfoa demo` needs none.
    """
    folders = list(_folders())
    findings = [*_packages(), *_weights(), *_surroundings()]
    needed = [finding.what for finding in (*findings, *folders) if finding.required and finding.fix]
    if needed:
        say(f"vfoa: doctor: `vfoa run CLIP` does not work yet; not ready: {', '.join(needed)}{_fetch_all()}", err=True)
    else:
        say("`vfoa run CLIP` can work here.")
    print_table(
        ["check", "state", "what to do"],
        [[finding.what, finding.state, finding.fix] for finding in findings],
        wrapped=("state", "what to do"),
    )
    for finding in folders:  # lines of their own: a table would break their paths
        say(f"{finding.what}: {finding.state}{f'; {finding.fix}' if finding.fix else ''}")
    if needed:
        raise typer.Exit(2)


def _fetch_all() -> str:
    """The end of a sentence with the one command that fetches all models of a default run; empty if they are here."""
    from harness.pipeline.weights import missing_weights
    from harness.run.experiment import default_configuration

    default = default_configuration()
    missing = missing_weights(default.stages)
    return f"; fetch its models: `{missing.fetch}`" if missing else ""


def _packages() -> Iterator[Finding]:
    """Import each package: one that is installed can still lack a library of the system."""
    yield Finding(what="Python", state=f"{platform.python_version()}, {platform.machine()}")
    for name in _MODULES:
        try:
            module = import_module(name)
        except ImportError as error:
            fix = _LIBRARIES.get(name, "pip install --requirement requirements.lock")
            yield Finding(what=name, state=first_line(error), fix=fix, required=True)
        else:
            yield Finding(what=name, state=getattr(module, "__version__", "ready"))


def _folders() -> Iterator[Finding]:
    from harness.files.folders import VARIABLE, cache_root
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
    """For each slot, the stages that can run, and how to get the weights of the default stage."""
    from harness.pipeline.configuration import STAGES
    from harness.pipeline.weights import missing_weights, ready_stages
    from harness.run.experiment import default_configuration

    default = default_configuration()
    for slot, choice in default.choices.items():
        missing = missing_weights([choice] if choice else [], others=default.stages)
        fix = " or ".join((missing.fetch, *missing.alternatives)) if missing else None
        ready = ", ".join(stage.name for stage in ready_stages(STAGES[slot]))
        what = f"{slot} (default {choice.name if choice else 'none'})"
        yield Finding(what=what, state=f"ready: {ready or 'none'}", fix=fix, required=not ready)


_DEVICES = Path("/dev")


def _has_nvidia_gpu() -> bool:
    """Whether the driver's devices are here: those of Linux, or of Windows' subsystem for it with NVIDIA's tools."""
    is_subsystem = (_DEVICES / "dxg").exists() and which("nvidia-smi") is not None
    return is_subsystem or any(_DEVICES.glob("nvidia[0-9]*"))


def _surroundings() -> Iterator[Finding]:
    """The providers of networks, and the browser of the pages."""
    import webbrowser

    from vfoa.onnx import available_providers

    providers = available_providers()
    is_unused = len(providers) == 1 and _has_nvidia_gpu()
    fix = "for CUDA: onnxruntime-gpu in place of onnxruntime; then --provider cuda" if is_unused else None
    yield Finding(what="providers of networks", state=", ".join(providers), fix=fix)
    try:
        state, fix = webbrowser.get().__class__.__name__, None
    except webbrowser.Error:
        state, fix = "none", "open the address that `vfoa annotate` and `vfoa report --serve` print in any browser"
    yield Finding(what="browser", state=state, fix=fix)


def settings(
    stage: Annotated[
        str | None,
        typer.Argument(
            metavar="STAGE",
            help="Only a stage or step (stereo), or one choice of it (stereo.sgbm).",
            autocompletion=stage_names,
        ),
    ] = None,
) -> None:
    """Print every setting: key (for --set and for experiments), type, unit, default and meaning."""
    from harness.pipeline.settings_reference import settings_tables

    for table in settings_tables(stage):
        say(f"{table.title}{': ' if table.summary else ''}{table.summary}")
        if table.settings:
            print_table(
                ("Key", "Type", "Unit", "Default", "Meaning"),
                [
                    (setting.key, setting.type, setting.unit, setting.default, setting.meaning)
                    for setting in table.settings
                ],
                wrapped=("Type", "Default", "Meaning"),
            )
        else:
            say("  nothing to set\n")


cache_app = typer.Typer(help="Show and clear the stage cache.", no_args_is_help=True)


@cache_app.command(short_help="Show where the cache is and what it holds.")
def info(cache: Cache = None) -> None:
    """Show where the cache is, its limit, and the size of each stage and clip."""
    from harness.pipeline.cache_store import open_store

    store = open_store(cache)
    usage = store.usage()
    total = sum(entry.bytes for entry in usage)
    if usage:
        print_table(
            ["stage", "clip", "results", "MB"],
            [[f"{entry.slot} {entry.name}", entry.clip, entry.files, f"{entry.bytes / 1e6:.1f}"] for entry in usage],
        )
    say(f"{store.stages}: {total / 1e6:.1f} MB of at most {store.limit_bytes / 1e6:.0f} MB ($VFOA_CACHE_GB)")


@cache_app.command()
def clear(cache: Cache = None) -> None:
    """Remove every cached result."""
    from harness.pipeline.cache_store import open_store

    store = open_store(cache)
    total = sum(usage.bytes for usage in store.usage())
    store.clear()
    say(f"{store.stages}: removed {total / 1e6:.1f} MB")
