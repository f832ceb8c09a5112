"""Replay: the second half of the pipeline on a run's records, with other settings of attention; no images, no models.

Directions are those of the record, after the run's filter. A record has no clouds, so targets are their boxes.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from harness.run.records import BoxRecord, FrameRecord, SubjectRecord, TargetRecord, attention_records
from vfoa.bayes import BayesSettings, BeliefState, infer_attentions
from vfoa.types import Attention, Box3D, Cues, Gaze, HeadPose, Instance, Person, Subject, Target

_NO_POINTS = np.zeros((0, 3), np.float32)


def replay(records: Iterable[FrameRecord], settings: BayesSettings, name: str) -> Iterator[FrameRecord]:
    """Yield the records of one clip with the attention under these settings, as of the configuration ``name``."""
    state = BeliefState()
    for record in records:
        targets = tuple(to_target(each) for each in record.targets)
        subjects = tuple(to_subject(each) for each in record.subjects)
        attentions, state = infer_attentions(subjects, targets, state, settings, record.time_ns)
        by_track = {each.subject.track_id: each for each in attentions}
        found = tuple(_answered(each, by_track[each.track_id]) for each in record.subjects)
        yield replace(record, configuration=name, subjects=found)


def _answered(subject: SubjectRecord, attention: Attention) -> SubjectRecord:
    return replace(
        subject,
        missing=None if attention.missing is None else attention.missing.value,
        attention=attention_records(attention),
        focus=attention.focus,
        tied=attention.tied,
        fit=None,
    )


def to_subject(record: SubjectRecord) -> Subject:
    """Convert a person of a record to a subject, with the directions after the filter."""
    gaze = None if record.gaze is None else Gaze(direction=np.array(record.gaze), sigma_rad=record.gaze_sigma_rad)
    head = None if record.head is None else HeadPose(direction=np.array(record.head))
    origin = None if record.eye_origin_m is None else np.array(record.eye_origin_m)
    number = -record.track_id if record.instance_id is None else record.instance_id  # no target has a negative id
    person = Person(view=Cues(head_pose=head, gaze=gaze), instance_id=number, eye_origin_left=origin)
    return Subject(track_id=record.track_id, person=person, gaze=gaze, head_pose=head)


def to_target(record: TargetRecord) -> Target:
    """Convert a target of a record; records have no clouds."""
    instance = Instance(id=record.instance_id, label=record.label, category_id=0, is_thing=True, score=record.score)
    return Target(
        instance=instance,
        box_px=None,
        points_left=_NO_POINTS,
        box=None if record.box is None else _box(record.box),
    )


def _box(record: BoxRecord) -> Box3D:
    return Box3D(
        center_m=np.array(record.center_m),
        half_size_m=np.array(record.half_size_m),
        left_from_box=np.array(record.axes).T,
    )
