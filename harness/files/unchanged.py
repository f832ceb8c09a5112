"""A clip is read as it was when a run began: a change of its files while they are read is an error.

Files are compared by stamp (size, times, inode), as digests of files are kept (:mod:`harness.files.digests`).
"""

from __future__ import annotations

import os
from array import array
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from harness.files.ascending import place_in
from vfoa.errors import VfoaError

Frame = TypeVar("Frame")

LARGE_BYTES = 1 << 20
"""Larger files have digests by stamp of their own."""

_FEW = 16
"""The stamps of this many files, and of as many large ones, such as videos, are compared at each frame."""

_ATTEMPTS = 3


class ChangedError(VfoaError):
    """A file is not as it was when the clip was digested."""


class UnchangedFiles:
    """The files of a clip, which is read as it was when it was digested: outputs are cached under that digest.

    While the object is active, every file that is read is compared with its stamp. A comparison at the end would miss
    files that were exchanged and put back, and links that were switched and switched back.

    Parameters
    ----------
    clip
        The name of the clip.
    digest
        Computes the digest of its files.
    expected
        The digest that the run began with.

    Raises
    ------
    VfoaError
        If the digest is another one.
    """

    def __init__(self, clip: str, digest: Callable[[], str], expected: str) -> None:
        self._clip, self._digest, self._expected = clip, digest, expected
        self._noted: dict[int, int] = {}
        self._watched: set[str] = set()
        self._renew()

    @contextmanager
    def active(self) -> Iterator[None]:
        """Compare every file of the clip that is read in the block."""
        global _active
        before, _active = _active, self
        try:
            yield
        finally:
            _active = before

    def read(self, frame: Callable[[int], Frame], number: int) -> Frame:
        """Return ``frame(number)``, read from unchanged files. If files were only touched, it is read again.

        Raises
        ------
        VfoaError
            If a file has changed.
        """
        for _ in range(_ATTEMPTS):
            try:
                value = frame(number)
                if len(self._watched) <= 2 * _FEW:  # not read by read_bytes: a video stays open while it is read
                    for path in tuple(self._watched):
                        self.check(path, os.stat(path))
            except (ChangedError, FileNotFoundError):
                self._renew()
            else:
                return value
        raise VfoaError(changed_during_run(self._clip))

    def check(self, path: str, status: os.stat_result) -> None:
        """Raise a :class:`ChangedError` if a file of the clip has another stamp."""
        paths, stamps = self._stamps
        place = place_in(paths, hash(path))
        if place is not None and stamps[place] != _short(status):
            raise ChangedError(f"{path}: changed during the run")

    def note(self, path: str, status: os.stat_result) -> None:
        """Note the stamp of a file that is being digested."""
        self._noted[hash(path)] = _short(status)
        if status.st_size > LARGE_BYTES or len(self._noted) <= _FEW:
            self._watched.add(path)

    def _renew(self) -> None:
        global _noting
        before, _noting = _noting, self
        try:
            if self._digest() != self._expected:
                raise VfoaError(changed_during_run(self._clip))
        finally:
            _noting = before
        paths = sorted(self._noted)
        # arrays take a third of the memory of a dict; other threads may be reading the old ones
        self._stamps = array("q", paths), array("q", (self._noted[path] for path in paths))
        self._noted = {}


def changed_during_run(clip: str) -> str:
    """The error of a clip whose files changed since the run began."""
    return (
        f"{clip}: its images or calibration changed during the run; expected the same content to the end: "
        "remove the run's directory and run again"
    )


def note_stamp(path: str, status: os.stat_result) -> None:
    """Note the stamp of a file, if an :class:`UnchangedFiles` is being digested."""
    if _noting is not None:
        _noting.note(path, status)


def check_unchanged(path: str, status: os.stat_result) -> None:
    """Raise a :class:`ChangedError` if a file of the active :class:`UnchangedFiles` has another stamp."""
    if _active is not None:
        _active.check(path, status)


def read_unchanged(frame: Callable[[int], Frame], number: int) -> Frame:
    """Return ``frame(number)``, by :meth:`UnchangedFiles.read` of the active object, if there is one."""
    return frame(number) if _active is None else _active.read(frame, number)


def _short(status: os.stat_result) -> int:
    return hash((status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino, status.st_dev))


_active: UnchangedFiles | None = None
_noting: UnchangedFiles | None = None
