"""Values are frozen, their arrays read-only, and what cannot be is refused when it is made."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

from tests.scenes import make_box, make_person, make_rig, make_subject, make_target, rendered_boxes
from vfoa.types import (
    Box3D,
    Cone,
    Disparity,
    Gaze,
    Head,
    HeadPose,
    HeadView,
    Instance,
    Instances,
    Person,
    Rays,
    StereoFrame,
    StereoRig,
    Target,
)

RIG = make_rig(8, 6)
CUP = Instance(id=1, label="cup", category_id=41, is_thing=True, score=0.9)


def image(height=6, width=8, dtype=np.uint8):
    return np.zeros((height, width, 3), dtype)


def frame(**changes):
    return StereoFrame(**{"index": 1, "time_ns": 0, "left": image(), "right": image(), "rig": RIG, **changes})


VALUES = [
    RIG,
    frame(),
    Disparity(disparity_px=np.ones((6, 8), np.float32), confidence=np.ones((6, 8), np.float32)),
    CUP,
    Instances(ids=np.ones((6, 8), np.uint16), instances=(CUP,)),
    Head(box_px=np.array([0.0, 0, 2, 2]), score=1.0, landmarks_px=np.zeros((5, 2))),
    HeadPose(direction=np.array([0.0, 0, -1])),
    Gaze(direction=np.array([0.0, 0, -1]), sigma_rad=0.1),
    HeadView(head=make_person().view.head, head_pose=None, gaze=None, crop=image()),
    rendered_boxes(RIG, [make_box((0, 0, 2))]),
    make_box((0, 0, 2)),
    make_target(1, None),
    make_person(),
    make_subject(),
    Cone(cue="gaze", apex_left=np.zeros(3), axis=np.array([0.0, 0, 1]), fov_rad=0.1, n_rays=4),
    Rays(
        origin_left=np.zeros(3),
        directions=np.ones((2, 3)),
        cone_index=np.zeros(2, np.intp),
        entry_m=np.ones((2, 5)),
    ),
]


def name(value):
    return type(value).__name__


@pytest.mark.parametrize("value", VALUES, ids=name)
def test_a_value_cannot_be_changed(value):
    for field in dataclasses.fields(value):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(value, field.name, getattr(value, field.name))
        found = getattr(value, field.name)
        if isinstance(found, np.ndarray):
            with pytest.raises(ValueError, match="read-only"):
                found[...] = 0


@pytest.mark.parametrize("value", VALUES, ids=name)
def test_a_value_has_no_room_for_other_names(value):
    assert not hasattr(value, "__dict__")
    with pytest.raises(TypeError):
        type(value)(*dataclasses.astuple(value))


@pytest.mark.parametrize("value", VALUES, ids=name)
def test_a_value_travels_to_another_process(value):
    copy = pickle.loads(pickle.dumps(value))
    for field in dataclasses.fields(value):
        a, b = getattr(value, field.name), getattr(copy, field.name)
        if not dataclasses.is_dataclass(a) and not isinstance(a, tuple):
            np.testing.assert_equal(b, a)


def test_the_makers_own_array_stays_writable():
    ids = np.zeros((6, 8), np.uint16)
    Instances(ids=ids, instances=())
    ids[0, 0] = 1


WRONG = [
    ("left: expected shape .6, 8, 3., found .6, 7, 3.", lambda: frame(left=image(width=7))),
    ("right: expected shape .6, 8, 3., found .5, 8, 3.", lambda: frame(right=image(height=5))),
    ("right: expected dtype uint8, found float32", lambda: frame(right=image(dtype=np.float32))),
    ("disparity_px: expected dtype float32, found float64", lambda: Disparity(disparity_px=np.zeros((6, 8)))),
    ("disparity_px: expected dtype float32, found int16", lambda: Disparity(disparity_px=np.zeros((6, 8), np.int16))),
    (
        "confidence: expected shape .6, 8., found .6, 7.",
        lambda: Disparity(disparity_px=np.zeros((6, 8), np.float32), confidence=np.zeros((6, 7), np.float32)),
    ),
    ("ids: expected dtype uint16", lambda: Instances(ids=np.zeros((6, 8), np.uint8), instances=())),
    ("ids: holds .3., which no instance has", lambda: Instances(ids=np.full((6, 8), 3, np.uint16), instances=(CUP,))),
    ("distinct ids above 0", lambda: Instances(ids=np.zeros((6, 8), np.uint16), instances=(CUP, CUP))),
    ("u0 < u1 and v0 < v1", lambda: Head(box_px=np.array([5.0, 0, 5, 9]), score=1.0)),
    ("u0 < u1 and v0 < v1", lambda: Head(box_px=np.array([np.nan, 0, 5, 9]), score=1.0)),
    ("u0 < u1 and v0 < v1", lambda: Head(box_px=np.array([0.0, 0, np.inf, 9]), score=1.0)),
    ("score: expected a finite number", lambda: Head(box_px=np.arange(4.0), score=np.nan)),
    ("Gaze.sigma_rad: expected an angle", lambda: Gaze(direction=np.ones(3), sigma_rad=np.nan)),
    ("HeadPose.sigma_rad: expected an angle", lambda: HeadPose(direction=np.ones(3), sigma_rad=-0.1)),
    ("eye_origin_left: expected a point or None", lambda: make_person(eyes=(0, np.nan, 1))),
    (
        "landmarks_px: expected shape .5, 2.",
        lambda: Head(box_px=np.arange(4.0), score=1.0, landmarks_px=np.ones((4, 2))),
    ),
    ("Gaze.direction: expected a direction", lambda: Gaze(direction=np.zeros(3))),
    ("HeadPose.direction: expected a direction", lambda: HeadPose(direction=np.array([np.nan, 0, 1]))),
    (
        "crop: expected shape",
        lambda: HeadView(head=make_person().view.head, head_pose=None, gaze=None, crop=image()[0]),
    ),
    ("left: expected an array of uint8, found NoneType", lambda: frame(left=None)),
    ("finite numbers and positive half sizes", lambda: make_box((0, 0, 1), (1, 1, 0))),
    ("finite numbers and positive half sizes", lambda: make_box((0, 0, 1), (1, 1, np.inf))),
    ("finite numbers and positive half sizes", lambda: make_box((0, np.nan, 1))),
    (
        "finite numbers and positive half sizes",
        lambda: Box3D(center_m=np.zeros(3), half_size_m=np.ones(3), left_from_box=np.full((3, 3), np.nan)),
    ),
    ("center_m: expected shape .3.", lambda: make_box((0, 1))),
    (
        "points_left: expected dtype float32",
        lambda: Target(instance=CUP, box_px=np.zeros(4), points_left=np.zeros((4, 3)), box=None),
    ),
    (
        "points_left: expected shape .any, 3.",
        lambda: Target(instance=CUP, box_px=np.zeros(4), points_left=np.zeros((4, 2), np.float32), box=None),
    ),
    (
        "eye_origin_left: expected shape .3.",
        lambda: Person(view=make_person().view, instance_id=None, eye_origin_left=np.zeros(2)),
    ),
    (
        "entry_m: expected shape .2, any.",
        lambda: Rays(
            origin_left=np.zeros(3),
            directions=np.ones((2, 3)),
            cone_index=np.zeros(2, np.intp),
            entry_m=np.ones((3, 5)),
        ),
    ),
    ("baseline_m: expected a positive number, found 0", lambda: make_rig(baseline_m=0)),
    ("width_px: expected a positive number, found 0", lambda: make_rig(width_px=0)),
    ("fx_px: expected a finite number, found nan", lambda: make_rig(fx_px=float("nan"))),
]


@pytest.mark.parametrize(("message", "make"), WRONG, ids=[message for message, _ in WRONG])
def test_what_cannot_be_is_refused_and_named(message, make):
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("place", [(0, 0), (2, 3), (3, 0), (5, 7)])
def test_a_single_pixel_of_an_unknown_instance_is_found(place):
    ids = np.ones((6, 8), np.uint16)
    ids[place] = 3
    with pytest.raises(ValueError, match=r"ids: holds \[3\], which no instance has; instances: \[1\]"):
        Instances(ids=ids, instances=(CUP,))


@pytest.mark.parametrize("part", ["disparity", "instances"])
def test_the_maps_of_a_frame_have_its_size(part):
    good = rendered_boxes(RIG, [])
    other = rendered_boxes(make_rig(9, 6), [])
    with pytest.raises(ValueError, match=rf"Percepts\.{part}: .*\(6, 8\), .*\(6, 9\)"):
        dataclasses.replace(good, **{part: getattr(other, part)})


def test_directions_are_unit_vectors_whatever_is_given():
    for value in (Gaze(direction=(0, 0, -5)), HeadPose(direction=(0, 0, -5))):
        np.testing.assert_array_equal(value.direction, [0, 0, -1])


def test_plain_numbers_make_arrays():
    box = Box3D(center_m=[0, 0, 1], half_size_m=[1, 2, 3], left_from_box=np.eye(3))
    assert box.half_size_m.dtype == np.float64
    np.testing.assert_array_equal(box.half_size_m, [1.0, 2.0, 3.0])


def test_what_was_measured_and_what_was_not():
    disparity = np.full((6, 8), np.nan, np.float32)
    disparity[:3] = 1
    assert Disparity(disparity_px=disparity).known_share == 0.5
    subject = make_subject(gaze=(0, 0, 1))
    np.testing.assert_array_equal(subject.direction("gaze"), [0, 0, 1])
    assert subject.direction("head") is None


def test_the_camera_matrix_projects():
    rig = StereoRig(width_px=8, height_px=6, fx_px=10, fy_px=20, cx_px=3, cy_px=2, baseline_m=0.1, cx_right_px=3)
    u, v, w = rig.camera_matrix @ [1, 1, 2]
    assert (u / w, v / w) == (8, 12)


def test_masks_are_the_pixels_of_one_instance():
    ids = np.zeros((6, 8), np.uint16)
    ids[2, 3] = 1
    assert np.argwhere(Instances(ids=ids, instances=(CUP,)).mask(1)).tolist() == [[2, 3]]
