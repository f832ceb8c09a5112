"""The file of ``vfoa fit``: weights of the logit as a preset, the labels they were fitted to, and their scores.

[fit]                     the experiment, its clips, the labelled seconds, the version of vfoa
[[fit.held_out]]          the scores of every method on clips, or parts of one, that were left out
[[fit.curve]]             the scores of the fit with fewer labels
[attention]               the method and its weights

``preset = "weights.toml"`` in an experiment, or ``--preset weights.toml``, applies it to every configuration of that
method, and to those that say nothing about attention.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.files.parsing import read_toml
from vfoa.logit import LogitSettings
from vfoa.settings import Settings
from vfoa.validation import parse


class MethodScore(Settings):
    """The scores of one method. Without probabilities it has no log loss and no calibration error."""

    method: str
    n: int
    log_loss: float | None = None
    calibration_error: float | None = None
    balanced_frr: float | None = None
    frr: float
    recall_on_targets: float | None = None


class FitRecord(Settings):
    """What weights were fitted to, and their scores on what was left out."""

    experiment: str
    configuration: str
    clips: tuple[str, ...]
    people: int
    labelled_s: float
    seeds: int = 1
    version: str
    held_out: tuple[MethodScore, ...] = ()
    curve: tuple[MethodScore, ...] = ()

    def score_of(self, method: str) -> MethodScore | None:
        """Return the scores of a method, if it was scored."""
        return next((each for each in self.held_out if each.method == method), None)


class FittedWeights(Settings):
    """A whole file."""

    fit: FitRecord
    attention: LogitSettings


def read_fitted(path: Path) -> FittedWeights:
    """Read a file of ``vfoa fit``.

    Raises
    ------
    VfoaError
        If it is missing, or a key or value is wrong.
    """
    return parse(FittedWeights, read_toml(path), str(path))


def preset_of(path: Path) -> dict[str, Any]:
    """Return the settings of attention in a file of ``vfoa fit``."""
    return {"method": "logit", "weights": read_fitted(path).attention.model_dump()["weights"]}


def fitted_note(path: Path, fitted: FittedWeights, clips: Sequence[str]) -> str:
    """The table's note about fitted weights, with a warning if it reports a clip they were fitted on."""
    seen = [clip for clip in clips if clip in fitted.fit.clips]
    if seen:
        return f"FITTED ON WHAT IS REPORTED: the weights of {path.name} were fitted on {', '.join(seen)}."
    return f"Weights of {path.name}, fitted on other clips: {', '.join(fitted.fit.clips)}."


def logit_only(tables: Mapping[str, Mapping[str, Any]], method: object) -> Mapping[str, Mapping[str, Any]]:
    """Return the tables of a preset that apply to a configuration of this method; None: it says nothing about it."""
    if "attention" not in tables or method in (None, tables["attention"].get("method")):
        return tables
    return {name: table for name, table in tables.items() if name != "attention"}
