"""Two annotators change labels, targets and drawing of one clip in any order: no undo changes what the other made."""

from __future__ import annotations

import random
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from harness.annotate import actions
from harness.annotate.drawing_store import Draw
from harness.annotate.history import History
from harness.clips.manifest import ClipManifest, load_manifest
from harness.clips.naming import NameRule
from harness.labels.labels import Label, LabelRange, Labels, Timeline
from tests.annotating import FRAMES, MANIFEST
from tests.disk import write_text
from vfoa.errors import VfoaError

TIMELINE = Timeline(frames=FRAMES, times_ns=())
LAST = len(FRAMES) - 1
NAMES = ("cup", "book", "mug", "pen")
ANNOTATORS = (None, "ben")
Found = dict[str | None, list[Label | None]]


class Clip:
    """A clip on disk, and a random change of it at a time, each by an annotator who opens it and closes it again."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.path = write_text(folder / "datasets" / "noise.toml", MANIFEST)
        self._random = random.Random(seed)

    @property
    def manifest(self) -> ClipManifest:
        return load_manifest(str(self.path))

    def files(self) -> dict[str, bytes]:
        folder = self.path.parents[1] / "annotations"
        return {path.name: path.read_bytes() for path in (*folder.glob("*.csv"), self.path)}

    def labels(self) -> Found:
        """The labels of ann by annotator; an error if a name is not the manifest's, also one in the drawing."""
        manifest, found = self.manifest, Found()
        manifest.drawn(FRAMES)
        for annotator in ANNOTATORS:
            if (path := manifest.annotations.find(annotator)) is not None:
                read = manifest.read(path, TIMELINE, allow_gaps=True)
                found[annotator] = [read.at(frame, "ann") for frame in FRAMES]
        return found

    def make(self, annotator: str | None, change: Callable[[History], Any]) -> Any:
        """Make a change. A refused one changes nothing; others' labels change only if a target is gone or new."""
        files, before, targets = self.files(), self.labels(), {*self.manifest.targets}
        try:
            with closing(History(self.manifest, annotator, TIMELINE)) as history:
                result = change(history)
        except VfoaError:
            assert self.files() == files
            return None
        after, gone, new = self.labels(), targets - {*self.manifest.targets}, {*self.manifest.targets} - targets
        for other in before.keys() - {annotator}:
            for old, now in zip(before[other], after[other], strict=True):
                assert old == now or (old and old.target in gone) or (now and now.target in new)
        return result

    def change(self) -> None:
        """Make a random change, or undo one, which is then made again."""
        choose, targets = self._random, [*self.manifest.targets]
        annotator, at, shape = choose.choice(ANNOTATORS), choose.randint(0, LAST), (1.0, 1.0, 9.0, 9.0)
        name, to = choose.choice(targets), choose.choice(NAMES)
        free = choose.choice([*targets, "none"])
        labels = Labels(
            LabelRange(first_frame=frame, last_frame=frame, subject="ann", label=Label(target=choose.choice(targets)))
            for frame in FRAMES
        )
        changes: dict[Callable[[History], Any], float] = {
            lambda made: made.labels.put(
                "ann", actions.mark_range(made.labels.track("ann"), at, min(at + 4, LAST), free)
            ): 6,
            lambda made: made.labels.put("ann", actions.look(made.labels.track("ann"), at, name), seen=at): 3,
            lambda made: made.labels.put_labels(labels, ["ann"]): 1,
            lambda made: made.drawing.draw(Draw(name=name, at=at, place=shape)): 3,
            lambda made: made.change_target(name, new_name=to, key=None, colour="olive plain"): 4,
            lambda made: made.delete_target(name, free) if len(targets) > 1 else None: 2,
            lambda made: made.add_target(to, NameRule(category=to)): 1,
            lambda made: made.step_back("undo"): 6,
            lambda made: made.step_back("redo"): 3,
        }
        if choose.random() < 0.9:
            self.make(annotator, choose.choices([*changes], [*changes.values()])[0])
            return
        before = self.files()
        if self.make(annotator, lambda made: made.step_back("undo")):
            assert self.make(annotator, lambda made: made.step_back("redo"))
            after = self.files()
            assert {name: after[name] for name in before} == before


@pytest.mark.parametrize("seed", range(8))
def test_an_undo_leaves_every_file_readable_and_the_labels_of_others(tmp_path: Path, seed: int) -> None:
    clip = Clip(tmp_path, seed)
    for _ in range(25):
        clip.change()
