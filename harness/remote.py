"""Data on object storage or another machine: ``s3://bucket/clip``, ``gs://``, ``sftp://`` and others that fsspec knows.

A pipeline reads every frame many times, so a remote folder is copied into the cache once, and read from there. A file
is copied again if the storage's listing shows a change (size, time, ETag), and removed from the copy if it is gone from
the storage; files on HTTP count as unchanging. Keys and passwords are left to fsspec (environment variables and files).
Data on this machine (``local:``, ``file:``) is read where it is. Only their owner can read the copies.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any

import platformdirs

from harness.files import atomic_write, replacing
from vfoa.errors import VfoaError

_ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*(::[A-Za-z0-9+.-]+)*://")
_INDEX = "index.json"
_TOGETHER = 64
"""Number of files that are requested at once."""

_VERSIONS = ("ETag", "etag", "md5Hash", "generation", "size", "mtime", "LastModified", "last_modified", "modified")
_MORE_VERSIONS = ("updated", "created", "last_write_time", "modify")
"""Names under which listings of storages give a value that changes with a file's content."""


CACHE_VARIABLE, _MODELS, _MODELS_ADDRESS = "VFOA_CACHE", "VFOA_MODELS", "VFOA_MODELS_ADDRESS"


def cache_root() -> Path:
    """``$VFOA_CACHE``, or the cache folder of the platform."""
    return Path(os.environ.get(CACHE_VARIABLE) or platformdirs.user_cache_dir("vfoa"))


def is_address(text: str) -> bool:
    """Whether a path from a configuration is an address of remote storage."""
    return _ADDRESS.match(text) is not None


@cache
def local_copy(address: str, where: str) -> Path:
    """Copy a remote file, or a folder with its whole content, and return the path of the copy; once per process.

    Data on this machine is not copied.

    Raises
    ------
    VfoaError
        If the storage is unknown, not installed or unreachable, has nothing at the address, or has a file whose name
        leads out of the copy; the message begins with ``where``.
    """
    try:
        if here := folder_of(address):
            if not here.exists():
                raise VfoaError(f"{address}: nothing there")
            return here
        mirror = Mirror(address)
        names = mirror.pull()
        if not names:
            raise VfoaError(f"{address}: nothing there")
        is_file = names == [address.rpartition("/")[2]] and Remote(address).is_file()
        return mirror.folder / names[0] if is_file else mirror.folder
    except VfoaError as error:
        raise VfoaError(f"{where}: {error}") from None


def forget_copies() -> None:
    """Check again, when a copy is requested next, whether the original has changed."""
    local_copy.cache_clear()


def bring_models() -> None:
    """If ``$VFOA_MODELS`` is an address, copy the models here, and set the variable to the path of the copy.

    ``$VFOA_MODELS_ADDRESS`` keeps the address: workers of a cluster make a copy of their own.

    Raises
    ------
    VfoaError
        As :func:`local_copy`.
    """
    named = os.environ.get(_MODELS, "")
    if is_address(named):
        os.environ[_MODELS_ADDRESS] = named
    if address := os.environ.get(_MODELS_ADDRESS):
        os.environ[_MODELS] = str(local_copy(address, _MODELS))


def folder_of(address: str) -> Path | None:
    """The path of an address on this machine (``local:``, ``file:``); None for any other storage.

    Raises
    ------
    VfoaError
        If the storage is not known, or its package is not installed.
    """
    from fsspec.implementations.local import LocalFileSystem  # type: ignore[import-untyped]

    storage, root = _storage(address)
    return Path(root) if type(storage) is LocalFileSystem else None


def _storage(address: str) -> tuple[Any, str]:
    import fsspec  # type: ignore[import-untyped]

    try:
        return fsspec.core.url_to_fs(address)
    except ImportError as error:
        hint = "; for S3: pip install 'vfoa[s3]'" if "s3fs" in str(error) else ""
        raise VfoaError(f"{address}: no such storage here: {error}{hint}") from None
    except ValueError as error:
        raise VfoaError(f"{address}: no such storage: {error}") from None
    except FileNotFoundError:
        raise VfoaError(f"{address}: nothing there") from None
    except Exception as error:  # every storage has errors of its own
        raise VfoaError(f"{address}: cannot be opened: {type(error).__name__}: {error}") from None


@contextmanager
def _in_one_line(address: str, failed: str) -> Iterator[None]:
    try:
        yield
    except VfoaError:
        raise
    except Exception as error:  # every storage has errors of its own
        raise VfoaError(f"{address}: {failed}: {type(error).__name__}: {error}") from None


@dataclass(frozen=True, slots=True)
class Remote:
    """The files below an address, by their names relative to it. All methods raise a :class:`VfoaError` of one line."""

    address: str

    def read(self, name: str) -> bytes | None:
        """The content of a file; None if there is none."""
        storage, root = _storage(self.address)
        with _in_one_line(self.address, "cannot be read"):
            try:
                return bytes(storage.cat_file(f"{root}/{name}"))
            except FileNotFoundError:
                return None

    def write(self, name: str, content: bytes) -> None:
        """Write a file; on object storage it appears whole, or not at all."""
        storage, root = _storage(self.address)
        with _in_one_line(self.address, "cannot be written"):
            _make_folders(storage, [f"{root}/{name}"])
            storage.pipe_file(f"{root}/{name}", content)

    def has(self, name: str) -> bool:
        """Whether there is such a file."""
        storage, root = _storage(self.address)
        with _in_one_line(self.address, "cannot be read"):
            return bool(storage.exists(f"{root}/{name}"))

    def files(self, under: str = "") -> dict[str, Mapping[str, Any]]:
        """The storage's details of each file, by name; if the address is a single file, its name is the last part.

        Raises
        ------
        VfoaError
            Also for a name that leads out of the folder.
        """
        storage, root = _storage(self.address)
        folder = f"{root}/{under}" if under else root
        with _in_one_line(self.address, "cannot be read"):
            storage.invalidate_cache()  # others write there, too
            try:
                found = storage.find(folder, detail=True)
            except FileNotFoundError:
                found = {}
            storage.invalidate_cache()
        top = str(PurePosixPath(root).parent) if list(found) == [root] else root
        files = {str(PurePosixPath(path).relative_to(top)): found[path] for path in sorted(found)}
        if escaping := next((name for name in files if ".." in PurePosixPath(name).parts), None):
            raise VfoaError(f"{self.address}: holds {escaping!r}; expected only names inside it")
        return files

    def is_file(self) -> bool:
        """Whether the address is that of a file."""
        storage, root = _storage(self.address)
        with _in_one_line(self.address, "cannot be read"):
            return bool(storage.isfile(root))

    def fetch(self, paths: Mapping[str, str], folder: Path) -> None:
        """Copy files into a folder, each completely or not at all; ``paths`` gives their paths on the storage."""
        storage, _ = _storage(self.address)
        names = list(paths)
        with _in_one_line(self.address, "cannot be read"):
            for begin in range(0, len(names), _TOGETHER):
                batch = names[begin : begin + _TOGETHER]
                with ExitStack() as drafts:
                    here = [str(drafts.enter_context(replacing(folder / name))) for name in batch]
                    storage.get([paths[name] for name in batch], here)

    def upload(self, names: Sequence[str], folder: Path) -> None:
        """Copy files of a folder to the storage, batch by batch in this order; the files of a batch at once."""
        storage, root = _storage(self.address)
        with _in_one_line(self.address, "cannot be written"):
            _make_folders(storage, [f"{root}/{name}" for name in names])
            for begin in range(0, len(names), _TOGETHER):
                batch = names[begin : begin + _TOGETHER]
                storage.put([str(folder / name) for name in batch], [f"{root}/{name}" for name in batch])

    def check_writable(self) -> None:
        """Write and remove an empty file, so that a wrong bucket or wrong keys are known before the work."""
        self.write(".vfoa", b"")
        self.remove([".vfoa"])

    def remove_all(self, under: str) -> None:
        """Remove all files of a folder."""
        names = [f"{under}/{name}" for name in Remote(f"{self.address}/{under}").files()]
        self.remove(names)

    def remove(self, names: Iterable[str]) -> None:
        """Remove files; it is no error if one is gone already."""
        storage, root = _storage(self.address)
        with _in_one_line(self.address, "cannot be written"):
            for name in names:
                with suppress(FileNotFoundError):
                    storage.rm_file(f"{root}/{name}")


def _make_folders(storage: Any, paths: Iterable[str]) -> None:
    """Make the folders of files on a storage with folders; object storage has none."""
    for folder in {} if storage.async_impl else {str(PurePosixPath(path).parent) for path in paths}:
        storage.makedirs(folder, exist_ok=True)


class Mirror:
    """A remote folder and ``folder``, its copy on this machine."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._remote = Remote(address)
        self._place = cache_root() / "remote" / hashlib.sha256(address.encode()).hexdigest()[:16]
        self.folder = self._place / "files"

    @classmethod
    def at(cls, folder: Path) -> Mirror | None:
        """The mirror whose copy is this folder; None if the folder is no copy."""
        try:
            mirror = cls((folder.parent / "address").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return mirror if mirror.folder.absolute() == folder.absolute() else None

    def pull(self) -> list[str]:
        """Fetch new and changed files, remove those gone from the storage, and return the names of all files there.

        Files that were written only here stay.
        """
        self._place.mkdir(parents=True, exist_ok=True)
        self._place.chmod(0o700)
        atomic_write(self._place / "address", self.address)
        files = self._remote.files()
        found = {name: _version(info) for name, info in files.items()}
        have = self._read_index()
        for name in have.keys() - found.keys():
            (self.folder / name).unlink(missing_ok=True)
        kept = {name for name in found if name in have and have[name][0] == found[name]}
        kept = {name for name in kept if (self.folder / name).is_file()}
        self._remote.fetch({name: info["name"] for name, info in files.items() if name not in kept}, self.folder)
        now = {name: have[name] if name in kept else [found[name], _stamp(self.folder / name)] for name in found}
        if now != have:
            self._write_index(now)
        return list(found)

    def push(self) -> None:
        """Upload the files written here since the last pull or push, and remove on the storage those removed here.

        Hidden files stay here.
        """
        have = self._read_index()
        here = {path.relative_to(self.folder).as_posix(): path for path in _plain_files(self.folder)}
        stamps = {name: _stamp(path) for name, path in here.items()}
        changed = [name for name in here if name not in have or have[name][1] != stamps[name]]
        self._remote.upload(sorted(changed, key=lambda name: stamps[name][1]), self.folder)
        gone = have.keys() - here.keys()
        self._remote.remove(sorted(gone))
        if changed or gone:
            versions = {name: _version(info) for name, info in self._remote.files().items()}
            same = {name: each for name, each in have.items() if name in here}
            self._write_index(same | {name: [versions[name], stamps[name]] for name in changed if name in versions})

    def _read_index(self) -> dict[str, list[Any]]:
        """For each file that was the same in both places: its version on the storage, and its stamp here."""
        path = self._place / _INDEX
        return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}

    def _write_index(self, index: dict[str, list[Any]]) -> None:
        atomic_write(self._place / _INDEX, json.dumps(index, indent=1, ensure_ascii=False) + "\n")


def open_mirror(text: str) -> Path:
    """Return a folder to write to: the path itself or, for an address, an up-to-date copy of it.

    Raises
    ------
    VfoaError
        If the address cannot be read or written.
    """
    address = text.rstrip("/")
    if not is_address(address):
        return Path(text)
    if folder := folder_of(address):
        return folder
    Remote(address).check_writable()
    mirror = Mirror(address)
    mirror.pull()
    return mirror.folder


def _plain_files(folder: Path) -> list[Path]:
    return [path for path in sorted(folder.rglob("*")) if path.is_file() and not path.name.startswith(".")]


def _version(info: Mapping[str, Any]) -> str:
    return " ".join(str(info[name]) for name in (*_VERSIONS, *_MORE_VERSIONS) if info.get(name) is not None)


def _stamp(path: Path) -> list[int]:
    status = path.stat()
    return [status.st_size, status.st_mtime_ns]
