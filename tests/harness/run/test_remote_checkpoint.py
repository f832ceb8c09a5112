"""Published checkpoints: another machine gets the files as far as they belong to the last checkpoint."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from harness.clips.naming import SubjectNames
from harness.remote import Remote
from harness.run.checkpoint import Checkpoint, SinkState, write_checkpoint
from harness.run.clip_job import ClipJob, checkpoints
from harness.run.directory import RunDirectory
from harness.run.partial_results import ResultsSinks
from harness.run.remote_checkpoint import UNFINISHED, RemoteCheckpoint
from vfoa.errors import VfoaError
from vfoa.pipeline import Memory

PAIR = "alley", "bm"
LINES = "partial/alley__bm.jsonl.partial"


def _job(folder: Path) -> ClipJob:
    manifest: Any = SimpleNamespace(name=PAIR[0])
    configurations: Any = (SimpleNamespace(name=PAIR[1]),)
    return ClipJob(
        manifest=manifest,
        frames=(1, 2, 3),
        labels=None,
        configurations=configurations,
        directory=RunDirectory(folder),
        sinks=(ResultsSinks(),),
    )


def _reach(job: ClipJob, frame: int, lines: bytes, beyond: bytes = b"") -> None:
    """Write the files of a job that has a checkpoint after a frame, and has gone on beyond it."""
    path = job.directory.path / LINES
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(lines + beyond)
    state = SinkState(files={LINES: len(lines)})
    (name,) = job.sink_names
    found = Checkpoint(
        frame=frame, written=frame, memory=Memory(), names=SubjectNames(), window=None, sinks={name: state}
    )
    write_checkpoint(job.directory, PAIR, found)


def _fetched(address: str, folder: Path) -> tuple[bytes | None, int | None]:
    """The lines that another machine gets, and the frame that it continues after."""
    job = _job(folder)
    RemoteCheckpoint(address, job).fetch()
    path = folder / LINES
    found = checkpoints(job).get(PAIR[1])
    return path.read_bytes() if path.exists() else None, found.frame if found else None


def test_another_machine_continues_after_the_last_checkpoint(address: str, tmp_path: Path) -> None:
    job = _job(tmp_path / "first")
    published = RemoteCheckpoint(address, job)
    published.publish()
    assert _fetched(address, tmp_path / "none") == (None, None)
    _reach(job, 1, b"one\n", beyond=b"tw")
    published.publish()
    assert _fetched(address, tmp_path / "second") == (b"one\n", 1)
    _reach(job, 2, b"one\ntwo\n", beyond=b"three\n")
    published.publish()
    assert _fetched(address, tmp_path / "third") == (b"one\ntwo\n", 2)
    published.remove()
    assert Remote(f"{address}/{UNFINISHED}").files() == {}


def test_only_what_was_added_is_uploaded(address: str, tmp_path: Path) -> None:
    job, long = _job(tmp_path), b"x" * 10_000
    published = RemoteCheckpoint(address, job)
    _reach(job, 1, long)
    published.publish()
    first = set(Remote(f"{address}/{UNFINISHED}").files())
    _reach(job, 2, long + b"two\n")
    published.publish()
    second = Remote(f"{address}/{UNFINISHED}").files()
    assert max(info["size"] for name, info in second.items() if name not in first) < len(long)
    assert len(second) == len(first) + 1  # the checkpoint before is removed


def test_a_worker_that_comes_back_does_not_mix_with_the_one_that_continued(address: str, tmp_path: Path) -> None:
    lost, job = _job(tmp_path / "lost"), _job(tmp_path / "other")
    of_lost, continued = RemoteCheckpoint(address, lost), RemoteCheckpoint(address, job)
    _reach(lost, 1, b"one\n")
    of_lost.publish()
    continued.fetch()
    _reach(job, 2, b"one\nother\n")
    continued.publish()
    _reach(lost, 3, b"one\nlost\nthree\n")
    of_lost.publish()
    assert _fetched(address, tmp_path / "third") == (b"one\nlost\nthree\n", 3)
    _reach(job, 3, b"one\nother\nthree\n")
    continued.publish()
    assert _fetched(address, tmp_path / "fourth") == (b"one\nother\nthree\n", 3)


def test_a_part_that_is_gone_makes_the_job_begin_again(address: str, tmp_path: Path) -> None:
    job = _job(tmp_path / "first")
    _reach(job, 1, b"one\n")
    RemoteCheckpoint(address, job).publish()
    remote = Remote(f"{address}/{UNFINISHED}")
    remote.remove(
        [name for name in remote.files() if not name.endswith("index.json") and remote.read(name) == b"one\n"]
    )
    assert _fetched(address, tmp_path / "second") == (b"", None)


def test_a_checkpoint_of_this_machine_is_offered_but_replaces_none(address: str, tmp_path: Path) -> None:
    here, elsewhere = _job(tmp_path / "here"), _job(tmp_path / "elsewhere")
    _reach(here, 1, b"one\n")
    RemoteCheckpoint(address, here).offer()
    assert _fetched(address, tmp_path / "second") == (b"one\n", 1)
    _reach(elsewhere, 2, b"one\ntwo\n")
    RemoteCheckpoint(address, elsewhere).publish()
    RemoteCheckpoint(address, here).offer()
    assert _fetched(address, tmp_path / "third") == (b"one\ntwo\n", 2)


def test_pictures_of_frames_go_to_their_places_in_the_run(address: str, tmp_path: Path) -> None:
    job = _job(tmp_path)
    _reach(job, 1, b"one\n")
    (tmp_path / "thumbnails").mkdir()
    (tmp_path / "thumbnails" / "1.webp").write_bytes(b"a picture")
    (tmp_path / "thumbnails" / "lines.jsonl.partial").write_bytes(b"unfinished")
    RemoteCheckpoint(address, job).publish()
    files = [name for name in Remote(address).files() if not name.startswith(UNFINISHED)]
    assert files == ["thumbnails/1.webp"]


@pytest.mark.parametrize("index", [b"[1]", b'{"../out": [["a", 1]]}', b'{"a": [["/out", 1]]}', b'{"a": 1}', b"{"])
def test_an_index_of_another_shape_is_refused(index: bytes, address: str, tmp_path: Path) -> None:
    job = _job(tmp_path / "first")
    _reach(job, 1, b"one\n")
    RemoteCheckpoint(address, job).publish()
    (name,) = [name for name in Remote(f"{address}/{UNFINISHED}").files() if name.endswith("index.json")]
    Remote(f"{address}/{UNFINISHED}").write(name, index)
    with pytest.raises(VfoaError, match=r"index\.json: "):
        _fetched(address, tmp_path / "second")
    assert not (tmp_path / "out").exists()
