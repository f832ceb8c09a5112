"""A person whose mask something divides is one person; other people in front, below or beside stay apart."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.clips.manifest import load_manifest
from harness.pipeline.ground_truth import TruthSegmenter
from harness.pipeline.perception import FollowedFrame, Perception
from harness.run.experiment import load_experiment
from tests.disk import write_text
from tests.experiments import NO_ERRORS, experiment_of
from tests.scenes import make_box, make_rig, rendered_boxes
from tests.true_stages import Seen, TrueGaze, TrueHeadPose
from vfoa.divided_people import join_people
from vfoa.estimator import Estimator
from vfoa.geometry import project
from vfoa.heads.person_mask import PersonMask
from vfoa.pipeline import Stages
from vfoa.types import Float, Head, HeadView, Instance, Instances, Percepts, StereoFrame

RIG = make_rig(400, 300, fx_px=300)
BLACK = np.zeros((300, 400, 3), np.uint8)
ANNA, CUP, OTHER = 1, 2, 3
HEAD_M = 0.25
LABELS = ("person",)


def head_of(center: tuple[float, float, float], top: float, front: float) -> Float:
    """The box of a head at the top of a box, pixels."""
    x = center[0]
    return project([[x - 0.1, top, front], [x + 0.1, top + HEAD_M, front]], RIG).ravel()


def view(box_px: Float, *, face: bool = True, instance_id: int | None = None) -> HeadView:
    head = Head(box_px=box_px, score=0.9, face_box_px=box_px if face else None, instance_id=instance_id)
    return HeadView(head=head, head_pose=None, gaze=None)


HEAD_PX, LOWER_PX = (head_of((-0.5, 0, 2.2), top, 2.0) for top in (-0.7, 0.1))


def scene(
    lower: tuple[float, float, float] = (-0.5, 0.4, 2.2),
    half: tuple[float, float, float] = (0.2, 0.3, 0.2),
    views: Iterable[HeadView] = (view(HEAD_PX),),
) -> Percepts:
    """Anna's upper part, from -0.7 m to 0.0 m; a cup; and another mask of a person, by default her legs."""
    return replace(rendered(lower, half), views=tuple(views))


@cache
def rendered(lower: tuple[float, float, float], half: tuple[float, float, float]) -> Percepts:
    boxes = [make_box((-0.5, -0.35, 2.2), (0.2, 0.35, 0.2)), make_box((0.6, 0.1, 1.8), 0.1), make_box(lower, half)]
    seen = rendered_boxes(RIG, boxes)
    labels = {ANNA: "person", CUP: "cup", OTHER: "person"}
    instances = tuple(replace(each, label=labels[each.id]) for each in seen.instances.instances)
    return replace(seen, instances=replace(seen.instances, instances=instances))


def people_of(percepts: Percepts) -> list[int]:
    return [each.id for each in join_people(percepts, LABELS).instances.instances if each.label == "person"]


def test_the_lower_part_of_a_divided_person_belongs_to_the_person() -> None:
    percepts = scene()
    joined = join_people(percepts, LABELS)
    before, after = percepts.instances, joined.instances
    np.testing.assert_array_equal(after.mask(ANNA), before.mask(ANNA) | before.mask(OTHER))
    np.testing.assert_array_equal(after.mask(CUP), before.mask(CUP))
    assert after.instances == before.instances[:2]
    assert joined.views == percepts.views


def test_three_parts_are_one_person() -> None:
    percepts = scene()
    ids = percepts.instances.ids.copy()
    rows = np.flatnonzero((ids == OTHER).any(axis=1))
    feet = np.zeros(ids.shape, bool)
    feet[rows[len(rows) // 2] + 4 :] = True
    ids[feet & (ids == OTHER)] = 9
    third = replace(percepts.instances.instances[2], id=9)
    divided = replace(percepts, instances=Instances(ids=ids, instances=(third, *percepts.instances.instances)))
    joined = join_people(divided, LABELS)
    assert people_of(divided) == [ANNA]
    np.testing.assert_array_equal(joined.instances.mask(ANNA), np.isin(ids, [ANNA, OTHER, 9]))


def test_a_head_at_the_top_of_the_lower_part_is_none() -> None:
    """A detector that takes the top of a mask for a head finds one in each part."""
    percepts = scene()
    frame = StereoFrame(index=1, time_ns=0, left=BLACK, right=BLACK, rig=RIG)
    heads = PersonMask(PersonMask.Settings()).detect(frame, percepts.instances)
    assert {head.instance_id for head in heads} == {ANNA, OTHER}
    views = tuple(HeadView(head=head, head_pose=None, gaze=None) for head in heads)
    joined = join_people(replace(percepts, views=views), LABELS)
    assert [each.head.instance_id for each in joined.views] == [ANNA]


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"lower": (-0.5, 0.2, 1.1), "half": (0.25, 0.3, 0.1)}, id="much nearer"),
        pytest.param({"lower": (0.1, -0.1, 2.2), "half": (0.2, 0.6, 0.2)}, id="beside"),
        pytest.param({"lower": (-0.5, 0.1, 1.7), "half": (0.08, 0.5, 0.05)}, id="a child in front"),
        pytest.param({"lower": (0.05, 0.4, 2.2)}, id="below, and beside"),
        pytest.param({"lower": (-0.5, 0.95, 2.2), "half": (0.2, 0.1, 0.2)}, id="far below"),
        pytest.param({"views": [view(HEAD_PX), view(LOWER_PX)]}, id="with a face"),
        pytest.param({"views": [view(HEAD_PX), view(LOWER_PX, face=False)]}, id="with a head"),
        pytest.param({"views": []}, id="below nobody"),
    ],
)
def test_another_person_stays_another(changes: dict[str, Any]) -> None:
    other = scene(**changes)
    assert join_people(other, LABELS) is other
    assert np.count_nonzero(other.instances.ids == OTHER) > 200


@pytest.mark.parametrize("known", [{"keeps_id": True}, {"name": "ben"}])
def test_people_whom_the_source_knows_stay_apart(known: dict[str, object]) -> None:
    percepts = scene()
    *others, last = percepts.instances.instances
    instances: tuple[Instance, ...] = (*others, replace(last, **known))  # type: ignore[arg-type]
    named = replace(percepts, instances=replace(percepts.instances, instances=instances))
    assert join_people(named, LABELS) is named


def test_a_part_of_unknown_depth_stays_as_it_is() -> None:
    percepts = scene()
    disparity = percepts.disparity.disparity_px.copy()
    disparity[percepts.instances.ids == OTHER] = np.nan
    unknown = replace(percepts, disparity=replace(percepts.disparity, disparity_px=disparity))
    assert join_people(unknown, LABELS) is unknown


def test_parts_are_people_by_the_labels_of_the_settings() -> None:
    percepts = scene()
    assert join_people(percepts, ("cup",)) is percepts


class _Divided(Seen):
    def detect(self, frame: StereoFrame, instances: Instances) -> tuple[Head, ...]:
        return (Head(box_px=self.head_px, score=0.9, face_box_px=self.head_px),)


class _Pose(_Divided, TrueHeadPose):
    direction = np.array([0.0, 0.6, -0.8])  # down, at her own legs


class _Gaze(_Divided, TrueGaze):
    direction = np.array([0.0, 0.6, -0.8])


def test_nobody_looks_at_the_own_legs() -> None:
    percepts = scene()
    given = {"percepts": percepts, "looked_at": ANNA, "head_px": HEAD_PX}
    seen = _Divided(**given)
    stages = Stages(matcher=seen, segmenter=seen, heads=seen, head_pose=_Pose(**given), gaze=_Gaze(**given))
    estimate = Estimator(stages).estimate(BLACK, BLACK, RIG)
    (look,) = estimate.looks
    assert (look.target, set(look.values)) == (None, {estimate.target_names[CUP]})


EXPERIMENT = experiment_of(
    ["studio_talk"],
    {"true": {}, "matched": {"stereo.matcher": "sgbm"}, "heads_of_masks": {"heads.detector": "person_mask"}},
    NO_ERRORS,
)


def test_a_run_joins_them_and_names_the_whole_person(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each person of the clip without legs of their own, also where each part gets a head."""
    clip = "studio_talk"
    segment = TruthSegmenter.segment

    def divided(self: TruthSegmenter, frame: StereoFrame) -> Instances:
        found = segment(self, frame)
        ids, instances = found.ids.copy(), []
        for each in found.instances:
            instances.append(replace(each, keeps_id=False))
            if each.label == "person":
                rows = np.flatnonzero((ids == each.id).any(axis=1))
                middle = (rows[0] + 2 * rows[-1]) // 3
                ids[middle : middle + 4][ids[middle : middle + 4] == each.id] = 0
                ids[middle:][ids[middle:] == each.id] = each.id + 1000
                instances.append(replace(each, id=each.id + 1000, keeps_id=False))
        return Instances(ids=ids, instances=tuple(instances))

    monkeypatch.setattr(TruthSegmenter, "segment", divided)
    configurations = load_experiment(str(write_text(tmp_path / "divided.toml", EXPERIMENT))).configurations
    with Perception(configurations, load_manifest(clip).open_images(), manifest=load_manifest(clip)) as perception:
        (frame,) = perception.frames((1,))
    assert len(frame.by_configuration) == 3
    for followed in frame.by_configuration.values():
        assert isinstance(followed, FollowedFrame)
        assert len(followed.scene.people) == len(followed.tracked.ids) == len(load_manifest(clip).subjects)
        assert sorted(followed.names.subjects.values()) == sorted(load_manifest(clip).subjects)
        assert sorted(followed.names.targets.values()) == sorted(
            {*load_manifest(clip).subjects, *load_manifest(clip).targets}
        )
