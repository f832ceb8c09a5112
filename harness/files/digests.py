"""Digests of files, kept by the files' stamps: a file with the same stamp is not read again.

The stamp of a set of files is the path, size, times, inode and device of each. A change of content sets the time of the
last change (ctime), which no program can set back, so the same stamp means the same content. There is one exception: a
file that changes twice within one tick of its file system's clock keeps its stamp. Therefore, as in git's index, a
digest is kept only if the files had not changed for some time before they were read. Two cases are not noticed: a
memory-mapped write that shows late, and a file server whose clock is behind by more than that time.

A result also depends on code: on a module and everything that it imports, directly or not (:func:`code_digest`).
Imports are read from the source, wherever they are in it. No module is imported for that.
"""

from __future__ import annotations

import ast
import hashlib
import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial
from importlib.machinery import ModuleSpec
from importlib.metadata import Distribution, distributions
from importlib.util import find_spec, resolve_name
from pathlib import Path
from pkgutil import get_importer

from harness.files.io import opened
from harness.files.unchanged import LARGE_BYTES, note_stamp

SETTLED_NS = 3 * 10**9
"""Least age of the last change, ns, of a file whose digest is kept: the coarsest clock (FAT) ticks every 2 s."""


def settled_stamp(parts: Sequence[tuple[str, str]]) -> str | None:
    """The stamp of (role, file) pairs in order; None if one is missing, or has changed within :data:`SETTLED_NS`."""
    settled_ns = time.time_ns() - SETTLED_NS
    total, newest_ns = hashlib.blake2b(digest_size=20), 0
    try:
        for role, path in parts:
            status = os.stat(path)
            note_stamp(path, status)
            newest_ns = max(newest_ns, status.st_mtime_ns, status.st_ctime_ns)
            times = f"{status.st_mtime_ns} {status.st_ctime_ns}"
            total.update(f"{role}\0{path}\0{status.st_size} {times} {status.st_ino} {status.st_dev}\n".encode())
    except (OSError, ValueError):  # reading them gives the error
        return None
    return total.hexdigest() if newest_ns <= settled_ns else None


KNOWN: dict[str, str] = {}
"""Digests by the stamp of their files: those of this process, and those that an earlier one has noted."""
IMPORTED: dict[tuple[str, str], tuple[str, ...]] = {}
"""What code imports, by its module and the digest of its source: found by this process, or told by another one."""


_used: dict[str, str] | None = None


@contextmanager
def used_digests() -> Iterator[dict[str, str]]:
    """Collect the digests that are used in the block, by the stamp of their files."""
    global _used
    before, _used = _used, (used := dict[str, str]())
    try:
        yield used
    finally:
        _used = before


def digest_by_stamp(parts: Sequence[tuple[str, str]], read: Callable[[], str]) -> str:
    """The digest of (role, file) pairs: the known one, else that of ``read``, which reads the files."""
    stamp = settled_stamp(parts)
    if stamp is None:
        return read()
    digest = KNOWN[stamp] = KNOWN.get(stamp) or read()
    if _used is not None:
        _used[stamp] = digest
    return digest


def file_digest(path: Path) -> str:
    """Hexadecimal sha256 of a file's content; an error (:func:`opened`) names the file if it cannot be read.

    A large file is not read again while its stamp is the same (:mod:`harness.files.digests`).
    """
    with opened(path) as file:
        if os.fstat(file.fileno()).st_size <= LARGE_BYTES:  # a clip has many: no buffer for each
            return hashlib.sha256(file.read()).hexdigest()
    return digest_by_stamp([("large", os.fspath(path))], partial(_digest_of_large, path))


def _digest_of_large(path: Path) -> str:
    with opened(path) as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def digest_files(parts: Iterable[tuple[str, Path]]) -> str:
    """Hexadecimal sha256 of (role, file) pairs in order: of the roles and the contents, not of the paths.

    The files are not read again while their stamps are the same (:mod:`harness.files.digests`).
    """
    files = [(role, os.fspath(path)) for role, path in parts]  # text takes a third of the memory of paths
    return digest_by_stamp(files, partial(_digest_of_all, files))


def _digest_of_all(parts: Sequence[tuple[str, str | Path]]) -> str:
    total = hashlib.sha256()
    for role, path in parts:
        total.update(f"{role}\0{file_digest(Path(path))}\n".encode())
    return total.hexdigest()


@cache
def code_of(module: str) -> tuple[str, dict[str, str]]:
    """The digest of a module's source with everything that it imports of its own package and of vfoa; and versions.

    The versions are those of the distributions that this code imports, of Python, and the kind of machine.
    """
    sources, outside = import_closure((module,))
    return _digest_of_all(sorted(sources.items())), _versions(outside)


@cache
def code_digest(modules: tuple[str, ...]) -> str:
    """The digest of the source of several modules with all that they import of their own packages and of vfoa."""
    return _digest_of_all(sorted(import_closure(modules)[0].items()))


@cache
def own_code_digest(modules: tuple[str, ...]) -> str:
    """The digest of the source of several modules, without what they import."""
    sources = {name: _source(name) for name in modules}
    if missing := [name for name, path in sources.items() if path is None]:
        raise ValueError(f"no such module: {missing[0]}")
    return _digest_of_all([(name, path) for name, path in sources.items() if path])


def import_closure(modules: Iterable[str]) -> tuple[dict[str, Path], set[str]]:
    """The source files by module that these modules depend on, themselves included, and the other packages' names."""
    pending = list(modules)
    own = {*(name.partition(".")[0] for name in pending), "vfoa"}
    sources: dict[str, Path] = {}
    outside: set[str] = set()
    while pending:
        name = pending.pop()
        if name.partition(".")[0] not in own:
            outside.add(name.partition(".")[0])
        elif name not in sources and (path := _source(name)):
            sources[name] = path
            pending += _imports(name, path, file_digest(path))
    return sources, outside


def _source(module: str) -> Path | None:
    """A module's file; None if the name is not a module but a name in one."""
    spec = _spec(module)
    return Path(spec.origin) if spec and spec.origin and spec.origin.endswith(".py") else None


def _spec(module: str) -> ModuleSpec | None:
    """Find a module without importing its parent packages, which ``find_spec`` would do."""
    package, _, name = module.rpartition(".")
    if not package:
        return find_spec(name)
    above = _spec(package)
    folders: list[str] = []
    for location in above.submodule_search_locations or () if above else ():
        finder = get_importer(location)
        spec = finder.find_spec(module) if finder else None
        if spec and spec.loader:
            return spec
        folders += (spec.submodule_search_locations or ()) if spec else ()
    if not folders:
        return None
    namespace = ModuleSpec(module, None, is_package=True)  # PathFinder would need the package above to be imported
    namespace.submodule_search_locations = folders
    return namespace


def _imports(module: str, path: Path, digest: str) -> tuple[str, ...]:
    """Every name that a module imports, anywhere in its code; a name imported from a package may be a module."""
    if (module, digest) not in IMPORTED:
        package = module if path.name == "__init__.py" else module.rpartition(".")[0]
        IMPORTED[module, digest] = tuple(_imported(_statements(ast.parse(path.read_bytes())), package))
    return IMPORTED[module, digest]


def _imported(statements: Iterable[ast.AST], package: str) -> Iterator[str]:
    for node in statements:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = "." * node.level + (node.module or "")
            name = resolve_name(start, package) if node.level else start
            yield from (name, *(f"{name}.{alias.name}" for alias in node.names))


def _statements(module: ast.Module) -> Iterator[ast.AST]:
    """Every statement of a module, without its expressions, which ``ast.walk`` visits for most of its time."""
    pending: list[ast.AST] = [module]
    while pending:
        node = pending.pop()
        yield node
        for block in ("body", "handlers", "cases", "orelse", "finalbody"):
            pending += getattr(node, block, ())


def _versions(packages: set[str]) -> dict[str, str]:
    """Versions of the distributions of these packages, of Python, and the kind of machine."""
    named = {_name_and_version(distribution) for distribution, provided in _installed() if provided & packages}
    versions = dict(sorted(named))
    return {**versions, "python": platform.python_version(), "machine": f"{platform.system()} {platform.machine()}"}


@cache
def _name_and_version(distribution: Distribution) -> tuple[str, str]:
    return distribution.name, distribution.version


@cache
def _installed() -> list[tuple[Distribution, set[str]]]:
    """Every distribution with its packages, in a tenth of the time of ``packages_distributions``."""
    return [(distribution, _packages(distribution)) for distribution in distributions()]


def _packages(distribution: Distribution) -> set[str]:
    if declared := distribution.read_text("top_level.txt"):
        return {*declared.split()}
    files = (line.partition(",")[0] for line in (distribution.read_text("RECORD") or "").splitlines())
    return {file.partition("/")[0].removesuffix(".py") for file in files if file.endswith(".py")}
