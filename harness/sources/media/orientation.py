"""Remove the rotation that a camera notes in the EXIF data of a TIFF.

Calibrations refer to the sensor's own pixels, so rotations are ignored. On request OpenCV ignores them in JPEG and PNG,
but not in TIFF.
"""

from __future__ import annotations

import struct

_ORIENTATION = 0x0112
_UPRIGHT = 1
_HEADS = {b"II*\0": "<", b"MM\0*": ">"}


def without_rotation(data: bytes) -> bytes:
    """Return the bytes of an image file; a TIFF is changed to say that it is upright."""
    place = _place(data)
    if place is None:
        return data
    at, order = place
    return data[:at] + struct.pack(f"{order}H", _UPRIGHT) + data[at + 2 :]


def _place(data: bytes) -> tuple[int, str] | None:
    """The offset of the orientation of a TIFF's first image, and the byte order; None if there is none."""
    order = _HEADS.get(data[:4])
    if order is None or len(data) < 8:
        return None
    (table,) = struct.unpack_from(f"{order}I", data, 4)
    if table + 2 > len(data):
        return None
    (count,) = struct.unpack_from(f"{order}H", data, table)
    for entry in range(table + 2, min(table + 2 + 12 * count, len(data) - 11), 12):
        tag, kind = struct.unpack_from(f"{order}HH", data, entry)
        if tag == _ORIENTATION and kind == 3:
            return entry + 8, order
    return None
