"""Files that look unchanged are not read again; a file whose content has changed always is."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from harness.files import digests
from harness.files.digests import SETTLED_NS
from vfoa.errors import VfoaError

Parts = list[tuple[str, Path]]


@pytest.fixture
def parts(tmp_path: Path) -> Parts:
    for name in ("left.png", "right.png"):
        (tmp_path / name).write_bytes(name.encode())
    return [("left", tmp_path / "left.png"), ("right", tmp_path / "right.png")]


@pytest.fixture
def later(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Set the clock to this many seconds from now: what was just written is as old."""
    true = time.time_ns

    def at(seconds: float) -> None:
        monkeypatch.setattr(time, "time_ns", lambda: true() + round(seconds * 1e9))

    return at


@pytest.fixture
def digest(monkeypatch: pytest.MonkeyPatch) -> Callable[[Parts], tuple[str, list[Path]]]:
    """A digest as a process without any gives it, and the files that were read for it."""
    monkeypatch.setattr(digests, "KNOWN", {})
    read: list[Path] = []
    true = digests.file_digest
    monkeypatch.setattr(digests, "file_digest", lambda path: read.append(path) or true(path))

    def of(parts: Parts) -> tuple[str, list[Path]]:
        read.clear()
        return digests.digest_files(parts), list(read)

    return of


def _in_place(path: Path, content: bytes) -> None:
    path.write_bytes(content)


def _by_another_file(path: Path, content: bytes) -> None:
    path.with_name("new").write_bytes(content)
    path.with_name("new").replace(path)


def test_files_left_alone_are_read_once(
    parts: Parts, digest: Callable[..., object], later: Callable[..., None]
) -> None:
    later(10)
    first, read = digest(parts)
    assert read == [path for _, path in parts]
    assert digest(parts) == (first, [])


def test_what_a_run_uses_is_told_whether_it_was_known_or_not(
    parts: Parts, digest: Callable[..., tuple[str, object]], later: Callable[..., None]
) -> None:
    later(10)
    digest(parts[:1])
    for _ in range(2):
        with digests.used_digests() as used:
            both = digest(parts)[0]
        assert [*used.values()] == [both]


@pytest.mark.parametrize("write", [_in_place, _by_another_file])
def test_new_content_of_the_same_size_and_time_is_read(
    parts: Parts, digest: Callable[..., tuple[str, object]], later: Callable[..., None], write: Callable[..., None]
) -> None:
    later(10)
    first, _ = digest(parts)
    path = parts[1][1]
    times = path.stat().st_atime_ns, path.stat().st_mtime_ns
    write(path, b"RIGHT.PNG")
    os.utime(path, ns=times)  # as cp -p and rsync -t do
    assert path.stat().st_mtime_ns == times[1]
    changed, read = digest(parts)
    assert changed != first
    assert read == [path for _, path in parts]


def test_other_roles_another_order_and_fewer_files_are_other_sets(
    parts: Parts, digest: Callable[..., tuple[str, object]], later: Callable[..., None]
) -> None:
    later(10)
    others = [parts, parts[::-1], parts[:1], [("right", parts[0][1]), parts[1]]]
    assert len({digest(each)[0] for each in others}) == len(others)


@pytest.mark.parametrize(("age_s", "kept"), [(0.0, False), (1.9, False), (SETTLED_NS / 1e9 + 1, True), (-60.0, False)])
def test_a_file_that_was_just_written_is_read_again(
    parts: Parts, digest: Callable[..., tuple[str, list[Path]]], later: Callable[..., None], age_s: float, kept: bool
) -> None:
    later(age_s)  # -60: the clock was set back
    digest(parts)
    assert (digest(parts)[1] == []) == kept


def test_a_file_that_is_gone_is_named(parts: Parts, digest: Callable[..., object], later: Callable[..., None]) -> None:
    later(10)
    digest(parts)
    parts[0][1].unlink()
    with pytest.raises(VfoaError, match=r"left\.png: no such file"):
        digest(parts)


def test_a_large_file_is_not_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, later: Callable[..., None]
) -> None:
    monkeypatch.setattr(digests, "KNOWN", {})
    path = tmp_path / "video.mp4"
    path.write_bytes(bytes(2 << 20))
    later(10)
    first = digests.file_digest(path)
    monkeypatch.setattr(digests, "_digest_of_large", lambda path: "read")
    assert digests.file_digest(path) == first
    path.write_bytes(bytes(3 << 20))
    assert digests.file_digest(path) == "read"
