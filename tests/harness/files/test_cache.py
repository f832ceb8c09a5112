"""Cached values are used only while they are whole, and their file and code unchanged."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from harness.files.digests import SETTLED_NS, settled_stamp
from harness.files.folders import kept_while_unchanged, read_value, write_value
from tests.disk import write_bytes


def test_a_file_has_a_settled_stamp_once_it_cannot_change_within_the_same_tick(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_bytes(tmp_path / "a", b"1")
    changed = max(path.stat().st_ctime_ns, path.stat().st_mtime_ns)
    ages = {}
    for age in (-SETTLED_NS, SETTLED_NS - 1, SETTLED_NS):
        monkeypatch.setattr(time, "time_ns", lambda age=age: changed + age)
        ages[age] = settled_stamp([("file", str(path))]) is not None
    assert ages == {-SETTLED_NS: False, SETTLED_NS - 1: False, SETTLED_NS: True}
    assert settled_stamp([("file", str(tmp_path / "missing"))]) is None


def test_a_value_is_read_again_if_its_file_or_the_code_changes_or_it_is_damaged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = time.time_ns
    monkeypatch.setattr(time, "time_ns", lambda: now() + 60 * 10**9)
    source, kept, calls = write_bytes(tmp_path / "source", b"1"), tmp_path / "kept", list[str]()

    def value(code: str) -> str:
        return kept_while_unchanged(kept, source, str, code, lambda: (calls.append(code), source.read_text())[1])

    assert [value("one"), value("one"), value("two")] == ["1", "1", "1"]
    source.write_bytes(b"2")
    os.utime(source, ns=(1, 1))
    assert [value("two"), value("two")] == ["2", "2"]
    kept.write_bytes(kept.read_bytes()[:-1])
    assert value("two") == "2"
    assert calls == ["one", "two", "two", "two"]


def test_what_has_just_changed_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = write_bytes(tmp_path / "source", b"1")
    monkeypatch.setattr(time, "time_ns", lambda: source.stat().st_ctime_ns)
    assert kept_while_unchanged(tmp_path / "kept", source, str, "code", source.read_text) == "1"
    assert not (tmp_path / "kept").exists()


def test_a_cached_value_of_another_type_counts_as_missing(tmp_path: Path) -> None:
    write_value(tmp_path / "a", {"number": 1})
    assert read_value(tmp_path / "a", dict[str, int]) == {"number": 1}
    assert read_value(tmp_path / "a", list[str]) is None
    assert read_value(tmp_path / "b", list[str]) is None
