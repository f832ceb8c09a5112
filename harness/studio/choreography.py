"""Poses of all people and objects at each frame: fixations, saccades, and heads that follow.

A gaze shift begins with a saccade of three frames along a great circle. The head follows over nine frames, with the
smooth bell-shaped speed of a minimum-jerk movement (Flash and Hogan 1985), while the eyes hold the target; if the eyes
move on sooner, the head turns round on its way. Fixations last from 0.5 to 3 s, mostly under one, scaled by the
scenario's mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.studio.mesh import Surface
from harness.studio.people import (
    EYE_CENTERS_HEAD,
    EYE_ORIGIN_HEAD,
    FACE_CENTER_HEAD,
    NECK_BODY,
    room_from_look,
)
from harness.studio.scenario import MEAN_FIXATION_S, Actor, Point, Scenario, ScriptedLook, Thing
from harness.studio.things import BALL_RADIUS_M
from vfoa.geometry import angle_between, unit
from vfoa.types import Float

FACE_RADII_M: Float = np.array([0.06, 0.02, 0.08])
"""Distance from the middle of a face within which a gaze rests on it, body frame: eyes, nose and mouth."""

POINT_RADIUS_M = 0.012
"""Distance from a point in the room within which a gaze rests on it, along each axis."""

SACCADE_FRAMES = 3
HEAD_TURN_FRAMES = 9
SHORTEST_FIXATION_S, LONGEST_FIXATION_S, MEAN_EXCESS_S = 0.5, 3.0, 0.18
"""Durations at the usual mean, seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """The pose of a body: rotation (3, 3) and origin (3,), metres, in the room or (from the stage) the camera frame."""

    frame_from_body: Float
    origin_m: Float

    def apply(self, points_body: Float) -> Float:
        """Transform points (..., 3) of the body to the frame of the pose."""
        return points_body @ self.frame_from_body.T + self.origin_m


@dataclass(frozen=True, slots=True, kw_only=True)
class ActorPose:
    """A person at one frame, in the room. ``target`` is a name, ``none``, or None during a saccade."""

    body: Pose
    head: Pose
    eyes: tuple[Pose, Pose]
    eye_origin: Float
    gaze: Float
    target: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Fixation:
    """A fixation: its first frame, counted from 0 and saccade included, and its target.

    ``place`` are three numbers in [0, 1) that decide where on the target the gaze rests.
    """

    first: int
    look: ScriptedLook
    place: Float


class Choreography:
    """The movements of a scenario: every frame is computed independently, from the seed alone."""

    def __init__(self, scenario: Scenario, frames: int, seed: int, surfaces: dict[str, Surface]) -> None:
        """Prepare the movements; ``surfaces`` are those of the things, each in its own frame."""
        self._rate_hz = scenario.rate_hz
        self._pace = scenario.mean_fixation_s / MEAN_FIXATION_S
        self._things = {thing.name: thing for thing in scenario.things}
        self._actors = {actor.name: actor for actor in scenario.actors}
        self._surfaces = surfaces
        self._fixations = {actor.name: self._schedule(actor, frames, seed) for actor in scenario.actors}

    def _schedule(self, actor: Actor, frames: int, seed: int) -> tuple[Fixation, ...]:
        rng = np.random.default_rng([seed, actor.id])
        fixations: list[Fixation] = []
        first = 0
        while first < frames:
            look = actor.script[len(fixations) % len(actor.script)]
            fixations.append(Fixation(first=first, look=look, place=rng.random(3)))
            usual_s = min(SHORTEST_FIXATION_S + rng.exponential(MEAN_EXCESS_S), LONGEST_FIXATION_S)
            still = int(np.ceil(usual_s * self._pace * self._rate_hz))
            first += still + (SACCADE_FRAMES if len(fixations) > 1 else 0)
        return tuple(fixations)

    def thing(self, thing: Thing, frame: int) -> Pose:
        """Return the pose of a thing; a rolling ball turns as it moves."""
        heading = np.radians(thing.heading_deg)
        turn = np.array([[np.cos(heading), -np.sin(heading), 0], [np.sin(heading), np.cos(heading), 0], [0, 0, 1]])
        origin = np.array(thing.at)
        if thing.roll is None:
            return Pose(frame_from_body=turn, origin_m=origin)
        shift = np.append(thing.roll.reach_m, 0) * np.sin(2 * np.pi * frame / self._rate_hz / thing.roll.period_s)
        # It rolls on the table without slip: angle = path / radius.
        axis = unit(np.cross([0.0, 0.0, 1.0], np.append(thing.roll.reach_m, 0)))
        angle = shift @ unit(np.append(thing.roll.reach_m, 0)) / BALL_RADIUS_M
        return Pose(frame_from_body=_rotation(axis, angle) @ turn, origin_m=origin + shift)

    def actor(self, actor: Actor, frame: int) -> ActorPose:
        """Return the pose of a person: body, head and gaze."""
        fixations = self._fixations[actor.name]
        now = max(k for k, fixation in enumerate(fixations) if fixation.first <= frame)
        current, before = fixations[now], fixations[max(now - 1, 0)]
        since = frame - current.first
        body = self._body(actor, frame)
        head = self._head(actor, body, now, frame)
        eye_origin = head.apply(EYE_ORIGIN_HEAD)
        gaze = unit(self._aim(current, frame) - eye_origin)
        target: str | None = current.look.at if isinstance(current.look.at, str) else "none"
        if now and since < SACCADE_FRAMES:
            start = unit(self._aim(before, frame) - eye_origin)
            gaze, target = slerp(start, gaze, _minimum_jerk((since + 1) / (SACCADE_FRAMES + 1))), None
        look = room_from_look(gaze)
        right, left = (Pose(frame_from_body=look, origin_m=center) for center in head.apply(EYE_CENTERS_HEAD))
        return ActorPose(body=body, head=head, eyes=(right, left), eye_origin=eye_origin, gaze=gaze, target=target)

    def _body(self, actor: Actor, frame: int) -> Pose:
        """Pose of the body, which sways by a few millimetres."""
        heading = np.radians(actor.heading_deg)
        facing = np.array([-np.sin(heading), np.cos(heading), 0.0])
        phase = 2 * np.pi * (frame / self._rate_hz / 3.7 + 0.37 * actor.id)
        sway = 0.005 * np.array([np.sin(phase), 0.6 * np.cos(1.3 * phase), 0.0])
        return Pose(frame_from_body=room_from_look(facing), origin_m=np.array(actor.at) + sway)

    def _head(self, actor: Actor, body: Pose, now: int, frame: int) -> Pose:
        since = frame - self._fixations[actor.name][now].first
        direction = self._head_direction(actor, body, now, since, frame)
        return Pose(frame_from_body=room_from_look(direction), origin_m=body.apply(NECK_BODY))

    def _head_direction(self, actor: Actor, body: Pose, now: int, since: int, frame: int) -> Float:
        """Direction of the head ``since`` frames into a fixation, with body and things as they are at ``frame``."""
        current, before = (self._fixations[actor.name][k] for k in (now, max(now - 1, 0)))
        lasted = current.first - before.first
        if 0 < lasted < HEAD_TURN_FRAMES:
            old = self._head_direction(actor, body, now - 1, lasted - 1, frame)
        else:
            old = self._head_goal(actor, body, before, frame)
        new = self._head_goal(actor, body, current, frame)
        return slerp(old, new, _minimum_jerk(min(1.0, (since + 1) / HEAD_TURN_FRAMES)))

    def _head_goal(self, actor: Actor, body: Pose, fixation: Fixation, frame: int) -> Float:
        """Final direction of the head in a fixation: towards ``head_at``, or a share of the way to the gaze's aim."""
        eyes = body.apply(NECK_BODY) + body.frame_from_body @ FACE_CENTER_HEAD
        if fixation.look.head_at is not None:
            return unit(self._point(fixation.look.head_at, fixation.place, frame) - eyes)
        return slerp(body.frame_from_body[:, 1], unit(self._aim(fixation, frame) - eyes), actor.head_share)

    def _aim(self, fixation: Fixation, frame: int) -> Float:
        return self._point(fixation.look.at, fixation.place, frame)

    def _point(self, at: str | Point, place: Float, frame: int) -> Float:
        """A point (3,) in the room on the surface of a thing, on the face of a head at rest, or about a point."""
        if not isinstance(at, str):
            return np.array(at) + POINT_RADIUS_M * (2 * place - 1)
        if at in self._things:
            return self.thing(self._things[at], frame).apply(self._surfaces[at].point(place))
        body = self._body(self._actors[at], frame)
        return body.apply(NECK_BODY + FACE_CENTER_HEAD + FACE_RADII_M * _in_ball(place))


def slerp(start: Float, end: Float, share: float) -> Float:
    """The direction (3,) at a share of the way along the great circle from one unit direction to another."""
    angle = float(angle_between(start, end))
    if angle < 1e-9:
        return end
    return (np.sin((1 - share) * angle) * start + np.sin(share * angle) * end) / np.sin(angle)


def _in_ball(shares: Float) -> Float:
    """A point (3,) in the unit ball, uniform over its volume, for three numbers in [0, 1)."""
    up, turn = 2 * shares[0] - 1, 2 * np.pi * shares[1]
    aside = np.sqrt(1 - up**2)
    point: Float = np.cbrt(shares[2]) * np.array([aside * np.cos(turn), aside * np.sin(turn), up])
    return point


def _minimum_jerk(share: float) -> float:
    return share**3 * (10 - 15 * share + 6 * share**2)


def _rotation(axis: Float, angle_rad: float) -> Float:
    """Rodrigues' formula: the rotation (3, 3) about a unit axis (3,)."""
    cross = np.cross(np.eye(3), axis)
    return np.eye(3) + np.sin(angle_rad) * cross + (1 - np.cos(angle_rad)) * cross @ cross
