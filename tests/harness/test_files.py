from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from harness.files import atomic_write, digest_files, file_digest, read_bytes, read_text
from vfoa.errors import VfoaError


def test_a_file_is_replaced_whole_with_usual_permissions(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.txt"
    atomic_write(path, "old\n")
    atomic_write(path, b"new\r\n")
    plain = tmp_path / "plain"
    plain.touch()
    assert path.read_bytes() == b"new\r\n"
    assert path.stat().st_mode == plain.stat().st_mode
    assert os.listdir(path.parent) == ["a.txt"]


def test_a_write_that_fails_leaves_the_old_file_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.txt"
    atomic_write(path, "old")

    def fail(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError, match="disk full"):
        atomic_write(path, "new")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_digest_sees_contents_and_roles_but_not_paths(tmp_path: Path) -> None:
    for name, content in {"a": b"1", "b": b"2", "c": b"1"}.items():
        (tmp_path / name).write_bytes(content)
    a, b, c = (tmp_path / name for name in "abc")
    assert digest_files([("left", a), ("right", b)]) == digest_files([("left", c), ("right", b)])
    assert digest_files([("left", a), ("right", b)]) != digest_files([("left", b), ("right", a)])
    assert digest_files([("left", a)]) != digest_files([("right", a)])


@pytest.mark.parametrize("read", [read_bytes, read_text, file_digest])
def test_a_name_that_no_file_can_have_is_one_line(tmp_path: Path, read: Callable[[Path], object]) -> None:
    with pytest.raises(VfoaError, match=r"a\\x00b': no file can be called so: embedded null byte"):
        read(tmp_path / "a\0b")
