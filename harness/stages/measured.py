"""A clip of measurements under many configurations: no stage of perception runs, since every frame is a scene.

If the clip knows the true directions of its people, the stages ``truth`` and ``simulated`` give heads and gazes.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from harness.sources import MeasuredClip, PersonTruth
from harness.stages.configuration import Configuration
from harness.stages.sharing import SharedFrame
from harness.stages.slots import SLOTS
from harness.stages.stage_runner import Timings, timed
from vfoa.types import Scene

_DIRECTIONS = {"head_pose": "head_direction", "gaze": "gaze_direction"}
"""The slots whose stages can answer from the truth of a person, and the direction that each needs."""


def measured_frames(
    configurations: Sequence[Configuration], clip: MeasuredClip, numbers: Iterable[int]
) -> Generator[SharedFrame]:
    """Read frames in ascending order; configurations with the same stages get the same scene, and no percepts."""
    stages = {each.name: _stages(each, clip) for each in configurations}
    for number in numbers:
        decoding: Timings = {}
        with timed(decoding, "decode"):
            scene, people = clip.scene(number), clip.truth(number).people
        scenes: dict[tuple[str, ...], Scene] = {}
        for own in stages.values():
            if tuple(own) not in scenes:
                scenes[tuple(own)] = scene if people is None else _with_stages(scene, people, own)
        found = {name: (None, scenes[tuple(own)], dict(decoding)) for name, own in stages.items()}
        yield SharedFrame(index=number, frame=None, by_configuration=found)


def _stages(configuration: Configuration, clip: MeasuredClip) -> dict[str, Any]:
    """The stages of a configuration that answer from the truth of a person, by key."""
    chosen = [choice for slot in _DIRECTIONS if (choice := configuration.choices[slot])]
    return {
        choice.key: SLOTS[choice.slot].stage_class(choice.name)(choice.settings, clip)
        for choice in chosen
        if SLOTS[choice.slot].is_true(choice)
    }


def _with_stages(scene: Scene, people: Iterable[PersonTruth], stages: Mapping[str, Any]) -> Scene:
    """The scene with the directions that the stages give; none where the truth is not known, as in a blink."""
    truths = {person.instance_id: person for person in people}
    placed = []
    for person in scene.people:
        truth = truths.get(person.instance_id or 0)
        cues = {}
        for key, stage in stages.items():
            slot = key.partition(" ")[0]
            is_known = truth is not None and getattr(truth, _DIRECTIONS[slot]) is not None
            cues[slot] = stage.of_person(scene.index, truth) if is_known else None
        placed.append(replace(person, view=replace(person.view, **cues)))
    return replace(scene, people=tuple(placed))
