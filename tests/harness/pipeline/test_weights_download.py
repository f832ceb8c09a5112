from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from harness.files.download import download
from tests.web import Site, serve
from vfoa.errors import VfoaError

CONTENT = np.random.default_rng(0).bytes(300_000)
SHA256 = hashlib.sha256(CONTENT).hexdigest()


@pytest.fixture
def site(monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    for name in ("HTTP_PROXY", "ALL_PROXY", "http_proxy", "all_proxy"):
        monkeypatch.delenv(name, raising=False)
    with serve() as found:
        found.files["/model.onnx"] = CONTENT
        yield found


@pytest.fixture
def target(tmp_path: Path) -> Path:
    return tmp_path / "cache" / "model.onnx"


def partial(target: Path) -> Path:
    return target.with_name("model.onnx.partial")


def test_brings_the_file_whole_and_tells_how_far_it_is(site: Site, target: Path) -> None:
    told: list[tuple[int, int | None]] = []
    download(site.url("/model.onnx"), target, checksum=SHA256, progress=lambda *each: told.append(each))
    assert target.read_bytes() == CONTENT
    assert [path.name for path in target.parent.iterdir()] == ["model.onnx"]
    assert told[0] == (0, len(CONTENT))
    assert told[-1] == (len(CONTENT), len(CONTENT))
    assert told == sorted(told)


def test_follows_where_a_release_is_kept(site: Site, target: Path) -> None:
    site.moved["/releases/model.onnx"] = site.url("/model.onnx")
    download(site.url("/releases/model.onnx"), target, checksum=SHA256)
    assert target.read_bytes() == CONTENT


def test_goes_on_where_it_was_cut(site: Site, target: Path) -> None:
    site.cut_after = 100_000
    for kept in (100_000, 200_000):
        with pytest.raises(VfoaError, match=rf"model\.onnx: .*{kept} bytes: "):
            download(site.url("/model.onnx"), target, checksum=SHA256)
        assert not target.exists()
        assert partial(target).read_bytes() == CONTENT[:kept]
    site.cut_after = None
    told: list[tuple[int, int | None]] = []
    download(site.url("/model.onnx"), target, checksum=SHA256, progress=lambda *each: told.append(each))
    assert target.read_bytes() == CONTENT
    assert not partial(target).exists()
    assert [wanted for _, wanted in site.asked] == [None, "bytes=100000-", "bytes=200000-"]
    assert told[0] == (200_000, len(CONTENT))


def test_begins_anew_where_the_server_gives_no_parts(site: Site, target: Path) -> None:
    target.parent.mkdir()
    partial(target).write_bytes(CONTENT[:1000])
    site.ranges = False
    download(site.url("/model.onnx"), target, checksum=SHA256)
    assert target.read_bytes() == CONTENT


def test_begins_anew_without_a_checksum_to_join_two_parts_by(site: Site, target: Path) -> None:
    target.parent.mkdir()
    partial(target).write_bytes(b"another version")
    download(site.url("/model.onnx"), target, checksum=None)
    assert target.read_bytes() == CONTENT
    assert site.asked == [("/model.onnx", None)]


def test_a_file_that_was_cut_after_its_last_byte_is_whole(site: Site, target: Path) -> None:
    target.parent.mkdir()
    partial(target).write_bytes(CONTENT)
    download(site.url("/model.onnx"), target, checksum=SHA256)
    assert target.read_bytes() == CONTENT


@pytest.mark.parametrize("kept", [b"", b"something else", CONTENT + b"more"])
def test_a_wrong_checksum_leaves_nothing_behind(site: Site, target: Path, kept: bytes) -> None:
    target.parent.mkdir()
    target.write_bytes(b"what was there")
    partial(target).write_bytes(kept)
    expected = SHA256 if kept else "0" * 64
    with pytest.raises(VfoaError, match=rf"sha256 \w+, expected {expected}"):
        download(site.url("/model.onnx"), target, checksum=expected)
    assert target.read_bytes() == b"what was there"
    assert not partial(target).exists()


def test_what_is_not_there_is_one_line(site: Site, target: Path) -> None:
    with pytest.raises(VfoaError, match=r"/absent\.onnx: HTTP 404 Not Found"):
        download(site.url("/absent.onnx"), target, checksum=None)
    assert not target.exists()
    assert not partial(target).exists()


def test_a_part_is_kept_while_the_server_is_in_trouble(site: Site, target: Path) -> None:
    target.parent.mkdir()
    partial(target).write_bytes(CONTENT[:1000])
    del site.files["/model.onnx"]
    with pytest.raises(VfoaError, match="HTTP 404"):
        download(site.url("/model.onnx"), target, checksum=SHA256)
    assert partial(target).read_bytes() == CONTENT[:1000]


def test_a_server_that_does_not_answer_is_one_line(target: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("HTTP_PROXY", raising=False)
    monkeypatch.delenv("http_proxy", raising=False)
    with serve() as site:
        gone = site.url("/model.onnx")
    with pytest.raises(VfoaError, match=r"cannot be reached: .*HTTPS_PROXY") as caught:
        download(gone, target, checksum=None)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("ALL_PROXY", "socks5://127.0.0.1:9", "cannot be reached: "),  # understood; nobody is there
        ("ALL_PROXY", "http://127.0.0.1:9", "cannot be reached: "),
        ("ALL_PROXY", "socks://127.0.0.1:9", "socks://127.0.0.1:9.*socks5://HOST:PORT"),
        ("HTTP_PROXY", "gopher://ann:secret@127.0.0.1:9", "gopher://.*http://HOST:PORT"),
        ("NO_PROXY", "[::1],localhost", r":1\].*NO_PROXY"),
        ("SSL_CERT_FILE", "/absent", "SSL_CERT_FILE"),
    ],
)
def test_what_the_surroundings_say_of_proxies_and_certificates_is_used_or_named(
    name: str, value: str, said: str, site: Site, target: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(name, value)
    with pytest.raises(VfoaError, match=rf"/model\.onnx: .*{said}") as caught:
        download(site.url("/model.onnx").replace("127.0.0.1", "example.org"), target, checksum=None)
    assert "secret" not in str(caught.value)


def test_a_git_lfs_pointer_is_not_taken_for_the_model(site: Site, target: Path) -> None:
    site.files["/model.onnx"] = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 1\n"
    with pytest.raises(VfoaError, match="answered with a Git LFS pointer"):
        download(site.url("/model.onnx"), target, checksum=None)
    assert list(target.parent.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_one_line(site: Site, tmp_path: Path) -> None:
    (tmp_path / "cache").write_bytes(b"a file")
    with pytest.raises(VfoaError, match=r"model\.onnx\.partial: .*written: "):
        download(site.url("/model.onnx"), tmp_path / "cache" / "model.onnx", checksum=None)


@pytest.mark.parametrize("kind", ["text/html; charset=utf-8", None])
def test_a_page_that_asks_to_log_in_is_not_taken_for_the_file(site: Site, target: Path, kind: str | None) -> None:
    site.kind, site.files["/model.onnx"] = kind, b"\n<!DOCTYPE html><title>Log in</title>"
    with pytest.raises(VfoaError, match=r"/model\.onnx: .*(web page|checksum)"):
        download(site.url("/model.onnx"), target, checksum=SHA256)
    assert list(target.parent.iterdir()) == []


def test_a_partial_file_that_is_a_link_does_not_change_what_it_leads_to(site: Site, target: Path) -> None:
    target.parent.mkdir()
    target.with_name("precious").write_bytes(b"kept")
    partial(target).symlink_to("precious")
    download(site.url("/model.onnx"), target, checksum=SHA256)
    assert target.read_bytes() == CONTENT
    assert not target.is_symlink()
    assert target.with_name("precious").read_bytes() == b"kept"


@pytest.mark.parametrize("sha256", [SHA256, None])
def test_of_two_downloads_of_one_file_the_second_is_refused(site: Site, target: Path, sha256: str | None) -> None:
    def meanwhile(done: int, total: int | None) -> None:
        with pytest.raises(VfoaError, match=r"\.partial: another process is downloading this file"):
            download(site.url("/model.onnx"), target, checksum=sha256)

    download(site.url("/model.onnx"), target, checksum=sha256, progress=meanwhile)
    assert target.read_bytes() == CONTENT
