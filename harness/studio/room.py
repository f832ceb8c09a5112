"""The room around the people: a table, a floor, a bare wall, a pleated curtain and a picture."""

from __future__ import annotations

import numpy as np

from harness.studio.material import Material
from harness.studio.mesh import Mesh, box
from harness.studio.scenario import TABLE_HEIGHT_M, Scenario
from harness.studio.things import INK, Part, Parts

_WALL_Y = 2.75


def room(scenario: Scenario) -> dict[str, Parts]:
    """The parts of the room in its own frame, by the COCO stuff class they belong to."""
    return {"wall": _wall(scenario), "floor": _floor(), "table": _table(scenario), "curtain": _curtain(scenario)}


def _table(scenario: Scenario) -> Parts:
    thickness = 0.035
    top = box((0, 1.30, TABLE_HEIGHT_M - thickness / 2), (2.5, 0.84, thickness))
    return (Part(mesh=top, material=scenario.cloth),)


def _floor() -> Parts:
    boards = Material(
        colours=((0.4, 0.33, 0.27), (0.36, 0.3, 0.24), (0.44, 0.36, 0.29)), pattern="wood", scale_m=0.3, grain=0.2
    )
    return (Part(mesh=box((0, 1.8, -0.05), (8, 5, 0.1)), material=boards),)


def _wall(scenario: Scenario) -> Parts:
    """Bare paint without texture for a matcher, and a picture."""
    paint = Material(colours=(scenario.wall,), grain=0)
    frame = Material(colours=((0.32, 0.22, 0.14),), grain=0.2)
    canvas = Material(
        colours=((0.16, 0.3, 0.42), (0.36, 0.52, 0.56), (0.86, 0.76, 0.52), (0.8, 0.46, 0.3)),
        pattern="blotches",
        scale_m=0.17,
        grain=0.35,
    )
    x, z = -1.12, 1.33
    return (
        Part(mesh=box((0, _WALL_Y + 0.05, 1.5), (9, 0.1, 3.4)), material=paint),
        Part(mesh=box((x, _WALL_Y - 0.015, z), (0.62, 0.03, 0.42)), material=frame),
        Part(mesh=box((x, _WALL_Y - 0.03, z), (0.55, 0.012, 0.35)), material=canvas),
        Part(mesh=box((0, _WALL_Y - 0.01, 0.06), (9, 0.02, 0.12)), material=Material(colours=(INK,), grain=0.1)),
    )


def _curtain(scenario: Scenario) -> Parts:
    """Pleats and stripes: a repeating pattern, on which matchers pick the wrong stripe."""
    along, up = np.linspace(0, 1, 181), np.array([0.05, 2.6])
    x, y = 0.75 + 1.6 * along, _WALL_Y - 0.10 + 0.035 * np.cos(2 * np.pi * 13 * along)
    slope = np.gradient(y, x)
    normals = np.stack([slope, -np.ones_like(x), 0 * x], axis=-1) / np.hypot(slope, 1)[:, None]
    low = np.arange(len(x) - 1, dtype=np.int32)
    n = len(x)
    quads = np.stack([low, low + 1, low + 1 + n, low, low + 1 + n, low + n], axis=-1)
    mesh = Mesh(
        vertices=np.concatenate([np.stack([x, y, np.full_like(x, z)], axis=-1) for z in up]),
        normals=np.concatenate([normals, normals]),
        triangles=quads.reshape(-1, 3),
    )
    cloth = Material(colours=scenario.curtain, pattern="stripes", scale_m=0.0615, grain=0.12)
    return (Part(mesh=mesh, material=cloth),)
