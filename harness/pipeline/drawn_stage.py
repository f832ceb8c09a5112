"""The shapes drawn on a clip, for the pipeline; and the stages that use only drawn shapes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from harness.clips.manifest import ClipManifest
from harness.labels.drawn_shapes import Drawn, Kind, format_drawn
from harness.pipeline.configuration import DRAWN, Configuration
from harness.sources import Clip
from vfoa.coco import category_ids
from vfoa.drawn import DrawnSettings, DrawnShape, DrawnShapes
from vfoa.errors import VfoaError, counted
from vfoa.settings import Settings
from vfoa.types import Head, Instances, StereoFrame


class NothingToSet(Settings):
    """There are no settings here: those of drawn shapes are in the table ``drawn``."""


class DrawnMasks:
    """A segmenter without masks of its own: uses only those drawn on the clip (``annotations/CLIP.drawn.csv``)."""

    Settings = NothingToSet

    def __init__(self, settings: NothingToSet, clip: Clip) -> None:
        """Nothing is read here: the drawn shapes come with the job."""

    def segment(self, frame: StereoFrame) -> Instances:
        """Return no instances."""
        return Instances(ids=np.zeros(frame.left.shape[:2], np.uint16), instances=())


class DrawnHeads:
    """A head detector without heads of its own: uses only those drawn on the clip (``annotations/CLIP.drawn.csv``)."""

    Settings = NothingToSet
    finds_faces = False

    def __init__(self, settings: NothingToSet, clip: Clip) -> None:
        """Nothing is read here: the drawn shapes come with the job."""

    def detect(self, frame: StereoFrame, instances: Instances) -> tuple[Head, ...]:
        """Return no heads."""
        return ()


@dataclass(frozen=True, kw_only=True)
class DrawnClip:
    """The shapes drawn on a clip, with the category of each name. It is pickled to other processes."""

    drawn: Drawn
    categories: Mapping[str, str]

    @classmethod
    def of(cls, manifest: ClipManifest, drawn: Drawn) -> DrawnClip:
        """Combine the drawn shapes with the categories of the manifest's rules."""
        rules = {**manifest.subjects, **manifest.targets}
        return cls(drawn=drawn, categories={name: rules[name].category for name in drawn.names})

    @property
    def digest(self) -> str:
        """Hexadecimal sha256 of everything that results depend on."""
        categories = "".join(f"{name}\0{label}\n" for name, label in self.categories.items())
        return hashlib.sha256(f"{format_drawn(self.drawn)}\0{categories}".encode()).hexdigest()

    @property
    def summary(self) -> str:
        """What is drawn, and the number of key frames, in words."""
        keys = counted(sum(len(track.keys) for track in self.drawn.tracks), "key frame")
        return f"drawn by hand: {', '.join(self.drawn.names)} ({keys})."

    def shapes(self, settings: DrawnSettings) -> DrawnShapes:
        """Return the shapes for the pipeline."""
        return DrawnShapes(settings, self._at)

    def _at(self, frame: int) -> list[DrawnShape]:
        return [
            DrawnShape(
                name=track.name,
                label=self.categories[track.name],
                category_id=self._category_ids[self.categories[track.name]],
                kind=track.kind,
                box_px=(place[0], place[1], place[-2], place[-1]),
            )
            for track, place in self.drawn.at(frame)
        ]

    @property
    def _category_ids(self) -> dict[str, int]:
        return category_ids(self.categories.values())


def check_drawn(name: str, drawn: Drawn | None, configuration: Configuration) -> None:
    """Reject a configuration with a ``"drawn"`` stage on a clip without such drawn shapes.

    Raises
    ------
    VfoaError
        With what is missing, and how to draw it.
    """
    kinds: set[Kind] = {track.kind for track in drawn.tracks} if drawn else set()
    for slot, needed, what in (("segmentation", {"box", "point"}, "targets"), ("heads", {"head"}, "heads")):
        choice = configuration.choices[slot]
        if choice is not None and choice.name == DRAWN and not kinds & needed:
            raise VfoaError(
                f"{name}: {slot} = {DRAWN!r}, and no {what} are drawn on the clip; expected some in "
                f"annotations/{name}.drawn.csv: draw them with vfoa annotate {name}"
            )
