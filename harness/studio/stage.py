"""A scenario in metres: every body with its shape, its paint, its instance and its pose at each frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.sources import PersonTruth
from harness.studio import people
from harness.studio.choreography import ActorPose, Choreography, Pose
from harness.studio.material import Material
from harness.studio.mesh import Mesh, Surface, box
from harness.studio.scenario import CAMERA, TABLE_HEIGHT_M, Scenario
from harness.studio.things import INK, THINGS, Part, Parts
from vfoa.geometry import project
from vfoa.types import Box3D, Float, Instance, StereoRig

RIG = StereoRig(
    width_px=1024,
    height_px=436,
    fx_px=800.0,
    fy_px=800.0,
    cx_px=511.5,
    cy_px=217.5,
    baseline_m=0.06,
    cx_right_px=511.5,
)
"""A stereo head of a robot's size. Nothing is nearer than 0.9 m, so no disparity is above 54 px."""

CAMERA_TILT_DEG = 9.0
"""Angle by which the cameras look down."""

COCO_IDS = {
    "person": 1,
    "sports ball": 37,
    "bottle": 44,
    "cup": 47,
    "bowl": 51,
    "banana": 52,
    "potted plant": 64,
    "laptop": 73,
    "book": 84,
    "clock": 85,
    "vase": 86,
    "teddy bear": 88,
    "curtain": 109,
    "table": 189,
    "floor": 190,
    "wall": 199,
}
"""COCO panoptic's category numbers."""

_FIRST_STUFF_ID = 101
_WALL_Y = 2.75


@dataclass(frozen=True, slots=True, kw_only=True)
class Body:
    """A rigid body: its parts in its own frame, and its instance. ``moves``: it moves during the clip."""

    name: str
    instance_id: int
    parts: Parts
    moves: bool


class Stage:
    """All bodies of a scenario, and the ground truth that follows from their poses. Camera frame, metres."""

    def __init__(self, scenario: Scenario, frames: int, seed: int) -> None:
        self._scenario = scenario
        stuff = _room(scenario)
        self.bodies: tuple[Body, ...] = (
            *(
                Body(name=label, instance_id=_FIRST_STUFF_ID + k, parts=parts, moves=False)
                for k, (label, parts) in enumerate(stuff.items())
            ),
            *(
                Body(
                    name=thing.name,
                    instance_id=thing.id,
                    parts=THINGS[thing.label](thing.colour),
                    moves=bool(thing.roll),
                )
                for thing in scenario.things
            ),
            *(
                Body(name=f"{actor.name}/{part}", instance_id=actor.id, parts=build(actor.appearance), moves=True)
                for actor in scenario.actors
                for part, build in (
                    ("body", people.body),
                    ("head", people.head),
                    ("eye0", people.eye),
                    ("eye1", people.eye),
                )
            ),
        )
        self._by_name = {body.name: body for body in self.bodies}
        self.instances: tuple[Instance, ...] = tuple(
            Instance(id=number, label=label, category_id=COCO_IDS[label], is_thing=number < _FIRST_STUFF_ID, score=1.0)
            for number, label in (
                *((actor.id, "person") for actor in scenario.actors),
                *((thing.id, thing.label) for thing in scenario.things),
                *((_FIRST_STUFF_ID + k, label) for k, label in enumerate(stuff)),
            )
        )
        surfaces = {
            thing.name: Surface.of([part.mesh for part in self._by_name[thing.name].parts]) for thing in scenario.things
        }
        self._choreography = Choreography(scenario, frames, seed, surfaces)

    def poses(self, frame: int) -> dict[str, Pose]:
        """The pose of every body in the camera frame; ``frame`` counts from 0."""
        poses = {body.name: Pose(frame_from_body=np.eye(3), origin_m=np.zeros(3)) for body in self.bodies}
        for thing in self._scenario.things:
            poses[thing.name] = self._choreography.thing(thing, frame)
        for actor, pose in self._actors(frame).items():
            parts = (pose.body, pose.head, *pose.eyes)
            poses |= {f"{actor}/{part}": p for part, p in zip(("body", "head", "eye0", "eye1"), parts, strict=True)}
        return {name: _to_left(pose) for name, pose in poses.items()}

    def boxes(self, frame: int) -> dict[int, Box3D]:
        """The axis-aligned box of every thing and person, by instance id: of the whole mesh, visible or not."""
        poses = self.poses(frame)
        points: dict[int, list[Float]] = {}
        for body in self.bodies:
            if body.instance_id < _FIRST_STUFF_ID:
                points.setdefault(body.instance_id, []).append(poses[body.name].apply(_vertices(body.parts)))
        return {number: _bounding_box(np.concatenate(vertices)) for number, vertices in points.items()}

    def people(self, frame: int) -> tuple[PersonTruth, ...]:
        """The ground truth of every person."""
        ids = {actor.name: actor.id for actor in self._scenario.actors}
        return tuple(
            PersonTruth(
                name=name,
                instance_id=ids[name],
                head_box_px=self._head_box(name, pose),
                eye_origin_left=_left_from_room() @ (pose.eye_origin - CAMERA),
                head_direction=_left_from_room() @ pose.head.frame_from_body[:, 1],
                gaze_direction=_left_from_room() @ pose.gaze,
                target=pose.target,
            )
            for name, pose in self._actors(frame).items()
        )

    def _actors(self, frame: int) -> dict[str, ActorPose]:
        return {actor.name: self._choreography.actor(actor, frame) for actor in self._scenario.actors}

    def _head_box(self, name: str, pose: ActorPose) -> Float:
        """Extent (4,) in pixels of the whole head, hair and ears included, cut at the image's border."""
        pixels = project(_to_left(pose.head).apply(_vertices(self._by_name[f"{name}/head"].parts)), RIG)
        limits = np.array([RIG.width_px, RIG.height_px]) - 0.5
        return np.concatenate([np.clip(edge, -0.5, limits) for edge in (pixels.min(axis=0), pixels.max(axis=0))])


def _left_from_room() -> Float:
    """Rotation (3, 3) from the room's axes (x right, y forward, z up) to the tilted camera's."""
    c, s = np.cos(np.radians(CAMERA_TILT_DEG)), np.sin(np.radians(CAMERA_TILT_DEG))
    return np.array([[1, 0, 0], [0, -s, -c], [0, c, -s]])


def _to_left(pose: Pose) -> Pose:
    rotation = _left_from_room()
    return Pose(frame_from_body=rotation @ pose.frame_from_body, origin_m=rotation @ (pose.origin_m - CAMERA))


def _vertices(parts: Parts) -> Float:
    return np.concatenate([part.mesh.vertices for part in parts])


def _bounding_box(points: Float) -> Box3D:
    low, high = points.min(axis=0), points.max(axis=0)
    return Box3D(center_m=(low + high) / 2, half_size_m=(high - low) / 2, left_from_box=np.eye(3))


# The room around the people: a table, a floor, a bare wall, a pleated curtain and a picture


def _room(scenario: Scenario) -> dict[str, Parts]:
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
