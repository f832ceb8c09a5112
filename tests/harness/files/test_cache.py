"""Cached values are used only while they are whole."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from harness.files.digests import SETTLED_NS, settled_stamp
from harness.files.folders import read_value, write_value
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


def test_a_cached_value_that_is_damaged_or_of_another_type_counts_as_missing(tmp_path: Path) -> None:
    write_value(tmp_path / "a", {"number": 1})
    assert read_value(tmp_path / "a", dict[str, int]) == {"number": 1}
    assert read_value(tmp_path / "a", list[str]) is None
    assert read_value(tmp_path / "b", list[str]) is None
    write_bytes(tmp_path / "a", (tmp_path / "a").read_bytes()[:-1])
    assert read_value(tmp_path / "a", dict[str, int]) is None
