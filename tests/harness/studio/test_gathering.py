"""Scenarios drawn by chance: they fit on the table, and their committed clips are what the seeds say."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from harness.clips.manifest import load_manifest
from harness.labels.labels import timeline_of
from harness.pipeline.ground_truth import true_labels
from harness.sources import Truth
from harness.studio import StudioClip, StudioSettings
from harness.studio.gathering import gathering
from harness.studio.scenario import CAMERA
from harness.studio.stage import RIG, Stage
from tests.repository import REPOSITORY
from vfoa.geometry import project

SETS = {"tune": range(1, 7), "report": range(201, 207)}
CLIPS = [(f"studio_{kind}_{place}", seed) for kind, seeds in SETS.items() for place, seed in enumerate(seeds, start=1)]


class PeopleAlone:
    """A gathering's truth without its pictures, which take long to render."""

    def __init__(self, settings: StudioSettings) -> None:
        self.frames = range(1, settings.frames + 1)
        self._stage = Stage(gathering(settings.seed), settings.frames, settings.seed)

    def truth(self, number: int) -> Truth:
        return Truth(people=self._stage.people(number - 1))


@pytest.mark.parametrize("seed", range(8))
def test_things_stand_apart_on_the_table(seed):
    scenario = gathering(seed)
    places = np.array([thing.at for thing in scenario.things])
    apart = np.linalg.norm(places[:, None, :2] - places[None, :, :2], axis=-1)
    assert apart[~np.eye(len(places), dtype=bool)].min() > 0.1
    assert np.abs(places[:, 0]).max() < 1.25
    assert (places[:, 1] < 1.72).all()


@pytest.mark.parametrize("seed", range(4))
def test_the_camera_has_every_thing_in_view(seed):
    stage = Stage(gathering(seed), 5, seed)
    for number, box in stage.boxes(0).items():
        u, v = project(box.center_m, RIG)
        assert 0 < u < RIG.width_px, number
        assert 0 < v < RIG.height_px, number


def test_looks_are_at_things_at_people_and_at_the_camera():
    scenario = gathering(3)
    for actor in scenario.actors:
        looked_at = {look.at for look in actor.script}
        assert actor.name not in looked_at
        assert CAMERA in looked_at
        assert all(one.at != next_.at for one, next_ in pairwise(actor.script))
        assert {one.name for one in scenario.actors} & looked_at
        assert any(look.head_at for look in actor.script)


def test_seeds_differ_and_a_seed_does_not():
    assert gathering(5) == gathering(5)
    assert len({len(gathering(seed).things) for seed in range(10)}) > 3
    assert {len(gathering(seed).actors) for seed in range(30)} == {1, 2, 3}


@pytest.mark.parametrize(("name", "seed"), CLIPS)
def test_committed_clips_name_everyone_and_have_the_true_labels(name, seed):
    manifest = load_manifest(REPOSITORY / "datasets" / f"{name}.toml")
    clip, scenario = manifest.open(), gathering(seed)
    settings = StudioSettings(**manifest.source)
    assert isinstance(clip, StudioClip)
    assert (settings.scenario, settings.seed) == ("gathering", seed)
    named = {key: rule.instance for key, rule in {**manifest.subjects, **manifest.targets}.items()}
    assert named == {each.name: each.id for each in (*scenario.actors, *scenario.things)}
    labels = manifest.labels(timeline_of(clip))
    assert labels is not None
    expected = true_labels(PeopleAlone(settings))
    for frame in clip.frames:
        for subject in expected.subjects:
            found, true = labels.at(frame, subject), expected.at(frame, subject)
            assert found is not None
            assert true is not None
            assert found.target == true.target, "the labels follow from the seed: write them again"
    for frame in (4, 60):
        blocked = {subject for subject in expected.subjects if labels.at(frame, subject).is_blocked}
        assert blocked == clip.blockers(frame).keys()
