"""Files of a clip that is read as it was when a run began: a change while they are read is an error."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from vfoa.errors import VfoaError

Frame = TypeVar("Frame")

LARGE_BYTES = 1 << 20
"""Larger files have digests by stamp of their own."""

_FEW = 16
"""The stamps of this many large files, such as videos, are compared at each frame."""

_ATTEMPTS = 3


class ChangedError(VfoaError):
    """A file is not as it was when the clip was digested."""


class UnchangedFiles:
    """The files of a clip, which is read as it was when it was digested: outputs are cached under that digest.

    While the object is active, every file that is read is compared with its stamp: files that are exchanged and put
    back, or behind a link that is switched and switched back, differ in nothing at the end.

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
        self._stamps: dict[int, int] = {}
        self._large: set[str] = set()
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
                found = frame(number)
                for path in (
                    tuple(self._large) if len(self._large) <= _FEW else ()
                ):  # a video stays open while it is read
                    self.check(path, os.stat(path))
            except (ChangedError, FileNotFoundError):
                self._renew()
            else:
                return found
        raise VfoaError(changed_during_run(self._clip))

    def check(self, path: str, found: os.stat_result) -> None:
        """Raise a :class:`ChangedError` if a file of the clip has another stamp."""
        if self._stamps.get(hash(path), expected := _short(found)) != expected:
            raise ChangedError(f"{path}: changed during the run")

    def note(self, path: str, found: os.stat_result) -> None:
        """Note the stamp of a file that is being digested."""
        self._stamps[hash(path)] = _short(found)
        if found.st_size > LARGE_BYTES:
            self._large.add(path)

    def _renew(self) -> None:
        global _noting
        before, _noting = _noting, self  # each stamp is replaced: other threads may be reading
        try:
            if self._digest() != self._expected:
                raise VfoaError(changed_during_run(self._clip))
        finally:
            _noting = before


def changed_during_run(clip: str) -> str:
    """The error of a clip that is not what a run began with."""
    return (
        f"{clip}: its images or calibration changed during the run; expected the same content to the end: "
        "remove the run's directory and run again"
    )


def check_unchanged(path: str, found: os.stat_result) -> None:
    """Check a file that was just read, if it belongs to the clip of an active :class:`UnchangedFiles`."""
    if _active is not None:
        _active.check(path, found)


def note_stamp(path: str, found: os.stat_result) -> None:
    """Note the stamp of a file, if an :class:`UnchangedFiles` is being digested."""
    if _noting is not None:
        _noting.note(path, found)


def read_unchanged(frame: Callable[[int], Frame], number: int) -> Frame:
    """Return ``frame(number)`` as :meth:`UnchangedFiles.read`; without an active one, as it is."""
    return frame(number) if _active is None else _active.read(frame, number)


def _short(found: os.stat_result) -> int:
    return hash((found.st_size, found.st_mtime_ns, found.st_ctime_ns, found.st_ino, found.st_dev))


_active: UnchangedFiles | None = None
_noting: UnchangedFiles | None = None
