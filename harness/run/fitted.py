"""Files of fitted weights, as ``vfoa fit`` writes them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from harness.files.parsing import read_toml
from vfoa import __version__
from vfoa.errors import VfoaError
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
    clips_sha256: tuple[str, ...] = ()
    """Digests of the content of these clips, which tell one that is called otherwise since."""
    people: int
    labelled_s: float
    seeds: int = 1
    version: str
    held_out: tuple[MethodScore, ...] = ()
    curve: tuple[MethodScore, ...] = ()

    def score_of(self, method: str) -> MethodScore | None:
        """Return the scores of a method, if it was scored."""
        return next((method_score for method_score in self.held_out if method_score.method == method), None)


class FittedWeights(Settings):
    """A whole file."""

    fit: FitRecord
    attention: LogitSettings


def read_fitted(path: Path) -> FittedWeights:
    """Read a file of ``vfoa fit``.

    Raises
    ------
    VfoaError
        If it is missing, a key or value is wrong, or a later version of this program wrote it.
    """
    table = read_toml(path)
    _check_version(table, path)  # first: a later version may have other keys
    return parse(FittedWeights, table, str(path))


def fitted_text(fitted: FittedWeights) -> str:
    """The text of a file, as :func:`read_fitted` reads it."""
    import tomlkit  # every run imports this file

    plain = fitted.model_dump(mode="json", exclude_none=True)
    weights = {
        smoothing: {
            case: {key: value for key, value in of_case.items() if value != []} for case, of_case in cases.items()
        }
        for smoothing, cases in plain["attention"]["weights"].items()
    }
    document = {"fit": plain["fit"], "attention": {"method": "logit", "weights": weights}}
    head = "# Written by vfoa fit. Use it as a preset: vfoa run CLIP | EXPERIMENT --preset THIS_FILE\n"
    return head + tomlkit.dumps(document)


def _check_version(table: Mapping[str, Any], path: Path) -> None:
    record = table.get("fit")
    version = record.get("version") if isinstance(record, dict) else None
    if isinstance(version, str) and not () < _release(version) <= _release(__version__):
        raise VfoaError(
            f"{path}: fit.version: found {version!r}; expected that of this program, {__version__}, or an earlier one: "
            "update vfoa, or fit the weights again"
        )


def _release(version: str) -> tuple[int, ...]:
    """The numbers that a version begins with; none if it is no version."""
    numbers = re.match(r"\d{1,9}(\.\d{1,9})*", version, re.ASCII)
    return tuple(map(int, numbers[0].split("."))) if numbers else ()
