"""Copies of remote files on this machine, kept up to date.

A pipeline reads every frame many times, so a remote folder is copied into the cache once, and read from there. A file
is copied again if the storage's listing shows a change (size, time, ETag), and removed from the copy if it is gone from
the storage; files on HTTP count as unchanging. Data on this machine (``local:``, ``file:``) is read where it is. Only
their owner can read the copies.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from harness.cache_folder import cache_root
from harness.files import atomic_write
from harness.remote import Remote, folder_of, is_address
from vfoa.errors import VfoaError

_INDEX = "index.json"
_MODELS, _MODELS_ADDRESS = "VFOA_MODELS", "VFOA_MODELS_ADDRESS"

_VERSIONS = ("ETag", "etag", "md5Hash", "generation", "size", "mtime", "LastModified", "last_modified", "modified")
_MORE_VERSIONS = ("updated", "created", "last_write_time", "modify")
"""Names under which listings of storages give a value that changes with a file's content."""


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


def local_path(path: str | Path, where: str) -> Path:
    """The path itself or, for an address, that of an up-to-date copy. Raises as :func:`local_copy` does."""
    return local_copy(path.rstrip("/"), where) if isinstance(path, str) and is_address(path) else Path(path)


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

        Hidden files are left out. Files that were written only here stay.
        """
        self._place.mkdir(parents=True, exist_ok=True)
        self._place.chmod(0o700)
        atomic_write(self._place / "address", self.address)
        files = {name: info for name, info in self._remote.files().items() if not is_hidden(name)}
        found = {name: _version(info) for name, info in files.items()}
        have = self._read_index()
        self._remove(have.keys() - found.keys())
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

    def _remove(self, names: Iterable[str]) -> None:
        """Remove files here, and the folders that are empty then: object storage has no folders without files."""
        for path in (self.folder / name for name in names):
            path.unlink(missing_ok=True)
            with suppress(OSError):  # not empty, or not there
                for folder in path.parents[: len(path.relative_to(self.folder).parts) - 1]:
                    folder.rmdir()

    def _read_index(self) -> dict[str, list[Any]]:
        """For each file that was the same in both places: its version on the storage, and its stamp here."""
        path = self._place / _INDEX
        return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}

    def _write_index(self, index: dict[str, list[Any]]) -> None:
        atomic_write(self._place / _INDEX, json.dumps(index, indent=1, ensure_ascii=False) + "\n")


def publish(folder: Path) -> None:
    """Upload what was written in a folder, if it is the copy of a remote one. Raises as :meth:`Mirror.push` does."""
    if mirror := Mirror.at(folder):
        mirror.push()


def name_of(folder: Path) -> str:
    """The address of a folder that is the copy of a remote one; the path of any other."""
    mirror = Mirror.at(folder)
    return mirror.address if mirror else str(folder)


def _plain_files(folder: Path) -> list[Path]:
    found = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return [path for path in found if not is_hidden(path.relative_to(folder).as_posix())]


def is_hidden(name: str) -> bool:
    """Whether a file, by its name relative to a folder, is left out of copies."""
    return any(part.startswith(".") for part in name.split("/"))


def _version(info: Mapping[str, Any]) -> str:
    return " ".join(str(info[name]) for name in (*_VERSIONS, *_MORE_VERSIONS) if info.get(name) is not None)


def _stamp(path: Path) -> list[int]:
    status = path.stat()
    return [status.st_size, status.st_mtime_ns]
