"""Sources of stereo frames: one file per kind, one protocol for all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from vfoa.registry import Registry
from vfoa.types import Box3D, Disparity, Float, Instances, StereoFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class PersonTruth:
    """What is true of one person in one frame (camera frame, metres, unit directions). None: not known.

    ``target`` is the name of what the person looks at, ``"none"`` for nothing in the scene.
    """

    name: str
    instance_id: int
    head_box_px: Float
    eye_origin_left: Float | None = None
    head_direction: Float | None = None
    gaze_direction: Float | None = None
    target: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """What a source knows to be true of one frame. None: the source does not know it.

    ``boxes`` are keyed by instance id.
    """

    disparity: Disparity | None = None
    instances: Instances | None = None
    boxes: dict[int, Box3D] | None = None
    people: tuple[PersonTruth, ...] | None = None


class Clip(Protocol):
    """A sequence of rectified stereo frames. Built as ``Class(settings, root)``, with ``Class.Settings``.

    ``root`` is the manifest's resolved ``root`` (None where it has none). Frames are read on demand and in any
    order; a clip holds no frames in memory and can be pickled to another process.
    """

    @property
    def frames(self) -> Sequence[int]:
        """The source's own frame numbers, ascending; gaps are allowed."""
        ...

    @property
    def rate_hz(self) -> float | None:
        """Frames per second, None where the source does not know it."""
        ...

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader of the table must know of this source (a view that was made, frames that were dropped)."""
        ...

    def frame(self, number: int) -> StereoFrame:
        """Read one stereo pair.

        Raises
        ------
        vfoa.errors.VfoaError
            If it cannot be read: the message names the file.
        """
        ...

    def truth(self, number: int) -> Truth:
        """What is known to be true of one frame. Read by scoring, and by stages configured as ``truth``."""
        ...

    def digest(self) -> str:
        """Hexadecimal sha256 of all that :meth:`frame` depends on: files' content or settings, not their paths."""
        ...


ADAPTERS = Registry(
    kind="adapter",
    builtin={
        "mcap": "harness.adapters.mcap.clip:McapClip",
        "sintel": "harness.adapters.sintel:SintelClip",
        "stereo_folder": "harness.adapters.stereo_folder:StereoFolderClip",
        "studio": "harness.adapters.studio:StudioClip",
    },
    group="vfoa.adapters",
)
