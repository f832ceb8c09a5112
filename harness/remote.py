"""Data on shared or object storage: ``s3://bucket/clip``, ``gs://``, ``sftp://`` and what else fsspec knows.

A pipeline reads every frame many times over, so a remote folder is copied into the cache once, and read from there. A
file is copied again when its storage says that it has changed (size, time, ETag: fsspec's ``ukey``), and left out of
the copy when it is gone there; what HTTP serves counts as unchanging, as fsspec has it. Keys and passwords are fsspec's
own matter: its environment variables and files. What is on this machine already (``local:``, ``file:``) is read where
it is; copies are for their owner's eyes alone.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from functools import cache
from pathlib import Path, PurePosixPath
from typing import Any

import platformdirs

from harness.files import atomic_write, replacing
from vfoa.errors import VfoaError

_ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*(::[A-Za-z0-9+.-]+)*://")
_INDEX = "index.json"


def cache_root() -> Path:
    """``$VFOA_CACHE``, or the cache folder of the platform."""
    return Path(os.environ.get("VFOA_CACHE") or platformdirs.user_cache_dir("vfoa"))


def is_address(text: str) -> bool:
    """Whether a path from a configuration is one of another storage."""
    return _ADDRESS.match(text) is not None


@cache
def local_copy(address: str, where: str) -> Path:
    """Copy a remote file, or a folder with all that is in it, and return where it is now; once a process.

    What is on this machine is not copied.

    Raises
    ------
    VfoaError
        If the storage is not known or not installed, cannot be reached, has nothing there, or has a file whose name
        leads out of the copy; ``where`` opens the line.
    """
    import fsspec  # type: ignore[import-untyped]
    from fsspec.implementations.local import LocalFileSystem  # type: ignore[import-untyped]

    place = cache_root() / "remote" / hashlib.sha256(address.encode()).hexdigest()[:16]
    try:
        storage, root = fsspec.core.url_to_fs(address)
        if type(storage) is LocalFileSystem:
            return _in_place(Path(root))
        found = storage.find(root, detail=True)
        if not found:
            raise FileNotFoundError
        _bring(storage, root, found, place)
    except VfoaError as error:
        raise VfoaError(f"{where}: {address}: {error}") from None
    except (ImportError, ValueError) as error:
        raise VfoaError(f"{where}: {address}: no such storage: {error}") from None
    except FileNotFoundError:
        raise VfoaError(f"{where}: {address}: nothing there") from None
    except Exception as error:  # every storage has errors of its own
        raise VfoaError(f"{where}: {address}: cannot be read: {type(error).__name__}: {error}") from None
    is_file = list(found) == [root] and storage.isfile(root)
    return place / "files" / PurePosixPath(root).name if is_file else place / "files"


def _in_place(path: Path) -> Path:
    if not path.exists():
        raise FileNotFoundError
    return path


def _bring(storage: Any, root: str, found: dict[str, Any], place: Path) -> None:
    """Make the copy what the storage has: new and changed files are fetched, those that are gone are removed."""
    place.mkdir(parents=True, exist_ok=True)
    place.chmod(0o700)
    folder = str(PurePosixPath(root).parent) if list(found) == [root] else root
    wanted = {str(PurePosixPath(path).relative_to(folder)): path for path in sorted(found)}
    if escaping := next((name for name in wanted if ".." in PurePosixPath(name).parts), None):
        raise VfoaError(f"holds {escaping!r}; expected only names inside it")
    index = place / _INDEX
    have: dict[str, str] = json.loads(index.read_text(encoding="utf-8")) if index.is_file() else {}
    for name in have.keys() - wanted.keys():
        (place / "files" / name).unlink(missing_ok=True)
    now = {}
    for name, path in wanted.items():
        file, key = place / "files" / name, str(storage.ukey(path))
        if have.get(name) != key or not file.is_file():
            with replacing(file) as fetched:
                storage.get_file(path, str(fetched))
        now[name] = key
    if now != have:
        atomic_write(index, json.dumps(now, indent=1, ensure_ascii=False) + "\n")
