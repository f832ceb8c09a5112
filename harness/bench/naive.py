"""A naive first version: every pixel of the frame becomes a point, and every entity is a separate call to Rerun."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import rerun as rr

from vfoa.types import Disparity, FrameResult, Instances, Map, Percepts, StereoFrame, StereoRig


def naive_clouds(disparity: Disparity, instances: Instances, rig: StereoRig) -> dict[int, Map]:
    """The cloud (N, 3) of each object by its id: the whole frame by OpenCV's matrix Q, then mask by mask."""
    q = np.array(
        [
            [1, 0, 0, -rig.cx_px],
            [0, 1, 0, -rig.cy_px],
            [0, 0, 0, rig.fx_px],
            [0, 0, 1 / rig.baseline_m, (rig.cx_right_px - rig.cx_px) / rig.baseline_m],
        ]
    )
    points = cv2.reprojectImageTo3D(disparity.disparity_px, q)
    known = np.isfinite(points).all(axis=2)
    return {each.id: points[instances.mask(each.id) & known] for each in instances.instances if each.is_thing}


class NaiveRecording:
    """Raw images, clouds with a colour per point, and lists of one entity each."""

    def __init__(self, path: Path) -> None:
        self._stream = rr.RecordingStream("vfoa_naive")
        self._stream.save(path)

    def log(self, frame: StereoFrame, percepts: Percepts, result: FrameResult) -> None:
        """Write the data of a frame that the recordings of a run show."""
        log: Any = self._stream.log
        self._stream.set_time("frame", sequence=frame.index)
        log("left", rr.Image(frame.left))
        if frame.right is not None:
            log("right", rr.Image(frame.right))
        log("disparity", rr.DepthImage(percepts.disparity.disparity_px))
        log("instances", rr.SegmentationImage(percepts.instances.ids))
        for target in result.scene.targets:
            name = f"things/{target.instance.id}"
            colours = [[200, 200, 40] for _ in target.points_left]
            log(f"{name}/points", rr.Points3D(target.points_left.tolist(), colors=colours))
            if target.box is not None:
                log(
                    f"{name}/box",
                    rr.Boxes3D(centers=[target.box.center_m.tolist()], half_sizes=[target.box.half_size_m.tolist()]),
                )
        for attention in result.attentions:
            name = f"subjects/{attention.subject.track_id}"
            if attention.rays is not None:
                origin = attention.rays.origin_left
                for number, direction in enumerate(attention.rays.directions):
                    strip = [origin.tolist(), (origin + 3 * direction).tolist()]
                    log(f"{name}/rays/{number}", rr.LineStrips3D([strip]))
            for value in attention.values:
                for cue in ("gaze", "head", "total"):
                    log(f"{name}/{value.instance_id}/{cue}", rr.Scalars(getattr(value, cue)))

    def close(self) -> None:
        """Flush the recording."""
        self._stream.flush()
        self._stream.disconnect()
