"""Clips on other storage: copied once, again when they changed, and said in one line where they cannot be had."""

from __future__ import annotations

import uuid
from pathlib import Path

import fsspec
import numpy as np
import pytest
from typer.testing import CliRunner

from harness import load_run
from harness.cli import app
from harness.clips.manifest import load_manifest
from harness.files.remote import expand, is_address, local_copy
from tests.disk import stereo_pair_folder, write_text
from vfoa.errors import VfoaError

CAMERA = "camera = { fx_px = 50.0, cx_px = 31.5, cy_px = 23.5, baseline_m = 0.1 }"


@pytest.fixture
def bucket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """A storage in memory, empty, with a cache of its own."""
    monkeypatch.setenv("VFOA_CACHE", str(tmp_path / "cache"))
    local_copy.cache_clear()
    storage = fsspec.filesystem("memory")
    name = f"/{uuid.uuid4().hex}"
    yield storage, name
    if storage.exists(name):
        storage.rm(name, recursive=True)
    local_copy.cache_clear()


@pytest.mark.parametrize(
    ("text", "expected"),
    [("s3://bucket/clip", True), ("zip://clip::s3://bucket/a.zip", True), ("../data", False), ("C:\\clips", False)],
)
def test_an_address_names_its_storage(text: str, expected: bool) -> None:
    assert is_address(text) is expected


def test_a_clip_on_other_storage_is_the_same_clip(tmp_path: Path, bucket) -> None:
    storage, name = bucket
    here = stereo_pair_folder(tmp_path / "data")
    storage.put(f"{here}/", f"{name}/", recursive=True)
    source = f'[source]\nleft = "left"\nright = "right"\n{CAMERA}\n'
    for clip, root in (("near", here.as_posix()), ("far", f"memory:/{name}")):
        text = f'name = "{clip}"\nadapter = "stereo_folder"\nroot = "{root}"\n{source}'
        write_text(tmp_path / "datasets" / f"{clip}.toml", text)
    near, far = (load_manifest(tmp_path / "datasets" / f"{clip}.toml").open() for clip in ("near", "far"))
    assert list(near.frames) == list(far.frames) == [1, 2, 3]
    assert near.digest() == far.digest()
    for number in near.frames:
        np.testing.assert_array_equal(near.frame(number).left, far.frame(number).left)


@pytest.mark.parametrize("scheme", ["local", "file"])
def test_what_is_on_this_machine_is_read_in_place(bucket, tmp_path: Path, scheme: str) -> None:
    (private := tmp_path / "private").mkdir()
    (private / "a.png").touch(mode=0o600)
    assert local_copy(f"{scheme}://{private}", "root") == private
    assert local_copy(f"{scheme}://{private}/a.png", "root") == private / "a.png"
    with pytest.raises(VfoaError, match=rf"^root: {scheme}://{private}/b\.png: "):
        local_copy(f"{scheme}://{private}/b.png", "root")
    assert not (tmp_path / "cache").exists()


def test_copies_are_for_their_owner_alone(bucket) -> None:
    storage, name = bucket
    storage.pipe(f"{name}/a.png", b"a face")
    assert local_copy(f"memory:/{name}", "root").parent.stat().st_mode & 0o777 == 0o700


def test_a_name_that_leads_out_of_the_copy_is_refused(bucket, tmp_path: Path) -> None:
    storage, name = bucket
    storage.pipe(f"{name}/clip/a.txt", b"inside")
    evil = f"{name}/clip/../../../escaped.txt"
    storage.store[evil] = storage.store[f"{name}/clip/a.txt"]  # what an object store can hold, pipe would tidy up
    try:
        with pytest.raises(VfoaError, match=r"clip: .*'\.\./.*/escaped\.txt'"):
            local_copy(f"memory:/{name}/clip", "root")
    finally:
        del storage.store[evil]
    assert not list(tmp_path.rglob("escaped.txt"))


def test_what_changed_is_copied_again_and_what_is_gone_is_left_out(bucket) -> None:
    storage, name = bucket
    for file, text in (("a/kept.txt", "kept"), ("a/changed.txt", "old"), ("gone.txt", "gone")):
        storage.pipe(f"{name}/{file}", text.encode())
    first = local_copy(f"memory:/{name}", "here")
    kept = (first / "a" / "kept.txt").stat().st_mtime_ns
    assert (first / "a" / "changed.txt").read_text() == "old"
    storage.pipe(f"{name}/a/changed.txt", b"newer")
    storage.rm(f"{name}/gone.txt")
    local_copy.cache_clear()
    second = local_copy(f"memory:/{name}", "here")
    assert second == first
    assert sorted(path.name for path in second.rglob("*.txt")) == ["changed.txt", "kept.txt"]
    assert (second / "a" / "changed.txt").read_text() == "newer"
    assert (second / "a" / "kept.txt").stat().st_mtime_ns == kept


def test_a_folder_made_in_a_console_and_hidden_files_are_no_files_of_a_clip(bucket) -> None:
    storage, name = bucket
    storage.pipe(f"{name}/left/a.png", b"a face")
    storage.pipe(f"{name}/.lock", b"of a run")
    storage.pipe(f"{name}/.unfinished/part", b"of a run")
    marker = f"{name}/left/"  # an object of this name is what "Create folder" makes on object storage
    storage.store[marker] = storage.store[f"{name}/left/a.png"]
    try:
        copied = local_copy(f"memory:/{name}", "root")
        assert [path.relative_to(copied).as_posix() for path in copied.rglob("*")] == ["left", "left/a.png"]
    finally:
        del storage.store[marker]


def test_a_single_file_keeps_its_name(bucket) -> None:
    storage, name = bucket
    storage.pipe(f"{name}/take.mcap", b"recorded")
    copied = expand(f"memory:/{name}/take.mcap", Path("elsewhere"), "here")
    assert (copied.name, copied.read_bytes()) == ("take.mcap", b"recorded")


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("memory://nowhere/at/all", "no such file or folder"),
        ("nosuch://bucket/clip", "unknown storage: "),
        ("zip://clip::file:///nowhere.zip", "no such file or folder"),
    ],
)
def test_what_cannot_be_had_is_one_line(address: str, said: str, bucket) -> None:
    with pytest.raises(VfoaError) as refused:
        local_copy(address, "mine.toml: root")
    assert str(refused.value).startswith(f"mine.toml: root: {address}: {said}")
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("option", ["--out", "--cache"])
def test_runs_and_caches_are_folders(option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["run", "demo", option, "s3://bucket/x"])
    assert isinstance(done.exception, VfoaError)
    assert str(done.exception).startswith(f"{option} s3://bucket/x: ")
    assert not list(tmp_path.iterdir())


def test_a_run_at_an_address_is_refused() -> None:
    with pytest.raises(VfoaError, match=r"^load_run: s3://bucket/x: "):
        load_run("s3://bucket/x")
