"""Further entities in a recording, one file and one registry line each.

An entity is a function that logs something of a frame. Another distribution adds one through the entry-point group
``vfoa.entities``. Where it logs decides where the layout shows it: below :data:`harness.record.entities.WORLD` in the
3D view, below ``CAMERA`` also in the left image, below ``ATTENTION`` in the plots.
"""

from __future__ import annotations

from typing import Protocol

from harness.record import Size
from harness.record.frame_log import FrameLog
from harness.run.frame_sink import FinishedFrame
from vfoa.registry import Registry


class Entity(Protocol):
    """Logs something of each frame, after all that the recorder itself logs."""

    def __call__(self, log: FrameLog, frame: FinishedFrame, size: Size) -> None:
        """Log one frame by ``log.log``, ``log.number`` or ``log.keep``; what is not logged again is cleared."""
        ...


ENTITIES = Registry(kind="recording entity", builtin={}, group="vfoa.entities")


def load_entities() -> tuple[Entity, ...]:
    """Every further entity, by the order of their names."""
    return tuple(ENTITIES.load(name) for name in ENTITIES.names())
