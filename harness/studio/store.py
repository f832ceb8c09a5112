"""Rendered pairs on disk, lossless: reading one takes a fraction of the time of rendering it."""

from __future__ import annotations

import hashlib
import logging
import os
from pathlib import Path

import cv2
import numpy as np
import platformdirs

from harness.files.io import atomic_write
from vfoa.types import Image

_log = logging.getLogger(__name__)
_DIGEST_BYTES = 32


def cache_folder(key: str) -> Path:
    """The folder of one clip's frames: under ``VFOA_CACHE``, else the user's cache folder."""
    root = os.environ.get("VFOA_CACHE") or platformdirs.user_cache_dir("vfoa")
    return Path(root) / "studio" / key


def load_pair(path: Path) -> tuple[Image, Image] | None:
    """Read a stored pair of (H, W, 3) uint8 RGB images; None if there is none, or it is damaged (logged)."""
    try:
        content = path.read_bytes()
    except OSError:  # missing, or the folder is unreadable: then save_pair reports it
        return None
    digest, png = content[:_DIGEST_BYTES], content[_DIGEST_BYTES:]
    if hashlib.sha256(png).digest() != digest:
        _log.warning("%s: damaged; the frame is rendered again", path)
        return None
    both = _decoded(png)
    if both is None or len(both) % 2:  # a right checksum, but no pair
        _log.warning("%s: damaged; the frame is rendered again", path)
        return None
    left, right = np.split(both, 2)
    return left, right


def save_pair(path: Path, left: Image, right: Image) -> None:
    """Store a pair as one PNG behind its sha256. A read-only folder is logged and is no error."""
    both = cv2.cvtColor(np.concatenate([left, right]), cv2.COLOR_RGB2BGR)
    png = cv2.imencode(".png", both, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()
    try:
        atomic_write(path, hashlib.sha256(png).digest() + png)
    except OSError as error:
        _log.warning("%s: rendered frames are not stored: %s", path.parent, error)


def _decoded(png: bytes) -> Image | None:
    try:
        pixels = cv2.imdecode(np.frombuffer(png, dtype=np.uint8), cv2.IMREAD_COLOR)
    except cv2.error:
        return None
    return None if pixels is None else cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)
