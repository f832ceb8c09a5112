from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from harness.sources.media.images import greatest_values
from harness.sources.recordings import pixels
from harness.sources.recordings.image_message import ImageMessage
from harness.sources.recordings.pixels import rgb
from tests.disk import HEIGHT, WIDTH, picture
from vfoa.errors import VfoaError

COLOURS = picture(5)
GRAY = COLOURS[..., 0]
OPAQUE = np.full((HEIGHT, WIDTH, 1), 77, np.uint8)
REPEATED = np.repeat(GRAY[..., None], 3, axis=2)
PLACES = {"r": 0, "g": 1, "b": 2}


def raw(encoding: str, pixels: NDArray[np.generic], padding: int = 0, big: bool = False) -> ImageMessage:
    """The message that holds these pixels, with ``padding`` bytes after each row."""
    height, width = pixels.shape[:2]
    rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(height, -1)
    padded = np.pad(rows, ((0, 0), (0, padding)), constant_values=255)
    return ImageMessage(
        form=encoding,
        frame_id="",
        size_px=(width, height),
        step=padded.shape[1],
        is_bigendian=big,
        data=padded.tobytes(),
    )


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize(
    ("encoding", "pixels", "expected"),
    [
        ("rgb8", COLOURS, COLOURS),
        ("bgr8", COLOURS[..., ::-1], COLOURS),
        ("8UC3", COLOURS[..., ::-1], COLOURS),
        ("rgba8", np.concatenate([COLOURS, OPAQUE], axis=2), COLOURS),
        ("bgra8", np.concatenate([COLOURS[..., ::-1], OPAQUE], axis=2), COLOURS),
        ("mono8", GRAY, REPEATED),
        ("8UC1", GRAY, REPEATED),
        ("8UC4", np.concatenate([COLOURS[..., ::-1], OPAQUE], axis=2), COLOURS),
        ("rgb16", COLOURS.astype("<u2") << 8 | 0xA5, COLOURS),
        ("bgr16", COLOURS[..., ::-1].astype("<u2") << 8, COLOURS),
        ("bgra16", np.concatenate([COLOURS[..., ::-1], OPAQUE], axis=2).astype("<u2") << 8, COLOURS),
        ("16UC1", GRAY.astype("<u2") << 8, REPEATED),
    ],
)
def test_every_order_of_channels(
    encoding: str, pixels: NDArray[np.unsignedinteger], expected: NDArray[np.uint8], padding: int
) -> None:
    assert np.array_equal(rgb(raw(encoding, pixels, padding), "x"), expected)


@pytest.mark.parametrize(("encoding", "pixels"), [("rgb8", COLOURS), ("mono8", GRAY)])
@pytest.mark.parametrize("size", [(1, 3), (3, 1), (1, 1)])
def test_any_size_will_do(encoding: str, pixels: NDArray[np.uint8], size: tuple[int, int]) -> None:
    part = pixels[: size[0], : size[1]]
    expected = part if part.ndim == 3 else np.repeat(part[..., None], 3, axis=2)
    assert np.array_equal(rgb(raw(encoding, part), "x"), expected)


@pytest.mark.parametrize(("order", "big"), [("<u2", False), (">u2", True)])
def test_of_sixteen_bits_the_upper_eight_are_kept(order: str, big: bool) -> None:
    values = (GRAY.astype(np.uint16) << 8 | GRAY[::-1]).astype(order)
    assert np.array_equal(rgb(raw("mono16", values, big=big), "x"), REPEATED)
    colours = (COLOURS.astype(np.uint16) << 8 | COLOURS[::-1]).astype(order)
    assert np.array_equal(rgb(raw("rgb16", colours, big=big), "x"), COLOURS)


@pytest.mark.parametrize(("order", "big"), [("<u2", False), (">u2", True)])
def test_the_greatest_value_of_sixteen_bits_is_collected_where_it_is_asked_for(order: str, big: bool) -> None:
    values = (GRAY.astype(np.uint16) * 16).astype(order)
    rgb(raw("mono16", values, padding=6, big=big), "x")
    with greatest_values() as greatest:
        rgb(raw("mono16", values, padding=6, big=big), "x")
        rgb(raw("mono8", GRAY), "x")
    rgb(raw("mono16", values, big=big), "x")
    assert greatest == [int(GRAY.max()) * 16]


@given(colour=st.tuples(*[st.integers(0, 255)] * 3), pattern=st.sampled_from(["rggb", "bggr", "gbrg", "grbg"]))
@pytest.mark.parametrize("bits", [8, 16])
def test_a_bayer_mosaic_of_one_colour_is_that_colour(bits: int, colour: tuple[int, int, int], pattern: str) -> None:
    tile = np.array([colour[PLACES[letter]] for letter in pattern], np.uint8).reshape(2, 2)
    mosaic = np.tile(tile, (HEIGHT // 2, WIDTH // 2))
    samples = mosaic if bits == 8 else mosaic.astype("<u2") << 8
    found = rgb(raw(f"bayer_{pattern}{bits}", samples), "x")
    assert (found == np.array(colour)).all()


@pytest.mark.parametrize(
    ("form", "bits", "is_mosaic"),
    [
        ("bayer_gbrg8; png compressed ", 8, True),
        ("bayer_gbrg8; png compressed bayer_gbrg8", 8, True),
        ("bayer_gbrg16; png compressed ", 16, True),
        ("bayer_gbrg8; png compressed mono8", 8, False),
    ],
)
def test_a_compressed_mosaic_has_its_colours(
    form: str, bits: int, is_mosaic: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """compressed_image_transport leaves a mosaic as it is, or makes it gray and says so."""
    mosaic = np.tile(np.array([[90, 30], [200, 90]], np.uint8), (HEIGHT // 2, WIDTH // 2))
    samples = mosaic if bits == 8 else mosaic.astype(np.uint16) << 8
    data = cv2.imencode(".png", samples)[1].tobytes()
    content = ImageMessage(form=form, data=data)
    monkeypatch.setattr(pixels, "picture", lambda kind, data, where: content)
    found = pixels.read_image(None, b"", "/left")  # type: ignore[arg-type]
    expected = np.broadcast_to([200, 90, 30], found.shape) if is_mosaic else np.repeat(mosaic[..., None], 3, axis=2)
    assert np.array_equal(found, expected)


@given(y=st.integers(16, 235), u=st.integers(90, 166), v=st.integers(90, 166))
@pytest.mark.parametrize(
    ("encoding", "order"), [("yuv422", "uyvy"), ("uyvy", "uyvy"), ("yuv422_yuy2", "yuyv"), ("yuyv", "yuyv")]
)
def test_yuv_is_that_of_bt_601(encoding: str, order: str, y: int, u: int, v: int) -> None:
    values = {"y": y, "u": u, "v": v}
    pixels = np.tile(np.array([values[letter] for letter in order], np.uint8), (4, 2)).reshape(4, 4, 2)
    luma, blue, red = 1.164 * (y - 16), u - 128, v - 128
    expected = [luma + 1.596 * red, luma - 0.813 * red - 0.391 * blue, luma + 2.018 * blue]
    found = rgb(raw(encoding, pixels), "x")
    assert np.abs(found - np.clip(expected, 0, 255)).max() <= 1.5


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize("encoding", ["nv12", "nv21"])
def test_colours_of_two_by_two_pixels_follow_the_luma(encoding: str, padding: int) -> None:
    generator = np.random.default_rng(1)
    luma = generator.integers(16, 236, (HEIGHT, WIDTH), dtype=np.uint8)
    blue, red = generator.integers(90, 167, (2, HEIGHT // 2, WIDTH // 2), dtype=np.uint8)
    colours = np.stack([blue, red] if encoding == "nv12" else [red, blue], axis=2).reshape(HEIGHT // 2, WIDTH)
    message = dataclasses.replace(raw(encoding, np.concatenate([luma, colours]), padding), size_px=(WIDTH, HEIGHT))
    y, u, v = (1.164 * (luma - 16.0), *(np.kron(each - 128.0, np.ones((2, 2))) for each in (blue, red)))
    expected = np.stack([y + 1.596 * v, y - 0.813 * v - 0.391 * u, y + 2.018 * u], axis=2)
    assert np.abs(rgb(message, "x") - np.clip(expected, 0, 255)).max() <= 1.5
    cut = dataclasses.replace(message, data=message.data[:-1])
    with pytest.raises(VfoaError, match=rf"{WIDTH} x {HEIGHT} .*{len(cut.data)} bytes"):
        rgb(cut, "x")


@pytest.mark.parametrize("size_px", [(3, 2), (2, 3)])
def test_colours_of_two_by_two_pixels_need_an_even_size(size_px: tuple[int, int]) -> None:
    message = dataclasses.replace(raw("nv12", np.zeros((6, 4), np.uint8)), size_px=size_px)
    with pytest.raises(VfoaError, match=f"x: {size_px[0]} x {size_px[1]} pixels of nv12"):
        rgb(message, "x")


def test_an_unknown_encoding_names_its_neighbours() -> None:
    with pytest.raises(VfoaError, match=r"x: encoding 'rgb88'; did you mean 'rgb8'"):
        rgb(raw("rgb88", COLOURS), "x")


@pytest.mark.parametrize("encoding", ["yuv422", "yuyv"])
def test_yuv_of_an_odd_width_is_refused(encoding: str) -> None:
    with pytest.raises(VfoaError, match=f"x: 3 x 2 pixels of {encoding}"):
        rgb(raw(encoding, np.zeros((2, 3, 2), np.uint8)), "x")


def test_data_that_are_too_short_are_refused() -> None:
    whole = raw("rgb8", COLOURS)
    cut = dataclasses.replace(whole, data=whole.data[:-1])
    with pytest.raises(VfoaError, match=rf"{WIDTH} x {HEIGHT} .*{len(cut.data)} bytes"):
        rgb(cut, "x")


@pytest.mark.parametrize("form", ["h264", "H265", "bgr8; libx264"])
def test_a_packet_of_a_video_among_pictures_is_named_as_one(form: str, monkeypatch: pytest.MonkeyPatch) -> None:
    packet = ImageMessage(form=form, frame_id="", size_px=None, step=0, is_bigendian=False, data=b"\0\0\0\1\x67")
    monkeypatch.setattr(pixels, "picture", lambda kind, data, where: packet)
    with pytest.raises(VfoaError, match=r"/left: a packet .*picture"):
        pixels.read_image(None, b"", "/left")  # type: ignore[arg-type]
