"""The cache folder and the data folders.

Each value in the cache is a file: a checksum, then MessagePack. Cached files can be removed at any time: if a file is
missing, damaged or of another version, the value is computed again.

Data folders of the working directory come before those of the package.
"""

from __future__ import annotations

import hashlib
import logging
import os
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from harness.files.io import is_file_or_link, replacing
from vfoa.weights import platform_cache

if TYPE_CHECKING:
    import msgspec


VARIABLE = "VFOA_CACHE"
_CHECKSUM_BYTES = 16
_log = logging.getLogger(__name__)


def cache_root() -> Path:
    """``$VFOA_CACHE``, or the cache folder of the platform. Raises as :func:`vfoa.weights.platform_cache`."""
    return Path(os.environ.get(VARIABLE) or platform_cache())


UNWRITABLE: set[Path] = set()
"""Cache folders that were reported as such, in this process or by the one that has started it."""


def check_writable(root: Path) -> None:
    """Report a cache folder in which nothing can be stored, as :func:`warn_not_stored` does."""
    try:
        root.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=root):
            pass
    except OSError as error:
        warn_not_stored(root, error)


def warn_not_stored(root: Path, error: Exception) -> None:
    """Log that nothing can be stored in a cache folder, unless it was reported before: the run goes on, slower."""
    if root not in UNWRITABLE:
        UNWRITABLE.add(root)
        hint = f"set {VARIABLE} to a folder of your own"
        _log.warning("%s: results are not stored, the next run computes them again: %s; %s", root, error, hint)


def read_value(path: Path, kind: Any) -> Any | None:
    """Read a value of a type that msgspec knows; None if there is none."""
    import msgspec

    try:
        content = path.read_bytes()
    except OSError:
        return None
    if (body := unsealed(content)) is None:
        _log.warning("%s: damaged; it is made again", path)
        return None
    try:
        return _decoder(kind).decode(body)
    except msgspec.DecodeError:
        return None


def write_value(path: Path, value: object) -> None:
    """Store a value. It is not synced to the disk: the checksum shows what a power cut damages."""
    import msgspec

    with replacing(path) as draft:
        draft.write_bytes(sealed(msgspec.msgpack.encode(value)))


def sealed(body: bytes) -> bytes:
    """Bytes with their checksum in front."""
    return _checksum(body) + body


def unsealed(content: bytes) -> memoryview | None:
    """What :func:`sealed` was given; None if it is damaged."""
    body = memoryview(content)[_CHECKSUM_BYTES:]
    return body if _checksum(body) == content[:_CHECKSUM_BYTES] else None


def _checksum(body: bytes | memoryview) -> bytes:
    return hashlib.blake2b(body, digest_size=_CHECKSUM_BYTES).digest()


@cache
def _decoder(kind: Any) -> msgspec.msgpack.Decoder[Any]:
    import msgspec

    return msgspec.msgpack.Decoder(kind)


Kind = Literal["datasets", "annotations", "experiments"]

_PACKAGE = Path(__file__).parent.parent
_SUFFIX: dict[Kind, str] = {"datasets": ".toml", "annotations": ".csv", "experiments": ".toml"}


def folders(kind: Kind) -> list[Path]:
    """Every folder that may hold files of this kind, in search order; some may not exist."""
    if kind == "experiments":
        return [Path.cwd() / kind, _PACKAGE / kind]
    places = [Path.cwd() / kind, _PACKAGE / "_data" / kind]
    # Beside an installed package, "datasets" would belong to something else; beside a checkout it is ours.
    if (_PACKAGE.parent / "pyproject.toml").is_file():
        places.append(_PACKAGE.parent / kind)
    return places


def came_with_program(manifest: Path) -> bool:
    """Whether a manifest is the program's own, of an installed package or a checkout: nothing is written there.

    In the checkout itself, its data can be changed.
    """
    own, *of_program = (folder.resolve() for folder in folders("datasets"))
    folder = manifest.resolve().parent
    return folder != own and folder in of_program


def find(kind: Kind, name: str) -> Path | None:
    """The file of this kind called ``name`` (without its suffix), or None."""
    candidates = (folder / f"{name}{_SUFFIX[kind]}" for folder in folders(kind))
    return next((path for path in candidates if is_file_or_link(path)), None)


OTHER_RUNS = "benchmark", "paper_cases"
"""What ``vfoa run`` runs that is no file of an experiment."""


def is_run_of_program(name: str) -> bool:
    """Whether ``vfoa run NAME`` runs what came with the program, not an experiment of the working directory."""
    return name in OTHER_RUNS or find("experiments", name) == _PACKAGE / "experiments" / f"{name}.toml"


def names(kind: Kind) -> dict[str, Path]:
    """All files of this kind by name, sorted; if two folders have the same name, the one that :func:`find` returns.

    Hidden files, such as macOS's ``._talk.toml`` on shared disks, are left out.
    """
    paths: dict[str, Path] = {}
    for folder in reversed(folders(kind)):
        with suppress(OSError), os.scandir(folder) as entries:  # asks the disk for no file: each clip is looked up here
            files = (entry.name for entry in entries if entry.name.endswith(_SUFFIX[kind]) and not entry.is_dir())
            paths.update((name.removesuffix(_SUFFIX[kind]), folder / name) for name in files if name[0] != ".")
    return dict(sorted(paths.items()))
