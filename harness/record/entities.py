"""Every entity path of a recording. A path names the layer that it belongs to (:mod:`harness.record.layers`).

Names from manifests are escaped: spaces, slashes and any letter are allowed.

Further entities have one file and one registry line each: a function that logs something of a frame. Another
distribution adds one through the entry-point group ``vfoa.entities``. Where it logs decides where the layout shows it:
below :data:`WORLD` in the 3D view, below :data:`CAMERA` also in the left image, below :data:`ATTENTION` in the plots.
"""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Protocol

import rerun as rr

from harness.record.frame_log import FrameLog
from vfoa.registry import Registry

if TYPE_CHECKING:
    from harness.run.frame_sink import FinishedFrame

WORLD = "/world"
CAMERA = f"{WORLD}/camera/left"
IMAGE = f"{CAMERA}/image"
MASKS = f"{CAMERA}/masks"
MEASURED_DEPTH = f"{CAMERA}/measured_depth"
ATTENTION_2D = f"{CAMERA}/attention"

RECONSTRUCTION = f"{WORLD}/reconstruction"
ATTENTION_3D = f"{WORLD}/attention"
VERDICTS_3D = f"{WORLD}/verdicts"

# Below the camera's pinhole, a disparity would be drawn as false geometry.
STEREO = "/stereo"
RIGHT = f"{STEREO}/right"
DISPARITY = f"{STEREO}/disparity"

ATTENTION = "/attention"
VERDICTS = "/verdicts"
SUMMARY = "/summary"
LOG = "/failures"
GUIDE = "/guide"


def _join(*parts: str) -> str:
    root, *names = parts
    return f"{root}/" + "/".join(rr.escape_entity_path_part(name) for name in names)


# The layer of the images


def masks(segmentation: str) -> str:
    """The masks of a segmentation."""
    return _join(MASKS, segmentation)


# The layer of a reconstruction


def disparity(reconstruction: str) -> str:
    """The disparity, in pixels."""
    return _join(DISPARITY, reconstruction)


def scene(reconstruction: str) -> str:
    """The parent of all clouds and boxes of a reconstruction."""
    return _join(RECONSTRUCTION, reconstruction)


def points(reconstruction: str, instance_id: int) -> str:
    """The cloud of one instance."""
    return f"{scene(reconstruction)}/{instance_id}/points"


def box(reconstruction: str, instance_id: int) -> str:
    """The 3D box of one instance."""
    return f"{scene(reconstruction)}/{instance_id}/box"


# The layer of a configuration


def image_marks(configuration: str, *parts: str) -> str:
    """Marks of a configuration in the left image: ``targets``, and ``heads`` with a subject each."""
    return _join(ATTENTION_2D, configuration, *parts)


def head_box(configuration: str, subject: str) -> str:
    """The box of a subject's head in the left image."""
    return image_marks(configuration, "heads", subject)


def subject_3d(configuration: str, *parts: str) -> str:
    """A subject in the world; without one, the parent of all of them.

    Below it are its eye ``origin`` and, for each cue, ``direction``, ``cones``, ``rays``, ``missed_rays`` and ``hits``.
    """
    return _join(ATTENTION_3D, configuration, *parts)


def curves(configuration: str, subject: str, value: str, *target: str) -> str:
    """One subject's ``gaze``, ``head`` or ``total`` for the manifest's targets and other subjects: one plot.

    With a target, the curve for a name that is not in the manifest.
    """
    return _join(ATTENTION, configuration, subject, value, *target)


def is_total(curve: str) -> bool:
    """Whether the path of a curve is that of a total, not of the part of a cue."""
    return re.split(r"(?<!\\)/", curve)[4:5] == ["total"]


# The layer of the verdicts


def verdict(configuration: str, *parts: str) -> str:
    """States of a subject over time: ``truth``, ``predicted``, ``verdict``, ``error_type``; else, their parent."""
    return _join(VERDICTS, configuration, *parts)


def answer_3d(configuration: str, *parts: str) -> str:
    """The true target of a subject (``truth``) and the wrong answer (``predicted``); without these, their parent."""
    return _join(VERDICTS_3D, configuration, *parts)


def summary(configuration: str) -> str:
    """The page of the frame: truth, prediction, error type, attention."""
    return _join(SUMMARY, configuration)


def log(configuration: str) -> str:
    """One warning for each wrong frame."""
    return _join(LOG, configuration)


class Entity(Protocol):
    """Logs data of each frame, after the recorder's own data."""

    def __call__(self, log: FrameLog, frame: FinishedFrame) -> None:
        """Log one frame by ``log.row``, ``number`` or ``keep``; entities not logged again are cleared."""
        ...


ENTITIES = Registry(kind="recording entity", builtin={}, group="vfoa.entities")


def load_entities() -> tuple[Entity, ...]:
    """Load every further entity, in the order of their names."""
    return tuple(ENTITIES.load(name) for name in ENTITIES.names())
