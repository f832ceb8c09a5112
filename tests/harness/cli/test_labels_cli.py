"""``vfoa labels`` as its user meets it, on a rendered clip."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

import pytest

from tests.command import vfoa
from tests.disk import write_text
from tests.repository import REPOSITORY

CLIP = "studio_talk"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with a clip, the labels of two annotators, and those of none."""
    for kind, suffix in (("datasets", "toml"), ("annotations", "csv")):
        (tmp_path / kind).mkdir()
        shutil.copy(REPOSITORY / kind / f"{CLIP}.{suffix}", tmp_path / kind)
    text = (tmp_path / "annotations" / f"{CLIP}.csv").read_text()
    write_text(tmp_path / "annotations" / f"{CLIP}@anna.csv", text)
    write_text(tmp_path / "annotations" / f"{CLIP}@ben.csv", text.replace("ben,bear", "ben,none"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VFOA_CACHE", str(tmp_path / "cache"))
    return tmp_path


@pytest.mark.parametrize("name", ["elan", "boris", "boris-aggregated"])  # cvat would render every head
def test_labels_go_out_and_come_back(
    name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    where = ("--format", name, "--offset", "3")
    assert vfoa(monkeypatch, capsys, "labels", "export", CLIP, "out", *where)[0] == 0
    code, out, _ = vfoa(monkeypatch, capsys, "labels", "import", "out", "--clip", CLIP, "--annotator", "cat", *where)
    assert code == 0
    assert "16 ranges of anna, ben" in out
    labels = folder / "annotations"
    assert (labels / f"{CLIP}@cat.csv").read_bytes() == (labels / f"{CLIP}.csv").read_bytes()


def test_the_old_name_of_the_verb_is_kept(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert vfoa(monkeypatch, capsys, "annotations", "check", CLIP) == vfoa(monkeypatch, capsys, "labels", "check", CLIP)
    assert "annotations" not in vfoa(monkeypatch, capsys, "--help")[1].split()


def test_a_file_that_is_read_is_not_written_over(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    own = folder / "annotations" / f"{CLIP}.csv"
    before = own.read_bytes()
    code, _, said = vfoa(monkeypatch, capsys, "labels", "export", CLIP, str(own), "--format", "boris")
    assert (code, own.read_bytes()) == (2, before)
    assert "exists already; expected --replace" in said


def test_a_folder_with_files_is_not_written_over(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = write_text(folder / "theirs" / "anna.txt", "mine")
    words = ("labels", "export", CLIP, "theirs", "--format", "videoattentiontarget")
    code, _, said = vfoa(monkeypatch, capsys, *words)
    assert (code, mine.read_text()) == (2, "mine")
    assert "theirs: has files already; expected --replace" in said


def test_tables_of_agreement_are_written_all_or_none(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("labels", "agreement", CLIP, "anna", "ben", "--out", "tables")
    asked = iter(range(3))

    def full(file: int) -> None:
        if next(asked) == 2:
            raise OSError(errno.ENOSPC, "No space left on device", "tables")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        code, _, said = vfoa(monkeypatch, capsys, *words)
    assert (code, said) == (2, "vfoa: tables: No space left on device\n")
    assert list((folder / "tables").iterdir()) == []
    assert vfoa(monkeypatch, capsys, *words)[0] == 0


def test_a_device_is_not_replaced(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, said = vfoa(monkeypatch, capsys, "labels", "export", CLIP, "/dev/full", "--format", "elan", "--replace")
    assert (code, said) == (2, "vfoa: /dev/full: not a plain file; expected a file to write\n")
    assert Path("/dev/full").is_char_device()


def test_a_pipe_is_not_written_over(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(folder / "pipe")
    code, _, said = vfoa(monkeypatch, capsys, "labels", "export", CLIP, "pipe", "--format", "elan")
    assert (code, said) == (2, "vfoa: pipe: not a plain file; expected a file to write\n")
    assert (folder / "pipe").is_fifo()


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("export", CLIP, "out", "--format", "elen"), "annotation format: no 'elen'; did you mean 'elan'?"),
        (("export", CLIP, "out", "--format", "elan", "--annotator", "bea"), "no annotations by 'bea'"),
        (("import", "gone", "--format", "cvat", "--clip", CLIP, "--annotator", "x"), "gone: no such file"),
        (("import", "gone", "--format", "cvat", "--clip", CLIP), f"{CLIP}.csv: exists already; expected --replace"),
        (("import", "gone", "--format", "cvat", "--clip", CLIP, "--rename", "x"), "--rename x: expected THEIRS=OURS"),
        (("export", CLIP, "out", "--format", "elan", "--offset", "inf"), "--offset: found inf; expected a number"),
        (("agreement", CLIP, "anna"), "labels of anna; expected two annotators or more"),
        (("merge", CLIP), f"{CLIP}.csv: exists already; expected --replace, or another --to"),
        (("check", CLIP, "--annotator", "bea"), "no annotations by 'bea'"),
    ],
)
def test_a_wrong_word_is_one_line_and_exit_code_2(
    arguments: tuple[str, ...], line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = vfoa(monkeypatch, capsys, "labels", *arguments)
    assert code == 2
    assert line in err
    assert err.count("\n") == 1


def test_annotators_are_compared_and_merged(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = vfoa(monkeypatch, capsys, "labels", "agreement", CLIP, "--out", "tables")
    assert code == 0
    assert "Kappa" in out
    assert "bear,none" in (folder / "tables" / "differences.csv").read_text()
    assert (folder / "tables" / "agreement.md").read_text().count("## ") == 4
    code, out, _ = vfoa(monkeypatch, capsys, "labels", "merge", CLIP, "anna", "ben", "--to", "both")
    assert code == 0
    assert "are to be decided, the first at frame 1" in out
    assert "to decide: anna bear, ben none" in (folder / "annotations" / f"{CLIP}@both.csv").read_text()
    assert vfoa(monkeypatch, capsys, "labels", "check", CLIP)[1].count("@") == 3
