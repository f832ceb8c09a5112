"""What clips there are, and whether each can be used: files, calibration, rectification, labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.adapters import Clip
from harness.annotations.files import IGNORED
from harness.annotations.timeline import timeline_of
from harness.clips.locate import names, unset_variables
from harness.clips.manifest import ClipManifest, load_manifest
from harness.clips.matching import matched_offsets_px
from vfoa.errors import VfoaError
from vfoa.types import Float, StereoFrame

MAX_VERTICAL_ERROR_PX = 1.5
"""Median row difference of matched points above which block matching along rows stops working."""

MIN_MATCHES = 30
"""Fewer matches say nothing about rectification."""

MAX_BASELINE_M = 10.0
"""A baseline above this is most likely in millimetres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipRow:
    """One clip of the list. ``frames`` is None where it cannot be opened; ``problem`` says why."""

    name: str
    adapter: str | None = None
    frames: int | None = None
    subjects: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()
    licence: str | None = None
    labels: int | None = None
    problem: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipCheck:
    """What was found in one clip; it can be used if there are no ``problems``.

    ``labels`` counts (frame, subject) pairs whose label is scored, None without an annotation file.
    ``vertical_error_px`` is the median row difference of matched points, None where too few were found. ``notes`` are
    what is to be known: what the source lost, what could not be measured.
    """

    name: str
    frames: int | None = None
    size_px: tuple[int, int] | None = None
    fx_px: float | None = None
    baseline_m: float | None = None
    vertical_error_px: float | None = None
    matches: int | None = None
    labels: int | None = None
    notes: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()


def list_clips() -> list[ClipRow]:
    """Every clip that can be found, by name."""
    return [_row(name, path) for name, path in names("datasets").items()]


def clips_at_hand() -> tuple[list[str], dict[str, list[str]]]:
    """The clips that can be looked for, and, by environment variable, those whose root needs one that is not set.

    Those that came with the package are at hand only where their data is; a manifest that cannot be read is.
    """
    here: list[str] = []
    elsewhere: dict[str, list[str]] = {}
    for name, path in names("datasets").items():
        try:
            root = load_manifest(path).root or ""
        except VfoaError:
            root = ""
        if unset := unset_variables(root):
            elsewhere.setdefault(unset[0], []).append(name)
        else:
            here.append(name)
    return here, elsewhere


def check_clip(name_or_path: str) -> ClipCheck:
    """Open a clip, decode its first, middle and last frame, and check calibration, rectification and labels."""
    name = Path(name_or_path).stem if name_or_path.endswith(".toml") else name_or_path
    try:
        manifest = load_manifest(name_or_path)
        clip = manifest.open()
        frames = _sample(clip)
    except VfoaError as error:
        return ClipCheck(name=name, problems=(str(error),))
    labels, label_problems = _labels(manifest, clip)
    offsets = [matched_offsets_px(frame.left, frame.right) for frame in frames]
    matches = sum(map(len, offsets))
    error_px = float(np.median(np.abs(np.concatenate(offsets)[:, 1]))) if matches >= MIN_MATCHES else None
    rig = frames[0].rig
    return ClipCheck(
        name=manifest.name,
        frames=len(clip.frames),
        size_px=(rig.width_px, rig.height_px),
        fx_px=rig.fx_px,
        baseline_m=rig.baseline_m,
        vertical_error_px=error_px,
        matches=matches,
        labels=labels,
        notes=(*clip.notes, *_unmeasured(matches)),
        problems=(
            *_calibration_problems(frames),
            *_rectification_problems(error_px),
            *(_order_problems(frames, offsets) if error_px is not None else ()),
            *label_problems,
        ),
    )


def _row(name: str, path: Path) -> ClipRow:
    try:
        manifest = load_manifest(path)
    except VfoaError as error:
        return ClipRow(name=name, problem=str(error))
    clip, problem = _open(manifest)
    labels, label_problems = _labels(manifest, clip)
    return ClipRow(
        name=manifest.name,
        adapter=manifest.adapter,
        frames=None if clip is None else len(clip.frames),
        subjects=tuple(manifest.subjects),
        targets=tuple(manifest.targets),
        licence=manifest.licence,
        labels=labels,
        problem=problem or next(iter(label_problems), None),
    )


def _open(manifest: ClipManifest) -> tuple[Clip | None, str | None]:
    try:
        return manifest.open(), None
    except VfoaError as error:
        return None, str(error)


def _labels(manifest: ClipManifest, clip: Clip | None) -> tuple[int | None, tuple[str, ...]]:
    """Number of (frame, subject) pairs with a label that is scored, and problems.

    Where the clip cannot be opened, the rows' own lengths count.
    """
    try:
        labels = manifest.labels(None if clip is None else timeline_of(clip))
    except VfoaError as error:
        return None, (str(error),)
    if labels is None:
        return None, ()
    if clip is None:
        scored = [each for each in labels.ranges if each.label.target != IGNORED]
        return sum(each.last_frame - each.first_frame + 1 for each in scored), ()
    return sum(1 for _, _, label in labels.labelled(clip.frames) if label.target != IGNORED), ()


def _sample(clip: Clip) -> list[StereoFrame]:
    """The first, middle and last frame, each once; reading the truth shows that it can be read."""
    if not clip.frames:
        raise VfoaError("the clip has no frames")
    numbers = sorted({clip.frames[0], clip.frames[len(clip.frames) // 2], clip.frames[-1]})
    for number in numbers:
        clip.truth(number)
    return [clip.frame(number) for number in numbers]


def _calibration_problems(frames: Sequence[StereoFrame]) -> list[str]:
    """Each once, with the frames that have it."""
    problems: dict[str, list[int]] = {}
    for frame in frames:
        rig = frame.rig
        if rig.baseline_m > MAX_BASELINE_M:
            problem = f"the baseline is {rig.baseline_m:g} m; expected metres (millimetres?)"
            problems.setdefault(problem, []).append(frame.index)
        if not (0 < rig.cx_px < rig.width_px and 0 < rig.cy_px < rig.height_px):
            problem = (
                f"the principal point ({rig.cx_px:g}, {rig.cy_px:g}) lies outside the image of "
                f"{rig.width_px} x {rig.height_px}; expected the calibration of this size"
            )
            problems.setdefault(problem, []).append(frame.index)
    return [f"frame {', '.join(map(str, numbers))}: {problem}" for problem, numbers in problems.items()]


def _rectification_problems(error_px: float | None) -> list[str]:
    if error_px is None or error_px <= MAX_VERTICAL_ERROR_PX:
        return []
    return [
        f"matched points lie {error_px:.1f} rows apart (median); "
        f"expected at most {MAX_VERTICAL_ERROR_PX} in a rectified pair"
    ]


def _order_problems(frames: Sequence[StereoFrame], offsets: Sequence[Float]) -> list[str]:
    """Points before the cameras lie further right in the left image, but for the principal points' own distance."""
    shifts = [
        columns + frame.rig.cx_right_px - frame.rig.cx_px
        for frame, (columns, _) in zip(frames, (each.T for each in offsets), strict=True)
    ]
    disparity_px = float(np.median(np.concatenate(shifts)))
    if disparity_px >= 0:
        return []
    return [
        f"matched points have a disparity of {disparity_px:.1f} px (median); expected a positive one "
        "(left and right swapped?)"
    ]


def _unmeasured(matches: int) -> list[str]:
    if matches >= MIN_MATCHES:
        return []
    return [f"{matches} points were matched between left and right; rectification is measured from {MIN_MATCHES} on"]
