"""A run of four small frames with all that a recording must cope with, computed by the real second half."""

from __future__ import annotations

import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.clips.naming import FrameNames
from harness.labels.labels import Label, LabelRange, Labels
from harness.pipeline.perception import FollowedFrame, SharedFrame
from harness.record.composed import find_clips
from harness.record.layers import ClipFiles, LayerNames, layer_names, recording_ids
from harness.record.recorder import Recorder, SharedRecorder, noted_colours
from harness.record.verdict_layer import write_verdict_layers
from harness.run.directory import RunDirectory
from harness.run.frame_sink import Camera, FinishedFrame
from harness.run.records import FrameRecord, to_record
from harness.score.verdicts import Verdict
from tests.frame_by_frame import judge
from tests.record_tables import write_tables
from tests.records import write_manifest
from vfoa.cones import ConesSettings, pay_attention
from vfoa.geometry import fov_from_radius
from vfoa.tracking import Tracked
from vfoa.types import (
    Box3D,
    Disparity,
    FrameResult,
    Gaze,
    Head,
    HeadPose,
    HeadView,
    Instance,
    Instances,
    Percepts,
    Person,
    Scene,
    StereoFrame,
    StereoRig,
    Subject,
    Target,
)

ANN = "Ann Müller/left"
"""A name that an entity path cannot hold unescaped."""

NAMES = {1: ANN, 2: "red cup", 3: "red cup", 4: "book#4"}
EYES = np.array([0.0, -0.1, 1.5])
CENTRES = {1: (0.0, 0.1, 1.5), 2: (-0.4, 0.1, 1.0), 3: (-0.4, 0.1, 1.6), 4: (0.4, 0.1, 1.0)}


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """One frame with all that a recording shows of it: images, percepts, result and record."""

    frame: StereoFrame
    percepts: Percepts
    result: FrameResult
    record: FrameRecord

    @property
    def finished(self) -> FinishedFrame:
        """The frame as the sink of a configuration gets it."""
        return FinishedFrame(camera=Camera.of(self.frame), result=self.result, record=self.record, timings={})

    @property
    def followed(self) -> FollowedFrame:
        """What a configuration has perceived."""
        scene, attentions = self.result.scene, self.result.attentions
        tracks = frozenset(attention.subject.track_id for attention in attentions)
        tracked = Tracked(ids=tuple(tracks), open=tracks)
        return FollowedFrame(self.percepts, scene, tracked, FrameNames(subjects={}, targets=scene.names), {})


def shared(frames: Mapping[str, Shown]) -> SharedFrame:
    """The same frame under these configurations, as the sink of a clip gets it."""
    frame = next(iter(frames.values())).frame
    by_configuration = {name: each.followed for name, each in frames.items()}
    return SharedFrame(index=frame.index, frame=frame, by_configuration=by_configuration)


def show(index: int, *, things: tuple[int, ...], head: bool = True, gaze_at: int | None = None, turn: int = 0) -> Shown:
    """One frame: the instances in ``things``, Ann where ``head``, her gaze at one of them, her head at the book.

    ``turn`` is added to every instance's id: a segmenter that numbers anew.
    """
    rig = StereoRig(
        width_px=96, height_px=64, fx_px=80, fy_px=80, cx_px=47.5, cy_px=31.5, baseline_m=0.1, cx_right_px=47.5
    )
    rng = np.random.default_rng(index)
    left, right = rng.integers(0, 256, (2, 64, 96, 3), dtype=np.uint8)
    frame = StereoFrame(index=index, time_ns=index * 40_000_000, left=left, right=right, rig=rig)
    ids = np.zeros((64, 96), dtype=np.uint16)
    instances = []
    for thing in things:
        ids[20:40, 20 * (thing - 1) : 20 * thing] = thing + turn
        label = {1: "person", 4: "book"}.get(thing, "cup")
        instances.append(Instance(id=thing + turn, label=label, category_id=thing, is_thing=True, score=0.9))
    disparity = np.full((64, 96), 8.0, dtype=np.float32)
    disparity[:5] = np.nan
    views = (_view(gaze_at),) if head else ()
    percepts = Percepts(
        index=index,
        time_ns=frame.time_ns,
        rig=rig,
        disparity=Disparity(disparity_px=disparity, confidence=np.full((64, 96), 0.5, dtype=np.float32)),
        instances=Instances(ids=ids, instances=tuple(instances)),
        views=views,
    )
    targets = tuple(_target(instance, instance.id - turn, rng) for instance in instances)
    people = tuple(Person(view=view, instance_id=1 + turn, eye_origin_left=EYES) for view in views)
    names = {thing + turn: NAMES[thing] for thing in things}
    scene = Scene(index=index, time_ns=frame.time_ns, targets=targets, people=people, names=names)
    settings = ConesSettings(cones_cm=(10, 25))
    subjects = [Subject(track_id=7, person=p, gaze=p.view.gaze, head_pose=p.view.head_pose, name=ANN) for p in people]
    result = FrameResult(scene=scene, attentions=tuple(pay_attention(s, targets, settings) for s in subjects))
    record = to_record("clip", "two cones", result)
    return Shown(frame=frame, percepts=percepts, result=result, record=record)


LABEL = Label(target="red cup")
LABELS = Labels([LabelRange(first_frame=0, last_frame=1000, subject=ANN, label=LABEL)])


def verdict(frame: Shown) -> Verdict:
    """The verdict on Ann."""
    return judge(frame.record, ANN, LABEL)


def _view(gaze_at: int | None) -> HeadView:
    gaze = None if gaze_at is None else Gaze(direction=np.array(CENTRES[gaze_at]) - EYES)
    head_pose = HeadPose(direction=np.array(CENTRES[4]) - EYES)
    return HeadView(head=Head(box_px=np.array([2.0, 20, 18, 34]), score=1), head_pose=head_pose, gaze=gaze)


def _target(instance: Instance, thing: int, rng: np.random.Generator) -> Target:
    centre = np.array(CENTRES[thing])
    turn = fov_from_radius(0.3) * thing
    rotation = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    points = (centre + rng.uniform(-0.1, 0.1, (400, 3))).astype(np.float32)
    box = Box3D(center_m=centre, half_size_m=np.array([0.1, 0.12, 0.08]), left_from_box=rotation)
    box_px = np.array([20.0 * (thing - 1), 20, 20 * thing - 1, 39])
    return Target(instance=instance, box_px=box_px, points_left=points, box=None if thing == 3 else box)


@pytest.fixture
def frames() -> list[Shown]:
    return four_frames()


def four_frames() -> list[Shown]:
    """Gaze at the cup; the gaze lost and the cups gone; nobody there; all back, numbered anew."""
    return [
        show(10, things=(1, 2, 3, 4), gaze_at=2),
        show(11, things=(1, 4), gaze_at=None),
        show(13, things=(4,), head=False),
        show(14, things=(1, 2, 3, 4), gaze_at=4, turn=300),
    ]


CONFIGURATION = "two cones"
LAYERS = LayerNames(configuration=CONFIGURATION, masks=CONFIGURATION, reconstruction=CONFIGURATION)


@dataclass(frozen=True)
class Recorded:
    """The output of a run: its directory, and the clip's files."""

    run: Path
    configurations: tuple[str, ...]

    @property
    def files(self) -> ClipFiles:
        return ClipFiles(run=self.run, clip="clip")

    @property
    def paths(self) -> tuple[Path, ...]:
        return find_clips(self.run, None, None)[0].compose().files


def under(frame: Shown, configuration: str) -> Shown:
    """The same frame under another configuration."""
    return replace(frame, record=replace(frame.record, configuration=configuration))


def write_run(run: Path, frames: Mapping[str, list[Shown]], **options: Any) -> Recorded:
    """A run's manifest, results, recordings and verdicts, from the frames of each configuration.

    All configurations share the masks; the first and the second have a reconstruction each.
    """
    tables = {name: {"stereo": {"first": place < 1}, "attention": {"of": name}} for place, name in enumerate(frames)}
    layers = layer_names(tables)
    numbers = sorted({each.record.frame for found in frames.values() for each in found})
    directory = RunDirectory(run)
    names = {"subjects": {ANN: {}}, "targets": {"red cup": {}}}
    clip = {"name": "clip", "frames": numbers, "rate_hz": 25, "names": names}
    options = {"rate_hz": 25, "names": ["red cup", ANN], **options}
    of_each = {"names": options["names"], "probabilistic": options.pop("probabilistic", False)}
    methods = {name: {"probabilistic": of_each["probabilistic"]} for name in frames}
    write_manifest(directory, {"clips": [clip], "configurations": tables, "methods": methods, "finished": "now"})
    files = ClipFiles(run=run, clip="clip", ids=recording_ids(str(uuid.uuid4()), "clip"))
    with SharedRecorder(files, layers, **options) as recorder:
        for number in numbers:
            recorder.write(
                shared({name: each for name, found in frames.items() for each in found if each.record.frame == number})
            )
    for name, found in frames.items():
        colours = noted_colours(files, [name])
        assert colours
        with Recorder(files, layers[name], colours, per_second=25, **of_each) as of_one:
            for frame in found:
                of_one.write(under(frame, name).finished)
    records = {("clip", name): [under(frame, name).record for frame in found] for name, found in frames.items()}
    write_tables(directory, records)
    write_verdict_layers(directory, {"clip": LABELS})
    return Recorded(run, tuple(frames))


@pytest.fixture
def record_run(tmp_path: Path) -> Callable[..., Recorded]:
    """Record frames under one configuration, in a run called ``run``."""

    def write(frames: list[Shown], **options: Any) -> Recorded:
        return write_run(tmp_path / "run", {CONFIGURATION: frames}, **options)

    return write


class Columns:
    """A recording read back by Rerun's own reader: a file, or all layers of a run."""

    def __init__(self, source: Path | Recorded) -> None:
        from rerun.chunk import RrdReader

        self._batches: dict[str, list[Any]] = {}
        for path in (source,) if isinstance(source, Path) else source.paths:
            for chunk in RrdReader(path).stream():
                self._batches.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())

    @property
    def paths(self) -> set[str]:
        """Every entity that holds something."""
        return set(self._batches)

    def at(self, path: str, component: str) -> dict[int, Any]:
        """The values of a component of an entity by frame."""
        found: dict[int, Any] = {}
        for batch in self._batches.get(path, ()):
            if component in batch.schema.names and "frame" in batch.schema.names:
                values = batch.column(component).to_pylist()
                frames = batch.column("frame").to_pylist()
                found |= {f: value for f, value in zip(frames, values, strict=True) if value is not None}
        return found

    def static(self, path: str, component: str) -> Any:
        """The last static value of a component of an entity."""
        found = [
            value
            for batch in self._batches.get(path, ())
            if component in batch.schema.names and "frame" not in batch.schema.names
            for value in batch.column(component).to_pylist()
        ]
        return found[-1]

    def everything(self, path: str) -> dict[str, dict[int, Any]]:
        """Every value of an entity that has a time, by component and frame."""
        names = {
            name for batch in self._batches[path] for name in batch.schema.names if ":" in name and "." not in name
        }
        return {name: found for name in names if (found := self.at(path, name))}

    def timelines(self, path: str) -> set[str]:
        """The timelines an entity has values on."""
        return {
            name for batch in self._batches[path] for name in batch.schema.names if ":" not in name and "." not in name
        }


@pytest.fixture
def read_back() -> type[Columns]:
    """Read a recording."""
    return Columns
