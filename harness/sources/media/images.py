"""Images from files: decoded completely, or one clear error."""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from harness.files.io import read_bytes
from harness.sources.media.tiff import has_separate_planes, is_tiff, plain_tiff, tiff_problem
from vfoa.errors import VfoaError, reported_as
from vfoa.types import Image

_CORNER_PX = 4
_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
_JPEG_END = b"\xff\xd9"
_PROGRESSIVE = b"\xff\xc2"
_POINTER = b"version https://git-lfs.github.com/spec/"

MOST_PIXELS = int(os.environ["OPENCV_IO_MAX_IMAGE_PIXELS"])
"""Most pixels of an image: :mod:`harness` sets OpenCV's limit."""


_greatest: ContextVar[list[int] | None] = ContextVar("greatest", default=None)


@contextmanager
def greatest_values() -> Iterator[list[int]]:
    """Collect the greatest value of each picture of 16 bits that this thread cuts to 8 bits within the block."""
    found: list[int] = []
    token = _greatest.set(found)
    try:
        yield found
    finally:
        _greatest.reset(token)


def is_collecting() -> bool:
    """Whether :func:`greatest_values` collects: only then are pictures decoded with their own bits, too."""
    return _greatest.get() is not None


def collect_greatest(pixels: NDArray[Any]) -> None:
    """Add a picture with its own bits to those of :func:`greatest_values`."""
    if (found := _greatest.get()) is not None and pixels.dtype == np.uint16:
        found.append(int(pixels.max(initial=0)))


def read_rgb(path: Path, *, upright: bool = False) -> Image:
    """Read an image (H, W, 3) uint8 RGB. Gray is repeated, alpha dropped, 16 bits are cut to 8.

    A file that states its bits is scaled by them instead: AVIF, JPEG 2000, and PGM and PPM, whose header has the value
    of white.

    ``upright``: turn and mirror it as its orientation (EXIF) says, as viewers and OpenCV do. Else its pixels are those
    of the sensor, with which measured depth is aligned.

    Raises
    ------
    VfoaError
        If the file is missing, not an image, or damaged.
    """
    return decode_rgb(read_bytes(path), str(path), upright=upright)


def decode_rgb(data: bytes, where: str, *, upright: bool = False) -> Image:
    """As :func:`read_rgb`, from a file's bytes; ``where`` names the file in messages."""
    if (header := _NETPBM.match(data)) and int(header[1]) not in (_BRIGHTEST, np.iinfo(np.uint16).max):
        return _scaled(decode(data, where, cv2.IMREAD_UNCHANGED), int(header[1]))
    image = decode(data, where, cv2.IMREAD_COLOR | (0 if upright else cv2.IMREAD_IGNORE_ORIENTATION))
    if is_collecting():
        deep = decode(data, where, cv2.IMREAD_UNCHANGED)
        if int(image.max(initial=0)) <= (int(deep.max(initial=0)) >> 8) + 1:  # AVIF states its bits, and is scaled
            collect_greatest(deep)
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


_BRIGHTEST = 255
_NETPBM = re.compile(rb"P[2356](?:(?:\s|#[^\n]*\n)+\d+){2}(?:\s|#[^\n]*\n)+([1-9]\d*)\s")
"""Header of a PGM or PPM, up to the value of white, which OpenCV does not use of a binary one."""
_PLAIN_NETPBM = re.compile(rb"P[23][\s#]")
_NETPBM_COMMENT = re.compile(rb"#[^\n]*")


def _packed(data: bytes, where: str) -> bytes:
    """A PGM or PPM in plain text as the same picture in binary: OpenCV scales the numbers of the former."""
    magic, *words = _NETPBM_COMMENT.sub(b"", data).split()
    with reported_as(f"{where}: not a readable PGM or PPM in plain text"):
        width, height, white = map(int, words[:3])
        values = np.array(words[3:], np.int64)
    n_values = width * height * (3 if magic == b"P3" else 1)
    if len(values) < n_values:
        raise VfoaError(f"{where}: the file ends after {len(values)} of {n_values} values; expected a whole copy")
    values = values[:n_values]
    if values.size and not 0 <= values.min() <= values.max() <= white:
        raise VfoaError(
            f"{where}: found values from {values.min()} to {values.max()}; expected 0 to the header's {white}"
        )
    header = f"P{6 if magic == b'P3' else 5}\n{width} {height}\n{white}\n".encode()
    return header + values.astype(np.uint8 if white <= _BRIGHTEST else ">u2").tobytes()


def _scaled(values: NDArray[Any], white: int) -> Image:
    """Gray (H, W) or BGR (H, W, 3) with this value of white as RGB (H, W, 3) uint8."""
    levels = (values.astype(np.uint32) * _BRIGHTEST + white // 2) // white
    pixels = np.minimum(levels, _BRIGHTEST).astype(np.uint8)
    return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_GRAY2RGB if pixels.ndim == 2 else cv2.COLOR_BGR2RGB), np.uint8)


_ORIENTATION = 0x0112
_HEAD_BYTES = 1 << 16
_TURNS = {
    2: "mirrored",
    3: "rotated by 180 degrees",
    4: "mirrored and rotated by 180 degrees",
    5: "mirrored and rotated by 270 degrees",
    6: "rotated by 90 degrees",
    7: "mirrored and rotated by 90 degrees",
    8: "rotated by 270 degrees",
}
"""What is done to the pixels of an image with this orientation (EXIF 2.32, table 6); degrees are clockwise."""


def turn_of(path: Path) -> str:
    """What the orientation of an image (EXIF) does to its pixels, in words; empty if it has none or cannot be read."""
    with suppress(OSError, SyntaxError, ValueError), path.open("rb") as file:
        head = file.read(_HEAD_BYTES)
        if b"exif" not in head.lower() and not is_tiff(head):
            return ""  # most have none, and Pillow takes its time to import
        from PIL import Image as Pillow

        with Pillow.open(path) as picture:
            return _TURNS.get(picture.getexif().get(_ORIENTATION, 1), "")
    return ""


def read_raw(path: Path) -> NDArray[Any]:
    """Read an image with its own values: (H, W) or (H, W, 3) in RGB order, alpha dropped, uint8 or uint16.

    Raises
    ------
    VfoaError
        As :func:`read_rgb`.
    """
    data = read_bytes(path)
    image = decode(data, str(path), cv2.IMREAD_UNCHANGED)
    if is_tiff(data) and has_separate_planes(data):
        raise VfoaError(
            f"{path}: a TIFF whose colours of 16 bits are in planes of their own; expected those of a pixel beside "
            "each other (PlanarConfiguration 1: tifffile's planarconfig='contig')"
        )
    if image.ndim == 2:
        return image
    if image.dtype not in (np.uint8, np.uint16) or image.shape[2] not in (3, 4):
        kind = f"{image.shape[2]} channels of {image.dtype}"
        raise VfoaError(f"{path}: found {kind}; expected gray or colour of 8 or 16 bits")
    return cv2.cvtColor(image, cv2.COLOR_BGRA2RGB if image.shape[2] == 4 else cv2.COLOR_BGR2RGB)


def decode(data: bytes, where: str, flags: int) -> NDArray[Any]:
    """Decode an image file's bytes with OpenCV's flags; raises as :func:`read_rgb`."""
    # OpenCV 4 silently fills the missing part of a truncated file with black or gray.
    if problem := _damage(data):
        raise VfoaError(f"{where}: {problem}")
    if is_tiff(data):
        is_turned = flags != cv2.IMREAD_UNCHANGED and not flags & cv2.IMREAD_IGNORE_ORIENTATION
        data = plain_tiff(data, keeps_orientation=is_turned)
    elif _PLAIN_NETPBM.match(data):
        data = _packed(data, where)
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        is_large = "CV_IO_MAX_IMAGE" in error.err
        problem = f"it claims more than {MOST_PIXELS} pixels" if is_large else f"not a readable image: {error.err}"
        raise VfoaError(f"{where}: {problem}") from None
    if image is None:
        raise VfoaError(f"{where}: not a readable image ({len(data)} bytes); expected PNG, JPEG or another of OpenCV's")
    if data.startswith(_JPEG) and _ends_early(data, image):
        raise VfoaError(f"{where}: damaged JPEG: its data end before the image does; expected a whole copy")
    return image


def encode_rgb(image: Image, suffix: str, *options: int) -> bytes:
    """An image (H, W, 3) uint8 RGB as the bytes of a file with this suffix, under OpenCV's options."""
    return cv2.imencode(suffix, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)[1].tobytes()


def _damage(data: bytes) -> str | None:
    """A description of the damage in the bytes of an image file; None if none is visible."""
    if not data:
        return "the file is empty; expected an image"
    if data.startswith(_POINTER):
        return "a pointer of Git LFS, not the image; expected its content: git lfs pull fetches it"
    if data.startswith(_PNG) and (problem := _png_damage(data)):
        return problem
    if is_tiff(data) and (problem := tiff_problem(data)):
        return problem
    # Some cameras append a few bytes of their own to a JPEG, or send the buffer's rest; inside compressed data the end
    # mark cannot occur.
    if data.startswith(_JPEG) and _JPEG_END not in data.rstrip(b"\0")[-1024:]:
        return f"truncated JPEG: no end mark in {len(data)} bytes"
    return None


def _ends_early(data: bytes, image: NDArray[Any]) -> bool:
    """Whether the data of a JPEG end before its image (H, W, ...) does, although an end mark follows them.

    libjpeg repeats the last colour then, and warns on the terminal alone. FFmpeg refuses such data. It decodes only
    progressive files, and those whose last pixels are of one colour: decoding twice takes a third longer.
    """
    corner = image[-_CORNER_PX:, -_CORNER_PX:]
    if (corner != corner[-1, -1]).any() and _PROGRESSIVE not in data:
        return False
    return not _decodes(data, err_detect="explode") and _decodes(data)


def _decodes(data: bytes, **options: str) -> bool:
    import av  # slow to import, and few commands need it

    decoder = av.CodecContext.create("mjpeg", "r")
    decoder.options = options
    try:
        return bool(decoder.decode(av.Packet(data)) + decoder.decode(None))
    except av.FFmpegError:
        return False


def width_by_height(pixels: NDArray[Any]) -> str:
    """The size of pixels (H, W, ...) for a message, such as ``640 x 480``."""
    return f"{pixels.shape[1]} x {pixels.shape[0]}"


def too_many_pixels(width_px: int, height_px: int) -> str:
    """The message for an image of a size that is not decoded."""
    return f"it claims {width_px} x {height_px} pixels; expected 1 to {MOST_PIXELS}"


def _png_damage(data: bytes) -> str | None:
    """Check the chunks of a PNG (length, type, data, CRC) up to IEND."""
    at = len(_PNG)
    while at + 12 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        kind, end = data[at + 4 : at + 8], at + 12 + length
        if end > len(data):
            break
        if zlib.crc32(memoryview(data)[at + 4 : end - 4]) != struct.unpack_from(">I", data, end - 4)[0]:
            return f"damaged PNG: wrong checksum of chunk {kind.decode('latin-1')!r} at byte {at}"
        if kind == b"IHDR" and 0 in struct.unpack_from(">II", data, at + 8):
            return "a PNG without pixels"  # libpng would write to the terminal
        if kind == b"IEND":
            return None
        at = end
    return f"truncated PNG: the file ends after {len(data)} bytes, inside the chunk at byte {at}"
