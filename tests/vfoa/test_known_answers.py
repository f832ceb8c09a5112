"""Every method gives the answers on a seeded conversation that it gave before its code was made faster.

``known_answers.json`` has, by method, the focus and the total of each target, frame by frame and person by person.
``python -m tests.vfoa.test_known_answers`` writes it anew, where answers are to change.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.scenes import make_box, make_person, make_target
from vfoa.bayes import BayesSettings
from vfoa.cones import ConesSettings
from vfoa.geometry import left_from_crop, perturb, unit
from vfoa.logit import Cases, LogitSettings, LogitWeights, Weights
from vfoa.logit_cues import ROWS
from vfoa.methods import MethodSettings
from vfoa.nearest import NearestSettings
from vfoa.pipeline import Attending, AttendSettings
from vfoa.tracking import Tracked
from vfoa.types import Box3D, FrameResult, Person, Scene

FILE = Path(__file__).with_name("known_answers.json")


def all_cues() -> LogitWeights:
    """Weights that all count."""
    rng = np.random.default_rng(11)

    def of(scales: int) -> Cases:
        weights = {case: [3.0, 0.4, *rng.uniform(0.1, 0.5, scales * len(rows))] for case, rows in ROWS.items()}
        return Cases(**{case: Weights.of(case, of_case) for case, of_case in weights.items()})

    return LogitWeights(forward=of(2), both=of(3))


METHODS: dict[str, MethodSettings] = {
    "cones": ConesSettings(cones_cm=(10, 25)),
    "nearest": NearestSettings(method="nearest", limit_deg=25),
    "bayes": BayesSettings(method="bayes"),
    "bayes, both": BayesSettings(method="bayes", smoothing="both", look_ahead_s=0.2),
    "bayes, told": BayesSettings(method="bayes", error="told"),
    "logit": LogitSettings(method="logit", weights=all_cues()),
    "logit, both": LogitSettings(method="logit", weights=all_cues(), smoothing="both", look_ahead_s=0.2),
    "logit, unlabelled": LogitSettings(method="logit"),
}
Known = dict[str, list[tuple[int | None, list[float]]]]


def conversation(frames: int = 14) -> list[Scene]:
    """Two people who turn to each other, to five things or away, 10 frames a second; a thing comes and cues are lost.

    Their own bodies are targets, too.
    """
    rng = np.random.default_rng(57)
    eyes = np.array([[-0.6, 0.0, 1.5], [0.7, 0.1, 1.6]])
    places = np.vstack([rng.uniform((-1, 0.1, 1), (1, 0.6, 2.5), (5, 3)), eyes + np.array([0, 0.5, 0])])
    sizes = np.vstack([rng.uniform(0.03, 0.2, (5, 3)), [(0.25, 0.6, 0.15)] * 2])
    axes = [*left_from_crop(rng.normal(size=(5, 3))), np.eye(3), np.eye(3)]
    targets = [make_target(n, make_box(*each)) for n, each in enumerate(zip(places, sizes, axes, strict=True), start=1)]
    ahead = unit(eyes[::-1] - eyes)
    scenes = []
    for index in range(frames):
        people = []
        for person in range(2):
            aim = unit(places[(3 * person + index // 4) % 7] - eyes[person]) if index % 9 < 7 else ahead[person]
            gaze = perturb(aim, *rng.normal(0, 0.15, 2))
            head = perturb(unit(aim + ahead[person] + 0.01), *rng.normal(0, 0.08, 2))
            people.append(
                make_person(
                    (200 * person, 0, 200 * person + 50, 50),
                    eyes=None if index == 5 and person else eyes[person] + rng.normal(0, 0.01, 3),
                    gaze=gaze if person == 0 or index not in (0, 1, 6) else None,
                    head=head if person or index not in (0, 8) else None,
                    instance_id=6 + person,
                )
            )
        seen = tuple(target for target in targets if target.instance.id != 2 or index >= 6)
        scenes.append(Scene(index=index, time_ns=index * 100_000_000, targets=seen, people=tuple(people)))
    return scenes


_MIRROR = np.diag([-1.0, 1, 1])


def in_a_mirror(scene: Scene) -> Scene:
    """The scene with right and left exchanged."""

    def box(it: Box3D) -> Box3D:
        return Box3D(
            center_m=_MIRROR @ it.center_m,
            half_size_m=it.half_size_m,
            left_from_box=_MIRROR @ it.left_from_box @ _MIRROR,
        )

    def person(it: Person) -> Person:
        gaze, head, eyes = it.view.gaze, it.view.head_pose, it.eye_origin_left
        return make_person(
            eyes=None if eyes is None else _MIRROR @ eyes,
            gaze=None if gaze is None else _MIRROR @ gaze.direction,
            head=None if head is None else _MIRROR @ head.direction,
            instance_id=it.instance_id,
        )

    targets = tuple(replace(each, box=each.box and box(each.box)) for each in scene.targets)
    return replace(scene, targets=targets, people=tuple(map(person, scene.people)))


def answers(scenes: Iterable[Scene]) -> Known:
    """The answers of every method, attending one after the other to each frame."""
    tracked = Tracked(ids=(1, 2), open=frozenset({1, 2}))
    attending = {name: Attending(AttendSettings(attention=settings)) for name, settings in METHODS.items()}
    results: dict[str, list[FrameResult]] = {name: [] for name in METHODS}
    for scene in scenes:
        for name, each in attending.items():
            results[name] += each.step(scene, tracked)
    return {
        name: [
            (attention.focus, [value.total for value in attention.values])
            for result in results[name] + each.finish()
            for attention in result.attentions
        ]
        for name, each in attending.items()
    }


@pytest.fixture(scope="module")
def found() -> Known:
    return answers(conversation())


@pytest.fixture(scope="module")
def mirrored() -> Known:
    return answers(map(in_a_mirror, conversation()))


@pytest.mark.parametrize("name", METHODS)
def test_the_answers_are_the_known_ones(name: str, found: Known) -> None:
    known = json.loads(FILE.read_text(encoding="utf-8"))[name]
    assert [focus for focus, _ in found[name]] == [focus for focus, _ in known]
    assert len({focus for focus, _ in known}) > 2
    for (_, totals), (_, expected) in zip(found[name], known, strict=True):
        assert totals == pytest.approx(expected, abs=1e-12, rel=0)


@pytest.mark.parametrize("name", METHODS)
def test_the_answers_are_the_same_in_a_mirror(name: str, found: Known, mirrored: Known) -> None:
    assert [focus for focus, _ in mirrored[name]] == [focus for focus, _ in found[name]]
    for (_, totals), (_, expected) in zip(mirrored[name], found[name], strict=True):
        assert totals == pytest.approx(expected, abs=1e-12, rel=0)


if __name__ == "__main__":
    lines = (f"{json.dumps(name)}: {json.dumps(of_method)}" for name, of_method in answers(conversation()).items())
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
