"""The paper's five synthetic cases: attention over the number of rays and the field of view.

A cube of 0.4 m centred 1.1 m in front of the eyes, cones with surface rays only. Where the paper gives no measures (the
corner, the direction outside, the second object) we chose the scenes.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from vfoa.attention import AttentionSettings, pay_attention
from vfoa.types import (
    Box3D,
    Cues,
    FrameResult,
    Gaze,
    HeadPose,
    Instance,
    Person,
    Scene,
    Subject,
    Target,
)

Vector = tuple[float, float, float]

N_RAYS = tuple(range(4, 41))
RADII_CM = tuple(range(5, 48))
"""Radius of the cone's base at 1.10 m: full apex angles of 5.2 to 46.3 degrees."""

_AHEAD: Vector = (0.0, 0.0, 1.0)
_NEAR_CORNER: Vector = (0.18, 0.18, 0.9)
_OUTSIDE: Vector = (0.45, 0.0, 1.0)
_ASIDE: Vector = (math.sin(math.radians(25)), 0.0, math.cos(math.radians(25)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Cube:
    """An object of a case: centre and half of its side, metres, camera frame."""

    name: str
    center_m: Vector = (0.0, 0.0, 1.1)
    half_m: float = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One scene: the directions of gaze and head from the origin (any length), and the objects."""

    name: str
    gaze: Vector = _AHEAD
    head: Vector = _AHEAD
    objects: tuple[Cube, ...] = (Cube(name="cube"),)


CASES = (
    Case(name="1 both on the centre"),
    Case(name="2 head on a corner", head=_NEAR_CORNER),
    Case(name="2 gaze on a corner", gaze=_NEAR_CORNER),
    Case(name="3 head outside", head=_OUTSIDE),
    Case(name="3 gaze outside", gaze=_OUTSIDE),
    Case(
        name="4 two sizes",
        objects=(
            Cube(name="small", center_m=(-0.25, 0.0, 1.1)),
            Cube(name="big", center_m=(0.35, 0.0, 1.1), half_m=0.3),
        ),
    ),
    Case(
        name="5 different objects",
        head=_ASIDE,
        objects=(
            Cube(name="of the gaze"),
            Cube(name="of the head", center_m=(1.1 * _ASIDE[0], 0.0, 1.1 * _ASIDE[2])),
        ),
    ),
)


_CENTRED = ((40, 5, 0.99), (40, 10, 0.95), (40, 20, 0.82), (4, 30, 0.0), (40, 30, 0.19), (40, 40, 0.0))
"""(n_rays, radius_cm, total) with gaze and head on the centre."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """Attention to one object in one case at one setting; the parts of gaze and head make the total."""

    case: str
    n_rays: int
    radius_cm: float
    object: str
    gaze: float
    head: float
    total: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Statement:
    """A statement of the paper about a case, the value found, and whether it holds."""

    claim: str
    expected: str
    found: str
    holds: bool


def simulate(n_rays: Iterable[int] = N_RAYS, radii_cm: Iterable[float] = RADII_CM) -> tuple[Row, ...]:
    """Attention in every case, at every number of rays with every radius (cm at 1.10 m)."""
    scenes = [(case, _subject(case), _targets(case)) for case in CASES]
    radii = tuple(radii_cm)
    return tuple(
        Row(
            case=case.name,
            n_rays=n,
            radius_cm=radius,
            object=thing.name,
            gaze=value.gaze,
            head=value.head,
            total=value.total,
        )
        for n in n_rays
        for radius in radii
        for settings in [AttentionSettings(cones_cm=(radius,), n_rays=n, axis_ray=False)]
        for case, subject, targets in scenes
        for thing, value in zip(case.objects, pay_attention(subject, targets, settings).values, strict=True)
    )


def look(case: Case, radius_cm: int, n_rays: int = 40) -> FrameResult:
    """Return one case at one setting as a frame of its own, whose number is the radius in cm."""
    subject, targets = _subject(case), _targets(case)
    scene = Scene(index=radius_cm, time_ns=0, targets=targets, people=(subject.person,))
    settings = AttentionSettings(cones_cm=(radius_cm,), n_rays=n_rays, axis_ray=False)
    return FrameResult(scene=scene, attentions=(pay_attention(subject, targets, settings),))


def tuning_sums(rows: Iterable[Row], over: Literal["n_rays", "radius_cm"]) -> dict[float, float]:
    """Sum of the totals over all cases, for each number of rays or each radius, ascending."""
    sums: defaultdict[float, float] = defaultdict(float)
    for row in rows:
        sums[row.n_rays if over == "n_rays" else row.radius_cm] += row.total
    return dict(sorted(sums.items()))


def setting_sums(rows: Iterable[Row]) -> dict[tuple[int, float], float]:
    """Sum of the totals over all cases, for each (n_rays, radius_cm)."""
    sums: defaultdict[tuple[int, float], float] = defaultdict(float)
    for row in rows:
        sums[row.n_rays, row.radius_cm] += row.total
    return dict(sums)


def best_setting(rows: Iterable[Row]) -> tuple[int, float]:
    """(n_rays, radius_cm) of the greatest sum over all cases; the first of equals."""
    sums = setting_sums(rows)
    return max(sums, key=sums.__getitem__)


def statements(rows: Iterable[Row]) -> tuple[Statement, ...]:
    """Check the paper's statements. ``rows`` hold 4 and 40 rays at radii of 5, 10, 20, 30 and 40 cm."""
    at = {(row.case, row.n_rays, row.radius_cm, row.object): row for row in rows}
    first = CASES[0].name
    centred = [
        _near(f"both on the centre, total at {radius} cm, {n} rays", expected, at[first, n, radius, "cube"].total)
        for n, radius, expected in _CENTRED
    ]
    both, head_corner, gaze_corner, head_off, gaze_off = (at[case.name, 40, 5, "cube"] for case in CASES[:5])
    small, big = (at[CASES[5].name, 40, 30, thing.name] for thing in CASES[5].objects)
    of_gaze, of_head = (at[CASES[6].name, 40, 5, thing.name] for thing in CASES[6].objects)
    return (
        *centred,
        _near("both on the centre, gaze's share of the total", 0.6, both.gaze / both.total),
        _near("both on the centre, head's part", 0.39, both.head),
        _near("head on a corner, head's part", 0.1, head_corner.head, within=0.05),
        _same("head on a corner, the gaze keeps its part", both.gaze, head_corner.gaze),
        _same("gaze on a corner, the head keeps its part", both.head, gaze_corner.head),
        Statement(
            claim="one cue outside, the total is the other cue's part",
            expected=f"{both.gaze:.3f} and {both.head:.3f}",
            found=f"{head_off.total:.3f} and {gaze_off.total:.3f}",
            holds=math.isclose(head_off.total, both.gaze) and math.isclose(gaze_off.total, both.head),
        ),
        Statement(
            claim="two sizes in view (30 cm), both get attention, the bigger more",
            expected="0 < small < big",
            found=f"small {small.total:.3f}, big {big.total:.3f}",
            holds=0 < small.total < big.total,
        ),
        Statement(
            claim="gaze and head on different objects, the gaze's wins",
            expected="of the gaze > of the head",
            found=f"{of_gaze.total:.3f} and {of_head.total:.3f}",
            holds=of_gaze.total > of_head.total,
        ),
    )


def _near(claim: str, expected: float, found: float, within: float = 0.005) -> Statement:
    holds = abs(found - expected) <= within
    return Statement(claim=claim, expected=f"{expected:.2f} ± {within:g}", found=f"{found:.3f}", holds=holds)


def _same(claim: str, expected: float, found: float) -> Statement:
    return Statement(claim=claim, expected=f"{expected:.3f}", found=f"{found:.3f}", holds=math.isclose(found, expected))


def _subject(case: Case) -> Subject:
    gaze, head_pose = Gaze(direction=np.array(case.gaze)), HeadPose(direction=np.array(case.head))
    person = Person(view=Cues(head_pose=head_pose, gaze=gaze), instance_id=0, eye_origin_left=np.zeros(3))
    return Subject(track_id=1, person=person, gaze=gaze, head_pose=head_pose)


def _targets(case: Case) -> tuple[Target, ...]:
    return tuple(
        Target(
            instance=Instance(id=number, label=cube.name, category_id=1, is_thing=True, score=1.0),
            box_px=None,
            points_left=np.zeros((0, 3), np.float32),
            box=Box3D(center_m=np.array(cube.center_m), half_size_m=np.full(3, cube.half_m), left_from_box=np.eye(3)),
        )
        for number, cube in enumerate(case.objects, start=1)
    )
