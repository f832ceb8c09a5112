from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.studio import StudioClip, StudioSettings
from tests.scenes import make_rig
from vfoa.drawn import DrawnSettings, DrawnShape, DrawnShapes, depth_mode
from vfoa.following import Following
from vfoa.geometry import disparity_from_depth
from vfoa.reconstruction import ReconstructionSettings
from vfoa.tracking import TrackingSettings
from vfoa.types import Disparity, Head, Instance, Instances, Percepts, StereoFrame

RIG = make_rig(64, 48)
USED = DrawnSettings(targets=True, heads=True)
CUP, PERSON = (
    Instance(id=7, label="cup", category_id=47, is_thing=True, score=0.9),
    Instance(id=9, label="person", category_id=1, is_thing=True, score=0.9),
)
Box = tuple[float, float, float, float]


def shape(name: str, box: Box, kind: Literal["box", "point", "head"] = "box", label: str = "cup") -> DrawnShape:
    return DrawnShape(name=name, label=label, category_id=1001, kind=kind, box_px=box)


def _frame() -> StereoFrame:
    black = np.zeros((48, 64, 3), np.uint8)
    return StereoFrame(index=1, time_ns=0, left=black, right=black, rig=RIG)


def _depths(*parts: tuple[tuple[slice, slice], float]) -> Disparity:
    """Of parts of the image at these depths, before a wall."""
    depth = np.full((48, 64), 4.0)
    for part, depth_m in parts:
        depth[part] = depth_m
    return Disparity(disparity_px=disparity_from_depth(depth, RIG).astype(np.float32))


def _of_model(**instances: tuple[Instance, tuple[slice, slice]]) -> Instances:
    ids = np.zeros((48, 64), np.uint16)
    for instance, part in instances.values():
        ids[part] = instance.id
    return Instances(ids=ids, instances=tuple(instance for instance, _ in instances.values()))


def _draw(
    shapes: Sequence[DrawnShape],
    disparity: Disparity,
    *,
    model: Instances | None = None,
    heads: Sequence[Head] = (),
    settings: DrawnSettings = USED,
) -> tuple[Instances, tuple[Head, ...]]:
    """The steps of the pipeline for drawn shapes, in its order."""
    drawing, frame = DrawnShapes(settings, lambda _: shapes), _frame()
    instances = model or _of_model()
    placed = drawing.place(frame, instances)
    found = drawing.add_heads(frame, heads, placed)
    return drawing.add_masks(frame, instances, placed, disparity), found


def test_a_box_is_cut_out_by_the_depth_of_its_middle() -> None:
    cup = (slice(12, 30), slice(22, 40))
    found, _ = _draw([shape("mug", (19.5, 9.5, 42.5, 32.5))], _depths((cup, 1.0)))
    expected = np.zeros((48, 64), bool)
    expected[cup] = True
    assert [(instance.name, instance.label, instance.is_thing) for instance in found.instances] == [
        ("mug", "cup", True)
    ]
    assert np.array_equal(found.mask(found.instances[0].id), expected)


@pytest.mark.parametrize(
    ("part", "box"),
    [
        ((slice(20, 26), slice(10, 54)), (9.5, 18.5, 53.5, 26.5)),
        ((slice(4, 44), slice(30, 36)), (28.5, 3.5, 36.5, 43.5)),
    ],
    ids=["wide", "high"],
)
def test_a_long_thing_is_as_deep_as_its_shorter_side(part: tuple[slice, slice], box: Box) -> None:
    close_behind = (slice(0, 48), slice(0, 64)), 1.1
    found, _ = _draw([shape("board", box)], _depths(close_behind, (part, 1.0)))
    expected = np.zeros((48, 64), bool)
    expected[part] = True
    assert np.array_equal(found.mask(found.instances[0].id), expected)


def test_pixels_of_unknown_depth_belong_to_nothing() -> None:
    disparity = _depths(((slice(12, 30), slice(22, 40)), 1.0)).disparity_px.copy()
    disparity[20:25] = np.nan
    found, _ = _draw([shape("mug", (21.5, 11.5, 39.5, 29.5))], Disparity(disparity_px=disparity))
    assert not found.ids[20:25].any()
    assert found.ids[12, 22]


NO_DEPTH = Disparity(disparity_px=np.full((48, 64), np.nan, np.float32))


def test_a_shape_without_depth_is_all_that_the_model_leaves_free() -> None:
    bowl = replace(CUP, label="bowl")
    model = _of_model(bowl=(bowl, (slice(12, 30), slice(22, 40))))
    found, _ = _draw([shape("mug", (21.5, 11.5, 49.5, 29.5))], NO_DEPTH, model=model)
    ids = {instance.name: instance.id for instance in found.instances}
    assert np.array_equal(found.mask(ids[None]), model.mask(CUP.id))
    expected = np.zeros((48, 64), bool)
    expected[12:30, 40:50] = True
    assert np.array_equal(found.mask(ids["mug"]), expected)


@pytest.mark.parametrize("known", [slice(0, 0), slice(26, 30)])
@pytest.mark.parametrize("kind", ["box", "point"])
def test_a_shape_of_little_depth_has_its_last_one_where_it_is_drawn(
    kind: Literal["box", "point"], known: slice
) -> None:
    """The few pixels of known depth are at its border: their middle is not that of the shape."""
    last = np.full((48, 64), np.nan, np.float32)
    last[18:22, known] = disparity_from_depth(1.0, RIG)
    mug = shape("mug", (21.5, 11.5, 39.5, 29.5) if kind == "box" else (30, 20, 30, 20), kind)
    following = Following(ReconstructionSettings(), TrackingSettings())
    seen = []
    for index, disparity in enumerate((_depths(((slice(12, 30), slice(22, 40)), 1.0)), Disparity(disparity_px=last))):
        instances, _ = _draw([mug], disparity)
        found = Percepts(index=index, time_ns=0, rig=RIG, disparity=disparity, instances=instances, views=())
        (target,) = following.step(found)[1].targets
        seen.append((target.instance.name, target.depth_from, target.box and target.box.center_m.tolist()))
    (_, measured, center), remembered = seen
    assert measured is None
    assert center is not None
    assert remembered == ("mug", 0, center)


def test_of_two_boxes_the_nearer_hides_the_farther_whatever_their_order() -> None:
    near, far = (slice(10, 30), slice(10, 30)), (slice(5, 40), slice(5, 60))
    shapes = [shape("near", (9.5, 9.5, 29.5, 29.5)), shape("far", (4.5, 4.5, 59.5, 39.5))]
    for order in (shapes, shapes[::-1]):
        found, _ = _draw(order, _depths((far, 2.0), (near, 1.0)))
        ids = {instance.name: instance.id for instance in found.instances}
        assert found.ids[20, 20] == ids["near"]
        assert found.ids[20, 50] == ids["far"]


@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)])
@pytest.mark.parametrize(
    ("near", "far"),
    [
        ((slice(14, 34), slice(16, 46)), (slice(8, 40), slice(8, 56))),
        ((slice(8, 40), slice(10, 40)), (slice(8, 40), slice(18, 48))),
    ],
    ids=["a cup before the middle of a laptop", "one person before most of another"],
)
def test_what_hides_the_middle_of_a_box_is_not_cut_out_as_its_object(
    near: tuple[slice, slice], far: tuple[slice, slice], order: slice
) -> None:
    depths = _depths((far, 2.0), (near, 1.2))
    shapes = [
        shape(name, (columns.start - 0.5, rows.start - 0.5, columns.stop - 0.5, rows.stop - 0.5))
        for name, (rows, columns) in (("near", near), ("far", far))
    ]
    found, _ = _draw(shapes[order], depths)
    ids = {instance.name: instance.id for instance in found.instances}
    expected = np.zeros((48, 64), np.uint16)
    expected[far], expected[near] = ids["far"], ids["near"]
    np.testing.assert_array_equal(found.ids, expected)


def test_a_thin_thing_close_before_a_person_keeps_its_pixels() -> None:
    """The person fills its own box better than the vase, and is so wide that the vase is as deep as its body."""
    person, flowers, foot = (
        (slice(8, 40), slice(4, 34)),
        (slice(12, 20), slice(20, 40)),
        (slice(20, 36), slice(28, 33)),
    )
    depths = _depths((person, 2.0), (flowers, 1.88), (foot, 1.88))
    shapes = [shape("person", (3.5, 7.5, 33.5, 39.5), label="person"), shape("vase", (19.5, 11.5, 39.5, 35.5))]
    found, _ = _draw(shapes, depths)
    ids = {instance.name: instance.id for instance in found.instances}
    assert (found.ids[flowers] == ids["vase"]).all()
    assert (found.ids[foot] == ids["vase"]).all()
    assert found.ids[38, 10] == ids["person"]


def test_a_point_is_a_disc_in_its_band_of_depth() -> None:
    lamp = (slice(0, 48), slice(30, 64))
    found, _ = _draw([shape("lamp", (34, 20, 34, 20), "point")], _depths((lamp, 1.0)))
    v, u = np.nonzero(found.ids)
    assert len(v) > 60
    assert u.min() == 30  # the disc would begin at 28
    assert ((u - 34) ** 2 + (v - 20) ** 2 <= 6**2).all()


def test_a_head_that_no_detector_finds_is_a_head_with_a_person() -> None:
    part = (slice(5, 25), slice(10, 25))
    found, heads = _draw([shape("anna", (9.5, 4.5, 24.5, 24.5), "head", "person")], _depths((part, 1.0)))
    (anna,) = found.instances
    assert (anna.name, anna.label) == ("anna", "person")
    assert [(head.box_px.tolist(), head.instance_id) for head in heads] == [([9.5, 4.5, 24.5, 24.5], anna.id)]
    assert found.ids[15, 17] == anna.id
    assert found.ids[5, 10] == 0  # a head is round


def test_a_head_that_is_detected_stays_and_learns_whose_it_is() -> None:
    model = _of_model(anna=(PERSON, (slice(5, 48), slice(5, 30))))
    seen = Head(box_px=np.array([10.0, 5, 24, 24]), score=0.7, landmarks_px=np.ones((5, 2)))
    drawn = shape("anna", (9.5, 4.5, 24.5, 24.5), "head", "person")
    found, heads = _draw([drawn], _depths(), model=model, heads=[seen])
    assert [(instance.id, instance.name) for instance in found.instances] == [(9, "anna")]
    assert np.array_equal(found.ids, model.ids)
    (head,) = heads
    assert head.instance_id == 9
    assert head.landmarks_px is not None


ANNA_PX, BEN_PX = (9.5, 9.5, 25.5, 29.5), (14.5, 9.5, 30.5, 29.5)
"""Two heads one behind the other, whose boxes overlap by half."""


@pytest.mark.parametrize("order", [slice(None), slice(None, None, -1)])
@pytest.mark.parametrize("detected", [(), (ANNA_PX,), (BEN_PX,), (ANNA_PX, BEN_PX)])
def test_of_two_people_whose_heads_overlap_each_keeps_the_own_head(detected: Sequence[Box], order: slice) -> None:
    shapes = [shape("anna", ANNA_PX, "head", "person"), shape("ben", BEN_PX, "head", "person")][order]
    heads = [Head(box_px=np.array(box), score=0.7) for box in detected]
    people, found = _draw(shapes, _depths(), heads=heads)
    names = {instance.id: instance.name for instance in people.instances}
    assert [tuple(head.box_px.tolist()) for head in found[: len(detected)]] == list(detected)
    assert {names[head.instance_id or 0]: tuple(head.box_px.tolist()) for head in found} == {
        "anna": ANNA_PX,
        "ben": BEN_PX,
    }
    assert len(found) == 2


def test_a_box_about_the_model_s_own_instance_names_it() -> None:
    model = _of_model(cup=(CUP, (slice(12, 30), slice(22, 40))))
    depths = _depths(((slice(12, 30), slice(22, 40)), 1.0))
    found, _ = _draw([shape("mug", (20, 10, 41, 31))], depths, model=model)
    assert [(instance.id, instance.name) for instance in found.instances] == [(7, "mug")]
    assert np.array_equal(found.ids, model.ids)


@pytest.mark.parametrize(
    ("u_px", "v_px", "named"), [(22, 12, "mug"), (39.4, 29.4, "mug"), (60, 20, "glass"), (64.2, 47.3, "glass")]
)
def test_a_point_on_the_model_s_own_instance_names_it(u_px: float, v_px: float, named: str) -> None:
    glass = replace(CUP, id=8)
    model = _of_model(cup=(CUP, (slice(12, 30), slice(22, 40))), glass=(glass, (slice(12, 48), slice(50, 64))))
    found, _ = _draw([shape(named, (u_px, v_px, u_px, v_px), "point")], _depths(), model=model)
    number = {"mug": 7, "glass": 8}[named]
    assert {instance.id: instance.name for instance in found.instances} == {7: None, 8: None, number: named}
    assert np.array_equal(found.ids, model.ids)


def test_what_is_drawn_wins_over_the_same_object_under_another_label() -> None:
    model = _of_model(cup=(CUP, (slice(12, 30), slice(22, 40))), person=(PERSON, (slice(0, 48), slice(44, 64))))
    depths = _depths(((slice(12, 32), slice(22, 42)), 1.0))
    found, _ = _draw([shape("robot", (20, 10, 43, 33), label="robot")], depths, model=model)
    assert [(instance.id, instance.name) for instance in found.instances] == [(9, None), (10, "robot")]
    assert set(np.unique(found.ids)) == {0, 9, 10}


def test_what_is_not_asked_for_is_not_there() -> None:
    gone = shape("ben", (-30, 2, -10, 12), "head", "person")  # it has left the image
    shapes = [shape("mug", (20, 10, 41, 31)), shape("anna", (2, 2, 12, 12), "head", "person"), gone]
    instances, heads = _draw(shapes, _depths(), settings=DrawnSettings(targets=True))
    assert [instance.name for instance in instances.instances] == ["mug"]
    assert heads == ()
    instances, heads = _draw(shapes, _depths(), settings=DrawnSettings(heads=True))
    assert [instance.name for instance in instances.instances] == ["anna"]
    assert len(heads) == 1


@given(
    depth_m=st.floats(0.3, 30),
    noise=st.floats(0, 0.01),
    others=st.dictionaries(st.sampled_from((-3, -2, -1, 1, 2, 3, 90)), st.integers(1, 90)),
    seed=st.integers(0, 99),
)
def test_the_mode_is_the_depth_of_most(depth_m: float, noise: float, others: dict[int, int], seed: int) -> None:
    """More than half of the pixels may be others, nearer or farther, as long as fewer have the same depth."""
    most = depth_m * np.exp(noise * np.random.default_rng(seed).uniform(-1, 1, 100))
    samples = np.concatenate([most, *(np.full(count, depth_m * 1.3**steps) for steps, count in others.items())])
    assert depth_mode(samples, 0.05) == pytest.approx(depth_m, rel=0.05)


def test_of_two_depths_of_as_many_pixels_the_nearer_is_the_mode() -> None:
    assert depth_mode(np.array([2.0, 2.0, 1.0, 1.0]), 0.05) == pytest.approx(1.0)


def test_boxes_on_a_rendered_scene_become_masks() -> None:
    """On true depth, the masks of boxes about the true masks: all of a compact thing, most of a slanted one."""
    clip = StudioClip(StudioSettings(scenario="table", frames=60, seed=7), None)
    frame, truth = clip.frame(1), clip.truth(1)
    assert truth.instances is not None
    assert truth.disparity is not None
    shapes, true = [], {}
    for instance in truth.instances.instances:
        mask = truth.instances.mask(instance.id)
        rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
        if instance.is_thing and instance.label != "person" and len(rows):
            box = (columns[0] - 0.5, rows[0] - 0.5, columns[-1] + 0.5, rows[-1] + 0.5)
            shapes.append(shape(instance.label, box, label=instance.label))
            true[instance.label] = mask
    drawing = DrawnShapes(USED, lambda _: shapes)
    nothing = Instances(ids=np.zeros_like(truth.instances.ids), instances=())
    found = drawing.add_masks(frame, nothing, drawing.place(frame, nothing), truth.disparity)
    overlaps = {}
    for instance in found.instances:
        mask = found.mask(instance.id)
        overlaps[instance.label] = np.count_nonzero(mask & true[instance.label]) / np.count_nonzero(
            mask | true[instance.label]
        )
    assert {*overlaps} == {"laptop", "cup", "book", "bottle", "vase"}
    assert min(overlaps.values()) > 0.5
    assert np.median(list(overlaps.values())) > 0.7
