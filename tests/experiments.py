"""Experiments of the tests: which clips, the stages that all configurations share, and what each of these changes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

Settings = Mapping[str, object]
"""Settings by key, such as ``stereo.matcher``."""

TRUTH: Settings = {
    "stereo.matcher": "truth",
    "segmentation.model": "truth",
    "heads.detector": "truth",
    "head_pose.model": "simulated",
    "gaze.model": "simulated",
}
"""Stages of a rendered clip that know its ground truth."""
NO_ERRORS: Settings = {**TRUTH, "head_pose.model": "truth", "gaze.model": "truth"}
"""As :data:`TRUTH`, with directions without errors."""
BLOCKS: Settings = {**TRUTH, "stereo.matcher": "bm", "stereo.min_depth_m": 0.8, "stereo.wls": False}
"""As :data:`TRUTH`, with depths of block matching."""


def experiment_of(
    clips: Sequence[str], configurations: Mapping[str, Settings], stages: Settings | None = None, **top: object
) -> str:
    """An experiment in TOML; ``top`` are keys such as ``preset`` and ``seeds``."""
    lines = [_line(key, value) for key, value in {"clips": [*clips], **top}.items()]
    lines += [_line(f"defaults.{key}", value) for key, value in (stages or {}).items()]
    for name, settings in configurations.items():
        lines += ["[[configuration]]", _line("name", name)]
        lines += [_line(key, value) for key, value in settings.items()]
    return "\n".join([*lines, ""])


def _line(key: str, value: object) -> str:
    return f"{key} = {json.dumps(value)}"
