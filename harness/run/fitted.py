"""Files of fitted weights, as ``vfoa fit`` writes them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import zip_longest
from pathlib import Path
from typing import Any

from harness.files.parsing import read_toml
from harness.run.notes import Note, NoteKind, fitted_on_reported
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


def notes_on_fits(fits: Mapping[Path, FitRecord], digests: Mapping[str, str]) -> Iterator[Note]:
    """Yield what readers of a table must know of the weights in it: a warning if they have seen what is reported.

    Parameters
    ----------
    fits
        The origins of the weights, by their files.
    digests
        Digests of the content of the reported clips, by name. A clip of the content that weights were fitted on is that
        clip, whatever its name. One of its name and of other content is in question: it may be a changed copy. The name
        decides where a file has no digests.
    """
    for file, fit in fits.items():
        content = dict(zip_longest(fit.clips, fit.clips_sha256, fillvalue=""))
        named = {digest: name for name, digest in content.items() if digest}
        seen = [
            clip if content.get(clip) in (digest, "") else f"{clip} (then {named[digest]})"
            for clip, digest in digests.items()
            if digest in named or content.get(clip) == ""
        ]
        alike = [clip for clip, digest in digests.items() if content.get(clip) and digest not in named]
        if seen:
            yield fitted_on_reported(f"the weights of {file.name}", seen)
        if alike:
            text = f"the weights of {file.name} were fitted on a clip of this name whose content differs: if this is a"
            yield Note(f"{', '.join(alike)}: {text} changed copy of it, its rates are too good.", NoteKind.DOUBT)
        if not seen and not alike:
            yield Note(f"Weights of {file.name}, fitted on other clips: {', '.join(fit.clips)}.")


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
