"""Cones as lines, for whoever draws them."""

from __future__ import annotations

import math

import numpy as np

from vfoa.geometry import CONE_HEIGHT_M, left_from_crop
from vfoa.types import Attention, Cone, Float, Scene

RIM = 32
_RIBS = 4


def reach_m(attention: Attention, scene: Scene) -> float:
    """How far a subject's cones and missing rays are drawn: to the middling target; without one, the paper's height."""
    eyes = attention.subject.person.eye_origin_left
    attended = {value.instance_id for value in attention.values}
    boxes = [target.box for target in scene.targets if target.instance.id in attended and target.box is not None]
    if eyes is None or not boxes:
        return CONE_HEIGHT_M
    return float(np.median([np.linalg.norm(box.center_m - eyes) for box in boxes]))


def cone_wire(cone: Cone, reach_m: float, *, rim: int = RIM) -> Float:
    """A cone as one line (N, 3) in the camera frame, metres: four ribs of length ``reach_m``, then the rim they end on.

    One line, because Rerun takes an array of lines ten times faster than a list of lines of several lengths. ``rim`` is
    the number of points on it, a multiple of four.
    """
    half = cone.fov_rad / 2
    turn = np.linspace(0, 2 * math.pi, rim + 1)
    local = np.stack([math.sin(half) * np.cos(turn), math.sin(half) * np.sin(turn), np.full_like(turn, math.cos(half))])
    ring = cone.apex_left + reach_m * (left_from_crop(cone.axis) @ local).T
    ends = ring[: -1 : rim // _RIBS]
    ribs = np.stack([ends, np.broadcast_to(cone.apex_left, ends.shape)], axis=1).reshape(-1, 3)
    return np.concatenate([ribs, ring])
