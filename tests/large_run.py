"""A finished run of any length, seeded, with measures of its stages; and labels for it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from harness.pipeline.measures import DisparityMeasure, FrameMeasures, PersonMeasure, TargetMeasure
from harness.run.directory import RunDirectory
from harness.run.records import AttentionRecord, BoxRecord, FrameRecord, SubjectRecord, TargetRecord
from tests import records
from tests.disk import labels_text
from tests.record_tables import MeasuredRecord
from tests.records import write_manifest
from vfoa.types import Float

_THINGS = ("mug", "book", "bottle", "vase", "laptop", "ball")
_PEOPLE = ("anna", "ben", "cara")
_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
_CLIP = "large"


def write_run(root: Path, frames: int, configurations: int, subjects: int) -> RunDirectory:
    names = [f"configuration-{number}" for number in range(configurations)]
    directory = RunDirectory(root / "run")
    clip = {
        "name": _CLIP,
        "manifest": str(_write_clip(root, subjects)),
        "licence": "MIT",
        "notes": [],
        "rate_hz": 25.0,
        "frames": list(range(1, frames + 1)),
    }
    write_manifest(
        directory,
        {
            "experiment": "large",
            "notes": [],
            "clips": [clip],
            "configurations": {name: {"attention": {"cones_cm": [k]}} for k, name in enumerate(names, start=1)},
            "versions": {},
            "finished": "now",
        },
    )
    return records.write_run(root / "run", measured_records(frames, configurations, subjects))


def measured_records(frames: int, configurations: int, subjects: int) -> Iterator[FrameRecord]:
    """The records of the run, with measures."""
    rng = np.random.default_rng(0)
    for number in range(configurations):
        yield from _records(f"configuration-{number}", frames, subjects, rng)


def _write_clip(root: Path, subjects: int) -> Path:
    named = [("subjects", name) for name in _PEOPLE[:subjects]] + [("targets", name) for name in _THINGS]
    tables = "".join(f'[{kind}.{name}]\ncategory = "{name}"\n' for kind, name in named)
    path = root / "datasets" / f"{_CLIP}.toml"
    path.parent.mkdir()
    path.write_text(f'name = "{_CLIP}"\nadapter = "studio"\nlicence = "MIT"\n{tables}', encoding="utf-8")
    return path


def write_labels(root: Path, frames: int, subjects: int, edit: int) -> None:
    """Fixations of 20 frames, one target after the other; ``edit`` changes all of them."""
    rows = [
        f"{first},{min(first + 19, frames)},{name},{_THINGS[(first // 20 + k + edit) % len(_THINGS)]},"
        for k, name in enumerate(_PEOPLE[:subjects])
        for first in range(1, frames + 1, 20)
    ]
    path = root / "annotations" / f"{_CLIP}.csv"
    path.parent.mkdir(exist_ok=True)
    path.write_text(labels_text(*rows), encoding="utf-8")


def _records(configuration: str, frames: int, subjects: int, rng: np.random.Generator) -> Iterator[FrameRecord]:
    """Frames of six objects; each subject attends to all of them, and mostly to the right one."""
    for frame in range(1, frames + 1):
        numbers = rng.uniform(0, 1, (subjects, len(_THINGS), 2))
        for k in range(subjects):
            numbers[k, (frame // 20 + k) % len(_THINGS)] += rng.uniform(0, 2)
        yield MeasuredRecord(
            clip=_CLIP,
            configuration=configuration,
            frame=frame,
            time_ns=frame * 40_000_000,
            targets=tuple(_target(number, name) for number, name in enumerate(_THINGS, start=1)),
            subjects=tuple(_subject(_PEOPLE[k], k, numbers[k]) for k in range(subjects)),
            measures=_measures(rng.uniform(0, 1, 4), subjects),
        )


def _target(number: int, name: str) -> TargetRecord:
    """A target with a box."""
    box = BoxRecord(center_m=(0.1 * number, 0.2, 1.5), half_size_m=(0.04, 0.06, 0.05), axes=_AXES)
    box_px = (60.0 * number, 200.0, 60.0 * number + 40, 260.0)
    return TargetRecord(instance_id=number, name=name, label=name, score=0.9, box_px=box_px, points=800, box=box)


def _subject(name: str, place: int, numbers: Float) -> SubjectRecord:
    """A subject with gaze and head parts (targets, 2), who looks at the target with the most."""
    parts = [(0.6 * float(gaze), 0.4 * float(head)) for gaze, head in numbers]
    attention = tuple(
        AttentionRecord(instance_id=number, gaze=gaze, head=head, total=gaze + head)
        for number, (gaze, head) in enumerate(parts, start=1)
    )
    return SubjectRecord(
        track_id=place + 1,
        name=name,
        instance_id=None,
        head_box_px=(200.0 * place, 20.0, 200.0 * place + 60, 100.0),
        eye_origin_m=(0.3 * place, -0.2, 1.8),
        gaze=(0.0, 0.6, -0.8),
        gaze_sigma_rad=0.1,
        head=(0.0, 0.0, -1.0),
        missing=None,
        attention=attention,
        focus=max(attention, key=lambda each: each.total).instance_id,
        tied=(),
    )


def _measures(numbers: Float, subjects: int) -> FrameMeasures:
    share, error, eyes, angle = numbers.tolist()
    return FrameMeasures(
        disparity=DisparityMeasure(error_px=error, over_2_px=share, known=share),
        targets=tuple(
            TargetMeasure(
                truth_id=number, label=name, instance_id=number, mask_iou=1.0, box_iou=share, center_error_m=eyes
            )
            for number, name in enumerate(_THINGS, start=1)
        ),
        people=tuple(
            PersonMeasure(name=name, head_box_iou=1.0, eye_error_m=eyes, head_error_deg=angle, gaze_error_deg=2 * angle)
            for name in _PEOPLE[:subjects]
        ),
    )
