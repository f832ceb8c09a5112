"""The simulated cases of Simões and Moreno (ICARSC 2022), beside what the paper states: ``vfoa run paper_cases``.

One object and several, 1.1 m in front of the eyes; gaze and head on the middle, a corner and outside; the radius of the
cone and the number of its rays vary. Cones have surface rays only, no axis ray.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from harness.report.formats import Table
from vfoa.cones import ConesSettings, pay_attention
from vfoa.types import Box3D, Cues, Gaze, HeadPose, Instance, Person, Subject, Target, TargetAttention

Vector = tuple[float, float, float]
Values = tuple[TargetAttention, ...]

RADII_CM = (5, 10, 20, 30, 40)
RAYS = (4, 40)

AHEAD: Vector = (0.0, 0.0, 1.0)
CORNER: Vector = (0.18, 0.18, 0.9)
OUTSIDE: Vector = (0.45, 0.0, 1.0)
ASIDE: Vector = (math.sin(math.radians(25)), 0.0, math.cos(math.radians(25)))


@dataclass(frozen=True)
class Cube:
    """An object: its centre in the left camera's frame and half of its side, metres."""

    center_m: Vector = (0.0, 0.0, 1.1)
    half_m: float = 0.2


@dataclass(frozen=True, kw_only=True)
class Case:
    """A person whose eyes are at the origin, objects, and what the paper states of them.

    ``gaze`` and ``head`` are directions of any length. ``holds(values, centred)`` tells whether the statement is true
    of the attention to each object; ``centred`` is that of the same cone with both cues on the middle of the one cube.
    """

    name: str
    statement: str
    holds: Callable[[Values, Values], bool]
    gaze: Vector = AHEAD
    head: Vector = AHEAD
    cubes: tuple[Cube, ...] = (Cube(),)

    def attention(self, radius_cm: float, n_rays: int) -> Values:
        """The attention to each cube, in order. ``radius_cm`` is the cone's at 1.10 m."""
        view = Cues(head_pose=HeadPose(direction=np.array(self.head)), gaze=Gaze(direction=np.array(self.gaze)))
        person = Person(view=view, instance_id=0, eye_origin_left=np.zeros(3))
        subject = Subject(track_id=1, person=person, gaze=view.gaze, head_pose=view.head_pose)
        targets = tuple(_target(number, cube) for number, cube in enumerate(self.cubes, start=1))
        settings = ConesSettings(cones_cm=(radius_cm,), n_rays=n_rays, axis_ray=False)
        return pay_attention(subject, targets, settings).values


def _target(number: int, cube: Cube) -> Target:
    return Target(
        instance=Instance(id=number, label="cube", category_id=1, is_thing=True, score=1.0),
        box_px=None,
        points_left=np.zeros((0, 3), np.float32),
        box=Box3D(center_m=np.array(cube.center_m), half_size_m=np.full(3, cube.half_m), left_from_box=np.eye(3)),
    )


def _same(a: float, b: float) -> bool:
    return math.isclose(a, b, abs_tol=1e-9)


CASES = (
    Case(
        name="both on the middle",
        statement="gaze and head have 60 and 40 % of the total",
        holds=lambda values, _: values[0].total > 0 and _same(values[0].gaze, 0.6 * values[0].total),
    ),
    Case(
        name="head on a corner",
        statement="the head's part falls, the gaze's stays",
        holds=lambda values, centred: values[0].head < centred[0].head and _same(values[0].gaze, centred[0].gaze),
        head=CORNER,
    ),
    Case(
        name="gaze on a corner",
        statement="the gaze's part falls, the head's stays",
        holds=lambda values, centred: values[0].gaze < centred[0].gaze and _same(values[0].head, centred[0].head),
        gaze=CORNER,
    ),
    Case(
        name="head outside",
        statement="the total is the gaze's part",
        holds=lambda values, centred: values[0].total > 0 and _same(values[0].total, centred[0].gaze),
        head=OUTSIDE,
    ),
    Case(
        name="gaze outside",
        statement="the total is the head's part",
        holds=lambda values, centred: values[0].total > 0 and _same(values[0].total, centred[0].head),
        gaze=OUTSIDE,
    ),
    Case(
        name="between two sizes",
        statement="both have attention, the second, bigger one more",
        holds=lambda values, _: 0 < values[0].total < values[1].total,
        cubes=(Cube((-0.25, 0.0, 1.1)), Cube((0.35, 0.0, 1.1), half_m=0.3)),
    ),
    Case(
        name="gaze on 1, head on 2",
        statement="the first one, that of the gaze, has more",
        holds=lambda values, _: values[0].total > values[1].total > 0,
        head=ASIDE,
        cubes=(Cube(), Cube((1.1 * ASIDE[0], 0.0, 1.1 * ASIDE[2]))),
    ),
)


def paper_cases() -> Table:
    """The attention to each object by radius and number of rays, and whether the paper's statement is reproduced."""
    return Table.of(
        "The paper's simulated cases",
        "Case | Statement | Object | Radius cm | Rays | Gaze | Head | Total | Reproduced",
        _rows(),
        words=2,
        notes=(
            "Cubes of 0.4 m, 1.1 m away; of the two sizes, 0.4 and 0.6 m. Radii are at 1.10 m. No axis ray.",
            "The cube on the middle is the paper's. Where the paper gives no measures (the corner, the direction "
            "outside, the second object), they are ours.",
            '"no": the statement is not reproduced with this cone. Wide cones pass the object by, or reach it where a '
            "narrow one does not; few rays leave blind spots.",
        ),
    )


def _rows() -> Iterator[tuple[object, ...]]:
    for case in CASES:
        for n_rays in RAYS:
            for radius_cm in RADII_CM:
                values, centred = case.attention(radius_cm, n_rays), CASES[0].attention(radius_cm, n_rays)
                reproduced = "yes" if case.holds(values, centred) else "no"
                for value in values:
                    parts = (f"{part:.2f}" for part in (value.gaze, value.head, value.total))
                    yield case.name, case.statement, value.instance_id, radius_cm, n_rays, *parts, reproduced
