"""Depth in RVL, against words that were made by hand."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from harness.sources.recordings.rvl import decode_rvl
from vfoa.errors import VfoaError


def words(width: int, height: int, *given: int) -> bytes:
    return struct.pack(f"<II{len(given)}I", width, height, *given)


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        # 1 without depth, 2 with: 5 = 0 + 5 (10 = octal 12: nibbles a, 1), 3 = 5 - 2 (3); 1 without, 0 with
        (words(4, 1, 0x12A13100), [[0, 5, 3, 0]]),
        # the difference is from the last depth, across pixels without: 0, 1; 1 (2); 1, 1; 1 - 1 = 0 would be no depth
        (words(1, 3, 0x01211200), [[1], [0], [2]]),
        # 0, 1; 65535 (131070 = octal 377776: e f f f b... lowest first: 6, 7, 7, 7, 7, 3)
        (words(1, 1, 0x01EFFFF3), [[65535]]),
        (words(2, 2, 0x40000000), [[0, 0], [0, 0]]),
    ],
)
def test_numbers_are_those_written(data: bytes, expected: list[list[int]]) -> None:
    found = decode_rvl(data, "x")
    assert found.dtype == np.uint16
    assert found.tolist() == expected


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"\1\0\0\0", "x: RVL of 4 bytes; expected width and height in 8"),
        (words(0, 4), "x: RVL: it claims 0 x 4 pixels"),
        (words(2**31, 2**31), "x: RVL: it claims 2147483648 x 2147483648 pixels"),
        (words(4, 1), "x: RVL that ends after 0 of 4 pixels"),
        (words(4, 1, 0xFFFFFFFF), "x: RVL that ends after 0 of 4 pixels"),
        (words(40, 1, 0x12A1310F), "x: RVL that ends after 4 of 40 pixels"),
        (words(2, 1, 0x12A13100), "x: damaged RVL: 2 pixels with depth from pixel 1 of 2 on, and 5 values"),
        (words(9, 1, 0x18812000), "x: damaged RVL: "),
        (words(9, 1, 0xFFFFFFFF, 0xFFFFFFFF, 0xFFFFFFF1, 0x11111111), "x: damaged RVL: "),
    ],
)
def test_damaged_data_are_one_line(data: bytes, message: str) -> None:
    with pytest.raises(VfoaError, match=f"^{message}"):
        decode_rvl(data, "x")
