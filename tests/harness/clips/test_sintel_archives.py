from __future__ import annotations

import io
import shutil
import sys
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from harness.cli.clips import fetch_clips
from harness.clips import fetch
from harness.clips.fetch import ARCHIVES, fetch_sintel, unpack
from harness.sources.sintel import SintelClip, SintelSettings
from tests.disk import picture, sintel_scene
from tests.web import Site, serve
from vfoa.errors import VfoaError


@pytest.fixture
def site() -> Iterator[Site]:
    with serve() as running:
        yield running


def _zip(files: dict[str, bytes]) -> bytes:
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return content.getvalue()


def _scene_zip(folder: Path) -> bytes:
    root = sintel_scene(folder)
    return _zip({p.relative_to(root).as_posix(): p.read_bytes() for p in sorted(root.rglob("*")) if p.is_file()})


def test_a_cut_fetch_goes_on_and_gives_a_clip(tmp_path: Path, site: Site) -> None:
    site.files[f"/{ARCHIVES['stereo']}"] = content = _scene_zip(tmp_path / "made")
    root, home = tmp_path / "sintel", site.url("/")
    site.cut_after = len(content) // 2
    with pytest.raises(VfoaError, match="cut after"):
        fetch_sintel(root, ("stereo",), home=home)
    site.cut_after = None
    fetch_sintel(root, ("stereo",), home=home)
    assert site.asked[-1][1] == f"bytes={len(content) // 2}-"
    clip = SintelClip(SintelSettings.model_validate({"scene": "alley"}), root)
    assert (clip.frame(2).left == picture(2)).all()
    assert [path.name for path in root.iterdir()] == ["training"]


@pytest.mark.parametrize("name", ["../out.png", "/out.png", "training/../../out.png", "..\\out.png", "C:/out.png"])
def test_nothing_is_written_outside(tmp_path: Path, name: str) -> None:
    root = tmp_path / "inner" / "sintel"
    root.mkdir(parents=True)
    archive = root / "a.zip"
    archive.write_bytes(_zip({"training/good.png": b"1", name: b"2"}))
    unpack(archive, root)
    written = [path for path in tmp_path.rglob("*") if path.is_file() and path != archive]
    assert len(written) == 2
    assert all(path.is_relative_to(root) for path in written)


def test_the_disk_s_room_is_checked_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    archive = tmp_path / "a.zip"
    archive.write_bytes(_zip({"training/a.png": b"12345"}))
    usage = shutil.disk_usage(tmp_path)._replace(free=4)
    monkeypatch.setattr(fetch.shutil, "disk_usage", lambda path: usage)
    with pytest.raises(VfoaError, match="GB free"):
        unpack(archive, tmp_path)
    assert not (tmp_path / "training").exists()


def test_a_damaged_archive_is_thrown_away(tmp_path: Path) -> None:
    archive = tmp_path / "a.zip"
    content = bytearray(_zip({"training/a.png": b"x" * 100}))
    content[80] ^= 1
    archive.write_bytes(content)
    with pytest.raises(VfoaError, match="damaged"):
        unpack(archive, tmp_path)
    assert not archive.exists()


@pytest.mark.parametrize(("offset", "value"), [(6, 1), (8, 99)], ids=["encrypted", "unknown compression"])
def test_an_archive_that_nobody_can_unpack_is_one_line(tmp_path: Path, offset: int, value: int) -> None:
    content = bytearray(_zip({"training/a.png": b"x" * 100}))
    for head, place in ((b"PK\x03\x04", offset), (b"PK\x01\x02", offset + 2)):
        content[content.index(head) + place] = value
    archive = tmp_path / "a.zip"
    archive.write_bytes(content)
    with pytest.raises(VfoaError, match=r"a\.zip: damaged and removed: "):
        unpack(archive, tmp_path)


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("stream", [Terminal, io.StringIO])
def test_the_command_fetches_every_part_and_shows_a_bar_on_a_terminal(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch, stream: type[io.StringIO]
) -> None:
    site.files[f"/{ARCHIVES['stereo']}"] = _scene_zip(tmp_path / "made")
    for part in ("depth", "segmentation"):
        site.files[f"/{ARCHIVES[part]}"] = _zip({f"training/{part}/README": b"part"})
    monkeypatch.setitem(fetch_sintel.__kwdefaults__ or {}, "home", site.url("/"))
    monkeypatch.setenv("TERM", "xterm")
    stderr = stream()
    monkeypatch.setattr(sys, "stderr", stderr)
    fetch_clips("sintel", tmp_path / "sintel")
    assert ("sintel" in stderr.getvalue()) == (stream is Terminal)
    assert (tmp_path / "sintel/training/segmentation/README").is_file()
    assert len(SintelClip(SintelSettings.model_validate({"scene": "alley"}), tmp_path / "sintel").frames) == 3
