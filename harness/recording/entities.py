"""Every entity path of a recording. Names from manifests are escaped: spaces, slashes and any letter are allowed.

Only :class:`harness.recording.frame_log.FrameLog` and the blueprint use these; a reader of recordings may too.
"""

from __future__ import annotations

import rerun as rr

from vfoa.types import Cue

WORLD = "/world"
CAMERA = "/world/camera/left"
IMAGE = f"{CAMERA}/image"
MASKS = f"{CAMERA}/instances"
DEPTH = f"{CAMERA}/depth"
TARGETS_2D = f"{CAMERA}/targets"
HEADS_2D = f"{CAMERA}/heads"

INSTANCES = f"{WORLD}/instances"
SUBJECTS = f"{WORLD}/subjects"

# Outside the camera: under a pin-hole, a disparity would be drawn as false geometry.
STEREO = "/stereo"
RIGHT = f"{STEREO}/right"
DISPARITY = f"{STEREO}/disparity"
CONFIDENCE = f"{STEREO}/confidence"

ATTENTION = "/attention"
VERDICT = "/verdict"
SUMMARY = "/summary"
GUIDE = "/guide"
LOG = "/log"


def _join(*parts: str) -> str:
    root, *names = parts
    return f"{root}/" + "/".join(rr.escape_entity_path_part(name) for name in names)


def points(instance_id: int) -> str:
    """The cloud of one instance."""
    return f"{INSTANCES}/{instance_id}/points"


def box(instance_id: int) -> str:
    """The 3D box of one instance."""
    return f"{INSTANCES}/{instance_id}/box"


def head_box(subject: str) -> str:
    """The box of a subject's head in the left image."""
    return _join(HEADS_2D, subject, "box2d")


def subject_3d(subject: str, *parts: str) -> str:
    """Something of a subject in the world: ``origin``, ``truth``, ``focus``."""
    return _join(SUBJECTS, subject, *parts)


def cue_3d(subject: str, cue: Cue, part: str) -> str:
    """A cue of a subject in the world: ``direction``, ``cones``, ``rays``, ``hits``."""
    return _join(SUBJECTS, subject, cue, part)


def curves(subject: str, value: str) -> str:
    """Above the curves of one subject's ``gaze``, ``head`` or ``total``: one plot."""
    return _join(ATTENTION, subject, value)


def curve(subject: str, value: str, target: str) -> str:
    """One attention curve: ``gaze``, ``head`` or ``total`` of a subject for a target."""
    return _join(ATTENTION, subject, value, target)


def verdict(subject: str, *parts: str) -> str:
    """The verdict on a subject over time; below it ``truth`` and ``predicted``."""
    return _join(VERDICT, subject, *parts)
