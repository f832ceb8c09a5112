"""List clips and check whether each can be used: files, calibration, rectification, depth, labels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from harness.clips.manifest import ClipManifest, clip_files, load_manifest, manifest_notes, manifest_problems
from harness.clips.matching import first_middle_last, matched_offsets_px, near_notes
from harness.files.folders import folders
from harness.labels.labels import IGNORED, timeline_of
from harness.remote import unset_variables
from harness.sources import Clip, MeasuredClip
from vfoa.errors import VfoaError, did_you_mean
from vfoa.stereo.block_matching_settings import BlockMatchingSettings
from vfoa.types import StereoFrame

Value = TypeVar("Value")

MAX_VERTICAL_ERROR_PX = 1.5
"""Median row difference of matched points above which block matching along rows fails."""

MIN_MATCHES = 30
"""Fewer matches do not allow a check of rectification."""

MIN_DEPTH_M, MAX_DEPTH_M = 0.05, 200.0
"""A median measured depth outside of this range is probably in another unit."""

MIN_BASELINE_M, MAX_BASELINE_M = 0.02, 1.0
"""Usual baselines of cameras that watch people; others are probably in another unit."""

_OTHER_UNIT = "another unit? depth_scale in [source] is the number of counts per metre"

DARK = 16
"""Greatest brightness of 12-bit values in 16-bit files, of which only the upper 8 bits are read: 15."""


def _calibration_problems(frames: Sequence[StereoFrame], *, says_unit: bool) -> list[str]:
    """Return each problem once, with its frames. ``says_unit``: the manifest gives the unit of the baseline itself."""
    problems: dict[str, list[int]] = {}
    for frame in frames:
        rig = frame.rig
        if frame.right is not None and not says_unit and not MIN_BASELINE_M <= rig.baseline_m <= MAX_BASELINE_M:
            guess = "" if rig.baseline_m < MIN_BASELINE_M else " (millimetres? squares of the calibration board?)"
            problem = (
                f"the baseline is {rig.baseline_m:.4g} m; expected {MIN_BASELINE_M:g} to {MAX_BASELINE_M:g} m{guess}: "
                'say calibration_unit = "mm" (or "cm"; "m" if it is right) or baseline_m = in [source]'
            )
            problems.setdefault(problem, []).append(frame.index)
        if not (0 < rig.cx_px < rig.width_px and 0 < rig.cy_px < rig.height_px):
            problem = (
                f"the principal point ({rig.cx_px:g}, {rig.cy_px:g}) lies outside the image of "
                f"{rig.width_px} x {rig.height_px}; expected the calibration of this size"
            )
            problems.setdefault(problem, []).append(frame.index)
    return [f"frame {', '.join(map(str, numbers))}: {problem}" for problem, numbers in problems.items()]


def _image_problems(frames: Sequence[StereoFrame]) -> list[str]:
    """Images that decode but cannot be right: the same on both sides, or nearly black."""
    same = [str(frame.index) for frame in frames if frame.right is not None and np.array_equal(frame.left, frame.right)]
    problems = [f"frame {', '.join(same)}: left and right are the same image; expected two views"] if same else []
    brightest = max(int(image.max()) for frame in frames for image in (frame.left, frame.right) if image is not None)
    if brightest <= DARK:
        problems.append(
            f"the brightest value of {len(frames)} frames is {brightest} of 255; expected brighter images "
            "(10 or 12 bits in 16-bit files? scale them to 8 bits)"
        )
    return problems


@dataclass(frozen=True, slots=True, kw_only=True)
class _Matching:
    """Points that were matched between left and right: the median row difference, None with too few of them."""

    matches: int | None = None
    error_px: float | None = None
    notes: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()


def _check_matches(frames: Sequence[StereoFrame]) -> _Matching:
    """Rows that do not match, and negative disparities: points before the cameras are further right in the left image.

    They are found in both images of the frames that have two.
    """
    rows_px, disparities_px = [np.empty(0)], [np.empty(0)]
    for frame in frames:
        if frame.right is not None:
            columns, rows = matched_offsets_px(frame.left, frame.right).T
            rows_px.append(np.abs(rows))
            disparities_px.append(columns + frame.rig.cx_right_px - frame.rig.cx_px)
    if len(rows_px) == 1:
        return _Matching()
    if (matches := sum(map(len, rows_px))) < MIN_MATCHES:
        few = f"{matches} points were matched between left and right"
        return _Matching(matches=matches, notes=(f"{few}; rectification is checked from {MIN_MATCHES} points on",))
    error_px, disparity_px = (float(np.median(np.concatenate(each))) for each in (rows_px, disparities_px))
    problems = []
    if error_px > MAX_VERTICAL_ERROR_PX:
        expected = f"expected at most {MAX_VERTICAL_ERROR_PX} in a rectified pair"
        problems.append(f"matched points lie {error_px:.1f} rows apart (median); {expected}")
    if disparity_px < 0:
        problems.append(
            f"matched points have a disparity of {disparity_px:.1f} px (median); expected a positive one "
            "(left and right swapped?)"
        )
    return _Matching(matches=matches, error_px=error_px, problems=tuple(problems))


def depth_notes(frames: Sequence[StereoFrame]) -> list[str]:
    """Share of the image with measured depth, and its range."""
    depths = [frame.depth_m for frame in frames if frame.depth_m is not None]
    known = np.concatenate([depth[np.isfinite(depth)] for depth in depths]) if depths else np.zeros(0)
    if known.size == 0:
        return []
    near, middle, far = np.percentile(known, (1, 50, 99))
    share = known.size / sum(depth.size for depth in depths)
    limit_m = BlockMatchingSettings().min_depth_m
    unit = f"nearly all of the measured depth is nearer than {limit_m:g} m ({_OTHER_UNIT})"
    return [
        *([unit] if far < limit_m else []),
        f"measured depth on {share:.0%} of the pixels: {near:.2f} to {far:.2f} m (1st to 99th percentile), "
        f'median {middle:.2f} m; stereo.matcher = "sensor" takes it',
    ]


def _depth_problems(frames: Sequence[StereoFrame]) -> list[str]:
    """Measured maps without a value, or with values that suggest another unit."""
    measured = [
        (frame.index, frame.depth_m[np.isfinite(frame.depth_m)]) for frame in frames if frame.depth_m is not None
    ]
    empty = [str(index) for index, depths_m in measured if not depths_m.size]
    medians = [float(np.median(depths_m)) for _, depths_m in measured if depths_m.size]
    problems = [f"frame {', '.join(empty)}: no pixel has a measured depth"] if empty else []
    if medians and not MIN_DEPTH_M <= np.median(medians) <= MAX_DEPTH_M:
        expected = f"expected {MIN_DEPTH_M:g} to {MAX_DEPTH_M:g} m ({_OTHER_UNIT})"
        problems.append(f"the median measured depth is {np.median(medians):.3g} m; {expected}")
    return problems


MAX_DISTANCE_M = 100.0
"""A position further from the origin than this is probably in millimetres."""


def measurement_problems(manifest: ClipManifest, clip: MeasuredClip) -> Iterator[str]:
    """Names of the manifest that do not occur, and positions that cannot be in metres."""
    ids = {**clip.people, **clip.objects}
    kinds = {number: clip.categories[name] for name, number in ids.items()}
    for table, rules in (("subjects", manifest.subjects), ("targets", manifest.targets)):
        for name, rule in rules.items():
            if rule.category not in kinds.values():
                yield f"{table}.{name}.category: {did_you_mean(rule.category, kinds.values())}"
            elif rule.instance is not None and kinds.get(rule.instance) != rule.category:
                yield f"{table}.{name}.instance: no {rule.category} has the number {rule.instance}; numbers: {ids}"
            elif rule.instance is None and not rule.is_shared:
                yield f"{table}.{name}: without images, expected instance, or the category alone"
    farthest_m = max((distance for number in clip.frames for distance in _distances_m(clip, number)), default=0.0)
    if farthest_m > MAX_DISTANCE_M:
        yield f"a person or object is {farthest_m:g} m away; expected metres (millimetres?)"


def _distances_m(clip: MeasuredClip, number: int) -> Iterator[float]:
    scene = clip.scene(number)
    yield from (float(np.linalg.norm(each.box.center_m)) for each in scene.targets if each.box is not None)
    yield from (float(np.linalg.norm(p.eye_origin_left)) for p in scene.people if p.eye_origin_left is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipRow:
    """One clip of the list. ``frames`` is None if it cannot be opened; ``problem`` says why."""

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
    """The result of checking one clip; it can be used if there are no ``problems``.

    ``labels`` counts (frame, subject) pairs whose label is scored, None without an annotation file.
    ``vertical_error_px`` is the median row difference of matched points, None with too few of them. Without right
    images there are no ``baseline_m`` and no ``matches``. ``notes`` are further facts for the user: losses of the
    source, checks that were not possible, how much depth a sensor measured.
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
    """Return every clip that can be found, by name."""
    return [_row(name, path) for name, path in clip_files().items()]


@dataclass(frozen=True, slots=True, kw_only=True)
class AtHand:
    """The clips of the working directory, or of the package if there are none, whose data can be checked.

    ``without_data``: by environment variable, clips whose root needs one that is not set. ``packaged``: clips of the
    package that are left out, because the working directory has clips of its own.
    """

    clips: tuple[str, ...]
    without_data: dict[str, list[str]]
    packaged: tuple[str, ...]


def clips_at_hand() -> AtHand:
    """Return the clips that ``vfoa clips check`` checks by default; a manifest that cannot be read is included."""
    found = clip_files()
    own = {name: path for name, path in found.items() if path.parent == folders("datasets")[0]}
    here: list[str] = []
    without_data: dict[str, list[str]] = {}
    for name, path in (own or found).items():
        try:
            root = load_manifest(path, name).root or ""
        except VfoaError:
            root = ""
        if unset := unset_variables(root):
            without_data.setdefault(unset[0], []).append(name)
        else:
            here.append(name)
    packaged = tuple(name for name in found if own and name not in own)
    return AtHand(clips=tuple(here), without_data=without_data, packaged=packaged)


def check_clip(name_or_path: str, *, every_frame: bool = False) -> ClipCheck:
    """Open a clip, decode its first, middle and last frame, and check calibration, rectification and labels.

    With ``every_frame``, decode all frames, and count those that cannot be read. Of a clip of measurements, check every
    frame: that its names exist and that its positions are in metres.
    """
    name = Path(name_or_path).stem if name_or_path.endswith(".toml") else name_or_path
    unreadable: tuple[str, ...] = ()
    try:
        manifest = load_manifest(name_or_path)
        clip = manifest.open()
        unreadable = _unreadable(clip) if every_frame and not isinstance(clip, MeasuredClip) else ()
        frames = [] if isinstance(clip, MeasuredClip) else _sample(clip)
    except VfoaError as error:
        return ClipCheck(name=name, problems=unreadable or (str(error),))
    labels, label_problems = _labels(manifest, clip)
    if isinstance(clip, MeasuredClip):
        return ClipCheck(
            name=manifest.name,
            frames=len(clip.frames),
            labels=labels,
            notes=clip.notes,
            problems=(*measurement_problems(manifest, clip), *manifest_problems(manifest), *label_problems),
        )
    matching, rig = _check_matches(frames), frames[0].rig
    _, drawn_problems = _attempt(lambda: manifest.drawn(clip.frames))
    return ClipCheck(
        name=manifest.name,
        frames=len(clip.frames),
        size_px=(rig.width_px, rig.height_px),
        fx_px=rig.fx_px,
        baseline_m=None if matching.matches is None else rig.baseline_m,
        vertical_error_px=matching.error_px,
        matches=matching.matches,
        labels=labels,
        notes=(
            *clip.notes,
            *matching.notes,
            *depth_notes(frames),
            *near_notes(frames),
            *manifest_notes(manifest, clip),
        ),
        problems=(
            *unreadable,
            *_calibration_problems(frames, says_unit="calibration_unit" in manifest.source),
            *_image_problems(frames),
            *_depth_problems(frames),
            *matching.problems,
            *manifest_problems(manifest),
            *label_problems,
            *drawn_problems,
        ),
    )


def _attempt(read: Callable[[], Value]) -> tuple[Value | None, tuple[str, ...]]:
    """What ``read`` returns, or None and its error."""
    try:
        return read(), ()
    except VfoaError as error:
        return None, (str(error),)


def _unreadable(clip: Clip) -> tuple[str, ...]:
    """The frames that cannot be read: their number, each number, and the first error."""
    errors: dict[int, str] = {}
    for number in clip.frames:
        try:
            clip.frame(number)
        except VfoaError as error:
            errors[number] = str(error)
    if not errors:
        return ()
    first = next(iter(errors.values()))
    return (f"{len(errors)} of {len(clip.frames)} frames cannot be read: {', '.join(map(str, errors))}; {first}",)


def _row(name: str, path: Path) -> ClipRow:
    try:
        manifest = load_manifest(path, name)
    except VfoaError as error:
        return ClipRow(name=name, problem=str(error))
    clip, problems = _attempt(manifest.open)
    labels, label_problems = _labels(manifest, clip)
    return ClipRow(
        name=manifest.name,
        adapter=manifest.adapter,
        frames=None if clip is None else len(clip.frames),
        subjects=tuple(manifest.subjects),
        targets=tuple(manifest.targets),
        licence=manifest.licence,
        labels=labels,
        problem=next(iter((*problems, *label_problems)), None),
    )


def _labels(manifest: ClipManifest, clip: Clip | MeasuredClip | None) -> tuple[int | None, tuple[str, ...]]:
    """Number of (frame, subject) pairs with a label that is scored, and problems.

    If the clip cannot be opened, the rows' own lengths count.
    """
    labels, problems = _attempt(lambda: manifest.labels(None if clip is None else timeline_of(clip)))
    if labels is None:
        return None, problems
    if clip is None:
        scored = [each for each in labels.ranges if each.label.target != IGNORED]
        return sum(each.last_frame - each.first_frame + 1 for each in scored), ()
    return sum(1 for _, _, label in labels.labelled(clip.frames) if label.target != IGNORED), ()


def _sample(clip: Clip) -> list[StereoFrame]:
    """The first, middle and last frame, each once; reading the ground truth checks that it can be read."""
    if not clip.frames:
        raise VfoaError("the clip has no frames")
    numbers = first_middle_last(clip.frames)
    for number in numbers:
        clip.truth(number)
    return [clip.frame(number) for number in numbers]
