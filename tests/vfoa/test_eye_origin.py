"""The eye origin on spherical heads: the truth is the point where the head's direction leaves them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.scenes import make_rig
from vfoa.crops import head_box, reaches_border
from vfoa.geometry import back_project, disparity_from_depth, unit
from vfoa.reconstruction import ReconstructionSettings, eye_origin
from vfoa.types import Disparity, Float, Head, HeadPose, HeadView, Instance, Instances, Percepts, StereoRig

RIG = make_rig(400, 300, fx_px=800)
WIDE = make_rig(640, 480, fx_px=300)
"""Sees 47 degrees to each side."""
RADIUS_M = 0.1
CENTER = np.array([0.03, -0.02, 1.2])
SIDEWAYS = unit([-1.0, 0.5, -0.6])


def ball(
    center: Float = CENTER, radius_m: float = RADIUS_M, rig: StereoRig = RIG, stretched: tuple[float, ...] = (1, 1, 1)
) -> Percepts:
    """A ball, instance 1, before a wall at 3 m; ``stretched`` along the camera's axes, an ellipsoid."""
    v, u = np.mgrid[: rig.height_px, : rig.width_px]
    towards = back_project(u, v, np.ones(u.shape), rig) / stretched
    rays, center = unit(towards), center / stretched
    along = rays @ center
    inside = along**2 - center @ center + radius_m**2
    hit = inside >= 0
    depth = np.where(hit, (along - np.sqrt(np.maximum(inside, 0))) / np.linalg.norm(towards, axis=2), 3.0)
    person = Instance(id=1, label="person", category_id=1, is_thing=True, score=1.0)
    return Percepts(
        index=1,
        time_ns=0,
        rig=rig,
        disparity=Disparity(disparity_px=disparity_from_depth(depth, rig).astype(np.float32)),
        instances=Instances(ids=hit.astype(np.uint16), instances=(person,)),
        views=(),
    )


def face_of(head_px: Float) -> Float:
    """The box (4,) of the face from which a head's is grown."""
    u0, v0, u1, v1 = head_px
    width, height = (u1 - u0) / 1.3, (v1 - v0) / 1.25
    return np.array([u0 + 0.15 * width, v0 + 0.2 * height, u1 - 0.15 * width, v1 - 0.05 * height])


def cut(percepts: Percepts, left: int, top: int, right: int, bottom: int) -> Percepts:
    """What is seen in a part of the image."""
    part, rig = (slice(top, bottom), slice(left, right)), percepts.rig
    return replace(
        percepts,
        rig=replace(
            rig,
            width_px=right - left,
            height_px=bottom - top,
            cx_px=rig.cx_px - left,
            cy_px=rig.cy_px - top,
            cx_right_px=rig.cx_right_px - left,
        ),
        disparity=Disparity(disparity_px=percepts.disparity.disparity_px[part]),
        instances=replace(percepts.instances, ids=percepts.instances.ids[part]),
    )


def view(percepts: Percepts, direction: Float | None) -> HeadView:
    """The head in the box about instance 1."""
    v, u = np.nonzero(percepts.instances.ids == 1)
    box = np.array([u.min() - 0.5, v.min() - 0.5, u.max() + 0.5, v.max() + 0.5])
    pose = None if direction is None else HeadPose(direction=direction)
    return HeadView(head=Head(box_px=box, score=1.0), head_pose=pose, gaze=None)


def found(percepts: Percepts, direction: Float | None, *, of: Percepts | None = None, **changes) -> Float | None:
    instance_id = changes.pop("instance_id", 1)
    return eye_origin(view(of or percepts, direction), instance_id, percepts, ReconstructionSettings(**changes))


def with_unknown(percepts: Percepts, unknown: np.ndarray) -> Percepts:
    disparity = np.where(unknown, np.nan, percepts.disparity.disparity_px).astype(np.float32)
    return replace(percepts, disparity=Disparity(disparity_px=disparity))


@given(
    right=st.floats(-0.9, 0.9),
    down=st.floats(-0.6, 0.6),
    z=st.floats(0.8, 2.5),
    radius=st.floats(0.06, 0.13),
    turn=st.floats(-1.4, 1.4),
    nod=st.floats(-1.0, 1.0),
)
def test_the_eyes_are_where_the_heads_direction_leaves_it(
    right: float, down: float, z: float, radius: float, turn: float, nod: float
) -> None:
    """Anywhere in the image, up to 47 degrees beside the axis, where a ball's outline is a long ellipse."""
    center = z * np.array([right, down, 1])
    direction = unit([np.sin(turn), np.sin(nod), -np.cos(turn)])
    seen = ball(center, radius, rig=WIDE)
    assume(not reaches_border(view(seen, direction).head.box_px, seen.instances.ids))
    origin = found(seen, direction)
    assert origin is not None
    # the box is exact to a pixel, which is z / f wide
    assert np.linalg.norm(origin - (center + radius * direction)) < z / WIDE.fx_px


@pytest.mark.parametrize("has_face", [False, True])
@pytest.mark.parametrize("side", range(4))
def test_a_head_cut_by_the_images_border_has_the_eyes_of_the_whole_head(side: int, has_face: bool) -> None:
    """A third of the head lies beyond the left, upper, right or lower border."""
    whole = ball(stretched=(0.75, 1, 0.75))
    head = view(whole, SIDEWAYS).head.box_px
    limits = np.array([0, 0, RIG.width_px, RIG.height_px])
    third = (head[2:] - head[:2])[side % 2] / 3
    limits[side] = round(head[side] + 0.5 + (third if side < 2 else -third))
    left, top, right, bottom = limits.tolist()
    seen = cut(whole, left, top, right, bottom)
    shown = view(seen, SIDEWAYS)
    if has_face:
        u0, v0 = face_of(head)[:2] - [left, top]
        u1, v1 = face_of(head)[2:] - [left, top]
        face = np.array([max(u0, -0.5), max(v0, -0.5), min(u1, right - left - 0.5), min(v1, bottom - top - 0.5)])
        shown = replace(shown, head=Head(box_px=head_box(face), face_box_px=face, score=1.0))
    origin, truth = eye_origin(shown, 1, seen, ReconstructionSettings()), found(whole, SIDEWAYS)
    assert origin is not None
    assert truth is not None
    assert np.linalg.norm(origin - truth) < 0.01


def test_the_patch_is_far_off_for_a_head_turned_away() -> None:
    truth = CENTER + RADIUS_M * SIDEWAYS
    by_head, by_patch = found(ball(), SIDEWAYS), found(ball(), SIDEWAYS, eyes="patch")
    assert by_head is not None
    assert by_patch is not None
    assert np.linalg.norm(by_head - truth) < 0.01
    assert np.linalg.norm(by_patch - truth) > 0.07


def test_thinned_out_points_give_nearly_the_same_eyes() -> None:
    origin = found(ball(), SIDEWAYS, max_eye_points=100)
    assert origin is not None
    assert np.linalg.norm(origin - (CENTER + RADIUS_M * SIDEWAYS)) < 0.01
    assert not np.array_equal(origin, found(ball(), SIDEWAYS))


def test_half_a_head_is_enough() -> None:
    """The other half has no disparity: the middle does not move with what is left."""
    columns = np.broadcast_to(np.arange(RIG.width_px), (RIG.height_px, RIG.width_px))
    half = with_unknown(ball(), columns < RIG.cx_px + 20)
    whole, rest = found(ball(), SIDEWAYS), found(half, SIDEWAYS)
    assert whole is not None
    assert rest is not None
    np.testing.assert_allclose(rest, whole, atol=0.004)


def test_mismatches_on_a_third_of_the_head_do_not_count() -> None:
    noise = np.random.default_rng(1).uniform(size=(RIG.height_px, RIG.width_px)) < 0.33
    clean = ball()
    wild = np.where(noise, 5.0, clean.disparity.disparity_px).astype(np.float32)
    disturbed, undisturbed = (
        found(each, SIDEWAYS) for each in (replace(clean, disparity=Disparity(disparity_px=wild)), clean)
    )
    assert disturbed is not None
    assert undisturbed is not None
    np.testing.assert_allclose(disturbed, undisturbed, atol=0.03)


def test_what_is_not_the_person_does_not_count() -> None:
    """A hand before the lower half, another instance, half a metre nearer."""
    clean = ball()
    rows = np.broadcast_to(np.arange(RIG.height_px)[:, None], (RIG.height_px, RIG.width_px))
    hand = (rows > 150) & (clean.instances.ids == 1)
    near = np.where(hand, disparity_from_depth(0.7, RIG), clean.disparity.disparity_px).astype(np.float32)
    ids = np.where(hand, 2, clean.instances.ids).astype(np.uint16)
    instances = tuple(replace(clean.instances.instances[0], id=number) for number in (1, 2))
    covered = replace(clean, disparity=Disparity(disparity_px=near), instances=Instances(ids=ids, instances=instances))
    one, other = found(covered, SIDEWAYS, of=clean), found(clean, SIDEWAYS)
    assert one is not None
    assert other is not None
    np.testing.assert_allclose(one, other, atol=0.005)


@pytest.mark.parametrize("changes", [{"eyes": "patch"}, {"direction": None}], ids=["chosen", "no direction"])
def test_without_a_direction_the_patch_decides(changes) -> None:
    origin = found(ball(), changes.pop("direction", SIDEWAYS), **changes)
    assert origin is not None
    assert np.linalg.norm(origin - CENTER) == pytest.approx(RADIUS_M, abs=0.01)
    assert origin[2] < CENTER[2] - 0.08


def test_a_head_of_which_nothing_is_known_has_no_eyes() -> None:
    unknown = with_unknown(ball(), np.ones((RIG.height_px, RIG.width_px), bool))
    assert found(unknown, SIDEWAYS) is None


def test_the_patch_is_a_fifth_of_the_box_wide_and_needs_exactly_so_many_points() -> None:
    """Known within it are two columns near its sides, 14 pixels, one of them wrong; all about it is much farther.

    The box is 40 px wide and begins at (100, 40): the patch reaches 4 px from (120, 61).
    """
    flat = ball()
    near, far, wrong = (float(disparity_from_depth(depth, RIG)) for depth in (2.0, 5.0, 0.3))
    disparity = np.full((RIG.height_px, RIG.width_px), far, np.float32)
    disparity[56:67, 115:126] = np.nan
    disparity[58:65, [117, 123]] = near
    disparity[58, 117] = wrong
    nobody = Instances(ids=np.zeros((RIG.height_px, RIG.width_px), np.uint16), instances=())
    percepts = replace(flat, disparity=Disparity(disparity_px=disparity), instances=nobody)
    head = HeadView(head=Head(box_px=np.array([100.0, 40, 140, 100]), score=1.0), head_pose=None, gaze=None)
    of_patch = [ReconstructionSettings(eyes="patch", min_eye_points=least) for least in (14, 15)]
    origins = [eye_origin(head, None, percepts, settings) for settings in of_patch]
    depths = [origin[2] for origin in origins if origin is not None]
    assert depths == pytest.approx([2.0, 5.0])
