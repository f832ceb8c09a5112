from __future__ import annotations

import errno
import os
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from harness.files.digests import digest_files, file_digest
from harness.files.io import (
    _warn_of_no_locks,
    atomic_write,
    check_new,
    read_bytes,
    read_text,
    take_lock,
    write_together,
)
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


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664])
def test_a_file_keeps_its_mode_when_it_is_written_anew(tmp_path: Path, mode: int) -> None:
    path = tmp_path / "labels.csv"
    path.touch()
    path.chmod(mode)
    atomic_write(path, "new")
    assert path.stat().st_mode & 0o777 == mode


def test_a_lock_is_held_by_one_at_a_time(tmp_path: Path) -> None:
    with (tmp_path / "lock").open("a") as first, (tmp_path / "lock").open("a") as second:
        assert [take_lock(first), take_lock(second)] == [True, False]
    with (tmp_path / "lock").open("a") as third:
        assert take_lock(third)


@pytest.mark.parametrize("number", [errno.ENOLCK, errno.ENOSYS, errno.EOPNOTSUPP])
def test_a_file_system_without_locks_is_said_once(
    number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """As Lustre without its option ``flock``, or NFS without its daemon of locks."""

    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("fcntl.flock", refuse)
    _warn_of_no_locks.cache_clear()
    with (tmp_path / "lock").open("a") as file:
        assert take_lock(file)
        assert take_lock(file)
    assert len(caplog.messages) == 1


def test_a_lock_that_fails_for_another_reason_is_an_error(tmp_path: Path) -> None:
    file = (tmp_path / "lock").open("a")
    file.close()
    with pytest.raises(ValueError, match="closed"):
        take_lock(file)


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


def test_a_folder_that_cannot_be_written_is_told_by_the_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(**_: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system", str(tmp_path / ".a.txt.4dfs3hvs"))

    monkeypatch.setattr("tempfile.mkstemp", fail)
    with pytest.raises(OSError, match="Read-only") as caught:
        atomic_write(tmp_path / "a.txt", "new")
    assert caught.value.filename == str(tmp_path / "a.txt")


def test_of_files_that_are_written_together_a_full_disk_leaves_all_as_they_were(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    old, new = tmp_path / "old", tmp_path / "folder" / "new"
    atomic_write(old, "old")
    forced: list[int] = []

    def full(file: int) -> None:
        forced.append(file)
        if len(forced) == 2:
            raise OSError(errno.ENOSPC, "disk full")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match=rf"disk full: .*{re.escape(str(new))}"):
        write_together({old: "changed", new: b"1"})
    assert old.read_text() == "old"
    assert list(new.parent.iterdir()) == []
    write_together({old: "changed", new: b"1"})
    assert (old.read_text(), new.read_bytes()) == ("changed", b"1")


def test_a_digest_sees_contents_and_roles_but_not_paths(tmp_path: Path) -> None:
    for name, content in {"a": b"1", "b": b"2", "c": b"1"}.items():
        (tmp_path / name).write_bytes(content)
    a, b, c = (tmp_path / name for name in "abc")
    assert digest_files([("left", a), ("right", b)]) == digest_files([("left", c), ("right", b)])
    assert digest_files([("left", a), ("right", b)]) != digest_files([("left", b), ("right", a)])
    assert digest_files([("left", a)]) != digest_files([("right", a)])


@pytest.mark.parametrize("read", [read_bytes, read_text, file_digest])
def test_a_name_that_no_file_can_have_is_one_line(tmp_path: Path, read: Callable[[Path], object]) -> None:
    with pytest.raises(VfoaError, match=r"a\\x00b': .*null (byte|character)"):
        read(tmp_path / "a\0b")


def test_a_file_is_replaced_only_where_that_was_said(tmp_path: Path) -> None:
    place = tmp_path / "a.csv"
    check_new(place, replace=False)
    atomic_write(place, "mine")
    with pytest.raises(VfoaError, match=r"a\.csv: exists already.*--replace"):
        check_new(place, replace=False, hint=", or another")
    check_new(place, replace=True)


@pytest.mark.parametrize("write", [lambda path: atomic_write(path, "x"), lambda path: check_new(path, replace=True)])
def test_what_is_no_plain_file_is_never_replaced(tmp_path: Path, write: Callable[[Path], object]) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "pipe", tmp_path / "folder", Path("/dev/full")):
        with pytest.raises(VfoaError, match="not a plain file"):
            write(path)
    assert (tmp_path / "pipe").is_fifo()
