"""Clips on object storage and other machines: ``s3://bucket/clip``, ``gs://``, ``sftp://``, as fsspec knows them.

A pipeline reads every frame many times, so a remote folder is copied into the cache once, and read from there. A file
is copied again if the storage's listing shows a change (size, time, ETag), and removed from the copy if it is gone from
the storage; files on HTTP count as unchanging. Data on this machine (``local:``, ``file:``) is read where it is. Only
their owner can read the copies.

Keys and passwords are left to fsspec (environment variables and files). Runs and caches are folders of this machine.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterable, Mapping
from contextlib import ExitStack, suppress
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any

from harness.files.folders import cache_root
from harness.files.io import atomic_write, replacing
from vfoa.errors import VfoaError

_ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*(::[A-Za-z0-9+.-]+)*://")
VARIABLE = re.compile(r"\$\{(\w+)\}")
_TOGETHER = 64
"""Number of files that are requested at once."""

_VERSIONS = (
    *("ETag", "etag", "md5Hash", "generation", "size", "mtime", "LastModified", "last_modified", "modified"),
    *("updated", "created", "last_write_time", "modify"),
)
"""Names under which listings of storages give a value that changes with a file's content."""

_INDEX = "index.json"


def is_address(text: str) -> bool:
    """Whether a path from a configuration is an address of remote storage."""
    return _ADDRESS.match(text) is not None


def local_folder(path: str | Path, where: str) -> Path:
    """The path of a folder that is written to: no address.

    Raises
    ------
    VfoaError
        If it is an address; the message begins with ``where``.
    """
    if is_address(str(path)):
        raise VfoaError(
            f"{where} {path}: found an address; expected a folder of this machine: only clips are read from addresses"
        )
    return Path(path)


@cache
def local_copy(address: str, where: str) -> Path:
    """Copy a remote file, or a folder with its whole content, and return the path of the copy; once per process.

    Hidden files are left out. Data on this machine is not copied.

    Raises
    ------
    VfoaError
        If the storage is unknown, not installed or unreachable, has nothing at the address, or has a file whose name
        leads out of the copy; the message begins with ``where``.
    """
    try:
        return _copied(address)
    except VfoaError as error:
        raise VfoaError(f"{where}: {error}") from None
    except Exception as error:  # every storage has errors of its own
        raise VfoaError(f"{where}: {address}: cannot be read: {type(error).__name__}: {error}") from None


def forget_copies() -> None:
    """Check again, when a copy is requested next, whether the original has changed."""
    local_copy.cache_clear()


def unset_variables(text: str) -> list[str]:
    """The environment variables that a path from a configuration file needs and that are not set."""
    return [name for name in dict.fromkeys(VARIABLE.findall(text)) if not os.environ.get(name)]


def expand(text: str, base: Path, where: str) -> Path:
    """Resolve a configured path: ``${NAME}`` and ``~`` expanded, relative to ``base``; an address gives its local copy.

    Raises
    ------
    VfoaError
        If an environment variable is not set, or an address cannot be read;
        ``where`` (file and key) starts the message.
    """

    def value(match: re.Match[str]) -> str:
        setting = os.environ.get(match[1])
        if not setting:
            below = text[match.end() :].strip("/")
            holds = f"; set it to the folder that holds {below}" if below else ""
            raise VfoaError(f"{where}: {text!r} needs the environment variable {match[1]}, which is not set{holds}")
        return setting

    place = VARIABLE.sub(value, text)
    return local_copy(place, where) if is_address(place) else base / os.path.expanduser(place)


def _copied(address: str) -> Path:
    from fsspec.implementations.local import LocalFileSystem  # type: ignore[import-untyped]

    storage, root = _storage(address)
    if type(storage) is LocalFileSystem:
        if not Path(root).exists():
            raise _absent(address)
        return Path(root)
    files = _files(storage, root, address)
    if not files:
        raise _absent(address)
    place = cache_root() / "remote" / hashlib.sha256(address.encode()).hexdigest()[:16]
    place.mkdir(parents=True, exist_ok=True)
    place.chmod(0o700)
    _update(storage, files, place)
    is_file = list(files) == [address.rpartition("/")[2]] and storage.isfile(root)
    return place / "files" / next(iter(files)) if is_file else place / "files"


def _update(storage: Any, files: Mapping[str, Mapping[str, Any]], place: Path) -> None:
    """Fetch new and changed files, and remove those that are gone from the storage."""
    folder, path = place / "files", place / _INDEX
    have: dict[str, str] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    versions = {name: _version(info) for name, info in files.items()}
    _remove(folder, have.keys() - versions.keys())
    names = [name for name in versions if have.get(name) != versions[name] or not (folder / name).is_file()]
    for begin in range(0, len(names), _TOGETHER):
        batch = names[begin : begin + _TOGETHER]
        with ExitStack() as drafts:
            here = [str(drafts.enter_context(replacing(folder / name))) for name in batch]
            storage.get([files[name]["name"] for name in batch], here)
    if versions != have:
        atomic_write(path, json.dumps(versions, indent=1, ensure_ascii=False) + "\n")


def _remove(folder: Path, names: Iterable[str]) -> None:
    """Remove files, and the folders that are empty then: object storage has no folders without files."""
    for path in (folder / name for name in names):
        path.unlink(missing_ok=True)
        with suppress(OSError):  # not empty, or not there
            for parent in path.parents[: len(path.relative_to(folder).parts) - 1]:
                parent.rmdir()


def _files(storage: Any, root: str, address: str) -> dict[str, Mapping[str, Any]]:
    """The storage's details of each file that is not hidden, by name; that of a single file is its last part."""
    storage.invalidate_cache()  # others write there, too
    try:
        listing = storage.find(root, detail=True)
    except FileNotFoundError:
        listing = {}
    top = str(PurePosixPath(root).parent) if list(listing) == [root] else root
    listing = {path: info for path, info in listing.items() if not path.endswith("/")}  # a folder made in a console
    files = {str(PurePosixPath(path).relative_to(top)): listing[path] for path in sorted(listing)}
    if escaping := next((name for name in files if ".." in PurePosixPath(name).parts), None):
        raise VfoaError(
            f"{address}: found the file name {escaping!r}, which leads out of the folder; expected names inside it"
        )
    return {name: info for name, info in files.items() if not any(part.startswith(".") for part in name.split("/"))}


def _version(info: Mapping[str, Any]) -> str:
    return " ".join(str(info[name]) for name in _VERSIONS if info.get(name) is not None)


def _storage(address: str) -> tuple[Any, str]:
    import fsspec  # type: ignore[import-untyped]

    try:
        return fsspec.core.url_to_fs(address)
    except ImportError as error:
        hint = "; for S3: pip install 'vfoa[s3]'" if "s3fs" in str(error) else ""
        raise VfoaError(f"{address}: this storage needs a package that is not installed: {error}{hint}") from None
    except ValueError as error:
        raise VfoaError(
            f"{address}: unknown storage: {error}; expected an address such as s3://BUCKET/FOLDER or "
            "https://HOST/FOLDER"
        ) from None
    except FileNotFoundError:
        raise _absent(address) from None


def _absent(address: str) -> VfoaError:
    return VfoaError(f"{address}: no such file or folder; expected the address of one that is not empty")
