from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image, ImageOps

from harness.sources.media.images import greatest_values, read_raw, read_rgb, turn_of
from tests.disk import picture, write_bytes, write_image
from vfoa.errors import VfoaError


def test_colours_come_as_rgb(tmp_path: Path) -> None:
    image = picture(0)
    assert np.array_equal(read_rgb(write_image(tmp_path / "a.png", image)), image)
    assert np.array_equal(read_raw(tmp_path / "a.png"), image)


def test_a_picture_of_8k_is_read(tmp_path: Path) -> None:
    file = io.BytesIO()
    Image.new("RGB", (7680, 4320)).save(file, "png", compress_level=1)
    assert read_rgb(write_bytes(tmp_path / "a.png", file.getvalue())).shape == (4320, 7680, 3)


def test_gray_and_16_bit_images_become_8_bit_rgb(tmp_path: Path) -> None:
    gray = picture(1)[..., 0]
    expected = np.repeat(gray[..., None], 3, axis=2)
    assert np.array_equal(read_rgb(write_image(tmp_path / "gray.png", gray)), expected)
    assert np.array_equal(read_rgb(write_image(tmp_path / "deep.png", gray.astype(np.uint16) << 8)), expected)


@pytest.mark.parametrize("white", [100, 255, 1023, 4095, 65535])
@pytest.mark.parametrize(("magic", "shape"), [("P5", (3, 4)), ("P6", (3, 4, 3))])
def test_white_is_what_the_header_of_a_pgm_or_ppm_states(
    tmp_path: Path, magic: str, shape: tuple[int, ...], white: int
) -> None:
    values = np.linspace(0, white, int(np.prod(shape))).astype(int).reshape(shape)
    header = f"{magic}\n# by 1 camera\n4 3\n{white}\n".encode()
    data = values.astype("u1" if white < 256 else ">u2").tobytes()
    found = read_rgb(write_bytes(tmp_path / "a.ppm", header + data))
    expected = values * 255 / white if values.ndim == 3 else np.repeat(values[..., None] * 255 / white, 3, axis=2)
    assert np.abs(found - expected).max() < 1
    raw = read_raw(tmp_path / "a.ppm")
    assert np.array_equal(raw, values)


@pytest.mark.parametrize("white", [100, 255, 1023, 65535])
@pytest.mark.parametrize(("magic", "shape"), [("P2", (3, 4)), ("P3", (3, 4, 3))])
def test_a_pgm_or_ppm_in_plain_text_is_read_as_one_in_binary(
    tmp_path: Path, magic: str, shape: tuple[int, ...], white: int
) -> None:
    values = np.linspace(0, white, int(np.prod(shape))).astype(int).reshape(shape)
    text = f"{magic} # 9 9\n4 3\n{white}\n{' '.join(map(str, values.ravel()))}\n"
    path = write_bytes(tmp_path / "a.pgm", text.encode())
    assert np.array_equal(read_raw(path), values)
    pixels = values if values.ndim == 3 else np.repeat(values[..., None], 3, axis=2)
    assert np.abs(read_rgb(path) - pixels * 255 / white).max() < 1


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("P2 2 2 255 1 2 3", "after 3 of 4"),
        ("P2 1 1 9 12", "12.*9"),
        ("P2 1 1 9 a", "not a readable PGM"),
        ("P2 2", "PGM"),
    ],
)
def test_a_damaged_pgm_in_plain_text_is_one_clear_error(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(VfoaError, match=rf"a\.pgm: .*{message}"):
        read_rgb(write_bytes(tmp_path / "a.pgm", text.encode()))


@pytest.mark.parametrize(("suffix", "is_cut"), [("png", True), ("avif", False)])
def test_twelve_bits_are_not_cut_in_a_file_that_states_them(tmp_path: Path, suffix: str, is_cut: bool) -> None:
    values = np.repeat(np.linspace(0, 4095, 32 * 64).astype(np.uint16).reshape(32, 64, 1), 3, axis=2)
    options = [cv2.IMWRITE_AVIF_DEPTH, 12] if suffix == "avif" else []
    path = write_bytes(tmp_path / f"a.{suffix}", cv2.imencode(f".{suffix}", values, options)[1].tobytes())
    with greatest_values() as greatest:
        read_rgb(path)
    assert bool(greatest) == is_cut


def test_raw_values_keep_their_16_bits(tmp_path: Path) -> None:
    deep = np.arange(12, dtype=np.uint16).reshape(3, 4) * 5000
    assert np.array_equal(read_raw(write_image(tmp_path / "deep.png", deep)), deep)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_raw_colours_come_as_rgb_without_their_alpha(tmp_path: Path, dtype: type[np.unsignedinteger]) -> None:
    rgb = picture(0).astype(dtype)
    assert cv2.imwrite(str(tmp_path / "a.png"), np.dstack([rgb[..., ::-1], np.full(rgb.shape[:2], 7, dtype)]))
    found = read_raw(tmp_path / "a.png")
    assert found.dtype == dtype
    assert np.array_equal(found, rgb)


def test_colours_of_other_depths_are_one_clear_error(tmp_path: Path) -> None:
    assert cv2.imwrite(str(tmp_path / "deep.tiff"), np.zeros((3, 4, 3), np.float64))
    with pytest.raises(VfoaError, match=r"deep\.tiff: found 3 .*float64.*8 or 16"):
        read_raw(tmp_path / "deep.tiff")


@given(share=st.floats(0, 1, exclude_max=True))
def test_a_png_cut_anywhere_is_one_clear_error(tmp_path: Path, share: float) -> None:
    whole = write_image(tmp_path / "whole.png", picture(2)).read_bytes()
    cut = write_bytes(tmp_path / "cut.png", whole[: int(share * len(whole))])
    with pytest.raises(VfoaError, match=r"cut\.png: ") as error:
        read_rgb(cut)
    assert "\n" not in str(error.value)


@given(share=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_flipped_bit_of_a_png_is_found(tmp_path: Path, share: float, bit: int) -> None:
    data = bytearray(write_image(tmp_path / "whole.png", picture(3)).read_bytes())
    data[int(share * len(data))] ^= 1 << bit
    with pytest.raises(VfoaError, match=r"flip\.png: "):
        read_rgb(write_bytes(tmp_path / "flip.png", bytes(data)))


def test_a_cut_jpeg_is_found(tmp_path: Path) -> None:
    data = write_image(tmp_path / "whole.jpg", picture(4, 200, 150)).read_bytes()
    assert read_rgb(tmp_path / "whole.jpg").shape == (150, 200, 3)
    with pytest.raises(VfoaError, match="truncated JPEG"):
        read_rgb(write_bytes(tmp_path / "cut.jpg", data[: len(data) // 2]))


def test_what_a_camera_s_buffer_has_behind_a_jpeg_is_no_cut(tmp_path: Path) -> None:
    data = write_image(tmp_path / "whole.jpg", picture(4)).read_bytes()
    assert np.array_equal(
        read_rgb(write_bytes(tmp_path / "more.jpg", data + bytes(5000))), read_rgb(tmp_path / "whole.jpg")
    )
    with pytest.raises(VfoaError, match="truncated JPEG"):
        read_rgb(write_bytes(tmp_path / "cut.jpg", data[: len(data) // 2] + bytes(5000)))


@pytest.mark.parametrize(("content", "message"), [(b"", "empty"), (b"no image at all", "not a readable image")])
def test_what_is_no_image_is_named(tmp_path: Path, content: bytes, message: str) -> None:
    with pytest.raises(VfoaError, match=rf"x\.png: .*{message}"):
        read_rgb(write_bytes(tmp_path / "x.png", content))


def test_a_missing_file_and_a_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"gone\.png: no such file"):
        read_rgb(tmp_path / "gone.png")
    with pytest.raises(VfoaError, match="cannot be read"):
        read_rgb(tmp_path)


def _jpeg(**how: object) -> bytes:
    noise = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    file = io.BytesIO()
    Image.fromarray(cv2.GaussianBlur(noise, (0, 0), 2)).save(file, "jpeg", quality=90, **how)
    return file.getvalue()


@pytest.mark.parametrize("optimize", [False, True])
def test_a_flat_jpeg_is_not_damaged(tmp_path: Path, optimize: bool) -> None:
    file = io.BytesIO()
    Image.fromarray(np.zeros((480, 640, 3), np.uint8)).save(file, "jpeg", optimize=optimize)
    assert not read_rgb(write_bytes(tmp_path / "flat.jpg", file.getvalue())).any()


@pytest.mark.parametrize("how", [{}, {"progressive": True}, {"subsampling": 0}, {"optimize": True}])
@pytest.mark.parametrize("share", [0.3, 0.5, 0.9])
def test_a_jpeg_whose_data_end_early_is_refused(tmp_path: Path, share: float, how: dict[str, object]) -> None:
    whole = _jpeg(**how)
    assert read_rgb(write_bytes(tmp_path / "whole.jpg", whole)).shape == (240, 320, 3)
    half = write_bytes(tmp_path / "half.jpg", whole[: int(share * len(whole))] + b"\xff\xd9")
    with pytest.raises(VfoaError, match=r"half\.jpg: damaged JPEG"):
        read_rgb(half)


@pytest.mark.parametrize("kind", ["png", "jpeg", "bmp", "tiff", "webp", "webp lossless"])
def test_an_image_that_claims_too_many_pixels_is_not_decoded(tmp_path: Path, kind: str) -> None:
    name, _, way = kind.partition(" ")
    file = io.BytesIO()
    Image.fromarray(np.zeros((9, 7, 3), np.uint8)).save(file, name, **({"lossless": True} if way else {}))
    data, most = bytearray(file.getvalue()), {"webp": 16383}.get(name, 30000)
    at, size = {
        "png": (16, struct.pack(">II", most, most)),
        "jpeg": (data.find(b"\xff\xc0") + 5, struct.pack(">HH", most, most)),
        "bmp": (18, struct.pack("<ii", most, most)),
        "tiff": (-1, b""),
        "webp": (26, struct.pack("<HH", most, most)),
        "webp lossless": (21, struct.pack("<I", (most - 1) | (most - 1) << 14)),
    }[kind]
    if kind == "tiff":  # width and length: tags 256 and 257, one LONG or SHORT each
        for tag in (256, 257):
            at = next(n for n in range(len(data)) if data[n : n + 2] == struct.pack("<H", tag) and n > 7)
            data[at + 2 : at + 12] = struct.pack("<HII", 4, 1, most)
    else:
        data[at : at + len(size)] = size
    if kind == "png":
        data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    with pytest.raises(VfoaError, match="it claims more than 67108864 pixels"):
        read_rgb(write_bytes(tmp_path / "bomb", bytes(data)))


@pytest.mark.parametrize("suffix", ["jpg", "png", "webp"])
@pytest.mark.parametrize("orientation", range(9))
def test_an_image_is_upright_as_its_camera_says_or_as_it_is_stored(
    tmp_path: Path, suffix: str, orientation: int
) -> None:
    stored = np.zeros((16, 32, 3), np.uint8)
    stored[:8, :8] = 255
    picture = Image.fromarray(stored)
    exif = picture.getexif()
    exif[0x0112] = orientation
    path = tmp_path / f"a.{suffix}"
    picture.save(path, exif=exif)
    with Image.open(path) as opened:
        upright = np.asarray(ImageOps.exif_transpose(opened).convert("RGB"))
    assert np.array_equal(read_rgb(path, upright=True) > 127, upright > 127)
    assert np.array_equal(read_rgb(path) > 127, stored > 127)
    assert read_raw(path).shape == stored.shape
    assert bool(turn_of(path)) == (orientation > 1)


def test_what_is_no_image_is_not_turned(tmp_path: Path) -> None:
    assert turn_of(tmp_path / "none.jpg") == ""
    assert turn_of(write_bytes(tmp_path / "a.jpg", b"\xff\xd8 Exif")) == ""
