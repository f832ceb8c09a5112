"""Names that a spreadsheet runs and a terminal obeys: refused where they are defined, harmless where they are shown."""

from __future__ import annotations

import csv
import io
import shlex
from pathlib import Path

import pytest

from harness.clips.manifest import make_manifest
from harness.files.safe_names import plain_cell, shell_command, shown, vfoa_command
from harness.labels.files import read_annotations
from harness.pipeline.stage_files.coco_panoptic import _Category, _Segment
from harness.report.formats import Table, csv_cell, to_csv
from tests.command import vfoa
from tests.disk import labels_text, stereo_pair_folder, write_text
from tests.harness.clips.adding import NUMBERS
from tests.repository import REPOSITORY
from vfoa.errors import VfoaError

WRONG = ["=1+1", "+1", "-1", "@SUM(A1)", "\tcup", "\rcup", "cup\x1b[2J", "cup\x00", "", " ", "cup\u202e"]
RIGHT = ["cup", "Ann Müller/left", "目", "cup = mug", "a-b"]
AUTOMATIC = "laptop#2"
"""What the program calls an object without a name: right in its own files, and no name that a user gives."""


@pytest.mark.parametrize("kind", ["subjects", "targets"])
def test_a_manifest_refuses_them(kind: str) -> None:
    for name in RIGHT:
        make_manifest({"name": "c", "adapter": "studio", kind: {name: {"category": "cup"}}}, Path("c.toml"))
    for name in (*WRONG, AUTOMATIC):
        with pytest.raises(VfoaError, match=r"c\.toml: .*found the name") as error:
            make_manifest({"name": "c", "adapter": "studio", kind: {name: {"category": "cup"}}}, Path("c.toml"))
        assert str(error.value).isprintable()


@pytest.mark.parametrize("name", [name for name in WRONG if name.strip()])
def test_categories_and_segments_of_files_refuse_them(name: str) -> None:
    with pytest.raises(ValueError, match="found the name"):
        _Category(id=1, name=name)
    with pytest.raises(ValueError, match="found the name"):
        _Segment(id=1, category_id=1, name=name)


@pytest.mark.parametrize("name", ["=1+1", "cup\x1b[2J"])
def test_labels_of_them_are_refused_in_a_line_that_does_nothing_to_a_terminal(name: str, tmp_path: Path) -> None:
    path = write_text(tmp_path / "c.csv", labels_text(f"1,2,ann,{name},"))
    with pytest.raises(VfoaError, match=r"c\.csv:3: ") as error:
        read_annotations(path, timeline=None, subjects=["ann"], targets=["cup"])
    assert str(error.value).isprintable()


@pytest.mark.parametrize("option", ["--subject", "--target"])
def test_clips_add_refuses_them_and_writes_nothing(
    option: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    stereo_pair_folder(tmp_path / "pairs")
    code, _, said = vfoa(monkeypatch, capsys, "clips", "add", "pairs", *NUMBERS, option, "@1+1=cup")
    assert (code, said.count("\n")) == (2, 1), said
    assert "found the name '@1+1'" in said
    assert not (tmp_path / "datasets").exists()


def test_a_command_to_copy_has_the_same_words_in_a_shell_and_no_path_is_an_option() -> None:
    paths = [Path("-x"), Path("--out"), Path("it's here/a b"), Path("~/$HOME"), Path("/-x"), Path("a\\*")]
    command, *words = shlex.split(vfoa_command("view", *paths, "--failures"))
    assert (command, words[0], words[-1]) == ("vfoa", "view", "--failures")
    assert [Path(word) for word in words[1:-1]] == paths
    assert not any(word.startswith("-") for word in words[1:-1])
    assert shell_command("ffmpeg", "-i", Path("-a.avi")) == "ffmpeg -i ./-a.avi"


def test_what_is_not_ours_is_text_in_tables_and_on_the_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["=1+1#3", "@SUM(A1)", "-cmd", "+1+1", "a\x1b[2Jb"]
    numbers = ["-0.5", "+1.25", "-3e-05", "-", "12", "-1.0 to 2.0", "-0,5", "cup"]
    table = Table(title="t", columns=("name",), rows=tuple((each,) for each in (*words, *numbers)), words=1)
    _, *rows = csv.reader(io.StringIO(to_csv(table)))
    assert [cell for (cell,) in rows] == ["'=1+1#3", "'@SUM(A1)", "'-cmd", "'+1+1", r"a\x1b[2Jb", *numbers]
    assert csv_cell("=1,2") == '"\'=1,2"'
    assert plain_cell("=") == "="
    assert shown("a\x1b[31mb\r\u202e") == r"a\x1b[31mb\r\u202e"
    code, _, said = vfoa(monkeypatch, capsys, "score", str(tmp_path / "\x1b[2Jrun"))
    assert code == 2
    assert "\x1b" not in said
    assert r"\x1b[2Jrun" in said


def test_what_is_done_is_told_without_a_control_character(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    code, said, _ = vfoa(monkeypatch, capsys, "init", "\x1b[2Jmine")
    assert code == 0
    assert "\x1b" not in said
    assert r"\x1b[2Jmine" in said
    speaking = [path.name for path in (REPOSITORY / "harness" / "cli").glob("*.py") if "typer.echo" in path.read_text()]
    assert speaking == ["terminal.py"], "expected harness.cli.terminal.say, which shows control characters"
