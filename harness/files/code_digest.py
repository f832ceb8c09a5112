"""Digests of the code that a result depends on: a module and everything that it imports, directly or not.

Imports are read from the source, wherever they are in it. No module is imported for that.
"""

from __future__ import annotations

import ast
import hashlib
import platform
from collections.abc import Iterable, Iterator, Mapping
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from importlib.metadata import packages_distributions, version
from importlib.util import find_spec, resolve_name
from pathlib import Path

from harness.files.digests import file_digest


@cache
def code_of(module: str) -> tuple[str, dict[str, str]]:
    """The digest of a module's source with everything that it imports of its own package and of vfoa; and versions.

    The versions are those of the distributions that this code imports, of Python, and the kind of machine.
    """
    sources, outside = import_closure((module,))
    return _digest(sources), _versions(outside)


@cache
def code_digest(modules: tuple[str, ...]) -> str:
    """The digest of the source of several modules with all that they import of their own packages and of vfoa."""
    return _digest(import_closure(modules)[0])


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
            pending += _imports(name, path)
    return sources, outside


def _digest(sources: Mapping[str, Path]) -> str:
    total = hashlib.sha256()
    for name, path in sorted(sources.items()):
        total.update(f"{name}\0{file_digest(path)}\n".encode())
    return total.hexdigest()


def _source(module: str) -> Path | None:
    """A module's file; None if the name is no module but a name in one."""
    spec = _spec(module)
    return Path(spec.origin) if spec and spec.origin and spec.origin.endswith(".py") else None


def _spec(module: str) -> ModuleSpec | None:
    """Find a module without importing its parent packages, which ``find_spec`` would do."""
    package, _, name = module.rpartition(".")
    if not package:
        return find_spec(name)
    above = _spec(package)
    if above is None or above.submodule_search_locations is None:
        return None
    return PathFinder.find_spec(module, above.submodule_search_locations)


def _imports(module: str, path: Path) -> Iterator[str]:
    """Every name that a module imports, anywhere in its code; a name imported from a package may be a module."""
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    for node in _statements(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = "." * node.level + (node.module or "")
            name = resolve_name(start, package) if node.level else start
            yield name
            yield from (f"{name}.{alias.name}" for alias in node.names)


def _statements(tree: ast.Module) -> Iterator[ast.AST]:
    """Every statement, in any block: going through expressions too takes several times as long."""
    pending: list[ast.AST] = [tree]
    while pending:
        node = pending.pop()
        yield node
        for block in ("body", "orelse", "finalbody", "handlers", "cases"):
            pending += getattr(node, block, ())


def _versions(packages: set[str]) -> dict[str, str]:
    """Versions of the distributions of these packages, of Python, and the kind of machine."""
    distributions = {each for package in packages for each in _distributions().get(package, ())}
    found = {name: version(name) for name in sorted(distributions)}
    return {**found, "python": platform.python_version(), "machine": f"{platform.system()} {platform.machine()}"}


@cache
def _distributions() -> Mapping[str, list[str]]:
    return packages_distributions()
