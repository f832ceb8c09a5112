"""The file of ``vfoa fit``: settings of the posterior as a preset, the data they are based on, and their effect.

[fit]                     the experiment, its clips, and the calibration before and after, leave-one-clip-out
[[fit.value]]             a value with n and its 95 % interval
[attention]               the settings themselves, for configurations with ``attention.method = "bayes"``

``preset = "fitted.toml"`` in an experiment, or ``--preset fitted.toml``, applies them over its defaults.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.bounded_parsing import read_toml
from vfoa.settings import Settings
from vfoa.validation import parse


class FittedValue(Settings):
    """One value of the file."""

    name: str
    value: float
    n: int
    low: float | None = None
    high: float | None = None


class HeldOut(Settings):
    """The scores of one clip under the default settings, and under those fitted on the other clips."""

    clip: str
    n: int
    right_before: float
    right_after: float
    calibration_error_before: float
    calibration_error_after: float


class FitRecord(Settings):
    """The clips that settings were fitted on, and the rates on clips that were left out."""

    experiment: str
    clips: tuple[str, ...]
    value: tuple[FittedValue, ...] = ()
    held_out: tuple[HeldOut, ...] = ()


class FittedSettings(Settings):
    """A whole file."""

    fit: FitRecord
    attention: dict[str, Any]


def read_fitted(path: Path) -> FittedSettings:
    """Read a file of ``vfoa fit``.

    Raises
    ------
    VfoaError
        If it is missing, or a key or value is wrong.
    """
    return parse(FittedSettings, read_toml(path), str(path))


def fitted_note(path: Path, fitted: FittedSettings, clips: Sequence[str]) -> str:
    """The table's note about fitted settings, with a warning if it reports a clip they were fitted on."""
    seen = [clip for clip in clips if clip in fitted.fit.clips]
    if seen:
        return f"FITTED ON WHAT IS REPORTED: the settings of {path.name} were fitted on {', '.join(seen)}."
    return f"Settings of {path.name}, fitted on other clips: {', '.join(fitted.fit.clips)}."


def bayes_only(tables: Mapping[str, Mapping[str, Any]], method: object) -> Mapping[str, Mapping[str, Any]]:
    """Return the tables that apply to a configuration with this attention method."""
    return tables if method == "bayes" else {name: table for name, table in tables.items() if name != "attention"}
