"""Ground truth of idiap/vfoa (github.com/idiap/vfoa, ``tests/test_runVfoaModule.py``; read, not used).

``*_gt.npz``: an array (frames, 1) for each person (``Person 1``, ...), a code for each frame: 0 unfocused, 1 robot,
2 the other person. An array (frames,) is read, too.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from harness.files.io import read_bytes
from harness.files.parsing import check_archive
from harness.labels.formats.exchange import Exchange, Imported, ReadOnly
from harness.labels.labels import NOWHERE, Label, ranges_of
from vfoa.errors import VfoaError

MEANINGS = ("unfocused", "robot", "other person")
"""Meaning of the codes, in their order."""

_Found = tuple[int, str, str]
"""A frame, the upstream name of a person, and the target of that person."""


class IdiapGroundTruth(ReadOnly):
    """Reads upstream's arrays."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read labels; the manifest must have the people, and the robot by this name."""
        tracks: dict[str, list[tuple[int, Label]]] = {}
        for frame, person, meaning in _codes(path, exchange):
            subject = exchange.subject(person, str(path))
            target = exchange.target(_target(meaning, subject, exchange, path), subject, str(path))
            tracks.setdefault(subject, []).append((frame, Label(target=target)))
        for subject, labels in tracks.items():
            if len(labels) != len(exchange.frames):
                raise VfoaError(f"{path}: {subject!r} has {len(labels)} labels; expected {len(exchange.frames)}")
        rows = [row for subject, labels in tracks.items() for row in ranges_of(subject, labels)]
        return exchange.labels(rows, path)


def _target(meaning: str, subject: str, exchange: Exchange, path: Path) -> str:
    if meaning == "unfocused":
        return NOWHERE
    if meaning == "robot":
        return "robot"
    others = [name for name in exchange.subjects if name != subject]
    if len(others) != 1:
        raise VfoaError(f"{path}: {meaning!r} of {subject!r}: found {len(others)} other people; expected one")
    return others[0]


def _codes(path: Path, exchange: Exchange) -> Iterator[_Found]:
    frames = exchange.frames
    for name, codes in _arrays(path).items():
        if len(codes) != len(frames):
            raise VfoaError(f"{path}: {name}: found {len(codes)} labels; expected {len(frames)}, one for each frame")
        for frame, code in zip(frames, codes, strict=True):
            if code not in range(len(MEANINGS)):
                raise VfoaError(f"{path}: {name}: frame {frame}: found the code {code}; expected 0, 1 or 2")
            yield frame, name.removeprefix("Person "), MEANINGS[code]


def _arrays(path: Path) -> dict[str, Sequence[int]]:
    data = read_bytes(path)
    check_archive(data, path)
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = {name: np.asarray(file[name]) for name in file.files}
    except Exception as error:  # errors of the archive, and of each array's header, which is Python
        raise VfoaError(f"{path}: not a file of arrays: {error}") from None
    for name, array in arrays.items():
        is_column = array.ndim == 1 or array.shape[1:] == (1,)
        if not is_column or array.dtype.kind not in "iuf" or not np.array_equal(array, array.astype(int)):
            raise VfoaError(f"{path}: {name}: found {array.dtype} of {array.shape}; expected one code for each frame")
    return {name: [int(code) for code in array.ravel()] for name, array in arrays.items()}
