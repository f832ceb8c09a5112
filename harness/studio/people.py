"""The people of the studio: a sitting body, a head that turns, eyes that turn in it.

Body frame: the origin on the floor under the neck, y in the direction the person faces, z up, x to the person's right.
Head frame: the origin at the top of the neck, the same axes, turned with the head. Eye frame: the ball's centre, y in
the direction of the gaze.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from harness.studio.material import Colour, Material, shaded
from harness.studio.mesh import ellipsoid, loft, tube
from harness.studio.things import Part, Parts
from vfoa.geometry import cross, unit
from vfoa.types import Float

NECK_BODY: Float = np.array([0.0, 0.015, 1.19])
"""The head's pivot (3,) in the body frame, metres."""

FACE_CENTER_HEAD: Float = np.array([0.0, 0.02, 0.085])
"""The middle of the head (3,) in the head frame, at which other people look."""

_CRANIUM = (np.array([0.0, 0.012, 0.082]), np.array([0.075, 0.097, 0.112]))
_EYE_HEIGHT = 0.096
EYE_ORIGIN_HEAD: Float = np.array(
    [
        0.0,
        _CRANIUM[0][1] + _CRANIUM[1][1] * np.sqrt(1 - ((_EYE_HEIGHT - _CRANIUM[0][2]) / _CRANIUM[1][2]) ** 2),
        _EYE_HEIGHT,
    ]
)
"""The eye origin (3,): the point of the face's surface between the eyes, head frame, metres."""

EYE_CENTERS_HEAD: Float = np.array([[0.032, 0.0885, _EYE_HEIGHT], [-0.032, 0.0885, _EYE_HEIGHT]])
"""Centres (2, 3) of the right and the left eye, head frame, metres."""

_EYE_RADIUS_M = 0.0145


@dataclass(frozen=True, slots=True, kw_only=True)
class Appearance:
    """Colours of a person, and whether the hair is long."""

    skin: Colour
    hair: Colour
    shirt: Material
    iris: Colour = (0.3, 0.22, 0.12)
    long_hair: bool = False


def body(appearance: Appearance) -> Parts:
    """Torso, arms and neck in the body frame; the hands lie on a table 0.74 m high."""
    torso = loft(
        [
            (0.50, 0, 0),
            (0.50, 0.165, 0.12),
            (0.66, 0.158, 0.112),
            (0.80, 0.170, 0.112),
            (0.93, 0.188, 0.112),
            (1.01, 0.192, 0.102),
            (1.055, 0.168, 0.088),
            (1.09, 0.11, 0.07),
            (1.115, 0.058, 0.056),
            (1.12, 0, 0),
        ],
        segments=36,
    )
    skin = Material(colours=(appearance.skin,), grain=0.05)
    parts = [Part(mesh=torso, material=appearance.shirt)]
    for side in (-1.0, 1.0):
        sleeve = [
            (side * 0.178, 0, 1.02),
            (side * 0.235, 0.0, 0.90),
            (side * 0.25, 0.06, 0.795),
            (side * 0.16, 0.25, 0.785),
        ]
        parts.append(Part(mesh=tube(sleeve, (0.062, 0.054, 0.047, 0.036), segments=18), material=appearance.shirt))
        wrist = [(side * 0.165, 0.24, 0.785), (side * 0.125, 0.31, 0.775)]
        parts.append(Part(mesh=tube(wrist, (0.028, 0.027)), material=skin))
        parts.append(Part(mesh=ellipsoid((side * 0.098, 0.352, 0.768), (0.043, 0.06, 0.022)), material=skin))
    neck = tube(((0, 0, 1.07), (0, 0.012, 1.19)), (0.054, 0.05), segments=18)
    return (*parts, Part(mesh=neck, material=skin))


def head(appearance: Appearance) -> Parts:
    """Skull, nose, ears and hair in the head frame. The face's marks are painted on."""
    shade = shaded(appearance.skin, 0.86)
    lips: Colour = (0.68, 0.3, 0.28)
    brow: Colour = shaded(appearance.hair, 0.7)
    blush: Colour = (appearance.skin[0], appearance.skin[1] * 0.94, appearance.skin[2] * 0.93)
    face = Material(colours=(appearance.skin, lips, brow, blush), pattern="face", grain=0.05)
    skin = Material(colours=(shade,), grain=0.05)
    hair = Material(
        colours=(appearance.hair, shaded(appearance.hair, 0.75)), pattern="blotches", scale_m=0.014, grain=0.4
    )
    parts = [
        Part(mesh=ellipsoid(*_CRANIUM, segments=40), material=face),
        Part(mesh=ellipsoid((0, 0.028, 0.054), (0.0655, 0.0795, 0.094), segments=36), material=face),
        Part(mesh=ellipsoid((0, 0.112, 0.058), (0.0125, 0.02, 0.027), segments=20), material=skin),
        *(
            Part(mesh=ellipsoid((s * 0.076, 0.002, 0.072), (0.01, 0.02, 0.03), segments=16), material=skin)
            for s in (-1, 1)
        ),
        Part(mesh=ellipsoid((0, -0.014, 0.112), (0.083, 0.098, 0.095), segments=36), material=hair),
        Part(mesh=ellipsoid((0.012, 0.03, 0.158), (0.066, 0.072, 0.042), segments=28), material=hair),
    ]
    if appearance.long_hair:
        parts.append(Part(mesh=ellipsoid((0, -0.05, 0.03), (0.084, 0.062, 0.115), segments=32), material=hair))
        for s in (-1.0, 1.0):
            lock = [
                (s * 0.07, -0.005, 0.13),
                (s * 0.084, -0.012, 0.06),
                (s * 0.082, -0.02, -0.01),
                (s * 0.075, -0.025, -0.05),
            ]
            parts.append(Part(mesh=tube(lock, (0.02, 0.026, 0.026, 0.016), segments=14), material=hair))
    return tuple(parts)


def eye(appearance: Appearance) -> Parts:
    """An eyeball in the eye frame."""
    paint = Material(
        colours=((0.95, 0.94, 0.92), appearance.iris, (0.03, 0.03, 0.03)), pattern="eye", scale_m=_EYE_RADIUS_M, grain=0
    )
    return (Part(mesh=ellipsoid((0, 0, 0), np.full(3, _EYE_RADIUS_M), segments=24), material=paint),)


_UP = np.array([0.0, 0.0, 1.0])


def room_from_look(direction_room: ArrayLike) -> Float:
    """Rotation (3, 3) whose y column is a direction (3,) in the room, x level, z up: a head without roll."""
    forward = unit(direction_room)
    right = unit(cross(forward, _UP))
    return np.stack([right, forward, cross(right, forward)], axis=-1)
