"""Maps as other programs write them, and files that are none."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from harness.sources.media.maps import read_disparity
from tests.disk import write_bytes
from vfoa.errors import VfoaError

PIXELS = np.array([[1.5, 2.0]], "<f4")


def npz() -> bytes:
    content = io.BytesIO()
    np.savez(content, disparity=PIXELS)
    return content.getvalue()


@pytest.mark.parametrize(
    "head", [b"Pf\n2 1\n-1\n", b"Pf\r\n2 1\r\n-1.0\r\n", b"Pf 2 1 -0.0039216\n", b"Pf\n2 1\n-1e0\n"]
)
def test_heads_of_pfm(tmp_path: Path, head: bytes) -> None:
    assert np.array_equal(read_disparity(write_bytes(tmp_path / "a.pfm", head + PIXELS.tobytes())), PIXELS)


@pytest.mark.parametrize("scale", [b"0", b"-0.0", b"-", b"1e", b"--1"])
def test_a_pfm_whose_byte_order_nobody_can_tell_is_refused(tmp_path: Path, scale: bytes) -> None:
    with pytest.raises(VfoaError, match=r"a\.pfm: .*one-channel"):
        read_disparity(write_bytes(tmp_path / "a.pfm", b"Pf\n2 1\n" + scale + b"\n" + PIXELS.tobytes()))


@pytest.mark.parametrize("content", [npz(), npz()[:30], b"", b"PK\x03\x04"])
def test_an_archive_called_npy_is_refused(tmp_path: Path, content: bytes) -> None:
    with pytest.raises(VfoaError, match=r"a\.npy: not an npy file: "):
        read_disparity(write_bytes(tmp_path / "a.npy", content))


@pytest.mark.parametrize("dtype", [">f4", "<f8", "<f2"])
def test_npy_of_any_floats(tmp_path: Path, dtype: str) -> None:
    np.save(tmp_path / "a.npy", PIXELS.astype(dtype))
    assert np.array_equal(read_disparity(tmp_path / "a.npy"), PIXELS)


@pytest.mark.parametrize("bits", [0x7FE0000000000000, 0x7FF0000000000001], ids=["too large", "signalling NaN"])
def test_what_no_map_can_hold_is_unknown(tmp_path: Path, bits: int) -> None:
    np.save(tmp_path / "a.npy", np.array([[3.0, np.uint64(bits).view(np.float64)]]))
    assert np.array_equal(read_disparity(tmp_path / "a.npy"), np.array([[3.0, np.nan]]), equal_nan=True)
