"""The token of an earlier page: only this user's own file is believed, and any file is replaced by the next page."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from harness.annotate.app import PageServer
from harness.annotate.last_address import Address, read_address, write_address

KNOWN = Address(port=43210, token="a-token-of-an-earlier-page")


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("VFOA_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def stored(cache: Path) -> tuple[Path, Path]:
    """Labels, and the file with the address of their last page."""
    labels = cache.parent / "noise.csv"
    write_address(labels, KNOWN)
    (file,) = (cache / "annotate").iterdir()
    return labels, file


def _replace(content: str | bytes) -> Callable[[Path], None]:
    return lambda file: file.write_bytes(content.encode() if isinstance(content, str) else content) and None


def _link(file: Path) -> None:
    file.rename(file.with_suffix(".moved"))
    file.symlink_to(file.with_suffix(".moved"))


def _pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file, 0o600)


def _folder(file: Path) -> None:
    file.unlink()
    file.mkdir()


def test_the_address_of_the_last_page_is_stored_where_only_this_user_can_read_it(stored: tuple[Path, Path]) -> None:
    labels, file = stored
    assert read_address(labels) == KNOWN
    assert (file.stat().st_mode & 0o777, file.parent.stat().st_mode & 0o777) == (0o600, 0o700)
    os.utime(file, (0, 0))
    assert read_address(labels) is None


def test_a_file_of_another_user_is_not_believed(
    stored: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    labels, file = stored
    other = os.geteuid() + 1
    monkeypatch.setattr("os.geteuid", lambda: other)
    assert read_address(labels) is None
    assert [record.getMessage().startswith(f"{file}: belongs to user") for record in caplog.records] == [True]


@pytest.mark.parametrize(
    "damage",
    [
        *(lambda file, mode=mode: file.chmod(mode) for mode in (0o640, 0o604, 0o602)),
        *(_link, _pipe, _folder),
        *map(_replace, ("", "[", b"\xff", "null", "{}", "[1]", "[1, 2, 3]", "[" * 100_000, "1" * 100_000)),
        *(
            _replace(json.dumps([port, KNOWN.token]))
            for port in (0, -1, 70_000, 10**400, 8000.5, "8000", True, None, [])
        ),
        *(_replace(json.dumps([8000, token])) for token in ("", "short", "a" * 300, "a token with blanks", None, 7)),
        _replace(f'[1e999, "{KNOWN.token}"]'),
        _replace(json.dumps([8000, f"{KNOWN.token}\n"])),
    ],
)
def test_a_file_that_cannot_be_used_is_one_line_and_no_address(
    stored: tuple[Path, Path], damage: Callable[[Path], None], caplog: pytest.LogCaptureFixture
) -> None:
    labels, file = stored
    damage(file)
    assert read_address(labels) is None
    (line,) = (record.getMessage() for record in caplog.records)
    assert line.startswith(f"{file}:")
    assert "\n" not in line


@pytest.mark.parametrize("damage", [_replace('[70000, "x"]'), _link, _pipe, lambda file: file.chmod(0o666)])
def test_the_next_page_replaces_a_file_that_cannot_be_used(
    opened: Any, cache: Path, damage: Callable[[Path], None]
) -> None:
    session = opened()
    write_address(session.path, KNOWN)
    (file,) = (cache / "annotate").iterdir()
    damage(file)
    server = PageServer(session)
    try:
        assert KNOWN.token not in server.address
        now = read_address(session.path)
        assert now is not None
        assert server.address.endswith(f":{now.port}/?token={now.token}")
    finally:
        server.close()


def test_a_cache_that_takes_no_file_is_one_line(cache: Path, caplog: pytest.LogCaptureFixture) -> None:
    cache.write_text("no folder")
    write_address(cache.parent / "noise.csv", KNOWN)
    (line,) = (record.getMessage() for record in caplog.records)
    assert str(cache / "annotate") in line
