"""The files of the stage cache, and the bytes in them: arrays and numbers exactly, and without code.

    <root>/stages/<stage>/<identity>/
      identity.json            everything that the results in this folder depend on
      000012-6f1e....bin       frame 12, and the digest of the stage's other inputs

``root`` is ``$VFOA_CACHE`` or the cache folder of the platform. Files appear whole, or not at all, with a checksum;
many processes may read and write at once. The least recently used are removed beyond a size.

The format is MessagePack. A value of :mod:`vfoa.types` is a map with its type's name, and an array its dtype, shape and
compressed bytes: the first bytes of all elements, then the second ones (which makes a map of disparities in sixteenths
much smaller).
"""

from __future__ import annotations

import dataclasses
import errno
import hashlib
import json
import logging
import os
import shutil
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import msgspec
import numpy as np
import zstandard
from numpy.typing import NDArray

from harness.files.folders import cache_root, sealed, unsealed
from harness.files.io import atomic_write, opened, read_bytes, replacing
from harness.files.parsing import parse_json
from harness.files.remote import local_folder
from vfoa.errors import VfoaError
from vfoa.stereo.region import Region
from vfoa.types import Disparity, Gaze, Head, HeadPose, Instance, Instances, NoGaze, StereoRig

GIGABYTE = 10**9
DEFAULT_LIMIT_GB = 10.0
DRAFT_SECONDS = 3600.0
"""No draft file is written for longer than this."""

_IDENTITY, _RESULT = "identity.json", ".bin"
_log = logging.getLogger(__name__)


def cache_limit() -> int:
    """Bytes that stage outputs may take: ``$VFOA_CACHE_GB`` gigabytes, or 10.

    Raises
    ------
    VfoaError
        If the variable is not a number of at least 0.
    """
    text = os.environ.get("VFOA_CACHE_GB") or str(DEFAULT_LIMIT_GB)
    try:
        limit = float(text)
    except ValueError:
        limit = -1.0
    if not 0 <= limit < float("inf"):
        raise VfoaError(f"VFOA_CACHE_GB: found {text!r}; expected a size in gigabytes")
    return int(limit * GIGABYTE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Usage:
    """Disk usage of one stage (``slot`` and ``name``) on one clip."""

    slot: str
    name: str
    clip: str
    files: int
    bytes: int


def open_store(place: str | Path | None = None) -> Store:
    """The store in a folder; by default in the cache folder of this machine.

    Raises
    ------
    VfoaError
        If ``$VFOA_CACHE_GB`` is no size, or the folder is an address.
    """
    return Store(local_folder(place, "--cache") if place else cache_root(), cache_limit())


@dataclass(frozen=True, slots=True)
class Store:
    """The results under a folder; it travels to other processes by pickle."""

    root: Path
    limit_bytes: int

    @property
    def stages(self) -> Path:
        """The folder of all stages."""
        return self.root / "stages"

    def folder(self, slot: str, identity: str) -> Path:
        """The folder of the outputs with one identity."""
        return self.stages / slot / identity

    def load(self, path: Path) -> memoryview | None:
        """Return an output's bytes; None if there are none, or if they are damaged, which is logged."""
        try:
            data = unsealed(read_bytes(path))
        except VfoaError:
            return None
        if data is None:
            warn_damaged(path)
            return None
        with suppress(OSError):  # the cache may be another user's, and read-only
            os.utime(path)  # the most recently used is removed last
        return data

    def save(self, path: Path, data: bytes) -> None:
        """Store a result. It is not forced to the disk: a checksum detects what a power cut damages.

        A result that the cache is cleared of while it is written is not stored.

        Raises
        ------
        OSError, VfoaError
            If it cannot be written.
        """
        with suppress(FileNotFoundError), replacing(path) as draft:
            draft.write_bytes(sealed(data))

    def pack(self, path: Path, files: Mapping[str, Path]) -> None:
        """Store files as one result, by their names in it. Raises as :meth:`save` does."""
        with suppress(FileNotFoundError), replacing(path) as draft, ZipFile(draft, "w") as packed:
            for name, file in files.items():
                packed.write(file, name)

    def unpack(self, path: Path, folder: Path) -> bool:
        """Write files that were packed into a new folder; False if there are none, or damaged, which is logged.

        Damaged ones are removed, so that they are packed again.
        """
        try:
            with opened(path) as file, ZipFile(file) as packed:
                if sum(each.file_size for each in packed.infolist()) > path.stat().st_size:
                    raise BadZipFile("compressed")
                packed.extractall(folder)
        except VfoaError:
            return False
        except Exception:  # any, in a damaged file
            shutil.rmtree(folder, ignore_errors=True)
            warn_damaged(path)
            with suppress(OSError):
                path.unlink()
            return False
        with suppress(OSError):
            os.utime(path)
        return True

    def describe(self, slot: str, identity: str, parts: dict[str, Any]) -> None:
        """Write the description of an identity beside its results. Raises as :meth:`save` does."""
        path = self.folder(slot, identity) / _IDENTITY
        if not path.exists():
            with suppress(FileNotFoundError):
                atomic_write(path, json.dumps(parts, indent=1, sort_keys=True))

    def described(self, slot: str) -> Iterator[tuple[Path, dict[str, Any]]]:
        """The folder and the description of each identity of a slot (``*``: of any); damaged ones are left out."""
        for path in sorted(self.stages.glob(f"{slot}/*/{_IDENTITY}")):
            parts = None
            with suppress(VfoaError):
                parts = parse_json(read_bytes(path), path)
            if isinstance(parts, dict) and {"stage", "clip"} <= parts.keys():
                yield path.parent, parts

    def usage(self) -> list[Usage]:
        """Disk usage by stage and clip, all settings together, largest first; undescribed outputs are left out."""
        sizes: dict[tuple[str, str, str], list[int]] = {}
        for folder, parts in self.described("*"):
            key = folder.parent.name, str(parts["stage"]), str(parts["clip"])
            results = (status.st_size for path, status in _files(folder) if path.endswith(_RESULT))
            sizes.setdefault(key, []).extend(results)
        usages = (
            Usage(slot=slot, name=name, clip=clip, files=len(own), bytes=sum(own))
            for (slot, name, clip), own in sizes.items()
        )
        return sorted(usages, key=lambda usage: -usage.bytes)

    def trim(self) -> None:
        """Remove the least recently used outputs until the rest is within the limit.

        Drafts that a killed process left are removed, too.
        """
        results, oldest_draft = [], time.time() - DRAFT_SECONDS
        for path, status in _files(self.stages):
            if path.endswith(_RESULT):
                results.append((status.st_mtime, status.st_size, path))
            elif f"{_RESULT}." in os.path.basename(path) and status.st_mtime < oldest_draft:
                with suppress(OSError):
                    os.unlink(path)
        results.sort()
        excess = sum(size for _, size, _ in results) - self.limit_bytes
        for _, size, path in results:
            if excess <= 0:
                break
            with suppress(OSError):
                os.unlink(path)
            excess -= size

    def clear(self) -> None:
        """Remove every result; those that a run stores meanwhile may stay.

        Raises
        ------
        VfoaError
            If the folder is a link: what it links to may be another's.
        OSError
            If something cannot be removed. It is no error if another process removes it meanwhile.
        """
        if self.stages.is_symlink():
            raise VfoaError(f"{self.stages}: found a symbolic link; expected a folder: clear the one that it links to")
        for place, folders, files in os.walk(self.stages, topdown=False, onerror=_raise_unless_gone):
            links = (name for name in folders if os.path.islink(os.path.join(place, name)))
            for name in (*files, *links):
                Path(place, name).unlink(missing_ok=True)
            try:
                os.rmdir(place)
            except OSError as error:
                if error.errno not in (errno.ENOENT, errno.ENOTEMPTY, errno.EEXIST):
                    raise


def _raise_unless_gone(error: OSError) -> None:
    if not isinstance(error, FileNotFoundError):
        raise error


def warn_damaged(path: Path) -> None:
    """Log that an output is not what was stored."""
    _log.warning("%s: damaged; its result is computed again", path)


def _files(folder: Path) -> Iterator[tuple[str, os.stat_result]]:
    """Every file under a folder; those that vanish meanwhile are left out. The cache of many clips has many files."""
    pending = [os.fspath(folder)]
    while pending:
        with suppress(OSError), os.scandir(pending.pop()) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    pending.append(entry.path)
                else:
                    with suppress(OSError):
                        yield entry.path, entry.stat()


_TYPE = "$type"
_ARRAY, _SCALAR = 1, 2


class Codec:
    """Converts frozen dataclasses of these types to bytes and back; also tuples, arrays, numbers, text, None.

    An array keeps the memory order of its axes: the order of a sum, and so its last bit, depends on it.
    """

    def __init__(self, types: Iterable[type[Any]]) -> None:
        self._types = {cls.__name__: cls for cls in types}

    def encode(self, value: object) -> bytes:
        """Encode a value as bytes.

        Raises
        ------
        TypeError
            If it holds a value of another type.
        """
        return msgspec.msgpack.encode(self._plain(value), enc_hook=_pack)

    def decode(self, data: bytes | memoryview) -> Any:
        """Return the value that :meth:`encode` was given, with the same types and equal to the last bit."""
        return self._value(msgspec.msgpack.decode(data, ext_hook=_unpack))

    def digest(self, *values: object) -> str:
        """Hexadecimal digest of the content of values, not of their identity. Raises as :meth:`encode` does."""
        total = hashlib.blake2b(digest_size=16)
        total.update(msgspec.msgpack.encode(self._plain(values), enc_hook=_raw))
        return total.hexdigest()

    def _plain(self, value: object) -> object:
        if dataclasses.is_dataclass(value) and self._types.get(type(value).__name__) is type(value):
            fields = {field.name: self._plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
            return {_TYPE: type(value).__name__, **fields}
        if isinstance(value, tuple | list):
            return [self._plain(element) for element in value]
        if value is None or type(value) in (bool, int, float, str) or isinstance(value, np.ndarray | np.generic):
            return value
        raise TypeError(f"expected the pipeline's values, arrays and numbers, found {type(value).__name__}")

    def _value(self, plain: Any) -> Any:
        if isinstance(plain, dict):
            fields = {name: self._value(field) for name, field in plain.items() if name != _TYPE}
            return self._types[plain[_TYPE]](**fields)
        return tuple(self._value(element) for element in plain) if isinstance(plain, list) else plain


_outputs = Codec((Disparity, Gaze, Head, HeadPose, Instance, Instances, NoGaze, Region, StereoRig))
encode, decode, content_digest = _outputs.encode, _outputs.decode, _outputs.digest


def _raw(value: object) -> msgspec.msgpack.Ext:
    code, array = _array(value)
    return msgspec.msgpack.Ext(code, msgspec.msgpack.encode((array.dtype.str, array.shape, array.tobytes())))


def _pack(value: object) -> msgspec.msgpack.Ext:
    code, array = _array(value)
    axes = (
        range(array.ndim) if array.flags.c_contiguous else np.argsort(np.negative(np.abs(array.strides)), stable=True)
    )
    ordered = array.transpose(axes)
    planes = np.ascontiguousarray(ordered).reshape(-1).view(np.uint8).reshape(array.size, array.itemsize).T.tobytes()
    packed = zstandard.ZstdCompressor(level=1).compress(planes)
    return msgspec.msgpack.Ext(
        code, msgspec.msgpack.encode((array.dtype.str, ordered.shape, [*map(int, axes)], packed))
    )


def _unpack(code: int, data: memoryview) -> NDArray[Any] | np.generic:
    text, shape, axes, packed = msgspec.msgpack.decode(data)
    dtype = np.dtype(text)
    planes = np.frombuffer(zstandard.ZstdDecompressor().decompress(packed), np.uint8).reshape(dtype.itemsize, -1)
    items = np.empty((planes.shape[1], dtype.itemsize), np.uint8)
    for byte, plane in enumerate(planes):  # a third of the time of a transposed copy
        items[:, byte] = plane
    array = items.reshape(-1).view(dtype).reshape(shape).transpose(np.argsort(axes))
    return array if code == _ARRAY else array[()]


def _array(value: object) -> tuple[int, NDArray[Any]]:
    if not isinstance(value, np.ndarray | np.generic) or value.dtype.kind not in "biuf":
        raise TypeError(f"expected the pipeline's values, arrays and numbers, found {type(value).__name__}")
    return (_ARRAY if isinstance(value, np.ndarray) else _SCALAR), np.asarray(value)
