"""A recording that Azure Kinect's own recorder wrote."""

from __future__ import annotations

import lzma
from pathlib import Path

FOLDER = Path(__file__).parent / "harness" / "sources" / "kinect"
"""Where it comes from: record.py there."""


def kinect_recording(folder: Path) -> Path:
    """Unpack it to this folder: three frames."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "recording.mkv"
    path.write_bytes(lzma.decompress((FOLDER / "recording.mkv.xz").read_bytes()))
    return path
