"""Zeros inside the compressed data of a JPEG: a file that was copied in part, which decoders fill with gray."""

from __future__ import annotations

_ZEROS = bytes(32)
"""No encoder writes so many in a row, but for one whose shortest code means a block without detail."""
_SCAN, _TABLE = 0xDA, 0xC4
_WITHOUT_LENGTH = {0x01, *range(0xD0, 0xDA)}


def zeros_at(data: bytes) -> int | None:
    """Where a run of zeros begins in the compressed data of a JPEG; None where there is none, or it may be right.

    It may be right in progressive files, and where every table's shortest code is that of a flat block.
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
    """Of each AC table: whether its code of zeros means "no detail in the rest of the block"."""
    found, at = [], 0
    while at + 17 <= len(tables):
        kind, symbols = tables[at] >> 4, sum(tables[at + 1 : at + 17])
        if kind == 1:
            found.append(tables[at + 17 : at + 18] == b"\0")
        at += 17 + symbols
    return found
