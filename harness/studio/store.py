"""Rendered pairs and their geometry on disk, lossless: to read one takes a fraction of the time of rendering it."""

from __future__ import annotations

import hashlib
import logging
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np
import platformdirs
import zstandard
from numpy.typing import NDArray

from harness.files.io import atomic_write
from vfoa.types import Image, Map

_log = logging.getLogger(__name__)
_DIGEST_BYTES = 32
_PNG = (
    *(cv2.IMWRITE_PNG_COMPRESSION, 1),
    *(cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE),
    *(cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_SUB),
)
"""Sensor noise does not repeat: to look for what does takes twice as long, and makes files larger."""
_Read = TypeVar("_Read")


def cache_folder(key: str) -> Path:
    """The folder of one clip's frames: under ``VFOA_CACHE``, else the user's cache folder."""
    root = os.environ.get("VFOA_CACHE") or platformdirs.user_cache_dir("vfoa")
    return Path(root) / "studio" / key


def load_pair(path: Path) -> tuple[Image, Image] | None:
    """Read a stored pair of (H, W, 3) uint8 RGB images; None if there is none, or it is damaged (logged)."""
    return _load(path, _decoded)


def save_pair(path: Path, left: Image, right: Image) -> None:
    """Store a pair as one PNG. A read-only folder is logged and is no error."""
    both = cv2.cvtColor(np.concatenate([left, right]), cv2.COLOR_RGB2BGR)
    _save(path, cv2.imencode(".png", both, _PNG)[1].tobytes())


def load_geometry(path: Path, shape: tuple[int, int]) -> tuple[Map, NDArray[np.uint16]] | None:
    """Read stored disparities and instance ids, both of this shape; None if there are none, or damaged (logged)."""
    return _load(path, lambda packed: _unpacked(packed, shape))


def save_geometry(path: Path, disparity_px: Map, ids: NDArray[np.uint16]) -> None:
    """Store disparities (H, W) and instance ids (H, W), compressed. A read-only folder is logged and is no error."""
    content = disparity_px.astype("<f4").tobytes() + ids.astype("<u2").tobytes()
    _save(path, zstandard.ZstdCompressor(1).compress(content))


def _load(path: Path, decode: Callable[[bytes], _Read | None]) -> _Read | None:
    """Decode what is stored behind its sha256."""
    try:
        stored = path.read_bytes()
    except OSError:  # missing, or the folder is unreadable: then _save reports it
        return None
    digest, content = stored[:_DIGEST_BYTES], stored[_DIGEST_BYTES:]
    value = decode(content) if hashlib.sha256(content).digest() == digest else None
    if value is None:
        _log.warning("%s: damaged; the frame is rendered again", path)
    return value


def _save(path: Path, content: bytes) -> None:
    try:
        atomic_write(path, hashlib.sha256(content).digest() + content)
    except OSError as error:
        _log.warning("%s: rendered frames are not stored: %s", path.parent, error)


def _decoded(png: bytes) -> tuple[Image, Image] | None:
    try:
        pixels = cv2.imdecode(np.frombuffer(png, dtype=np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:
        return None
    if pixels is None or len(pixels) % 2:
        return None
    left, right = np.split(cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False), 2)
    return left, right


def _unpacked(packed: bytes, shape: tuple[int, int]) -> tuple[Map, NDArray[np.uint16]] | None:
    pixels = math.prod(shape)
    try:
        if zstandard.frame_content_size(packed) != 6 * pixels:
            return None
        content = zstandard.ZstdDecompressor().decompress(packed)
    except zstandard.ZstdError:
        return None
    disparity_px, ids = np.frombuffer(content, "<f4", pixels), np.frombuffer(content, "<u2", offset=4 * pixels)
    return disparity_px.reshape(shape), ids.reshape(shape)
