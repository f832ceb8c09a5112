"""What both views show: points on common rows, objects too near for stereo matching, and motion at the same time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from vfoa.stereo.block_matching_settings import BlockMatchingSettings
from vfoa.types import Float, Image, StereoFrame

MATCHED_SIDE_PX = 2048
"""Larger images are reduced before matching: an 8K pair would need 8 GB."""


def matched_offsets_px(left: Image, right: Image) -> Float:
    """Offsets of points found in both images, (N, 2): columns (their disparity) and rows, left minus right.

    The rows are 0 in a perfectly rectified pair. SIFT features; a match must be mutual and clearly better than the
    second best (Lowe's ratio). Both images have the same size.
    """
    factor = _factor(left)
    points = _matched(_features(_shrunk_gray(left, factor)), _features(_shrunk_gray(right, factor)))
    return factor * (points[:, 0] - points[:, 1])


_Features = tuple[Float, cv2.typing.MatLike | None]
"""Places (N, 2), columns and rows, and descriptors; None for no feature."""


def _factor(image: Image, side_px: int = MATCHED_SIDE_PX) -> int:
    return math.ceil(max(image.shape) / side_px)


def _features(gray: NDArray[np.uint8], most: int = 2000) -> _Features:
    points, found = cv2.SIFT.create(nfeatures=most).detectAndCompute(gray, None)
    return np.array([point.pt for point in points], np.float64).reshape(-1, 2), found


def _matched(left: _Features, right: _Features, within: NDArray[np.bool_] | None = None) -> Float:
    """Places (N, 2, 2) of the features that are found in both images, in the left and in the right one.

    ``within`` (H, W) are the pixels of the left image whose features are matched; None: all.
    """
    (places_left, found_left), (places_right, found_right) = left, right
    if found_left is None or found_right is None or min(len(found_left), len(found_right)) < 2:
        return np.empty((0, 2, 2))
    columns, rows = places_left.astype(int).T
    asked = np.arange(len(found_left)) if within is None else np.flatnonzero(within[rows, columns])
    there = _nearest(found_left[asked], found_right, 2)
    clear = [
        (int(asked[best.queryIdx]), best.trainIdx) for best, second in there if best.distance < 0.7 * second.distance
    ]
    back = _nearest(found_right[[place for _, place in clear]], found_left, 1)
    pairs = [
        (places_left[one], places_right[other])
        for (one, other), (match,) in zip(clear, back, strict=True)
        if match.trainIdx == one
    ]
    return np.array(pairs, dtype=np.float64).reshape(-1, 2, 2)


def _nearest(of: cv2.typing.MatLike, among: cv2.typing.MatLike, count: int) -> Sequence[Sequence[cv2.DMatch]]:
    """The nearest descriptors of each, the best first."""
    return cv2.BFMatcher(cv2.NORM_L2).knnMatch(of, among, k=count) if len(of) else ()


def _shrunk_gray(image: Image, factor: int) -> NDArray[np.uint8]:
    """The gray image with each square of ``factor`` pixels averaged; incomplete squares at the edges are dropped."""
    gray = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    height, width = (max(1, size // factor) for size in gray.shape)
    whole = gray[: height * factor, : width * factor]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8)


LEAST_SHARE = 0.02
"""Least share of matches nearer than a limit: noise reaches 0.012 in 22 rendered and real frames without near objects.
"""

_WIDTH_PX = 320
_SEARCHED = 0.6
_BLOCK_PX = 5
_MARGIN = 0.9
_DEFAULT_M: float = BlockMatchingSettings().min_depth_m


def near_notes(frames: Sequence[StereoFrame], min_depth_m: float = _DEFAULT_M) -> list[str]:
    """A note if a limit (by default the matchers' own) excludes objects in these frames.

    The note proposes a limit that 99 % of the matches are beyond. There is no note if matches are too few, or without
    right images.
    """
    depths_m = np.concatenate([np.empty(0), *(_matched_depths_m(frame) for frame in frames if frame.right is not None)])
    if not depths_m.size or (share := float((depths_m < min_depth_m).mean())) < LEAST_SHARE:
        return []
    nearest_m = _MARGIN * float(np.percentile(depths_m, 1))
    digits = 2 - math.ceil(math.log10(nearest_m))
    proposed_m = math.floor(nearest_m * 10**digits) / 10**digits
    return [
        f"{share:.0%} of the matches are nearer than stereo.min_depth_m = {min_depth_m:g}, which leaves them without "
        f"depth; --set stereo.min_depth_m={proposed_m:g} reaches them"
    ]


def first_middle_last(frames: Sequence[int]) -> list[int]:
    """Up to three of a clip's frame numbers, each once, for checks."""
    return sorted({frames[0], frames[len(frames) // 2], frames[-1]}) if frames else []


def _matched_depths_m(frame: StereoFrame) -> Float:
    """Depths (N,) of the pixels that a coarse semi-global match finds in both views, at about 320 columns."""
    factor = max(1, math.ceil(frame.rig.width_px / _WIDTH_PX))
    width = max(1, frame.rig.width_px // factor)
    searched = 16 * max(1, math.ceil(_SEARCHED * width / 16))
    first = math.floor((frame.rig.cx_px - frame.rig.cx_right_px) / factor)  # the disparity of infinity
    # OpenCV does not match the columns at the edges, as many as it searches to either side
    before, after = max(first + searched, 0), max(-first, 0)
    left, right = (
        cv2.copyMakeBorder(_shrunk_gray(image, factor), 0, 0, before, after, cv2.BORDER_REPLICATE)
        for image in (frame.left, frame.right)
        if image is not None
    )
    matcher = cv2.StereoSGBM.create(
        minDisparity=first,
        numDisparities=searched,
        blockSize=_BLOCK_PX,
        P1=8 * _BLOCK_PX**2,
        P2=32 * _BLOCK_PX**2,
        disp12MaxDiff=1,
        preFilterCap=63,
        uniquenessRatio=15,
        speckleWindowSize=60,
        speckleRange=2,
    )
    disparity_px = matcher.compute(left, right)[:, before : before + width].astype(np.float64) / 16
    columns_right = np.arange(width) - disparity_px
    known = (disparity_px > first) & (columns_right >= 0) & (columns_right <= width - 1)
    shifted_px = factor * disparity_px[known] + frame.rig.cx_right_px - frame.rig.cx_px
    return frame.rig.fx_px * frame.rig.baseline_m / shifted_px[shifted_px > 0]


# Motion: what moves is seen to move in both views, in the same frames

MOTION_SIDE_PX = 160
"""Images are shrunk by a whole number, to at least this length of the longer side."""
LEAST_AGREEMENT, LEAST_MORE = 0.8, 0.15
"""Least correlation of the motion in both views at an offset, and how much larger it is there than at none."""
LEAST_CHANGE = 0.15
"""Least relative standard deviation of the motion: noise alone is the same in every frame."""
LEAST_IN_COMMON = 24
"""Least number of frames that both views have at an offset."""


def motion(frames: Iterable[StereoFrame | None]) -> Float:
    """Mean change (2, N) of gray values from each frame to the next, left and right; NaN beside unknown frames.

    Frames follow each other without gaps; None for one that cannot be read. All pairs have both views.
    """
    changes, before = list[tuple[float, float]](), None
    for frame in frames:
        now = None
        if frame is not None and frame.right is not None:
            factor = max(1, max(frame.left.shape) // MOTION_SIDE_PX)
            now = tuple(_shrunk_gray(image, factor) for image in (frame.left, frame.right))
        if before is not None and now is not None:
            left, right = (float(cv2.absdiff(*views).mean()) for views in zip(before, now, strict=True))
            changes.append((left, right))
        else:
            changes.append((np.nan, np.nan))
        before = now
    return np.array(changes[1:], np.float64).reshape(-1, 2).T


def right_offset(changes: Float, most: int) -> int | None:
    """By how many frames the right views are later in their film, at most ``most``; None if nothing says so.

    ``changes`` (2, N) are those of :func:`motion`. At -3, the right view of a frame shows what the left one shows 3
    frames later.
    """
    agreements = {by: _agreement(changes, by) for by in range(-most, most + 1)}
    best = max(agreements, key=lambda by: (agreements[by], -abs(by)))
    is_shown = agreements[best] >= LEAST_AGREEMENT and agreements[best] >= agreements[0] + LEAST_MORE
    return best if best and is_shown else None


def _agreement(changes: Float, by: int) -> float:
    """Correlation of the motion on the left with that on the right ``by`` frames later; 0 where too little moves."""
    left, right = changes[0, max(-by, 0) :], changes[1, max(by, 0) :]
    size = min(len(left), len(right))
    both = np.stack([left[:size], right[:size]])
    both = both[:, np.isfinite(both).all(axis=0)]
    if both.shape[1] < LEAST_IN_COMMON or (both.std(axis=1) <= LEAST_CHANGE * both.mean(axis=1)).any():
        return 0.0
    return float(np.corrcoef(*both)[0, 1])


# Rows: what moves up or down is on the same rows in both views only if they are of the same time

ROWS_FRAMES = 15
"""Number of frames, which follow each other, that are compared."""
_ROWS_SIDE_PX, _ROWS_FEATURES = 1024, 800
_MOST_ROWS_OFFSET = 2
_LEFTS = (4, 7, 10)
_LEAST_MOVED, _MOVED_GRAY, _MOVED_PX = 60, 6, 9
"""Least number of points that move, and how much the gray values about them change in two frames."""
LEAST_ROWS_PX, LEAST_BETTER = 0.3, 2.0
"""Least median row difference that is doubted, and how many times smaller it is at another offset.

In bandage_2, 0.09 px at the true offset; one frame beside it 1.2, two 1.8 to 2.3.
"""


class MovingRows:
    """The rows of points that move, in frames that follow each other: they tell by how many frames one view is late.

    Motion that is as fast in each frame does not tell the two times apart by how much moves, but by where it is.
    """

    def __init__(self, pair: Callable[[int], tuple[Image, Image]]) -> None:
        """``pair`` reads the left and the right view of a frame, from 0 to below :data:`ROWS_FRAMES`, if needed."""
        self._grays = cache(lambda place: _grays(pair(place), _ROWS_SIDE_PX))
        self._apart_px = cache(self._measured_px)
        self._features = cache(lambda place, side: _features(self._grays(place)[side], _ROWS_FEATURES))

    def agree(self) -> bool:
        """Whether nothing speaks against the times as they are: most costs of :meth:`offset` are saved then."""
        apart_px = self._apart_px(0)
        return len(apart_px) < _LEAST_MOVED or float(np.median(apart_px)) < LEAST_ROWS_PX

    def offset(self) -> int | None:
        """As :func:`right_offset`, by at most two frames; None if the rows do not tell."""
        reach = range(-_MOST_ROWS_OFFSET - 1, _MOST_ROWS_OFFSET + 2)
        apart_px = {by: self._apart_px(by) for by in reach}
        if min(map(len, apart_px.values())) < _LEAST_MOVED:
            return None
        median_px = {by: float(np.median(of_offset)) for by, of_offset in apart_px.items()}
        best = min(reach[1:-1], key=lambda by: median_px[by])
        worse = min(median_px[by] for by in (0, best - 1, best + 1) if by != best)
        return best if worse >= max(LEAST_ROWS_PX, LEAST_BETTER * median_px[best]) else None

    def _measured_px(self, by: int) -> Float:
        """The row differences (N,) of points that move, in left views and the right ones so many frames later."""
        for place in range(_LEFTS[0] + min(by, -1), _LEFTS[-1] + max(by, 1) + 1):
            self._grays(place)  # in their order: to go back in a film takes as long as all pictures from a key frame on
        found = [np.empty(0)]
        for place in _LEFTS:
            moved = _moved(self._grays(place - 1)[0], self._grays(place + 1)[0])
            if not moved.any():
                continue
            points = _matched(self._features(place, 0), self._features(place + by, 1), moved)
            found.append(np.abs(points[:, 0, 1] - points[:, 1, 1]))
        return np.concatenate(found)


def _grays(views: tuple[Image, Image], side_px: int) -> list[NDArray[np.uint8]]:
    """Both views in gray, shrunk to at most this side."""
    return [_shrunk_gray(view, _factor(view, side_px)) for view in views]


def _moved(before: NDArray[np.uint8], after: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """The pixels (H, W) about which two images differ."""
    return np.asarray(cv2.blur(cv2.absdiff(before, after), (_MOVED_PX, _MOVED_PX)) > _MOVED_GRAY)
