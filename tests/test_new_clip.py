"""The page about a clip of one's own, executed as it is written, with what its commands print.

Runs are short, so numbers are not compared.
"""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import cv2
import pytest

from tests.command import vfoa
from tests.disk import labels_text, picture, write_image, write_text
from tests.pages import is_shown_by, steps
from tests.repository import REPOSITORY

PAGE = (REPOSITORY / "docs" / "new-clip.md").read_text(encoding="utf-8")
BEGINNING, _, DRAGON = PAGE.partition("## From a folder to a table")
SHORT = ("--limit", "2", "--workers", "1")


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A home without models, whose folder of clips is the working directory."""
    (tmp_path / "clips").mkdir()
    monkeypatch.chdir(tmp_path / "clips")
    monkeypatch.delenv("VFOA_MODELS", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / ".cache"))
    return tmp_path


def test_a_folder_of_pairs_is_added_labelled_and_checked_as_the_page_says(
    home: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    scene = cv2.GaussianBlur(picture(0, 1044, 436), (0, 0), 2)
    left = write_image(home / "data/kitchen/left" / "0001.png", scene[:, :1024])
    right = write_image(home / "data/kitchen/right" / "0001.png", scene[:, 20:])
    for number in range(2, 61):
        for image in (left, right):
            shutil.copy(image, image.with_name(f"{number:04d}.png"))
    (labels,) = re.findall(r"^```\n(# vfoa annotations.*?)^```", BEGINNING, re.MULTILINE | re.DOTALL)
    for command, expected in steps(BEGINNING):
        words = shlex.split(command.replace("/data/kitchen", str(home / "data/kitchen")))[1:]
        if words[:2] == ["clips", "check"]:
            write_text(home / "clips" / "annotations" / "kitchen.csv", labels)
        code, out, err = vfoa(monkeypatch, capsys, *words)
        assert (code != 0) == expected.startswith("vfoa: "), command
        printed = (out + err).replace(str(home), "/home/me")
        assert is_shown_by(printed, expected), printed


def test_real_pairs_become_a_table_as_the_page_says(
    home: Path,
    shared_data: Path,
    default_models: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for side in ("left", "right"):
        shutil.copytree(shared_data / "sintel/training" / f"clean_{side}" / "bandage_2", Path("pairs") / side)
    shutil.copytree(shared_data / "bandage_2_panoptic", "bandage_2_panoptic")
    monkeypatch.setenv("VFOA_MODELS", str(default_models))
    for command, expected in steps(DRAGON):
        words = shlex.split(command)[1:]
        if words[0] == "annotate":
            write_text(Path("annotations/dragon.csv"), labels_text("1,50,girl,dragon,"))
            continue
        code, out, err = vfoa(monkeypatch, capsys, *words, *(SHORT if words[0] == "run" else ()))
        assert code == 0, err
        if expected.strip():
            assert is_shown_by(out + err, expected), out + err
