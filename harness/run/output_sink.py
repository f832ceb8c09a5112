"""The sink that saves the output of every stage, in the files that the ``files`` stages read."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from harness.files.io import atomic_write
from harness.run.frame_sink import FinishedFrame, SinkContext
from harness.run.saved_outputs import DISPARITY
from harness.sources.media.frame_files import printf_name
from harness.stages.outputs.coco_panoptic_writer import CocoPanopticWriter
from harness.stages.outputs.directions import write_gazes, write_head_poses
from harness.stages.outputs.heads import write_heads
from vfoa.errors import VfoaError
from vfoa.geometry import depth_from_disparity
from vfoa.types import Gaze, Head, HeadPose, Percepts


class OutputSink:
    """Saves the output of ``slots`` under ``root``; :mod:`harness.run.saved_outputs` lists the files.

    Maps and masks are written frame by frame, the tables at the end. The heads of a frame are numbered 1, 2, ... in
    their order. Every number reads back exactly. Two things that no later stage uses are not saved: a matcher's
    confidence, and instances without a pixel.
    """

    def __init__(self, root: Path, slots: frozenset[str]) -> None:
        self._root, self._slots = root, slots
        self._masks = CocoPanopticWriter(root)
        self._heads: list[tuple[int, str, Head]] = []
        self._head_poses: list[tuple[int, str, HeadPose]] = []
        self._gazes: list[tuple[int, str, Gaze]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            self._finish()

    def write(self, frame: FinishedFrame) -> None:
        """Save one frame's percepts, if it has any."""
        if frame.percepts is not None:
            self.save(frame.percepts)

    def save(self, percepts: Percepts) -> None:
        """Save the percepts of one frame.

        Raises
        ------
        VfoaError
            If a file cannot distinguish a disparity from an unknown one, or a category number has two meanings.
        """
        if "stereo" in self._slots:
            self._save_disparity(percepts)
        if "segmentation" in self._slots:
            self._masks.add(percepts.index, percepts.instances)
        for place, view in enumerate(percepts.views, start=1):
            key = percepts.index, str(place)
            self._heads.append((*key, view.head))
            if view.head_pose is not None:
                self._head_poses.append((*key, view.head_pose))
            if view.gaze is not None:
                self._gazes.append((*key, view.gaze))

    def _save_disparity(self, percepts: Percepts) -> None:
        path = self._root / printf_name(DISPARITY, percepts.index)
        disparity = percepts.disparity.disparity_px
        if (np.isfinite(depth_from_disparity(disparity, percepts.rig)) & (disparity <= 0)).any():
            raise VfoaError(f"{path}: the map has disparities of 0 or less with a depth; expected positive ones")
        content = io.BytesIO()
        np.save(content, disparity)
        atomic_write(path, content.getvalue())

    def _finish(self) -> None:
        if "segmentation" in self._slots:
            self._masks.finish()
        if "heads" in self._slots:
            write_heads(self._root / "heads.csv", self._heads)
        if "head_pose" in self._slots:
            write_head_poses(self._root / "head_pose.csv", self._head_poses)
        if "gaze" in self._slots:
            write_gazes(self._root / "gaze.csv", self._gazes)


@dataclass(frozen=True, slots=True)
class OutputSinks:
    """Opens the stage outputs of each configuration: the stages in ``slots``, by the configuration's name."""

    slots: Mapping[str, frozenset[str]]

    def described(self) -> Mapping[str, Any]:
        """Whether outputs are saved."""
        return {"stage_outputs": True}

    def open(self, context: SinkContext) -> OutputSink | None:
        """Open the outputs that this configuration saves; None if other configurations save all of them."""
        slots = self.slots.get(context.configuration)
        if not slots or context.rehearsal:
            return None
        return OutputSink(context.directory.stage_outputs / context.manifest.name / context.configuration, slots)
