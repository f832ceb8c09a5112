"""The rooms of the harness in order, imports that run one way without cycles, and one door for each outside package."""

from __future__ import annotations

import ast
import builtins
import re
import sys
import tomllib
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent

ROOMS = (
    "files",
    "",
    "server",
    "sources",
    "studio",
    "labels",
    "clips",
    "pipeline",
    "run",
    "score",
    "record",
    "report",
    "api",
    "annotate",
    "bench",
    "cli",
    "__main__",
)
"""Folders of ``harness/``, each of which may import those before it. "" are the modules of ``harness/`` itself, but for
``api.py``, which opens the rooms before it to scripts, and ``__main__.py``, which runs the command."""

# package -> the files (or folders) that may import it
DOORS = {
    "rerun": ("harness/record/", "harness/api.py"),
    "rerun_cli": ("harness/record/",),
    "mcap": ("harness/sources/recordings/",),
    "OpenEXR": ("harness/sources/media/maps.py",),
    "rosbags": ("harness/sources/recordings/",),
    "av": (
        "harness/sources/recordings/video.py",
        "harness/sources/media/images.py",
        "harness/sources/media/matroska.py",
        "harness/sources/media/film.py",
        "harness/record/images.py",
        "harness/clips/export.py",
    ),
    "mcap_protobuf": ("harness/sources/recordings/messages.py",),
    "onnxruntime": ("vfoa/onnx.py",),
    "typer": ("harness/cli/",),
    "pympi": ("harness/labels/formats/elan.py",),
    "distributed": ("harness/run/executors/cluster.py",),
    "torch": ("harness/pipeline/export/",),
    "uvicorn": ("harness/server/local_server.py",),
    "tomlkit": ("harness/clips/manifest_text.py", "harness/run/fitted.py"),
    "onnx": ("harness/pipeline/export/",),
    "filterpy": ("vfoa/gaze_filter.py",),
    "open3d": ("harness/studio/raycast.py",),
    "fsspec": ("harness/files/remote.py",),
    "httpx": ("harness/files/download.py", "harness/record/viewer.py"),
    "starlette": (
        "harness/annotate/",
        "harness/record/web_app.py",
        "harness/server/",
    ),
    "jinja2": ("harness/report/page/render.py",),
    "matplotlib": ("harness/report/figures/",),
    "rich": ("harness/cli/", "harness/report/formats.py"),
    "pandas": ("harness/api.py", "harness/bench/stages.py"),
    "msgspec": (
        "harness/files/folders.py",
        "harness/files/coco.py",
        "harness/files/coco_masks.py",
        "harness/files/parsing.py",
        "harness/labels/formats/label_studio.py",
        "harness/labels/formats/via.py",
        "harness/pipeline/stage_files/coco_instances.py",
        "harness/pipeline/stage_files/coco_panoptic.py",
        "harness/record/verdict_layer.py",
        "harness/report/",
        "harness/pipeline/cache_store.py",
    ),
    "zstandard": (
        "harness/pipeline/cache_store.py",
        "harness/sources/recordings/containers.py",
        "harness/sources/recordings/bags.py",
        "harness/studio/store.py",
    ),
    "pyarrow": (
        "harness/record/",
        "harness/run/table_files.py",
        "harness/run/tables.py",
        "harness/pipeline/stage_files/answer_tables.py",
        "harness/run/timings.py",
        "harness/api.py",
    ),
    "yaml": ("harness/files/parsing.py", "harness/sources/calibration_files/documents.py"),
    "platformdirs": ("vfoa/weights.py", "harness/files/folders.py", "harness/studio/store.py"),
}


def _sources(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def _imports(path: Path) -> frozenset[str]:
    """Every module that a file imports, anywhere in its code; a name that is imported from a package may be one."""
    found: set[str] = set()
    for node in ast.walk(_tree(path)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            inside = {f"{node.module}.{alias.name}" for alias in node.names} & _modules().keys()
            found |= inside or {node.module}
    return frozenset(found)


@cache
def _modules() -> dict[str, Path]:
    """The files of both packages by module."""
    return {_name(path): path for path in [*_sources("vfoa"), *_sources("harness")]}


def _within(path: Path, places: tuple[str, ...]) -> bool:
    return path.relative_to(ROOT).as_posix().startswith(places)


def test_the_library_does_not_know_the_harness() -> None:
    guilty = [path for path in _sources("vfoa") if any(name.split(".")[0] == "harness" for name in _imports(path))]
    assert not guilty


@pytest.mark.parametrize("package", DOORS)
def test_an_outside_package_has_one_door(package: str) -> None:
    importers = [
        path
        for path in [*_sources("vfoa"), *_sources("harness")]
        if any(name.split(".")[0] == package for name in _imports(path))
    ]
    assert [path for path in importers if not _within(path, DOORS[package])] == []


def test_what_is_imported_is_declared() -> None:
    """A package that comes with another one is declared as well: the other may stop bringing it."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    declared = [
        *project["dependencies"],
        *(each for extra in project["optional-dependencies"].values() for each in extra),
    ]
    names = {re.split(r"[^\w.-]", line, maxsplit=1)[0].replace("_", "-").lower() for line in declared}
    shipped = _modules().values()
    imported = {name.split(".")[0] for path in shipped for name in _imports(path)}
    outside = imported - sys.stdlib_module_names - {"vfoa", "harness"}
    providing = packages_distributions()
    providers = {
        module: {name.replace("_", "-").lower() for name in providing.get(module, [module])} for module in outside
    }
    assert len(outside) > 20
    assert {module: found for module, found in providers.items() if not found & names} == {}


def _name(path: Path) -> str:
    return path.relative_to(ROOT).with_suffix("").as_posix().removesuffix("/__init__").replace("/", ".")


def _room(module: str) -> str:
    """The room of a module of the harness."""
    name = module.split(".")[1] if "." in module else ""
    return name if name in ROOMS else ""


@pytest.fixture(scope="module")
def imported() -> dict[str, set[str]]:
    """By module of both packages, the other modules of them that it imports."""
    return {name: set(_imports(path) & _modules().keys()) - {name} for name, path in _modules().items()}


def test_every_folder_of_the_harness_is_a_room() -> None:
    folders = {path.name for path in (ROOT / "harness").iterdir() if (path / "__init__.py").is_file()}
    without_init = {path.parent.name for path in (ROOT / "harness").glob("*/*.py")}
    assert folders | without_init == set(ROOMS) - {"", "api", "__main__"}


def test_no_room_imports_a_later_one(imported: dict[str, set[str]]) -> None:
    upward = [
        f"{module} -> {target}"
        for module, targets in imported.items()
        for target in sorted(targets)
        if module.startswith("harness") and target.startswith("harness")
        if ROOMS.index(_room(target)) > ROOMS.index(_room(module))
    ]
    assert upward == []


def test_no_imports_run_in_a_circle(imported: dict[str, set[str]]) -> None:
    """Modules that import nothing are removed repeatedly; the modules that remain form a cycle."""
    left = dict(imported)
    while leaves := [module for module, targets in left.items() if not targets & left.keys()]:
        for module in leaves:
            del left[module]
    assert sorted(left) == []


def test_types_stand_at_the_bottom_and_the_pipeline_on_top() -> None:
    types = {name for name in _imports(ROOT / "vfoa" / "types.py") if name.startswith("vfoa")}
    geometry = {name for name in _imports(ROOT / "vfoa" / "geometry.py") if name.startswith("vfoa")}
    importers = [path.name for path in _sources("vfoa") if "vfoa.pipeline" in set(_imports(path))]
    assert types == set()
    assert geometry == {"vfoa.recent", "vfoa.types"}
    assert not any(name.startswith("vfoa") for name in _imports(ROOT / "vfoa" / "recent.py"))
    assert importers == ["config.py", "estimator.py", "measured_follower.py"]  # what `import vfoa` gives


def test_a_class_is_the_only_one_of_its_name() -> None:
    """Also a private one: who reads a name in one file expects the same meaning in the next."""
    places: dict[str, list[str]] = {}
    for module, path in _modules().items():
        for node in _tree(path).body:
            if isinstance(node, ast.ClassDef):
                places.setdefault(node.name.lstrip("_"), []).append(module)
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


@cache
def _names(path: Path) -> frozenset[str]:
    """Every name that a file defines or imports, in any scope, attributes and keys of tables included."""
    found: set[str] = set()
    for node in ast.walk(_tree(path)):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            found.add(node.id if isinstance(node, ast.Name) else node.attr)
        elif isinstance(node, ast.alias):
            found.add(node.asname or node.name)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.isidentifier():
            found.add(node.value)
    return frozenset(found)


def _is_found(reference: str, path: Path) -> bool:
    """Whether a docstring of a file may name this: a module with what is in it, or names of the file or of Python."""
    parts = reference.split(".")
    module = next((".".join(parts[:n]) for n in range(len(parts), 0, -1) if ".".join(parts[:n]) in _modules()), "")
    if module:
        return set(parts[module.count(".") + 1 :]) <= _names(_modules()[module])
    own = _names(path) | set(dir(builtins)) | sys.stdlib_module_names
    missing = set(parts) - own
    if parts[0] in sys.stdlib_module_names or not missing:
        return True
    inherited = (_names(_modules()[name]) for name in _imports(path) & _modules().keys())
    return parts[0] in own and missing <= set().union(*inherited)


def test_what_a_docstring_refers_to_is_there() -> None:
    role = re.compile(r":(?:func|class|mod|data|attr|meth|exc):`~?([^`]+)`")
    places = {(module, name) for module, path in _modules().items() for name in role.findall(path.read_text("utf-8"))}
    assert len(places) > 200
    assert [(module, name) for module, name in sorted(places) if not _is_found(name, _modules()[module])] == []


def test_an_index_of_a_folder_names_its_files() -> None:
    """An index is in the docstring of ``__init__``: lines of a name, or several, and what is there."""
    line = re.compile(r"^(\w+(?:, \w+)*)/? {2,}\S", re.MULTILINE)
    texts = {path.parent: ast.get_docstring(_tree(path)) for path in _modules().values() if path.name == "__init__.py"}
    found = {folder: names for folder, text in texts.items() if (names := line.findall(text or ""))}
    indexes = {folder: {name for several in names for name in several.split(", ")} for folder, names in found.items()}
    there = {folder: {each.stem for each in folder.iterdir() if each.name[0] not in "._"} for folder in indexes}
    assert len(indexes) >= 3
    assert indexes == there


def _parameters(node: ast.AST) -> set[str]:
    """The parameters of a function, of the initializer of a class, or of a dataclass."""
    if isinstance(node, ast.ClassDef):
        begin = next(
            (each for each in node.body if isinstance(each, ast.FunctionDef) and each.name == "__init__"), None
        )
        fields = {
            each.target.id
            for each in node.body
            if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)
        }
        return fields if begin is None else _parameters(begin)
    assert isinstance(node, ast.FunctionDef)
    return {each.arg for each in ast.walk(node.args) if isinstance(each, ast.arg)}


def test_a_parameter_that_a_docstring_describes_is_one() -> None:
    section = re.compile(r"^Parameters\n-+\n(.*?)(?=^\w+\n-+$|\Z)", re.MULTILINE | re.DOTALL)
    described = [
        (module, node.name, name, _parameters(node))
        for module, path in _modules().items()
        for node in ast.walk(_tree(path))
        if isinstance(node, ast.FunctionDef | ast.ClassDef)
        for block in section.findall(ast.get_docstring(node) or "")
        for line in re.findall(r"^\w+(?:, \w+)*$", block, re.MULTILINE)
        for name in line.split(", ")
    ]
    assert len(described) > 200
    assert [(module, place, name) for module, place, name, known in described if name not in known] == []


def test_data_folders_hold_no_python() -> None:
    assert [path for folder in ("datasets", "annotations", "reports") for path in (ROOT / folder).rglob("*.py")] == []
