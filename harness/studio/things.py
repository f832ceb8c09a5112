"""Objects of the studio: shape and paint of each, by its COCO name.

A thing's frame is at its base: z up, y to its back, x to its right, the origin in the middle of its base.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from harness.studio.material import Colour, Material, shaded
from harness.studio.mesh import Mesh, box, ellipsoid, loft, tube, turned


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """A mesh and its paint, in the frame of the body it belongs to."""

    mesh: Mesh
    material: Material


Parts = tuple[Part, ...]

CREAM: Colour = (0.93, 0.89, 0.80)
INK: Colour = (0.12, 0.12, 0.15)
WHITE: Colour = (0.96, 0.96, 0.94)
BALL_RADIUS_M = 0.075


def cup(paint: Colour) -> Parts:
    """A striped mug with a handle, 9.5 cm high."""
    glaze = Material(colours=(paint, WHITE), pattern="panels", scale_m=0.066, grain=0.09)
    wall = turned([(0, 0), (0.036, 0), (0.04, 0.004), (0.043, 0.095), (0.039, 0.095), (0.036, 0.01), (0, 0.008)])
    angle = np.linspace(-np.pi / 2, np.pi / 2, 5)
    handle = np.stack([0.040 + 0.032 * np.cos(angle), 0 * angle, 0.05 + 0.028 * np.sin(angle)], axis=-1)
    return (
        Part(mesh=wall, material=glaze),
        Part(mesh=tube(handle, np.full(5, 0.006)), material=Material(colours=(paint,), grain=0.06)),
    )


def bottle(paint: Colour) -> Parts:
    """A bottle with a label, 27 cm high."""
    glass = Material(colours=(paint, CREAM, paint), pattern="panels", scale_m=0.075, grain=0.1)
    body = [(0, 0), (0.036, 0), (0.038, 0.01), (0.038, 0.16), (0.03, 0.19), (0.015, 0.215), (0.014, 0.255), (0, 0.256)]
    cap = [(0, 0.25), (0.0165, 0.25), (0.0165, 0.272), (0, 0.273)]
    return (
        Part(mesh=turned(body), material=glass),
        Part(mesh=turned(cap), material=Material(colours=(INK,), grain=0.04)),
    )


def bowl(paint: Colour) -> Parts:
    """A dotted bowl, 17 cm wide, with fruit in it."""
    shape = [(0, 0), (0.04, 0), (0.045, 0.008), (0.075, 0.04), (0.086, 0.07), (0.082, 0.07), (0.05, 0.02), (0, 0.016)]
    glaze = Material(colours=(paint, WHITE), pattern="dots", scale_m=0.028, grain=0.06)
    fruit = (((-0.03, 0.012, 0.055), (0.75, 0.2, 0.12)), ((0.034, 0.008, 0.056), (0.93, 0.6, 0.12)))
    return (
        Part(mesh=turned(shape), material=glaze),
        *(Part(mesh=ellipsoid(at, (0.036, 0.036, 0.034)), material=Material(colours=(skin,))) for at, skin in fruit),
    )


def vase(paint: Colour) -> Parts:
    """A vase with a bunch of flowers, 40 cm high."""
    shape = [(0, 0), (0.035, 0), (0.055, 0.05), (0.06, 0.09), (0.04, 0.15), (0.028, 0.18), (0.038, 0.2), (0, 0.198)]
    glaze = Material(colours=(paint, (0.92, 0.92, 0.95), paint), pattern="blotches", scale_m=0.04, grain=0.08)
    green = Material(colours=((0.2, 0.42, 0.18), (0.28, 0.52, 0.2)), pattern="blotches", scale_m=0.03, grain=0.14)
    petal = ((0.9, 0.35, 0.4), (0.95, 0.75, 0.3), (0.85, 0.5, 0.75), (0.93, 0.55, 0.25))
    parts = [Part(mesh=turned(shape), material=glaze)]
    for k in range(9):
        angle, reach = 2.4 * k, 0.02 + 0.0085 * k
        head = np.array([reach * np.cos(angle), reach * np.sin(angle), 0.385 - 0.011 * k])
        stem = np.array([[0, 0, 0.18], head * [0.5, 0.5, 0.75], head])
        parts.append(Part(mesh=tube(stem, (0.003, 0.0025, 0.002), segments=8), material=green))
        bloom = Material(colours=(petal[k % 4], INK), grain=0.4)
        parts.append(Part(mesh=ellipsoid(head, (0.024, 0.024, 0.018), segments=16), material=bloom))
        leaf = ellipsoid(head * [0.75, 0.75, 0.8], (0.022, 0.012, 0.016), segments=12)
        parts.append(Part(mesh=leaf, material=green))
    return tuple(parts)


def book(paint: Colour) -> Parts:
    """A stack of two thick books, the upper one turned aside."""
    pages = Material(colours=(CREAM, (0.84, 0.79, 0.68)), pattern="panels", scale_m=0.004, grain=0.06)
    cover = Material(colours=(paint, (0.95, 0.85, 0.55)), pattern="checks", scale_m=0.07, grain=0.12)
    lower = Material(colours=((0.25, 0.33, 0.42), CREAM), pattern="stripes", scale_m=0.09, grain=0.12)
    return (
        Part(mesh=box((0, 0, 0.018), (0.235, 0.165, 0.028)), material=pages),
        Part(mesh=box((0, 0, 0.002), (0.24, 0.17, 0.004)), material=lower),
        Part(mesh=box((0, 0, 0.034), (0.24, 0.17, 0.004)), material=lower),
        Part(mesh=box((0.012, 0.006, 0.053), (0.205, 0.145, 0.032)), material=pages),
        Part(mesh=box((0.012, 0.006, 0.038), (0.21, 0.15, 0.004)), material=cover),
        Part(mesh=box((0.012, 0.006, 0.071), (0.21, 0.15, 0.004)), material=cover),
    )


def laptop(paint: Colour) -> Parts:
    """An open laptop; its screen faces -y, leaning back."""
    shell = Material(colours=(paint, (0.3, 0.32, 0.36)), pattern="plain", grain=0.07)
    keys = Material(colours=((0.2, 0.2, 0.22), (0.32, 0.32, 0.35)), pattern="checks", scale_m=0.018, grain=0.04)
    screen = Material(colours=((0.2, 0.35, 0.55), (0.5, 0.66, 0.8)), pattern="stripes", scale_m=0.03, grain=0.08)
    sticker = Material(colours=((0.95, 0.55, 0.2), (0.3, 0.7, 0.6)), pattern="checks", scale_m=0.014, grain=0.08)
    lid = box((0, 0, 0.105), (0.31, 0.008, 0.21))
    panel = box((0, -0.005, 0.108), (0.28, 0.004, 0.175))
    marks = [box((-0.06, 0.005, 0.12), (0.06, 0.003, 0.05)), box((0.07, 0.005, 0.08), (0.05, 0.003, 0.06))]
    return (
        Part(mesh=box((0, 0, 0.008), (0.31, 0.22, 0.016)), material=shell),
        Part(mesh=box((0, -0.01, 0.017), (0.27, 0.12, 0.004)), material=keys),
        Part(mesh=_lean(lid), material=shell),
        Part(mesh=_lean(panel), material=screen),
        *(Part(mesh=_lean(mark), material=sticker) for mark in marks),
    )


def clock(paint: Colour) -> Parts:
    """A table clock on two feet, 22 cm high; its dial faces -y and its back is painted."""
    angle = np.linspace(0, 2 * np.pi, 41)
    disc = turned([(0, 0), (0.106, 0), (0.11, 0.004), (0.11, 0.044), (0.106, 0.048), (0, 0.048)], segments=48)
    upright = Mesh(
        vertices=disc.vertices[:, [0, 2, 1]] * [1, 1, -1] + [0, -0.024, 0.115],
        normals=disc.normals[:, [0, 2, 1]] * [1, 1, -1],
        triangles=disc.triangles,
    )
    rim = np.stack([0.108 * np.cos(angle), 0 * angle - 0.022, 0.115 + 0.108 * np.sin(angle)], axis=-1)
    dial = Material(colours=(CREAM, INK, paint), pattern="dial", scale_m=0.112, grain=0.05)
    wood = Material(colours=(paint, paint), grain=0.1)
    feet = [tube(((x, 0, 0.006), (0.8 * x, 0, 0.03)), (0.008, 0.01), segments=10) for x in (-0.06, 0.06)]
    return (
        Part(mesh=upright, material=dial),
        Part(mesh=tube(rim, np.full(41, 0.009), segments=10), material=wood),
        *(Part(mesh=foot, material=wood) for foot in feet),
    )


def teddy_bear(paint: Colour) -> Parts:
    """A sitting bear, 27 cm high, that looks to -y."""
    fur = Material(colours=(paint, shaded(paint, 0.8)), pattern="blotches", scale_m=0.012, grain=0.4)
    light = Material(colours=((0.86, 0.72, 0.52),), grain=0.14)
    dark = Material(colours=(INK,), grain=0.02)
    furry = [
        ((0, 0, 0.085), (0.07, 0.06, 0.085)),
        ((0, -0.005, 0.2), (0.062, 0.055, 0.055)),
        *(((s * 0.05, 0, 0.247), (0.022, 0.012, 0.022)) for s in (-1, 1)),
        *(((s * 0.075, -0.03, 0.115), (0.024, 0.05, 0.026)) for s in (-1, 1)),
        *(((s * 0.058, -0.075, 0.032), (0.032, 0.065, 0.032)) for s in (-1, 1)),
    ]
    pale = [
        ((0, -0.05, 0.188), (0.026, 0.024, 0.021)),
        *(((s * 0.058, -0.138, 0.033), (0.022, 0.006, 0.022)) for s in (-1, 1)),
    ]
    black = [
        ((0, -0.075, 0.195), (0.009, 0.007, 0.007)),
        *(((s * 0.024, -0.053, 0.215), (0.006, 0.006, 0.007)) for s in (-1, 1)),
    ]
    return tuple(
        Part(mesh=ellipsoid(at, radii, segments=20), material=material)
        for shapes, material in ((furry, fur), (pale, light), (black, dark))
        for at, radii in shapes
    )


def sports_ball(paint: Colour) -> Parts:
    """A ball of 15 cm about its centre: it rolls."""
    skin = Material(colours=(paint, WHITE, paint), pattern="checks", scale_m=0.05, grain=0.1)
    return (Part(mesh=ellipsoid((0, 0, 0), np.full(3, BALL_RADIUS_M), segments=36), material=skin),)


def banana(paint: Colour) -> Parts:
    """Three bananas, 20 cm long."""
    angle = np.linspace(-0.9, 0.9, 7)
    radii = np.array([0.006, 0.014, 0.0185, 0.0195, 0.0185, 0.014, 0.005])
    peel = Material(colours=(paint, (0.8, 0.62, 0.15), paint, paint), pattern="blotches", scale_m=0.05, grain=0.1)
    parts = []
    for k, (shift, lift) in enumerate(((-0.03, 0.0), (0.005, 0.004), (0.0, 0.035))):
        curve = np.stack(
            [0.115 * np.sin(angle), 0.045 * (1 - np.cos(angle)) * 2 + shift, 0 * angle + 0.02 + lift], axis=-1
        )
        curve[:, 2] += 0.02 * np.abs(np.sin(angle)) * (k + 1) / 3
        parts.append(Part(mesh=tube(curve, radii, segments=12), material=peel))
    return tuple(parts)


def potted_plant(paint: Colour) -> Parts:
    """A pot with a bush, 30 cm high."""
    pot = loft(
        [(0, 0, 0), (0, 0.05, 0.05), (0.11, 0.07, 0.07), (0.12, 0.075, 0.075), (0.12, 0.066, 0.066), (0.1, 0, 0)]
    )
    clay = Material(colours=(paint, shaded(paint, 0.85)), pattern="panels", scale_m=0.095, grain=0.12)
    green = Material(
        colours=((0.12, 0.3, 0.14), (0.2, 0.45, 0.2), (0.3, 0.56, 0.26), (0.15, 0.36, 0.2)),
        pattern="blotches",
        scale_m=0.02,
        grain=0.4,
    )
    parts = [Part(mesh=pot, material=clay)]
    for k in range(16):
        angle, height = 2.4 * k, 0.15 + 0.0085 * k
        reach = 0.09 * np.sin(np.pi * (k + 3) / 20)
        at = (reach * np.cos(angle), reach * np.sin(angle), height)
        parts.append(Part(mesh=ellipsoid(at, (0.042, 0.042, 0.03), segments=14), material=green))
    return tuple(parts)


THINGS: dict[str, Callable[[Colour], Parts]] = {
    "cup": cup,
    "bottle": bottle,
    "bowl": bowl,
    "vase": vase,
    "book": book,
    "laptop": laptop,
    "clock": clock,
    "teddy bear": teddy_bear,
    "sports ball": sports_ball,
    "banana": banana,
    "potted plant": potted_plant,
}
"""The things by their COCO names; each takes its main colour."""


def _lean(mesh: Mesh) -> Mesh:
    """Lean an upright mesh back by 15 degrees and stand it behind the keyboard."""
    c, s = np.cos(np.radians(15)), np.sin(np.radians(15))
    turn = np.array([[1, 0, 0], [0, c, s], [0, -s, c]])
    return Mesh(
        vertices=mesh.vertices @ turn.T + [0, 0.1, 0.012], normals=mesh.normals @ turn.T, triangles=mesh.triangles
    )
