"""Access to object storage and other machines: ``s3://bucket/clip``, ``gs://``, ``sftp://``, as fsspec knows them.

Keys and passwords are left to fsspec (environment variables and files).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from harness.files import replacing
from vfoa.errors import VfoaError

_ADDRESS = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*(::[A-Za-z0-9+.-]+)*://")
_TOGETHER = 64
"""Number of files that are requested at once."""

_PROBE = ".vfoa"
"""Name of an empty file that is written and removed again."""


def is_address(text: str) -> bool:
    """Whether a path from a configuration is an address of remote storage."""
    return _ADDRESS.match(text) is not None


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

    def create(self, name: str, content: bytes) -> bool:
        """Write a file if there is none, and return whether there was none.

        Of several that do so at once only one succeeds, if the storage can decide that (S3, memory, SFTP).
        """
        storage, root = _storage(self.address)
        path = f"{root}/{name}"
        with _in_one_line(self.address, "cannot be written"):
            _make_folders(storage, [path])
            try:
                storage.pipe_file(path, content, mode="create")
            except FileExistsError:
                return False
            except (TypeError, ValueError, NotImplementedError):  # this storage cannot
                storage.invalidate_cache()
                if storage.exists(path):
                    return False
                storage.pipe_file(path, content)
        return True

    def age_s(self, name: str) -> float | None:
        """Seconds since a file was written, by the clock of the storage; None if there is no such file."""
        storage, root = _storage(self.address)
        self.write(_PROBE, b"")
        with _in_one_line(self.address, "cannot be read"):
            storage.invalidate_cache()
            try:
                now, then = (storage.modified(f"{root}/{each}") for each in (_PROBE, name))
            except FileNotFoundError:
                return None
        self.remove([_PROBE])
        return float((now - then).total_seconds())

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
        found = {path: info for path, info in found.items() if not path.endswith("/")}  # a folder made in a console
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
        self.write(_PROBE, b"")
        self.remove([_PROBE])

    def remove_all(self) -> None:
        """Remove all files."""
        self.remove(self.files())

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
