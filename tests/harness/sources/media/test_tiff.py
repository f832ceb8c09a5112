from __future__ import annotations

import struct
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from harness.sources.media.images import read_raw, read_rgb, turn_of
from tests.disk import picture, write_bytes, write_image
from vfoa.errors import VfoaError

ORIENTATION = 274


def _tiff(order: str, bits: int, *planes: bytes) -> bytes:
    """A TIFF of 6 x 4 pixels, one plane for each colour."""
    n_planes, (n_bytes,) = len(planes), {len(plane) for plane in planes}
    tags = [(256, [6]), (257, [4]), (258, [bits] * n_planes), (259, [1]), (262, [2 if n_planes > 1 else 1])]
    tags += [(273, [8 + n * n_bytes for n in range(n_planes)]), (277, [n_planes]), (278, [4])]
    tags += [(279, [n_bytes] * n_planes), (284, [2 if n_planes > 1 else 1])]
    body, entries = b"".join(planes), b""
    for tag, values in tags:
        packed = struct.pack(f"{order}{len(values)}H", *values)
        if len(packed) > 4:
            packed, body = struct.pack(f"{order}I", 8 + len(body)), body + packed
        entries += struct.pack(f"{order}HHI", tag, 3, len(values)) + packed.ljust(4, b"\0")
    head = (b"II*\0" if order == "<" else b"MM\0*") + struct.pack(f"{order}I", 8 + len(body))
    return head + body + struct.pack(f"{order}H", len(tags)) + entries + bytes(4)


@pytest.mark.parametrize("order", ["<", ">"])
def test_samples_that_share_bytes_are_refused(tmp_path: Path, order: str) -> None:
    packed = np.packbits(np.unpackbits(np.arange(24, dtype=">u2").view(np.uint8).reshape(-1, 2), axis=1)[:, 4:])
    path = write_bytes(tmp_path / "a.tif", _tiff(order, 12, packed.tobytes()))
    for read in (read_raw, read_rgb):
        with pytest.raises(VfoaError, match=r"a\.tif: a TIFF of 12 bits"):
            read(path)
    image = np.arange(24, dtype=np.uint16).reshape(4, 6) * 2000
    assert np.array_equal(read_raw(write_image(tmp_path / "b.tif", image)), image)


@pytest.mark.parametrize("order", ["<", ">"])
def test_colours_of_16_bits_in_planes_of_their_own_are_cut_to_8_bits_or_refused(tmp_path: Path, order: str) -> None:
    colours = np.random.default_rng(0).integers(0, 1 << 16, (4, 6, 3))
    planes = [colours[..., n].astype(f"{order}u2").tobytes() for n in range(3)]
    path = write_bytes(tmp_path / "a.tif", _tiff(order, 16, *planes))
    assert np.abs(read_rgb(path) - colours / 257).max() < 1
    with pytest.raises(VfoaError, match=r"a\.tif: .*16 bits.*planarconfig"):
        read_raw(path)


@pytest.mark.parametrize("is_big", [False, True])
def test_an_alpha_does_not_change_colours(tmp_path: Path, is_big: bool) -> None:
    rgb = picture(0)
    Image.fromarray(np.dstack([rgb, picture(1)[..., 0]])).save(tmp_path / "a.tif", big_tiff=is_big)
    assert np.array_equal(read_rgb(tmp_path / "a.tif"), rgb)
    assert np.array_equal(read_raw(tmp_path / "a.tif"), rgb)


@pytest.mark.parametrize("is_big", [False, True])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_picture_is_turned_only_upright(tmp_path: Path, orientation: int, is_big: bool) -> None:
    """As a JPEG or PNG is: measured depth is aligned with the pixels as they are stored."""
    rgb, path = picture(0), tmp_path / "a.tif"
    Image.fromarray(rgb).save(path, tiffinfo={ORIENTATION: orientation}, big_tiff=is_big)
    assert np.array_equal(read_rgb(path), rgb)
    assert np.array_equal(read_raw(path), rgb)
    transposed = rgb if orientation < 5 else rgb.swapaxes(0, 1)
    rows = slice(None, None, -1 if orientation in (3, 4, 7, 8) else 1)
    columns = slice(None, None, -1 if orientation in (2, 3, 6, 7) else 1)
    assert np.array_equal(read_rgb(path, upright=True), transposed[rows, columns])
    assert bool(turn_of(path)) == (orientation != 1)


@given(place=st.integers(4, 40), value=st.integers(0, 255), share=st.floats(0, 1))
def test_damage_is_one_clear_error_or_another_picture(tmp_path: Path, place: int, value: int, share: float) -> None:
    Image.fromarray(picture(0, 8, 6)).save(tmp_path / "a.tif", tiffinfo={ORIENTATION: 6}, big_tiff=bool(place % 2))
    data = bytearray((tmp_path / "a.tif").read_bytes())
    data[place] = value
    with suppress(VfoaError):
        read_rgb(write_bytes(tmp_path / "b.tif", bytes(data[: 4 + int(share * len(data))])))
