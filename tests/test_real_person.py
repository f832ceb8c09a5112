"""The tutorial of a real person in front of a real rig, run as it is written, from OpenCV's genuine pictures."""

from __future__ import annotations

import csv
import math
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from harness.report.frames_csv import export_frames
from harness.run.directory import RunDirectory
from harness.score.finished_run import FinishedRun
from tests.command import vfoa
from tests.disk import write_text
from tests.pages import BLOCK
from tests.repository import REPOSITORY
from vfoa.geometry import angle_between

PAGE = REPOSITORY / "docs" / "tutorials" / "real-person.md"
FETCHED, SHOWN = ("clips", "fetch"), ("view",)
TURN = re.compile(r"a head that is turned by (\d+) degrees")
ROW = re.compile(r"^\| ([\w-]+)(?: \(.*?\))? \| 1 \| (\d+) \| (.*?) \|$", re.MULTILINE)


def answers(run: str) -> dict[str, tuple[str, str]]:
    """The rate and the answer in the labelled frame of a run, by configuration."""
    frames = csv.DictReader(export_frames(Path("runs", run)).read_text().splitlines())
    rows = [row for row in frames if row["truth"] == "monitor"]
    return {
        row["configuration"]: ("100" if row["outcome"] == "correct" else "0", row["predicted"].strip("()"))
        for row in rows
    }


def turned(run: str) -> tuple[int, str | None]:
    """The angle of the man's head from the camera in the labelled frame, degrees, and why he has no gaze."""
    record = next(each for each in FinishedRun.read(RunDirectory(Path("runs", run))).records() if each.frame == 6)
    (man,) = record.subjects
    return round(math.degrees(angle_between(np.array(man.head), -np.array(man.eye_origin_m)))), man.no_gaze


def test_the_tutorial_gives_the_tables_that_it_shows(
    tmp_path: Path,
    shared_data: Path,
    default_models: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "opencv_stereo").symlink_to(shared_data / "chessboard")
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setenv("VFOA_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("VFOA_MODELS", str(default_models))
    page = PAGE.read_text(encoding="utf-8")
    printed = ""
    for block in BLOCK.finditer(page):
        if block["title"]:
            write_text(Path(block["title"]), block["text"])
        for line in re.findall(r"^\$ vfoa (.*)$", block["text"], re.MULTILINE):
            words = shlex.split(line.replace("${VFOA_DATA}", str(tmp_path / "data")))
            if words[0] in SHOWN or tuple(words[:2]) == FETCHED:
                continue
            alone = ("--workers", "1") if words[0] == "run" else ()
            code, out, err = vfoa(monkeypatch, capsys, *words, *alone)
            assert (code, err) == (0, ""), line
            printed += out
        if block["text"].startswith("stereo.yml"):
            assert block["text"].strip() in printed

    first, second = (
        {name: (rate, answer) for name, rate, answer in ROW.findall(part)}
        for part in page.split("## Another head-pose model")
    )
    assert (answers("rig"), answers("profile")) == (first, second)
    of_page = [int(turn) for turn in TURN.findall(page)]
    assert [turned("rig"), turned("profile")] == [(turn, "face_turned_away") for turn in of_page]
