"""The project's formalities: a licence, a citation, release notes, one version, and a wheel that works elsewhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import sysconfig
import tomllib
import venv
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from importlib import metadata
from pathlib import Path

import pytest
import yaml

import vfoa
from scripts.release_notes import release_notes
from tests.repository import REPOSITORY


def test_the_version_is_the_same_everywhere() -> None:
    citation = yaml.safe_load((REPOSITORY / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["version"] == vfoa.__version__ == metadata.version("vfoa")


def test_release_notes_are_a_section_of_the_changelog() -> None:
    changelog = "# Changelog\n\n## Unreleased\n\n- new\n\n## [0.2.0] - 2026-01-01\n\n### Added\n\n- old\n"
    assert release_notes(changelog, "Unreleased") == "- new"
    assert release_notes(changelog, "0.2.0") == "### Added\n\n- old"
    with pytest.raises(SystemExit, match=r"no version '1\.0'"):
        release_notes(changelog, "1.0")
    assert release_notes((REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8"), "Unreleased")


def test_no_two_test_files_share_a_name() -> None:
    """Pytest imports them by their name alone: of two, it refuses the second, but only in a run of the whole suite."""
    names = [path.name for path in (REPOSITORY / "tests").rglob("test_*.py")]
    assert [name for name, count in Counter(names).items() if count > 1] == []


def test_what_a_trial_leaves_is_not_committed() -> None:
    if not (REPOSITORY / ".git").exists():
        pytest.skip("no clone: it is not known what is committed")
    listed = subprocess.run(["git", "ls-files"], cwd=REPOSITORY, capture_output=True, text=True, check=True).stdout
    at_the_top = {name for name in listed.splitlines() if "/" not in name and not name.startswith(".")}
    kinds = {Path(name).suffix for name in at_the_top - {"LICENSE", "Makefile"}}
    assert kinds <= {".md", ".toml", ".lock", ".cff", ".yml", ".sh"}
    assert {name for name in at_the_top if name.endswith(".yml")} == {"mkdocs.yml"}


def test_what_continuous_integration_calls_is_there() -> None:
    workflow = (REPOSITORY / ".github/workflows/ci.yml").read_text(encoding="utf-8")
    matrix = yaml.safe_load(workflow)["jobs"]["checks"]["strategy"]["matrix"]
    parts = [*matrix["part"], *(each["part"] for each in matrix["include"])]
    called = {target for part in parts for target in part.split()}
    makefile = (REPOSITORY / "Makefile").read_text(encoding="utf-8")
    assert called <= set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    hooks = (REPOSITORY / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    for path in re.findall(r"\btests/[\w/.]+", workflow + hooks):
        assert (REPOSITORY / path).exists(), path


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The ``vfoa`` program of a wheel in an environment of its own.

    The environment has the wheel's own files and, through one ``.pth`` line, the dependencies that this environment
    has: nothing is downloaded. Such a line does not read the ``.pth`` files in that folder, so the checkout's editable
    installation is out of reach.
    """
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder)]
    subprocess.run(build, cwd=REPOSITORY, check=True, capture_output=True)
    (wheel,) = folder.glob("vfoa-*.whl")
    environment = folder / "env"
    venv.create(environment)
    python = environment / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    pip = [sys.executable, "-m", "pip", "--python", python, "--disable-pip-version-check"]
    install = ["install", "--no-index", "--no-deps", "--no-compile", wheel]  # what is imported is compiled then
    subprocess.run([*pip, *install], check=True, capture_output=True)
    purelib = sysconfig.get_path("purelib", vars={"base": str(environment), "platbase": str(environment)})
    Path(purelib, "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
    return python.with_name("vfoa.exe" if os.name == "nt" else "vfoa")


def _closure(names: Iterable[str]) -> set[str]:
    """These distributions and all that they need, of those that this environment has."""
    found: set[str] = set()
    waiting = [*names]
    while waiting:
        name = re.split(r"[^\w.-]", waiting.pop(), maxsplit=1)[0]
        with suppress(metadata.PackageNotFoundError):
            if name not in found:
                waiting += [line for line in metadata.requires(name) or () if "extra ==" not in line]
                found.add(name)
    return found


@pytest.fixture(scope="module")
def library_alone(installed: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of links to the wheel's files and to what ``pip install vfoa`` brings along, and to nothing else."""
    folder = tmp_path_factory.mktemp("library")
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [path for name in _closure(project["dependencies"]) for path in metadata.files(name) or ()]
    places = {Path(sysconfig.get_path("purelib"), path.parts[0]) for path in wanted if path.parts[0] != ".."}
    (purelib,) = installed.parents[1].rglob("site-packages")
    for place in (*places, purelib / "vfoa", purelib / "harness"):
        if place.name != "__pycache__":
            (folder / place.name).symlink_to(place)
    return folder


def _alone(folder: Path, cwd: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Python without any site-packages but these."""
    program = [sys.executable, "-S", *arguments]
    variables = {**os.environ, "PYTHONPATH": str(folder)}
    variables.pop("PYTHONSAFEPATH", None)  # set by commands in this process; OpenCV needs "" first
    return subprocess.run(program, cwd=cwd, env=variables, capture_output=True, text=True, check=False)


def test_the_library_needs_no_package_of_the_harness(library_alone: Path, tmp_path: Path) -> None:
    code = """
import importlib, pkgutil, sys, vfoa
for module in pkgutil.walk_packages(vfoa.__path__, "vfoa."):
    if not module.name.endswith("__main__"):
        importlib.import_module(module.name)
print(vfoa.score(["cup"], ["cup"]).frr, *sorted({name.partition(".")[0] for name in sys.modules}))
"""
    done = _alone(library_alone, tmp_path, "-c", code)
    assert done.returncode == 0, done.stderr
    frr, *modules = done.stdout.split()
    assert float(frr) == 1
    assert "cv2" in modules
    assert not {"rerun", "open3d", "starlette", "pandas", "harness"} & set(modules)


def test_the_command_without_its_packages_says_what_to_install(library_alone: Path, tmp_path: Path) -> None:
    done = _alone(library_alone, tmp_path, "-m", "harness", "run", "demo")
    assert done.returncode == 1
    (line,) = done.stderr.splitlines()
    assert "pip install 'vfoa[harness]'" in line


def _run(program: Path, cwd: Path, *arguments: str) -> str:
    variables = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run([program, *arguments], cwd=cwd, env=variables, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_wheel_runs_the_demo_outside_the_checkout(installed: Path, tmp_path: Path) -> None:
    places = "from importlib.util import find_spec; print(find_spec('vfoa').origin, find_spec('harness').origin)"
    origins = _run(installed.with_name("python"), tmp_path, "-c", places).split()
    assert [Path(origin).is_relative_to(REPOSITORY) for origin in origins] == [False, False]
    printed = _run(installed, tmp_path, "run", "demo", "--clip", "studio_crowd", "--limit", "2", "--workers", "1")
    assert "Best of 6" in printed
    assert "sgbm-two" in (tmp_path / "runs/demo/frr.csv").read_text(encoding="utf-8")
