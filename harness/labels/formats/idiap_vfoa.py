"""Ground truth of idiap/vfoa (github.com/idiap/vfoa, ``tests/test_runVfoaModule.py``; read, not used).

``*_gt.npz``: an array (frames, 1) for each person (``Person 1``, ...), a code for each frame: 0 unfocused, 1 robot,
2 the other person. An array (frames,) is read, too. Or a CSV with the header ``time_ns,person,looks_at``, where
``looks_at`` is one of these in words.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from harness.files.io import read_bytes
from harness.files.parsing import check_archive
from harness.files.tables import read_rows
from harness.labels.formats.exchange import Exchange, Imported, ReadOnly
from harness.labels.labels import NOWHERE, Label, ranges_of
from vfoa.errors import VfoaError, did_you_mean

MEANINGS = ("unfocused", "robot", "other person")
"""Meaning of the codes, in their order."""

_COLUMNS = ("time_ns", "person", "looks_at")
_Found = tuple[int, str, str]
"""A frame, the upstream name of a person, and the target of that person."""


class IdiapGroundTruth(ReadOnly):
    """Reads upstream's arrays, or the table."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read labels; the manifest must have the people, and the robot by this name."""
        found = _of_arrays(path, exchange) if path.suffix == ".npz" else _of_table(path, exchange)
        tracks: dict[str, list[tuple[int, Label]]] = {}
        for frame, person, meaning in found:
            subject = exchange.subject(person, str(path))
            target = exchange.target(_target(meaning, subject, exchange, path), subject, str(path))
            tracks.setdefault(subject, []).append((frame, Label(target=target)))
        for subject, labels in tracks.items():
            labels.sort(key=lambda each: each[0])
            if (
                twice := next((frame for (frame, _), (after, _) in pairwise(labels) if frame == after), None)
            ) is not None:
                raise VfoaError(f"{path}: frame {twice}: {subject!r} has two labels; expected one")
        rows = [row for subject, labels in tracks.items() for row in ranges_of(subject, labels)]
        return exchange.labels(rows, path)


def _target(meaning: str, subject: str, exchange: Exchange, path: Path) -> str:
    if meaning == "unfocused":
        return NOWHERE
    if meaning == "robot":
        return "robot"
    others = [each for each in exchange.subjects if each != subject]
    if len(others) != 1:
        raise VfoaError(f"{path}: {meaning!r} of {subject!r}: found {len(others)} other people; expected one")
    return others[0]


def _of_arrays(path: Path, exchange: Exchange) -> Iterator[_Found]:
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
            found = {name: np.asarray(file[name]) for name in file.files}
    except Exception as error:  # errors of the archive, and of each array's header, which is Python
        raise VfoaError(f"{path}: not a file of arrays: {error}") from None
    for name, array in found.items():
        is_column = array.ndim == 1 or array.shape[1:] == (1,)
        if not is_column or array.dtype.kind not in "iuf" or not np.array_equal(array, array.astype(int)):
            raise VfoaError(f"{path}: {name}: found {array.dtype} of {array.shape}; expected one code for each frame")
    return {name: [int(code) for code in array.ravel()] for name, array in found.items()}


def _of_table(path: Path, exchange: Exchange) -> Iterator[_Found]:
    frame_at = dict(zip(exchange.timeline.times_ns, exchange.timeline.frames, strict=True))
    for row in read_rows(path, _COLUMNS, _COLUMNS):
        stamp, meaning = row.cells.get("time_ns", ""), row.cells.get("looks_at", "")
        if not (stamp.isascii() and stamp.isdigit()) or int(stamp) not in frame_at:
            raise VfoaError(f"{row.where}: time_ns: found {stamp!r}; expected the time of a frame of the clip")
        if meaning not in MEANINGS:
            raise VfoaError(f"{row.where}: looks_at: no {meaning!r}; {did_you_mean(meaning, MEANINGS)}")
        yield frame_at[int(stamp)], row.cells.get("person", ""), meaning
