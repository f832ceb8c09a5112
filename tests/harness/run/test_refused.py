"""A run that is refused before a clip is perceived leaves nothing that the next one would be kept from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.run.directory import LOCK, RunDirectory, locked, missing_of, removed_if_refused
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from tests.disk import write_text
from tests.records import write_manifest
from vfoa.errors import VfoaError

EXPERIMENT = """
clips = ["studio_table"]
[[configuration]]
name = "files"
stereo = { matcher = "files", root = "maps", pattern = "%04d.npy", partial = true }
segmentation.model = "truth"
heads.detector = "truth"
head_pose.model = "none"
gaze.model = "truth"
"""


def _run(out: Path) -> RunDirectory:
    plan = prepare(load_experiment("files.toml"), limit=2)
    return run_plan(plan, out, workers=1, progress=lambda clip: None, next_free=True)


@pytest.fixture
def map_of_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The damaged disparity of the first frame, in the working directory of an experiment that reads it."""
    monkeypatch.chdir(tmp_path)
    write_text(tmp_path / "files.toml", EXPERIMENT)
    return write_text(tmp_path / "maps" / "0001.npy", "no map")


def test_the_command_takes_the_same_folder_after_the_repair(map_of_first: Path) -> None:
    out = Path("runs/files")
    with pytest.raises(VfoaError, match=r"0001\.npy"):
        _run(out)
    assert not Path("runs").exists()
    for path in (map_of_first, map_of_first.with_name("0002.npy")):
        np.save(path, np.full((436, 1024), 20, np.float32))
    assert _run(out).path == out
    assert [path.name for path in Path("runs").iterdir()] == ["files"]


def test_a_folder_that_was_there_stays(map_of_first: Path) -> None:
    out = Path("runs/files")
    out.mkdir(parents=True)
    with pytest.raises(VfoaError, match=r"0001\.npy"):
        _run(out)
    assert list(Path("runs").rglob("*")) == [out]


def test_what_an_earlier_run_has_written_stays(map_of_first: Path) -> None:
    out = RunDirectory(Path("files"))
    write_manifest(out, {"experiment": "other"})
    with pytest.raises(VfoaError, match=r"0001\.npy"):
        _run(out.path)
    assert out.read_manifest().plain() == {"experiment": "other"}
    assert [path.name for path in Path().glob("files*") if path.is_dir()] == ["files"]


def test_so_it_does_after_a_repair_of_a_later_frame(map_of_first: Path) -> None:
    out, later = Path("runs/files"), map_of_first.with_name("0002.npy")
    np.save(map_of_first, np.full((436, 1024), 20, np.float32))
    write_text(later, "no map")
    with pytest.raises(VfoaError, match=r"0002\.npy"):
        _run(out)
    assert not Path("runs").exists()
    np.save(later, np.full((436, 1024), 20, np.float32))
    assert _run(out).path == out


@pytest.mark.parametrize("result", [None, "scenes/0/clip/frames.parquet", "answers/configuration/clip.parquet"])
def test_finished_clips_and_tracebacks_stay(result: str | None, tmp_path: Path) -> None:
    directory = RunDirectory(tmp_path / "run")
    pair = ("clip", "configuration")

    def refused() -> None:
        made = missing_of(directory.path)
        with locked(directory.path, print), removed_if_refused(directory, made):
            write_manifest(directory, {})
            write_text(directory.partial(pair, "csv.partial"), "{}\n")
            if result is not None:
                write_text(directory.path / result, "result")
            write_text(directory.traceback(pair), "Traceback")
            raise VfoaError("refused")

    with pytest.raises(VfoaError, match="refused"):
        refused()
    assert directory.traceback(pair).read_text() == "Traceback"
    assert directory.is_new() == (result is None)
    assert directory.manifest.exists() == directory.partial(pair, "csv.partial").exists() == (result is not None)


def test_a_lock_that_was_removed_meanwhile_is_no_lock(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from harness.run import directory

    def taken_late(file: object) -> bool:
        calls.append(file)
        if len(calls) == 1:
            (tmp_path / LOCK).unlink()
        return True

    calls: list[object] = []
    monkeypatch.setattr(directory, "take_lock", taken_late)
    with locked(tmp_path, print):
        assert "process" in (tmp_path / LOCK).read_text()
