"""Files that are often given as a source and that no adapter reads: what they are, and what to do."""

from __future__ import annotations

from pathlib import Path

from harness.files.io import check_fetched
from harness.files.safe_names import shell_command
from harness.sources.recordings.containers import is_zstd, starts_with
from harness.sources.recordings.mcap_files import MAGIC, refuse_damaged
from vfoa.errors import VfoaError

_ZSTD_SUFFIXES = (".zst", ".zstd")
_RIGID_BODIES = "rigid bodies: the CSV of Motive or Vicon Tracker, or the TSV of QTM's 6DOF data"
_RECORDINGS = {
    ".svo": (
        "a recording of the ZED's SDK before version 4.1",
        "an .svo2, or its views, which the SDK's sample svo_export.py writes: --mode 0 a film of both, --mode 2 two "
        "series of images. They are rectified: give fx, cx, cy and the baseline of the SDK's calibration_parameters "
        "(--fx --cx --cy --baseline)",
    ),
    ".tak": ("a take of Motive", "the CSV of its rigid bodies: Export Tracking Data, as quaternions"),
    ".qtm": ("a measurement of QTM", "the TSV of its 6DOF data: Export to TSV, with header and names of columns"),
    ".c3d": ("markers in C3D", _RIGID_BODIES),
    ".trc": ("markers in TRC", _RIGID_BODIES),
    ".rrd": ("a recording of Rerun", "what it was made of: images, a film, an MCAP file or a bag"),
    ".bvh": ("a skeleton in BVH", _RIGID_BODIES),
}
"""By the end of a file's name, what it is, and what can be read in its place."""


def refuse_foreign(path: Path) -> None:
    """Raise a :class:`VfoaError` that names what a file is, if it is one of these; folders and other files pass."""
    _refuse_packed(path)
    if not path.is_file():
        return
    check_fetched(path)
    refuse_damaged(path)
    if (known := _RECORDINGS.get(path.suffix.lower())) is not None and not starts_with(path, MAGIC):
        kind, instead = known
        raise VfoaError(f"{path}: {kind}, which is not read; expected {instead}")


def _refuse_packed(path: Path) -> None:
    """Refuse a recording that rosbag2 compressed as a whole, without the ``metadata.yaml`` by which it is read."""
    if (path / "metadata.yaml").exists():
        return
    for file in filter(is_zstd, sorted(path.glob("*.zstd")) if path.is_dir() else [path]):
        plain = file.with_suffix("") if file.suffix.lower() in _ZSTD_SUFFIXES else file.with_name(f"plain_{file.name}")
        raise VfoaError(
            f"{file}: compressed as a whole (zstd; rosbag2's --compression-mode file); expected the folder with its "
            f"metadata.yaml, or the file unpacked: {shell_command('zstd', '-d', file, '-o', plain)}"
        )
