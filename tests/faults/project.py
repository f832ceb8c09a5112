"""The project on which faults are tried: a measured clip with labels, a finished run, pictures of a board, a site."""

from __future__ import annotations

import hashlib
from contextlib import closing
from pathlib import Path

import cv2
import numpy as np

from harness.annotate.actions import look
from harness.annotate.history import History
from harness.annotate.label_store import LabelStore
from harness.clips.manifest import load_manifest
from harness.labels.labels import Timeline, timeline_of
from tests.disk import write_image, write_text
from tests.measured import EXPERIMENT, LABELS_HEADER, measured_tables, true_labels

MANIFEST = """\
name = "talk"
adapter = "measured"
root = "../data/talk"
[source]
people_file = "people.csv"
objects_file = "objects.csv"
[subjects.anna]
category = "person"
instance = 1
[subjects.ben]
category = "person"
instance = 2
[targets.robot]
category = "robot"
[targets.cup]
category = "cup"
"""
OTHER = LABELS_HEADER + "1,25,anna,ben,\n26,60,anna,robot,\n1,30,ben,anna,\n31,60,ben,robot,\n"
FRAMES = range(1, 61)

MODEL = np.random.default_rng(0).bytes(300_000)
MODEL_SHA256 = hashlib.sha256(MODEL).hexdigest()


def write_project(folder: Path) -> None:
    """All files but the finished run and what is exported from it."""
    measured_tables(folder / "data" / "talk", FRAMES)
    measured_tables(folder / "data" / "walk", range(1, 9))
    write_text(folder / "datasets" / "talk.toml", MANIFEST)
    write_text(folder / "annotations" / "talk.csv", true_labels(len(FRAMES)))
    write_text(folder / "annotations" / "talk@ben.csv", OTHER)
    write_text(folder / "talk.toml", EXPERIMENT)
    _write_board(folder / "board")


def _write_board(folder: Path) -> None:
    """A chessboard of 9 x 6 corners, squares of 25 mm, in eight poses before two cameras 0.1 m apart."""
    squares = np.indices((7, 10)).sum(axis=0) % 2 * 255
    texture = cv2.copyMakeBorder(np.kron(squares, np.ones((40, 40))).astype(np.uint8), *[40] * 4, 0, value=255)
    metres_from_texture = np.array([[0.025 / 40, 0, -0.05], [0, 0.025 / 40, -0.05], [0, 0, 1]])
    k, rng = np.array([[400.0, 0, 200], [0, 400, 150], [0, 0, 1]]), np.random.default_rng(3)
    for number in range(8):
        rotation = cv2.Rodrigues(rng.uniform(-0.4, 0.4, 3))[0]
        place = np.array([-0.06, -0.08, rng.uniform(0.5, 0.7)])
        for side, baseline in (("left", 0.0), ("right", 0.1)):
            pose = np.column_stack([rotation[:, :2], place - [baseline, 0, 0]])
            seen = cv2.warpPerspective(texture, k @ pose @ metres_from_texture, (400, 300), borderValue=128)
            write_image(folder / f"{side}{number}.png", seen)


def take_back() -> None:
    """What ``vfoa labels undo talk --annotator dan`` does; dan has made one change, and a second time there is none."""
    manifest = load_manifest("talk")
    with closing(History(manifest, "dan", timeline_of(manifest.open()))) as history:
        history.step_back("undo")


def label() -> None:
    """Forty changes of labels, each as one key of the page makes it."""
    timeline = Timeline(frames=FRAMES, times_ns=())
    names = {"subjects": ("anna", "ben"), "targets": ("robot", "cup")}
    store = LabelStore(Path("annotations/talk.csv"), Path("annotations/.talk.jsonl"), timeline=timeline, **names)
    try:
        for at in range(40):
            target = ("cup", "none", "robot")[at % 3]
            track = store.track("anna")
            if (mark := track[at]) is None or mark.target != target:
                store.put("anna", look(track, at, target), seen=at)
    finally:
        store.close()
