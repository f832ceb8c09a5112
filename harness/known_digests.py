"""Digests of files that need not be read again, because the files have the stamp that they had when they were read.

The stamp of a set of files is the path, size, times, inode and device of each. A change of content sets the time of the
last change (ctime), which no program can set back, so the same stamp means the same content. Only a file that changes
again within one tick of its file system's clock keeps its stamp; therefore, as in git's index, a digest is only kept if
the files had been left alone for some time before they were read. Memory-mapped writes may show late, and a file
server whose clock is behind by more than that time is not noticed.
"""

from __future__ import annotations

import hashlib
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeVar

from vfoa.errors import VfoaError

Frame = TypeVar("Frame")

LARGE_BYTES = 1 << 20
"""Larger files have digests by stamp of their own."""

_FEW = 16
"""The stamps of this many large files, such as videos, are compared at each frame."""

_ATTEMPTS = 3

SETTLED_NS = 3 * 10**9
"""Age of the last change, ns, from which on a file counts as left alone: the coarsest clock (FAT) ticks every 2 s."""


@dataclass(frozen=True, slots=True)
class Stamp:
    """The stamp of a set of files, as a digest, and whether they had been left alone before it was taken."""

    digest: str
    is_settled: bool


def stamp_of(parts: Sequence[tuple[str, str]]) -> Stamp | None:
    """The stamp of (role, file) pairs in order; None if one of them is missing."""
    settled_ns = time.time_ns() - SETTLED_NS
    total, newest_ns = hashlib.blake2b(digest_size=20), 0
    try:
        for role, path in parts:
            found = os.stat(path)
            if _noting is not None:
                _noting.note(path, found)
            newest_ns = max(newest_ns, found.st_mtime_ns, found.st_ctime_ns)
            times = f"{found.st_mtime_ns} {found.st_ctime_ns}"
            total.update(f"{role}\0{path}\0{found.st_size} {times} {found.st_ino} {found.st_dev}\n".encode())
    except (OSError, ValueError):  # reading them gives the error
        return None
    return Stamp(total.hexdigest(), newest_ns <= settled_ns)


class KnownDigests:
    """Digests by the stamp of their files: those of this process, and those that an earlier one has kept."""

    def __init__(self) -> None:
        self._by_stamp: dict[str, str] = {}
        self._used: dict[str, str] = {}

    def of(self, parts: Sequence[tuple[str, str]], read: Callable[[], str]) -> str:
        """The digest of (role, file) pairs: a known one, else that of ``read``, which reads the files."""
        stamp = stamp_of(parts)
        digest = self._by_stamp.get(stamp.digest) if stamp else None
        if digest is None:
            digest = read()
            if stamp is None or not stamp.is_settled:
                return digest
        if stamp:
            self._by_stamp[stamp.digest] = self._used[stamp.digest] = digest
        return digest

    def add(self, known: Mapping[str, str]) -> None:
        """Add digests by stamp."""
        self._by_stamp.update(known)

    @property
    def known(self) -> dict[str, str]:
        """Every digest by stamp, for another process to add."""
        return dict(self._by_stamp)

    @contextmanager
    def used(self) -> Iterator[Mapping[str, str]]:
        """Yield the digests by stamp that are used in the ``with`` block, for another process to add."""
        before, self._used = self._used, {}
        try:
            yield self._used
        finally:
            self._used = before


KNOWN = KnownDigests()
"""Those of this process."""


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


def read_unchanged(frame: Callable[[int], Frame], number: int) -> Frame:
    """Return ``frame(number)`` as :meth:`UnchangedFiles.read`; without an active one, as it is."""
    return frame(number) if _active is None else _active.read(frame, number)


def _short(found: os.stat_result) -> int:
    return hash((found.st_size, found.st_mtime_ns, found.st_ctime_ns, found.st_ino, found.st_dev))


_active: UnchangedFiles | None = None
_noting: UnchangedFiles | None = None
