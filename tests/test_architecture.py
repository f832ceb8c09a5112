"""Imports run one way, and each outside package has its one door."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent

# package -> the files (or folders) that may import it
DOORS = {
    "rerun": ("harness/recording/", "harness/bench/naive.py"),
    "rerun_cli": ("harness/recording/",),
    "mcap": ("harness/adapters/mcap/", "harness/bench/mcap_memory.py"),
    "mcap_ros2": ("harness/adapters/mcap/",),
    "mcap_protobuf": ("harness/adapters/mcap/",),
    "onnxruntime": ("vfoa/onnx.py",),
    "typer": ("harness/cli/",),
    "pympi": ("harness/annotation_formats/elan.py",),
    "distributed": ("harness/runs/executors/cluster.py",),
    "torch": ("harness/export/",),
    "uvicorn": ("harness/local_server.py",),
    "tomlkit": ("harness/annotate/targets.py",),
    "onnx": ("harness/export/",),
    "filterpy": ("vfoa/gaze_filter.py",),
    "open3d": ("harness/adapters/studio/raycast.py",),
    "fsspec": ("harness/clips/remote.py",),
    "httpx": ("harness/models/download.py", "harness/recording/web_viewer.py"),
    "starlette": ("harness/annotate/", "harness/recording/site.py", "harness/local_server.py"),
    "jinja2": ("harness/report/page.py",),
    "matplotlib": ("harness/figures.py", "harness/report/", "harness/sweep/report.py"),
    "rich": ("harness/cli/", "harness/report/formats.py", "harness/bench/"),
    "pandas": ("harness/bench/stages.py",),
    "msgspec": ("harness/runs/results.py", "harness/stills/", "harness/cache/values.py"),
    "zstandard": ("harness/cache/values.py",),
    "pyarrow": ("harness/recording/",),
    "yaml": ("harness/adapters/",),
    "platformdirs": ("vfoa/weights.py", "harness/cache/store.py", "harness/adapters/studio/store.py"),
}


def _sources(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def _imports(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module


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


def test_the_command_line_is_imported_by_nobody() -> None:
    guilty = [
        path
        for path in _sources("harness")
        if not _within(path, ("harness/cli/",))
        and any(f"{name}.".startswith("harness.cli.") for name in _imports(path))
    ]
    assert not guilty


def test_types_stand_at_the_bottom_and_the_pipeline_on_top() -> None:
    types = {name for name in _imports(ROOT / "vfoa" / "types.py") if name.startswith("vfoa")}
    geometry = {name for name in _imports(ROOT / "vfoa" / "geometry.py") if name.startswith("vfoa")}
    importers = [path for path in _sources("vfoa") if "vfoa.pipeline" in set(_imports(path))]
    assert types == set()
    assert geometry == {"vfoa.types"}
    assert importers == []


def test_data_folders_hold_no_python() -> None:
    assert [path for folder in ("datasets", "annotations", "reports") for path in (ROOT / folder).rglob("*.py")] == []
