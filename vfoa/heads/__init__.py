"""Head detection: the boxes of the heads in the left view."""

from __future__ import annotations

from typing import Protocol

from vfoa.registry import Registry
from vfoa.types import Head, Instances, StereoFrame


class HeadDetector(Protocol):
    """Finds heads. Built as ``Class(settings)``, with ``Class.Settings``.

    ``Class.finds_faces = False`` says that no head has a face; without it, heads may have one.
    """

    def detect(self, frame: StereoFrame, instances: Instances) -> tuple[Head, ...]:
        """Return the heads of one frame, best first. ``instances`` holds the masks of the people."""
        ...


class FaceDetector(HeadDetector, Protocol):
    """Finds most heads without the masks, so that it can work while the frame is segmented; ``detect`` does both."""

    def faces(self, frame: StereoFrame) -> tuple[Head, ...]:
        """Return the heads that need no masks, best first."""
        ...

    def with_people(self, faces: tuple[Head, ...], frame: StereoFrame, instances: Instances) -> tuple[Head, ...]:
        """Return these heads, and those that only the masks of people show, as ``detect`` does."""
        ...


DETECTORS = Registry(
    kind="heads.detector",
    builtin={
        "yunet": "vfoa.heads.yunet:YuNet",
        "person_mask": "vfoa.heads.person_mask:PersonMask",
    },
    group="vfoa.heads",
)
