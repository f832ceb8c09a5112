"""Files: read with errors of one line, written atomically, locked."""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import shutil
import stat
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from io import BufferedReader
from pathlib import Path
from typing import IO, Any

from harness.files.unchanged import check_unchanged
from vfoa.errors import VfoaError
from vfoa.weights import is_lfs_pointer

_UMASK = os.umask(0)  # reading it changes it for all threads: read it only once
os.umask(_UMASK)
_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP)
_log = logging.getLogger(__name__)
_ABSENT = (errno.ENOENT, errno.ENOTDIR, errno.ELOOP)


def read_bytes(path: Path) -> bytes:
    """Read a whole file; raises a :class:`VfoaError` that names it if that fails."""
    with opened(path) as file:
        content = file.read()
        check_unchanged(os.fspath(path), os.fstat(file.fileno()))
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
    return decoded(read_bytes(path), path)


def decoded(data: bytes, where: object) -> str:
    """The text of bytes in UTF-8; raises as :func:`read_text`."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = error.object[: error.start].count(b"\n") + 1
        raise VfoaError(f"{where}:{line}: not UTF-8 text: found byte {error.object[error.start]:#04x}") from None


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
            with naming(path), draft.open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Name this file in an error of the block that names none, as that of a full disk does not."""
    try:
        yield
    except OSError as error:
        if error.errno is not None and error.filename is None:
            error.filename = str(path)
        raise


def _encoded(path: Path, content: str | bytes) -> bytes:
    try:
        return content.encode() if isinstance(content, str) else content
    except UnicodeEncodeError as error:  # a folder or a file whose name is not text
        near = error.object[max(error.start - 40, 0) : error.end]
        raise VfoaError(f"{path}: cannot be written: {near!a} is not UTF-8; expected names in UTF-8") from None


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
        raise VfoaError(
            f"{path}: this command reads it, and would replace it; expected another output file, or the input elsewhere"
        )
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
    try:
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    except OSError as error:  # of a folder that cannot be written
        error.filename = str(path)
        raise
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        temporary.chmod(mode)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


@contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """Yield an empty folder beside ``path`` that becomes it when the ``with`` block ends; it is removed after an error.

    Raises
    ------
    VfoaError
        If ``path`` exists, and is not an empty folder, or is the working directory.
    """
    is_free = not path.exists() or (path.is_dir() and not any(path.iterdir()) and not path.samefile(Path.cwd()))
    if path.is_symlink() or not is_free:
        raise VfoaError(f"{path}: exists already; expected a new folder, or an empty one")
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = Path(tempfile.mkdtemp(dir=path.parent, prefix=f".{path.name}."))
    try:
        yield draft
        draft.chmod(0o777 & ~_UMASK)
        draft.replace(path)
    except BaseException:
        shutil.rmtree(draft, ignore_errors=True)
        raise


def take_lock(file: IO[Any]) -> bool:
    """Lock an open file for this process, until it is closed or the process ends; False if another process holds it.

    Some file systems of clusters have no locks: it is True there, and a warning says that nobody else is noticed.
    """
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as error:
        if error.errno not in _NO_LOCKS:
            raise
        _warn_of_no_locks()
    return True


@cache
def _warn_of_no_locks() -> None:
    from multiprocessing import parent_process

    if parent_process() is None:  # the workers of a run need not say it again
        _log.warning("the file system has no locks: start no other process that writes here until this one has ended")
