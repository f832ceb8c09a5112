"""Files: read with errors of one line, and written atomically, under names that are safe in tables and on terminals.

A clip is read as it was when a run began: a change of its files while they are read is an error
(:class:`UnchangedFiles`).
"""

from __future__ import annotations

import errno
import fcntl
import os
import re
import stat
import tempfile
from array import array
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from io import BufferedReader
from pathlib import Path
from typing import IO, Any, TypeVar

from vfoa.errors import VfoaError
from vfoa.weights import is_lfs_pointer

_UMASK = os.umask(0)  # reading it changes it for all threads: read it only once
os.umask(_UMASK)
_ABSENT = (errno.ENOENT, errno.ENOTDIR, errno.ELOOP)


def read_bytes(path: Path) -> bytes:
    """Read a whole file; raises a :class:`VfoaError` that names it if that fails."""
    with opened(path) as file:
        content = file.read()
        if _active is not None:
            _active.check(os.fspath(path), os.fstat(file.fileno()))
    return content


def check_fetched(path: Path) -> None:
    """Raise a :class:`VfoaError` if a file is a pointer of Git LFS, which stands where a large file was not fetched."""
    with suppress(OSError):  # whoever reads it says why it cannot be read
        if path.is_file() and is_lfs_pointer(path):
            raise VfoaError(
                f"{path}: a pointer of Git LFS, not the file itself; expected its content: git lfs pull fetches it"
            )


@contextmanager
def opened(path: Path) -> Iterator[BufferedReader]:
    """Open a file to read; raises a :class:`VfoaError` that names it if opening or reading fails.

    A pipe, a socket or a device is rejected: reading it may never end.
    """
    _check_plain(path, "read")
    try:
        with path.open("rb") as file:
            yield file
    except OSError as error:
        raise unreadable(path, error) from None


def read_text(path: Path) -> str:
    """Read a whole UTF-8 text, line ends unchanged, with or without a byte-order mark.

    Raises
    ------
    VfoaError
        If it cannot be read, or is not UTF-8 (with the line).
    """
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise VfoaError(f"{path}:{line}: not UTF-8 text: found byte {error.object[error.start]:#04x}") from None


is_file = os.path.isfile
"""Whether a plain file exists; False also for an invalid file name."""


def is_file_or_link(path: Path) -> bool:
    """Whether a file, a pipe or a broken link is at the path (reading the latter two fails); False for a folder."""
    return os.path.lexists(path) and not path.is_dir()


def unreadable(path: Path, error: OSError | ValueError) -> VfoaError:
    """The error for a file that cannot be read; a ValueError means an invalid name."""
    if isinstance(error, FileNotFoundError) and path.is_symlink():
        return VfoaError(f"{path}: a link to {path.readlink()}, which does not exist")
    if isinstance(error, FileNotFoundError):
        return VfoaError(f"{path}: no such file")
    if isinstance(error, ValueError):
        return VfoaError(f"{str(path)!r}: invalid file name: {error}")
    return VfoaError(f"{path}: cannot be read: {error.strerror or error}")


def atomic_write(path: Path, content: str | bytes) -> None:
    """Write a file (text as UTF-8, line ends unchanged) so that a reader sees the old content or all of the new.

    The folder is created if it is missing.
    """
    write_together({path: content})


def write_together(contents: Mapping[Path, str | bytes]) -> None:
    """Write several files as :func:`atomic_write` does; replace none before all new ones are on the disk.

    So a full disk leaves all files as they were. The first one is replaced last.
    """
    with ExitStack() as drafts:
        for path, content in contents.items():
            data = _encoded(path, content)
            draft = drafts.enter_context(replacing(path))
            try:
                with draft.open("wb") as file:
                    file.write(data)
                    file.flush()
                    os.fsync(file.fileno())
            except OSError as error:  # that of a full disk names no file
                if error.errno is not None and error.filename is None:
                    error.filename = str(path)
                raise


def _encoded(path: Path, content: str | bytes) -> bytes:
    try:
        return content.encode() if isinstance(content, str) else content
    except UnicodeEncodeError as error:  # a folder or a file whose name is not text
        near = error.object[max(error.start - 40, 0) : error.end]
        raise VfoaError(f"{path}: cannot be written: {near!a} is not UTF-8; expected folders whose names are") from None


def check_new(path: Path, *, replace: bool, hint: str = "", inputs: Iterable[Path] = ()) -> None:
    """Reject an existing output file, in every command that writes to a path given by its user.

    Parameters
    ----------
    replace
        The user agrees that an existing file is replaced.
    hint
        An alternative, added after "expected --replace".
    inputs
        The files that the command reads, which no agreement lets it replace; those that do not exist are left out.

    Raises
    ------
    VfoaError
        If a file exists and may not be replaced, is an input, or the path is not a plain file.
    """
    _check_plain(path, "write", folders=False)
    if is_file(path) and any(is_file(file) and path.samefile(file) for file in inputs):
        raise VfoaError(f"{path}: this command reads it and would replace it; expected another file to write")
    if path.exists() and not replace:
        raise VfoaError(f"{path}: exists already; expected --replace{hint}")


def _check_plain(path: Path, use: str, *, folders: bool = True) -> None:
    try:
        mode = path.stat().st_mode
    except (OSError, ValueError) as error:
        if isinstance(error, OSError) and error.errno in _ABSENT:
            return
        raise unreadable(path, error) from None
    if not stat.S_ISREG(mode) and not (folders and stat.S_ISDIR(mode)):
        raise VfoaError(f"{path}: not a plain file; expected a file to {use}")


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield an empty file beside ``path`` that replaces it when the ``with`` block ends, and is removed after an error.

    It gets the mode of the file that it replaces. The folder is created if it is missing.

    Raises
    ------
    VfoaError
        If ``path`` exists and is not a plain file (a device, a pipe, a folder), which would be lost.
    """
    _check_plain(path, "write", folders=False)
    path.parent.mkdir(parents=True, exist_ok=True)
    # mkstemp makes private files; results are meant to be shared, unless their owner made them private
    mode = stat.S_IMODE(path.stat().st_mode) if path.exists() else 0o666 & ~_UMASK
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(mode)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def take_lock(file: IO[Any]) -> bool:
    """Lock an open file for this process, until it is closed or the process ends; False if another process holds it."""
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def place_in(ascending: Sequence[int], number: int) -> int | None:
    """The place of a number in an ascending sequence; None if it is not there. An hour of video has 90,000 frames."""
    place = bisect_left(ascending, number)
    return place if place < len(ascending) and ascending[place] == number else None


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


def read_unchanged(frame: Callable[[int], Frame], number: int) -> Frame:
    """Return ``frame(number)``, by :meth:`UnchangedFiles.read` of the active object, if there is one."""
    return frame(number) if _active is None else _active.read(frame, number)


def _short(status: os.stat_result) -> int:
    return hash((status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino, status.st_dev))


_active: UnchangedFiles | None = None
_noting: UnchangedFiles | None = None


_FORMULA = ("=", "+", "-", "@")
"""A spreadsheet executes a cell that begins with one of these as a formula."""
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069]")
"""Control characters: a terminal obeys some of them (ESC), and some reverse the direction of text."""

_NUMBER = re.compile(r"[+-][0-9.][0-9.,]*([eE][+-]?[0-9]+)?( .*)?$")
"""A number in the form of a table, perhaps followed by its unit or interval."""


def check_name(name: str) -> str:
    """Return a valid name; called wherever names are defined or come from another program.

    Raises
    ------
    ValueError
        If it is empty, holds a control character, or begins like a formula.
    """
    if not name.strip() or not name.isprintable() or name.startswith(_FORMULA):
        raise ValueError(f"found the name {name!r}; expected text that does not begin with {' '.join(_FORMULA)}")
    return name


def shown(text: str) -> str:
    """Text of unknown origin for a terminal: control characters are escaped as in Python."""
    return _CONTROL.sub(lambda sign: "\n" if sign[0] == "\n" else ascii(sign[0])[1:-1], text)


def plain_cell(text: str) -> str:
    """Text of unknown origin as a cell of a table, escaped so that a spreadsheet does not run it as a formula."""
    safe = text if text.isprintable() else shown(text)
    if safe.startswith(_FORMULA) and safe not in _FORMULA and not _NUMBER.match(safe):
        return f"'{safe}"
    return safe
