"""Detects what decoders hide in a partly copied JPEG: zeros in its compressed data, or data that end too early."""

from __future__ import annotations

from collections.abc import Iterator

from vfoa.types import Image

_ZEROS = bytes(32)
"""No encoder writes so many zeros in a row, except one whose shortest code means a block without detail."""
_SCAN, _TABLE = 0xDA, 0xC4
_PROGRESSIVE = 0xC2
_CORNER_PX = 4
_WITHOUT_LENGTH = {0x01, *range(0xD0, 0xDA)}


def zeros_at(data: bytes) -> int | None:
    """Return where a run of zeros begins in the compressed data of a JPEG; None if there is none, or it may be valid.

    It may be valid in progressive files, and if every table's shortest code is that of a flat block.
    """
    if data.find(_ZEROS) < 0:
        return None
    flat_codes: list[bool] = []
    for marker, at, end in _segments(data):
        if marker == _TABLE:
            flat_codes += _codes_of_flat_blocks(data[at:end])
        if marker == _SCAN:
            found = -1 if all(flat_codes) else data.find(_ZEROS, end, data.rfind(b"\xff\xd9"))
            return None if found < 0 else found
    return None


def ends_early(data: bytes, image: Image) -> bool:
    """Whether the data of a JPEG end before its image (H, W, ...) does, although an end mark follows them.

    libjpeg repeats the last colour then, and warns on the terminal alone. FFmpeg refuses such data. It decodes only
    progressive files, and those whose last pixels are of one colour: decoding twice takes a third longer.
    """
    corner = image[-_CORNER_PX:, -_CORNER_PX:]
    if (corner != corner[-1, -1]).any() and all(marker != _PROGRESSIVE for marker, *_ in _segments(data)):
        return False
    return not _decodes(data, err_detect="explode") and _decodes(data)


def _decodes(data: bytes, **options: str) -> bool:
    import av  # takes as long to import as a hundred files to check, of which most commands have none

    decoder = av.CodecContext.create("mjpeg", "r")
    decoder.options = options
    try:
        return bool(decoder.decode(av.Packet(data)) + decoder.decode(None))
    except av.FFmpegError:
        return False


def _segments(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Marker, begin and end of the content of each segment, up to the first scan."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker in _WITHOUT_LENGTH or marker == 0xFF:
            at += 1 if marker == 0xFF else 2
            continue
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        yield marker, at + 4, at + 2 + length
        if marker == _SCAN:
            return
        at += 2 + length


def _codes_of_flat_blocks(tables: bytes) -> list[bool]:
    """For each AC table: whether its code of zeros means "no detail in the rest of the block"."""
    found, at = [], 0
    while at + 17 <= len(tables):
        kind, symbols = tables[at] >> 4, sum(tables[at + 1 : at + 17])
        if kind == 1:
            found.append(tables[at + 17 : at + 18] == b"\0")
        at += 17 + symbols
    return found
