from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from harness.pipeline.cache_store import Store, cache_limit
from vfoa.errors import VfoaError


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path, 10**9)


def test_what_is_saved_is_loaded_and_nothing_else_is(store: Store) -> None:
    path = store.folder("stereo", "abc") / "000001-0.bin"
    assert store.load(path) is None
    store.save(path, b"content")
    assert store.load(path) == b"content"
    assert [each.name for each in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize(
    "spoil", [lambda data: data[:-1], lambda data: b"", lambda data: data[:-1] + bytes([data[-1] ^ 1])]
)
def test_a_damaged_result_is_told_from_a_missing_one(
    store: Store, spoil: object, caplog: pytest.LogCaptureFixture
) -> None:
    path = store.folder("stereo", "abc") / "000001-0.bin"
    store.save(path, b"content")
    path.write_bytes(spoil(path.read_bytes()))  # type: ignore[operator]
    assert store.load(path) is None
    assert f"{path}: damaged" in caplog.text


def test_a_pipe_in_place_of_a_result_is_not_waited_for(store: Store) -> None:
    path = store.folder("stereo", "a") / "000001.bin"
    path.parent.mkdir(parents=True)
    os.mkfifo(path)
    assert store.load(path) is None
    with pytest.raises(VfoaError, match="not a plain file"):
        store.save(path, b"found")


def test_what_was_used_longest_ago_is_removed_first(tmp_path: Path) -> None:
    size = len(b"x" * 100) + 16
    store = Store(tmp_path, 2 * size)
    paths = [store.folder("stereo", "abc") / f"{name}.bin" for name in "abcd"]
    for age, path in enumerate(paths):
        store.save(path, b"x" * 100)
        os.utime(path, (1000 + age, 1000 + age))
    assert store.load(paths[0]) is not None  # used now
    store.trim()
    assert [path.name for path in paths if path.exists()] == ["a.bin", "d.bin"]
    store.trim()
    assert [path.name for path in paths if path.exists()] == ["a.bin", "d.bin"]


def test_the_drafts_of_the_dead_are_removed_and_those_of_the_living_are_not(store: Store) -> None:
    folder = store.folder("stereo", "abc")
    folder.mkdir(parents=True)
    for name, age_s in (("old", 7200), ("new", 0)):
        (folder / f".1.bin.{name}").touch()
        os.utime(folder / f".1.bin.{name}", (time.time() - age_s,) * 2)
    store.trim()
    assert [path.name for path in folder.iterdir()] == [".1.bin.new"]


def test_what_an_identity_stands_for_may_be_damaged(store: Store) -> None:
    store.describe("stereo", "abc", {"stage": "bm", "clip": "table"})
    store.describe("stereo", "def", {"stage": "bm", "clip": "talk"})
    (store.folder("stereo", "abc") / "identity.json").write_text('{"stage": "b')
    assert [usage.clip for usage in store.usage()] == ["talk"]


def test_usage_says_what_each_stage_takes_and_clearing_leaves_none(store: Store) -> None:
    store.describe("stereo", "abc", {"stage": "bm", "clip": "table"})
    store.save(store.folder("stereo", "abc") / "000001-0.bin", b"x" * 100)
    (usage,) = store.usage()
    assert (usage.slot, usage.name, usage.clip, usage.files, usage.bytes) == ("stereo", "bm", "table", 1, 116)
    (store.root / "studio").mkdir()
    store.clear()
    assert store.usage() == []
    assert (store.root / "studio").exists()


def test_what_cannot_be_cleared_is_said(store: Store, tmp_path: Path) -> None:
    elsewhere = Store(tmp_path / "elsewhere", 0)
    elsewhere.save(elsewhere.folder("stereo", "abc") / "000001-0.bin", b"x")
    store.clear()
    store.stages.symlink_to(elsewhere.stages)
    with pytest.raises(VfoaError, match="symbolic link"):
        store.clear()
    assert (elsewhere.folder("stereo", "abc") / "000001-0.bin").exists()


def test_what_a_run_stores_while_the_cache_is_cleared_may_stay(store: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    """A result is stored in each folder when its files are removed; another folder vanishes as in another clearing."""
    for slot in ("stereo", "heads", "gaze"):
        store.save(store.folder(slot, "abc") / "000001-0.bin", b"x")
    remove = os.rmdir

    def stored_first(folder: str) -> None:
        if folder == str(store.folder("stereo", "abc")):
            store.save(store.folder("stereo", "abc") / "000002-0.bin", b"y")
        if folder == str(store.folder("heads", "abc")):
            remove(folder)
        remove(folder)

    monkeypatch.setattr(os, "rmdir", stored_first)
    store.clear()
    monkeypatch.undo()
    assert [path.name for path in store.stages.rglob("*.bin")] == ["000002-0.bin"]
    assert [path.name for path in store.stages.iterdir()] == ["stereo"]
    store.clear()
    assert not store.stages.exists()


def test_a_result_whose_draft_is_cleared_is_not_stored_and_no_error(
    store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = store.folder("stereo", "abc") / "000001-0.bin"
    replace = Path.replace

    def cleared_first(draft: Path, target: Path) -> Path:
        store.clear()
        return replace(draft, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", cleared_first)
        store.save(path, b"x")
    assert store.load(path) is None
    store.save(path, b"x")
    assert store.load(path) == b"x"


@pytest.mark.parametrize("text", ["lots", "-1", "nan", "inf"])
def test_a_limit_that_is_none_is_refused(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VFOA_CACHE_GB", text)
    with pytest.raises(VfoaError, match=f"VFOA_CACHE_GB: found '{text}'"):
        cache_limit()


def test_what_a_stage_takes_on_a_clip_is_of_all_its_settings(store: Store) -> None:
    for identity in ("abc", "def"):
        store.describe("stereo", identity, {"stage": "bm", "clip": "talk"})
        store.save(store.folder("stereo", identity) / "000001-0.bin", b"content")
    (usage,) = store.usage()
    assert (usage.slot, usage.name, usage.clip, usage.files) == ("stereo", "bm", "talk", 2)
    assert usage.bytes == sum(path.stat().st_size for path in store.stages.rglob("*.bin"))
