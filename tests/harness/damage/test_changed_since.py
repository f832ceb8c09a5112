"""Scoring a run whose clip has changed since: what differs is said, and the run says which labels its tables are of."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import pytest

from harness.files.digests import digest_files
from tests.command import vfoa
from tests.harness.damage.table import CSV, TOML, Damage, both, image, replaced

RENAMED = both(replaced(TOML, "targets.mug", "targets.beaker"), replaced(CSV, "mug", "beaker"))
EXCHANGED = both(
    replaced(TOML, '[targets.mug]\ncategory = "cup"', '[targets.mug]\ncategory = "book"'),
    replaced(TOML, '[targets.book]\ncategory = "book"', '[targets.book]\ncategory = "cup"'),
)
REFOUND = replaced(TOML, '[subjects.anna]\ncategory = "person"', '[subjects.anna]\ncategory = "person"\nfrom_left = 2')


def _another_clip(root: Path) -> None:
    for side in ("left", "right"):
        pixels = cv2.imread(str(root / f"images/{side}/000002.png"))
        assert pixels is not None
        image(f"images/{side}/000002.png", 255 - pixels)(root)
    replaced(CSV, "1,3,anna,mug", "1,3,anna,book")(root)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (RENAMED, "the names in mine.toml are not those that the run was made with (targets.beaker, targets.mug)"),
        (EXCHANGED, "(targets.mug.category, targets.book.category)"),
        (REFOUND, "(subjects.anna.from_left)"),
        (_another_clip, "the images or the calibration of mine.toml are not those that the run was made with"),
    ],
    ids=["a target renamed", "targets exchanged", "a subject found in another way", "another clip"],
)
def test_what_differs_is_said_in_one_line(
    change: Damage,
    said: str,
    finished_project: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    code, _, complaint = vfoa(monkeypatch, capsys, "score", "run")
    assert code == 0, complaint
    before = (finished_project / "run" / "frr.md").read_text()
    assert "made with" not in before
    change(finished_project)
    code, _, complaint = vfoa(monkeypatch, capsys, "score", "run")
    assert code == 0, complaint
    assert [line for line in (finished_project / "run" / "frr.md").read_text().splitlines() if said in line]


def test_the_run_says_which_labels_its_tables_are_of_and_which_it_was_made_with(
    finished_project: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    of_run = _labels(finished_project)
    replaced(CSV, "1,3,anna,mug", "1,3,anna,book")(finished_project)
    for _ in range(2):  # the second time as the first
        assert vfoa(monkeypatch, capsys, "score", "run")[0] == 0
        assert _labels(finished_project) == digest_files([("labels", finished_project / CSV)]) != of_run
        assert _labels(finished_project, "run_labels_sha256") == of_run
        assert "its labels are not those that the run was made with" in (finished_project / "run/frr.md").read_text()
    replaced(CSV, "1,3,anna,book", "1,3,anna,mug")(finished_project)
    assert vfoa(monkeypatch, capsys, "score", "run")[0] == 0
    assert _labels(finished_project) == of_run
    assert "made with" not in (finished_project / "run/frr.md").read_text()


def _labels(project: Path, key: str = "labels_sha256") -> str | None:
    return str(json.loads((project / "run" / "manifest.json").read_text())[key]["mine"])
