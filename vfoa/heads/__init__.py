"""Head detection: the boxes of the heads in the left view."""

from __future__ import annotations

from typing import Protocol

from vfoa.registry import Registry
from vfoa.types import Head, Instances, StereoFrame


class HeadDetector(Protocol):
    """Finds heads. Built as ``Class(settings)``, with ``Class.Settings``."""

    def detect(self, frame: StereoFrame, instances: Instances) -> tuple[Head, ...]:
        """Detect the heads of one frame, best first. ``instances`` holds the masks of the people."""
        ...


DETECTORS = Registry(
    kind="heads.detector",
    builtin={
        "yunet": "vfoa.heads.yunet:YuNet",
        "person_mask": "vfoa.heads.person_mask:PersonMask",
    },
    group="vfoa.heads",
)
