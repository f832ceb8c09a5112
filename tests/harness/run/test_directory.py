from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest

from harness.run.directory import RunDirectory
from harness.run.manifest import ClipOfRun, RunManifest
from tests.disk import write_text
from tests.records import write_manifest
from vfoa.config import STEPS
from vfoa.errors import VfoaError


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A working directory with two runs."""
    for name in ("demo", "demo-2"):
        write_manifest(RunDirectory(tmp_path / "runs" / name), {})
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("project")
@pytest.mark.parametrize(
    ("place", "found"),
    [
        ("runs/demos", "found nothing there; did you mean 'runs/demo'? expected one of: runs/demo, runs/demo-2"),
        ("runs", "found no manifest.json in it; did you mean 'runs/demo'? expected one of: runs/demo, runs/demo-2"),
    ],
)
def test_what_is_no_run_says_where_runs_are(place: str, found: str) -> None:
    with pytest.raises(VfoaError) as error:
        RunDirectory(Path(place)).read_manifest()
    assert str(error.value) == f"{place}: expected a run's directory, {found}"


@pytest.mark.parametrize(
    ("manifest", "key"),
    [({"commit": 5}, "commit"), ({"notes": [{"text": "Ours.", "kind": "doubts"}]}, "notes.0.kind: .*'doubts'")],
)
def test_a_key_of_another_kind_is_refused(manifest: dict[str, Any], key: str, tmp_path: Path) -> None:
    write_manifest(RunDirectory(tmp_path), manifest)
    with pytest.raises(VfoaError, match=key):
        RunDirectory(tmp_path).read_manifest()


@pytest.mark.parametrize("table", STEPS)
def test_no_step_can_be_off(table: str, tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path)
    write_manifest(directory, {"configurations": {"one": {"stereo": None, table: None}}})
    with pytest.raises(VfoaError, match=rf"one\.{table}: found None"):
        directory.read_manifest()


def test_a_copied_project_has_its_own_clips(tmp_path: Path) -> None:
    first, run = tmp_path / "first", Path("runs/demo")
    place = first / "datasets" / "talk.toml"
    write_text(place, 'name = "talk"')
    clip = ClipOfRun(name="talk", manifest=str(place), frames=[1])
    RunDirectory(first / run).write_manifest(RunManifest(clips=[clip]))
    shutil.copytree(first, tmp_path / "copy")
    shutil.copytree(first / run, tmp_path / "results")
    expected = {"first/runs/demo": "first", "copy/runs/demo": "copy", "results": "first"}
    found = {name: RunDirectory(tmp_path / name).read_manifest().clips[0].manifest for name in expected}
    assert found == {name: str(tmp_path / project / "datasets" / "talk.toml") for name, project in expected.items()}
