"""Metadata that ``ros2 bag record`` writes beside its files (``metadata.yaml``): numbers of recorded messages."""

from __future__ import annotations

from pathlib import Path, PurePosixPath
from typing import Any

from harness.files.io import read_bytes
from harness.files.parsing import parse_yaml
from vfoa.errors import VfoaError


def recorded_counts(files: tuple[Path, ...]) -> dict[str, int] | None:
    """Messages by topic that were written into these files together.

    None without a ``metadata.yaml`` beside them, or if it is not of exactly these files: its counts are of all.
    """
    path = files[0].with_name("metadata.yaml")
    try:
        noted = parse_yaml(read_bytes(path), path)["rosbag2_bagfile_information"]
        names = {PurePosixPath(name).name for name in noted["relative_file_paths"]}
        counts = dict(_count(each) for each in noted["topics_with_message_count"])
    except (VfoaError, KeyError, TypeError, ValueError, AttributeError):
        return None
    return counts if names == {file.name for file in files} else None


def _count(entry: Any) -> tuple[str, int]:
    return str(entry["topic_metadata"]["name"]), int(entry["message_count"])
