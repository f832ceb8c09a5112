"""Detects zeros inside the compressed data of a JPEG: a partly copied file, which decoders fill with gray."""

from __future__ import annotations

_ZEROS = bytes(32)
"""No encoder writes so many zeros in a row, except one whose shortest code means a block without detail."""
_SCAN, _TABLE = 0xDA, 0xC4
_WITHOUT_LENGTH = {0x01, *range(0xD0, 0xDA)}


def zeros_at(data: bytes) -> int | None:
    """Return where a run of zeros begins in the compressed data of a JPEG; None if there is none, or it may be valid.

    It may be valid in progressive files, and if every table's shortest code is that of a flat block.
    """
    if data.find(_ZEROS) < 0:
        return None
    at, flat_codes = 2, []
    while at + 4 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker in _WITHOUT_LENGTH or marker == 0xFF:
            at += 1 if marker == 0xFF else 2
            continue
        length = int.from_bytes(data[at + 2 : at + 4], "big")
        if marker == _TABLE:
            flat_codes += _codes_of_flat_blocks(data[at + 4 : at + 2 + length])
        at += 2 + length
        if marker == _SCAN:
            found = -1 if all(flat_codes) else data.find(_ZEROS, at, data.rfind(b"\xff\xd9"))
            return None if found < 0 else found
    return None


def _codes_of_flat_blocks(tables: bytes) -> list[bool]:
    """For each AC table: whether its code of zeros means "no detail in the rest of the block"."""
    found, at = [], 0
    while at + 17 <= len(tables):
        kind, symbols = tables[at] >> 4, sum(tables[at + 1 : at + 17])
        if kind == 1:
            found.append(tables[at + 17 : at + 18] == b"\0")
        at += 17 + symbols
    return found
