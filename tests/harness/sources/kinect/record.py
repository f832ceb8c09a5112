"""Writes the recording beside it by Azure Kinect's own recorder, without a camera.

    pip install pyk4a-bundle "numpy<2" pillow && python record.py recording.mkv && xz -9 recording.mkv

``calibration.json`` is that of a unit, as somebody published it (its serial number is gone). Depth is 1.5 m on the left
half of its image and 1.2 m on the right one. In frame n colour is (40 n, 90, 160), with a white square.
"""

from __future__ import annotations

import ctypes
import io
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pyk4a
from PIL import Image

COUNT, STEP_US = 3, 66_667
COLOUR, DEPTH = (1280, 720), (320, 288)
MJPG, DEPTH16 = 0, 4
_Handle = ctypes.c_void_p


class Configuration(ctypes.Structure):
    """``k4a_device_configuration_t``: MJPEG of 720 rows, depth NFOV 2x2 binned, 15 Hz."""

    _fields_ = (
        *((name, ctypes.c_int) for name in ("color_format", "color_resolution", "depth_mode", "camera_fps")),
        *(("synchronized_images_only", ctypes.c_bool), ("depth_delay_off_color_usec", ctypes.c_int32)),
        *(("wired_sync_mode", ctypes.c_int), ("subordinate_delay_off_master_usec", ctypes.c_uint32)),
        ("disable_streaming_indicator", ctypes.c_bool),
    )


def _libraries() -> tuple[Any, Any]:
    folder = Path(pyk4a.__file__).parent.parent / "pyk4a_bundle.libs"
    (sensor,), (recorder,) = folder.glob("libk4a-*"), folder.glob("libk4arecord-*")
    sensor, recorder = ctypes.CDLL(str(sensor), mode=ctypes.RTLD_GLOBAL), ctypes.CDLL(str(recorder))
    int_, place, size = ctypes.c_int, _Handle, ctypes.c_size_t
    sensor.k4a_image_create_from_buffer.argtypes = [*[int_] * 4, place, size, place, place, ctypes.POINTER(place)]
    sensor.k4a_image_set_device_timestamp_usec.argtypes = [place, ctypes.c_uint64]
    for name in ("color", "depth"):
        getattr(sensor, f"k4a_capture_set_{name}_image").argtypes = [place, place]
    sensor.k4a_capture_create.argtypes = [ctypes.POINTER(place)]
    recorder.k4a_record_create.argtypes = [ctypes.c_char_p, place, Configuration, ctypes.POINTER(place)]
    recorder.k4a_record_add_attachment.argtypes = [place, ctypes.c_char_p, ctypes.c_char_p, size]
    recorder.k4a_record_add_tag.argtypes = [place, ctypes.c_char_p, ctypes.c_char_p]
    recorder.k4a_record_write_capture.argtypes = [place, place]
    for name in ("write_header", "flush", "close"):
        getattr(recorder, f"k4a_record_{name}").argtypes = [place]
    return sensor, recorder


def _colour(number: int) -> bytes:
    pixels = np.full((COLOUR[1], COLOUR[0], 3), (40 * number, 90, 160), np.uint8)
    pixels[300:420, 500:700] = 255
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "JPEG", quality=90)
    return file.getvalue()


def _depth() -> bytes:
    return np.where(np.arange(DEPTH[0]) < DEPTH[0] // 2, 1500, 1200).astype(np.uint16).tobytes() * DEPTH[1]


def main(path: str) -> None:
    """Record to a file."""
    (sensor, recorder), kept = _libraries(), []

    def image(form: int, size: tuple[int, int], stride: int, data: bytes, time_us: int) -> _Handle:
        buffer, made = ctypes.create_string_buffer(data, len(data)), _Handle()
        kept.append(buffer)
        address = ctypes.cast(buffer, _Handle)
        sensor.k4a_image_create_from_buffer(form, *size, stride, address, len(data), None, None, ctypes.byref(made))
        sensor.k4a_image_set_device_timestamp_usec(made, time_us)
        return made

    record, calibration = _Handle(), (Path(__file__).parent / "calibration.json").read_bytes() + b"\0"
    recorder.k4a_record_create(path.encode(), None, Configuration(MJPG, 1, 1, 1, True), ctypes.byref(record))
    recorder.k4a_record_add_attachment(record, b"calibration.json", calibration, len(calibration))
    recorder.k4a_record_add_tag(record, b"K4A_CALIBRATION_FILE", b"calibration.json")
    recorder.k4a_record_write_header(record)
    for number in range(1, COUNT + 1):
        capture, time_us = _Handle(), 1_000_000 + number * STEP_US
        sensor.k4a_capture_create(ctypes.byref(capture))
        sensor.k4a_capture_set_color_image(capture, image(MJPG, COLOUR, 0, _colour(number), time_us))
        sensor.k4a_capture_set_depth_image(capture, image(DEPTH16, DEPTH, 2 * DEPTH[0], _depth(), time_us))
        recorder.k4a_record_write_capture(record, capture)
    recorder.k4a_record_flush(record)
    recorder.k4a_record_close(record)


if __name__ == "__main__":
    main(sys.argv[1])
