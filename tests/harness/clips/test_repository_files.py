"""`vfoa clips fetch` of files of a repository, from a server on this machine."""

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
from harness.clips import fetch
from harness.clips.check import check_clip
from harness.clips.fetch import HEADS, fetch_files, listed_files
from harness.clips.manifest import clips_here, load_manifest
from harness.files.digests import file_digest
from tests.measured import idiap_file, vr_session
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
            file = replace(getattr(fetch, constant), sha256=hashlib.sha256(content).hexdigest())
            monkeypatch.setattr(fetch, constant, file)
            running.files[f"/{file.name}"] = content
        monkeypatch.setattr(fetch, "IDIAP_HOME", running.url("/"))
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
    assert fetch.HEADS.sha256 in shown
    assert fetch.LABELS.sha256 in shown
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
        fetch_files(tmp_path / "data", [fetch.HEADS], site.url("/"))
    assert not (tmp_path / "data" / HEADS.name).exists()


def test_people_in_virtual_rooms_become_labelled_clips(
    work: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    made = vr_session(tmp_path / "made")
    files = [path for path in made.rglob("*.csv") if path.is_file()]
    shutil.copy(REPOSITORY / "datasets" / "vr_kitchen.toml", work / "datasets")
    manifest = work / "datasets" / "vr_kitchen.toml"
    above = manifest.read_text().partition("[targets]")[0]
    manifest.write_text(f'{above}[targets.cup]\ncategory = "cup"\n[clips]\nkitchen_p03 = {{ SUBJECT = "p3" }}\n')
    rows = [f"{path.relative_to(tmp_path / 'made')},{path.stat().st_size},{file_digest(path)}" for path in files]
    (work / "datasets" / "vr_objects.csv").write_text("\n".join(["path,bytes,sha256", *rows]) + "\n")
    with serve() as running:
        monkeypatch.setattr(fetch, "VR_HOME", running.url("/"))
        running.files.update({f"/{path.relative_to(tmp_path / 'made')}": path.read_bytes() for path in files})
        fetch_clips("vr_objects")
        asked = len(running.asked)
        fetch_clips("vr_objects")
        assert len(running.asked) == asked
    checked = check_clip("kitchen_p03")
    assert (checked.problems, checked.frames, checked.labels) == ((), 17, 8)
    assert clips_here(["vr_kitchen"])[0] == ("kitchen_p03",)


def test_the_list_of_files_is_that_of_all_people() -> None:
    files = listed_files("vr_objects")
    assert len(files) == 656
    assert len({Path(file.name).parts[1] for file in files}) == 16
    assert sum(file.n_bytes or 0 for file in files) == 83_259_830


def test_an_unknown_source_is_named() -> None:
    with pytest.raises(VfoaError, match="no 'idiap'; did you mean 'idiap_vfoa'"):
        fetch_clips("idiap")


def test_the_genuine_pairs_of_opencv_are_fetched(
    tmp_path: Path, shared_data: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pairs = sorted((shared_data / "chessboard").glob("*.jpg"))
    with serve() as running:
        monkeypatch.setattr(fetch, "OPENCV_HOME", running.url("/"))
        running.files.update({f"/{path.name}": path.read_bytes() for path in pairs})
        fetch_clips("opencv_stereo", tmp_path / "here")
    assert {path.name for path in (tmp_path / "here").iterdir()} == {path.name for path in pairs}
