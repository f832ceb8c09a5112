"""A clip that no segmenter and no detector knows: drawn at four key frames, run, named, scored."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.clips.manifest import load_manifest
from harness.labels.drawn_shapes import KeyFrame, Kind, drawn_of, read_drawn, write_drawn
from harness.pipeline.cache_store import Store
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.run.table_records import read_records
from harness.sources import Truth
from harness.studio import StudioClip
from tests.attended import assert_scenes_give_the_same
from tests.disk import write_text
from tests.drawn_clip import CLIP, DRAWN
from tests.records import tables_of
from tests.repository import copy_clip
from vfoa.errors import VfoaError
from vfoa.types import Mask


def _box_of(mask: Mask) -> tuple[float, ...]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return float(columns[0]) - 0.5, float(rows[0]) - 0.5, float(columns[-1]) + 0.5, float(rows[-1]) + 0.5


@pytest.fixture
def drawn_clip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with the clip and what somebody drew on it: the file of what is drawn."""
    copy_clip(CLIP, tmp_path)
    monkeypatch.chdir(tmp_path)
    write_text(tmp_path / "exp.toml", DRAWN)
    manifest = load_manifest(CLIP)
    clip = manifest.open()
    keys: dict[tuple[str, Kind], list[KeyFrame]] = {}
    for frame in (1, 9, 16, 24):
        truth = clip.truth(frame)
        assert truth.instances is not None
        assert truth.people is not None
        for name, rule in manifest.targets.items():
            place = _box_of(truth.instances.mask(rule.instance or 0))
            keys.setdefault((name, "box"), []).append(KeyFrame(frame=frame, place=place))
        for person in truth.people:
            place = tuple(person.head_box_px.tolist())
            keys.setdefault((person.name, "head"), []).append(KeyFrame(frame=frame, place=place))
    write_drawn(manifest.annotations.place_drawn(), drawn_of(keys))
    return manifest.annotations.place_drawn()


def _run(out: str, *, limit: int | None = None, workers: int = 1) -> RunDirectory:
    plan = prepare(load_experiment("exp.toml"), limit=limit)
    cache = Store(Path("cache"), 10**9) if workers > 1 else None
    return run_plan(plan, Path(out), workers=workers, progress=lambda clip: None, cache=cache)


def test_four_key_frames_are_enough_for_a_clip_without_masks(drawn_clip: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole_truth = StudioClip.truth

    def without_masks(clip: StudioClip, number: int) -> Truth:
        return replace(whole_truth(clip, number), instances=None)

    with monkeypatch.context() as patch:
        patch.setattr(StudioClip, "truth", without_masks)
        directory = _run("run", limit=24)
    rescore(directory)
    with (directory.path / "frr.csv").open() as file:
        rates = {row["subject"]: (int(row["n"]), float(row["frr"])) for row in csv.DictReader(file)}
    assert {*rates} == {"(all)", "anna", "ben"}
    assert rates["(all)"][0] == 42
    assert min(rate for _, rate in rates.values()) > 0.9
    manifest = json.loads(directory.manifest.read_text())
    note = f"{CLIP}: drawn by hand: anna, bear, ben, bowl, mug, plant (24 key frames)."
    assert manifest["notes"] == [{"text": note, "kind": "fact"}]


def test_answers_from_scenes_are_those_of_the_loop(drawn_clip: Path) -> None:
    plan = prepare(load_experiment("exp.toml"), limit=5)
    directory = run_plan(plan, Path("run"), workers=1, progress=lambda clip: None)
    assert_scenes_give_the_same(directory, *plan.clips, plan.experiment.configurations)


def test_results_are_the_same_with_workers(drawn_clip: Path) -> None:
    one = _run("one", limit=2)
    two = _run("two", limit=2, workers=2)
    assert tables_of(one) == tables_of(two)
    for record in read_records(one):
        assert {target.name for target in record.targets} == {"mug", "bear", "bowl", "plant", "anna", "ben"}
        assert {subject.name for subject in record.subjects} == {"anna", "ben"}


def test_what_is_drawn_is_an_input_of_the_run(drawn_clip: Path) -> None:
    first = _run("run", limit=1)
    assert _run("run", limit=1).path == first.path
    names = {"subjects": ("anna", "ben"), "targets": ("mug", "bear", "bowl", "plant")}
    drawn = read_drawn(drawn_clip, frames=None, **names)
    write_drawn(drawn_clip, replace(drawn, tracks=drawn.tracks[:-1]))
    with pytest.raises(VfoaError, match=rf"\(different: notes, drawn_sha256 of {CLIP}"):
        _run("run", limit=1)
    write_drawn(drawn_clip, drawn)
    assert _run("run", limit=1).path == first.path


def test_nothing_but_what_is_drawn_needs_something_drawn(drawn_clip: Path) -> None:
    drawn_clip.unlink()
    with pytest.raises(VfoaError, match=f"{CLIP}: segmentation = 'drawn'"):
        _run("run", limit=1)
