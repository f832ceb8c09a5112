"""Parsers that need more than one file: a run, a cache, labels being made, a recording, a message."""

from __future__ import annotations

import hashlib
import json
import os
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from harness.annotate.edits import look
from harness.annotate.store import LabelStore
from harness.labels.formats.exchange import Exchange
from harness.labels.formats.idiap_vfoa import IdiapGroundTruth
from harness.labels.timeline import Timeline
from harness.report.export import exported_table
from harness.report.thumbnails import lines_path, read_thumbnails
from harness.report.thumbnails.writer import ThumbnailWriter
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.score.finished_run import FinishedRun, read_scores
from harness.score.fit_logit import read_labelled
from harness.score.reference import Reference
from harness.score.score import score
from harness.stages.cache.identity import Identity, difference
from harness.stages.cache.stage import StoredOutputs, Tally
from harness.stages.cache.store import Store
from harness.stages.cache.values import encode
from harness.stages.outputs.coco_panoptic import CocoPanoptic, CocoPanopticSettings
from harness.stages.outputs.heads import read_heads
from harness.studio.store import load_pair
from tests.disk import picture, write_image, write_text
from tests.exchanges import PlainClip
from tests.fuzz import seeds
from tests.harness.record.conftest import ANN, show
from tests.measured import idiap_file, measured_tables, open_measured
from tests.records import labels
from vfoa.errors import VfoaError
from vfoa.types import Disparity, Head, Instance, Instances

# Labels


def idiap_labels(path: Path) -> Any:
    tracker = path.parent / "tracker"
    if not tracker.is_dir():
        idiap_file(tracker)
    clip = open_measured("idiap_vfoa", tracker, file="tracker.csv")
    return IdiapGroundTruth().read(path, Exchange(clip=clip, subjects=("1", "2"), targets=("robot",)))


def _store(folder: Path, journal: Path) -> LabelStore:
    timeline = Timeline(frames=range(1, 9), times_ns=())
    return LabelStore(folder / "mine.csv", journal, timeline=timeline, subjects=("ann", "ben"), targets=("cup",))


def write_journal(path: Path) -> None:
    store = _store(path.parent, path)
    for at, target in ((0, "cup"), (3, "none"), (5, "ben")):
        store.put(store.revision, "ann", look(store.track("ann"), at, target), seen=at)
    store.undo(store.revision)
    store.see("ann", 6)
    store.close()


def open_labels(path: Path) -> Any:
    """Beside the CSV that belongs to the whole journal."""
    whole = path.parent / "whole"
    if not whole.is_dir():
        whole.mkdir()
        write_journal(whole / path.name)
    os.replace(_copied(whole / "mine.csv"), path.parent / "mine.csv")
    store = _store(path.parent, path)
    try:
        return store.state()
    finally:
        store.close()


def _copied(path: Path) -> Path:
    copy = path.with_suffix(".copy")
    copy.write_bytes(path.read_bytes())
    return copy


# Runs


@cache
def _run(folder: Path) -> Path:
    """A finished run of measured frames, labelled: no images, so that it takes a second."""
    project = folder / "project"
    measured_tables(project / "data" / "talk")
    write_text(project / "datasets" / "mine.toml", seeds.MEASURED.replace("../talk", "../data/talk"))
    head = "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note\n"
    write_text(project / "annotations" / "mine.csv", f"{head}1,6,anna,none,\n7,12,anna,robot,\n")
    clip = (project / "datasets" / "mine.toml").as_posix()
    text = f'clips = ["{clip}"]\npreset = "measured"\n[[configuration]]\nname = "one"\n'
    experiment = load_experiment(str(write_text(project / "e.toml", text)))
    run_plan(prepare(experiment), project / "run", workers=1, progress=lambda clip: None)
    return project / "run"


def write_run_manifest(path: Path) -> None:
    path.write_bytes((_run(path.parent) / "manifest.json").read_bytes())


def open_run(path: Path) -> Any:
    """A run with this manifest and whole results."""
    results = path.with_name("results.jsonl")
    if not results.exists():
        results.write_bytes((_run(path.parent / "whole") / "results.jsonl").read_bytes())
    run = FinishedRun.read(RunDirectory(path.parent))
    records, reference = list(run.records()), run.reference()
    read_labelled(RunDirectory(path.parent), None)
    return score(records, reference)


def write_exported(path: Path) -> None:
    directory = RunDirectory(_run(path.parent))
    table = exported_table(read_scores(directory), directory.read_manifest())
    write_text(path, table.model_dump_json())


def write_thumbnails(path: Path) -> None:
    with ThumbnailWriter(path.parent, "clip", "one") as writer:
        for each in _shown():
            writer.write(each)
    path.write_bytes(lines_path(path.parent, "clip", "one").read_bytes())


def open_thumbnails(path: Path) -> Any:
    """Lines beside whole pictures, of frames that are wrong."""
    place = lines_path(path.parent, "clip", "one")
    if not place.exists():
        write_thumbnails(path.parent / "whole" / path.name)
        place.parent.parent.mkdir(parents=True, exist_ok=True)
        os.rename(lines_path(path.parent / "whole", "clip", "one").parent, place.parent)
    place.write_bytes(path.read_bytes())
    return read_thumbnails(path.parent, _verdicts())


@cache
def _shown() -> Any:
    return [show(frame, things=(1, 2, 3, 4), gaze_at=4) for frame in (1, 2, 3)]


@cache
def _verdicts() -> Any:
    reference = Reference(labels={"clip": labels("red cup", "red cup", "red cup", subject=ANN)})
    return score((each.record for each in _shown()), reference).verdicts


# The cache: nothing in it may stop a run


_IDENTITY = Identity(slot="stereo", parts={"stage": "bm", "clip": "mine", "settings": {}}, digest="abc")


def write_entry(path: Path) -> None:
    instances = Instances(
        ids=np.zeros((6, 8), np.uint16),
        instances=(Instance(id=3, label="cup", category_id=47, is_thing=True, score=0.1),),
    )
    values = (Disparity(disparity_px=np.ones((6, 8), np.float32)), instances, (Head(box_px=np.arange(4.0), score=0.3),))
    path.write_bytes(encode((f"{_IDENTITY.digest}/{path.name}", 0.5, values)))


def load_entry(path: Path) -> Any:
    """The damaged bytes behind a right checksum, as a stage's stored output."""

    class Here(StoredOutputs):
        def _path(self, inputs: Any) -> Path:
            return path

    data = path.read_bytes()
    path.write_bytes(hashlib.blake2b(data, digest_size=16).digest() + data)
    return Here(store=Store(path.parent, 10**9), identity=_IDENTITY, tally=Tally()).load(())


def write_identity(path: Path) -> None:
    parts = {
        "stage": "bm",
        "clip": "mine",
        "settings": {"a": 1},
        "code": "x",
        "versions": {"n": "2"},
    }
    write_text(path, json.dumps(parts))


def use_identity(path: Path) -> Any:
    store = Store(path.parent, 10**9)
    place = store.folder("stereo", "abc") / path.name
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_bytes(path.read_bytes())
    return store.usage(), difference(_IDENTITY.parts, store.described("stereo"))


def write_pair(path: Path) -> None:
    write_image(path.with_suffix(".png"), picture(1, 20, 10))
    path.write_bytes(path.with_suffix(".png").read_bytes())


def load_rendered(path: Path) -> Any:
    """The damaged bytes behind a right checksum."""
    data = path.read_bytes()
    path.write_bytes(hashlib.sha256(data).digest() + data)
    return load_pair(path)


# Outputs of stages, and measurements


def read_saved_heads(path: Path) -> Any:
    return read_heads(path, PlainClip())


def write_coco(path: Path) -> None:
    ids = np.zeros((48, 64, 3), np.uint8)
    ids[:20, :, 0] = 3  # R is the lowest byte of an id
    for number in (1, 2):
        write_image(path.parent / "png" / f"frame_{number:04d}.png", ids)
    annotations = [
        {"image_id": n, "file_name": f"frame_{n:04d}.png", "segments_info": [{"id": 3, "category_id": 1, "score": 0.5}]}
        for n in (1, 2)
    ]
    categories = [{"id": 1, "name": "person", "isthing": 1}, {"id": 187, "name": "sky", "isthing": 0}]
    write_text(path, json.dumps({"images": [], "annotations": annotations, "categories": categories}))


def read_coco(path: Path) -> Any:
    if not (path.parent / "png").is_dir():
        write_coco(path.parent / "whole" / path.name)
        os.rename(path.parent / "whole" / "png", path.parent / "png")
    clip = PlainClip()
    segmenter = CocoPanoptic(CocoPanopticSettings(root=str(path.parent), partial=True, stuff="all"), clip)
    try:
        return [segmenter.segment(clip.frame(number)) for number in (1, 2)]
    except VfoaError as error:  # of a mask that another name leads to
        raise VfoaError(f"{path}: {error}") from None


def open_tables(path: Path) -> Any:
    """Both tables; the one that is not damaged is whole."""
    if not (path.parent / "people.csv").exists() or not (path.parent / "objects.csv").exists():
        whole = measured_tables(path.parent / "whole", range(1, 5))
        for name in ({"people.csv", "objects.csv"}) - {path.name}:
            os.rename(whole / name, path.parent / name)
    people = path.name if path.name.startswith("people") else "people.csv"
    clip = open_measured("measured", path.parent, people_file=people, objects_file="objects.csv")
    return [clip.scene(number) for number in clip.frames]


def open_idiap(path: Path) -> Any:
    clip = open_measured("idiap_vfoa", path.parent, file=path.name)
    return [clip.scene(number) for number in clip.frames]
