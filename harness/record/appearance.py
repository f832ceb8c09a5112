"""The appearance of people and things wherever they are drawn: names, one colour per name, and cones as lines."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from harness.labels.labels import IGNORED, NOWHERE
from harness.run.records import AttentionRecord, FrameRecord, SubjectRecord
from harness.score.verdicts import name_probabilities
from vfoa.geometry import CONE_HEIGHT_M, left_from_crop
from vfoa.types import Attention, Cone, Cue, Float, Scene

Colour = tuple[int, int, int]

CUE_COLOURS: dict[Cue, Colour] = {"gaze": (255, 221, 51), "head": (102, 204, 255)}
OUTCOME_COLOURS: dict[str, Colour] = {"correct": (64, 200, 96), "wrong": (240, 72, 72), "unscored": (130, 130, 130)}
TRUTH_COLOUR: Colour = OUTCOME_COLOURS["correct"]
GREY: Colour = (150, 150, 150)

# Twelve hues that differ from each other, from the colours above, and from a dark background.
_TARGET_COLOURS: tuple[Colour, ...] = (
    (255, 127, 80),
    (186, 104, 255),
    (0, 180, 170),
    (255, 105, 180),
    (170, 210, 60),
    (90, 130, 255),
    (215, 165, 95),
    (0, 150, 90),
    (205, 92, 150),
    (150, 170, 200),
    (170, 110, 70),
    (225, 190, 225),
)

ARROW_M = 0.25
"""Length of the arrow of a direction."""
RIM = 32
_RIBS = 4


class Colours:
    """A colour and a class for every target's name: in the given order, then in order of appearance."""

    def __init__(self, names: Iterable[str]) -> None:
        self._classes: dict[str, int] = {}
        for name in names:
            self.class_of(name)

    def class_of(self, name: str) -> int:
        """The class id of a name in masks and clouds, from 1; a new name gets the next one."""
        return self._classes.setdefault(name, len(self._classes) + 1)

    def of(self, name: str) -> Colour:
        """The colour of a name; grey for a name that is no target."""
        if name in (NOWHERE, IGNORED):
            return GREY
        return _TARGET_COLOURS[(self.class_of(name) - 1) % len(_TARGET_COLOURS)]

    @property
    def known(self) -> dict[str, Colour]:
        """All names so far, with their colours, in the order of their classes."""
        return {name: self.of(name) for name in self._classes}


def subject_names(record: FrameRecord) -> dict[int, str]:
    """The name of each subject of a frame by track id, each used once: ``girl``, ``track 3``, ``girl (track 4)``."""
    names: dict[int, str] = {}
    for subject in record.subjects:
        name = subject.name or f"track {subject.track_id}"
        names[subject.track_id] = f"{name} (track {subject.track_id})" if name in names.values() else name
    return names


def target_names(record: FrameRecord) -> dict[int, str]:
    """The name of each target of a frame by instance id, each used once."""
    return distinct_names({target.instance_id: target.name for target in record.targets})


def distinct_names(names: Mapping[int, str]) -> dict[int, str]:
    """Names by instance id, each used once: ``cup``, ``cup (4)`` if there are two cups."""
    uses = Counter(names.values())
    return {number: name if uses[name] == 1 else f"{name} ({number})" for number, name in names.items()}


def attention_by_name(
    record: FrameRecord, subject: SubjectRecord, *, probabilistic: bool
) -> dict[str, AttentionRecord]:
    """A subject's attention by the target's manifest name; of instances that share a name, the greatest.

    Of probabilities it is their sum, as in the tables: that somebody looks at any of them.
    """
    names = {target.instance_id: target.name for target in record.targets}
    found: dict[str, AttentionRecord] = {}
    for value in subject.attention:
        other = found.setdefault(names[value.instance_id], value)
        if other is value:
            continue
        if probabilistic:
            gaze, head = _sum(value.gaze, other.gaze), _sum(value.head, other.head)
            value = replace(value, gaze=gaze, head=head, total=value.total + other.total)
        if value.total > other.total:
            found[names[value.instance_id]] = value
    return found


def _sum(first: float | None, second: float | None) -> float | None:
    return None if first is None or second is None else first + second


def totals_by_name(record: FrameRecord, subject: SubjectRecord, *, probabilistic: bool) -> dict[str, float]:
    """A subject's total attention by the target's manifest name; of probabilities, also that of looking at nothing."""
    if probabilistic:
        return name_probabilities(record, subject) if subject.attention else {}
    return {name: value.total for name, value in attention_by_name(record, subject, probabilistic=False).items()}


def reach_m(attention: Attention, scene: Scene) -> float:
    """Length of a subject's cones and missing rays, metres: median distance of the targets, else the paper's height."""
    eyes = attention.subject.person.eye_origin_left
    attended = {value.instance_id for value in attention.values}
    boxes = [target.box for target in scene.targets if target.instance.id in attended and target.box is not None]
    if eyes is None or not boxes:
        return CONE_HEIGHT_M
    return statistics.median(math.dist(box.center_m, eyes) for box in boxes)


def cone_wires(cones: Sequence[Cone], reach_m: float, *, rim: int = RIM) -> Float:
    """Each cone as one line (cones, N, 3) in the camera frame, metres: four ribs of length ``reach_m``, then the rim.

    It is one line, because Rerun takes an array of lines ten times faster than a list of lines of several lengths.
    ``rim`` is the number of points on the rim, a multiple of four.
    """
    apexes = np.array([cone.apex_left for cone in cones]).reshape(-1, 1, 3)
    axes = np.array([cone.axis for cone in cones]).reshape(-1, 3)
    halves = [cone.fov_rad / 2 for cone in cones]
    widths = np.array([(math.sin(half), math.sin(half), math.cos(half)) for half in halves]).reshape(-1, 1, 3)
    rings = apexes + reach_m * (_circle(rim) * widths) @ left_from_crop(axes).swapaxes(1, 2)
    ribs = np.repeat(rings[:, : -1 : rim // _RIBS], 2, axis=1)
    ribs[:, 1::2] = apexes
    return np.concatenate([ribs, rings], axis=1)


@cache
def _circle(rim: int) -> Float:
    """Points (rim + 1, 3) on the circle of radius 1 at z = 1; the last is the first."""
    turn = np.linspace(0, 2 * math.pi, rim + 1)
    return np.stack([np.cos(turn), np.sin(turn), np.ones_like(turn)], axis=1)
