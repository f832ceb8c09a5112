"""Writes the recordings beside it: RealSense's own SDK records a camera that exists in software alone.

    pip install "pyrealsense2<2.57" numpy && python record.py sdk_2.56.bag
    pip install pyrealsense2 numpy && python record.py sdk_2.59.db3

The colour camera stands 15 mm left of the depth camera and looks down by .05 rad. Depth is 1.5 m on the left half of
its image and 1.2 m on the right one, in counts of .25 mm. In frame n gray values are 100 + n (colour) and 60 + n
(infrared).
"""

from __future__ import annotations

import math
import sys
import time

import numpy as np
import pyrealsense2 as rs

DEPTH, COLOUR = (64, 48, 40.0, 31.0, 24.0), (80, 60, 60.0, 40.5, 29.0)
"""Width, height, focal length, centre."""
UNIT_M, TURN_RAD = 0.00025, 0.05
COUNT, STEP_S = 3, 0.1


def _stream(
    number: int, kind: rs.stream, form: rs.format, pixel_bytes: int, lens: tuple, index: int = 0
) -> rs.video_stream:
    width, height, focal, u, v = lens
    intrinsics = rs.intrinsics()
    intrinsics.width, intrinsics.height, intrinsics.fx, intrinsics.fy = width, height, focal, focal
    intrinsics.ppx, intrinsics.ppy, intrinsics.coeffs = u, v, [0.0] * 5
    intrinsics.model = rs.distortion.inverse_brown_conrady
    stream = rs.video_stream()
    stream.uid, stream.type, stream.index, stream.fmt, stream.bpp = number, kind, index, form, pixel_bytes
    stream.width, stream.height, stream.fps, stream.intrinsics = width, height, 30, intrinsics
    return stream


def _pose(turn_rad: float, translation_m: list[float]) -> rs.extrinsics:
    pose, (cos, sin) = rs.extrinsics(), (math.cos(turn_rad), math.sin(turn_rad))
    pose.rotation, pose.translation = [1, 0, 0, 0, cos, sin, 0, -sin, cos], translation_m  # by columns
    return pose


def _depth(number: int) -> np.ndarray:
    width, height, *_ = DEPTH
    counts = np.full((height, width), round(1.5 / UNIT_M), np.uint16)
    counts[:, width // 2 :] = round(1.2 / UNIT_M)
    return counts


def _gray(width: int, height: int, value: int, *channels: int) -> np.ndarray:
    return np.full((height, width, *channels), value, np.uint8)


def main(path: str) -> None:
    """Record to a file, whose suffix must be that of this version of the SDK."""
    device = rs.software_device()
    stereo, rgb = device.add_sensor("Stereo Module"), device.add_sensor("RGB Camera")
    stereo.add_read_only_option(rs.option.depth_units, UNIT_M)
    depth = stereo.add_video_stream(_stream(1, rs.stream.depth, rs.format.z16, 2, DEPTH))
    infrared = [stereo.add_video_stream(_stream(2 + n, rs.stream.infrared, rs.format.y8, 1, DEPTH, n)) for n in (1, 2)]
    colour = rgb.add_video_stream(_stream(2, rs.stream.color, rs.format.rgb8, 3, COLOUR))
    depth.register_extrinsics_to(colour, _pose(TURN_RAD, [0.015, 0.0, 0.0]))
    for other, translation_m in zip(infrared, ([0.0, 0.0, 0.0], [-0.05, 0.0, 0.0]), strict=True):
        depth.register_extrinsics_to(other, _pose(0.0, translation_m))
    recorder = rs.recorder(path, device)
    sensors, queue = recorder.query_sensors(), rs.frame_queue(50)
    for sensor in sensors:
        sensor.open(sensor.get_stream_profiles())
        sensor.start(queue)
    for number in range(1, COUNT + 1):
        for sensor, profile, pixels in (
            (stereo, depth, _depth(number)),
            *((stereo, each, _gray(*DEPTH[:2], 60 + number)) for each in infrared),
            (rgb, colour, _gray(*COLOUR[:2], 100 + number, 3)),
        ):
            frame = rs.software_video_frame()
            frame.pixels, frame.bpp, frame.stride = pixels, pixels.strides[1], pixels.strides[0]
            frame.timestamp, frame.domain = 1e6 + 1000 * STEP_S * number, rs.timestamp_domain.hardware_clock
            frame.frame_number, frame.profile = number, profile.as_video_stream_profile()
            sensor.on_video_frame(frame)
        time.sleep(STEP_S)
    for sensor in sensors:
        sensor.stop()
        sensor.close()
    del recorder
    time.sleep(1)


if __name__ == "__main__":
    main(sys.argv[1])
