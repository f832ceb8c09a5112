"""TIFF as OpenCV misreads it: tags that change the samples, and files whose samples it gives in another order."""

from __future__ import annotations

import struct
from contextlib import suppress

_ORDERS = {b"II*\0": "<", b"MM\0*": ">", b"II+\0": "<", b"MM\0+": ">"}
"""First bytes of a TIFF and of a BigTIFF, and the order of the bytes of its numbers."""
_READ_BITS = (1, 4, 8, 16, 32, 64)
"""Bits of a sample that OpenCV reads; it gives wrong numbers for 10, 12 and 14, which share bytes."""

_BITS_PER_SAMPLE, _ORIENTATION, _SAMPLES_PER_PIXEL, _PLANAR, _EXTRA_SAMPLES = 258, 274, 277, 284, 338
_SHORT, _UPRIGHT, _UNSPECIFIED, _UNASSOCIATED_ALPHA, _SEPARATE_PLANES = 3, 1, 0, 2, 2

_DAMAGE = (struct.error, OverflowError)
"""What a place beyond the end of the file raises."""


def is_tiff(data: bytes) -> bool:
    """Whether these are the first bytes of a TIFF or a BigTIFF."""
    return data.startswith(tuple(_ORDERS))


def tiff_problem(data: bytes) -> str | None:
    """Why OpenCV would give other numbers than a TIFF has; None if it gives the right ones."""
    if (bits := _value(data, _places(data), _BITS_PER_SAMPLE)) not in _READ_BITS:
        return f"a TIFF of {bits} bits per sample; expected one of: {', '.join(map(str, _READ_BITS))}"
    return None


def has_separate_planes(data: bytes) -> bool:
    """Whether OpenCV, when it does not cut them to 8 bits, gives the colours of a TIFF in a wrong order."""
    places = _places(data)
    planes, colours, bits = (_value(data, places, tag) for tag in (_PLANAR, _SAMPLES_PER_PIXEL, _BITS_PER_SAMPLE))
    return planes == _SEPARATE_PLANES and colours > 1 and bits > 8


def plain_tiff(data: bytes, *, keeps_orientation: bool) -> bytes:
    """The same file, of which OpenCV gives the colours as they are stored.

    It would multiply them by an alpha that is not associated with them, and turn and mirror them by the file's
    orientation, whatever its flags say, unless ``keeps_orientation``.
    """
    places, plain = _places(data), bytearray(data)
    if _value(data, places, _EXTRA_SAMPLES) == _UNASSOCIATED_ALPHA:
        struct.pack_into(f"{_order(data)}H", plain, places[_EXTRA_SAMPLES], _UNSPECIFIED)
    if not keeps_orientation and _value(data, places, _ORIENTATION) != _UPRIGHT:
        struct.pack_into(f"{_order(data)}H", plain, places[_ORIENTATION], _UPRIGHT)
    return bytes(plain)


def _order(data: bytes) -> str:
    return _ORDERS[data[:4]]


def _value(data: bytes, places: dict[int, int], tag: int) -> int:
    """The first number of a tag; 1, the format's default of most tags, if the file has none."""
    with suppress(KeyError, *_DAMAGE):
        return int(struct.unpack_from(f"{_order(data)}H", data, places[tag])[0])
    return 1


def _places(data: bytes) -> dict[int, int]:
    """Where the 16-bit numbers of the tags of the first picture begin, up to where the file is damaged."""
    order, is_big = _order(data), 43 in data[2:4]
    offset, counter, entry = ("Q", "Q", "HHQ") if is_big else ("I", "H", "HHI")
    places = {}
    with suppress(*_DAMAGE):
        (at,) = struct.unpack_from(order + offset, data, 8 if is_big else 4)
        (n_tags,) = struct.unpack_from(order + counter, data, at)
        at += struct.calcsize(order + counter)
        n_head, n_inside = struct.calcsize(order + entry), struct.calcsize(order + offset)
        for start in range(at, min(at + n_tags * (n_head + n_inside), len(data)), n_head + n_inside):
            tag, kind, n_values = struct.unpack_from(order + entry, data, start)
            if kind == _SHORT:
                place = start + n_head
                places[tag] = place if 2 * n_values <= n_inside else struct.unpack_from(order + offset, data, place)[0]
    return places
