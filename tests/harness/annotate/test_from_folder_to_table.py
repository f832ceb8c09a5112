"""A new user's way: a folder of image pairs and its calibration, four commands, no editor, and an FRR table."""

from __future__ import annotations

import csv
import re
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from harness.labels.files import format_annotations
from harness.labels.labels import IGNORED
from harness.studio import StudioClip
from harness.studio.stage import RIG
from tests.annotating import LOOKS_AROUND, served_by_the_program, shown, true_labels
from tests.browser import wait_for
from tests.calibrations import matrix, write_opencv
from tests.command import vfoa
from tests.disk import write_image
from tests.repository import REPOSITORY

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

FRAMES = range(1, 8)
TARGETS = {"mug": "cup", "vase": "vase", "laptop": "laptop", "book": "book", "bottle": "bottle"}
KEYS = {**{name: str(key) for key, name in enumerate(TARGETS, start=1)}, "none": "n", "ignore": "i"}
ARROW_RIGHT = "\ue014"


def _write_pairs(folder: Path, clip: StudioClip) -> None:
    """Images as cameras save them, and what OpenCV's stereoCalibrate says of the cameras, beside them."""
    for number in FRAMES:
        frame = clip.frame(number)
        write_image(folder / "left" / f"{number:04d}.png", frame.left)
        write_image(folder / "right" / f"{number:04d}.png", frame.right)
    k, d = matrix(RIG.fx_px, RIG.fy_px, RIG.cx_px, RIG.cy_px), np.zeros((1, 5))
    pose = {"R": np.eye(3), "T": np.array([[-RIG.baseline_m], [0], [0]])}
    nodes = {"K1": k, "D1": d, "K2": k, "D2": d, **pose}
    write_opencv(folder / "calibration.yml", nodes, (RIG.width_px, RIG.height_px))


def _label(browser: Chrome, work: Path, labels: list[str]) -> None:
    """Label the clip in its page, frame by frame, by keys alone."""
    from selenium.webdriver import ActionChains

    with served_by_the_program(work, "desk") as (_, address):

        def press(key: str) -> None:
            ActionChains(browser).send_keys(key).perform()
            wait_for(lambda: browser.execute_script("return document.body.getAttribute('aria-busy') === 'false'"))

        browser.get(address)
        for number, (before, target) in enumerate(zip([None, *labels], labels, strict=False), start=1):
            wait_for(lambda number=number: shown(browser) == number)
            if target != before:
                press(KEYS[target])
            press(ARROW_RIGHT)


def test_the_commands_are_those_that_contributing_names() -> None:
    section = (REPOSITORY / "CONTRIBUTING.md").read_text().partition("## A clip\n")[2].partition("\n## ")[0]
    assert re.findall(r"^\d\. `vfoa ([a-z ]+?) [A-Z]", section, re.MULTILINE) == [
        "clips add",
        "annotate",
        "clips check",
        "run",
    ]


def test_a_folder_becomes_a_labelled_clip_and_a_table(
    browser: Chrome,
    tmp_path: Path,
    default_models: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def run(*words: str) -> str:
        """A command as a user gives it; what it prints."""
        code, out, err = vfoa(monkeypatch, capsys, *words)
        assert code == 0, err
        return out

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VFOA_MODELS", str(default_models))
    clip = StudioClip(LOOKS_AROUND, None)
    truth = true_labels(clip, FRAMES)
    said = [label.target for _, _, label in truth.labelled(FRAMES)]
    _write_pairs(tmp_path / "pairs", clip)

    named = [word for name, category in TARGETS.items() for word in ("--target", f"{name}={category}")]
    added = run("clips", "add", "pairs", "--name", "desk", "--set", "rate_hz=20", "--subject", "anna", *named)
    assert "calibration.yml" in added
    _label(browser, tmp_path, said)
    assert (tmp_path / "annotations" / "desk.csv").read_text() == format_annotations(truth)
    assert "desk" in run("clips", "check", "desk")
    weights = ("--set", "segmentation.model=yolo_seg", "--set", "segmentation.weights=yolov8n-seg_int8.onnx")
    table = run("run", "desk", "--workers", "1", *weights)

    judged = sum(target != IGNORED for target in said)
    assert re.search(rf"^ *default +{judged} +[0-9.]+ ", table, re.MULTILINE), table
    (scores,) = (tmp_path / "runs").glob("*/frr.csv")
    with scores.open() as file:
        rows = {(row["clip"], row["subject"], row["configuration"], int(row["n"])) for row in csv.DictReader(file)}
    assert rows == {("desk", who, "default", judged) for who in ("(all)", "anna")}
