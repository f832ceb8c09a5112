"""`vfoa clips fetch idiap_vfoa` from a server on this machine."""

from __future__ import annotations

import hashlib
import io
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.cli.clips import fetch_clips
from harness.clips import idiap_files
from harness.clips.check import check_clip
from harness.clips.idiap_files import HEADS, fetch_idiap_file
from harness.clips.manifest import load_manifest
from tests.measured import idiap_file
from tests.repository import REPOSITORY
from tests.web import Site, serve
from vfoa.errors import VfoaError


@pytest.fixture
def site(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Site]:
    """Two files under upstream's names, whose checksums are the expected ones."""
    codes = io.BytesIO()
    np.savez(codes, **{"Person 1": [[1]] * 6, "Person 2": [[0], [0], [0], [2], [2], [2]]})  # as upstream: (frames, 1)
    contents = {"HEADS": idiap_file(tmp_path / "made").read_bytes(), "LABELS": codes.getvalue()}
    with serve() as running:
        for constant, content in contents.items():
            file = replace(getattr(idiap_files, constant), sha256=hashlib.sha256(content).hexdigest())
            monkeypatch.setattr(idiap_files, constant, file)
            running.files[f"/{file.name}"] = content
        monkeypatch.setitem(fetch_idiap_file.__kwdefaults__ or {}, "home", running.url("/"))
        yield running


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory of its own with the built-in manifest in it."""
    folder = tmp_path / "work"
    (folder / "datasets").mkdir(parents=True)
    shutil.copy(REPOSITORY / "datasets" / "idiap_vfoa.toml", folder / "datasets")
    monkeypatch.chdir(folder)
    monkeypatch.setenv("VFOA_DATA", str(tmp_path / "data"))
    return folder


def test_a_fetched_clip_is_labelled_and_passes_the_check(
    site: Site, work: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fetch_clips("idiap_vfoa")
    shown = capsys.readouterr().out
    assert "licence: BSD 3-Clause" in shown
    assert idiap_files.HEADS.sha256 in shown
    assert idiap_files.LABELS.sha256 in shown
    checked = check_clip("idiap_vfoa")
    assert (checked.problems, checked.frames, checked.labels) == ((), 6, 12)
    labels = load_manifest("idiap_vfoa").labels(None)
    assert labels is not None
    assert [label.target for frame in (2, 3) if (label := labels.at(frame, "2"))] == ["none", "1"]


def test_what_is_there_is_neither_fetched_again_nor_overwritten(site: Site, work: Path) -> None:
    fetch_clips("idiap_vfoa")
    place = work / "annotations" / "idiap_vfoa.csv"
    place.write_text(place.read_text().replace("none", "robot"))
    edited, asked = place.read_bytes(), len(site.asked)
    fetch_clips("idiap_vfoa")
    assert (place.read_bytes(), len(site.asked)) == (edited, asked)


def test_another_content_than_that_of_the_commit_is_refused(site: Site, tmp_path: Path) -> None:
    site.files[f"/{HEADS.name}"] += b"1,2,3\n"
    with pytest.raises(VfoaError, match=HEADS.name):
        fetch_idiap_file(tmp_path / "data", idiap_files.HEADS)
    assert not (tmp_path / "data" / HEADS.name).exists()


def test_an_unknown_source_is_named() -> None:
    with pytest.raises(VfoaError, match="no 'idiap'; did you mean 'idiap_vfoa'"):
        fetch_clips("idiap")
