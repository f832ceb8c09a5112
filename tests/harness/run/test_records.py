from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from harness.run.records import to_record
from vfoa.types import (
    Attention,
    Box3D,
    FrameResult,
    Gaze,
    Head,
    HeadView,
    Instance,
    NoAttention,
    NoGaze,
    Person,
    Scene,
    Subject,
    Target,
    TargetAttention,
)

# A turn by 90 degrees about z: the box's x axis is the camera's y axis.
LEFT_FROM_BOX = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])


def _result() -> FrameResult:
    cup = Target(
        instance=Instance(id=4, label="cup", category_id=47, is_thing=True, score=0.5),
        box_px=np.array([1.0, 2, 3, 4]),
        points_left=np.zeros((7, 3), np.float32),
        box=Box3D(center_m=np.array([1.0, 2, 3]), half_size_m=np.array([0.1, 0.2, 0.3]), left_from_box=LEFT_FROM_BOX),
    )
    view = HeadView(head=Head(box_px=np.array([5.0, 6, 7, 8]), score=1.0), head_pose=None, gaze=None)
    seen = Person(view=view, instance_id=2, eye_origin_left=np.array([0.1, 0.2, 1 / 3]))
    turned_away = dataclasses.replace(view, no_gaze=NoGaze(cause="face_turned_away"))
    unseen = Person(view=turned_away, instance_id=None, eye_origin_left=None)
    gaze = Gaze(direction=np.array([0.0, 0, 2]), sigma_rad=0.2)
    looking = Attention(
        subject=Subject(track_id=1, person=seen, gaze=gaze, head_pose=None, name="girl"),
        values=(TargetAttention(instance_id=4, gaze=0.9, head=float("nan"), total=0.9),),
        focus=4,
    )
    lost = Attention(
        subject=Subject(track_id=2, person=unseen, gaze=None, head_pose=None), missing=NoAttention.NO_EYES_3D
    )
    scene = Scene(index=7, time_ns=70, targets=(cup,), people=(seen, unseen), names={4: "cup"})
    return FrameResult(scene=scene, attentions=(looking, lost))


def test_a_record_holds_the_frame_in_plain_exact_values() -> None:
    record = to_record("clip", "best", _result())
    assert (record.clip, record.configuration, record.frame, record.time_ns) == ("clip", "best", 7, 70)
    target = record.target(4)
    assert (target.name, target.label, target.points, target.box_px) == ("cup", "cup", 7, (1.0, 2.0, 3.0, 4.0))
    assert target.box is not None
    assert target.box.axes[0] == (0.0, 1.0, 0.0)
    girl, other = record.subjects
    assert (girl.no_gaze, other.no_gaze) == (None, "face_turned_away")
    assert (girl.name, girl.instance_id, girl.eye_origin_m) == ("girl", 2, (0.1, 0.2, 1 / 3))
    assert (girl.gaze, girl.gaze_sigma_rad, girl.head, girl.focus) == ((0.0, 0.0, 1.0), 0.2, None, 4)
    assert (girl.attention[0].gaze, girl.attention[0].head, girl.attention[0].total) == (0.9, None, 0.9)
    assert (other.name, other.missing, other.focus, other.attention) == (None, "no_eyes_3d", None, ())


def test_a_record_is_json_without_nan() -> None:
    record = to_record("clip", "best", _result())
    assert json.loads(json.dumps(dataclasses.asdict(record), allow_nan=False))["targets"][0]["name"] == "cup"


def test_a_target_without_a_box_has_none() -> None:
    result = _result()
    (cup,) = result.scene.targets
    flat = dataclasses.replace(result.scene, targets=(dataclasses.replace(cup, box=None),))
    record = to_record("clip", "best", dataclasses.replace(result, scene=flat))
    assert record.target(4).box is None


def test_the_width_of_a_head_is_that_of_its_box_at_the_depth_of_the_eyes() -> None:
    widths = [subject.head_width_m for subject in to_record("clip", "best", _result(), fx_px=100.0).subjects]
    assert widths == [pytest.approx(2 / 100 / 3), None]
    assert [subject.head_width_m for subject in to_record("clip", "best", _result()).subjects] == [None, None]
