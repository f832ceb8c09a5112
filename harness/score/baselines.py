"""Scores of simple baselines on the same frames.

A clip on which a baseline does as well as the pipeline does not show that the pipeline works. Each baseline picks one
target of the frame's record, never the subject's own body. If it cannot pick (no such subject, no eye origin, nothing
with a box), it makes no prediction, which counts as wrong, as it does for the pipeline.

``commonest``  the commonest label of the other clips of the run, of the targets that this clip has; with one clip it
               cannot pick
``nearest``    the box whose centre is nearest to the eye origin
``largest``    the largest extent in the image; without images it cannot pick
``central``    the box whose centre is nearest to the camera's axis, by angle
``nearest_in_angle``  the box whose centre is nearest in angle to the measured gaze (to the head's direction without a
               gaze), or nothing if that angle is above a limit. The limit is the one that is best on the other
               clips of the run under the same configuration; with one clip there is none.
``constant``   the subject's commonest label in the clip's own labels: the best that any constant answer can do. It has
               seen the labels that it is scored on, so no method is judged by it; it says what a clip can show.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from harness.run.columns import NO_ID, UNKNOWN, LookColumns, SceneColumns
from vfoa.types import Codes, Flags, Float

BASELINES = {
    "commonest": "the commonest label of other clips",
    "nearest": "the object nearest to the eyes",
    "largest": "the object largest in the image",
    "central": "the object nearest to the camera's axis",
    "nearest_in_angle": "the object nearest in angle to the gaze",
    "constant": "the subject's commonest label",
}
"""Each baseline, in order, with its answer in words."""
SEES_LABELS = frozenset({"constant"})
"""Those that have seen the labels that they are scored on."""


def best_limit_rad(angles_rad: Float, hits: Flags, nowhere: Flags) -> float:
    """The limit of the angle that makes most frames right; the largest of equally good ones.

    Parameters
    ----------
    angles_rad, hits, nowhere
        By frame (n,): the smallest angle, whether its target is the true one, whether nothing is looked at.
    """
    known = np.isfinite(angles_rad)
    order = np.argsort(angles_rad[known], kind="stable")
    angles, gains = angles_rad[known][order], hits[known][order].astype(int) - nowhere[known][order]
    right = np.concatenate(([0], np.cumsum(gains)))
    is_cut = np.concatenate(([True], np.diff(angles) > 0, [True]))[: len(right)]  # equal angles stay together
    last = int(np.flatnonzero(is_cut & (right == right[is_cut].max()))[-1])
    if last == len(angles):
        return math.inf
    return float((angles[last] + angles[last - 1]) / 2) if last else -1.0


def commonest(counts: Mapping[str, int]) -> str | None:
    """The commonest label; of equally common ones the first by name; None without labels."""
    return min(counts, key=lambda name: (-counts[name], name), default=None)


def angle_rad(direction: Sequence[float], eyes: Sequence[float], center: Sequence[float]) -> float:
    """The angle between a direction and the way from the eyes to a centre, in radians."""
    towards = [end - start for end, start in zip(center, eyes, strict=True)]
    length = math.hypot(*towards) * math.hypot(*direction)
    cosine = sum(a * b for a, b in zip(direction, towards, strict=True)) / length if length else 1.0
    return math.acos(max(-1.0, min(1.0, cosine)))


class View:
    """A scene as matrices: P people by the K instances of their frames, NaN and UNKNOWN where there are fewer."""

    def __init__(self, scene: SceneColumns) -> None:
        rows = scene.instances_of(scene.person_at)
        self.firsts = scene.firsts[scene.person_at]
        self.is_there = rows != UNKNOWN
        self.names = np.append(scene.names, UNKNOWN)[rows]
        self.ids = np.append(scene.instance_ids, NO_ID)[rows]
        self.centers_m = np.append(scene.centers_m, np.full((1, 3), np.nan), axis=0)[rows]
        self.boxes_px = np.append(scene.boxes_px, np.full((1, 4), np.nan), axis=0)[rows]
        self.has_box = ~np.isnan(self.centers_m[..., 0])


class Picks:
    """What each baseline picks for each of P people: the place among the instances of the frame, UNKNOWN for none.

    ``picks`` (P, 4) are of ``nearest``, ``largest``, ``central`` and ``nearest_in_angle``; ``angles_rad`` (P,) are
    between the direction and the last one, NaN without it.
    """

    def __init__(self, scene: SceneColumns, looks: LookColumns) -> None:
        view = view_of(scene)
        self.directions = np.where(np.isnan(looks.gaze), looks.head, looks.gaze)
        is_other = view.is_there & (view.ids != scene.bodies[:, None])
        towards = view.centers_m - looks.eyes_m[:, None]
        far = _norm(view.centers_m)
        u0, v0, u1, v1 = np.moveaxis(view.boxes_px, -1, 0)
        off_axis = -view.centers_m[..., 2] / np.where(far == 0, np.inf, far)
        self.picks = np.stack(
            [
                _least(_norm(towards), is_other, view.ids, share=SHARE),
                _least(-(u1 - u0) * (v1 - v0), is_other, view.ids),
                _least(off_axis, is_other, view.ids, margin=COSINE),
                _least(-_cosine(self.directions[:, None], towards), is_other, view.ids, margin=COSINE),
            ],
            axis=1,
        )
        self.angles_rad = np.full(len(self.picks), np.nan)
        known = np.flatnonzero(self.picks[:, 3] != UNKNOWN)
        directions, eyes, centers = (
            self.directions[known],
            looks.eyes_m[known],
            view.centers_m[known, self.picks[known, 3]],
        )
        self.angles_rad[known] = [*map(angle_rad, directions.tolist(), eyes.tolist(), centers.tolist())]


view_of = lru_cache(maxsize=4)(View)
picks_of = lru_cache(maxsize=4)(Picks)

SHARE, COSINE = 1e-9, 1e-12
"""Distances that differ by a smaller share, and cosines by less, are equal but for rounding."""


def _norm(vectors: Float) -> Float:
    return np.asarray(np.sqrt((vectors**2).sum(axis=-1)))


def _cosine(directions: Float, towards: Float) -> Float:
    """Cosines of angles; 1 of a vector without a length."""
    lengths = _norm(towards) * _norm(directions)
    with np.errstate(invalid="ignore", divide="ignore"):
        cosines = (directions * towards).sum(axis=-1) / lengths
    return np.where(lengths == 0, 1.0, cosines).clip(-1, 1)


def _least(values: Float, is_other: Flags, ids: NDArray[np.int64], *, share: float = 0.0, margin: float = 0.0) -> Codes:
    """The place of the least known value in each row, of equal ones that of the lower id; UNKNOWN without one.

    Those are equal that are larger by at most this share of it and this margin.
    """
    known = np.where(is_other & ~np.isnan(values), values, np.inf)
    least = known.min(axis=1, keepdims=True)
    least[np.isinf(least)] = 0
    is_least = known <= least + np.abs(least) * share + margin
    places = np.where(is_least, ids, np.iinfo(np.int64).max).argmin(axis=1)
    return np.where(is_least.any(axis=1), places, UNKNOWN)
