"""The gaze of ADAS-0002 on pictures of faces by the turn of the head: ``python -m harness.bench.faces PICTURE...``.

Every picture is read at three sizes. The mirror error is the angle between the gaze in a picture and the mirrored gaze
in the mirrored picture; it needs no labels. "Before" takes every gaze and the published error of 11.1 degrees, "after"
the gazes that the model gives and its claims. "To camera" means something for people who look into the camera only.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from harness.report.formats import UNKNOWN, Table, to_markdown
from vfoa.gaze.adas import Adas0002
from vfoa.geometry import angle_between
from vfoa.head_pose.fsanet import FsaNet
from vfoa.heads.yunet import YuNet
from vfoa.posterior.settings import MEAN_ANGLE_PER_SIGMA
from vfoa.types import Float, Gaze, Head, Image, Instances, StereoFrame, StereoRig

SCALES = (1.0, 0.5, 0.3)
TURNS_DEG = (0.0, 10.0, 20.0, 40.0, 180.0)
COLUMNS = ("head turned", "n", "mirror before", "to camera before", "given after", "mirror after", "claimed after")


def measure_faces(pictures: Sequence[Image]) -> Table:
    """Medians in degrees by the angle of the head from the camera; pictures are (h, w, 3) uint8 RGB."""
    detector, pose = YuNet(YuNet.Settings()), FsaNet(FsaNet.Settings())
    given, every = Adas0002(Adas0002.Settings()), Adas0002(Adas0002.Settings(most_turned_deg=180))
    rows = []
    for picture in pictures:
        for scale in SCALES:
            frame = _frame(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
            nobody = Instances(ids=np.zeros(frame.left.shape[:2], np.uint16), instances=())
            for head in detector.detect(frame, nobody):
                measured = _measured(frame, head, (pose, given, every))
                if measured is not None:
                    rows.append(measured)
    return _table(np.array(rows).reshape(-1, 4))


def _measured(
    frame: StereoFrame, head: Head, models: tuple[FsaNet, Adas0002, Adas0002]
) -> tuple[float, float, float, float] | None:
    """Degrees: turn of the head, mirror error, angle to the camera, claimed error (NaN without a gaze)."""
    pose, given, every = models
    mirror = replace(frame, left=np.ascontiguousarray(frame.left[:, ::-1]))
    direction = pose.estimate(frame, head)
    there = _mirrored(head, frame.rig.width_px)
    gaze, seen = every.estimate(frame, head, direction), every.estimate(mirror, there, pose.estimate(mirror, there))
    if direction is None or not isinstance(gaze, Gaze) or not isinstance(seen, Gaze) or head.face_box_px is None:
        return None
    u, v = (head.face_box_px[:2] + head.face_box_px[2:]) / 2
    rig = frame.rig
    camera = -np.array([(u - rig.cx_px) / rig.fx_px, (v - rig.cy_px) / rig.fy_px, 1.0])
    kept = given.estimate(frame, head, direction)
    claimed = MEAN_ANGLE_PER_SIGMA * kept.sigma_rad if isinstance(kept, Gaze) and kept.sigma_rad else float("nan")
    angles = (
        angle_between(direction.direction, camera),
        angle_between(gaze.direction, seen.direction * [-1, 1, 1]),
        angle_between(gaze.direction, camera),
        claimed,
    )
    turned, error, to_camera, claim = (float(np.degrees(angle)) for angle in angles)
    return turned, error, to_camera, claim


def _mirrored(head: Head, width_px: int) -> Head:
    """The head in the mirrored picture; the person's own right eye is then what was the left one."""
    assert head.face_box_px is not None
    assert head.landmarks_px is not None
    boxes = [np.array([width_px - 1 - b[2], b[1], width_px - 1 - b[0], b[3]]) for b in (head.box_px, head.face_box_px)]
    points = head.landmarks_px[[1, 0, 2, 4, 3]] * [-1, 1] + [width_px - 1, 0]
    return replace(head, box_px=boxes[0], face_box_px=boxes[1], landmarks_px=points)


def _frame(picture: Image) -> StereoFrame:
    """A frame of a camera with a field of 53 degrees and the principal point in the middle of the picture."""
    height, width = picture.shape[:2]
    cx, cy = (width - 1) / 2, (height - 1) / 2
    rig = StereoRig(
        width_px=width, height_px=height, fx_px=width, fy_px=width, cx_px=cx, cy_px=cy, baseline_m=0.1, cx_right_px=cx
    )
    return StereoFrame(index=0, time_ns=0, left=picture, right=picture, rig=rig)


def _table(looks: Float) -> Table:
    rows = []
    for low, high in pairwise(TURNS_DEG):
        held = looks[(looks[:, 0] >= low) & (looks[:, 0] < high)]
        kept = held[~np.isnan(held[:, 3])]
        before, after = _medians(held), _medians(kept)
        rows.append(
            (f"{low:g} to {high:g}", str(len(held)), *before[1:3], f"{len(kept)} of {len(held)}", after[1], after[3])
        )
    return Table(
        title="Gaze of faces by the turn of the head, degrees (medians)", columns=COLUMNS, words=1, rows=tuple(rows)
    )


def _medians(looks: Float) -> list[str]:
    return [f"{value:.1f}" for value in np.median(looks, axis=0)] if len(looks) else [UNKNOWN] * 4


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pictures", nargs="+", type=Path, help="picture files")
    read = [cv2.imread(str(path), cv2.IMREAD_COLOR) for path in parser.parse_args().pictures]
    pictures = [np.ascontiguousarray(picture[..., ::-1]) for picture in read if picture is not None]
    sys.stdout.write(to_markdown(measure_faces(pictures)))
