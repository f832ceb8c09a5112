"""Check whether a clip can be used: files, calibration, rectification, depth, labels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from harness.clips.camera import camera_notes, camera_problems
from harness.clips.check_measured import direction_notes, measurement_problems
from harness.clips.listing import attempt, labels_of, scored_labels
from harness.clips.manifest import ClipManifest, load_manifest, manifest_notes
from harness.clips.matching import (
    ROWS_FRAMES,
    MovingRows,
    first_middle_last,
    matched_offsets_px,
    motion,
    near_notes,
    right_offset,
)
from harness.clips.units import clip_doubts, step_doubts
from harness.labels.drawn_shapes import Drawn, Place
from harness.sources import Clip, MeasuredClip
from harness.sources.media.images import greatest_values
from vfoa.errors import VfoaError, counted
from vfoa.stereo.block_matching_settings import BlockMatchingSettings
from vfoa.types import Float, Image, StereoFrame

MAX_VERTICAL_ERROR_PX = 1.5
"""Median row difference of matched points above which block matching along rows fails."""

DOUBTED_ROWS_PX = 0.5
"""Median row difference from which the images are also tried as if they were rectified already."""

MIN_MATCHES = 30
"""Fewer matches do not allow a check of rectification."""

MIN_DEPTH_M, MAX_DEPTH_M = 0.05, 200.0
"""A median measured depth outside of this range is probably in another unit."""

_OTHER_UNIT = "another unit? depth_scale in [source] is the number of counts per metre"

DARK = 16
"""Images no brighter than this are reported: of 12-bit values in 16-bit files, the upper 8 bits reach 15."""

MOST_BITS_NOTED = 14
"""Most bits of 16-bit pictures that are noted: 15 lose one bit, as a dark scene of 16 bits does."""


def _image_problems(frames: Sequence[StereoFrame]) -> Iterator[str]:
    """Images that decode but cannot be right: the same on both sides, or nearly black."""
    if same := [frame for frame in frames if frame.right is not None and np.array_equal(frame.left, frame.right)]:
        yield f"frame {_listed(same)}: left and right are the same image; expected two views"
    brightest = max(int(image.max()) for frame in frames for image in (frame.left, frame.right) if image is not None)
    if brightest <= DARK:
        yield (
            f"the brightest value of {len(frames)} frames is {brightest} of 255; expected brighter images "
            "(10 or 12 bits in 16-bit files? scale them to 8 bits)"
        )


def _picture_bits_notes(greatest: Sequence[int]) -> Iterator[str]:
    """A note, with what to do, if the greatest of 16-bit values need fewer bits: of 12, cutting to 8 keeps 4."""
    most = max(greatest, default=0)
    if 0 < (bits := most.bit_length()) <= MOST_BITS_NOTED:
        factor = 2 ** (16 - bits)
        yield (
            f"the 16-bit pictures use {bits} bits (the greatest value found is {most}): of these, the 8 bits that "
            f"are read keep {max(0, bits - 8)}; multiply the values by {factor} before they are saved (files: "
            f"cv2.imwrite(file, cv2.imread(file, cv2.IMREAD_UNCHANGED) * {factor}))"
        )


def _listed(frames: Sequence[StereoFrame]) -> str:
    return ", ".join(str(frame.index) for frame in frames)


def _offsets_px(frames: Sequence[StereoFrame]) -> Float:
    """Disparities and row differences (N, 2) of points that are matched between left and right."""
    offsets = [
        matched_offsets_px(frame.left, frame.right) + np.array([frame.rig.cx_right_px - frame.rig.cx_px, 0])
        for frame in frames
        if frame.right is not None
    ]
    return np.concatenate([np.empty((0, 2)), *offsets])


def _matching_problems(error_px: float, disparity_px: float) -> Iterator[str]:
    """Rows that do not match, and negative disparities: points before the cameras are further right in the left image.

    Both are medians over the matched points.
    """
    if error_px > MAX_VERTICAL_ERROR_PX:
        expected = f"expected at most {MAX_VERTICAL_ERROR_PX} in a rectified pair"
        yield f"matched points lie {error_px:.1f} rows apart (median); {expected}"
    if disparity_px < 0:
        yield (
            f"matched points have a disparity of {disparity_px:.1f} px (median); expected a positive one "
            "(left and right swapped? exchange left = and right = in [source]; of packed views: swap = true)"
        )


_OTHER_READINGS = {
    "rectified": "in the images as they are in the files, and {:.1f} once rectified: if they were rectified before",
    "fisheye": "with the calibration read as that of fisheye lenses, and {:.1f} as it is: if it is of cv2.fisheye",
}
"""Settings of the calibration, and the end of a note that proposes each."""


def _rows_notes(manifest: ClipManifest, error_px: float) -> Iterator[str]:
    """A note for each other reading of the calibration with which rows agree twice as well.

    The program of a camera may have rectified its images; four coefficients may be of a fisheye lens. ``error_px`` is
    the median row difference as it is.
    """
    if error_px < DOUBTED_ROWS_PX:
        return
    for setting, words in _OTHER_READINGS.items():
        other = manifest.model_copy(update={"source": {**manifest.source, setting: True}})
        frames, _ = attempt(partial(_sample_of, other))  # None of a source without the setting
        offsets = _offsets_px(frames or ())
        if len(offsets) >= MIN_MATCHES and (own_px := _rows_apart_px(offsets)) < error_px / 2:
            seen = f"matched points lie {own_px:.1f} rows apart {words.format(error_px)}"
            yield f"{seen}, say {setting} = true in [source]"


def _rows_apart_px(offsets: Float) -> float:
    """The median row difference of matched points (N, 2)."""
    return float(np.median(np.abs(offsets[:, 1])))


QUICK_FRAMES, QUICK_OFFSET, MOST_OFFSET = 48, 16, 1500
"""Frames in the middle of a clip in which motion is compared, and the offsets that are tried there and over all."""


def _time_notes(manifest: ClipManifest, clip: Clip, changes: Float, most: int) -> Iterator[str]:
    """A note if the right views are not of the time of the left ones, by the motion (2, N) in both, or by its rows."""
    by = right_offset(changes, min(most, changes.shape[1] // 2))
    if by is None and changes.shape[1] >= ROWS_FRAMES:
        spans = [(span, MovingRows(partial(_pair, clip, span))) for span in _stretches(clip.frames)]
        if all(attempt(rows.agree)[0] is not False for _, rows in spans):  # None: a frame that cannot be read
            return
        known = [(offset, span) for span, rows in spans if (offset := attempt(rows.offset)[0]) is not None]
        if len({offset for offset, _ in known}) > 1:
            parts = ", ".join(f"{_later(offset)} in frames {span[0]} to {span[-1]}" for offset, span in known)
            yield (
                f"what moves in the left view moves in the right one {parts}: a camera lost images in between; pair "
                "them by times (stamps), or make a clip of each part"
            )
            return
        by = next((offset for offset, _ in known), 0)
    if not by:
        return
    seen = f"what moves in the left view moves {_later(by)} in the right one"
    if manifest.source.get("layout") in ("videos", "images") and "stamps" not in manifest.source:
        later = -by if manifest.source.get("swap") else by  # of the files called right, which show the left view then
        yield f"{seen}: say right_offset = {manifest.source.get('right_offset', 0) + later} in [source]"
    else:
        yield f"{seen}: are the stamps or numbers of both cameras of one clock?"


def _pair(clip: Clip, numbers: Sequence[int], place: int) -> tuple[Image, Image]:
    """Both views of one of these frames."""
    frame = clip.frame(numbers[place])
    if frame.right is None:
        raise VfoaError(f"frame {frame.index}: found no right view; expected one")
    return frame.left, frame.right


def _later(by: int) -> str:
    """By how many frames something is later."""
    if by == 0:
        return "at the same time"
    return f"{counted(abs(by), 'frame')} {'later' if by > 0 else 'earlier'}"


def _stretches(numbers: Sequence[int]) -> list[Sequence[int]]:
    """Frames that follow each other: the first, middle and last ones of a clip, or of a short one those in the middle.

    A camera that loses an image in between is out of step from there on.
    """
    middle = _middle(numbers, ROWS_FRAMES)
    return [middle] if len(numbers) < 3 * ROWS_FRAMES else [numbers[:ROWS_FRAMES], middle, numbers[-ROWS_FRAMES:]]


def depth_notes(frames: Sequence[StereoFrame]) -> Iterator[str]:
    """Share of the image with measured depth, and its range."""
    known = _known_depths_m(frames)
    if known.size == 0:
        return
    near, middle, far = np.percentile(known, (1, 50, 99))
    limit_m = BlockMatchingSettings().min_depth_m
    if far < limit_m:
        yield f"nearly all of the measured depth is nearer than {limit_m:g} m ({_OTHER_UNIT})"
    share = known.size / sum(frame.depth_m.size for frame in frames if frame.depth_m is not None)
    yield (
        f"measured depth on {share:.0%} of the pixels: {near:.2f} to {far:.2f} m (1st to 99th percentile), "
        f'median {middle:.2f} m; stereo.matcher = "sensor" takes it'
    )


def _depth_problems(frames: Sequence[StereoFrame]) -> Iterator[str]:
    """Measured maps without a value, or with values that suggest another unit."""
    measured = [frame for frame in frames if frame.depth_m is not None]
    if empty := [frame for frame in measured if not _known_depths_m([frame]).size]:
        yield f"frame {_listed(empty)}: no pixel has a measured depth"
    known = _known_depths_m(measured)
    if known.size and not MIN_DEPTH_M <= (median_m := np.median(known)) <= MAX_DEPTH_M:
        expected = f"expected {MIN_DEPTH_M:g} to {MAX_DEPTH_M:g} m ({_OTHER_UNIT})"
        yield f"the median measured depth is {median_m:.3g} m; {expected}"


def _known_depths_m(frames: Sequence[StereoFrame]) -> Float:
    depths = [frame.depth_m[np.isfinite(frame.depth_m)] for frame in frames if frame.depth_m is not None]
    return np.concatenate([np.zeros(0), *depths])


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


def check_clip(name_or_path: str, *, every_frame: bool = False) -> ClipCheck:
    """Open a clip, decode its first, middle and last frame, and check calibration, rectification and labels.

    Of a pair, also decode up to 48 frames in the middle, for the motion in both views; with ``every_frame``, decode all
    frames. Those of them that cannot be read are counted and named. Of a clip of measurements, check every frame: that
    its names exist and that its positions are in metres.
    """
    name = Path(name_or_path).stem if name_or_path.endswith(".toml") else name_or_path
    unreadable: tuple[str, ...] = ()
    try:
        manifest = load_manifest(name_or_path)
        clip = manifest.open()
        if every_frame and not isinstance(clip, MeasuredClip):
            changes, unreadable = _moving(clip, clip.frames)
        with greatest_values() as greatest:
            frames = [] if isinstance(clip, MeasuredClip) else _sample(clip)
    except VfoaError as error:
        return ClipCheck(name=name, problems=unreadable or (str(error),))
    labels, label_problems = labels_of(manifest, clip)
    if isinstance(clip, MeasuredClip):
        return ClipCheck(
            name=manifest.name,
            frames=len(clip.frames),
            labels=scored_labels(labels, clip),
            notes=(*clip.notes, *clip_doubts(clip, clip.frames), *direction_notes(manifest, clip, labels)),
            problems=(*measurement_problems(manifest, clip), *label_problems),
        )
    rig, has_right = frames[0].rig, any(frame.right is not None for frame in frames)
    if not every_frame:
        is_asked = has_right and manifest.adapter != "studio"  # rendered views are of one time
        changes, unreadable = _moving(clip, _middle(clip.frames) if is_asked else ())
    offsets = _offsets_px(frames)
    is_matched = len(offsets) >= MIN_MATCHES
    disparity_px = float(np.median(offsets[:, 0])) if is_matched else 0.0
    error_px = _rows_apart_px(offsets) if is_matched else 0.0
    few = f"{len(offsets)} points were matched between left and right; rectification is checked from {MIN_MATCHES} on"
    drawn, drawn_problems = attempt(lambda: manifest.drawn(clip.frames))
    return ClipCheck(
        name=manifest.name,
        frames=len(clip.frames),
        size_px=(rig.width_px, rig.height_px),
        fx_px=rig.fx_px,
        baseline_m=rig.baseline_m if has_right else None,
        vertical_error_px=error_px if is_matched else None,
        matches=len(offsets) if has_right else None,
        labels=scored_labels(labels, clip),
        notes=(
            *clip.notes,
            *step_doubts(clip),
            *([few] if has_right and not is_matched else []),
            *dict.fromkeys(note for frame in frames for note in camera_notes(frame.rig)),
            *_rows_notes(manifest, error_px),
            *_time_notes(manifest, clip, changes, MOST_OFFSET if every_frame else QUICK_OFFSET),
            *_picture_bits_notes(greatest),
            *depth_notes(frames),
            *near_notes(frames),
            *manifest_notes(manifest, clip),
        ),
        problems=(
            *unreadable,
            *camera_problems(frames, manifest),
            *_image_problems(frames),
            *_depth_problems(frames),
            *_matching_problems(error_px, disparity_px),
            *label_problems,
            *drawn_problems,
            *_unseen_problems(drawn, (rig.width_px, rig.height_px)),
        ),
    )


def _unseen_problems(drawn: Drawn | None, size_px: tuple[int, int]) -> Iterator[str]:
    """Drawn shapes that no key frame shows in the image: of pictures of another size, or not in pixels."""
    for track in drawn.tracks if drawn else ():
        if not any(_is_seen(key.place, size_px) for key in track.keys if not key.outside):
            yield (
                f"drawn: the {track.kind} of {track.name!r} covers no whole pixel of the image in any key frame; "
                f"expected pixels of the left image of {size_px[0]} x {size_px[1]}"
            )


def _is_seen(place: Place, size_px: tuple[int, int]) -> bool:
    """Whether the image shows a point, or a pixel or more of a box in both directions."""
    first, last = place[:2], place[-2:]
    least_px = 0 if len(place) == 2 else 1
    return all(
        min(end, size) - max(begin, 0) >= least_px for begin, end, size in zip(first, last, size_px, strict=True)
    )


def _middle(numbers: Sequence[int], count: int = QUICK_FRAMES) -> Sequence[int]:
    """Frames that follow each other, in the middle of a clip."""
    begin = max(len(numbers) - count, 0) // 2
    return numbers[begin : begin + count]


def _moving(clip: Clip, numbers: Sequence[int]) -> tuple[Float, tuple[str, ...]]:
    """The motion in these frames, and those that cannot be read: how many, each number, and the first error."""
    errors: dict[int, str] = {}

    def read(number: int) -> StereoFrame | None:
        try:
            return clip.frame(number)
        except VfoaError as error:
            errors[number] = str(error)
            return None

    changes = motion(map(read, numbers))
    if not errors:
        return changes, ()
    first = next(iter(errors.values()))
    return changes, (f"{len(errors)} of {len(numbers)} frames cannot be read: {', '.join(map(str, errors))}; {first}",)


def _sample_of(manifest: ClipManifest) -> list[StereoFrame]:
    return _sample(manifest.open_images())


def _sample(clip: Clip) -> list[StereoFrame]:
    """The first, middle and last frame, each once; reading the ground truth checks that it can be read."""
    if not clip.frames:
        raise VfoaError("the clip has no frames")
    numbers = first_middle_last(clip.frames)
    for number in numbers:
        clip.truth(number)
    return [clip.frame(number) for number in numbers]
