"""Ground truth of idiap/vfoa (github.com/idiap/vfoa, ``tests/test_runVfoaModule.py``; read, not used).

``*_gt.npz``: an array (frames, 1) for each person (``Person 1``, ...), a code for each frame: 0 unfocused, 1 robot,
2 the other person. An array (frames,) is read, too.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from harness.files.io import read_bytes
from harness.files.parsing import check_archive
from harness.labels.formats.exchange import Exchange, Imported, ReadOnly
from harness.labels.labels import NOWHERE, Label, LabelRange, ranges_of
from vfoa.errors import VfoaError, reported_as

MEANINGS = ("unfocused", "robot", "other person")
"""Meaning of the codes, in their order."""


class IdiapGroundTruth(ReadOnly):
    """Reads upstream's arrays."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read labels; the manifest must have the people, and the robot by this name."""
        frames, rows = exchange.frames, dict[str, list[LabelRange]]()
        for name, codes in _arrays(path).items():
            subject = exchange.subject(name.removeprefix("Person "), str(path))
            if subject in rows:
                raise VfoaError(f"{path}: {name}: a second array of {subject!r}; expected one")
            if len(codes) != len(frames):
                raise VfoaError(
                    f"{path}: {name}: found {len(codes)} labels; expected {len(frames)}, one for each frame"
                )
            for frame, code in zip(frames, codes, strict=True):
                if code not in range(len(MEANINGS)):
                    raise VfoaError(f"{path}: {name}: frame {frame}: found the code {code}; expected 0, 1 or 2")
            targets = {
                code: exchange.target(_target(MEANINGS[code], subject, exchange, path), subject, str(path))
                for code in dict.fromkeys(codes)
            }
            labels = ((frame, Label(target=targets[code])) for frame, code in zip(frames, codes, strict=True))
            rows[subject] = list(ranges_of(subject, labels))
        return exchange.labels((row for of_subject in rows.values() for row in of_subject), path)


def _target(meaning: str, subject: str, exchange: Exchange, path: Path) -> str:
    if meaning == "unfocused":
        return NOWHERE
    if meaning == "robot":
        return "robot"
    others = [name for name in exchange.subjects if name != subject]
    if len(others) != 1:
        raise VfoaError(f"{path}: {meaning!r} of {subject!r}: found {len(others)} other people; expected one")
    return others[0]


def _arrays(path: Path) -> dict[str, Sequence[int]]:
    data = read_bytes(path)
    check_archive(data, path)
    # errors of the archive, and of each array's header, which is Python
    with reported_as(f"{path}: not a .npz file"), np.load(io.BytesIO(data), allow_pickle=False) as file:
        arrays = {name: np.asarray(file[name]) for name in file.files}
    for name, array in arrays.items():
        is_column = array.ndim == 1 or array.shape[1:] == (1,)
        if not is_column or array.dtype.kind not in "iuf" or not np.array_equal(array, array.astype(int)):
            raise VfoaError(f"{path}: {name}: found {array.dtype} of {array.shape}; expected one code for each frame")
    return {name: [int(code) for code in array.ravel()] for name, array in arrays.items()}
