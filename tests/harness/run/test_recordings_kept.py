"""Runs that end while recordings are being closed: the same command writes every recording, with every frame."""

from __future__ import annotations

import errno
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from harness.record.layer_file import _StreamFile
from harness.report.sinks import composed_sinks
from harness.run import attend
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.records import FrameRecord
from harness.run.runner import prepare, run_plan
from tests.disk import write_text
from tests.experiments import TRUTH, experiment_of
from tests.recorded import values_of
from tests.records import tables_of
from vfoa.errors import VfoaError
from vfoa.segmentation.key_frames import KeyFrameSegmenter
from vfoa.types import Instances, StereoFrame

FRAMES = 2

# two segmentations, whose masks are in one file; two reconstructions
EXPERIMENT = experiment_of(["studio_table"], {"every": {}, "second": {"segmentation.every": 2}}, TRUTH)
RECORDINGS = {f"studio_table{part}.rrd" for part in ("", "__every", "__every.scene", "__second", "__second.scene")}


@pytest.fixture(scope="module")
def experiment(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_text(tmp_path_factory.mktemp("kept") / "kept.toml", EXPERIMENT)


def _run(experiment: Path, out: Path, *, retry_failed: bool = False) -> RunDirectory:
    loaded = load_experiment(str(experiment))
    plan = prepare(loaded, limit=FRAMES, sinks=composed_sinks(loaded.configurations))
    return run_plan(plan, out, workers=1, progress=lambda clip: None, retry_failed=retry_failed)


@contextmanager
def _copies_before_each_rename(out: Path, copies: Path) -> Iterator[None]:
    """Copy the directory as a kill would leave it before each recording or result gets its name."""
    replace = Path.replace

    def copy_first(path: Path, target: Path) -> Path:
        if target.suffix in (".rrd", ".parquet", ".csv") and target.is_relative_to(out):
            number = len(list(copies.iterdir()))
            shutil.copytree(out, copies / f"{number:02d} {target.name}")
        return replace(path, target)

    copies.mkdir()
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Path, "replace", copy_first)
        yield


@pytest.fixture(scope="module")
def killed(experiment: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[RunDirectory, list[Path]]:
    """A whole run, and what a kill would have left of it before each of its files got its name."""
    folder = tmp_path_factory.mktemp("killed")
    with _copies_before_each_rename(folder / "whole", folder / "copies"):
        whole = _run(experiment, folder / "whole")
    return whole, sorted((folder / "copies").iterdir())


_expected = cache(values_of)
"""The values of a recording of the whole run, read once for all tests."""


def _assert_whole(run: RunDirectory, whole: RunDirectory) -> None:
    assert {path.name for path in run.path.glob("*.rrd*")} == RECORDINGS
    assert tables_of(run) == tables_of(whole)
    for name in RECORDINGS:
        assert values_of(run.path / name) == _expected(whole.path / name), name
    assert not (run.path / "partial").exists()


def test_a_run_that_is_killed_while_recordings_are_closed_loses_none(
    experiment: Path, killed: tuple[RunDirectory, list[Path]]
) -> None:
    whole, copies = killed
    assert {path.name.split(" ", 1)[1] for path in copies} >= RECORDINGS
    assert len(copies) >= 2 * len(RECORDINGS) - 1
    for copy in copies:
        _assert_whole(_run(experiment, copy), whole)


@pytest.mark.parametrize("name", sorted(RECORDINGS))
def test_a_finished_run_without_one_of_its_recordings_goes_on(
    name: str, experiment: Path, killed: tuple[RunDirectory, list[Path]], tmp_path: Path
) -> None:
    whole, _ = killed
    shutil.copytree(whole.path, tmp_path / "out")
    (tmp_path / "out" / name).unlink()
    _assert_whole(_run(experiment, tmp_path / "out"), whole)


@pytest.mark.parametrize("code", [errno.EDQUOT, errno.EIO, errno.EFBIG])
def test_a_disk_that_fails_while_recordings_are_closed_loses_none(
    code: int,
    experiment: Path,
    killed: tuple[RunDirectory, list[Path]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    whole, _ = killed
    write = _StreamFile._write

    def fail(self: _StreamFile, content: bytes) -> None:
        if ".whole" in self._path.name or len(list(tmp_path.glob("out/*.rrd"))) > 2:
            self._error = OSError(code, "no more")
        else:
            write(self, content)

    with monkeypatch.context() as patched:
        patched.setattr(_StreamFile, "_write", fail)
        with pytest.raises(OSError, match="no more"):
            _run(experiment, tmp_path / "out")
    assert {path.name for path in (tmp_path / "out").glob("*.rrd")} < RECORDINGS
    _assert_whole(_run(experiment, tmp_path / "out"), whole)


def test_a_configuration_that_is_repeated_leaves_the_masks_of_the_others_in_the_shared_recording(
    experiment: Path, killed: tuple[RunDirectory, list[Path]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, _ = killed
    to_record = attend.to_record

    def fail_for_the_second(clip: str, configuration: str, *rest: Any) -> FrameRecord:
        if configuration == "second":
            raise VfoaError("out of memory")
        return to_record(clip, configuration, *rest)

    with monkeypatch.context() as patched:
        patched.setattr(attend, "to_record", fail_for_the_second)
        partly = _run(experiment, tmp_path / "out")
    assert [failure.configuration for failure in partly.read_manifest().failed] == ["second"]
    _assert_whole(_run(experiment, tmp_path / "out", retry_failed=True), whole)


def test_a_configuration_that_is_perceived_again_leaves_the_masks_of_the_others_in_the_shared_recording(
    experiment: Path, killed: tuple[RunDirectory, list[Path]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, _ = killed
    segment = KeyFrameSegmenter.segment

    def fail_at_the_end(self: KeyFrameSegmenter, frame: StereoFrame) -> Instances:
        if frame.index == FRAMES:
            raise VfoaError("out of memory")
        return segment(self, frame)

    with monkeypatch.context() as patched:
        patched.setattr(KeyFrameSegmenter, "segment", fail_at_the_end)
        partly = _run(experiment, tmp_path / "out")
    assert [failure.configuration for failure in partly.read_manifest().failed] == ["second"]
    assert values_of(partly.path / "studio_table.rrd") != _expected(whole.path / "studio_table.rrd")
    _assert_whole(_run(experiment, tmp_path / "out", retry_failed=True), whole)
