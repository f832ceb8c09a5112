"""Head pose: the direction in which a head points."""

from __future__ import annotations

from typing import Protocol

from vfoa.registry import Registry
from vfoa.types import Head, HeadPose, StereoFrame


class HeadPoseModel(Protocol):
    """Estimates the pose of a head from its image. Built as ``Class(settings)``, with ``Class.Settings``.

    ``Class.needs_face = True`` says that it has no answer for a head without a face.
    """

    def estimate(self, frame: StereoFrame, head: Head) -> HeadPose | None:
        """Return one head's pose in the camera frame; None if the model has no answer."""
        ...


MODELS = Registry(
    kind="head_pose.model",
    builtin={
        "fsanet": "vfoa.head_pose.fsanet:FsaNet",
        "3ddfa_v2": "vfoa.head_pose.tddfa_v2:TddfaV2",
        "6drepnet": "vfoa.head_pose.sixdrepnet:SixDRepNet",
    },
    group="vfoa.head_pose",
)
