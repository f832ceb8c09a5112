"""Randomly drawn scenarios, so that clips for tuning and clips for reporting differ only in their seed.

One to three people sit at the far side of the table, and four to all eleven kinds of things stand where there is room.
People look at any thing and at each other, and in one of six fixations at the camera, which is no target. How far the
head follows the gaze differs from person to person; in one of six fixations it points at some other thing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from harness.studio.scenario import CAMERA, SCENARIOS, Actor, Scenario, ScriptedLook, Thing
from harness.studio.things import THINGS

LEAST_THINGS = 4
LOOKS = 24
RARE = 1 / 6
"""Share of the fixations at the camera, and of those in which the head points elsewhere."""

_SEATS_X_M = {1: (0.0,), 2: (-0.5, 0.5), 3: (-0.8, 0.0, 0.8)}
_TABLE_Y_M = (1.16, 1.6)
_GAP_M = 0.02
_VIEW = 0.61
"""Tangent of half the angle within which things stand, so that the camera sees them completely."""

_THINGS = {thing.label: thing for scenario in SCENARIOS.values() for thing in scenario.things}
_ACTORS = SCENARIOS["crowd"].actors


def gathering(seed: int) -> Scenario:
    """Return the scenario of a seed: seats, objects and looks."""
    rng = np.random.default_rng([seed, 0])
    people = int(rng.integers(1, len(_ACTORS), endpoint=True))
    labels = rng.permutation(sorted(_THINGS))[: rng.integers(LEAST_THINGS, len(_THINGS), endpoint=True)]
    things = _place([_THINGS[label] for label in labels], people + 1, rng)
    names = [actor.name for actor in _ACTORS[:people]]
    seats = zip(_ACTORS[:people], _SEATS_X_M[people], strict=True)
    actors = tuple(
        _seat(actor, x, [*names[:k], *names[k + 1 :], *(thing.name for thing in things)], rng)
        for k, (actor, x) in enumerate(seats)
    )
    room = list(SCENARIOS.values())[rng.integers(len(SCENARIOS))]
    return replace(room, things=things, actors=actors)


def _place(wanted: Sequence[Thing], first_id: int, rng: np.random.Generator) -> tuple[Thing, ...]:
    """Put things on the table, the largest first, each where it neither touches nor hides the ones before it."""
    radius = {thing.label: _radius_m(thing.label) for thing in wanted}
    places: dict[str, tuple[float, float]] = {}
    for label in sorted(radius, key=lambda label: -radius[label]):
        for _ in range(1000):
            y = float(rng.uniform(*_TABLE_Y_M))
            x = float(rng.uniform(-1, 1)) * (_VIEW * y - radius[label])
            if all(_are_apart((x, y), places[other], radius[label] + radius[other]) for other in places):
                places[label] = (x, y)
                break
    placed = [thing for thing in wanted if thing.label in places]
    headings = rng.uniform(0, 360, len(placed)).tolist()
    return tuple(
        replace(thing, id=number, at=(*places[thing.label], thing.at[2]), heading_deg=heading, roll=None)
        for number, (thing, heading) in enumerate(zip(placed, headings, strict=True), start=first_id)
    )


def _are_apart(one: tuple[float, float], other: tuple[float, float], radii_m: float) -> bool:
    """Whether two things leave a gap on the table, and the camera (at the origin) sees most of both."""
    aside = abs(math.atan2(*one) - math.atan2(*other)) * min(one[1], other[1])
    return math.dist(one, other) > radii_m + _GAP_M and aside > radii_m / 2


@cache
def _radius_m(label: str) -> float:
    """Distance from a thing's position to its outermost point."""
    vertices = np.concatenate([part.mesh.vertices for part in THINGS[label](_THINGS[label].colour)])
    return float(np.hypot(vertices[:, 0], vertices[:, 1]).max())


def _seat(actor: Actor, x: float, others: list[str], rng: np.random.Generator) -> Actor:
    """A person who turns slightly to the middle of the table, and looks at another target each time."""
    script: list[ScriptedLook] = []
    while len(script) < LOOKS:
        at = CAMERA if rng.random() < RARE else others[rng.integers(len(others))]
        aside = others[rng.integers(len(others))] if rng.random() < RARE else None
        if not script or script[-1].at != at:
            script.append(ScriptedLook(at=at, head_at=aside))
    return replace(
        actor,
        at=(x + rng.uniform(-0.05, 0.05), 1.88 + rng.uniform(-0.04, 0.06), 0.0),
        heading_deg=180 - 25 * x + rng.uniform(-10, 10),
        head_share=rng.uniform(0.4, 0.8),
        script=tuple(script),
    )
