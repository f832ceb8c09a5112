"""Clouds, boxes and eye origins, from rendered scenes whose boxes are known exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from tests.scenes import make_box, make_rig, rendered_boxes
from vfoa.geometry import back_project, box_corners, depth_from_disparity, project
from vfoa.reconstruction import (
    ReconstructionSettings,
    _gated,
    _without_outliers,
    axis_aligned_box,
    oriented_box,
    reconstruct,
)
from vfoa.types import Disparity, Head, HeadView, Instance, Instances

RIG = make_rig(320, 200, fx_px=260)
CUBE = make_box((-0.4, 0.3, 1.8), 0.2)
SEEN = rendered_boxes(RIG, [CUBE])
SHAPE = (RIG.height_px, RIG.width_px)
PIXEL_M = 2.0 / 260
"""The size of a pixel at the depth of the cube's back, in metres."""
RAW = ReconstructionSettings(erode_px=0, outlier_ratio=1e6, gate_mads=1e6, max_points=10**6)


def seen_points(percepts, instance_id):
    """Every point of an instance, by the plain formula."""
    v, u = np.nonzero(percepts.instances.ids == instance_id)
    rig = percepts.rig
    z = rig.fx_px * rig.baseline_m / (percepts.disparity.disparity_px[v, u] + rig.cx_right_px - rig.cx_px)
    return np.stack([(u - rig.cx_px) * z / rig.fx_px, (v - rig.cy_px) * z / rig.fy_px, z], axis=-1)


def faces(box):
    return np.concatenate([box.center_m - box.half_size_m, box.center_m + box.half_size_m])


def with_disparity(percepts, mask, disparity_px):
    """The percepts with other disparities where the mask is set."""
    disparity = percepts.disparity.disparity_px.copy()
    disparity[mask] = disparity_px
    return replace(percepts, disparity=Disparity(disparity_px=disparity))


def only_target(percepts, **changes):
    (target,) = reconstruct(percepts, ReconstructionSettings(**changes)).targets
    return target


# Boxes


@pytest.mark.parametrize("offset_px", [0, -5, 12])
@given(center=st.tuples(st.floats(-0.2, 0.2), st.floats(-0.2, 0.2), st.floats(1.2, 3)), half=st.floats(0.12, 0.3))
def test_without_filters_a_box_holds_exactly_what_is_seen(offset_px, center, half):
    percepts = rendered_boxes(make_rig(160, 160, fx_px=130, cx_right_offset_px=offset_px), [make_box(center, half)])
    points = seen_points(percepts, 1)
    (target,) = reconstruct(percepts, RAW).targets
    assert len(target.points_left) == len(points)
    np.testing.assert_allclose(target.box.center_m - target.box.half_size_m, points.min(axis=0), atol=2e-3)
    np.testing.assert_allclose(target.box.center_m + target.box.half_size_m, points.max(axis=0), atol=2e-3)


def assert_near_the_cube(box, back_m=0.12):
    """To three pixels, and at the back, of which only a few pixels of slanted faces tell, to this many metres."""
    np.testing.assert_array_less(np.abs(faces(box) - faces(CUBE)), [*[3 * PIXEL_M] * 5, back_m])


@pytest.mark.parametrize("offset_px", [0, -5, 12])
def test_with_the_default_filters_a_box_is_true_to_a_few_pixels(offset_px):
    rig = make_rig(320, 200, fx_px=260, cx_right_offset_px=offset_px)
    assert_near_the_cube(only_target(rendered_boxes(rig, [CUBE])).box)


@given(seed=st.integers(0, 2**32 - 1))
def test_a_few_wrong_disparities_hardly_move_the_box(seed):
    rng = np.random.default_rng(seed)
    wrong = (SEEN.instances.ids == 1) & (rng.random(SHAPE) < 0.01)
    disturbed = with_disparity(SEEN, wrong, rng.uniform(2, 60, wrong.sum()))
    assert np.ptp(seen_points(disturbed, 1)[:, 2]) > 1
    np.testing.assert_allclose(faces(only_target(disturbed).box), faces(CUBE), atol=0.2)


def test_a_mask_that_takes_the_wall_along_hardly_moves_the_box():
    v, u = np.nonzero(SEEN.instances.ids)
    ids = SEEN.instances.ids.copy()
    ids[v.min() - 2 : v.max() + 3, u.min() - 2 : u.max() + 3] = 1
    greedy = replace(SEEN, instances=Instances(ids=ids, instances=SEEN.instances.instances))
    assert_near_the_cube(only_target(greedy).box)


def test_flying_pixels_between_the_thing_and_the_wall_hardly_move_the_box():
    """WLS and wide blocks draw a ramp of disparities over an edge."""
    ids, disparity = SEEN.instances.ids, SEEN.disparity.disparity_px
    v, u = np.nonzero(ids)
    edge = np.zeros(SHAPE, bool)
    edge[v.min() : v.max() + 1, u.max() - 1 : u.max() + 1] = True
    edge &= ids == 1
    ramped = with_disparity(SEEN, edge, np.linspace(disparity[edge].max(), disparity.min(), edge.sum()))
    assert_near_the_cube(only_target(ramped).box, back_m=0.2)


def test_unknown_pixels_are_left_out():
    hole = np.zeros(SHAPE, bool)
    u = np.nonzero(SEEN.instances.ids)[1]
    hole[:, : int(np.median(u))] = True
    (target,) = reconstruct(with_disparity(SEEN, hole, np.nan), RAW).targets
    visible = seen_points(SEEN, 1)[u >= int(np.median(u))]
    np.testing.assert_allclose(np.sort(target.points_left, axis=0), np.sort(visible, axis=0), atol=1e-4)


def test_a_disparity_that_no_depth_has_is_unknown():
    percepts = rendered_boxes(make_rig(160, 100, fx_px=130, cx_right_offset_px=-5), [make_box((0, 0, 2))])
    beyond = np.zeros(percepts.instances.ids.shape, bool)
    beyond[:50] = True
    (target,) = reconstruct(with_disparity(percepts, beyond, 4.0), RAW).targets
    assert len(target.points_left) == ((percepts.instances.ids == 1) & ~beyond).sum()


def test_a_flat_face_has_a_box_and_keeps_its_depth():
    target = only_target(rendered_boxes(RIG, [make_box((0, 0, 2), 0.3)]), erode_px=0)
    assert (target.box.half_size_m > 0).all()
    assert target.box.center_m[2] == pytest.approx(1.7, abs=1e-3)


def test_a_deep_thing_seen_from_the_front_keeps_its_depth():
    """More than half of what is seen is the front, so the depths have no median deviation."""
    target = only_target(rendered_boxes(RIG, [make_box((0, 0.32, 1.2), 0.2)]), erode_px=0)
    z = target.points_left[:, 2]
    assert np.median(np.abs(z - np.median(z))) < 1e-3
    assert z.max() - z.min() == pytest.approx(0.4, abs=0.03)


@pytest.mark.parametrize("boxes", ["aabb", "oriented"])
def test_too_few_points_give_no_box_but_keep_the_target(boxes):
    v, u = np.nonzero(SEEN.instances.ids)
    unknown = np.ones(SHAPE, bool)
    unknown[v[:19], u[:19]] = False
    sparse = with_disparity(SEEN, unknown, np.nan)
    target = only_target(sparse, boxes=boxes, erode_px=0)
    assert target.box is None
    assert 0 < len(target.points_left) < 20
    nothing = only_target(with_disparity(SEEN, unknown | True, np.nan), boxes=boxes)
    assert nothing.box is None
    assert nothing.points_left.shape == (0, 3)


def test_a_box_must_be_possible():
    with pytest.raises(ValidationError, match=r"min_points: .*1000, found 1001"):
        ReconstructionSettings(min_points=1001)


def test_a_small_thing_is_not_eroded_away():
    target = only_target(rendered_boxes(RIG, [make_box((0, 0, 2), 0.02)]))
    assert len(target.points_left) >= 20


def test_a_big_cloud_is_thinned_without_losing_its_edges():
    percepts = rendered_boxes(RIG, [make_box((0, 0, 2), (0.6, 0.45, 0.2))])
    assert (percepts.instances.ids == 1).sum() > 10_000
    thin = only_target(percepts, erode_px=0, outlier_ratio=1e6, max_points=1000)
    (full,) = reconstruct(percepts, RAW).targets
    assert 800 < len(thin.points_left) <= 1000
    np.testing.assert_allclose(faces(thin.box), faces(full.box), atol=4 * PIXEL_M)


@pytest.mark.parametrize(
    ("radius_px", "size", "left"),
    [
        (0, (6, 8), (6, 8)),
        (1, (10, 30), (8, 28)),
        (2, (10, 30), (6, 26)),
        (1, (6, 8), (4, 6)),  # exactly half
        (1, (6, 7), (6, 7)),  # less than half would be left
    ],
)
def test_a_mask_loses_its_border_unless_that_is_more_than_half_of_it(radius_px, size, left):
    percepts = rendered_boxes(RIG, [])
    ids = np.zeros(SHAPE, np.uint16)
    ids[50 : 50 + size[0], 70 : 70 + size[1]] = 1
    thing = Instance(id=1, label="cup", category_id=41, is_thing=True, score=0.9)
    (target,) = reconstruct(
        replace(percepts, instances=Instances(ids=ids, instances=(thing,))),
        RAW.model_copy(update={"erode_px": radius_px}),
    ).targets
    u, v = np.round(project(target.points_left, RIG)).astype(int).T
    middle = (70 + (size[1] - 1) / 2, 50 + (size[0] - 1) / 2)
    assert (len(np.unique(v)), len(np.unique(u)), len(u)) == (*left, left[0] * left[1])
    assert ((u.min() + u.max()) / 2, (v.min() + v.max()) / 2) == middle


def test_points_beyond_so_many_median_deviations_are_gated_out_whatever_the_mean():
    """Most of the depths are off by 0.02 m, some by a metre: the gate stands at 8 x 0.02 m."""
    depth = np.array([1.98] * 45 + [2.0] * 11 + [2.02] * 34 + [2.15, 2.17] + [3.0] * 8)
    points = np.column_stack([np.zeros((len(depth), 2)), depth])
    kept = _gated(points, ReconstructionSettings(gate_mads=8), RIG, extent_px=10)
    assert np.unique(kept[:, 2]).tolist() == [1.98, 2.0, 2.02, 2.15]


def grid_with(*extra):
    """A hundred points 1 cm apart at a depth of 1 m, and some more."""
    across = np.arange(10) / 100
    return np.array([(x, y, 1.0) for x in across for y in across] + list(extra))


def test_an_outlier_is_measured_by_as_many_neighbours_as_are_asked_for():
    """Two points that fly together are each other's nearest, but have no second one."""
    pair = grid_with((0.5, 0.5, 1.0), (0.51, 0.5, 1.0))
    for neighbours, left in ((1, 102), (2, 100)):
        settings = ReconstructionSettings(outlier_neighbours=neighbours, outlier_ratio=3)
        assert len(_without_outliers(pair, settings)) == left


def test_an_outlier_is_measured_against_the_median_whatever_the_mean():
    """Its neighbour is 6 times as far as is usual, but not 6 times as far as the mean with a point at 100 m."""
    cloud = grid_with((0.15, 0.09, 1.0), (100, 0, 1.0))
    assert len(_without_outliers(cloud, ReconstructionSettings(outlier_neighbours=1, outlier_ratio=5))) == 100
    assert len(_without_outliers(cloud, ReconstructionSettings(outlier_neighbours=1, outlier_ratio=7))) == 101


def test_an_oriented_box_is_smaller_about_a_thing_that_stands_askew():
    askew = make_box((0, 0, 1.8), (0.3, 0.1, 0.2), Rotation.from_euler("z", 30, degrees=True).as_matrix())
    percepts = rendered_boxes(RIG, [askew])
    boxes = [only_target(percepts, boxes=kind).box for kind in ("aabb", "oriented")]
    np.testing.assert_array_equal(boxes[0].left_from_box, np.eye(3))
    np.testing.assert_allclose(boxes[1].left_from_box[:, 0], askew.left_from_box[:, 0], atol=0.05)
    assert np.prod(boxes[1].half_size_m) < 0.8 * np.prod(boxes[0].half_size_m)


@pytest.mark.parametrize(
    ("name", "good", "wrong"),
    [
        ("erode_px", (0, 20), (-1, 21)),
        ("gate_mads", (0.1,), (0,)),
        ("outlier_neighbours", (1,), (0,)),
        ("outlier_ratio", (1,), (0.9,)),
        ("min_points", (1,), (0,)),
        ("max_points", (100,), (99,)),
        ("min_eye_points", (1,), (0,)),
    ],
)
def test_a_setting_outside_of_its_range_is_refused(name, good, wrong):
    for value in good:
        assert getattr(ReconstructionSettings(**{name: value}), name) == value
    for value in wrong:
        with pytest.raises(ValidationError, match=name):
            ReconstructionSettings(**{name: value})


def test_reconstruction_is_repeatable():
    percepts = rendered_boxes(RIG, [CUBE, make_box((0.4, 0.2, 2.2), 0.25)])
    for boxes in ("aabb", "oriented"):
        first, second = (reconstruct(percepts, ReconstructionSettings(boxes=boxes)) for _ in range(2))
        for a, b in zip(first.targets, second.targets, strict=True):
            np.testing.assert_array_equal(a.points_left, b.points_left)
            np.testing.assert_array_equal(box_corners([a.box]), box_corners([b.box]))


# Which instances are targets


def test_things_are_targets_and_stuff_only_by_name():
    percepts = rendered_boxes(RIG, [CUBE, make_box((0.4, 0.2, 2.2), 0.25)])
    cup = Instance(id=1, label="cup", category_id=41, is_thing=True, score=0.9)
    table = Instance(id=2, label="table", category_id=9, is_thing=False, score=0.9)
    unseen = Instance(id=300, label="cup", category_id=41, is_thing=True, score=0.9)
    instances = Instances(ids=percepts.instances.ids, instances=(table, unseen, cup))
    percepts = replace(percepts, instances=instances)
    for stuff, expected in (((), [cup]), (("table",), [table, cup]), (("sky",), [cup])):
        scene = reconstruct(percepts, ReconstructionSettings(stuff=stuff))
        assert [target.instance for target in scene.targets] == expected


def test_the_extent_of_a_target_is_that_of_its_mask():
    v, u = np.nonzero(SEEN.instances.ids)
    expected = [u.min() - 0.5, v.min() - 0.5, u.max() + 0.5, v.max() + 0.5]
    np.testing.assert_array_equal(only_target(SEEN).box_px, expected)


# Boxes about points


@given(seed=st.integers(0, 2**32 - 1))
def test_an_oriented_box_finds_the_box_its_points_fill(seed):
    rng = np.random.default_rng(seed)
    box = make_box(rng.normal(size=3), rng.uniform(0.05, 0.5, 3), Rotation.random(rng=rng).as_matrix())
    inside = rng.uniform(-1, 1, (200, 3)) * box.half_size_m @ box.left_from_box.T + box.center_m
    found = oriented_box(np.concatenate([*box_corners([box]), inside]))
    np.testing.assert_allclose(found.left_from_box @ found.left_from_box.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(found.left_from_box) == pytest.approx(1)
    assert found.left_from_box.trace() >= 1 - 1e-9
    np.testing.assert_allclose(found.center_m, box.center_m, atol=2e-3)
    np.testing.assert_allclose(np.sort(found.half_size_m), np.sort(box.half_size_m), atol=2e-3)


@given(seed=st.integers(0, 2**32 - 1))
def test_an_oriented_box_is_the_smallest_with_a_face_on_the_hull(seed):
    """The smallest rectangle about a polygon has a side on one of its edges (Freeman and Shapira 1975)."""
    points = np.random.default_rng(seed).normal(size=(12, 3)) * (1, 0.6, 0.3)
    volumes = []
    for normal in ConvexHull(points).equations[:, :3]:
        flat = points @ np.linalg.svd(normal[None])[2][1:].T
        ring = flat[ConvexHull(flat).vertices]
        for edge in np.roll(ring, -1, axis=0) - ring:
            along = edge / np.linalg.norm(edge)
            volumes.append(np.ptp(flat @ along) * np.ptp(flat @ [-along[1], along[0]]) * np.ptp(points @ normal))
    assert np.prod(2 * oriented_box(points).half_size_m) == pytest.approx(min(volumes), rel=1e-4)


@given(seed=st.integers(0, 2**32 - 1), thickness=st.sampled_from([0, 1e-6, 1e-3, 0.02]))
def test_an_oriented_box_finds_the_plate_its_points_fill_in_any_orientation(seed, thickness):
    """As a grid, as stereo sees a face."""
    rng = np.random.default_rng(seed)
    plate = make_box(rng.normal(size=3), (*rng.uniform(0.1, 0.5, 2), 0.001), Rotation.random(rng=rng).as_matrix())
    u, v = np.mgrid[-1:1:15j, -1:1:15j].reshape(2, -1)
    local = np.column_stack([u, v, rng.uniform(-thickness, thickness, u.shape)]) * [*plate.half_size_m[:2], 1]
    found = oriented_box(local @ plate.left_from_box.T + plate.center_m)
    np.testing.assert_allclose(
        np.sort(found.half_size_m)[1:], np.sort(plate.half_size_m[:2]), rtol=0.02, atol=thickness
    )
    normal = found.left_from_box[:, found.half_size_m.argmin()]
    assert abs(normal @ plate.left_from_box[:, 2]) == pytest.approx(1, abs=2 * max(thickness, 1e-3))


@pytest.mark.parametrize("make", [axis_aligned_box, oriented_box])
@pytest.mark.parametrize("flat", [(0, 0, 1), (0, 1, 1), (1, 1, 1)])
@pytest.mark.parametrize("scale", [1, 1e12], ids=["near", "farther than a sky"])
def test_flat_clouds_have_boxes_with_an_inside(make, flat, scale):
    shape = np.where(flat, 0, (1, 0.5, 0.3))
    points = scale * (np.random.default_rng(1).uniform(-1, 1, (50, 3)) * shape + (0, 0, 2))
    box = make(points)
    local = (points - box.center_m) @ box.left_from_box
    assert (box.half_size_m > 0).all()
    assert (np.abs(local) <= box.half_size_m + 1e-9 * scale).all()


# People and their eyes

FACE_PX = (100.0, 40.0, 140.0, 100.0)
EYES_PX = (120, 61)


def body_depth(u, v):
    return 2.0 + 0.001 * (u - EYES_PX[0]) + 0.002 * (v - EYES_PX[1])


def portrait(*heads, ids=None, label="person", known=True):
    """Heads before a slanted body that fills the left half of the image, the wall behind on the right."""
    v, u = np.mgrid[: RIG.height_px, : RIG.width_px]
    depth = np.where(u < 160, body_depth(u, v), 4.0)
    disparity = np.where(known, RIG.fx_px * RIG.baseline_m / depth, np.nan).astype(np.float32)
    ids = np.where(u < 160, 1, 0) if ids is None else ids
    labels = [Instance(id=int(k), label=label, category_id=1, is_thing=True, score=1.0) for k in np.unique(ids) if k]
    percepts = rendered_boxes(RIG, [])
    return replace(
        percepts,
        disparity=Disparity(disparity_px=disparity),
        instances=Instances(ids=ids.astype(np.uint16), instances=tuple(labels)),
        views=tuple(HeadView(head=head, head_pose=None, gaze=None) for head in heads),
    )


def face(**changes):
    return Head(**{"box_px": np.array(FACE_PX), "score": 1.0, **changes})


def only_person(percepts, **changes):
    (person,) = reconstruct(percepts, ReconstructionSettings(**changes)).people
    return person


def known_only(rows, columns):
    known = np.zeros(SHAPE, bool)
    known[rows, columns] = True
    return known


RING = known_only(slice(53, 70), slice(112, 129))
RING[57:66, 116:125] = False
CHIN = known_only(slice(85, 100), slice(100, 140))


@pytest.mark.parametrize(
    ("known", "at_px", "within_m"),
    [(True, EYES_PX, 1e-3), (RING, EYES_PX, 0.02), (CHIN, (119.5, 92), 0.008)],
    ids=["35 percent of the head from its top", "a patch with too few points is doubled", "else the head decides"],
)
def test_the_eyes_are_where_points_of_the_person_are_known(known, at_px, within_m):
    origin = only_person(portrait(face(), known=known)).eye_origin_left
    np.testing.assert_allclose(origin, back_project(*at_px, body_depth(*at_px), RIG), atol=within_m)


def test_only_the_patch_decides_where_there_is_one():
    around = np.ones(SHAPE, bool)
    around[57:66, 116:125] = False
    disturbed = with_disparity(portrait(face()), around, 50.0)
    np.testing.assert_allclose(only_person(disturbed).eye_origin_left[2], 2.0, atol=1e-3)


def test_without_points_on_the_head_there_are_no_eyes():
    person = only_person(portrait(face(), known=known_only(slice(150, 200), slice(0, 160))))
    assert person.eye_origin_left is None
    assert person.instance_id == 1


def test_without_a_person_only_the_patches_are_tried():
    nobody = {"ids": np.zeros(SHAPE)}
    person = only_person(portrait(face(), **nobody))
    assert person.instance_id is None
    np.testing.assert_allclose(person.eye_origin_left, back_project(*EYES_PX, 2.0, RIG), atol=1e-3)
    assert only_person(portrait(face(), known=CHIN, **nobody)).eye_origin_left is None


def test_what_is_not_the_person_does_not_count():
    """A hand before the eyes, another instance, hides most of the patch."""
    hand = np.zeros(SHAPE, bool)
    hand[57:66, 116:123] = True
    ids = np.where(np.arange(RIG.width_px) < 160, 1, 0) * np.where(hand, 2, 1)
    percepts = with_disparity(portrait(face(), ids=ids), hand, 60.0)
    np.testing.assert_allclose(only_person(percepts, min_eye_points=9).eye_origin_left[2], 2.0, atol=0.02)


def test_a_head_belongs_to_the_person_that_covers_most_of_it():
    columns = np.broadcast_to(np.arange(RIG.width_px), SHAPE)
    ids = np.select([columns < 115, columns < 160], [1, 2], 0)
    assert only_person(portrait(face(), ids=ids)).instance_id == 2
    assert only_person(portrait(face(instance_id=1), ids=ids)).instance_id == 1
    assert only_person(portrait(face(), ids=ids, label="bird")).instance_id is None
    assert only_person(portrait(face(), ids=ids, label="bird"), person=("child", "bird")).instance_id == 2


def test_a_single_pixel_in_the_heads_box_is_enough_to_belong_and_of_equals_the_first_has_it():
    ids = np.zeros(SHAPE, int)
    ids[60, 120] = 2
    assert only_person(portrait(face(), ids=ids)).instance_id == 2
    ids[61, 120] = 1
    assert only_person(portrait(face(), ids=ids)).instance_id == 1


def test_people_are_targets_of_others():
    scene = reconstruct(portrait(face()), ReconstructionSettings())
    assert [target.instance.id for target in scene.targets] == [scene.people[0].instance_id]


@pytest.mark.parametrize("box_px", [(-30, -20, 30, 40), (290, 170, 350, 230), (400, 10, 440, 60), (-90, 0, -50, 40)])
def test_a_head_may_leave_the_image(box_px):
    percepts = portrait(face(box_px=np.array(box_px, dtype=float)))
    person = only_person(percepts)
    visible = box_px[0] < RIG.width_px and box_px[2] > 0
    assert (person.eye_origin_left is not None) == visible


def test_depths_come_from_the_rig_with_its_own_principal_points():
    rig = replace(RIG, cx_right_px=RIG.cx_px + 7)
    percepts = portrait(face())
    shifted = replace(percepts, rig=rig)
    expected = depth_from_disparity(RIG.fx_px * RIG.baseline_m / 2.0, rig)
    assert only_person(shifted).eye_origin_left[2] == pytest.approx(expected, abs=1e-3)
