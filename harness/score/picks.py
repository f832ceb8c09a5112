"""What each baseline picks for every person of a clip, as :func:`harness.score.baselines.choose_among` does for one."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.run.columns import NO_ID, UNKNOWN, LookColumns, SceneColumns
from harness.score.baselines import angle_rad, choose_among
from vfoa.types import Codes, Flags, Float


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

    ``picks`` (P, 4) are in the order of :class:`harness.score.baselines.Choices`; ``angles_rad`` (P,) as there.
    """

    def __init__(self, scene: SceneColumns, looks: LookColumns) -> None:
        view = view_of(scene)
        self.directions = np.where(np.isnan(looks.gaze), looks.head, looks.gaze)
        is_other = view.is_there & (view.ids != scene.bodies[:, None])
        towards = view.centers_m - looks.eyes_m[:, None]
        far = _norm(view.centers_m)
        u0, v0, u1, v1 = np.moveaxis(view.boxes_px, -1, 0)
        off_axis = -view.centers_m[..., 2] / np.where(far == 0, np.inf, far)
        picks, is_tie = zip(
            _least(_norm(towards), is_other, view.ids, share=_SHARE),
            _least(-(u1 - u0) * (v1 - v0), is_other, view.ids),
            _least(off_axis, is_other, view.ids, margin=_COSINE),
            _least(-_cosine(self.directions[:, None], towards), is_other, view.ids, margin=_COSINE),
            strict=True,
        )
        self.picks = np.stack(picks, axis=1)
        for row in np.flatnonzero(np.any(is_tie, axis=0)).tolist():  # decided as for one frame, to the last bit
            self.picks[row] = _chosen(view, looks, self.directions, row, np.flatnonzero(is_other[row]))
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

_SHARE, _COSINE = 1e-9, 1e-12
"""Distances that differ by a smaller share, and cosines by less, are equal but for rounding."""


def _norm(vectors: Float) -> Float:
    return np.asarray(np.sqrt((vectors**2).sum(axis=-1)))


def _cosine(directions: Float, towards: Float) -> Float:
    """Cosines of angles; 1 of a vector without a length."""
    lengths = _norm(towards) * _norm(directions)
    with np.errstate(invalid="ignore", divide="ignore"):
        cosines = (directions * towards).sum(axis=-1) / lengths
    return np.where(lengths == 0, 1.0, cosines).clip(-1, 1)


def _least(
    values: Float, is_other: Flags, ids: NDArray[np.int64], *, share: float = 0.0, margin: float = 0.0
) -> tuple[Codes, Flags]:
    """The place of the least known value in each row, of equal ones that of the lower id; UNKNOWN without one.

    And whether rounding decides: another one is larger by at most this share of it and this margin.
    """
    known = np.where(is_other & ~np.isnan(values), values, np.inf)
    least = known.min(axis=1, keepdims=True)
    is_found = least[:, 0] < np.inf
    least[~is_found] = 0
    places = np.where(known == least, ids, np.iinfo(np.int64).max).argmin(axis=1)
    as_small = known <= least + np.abs(least) * share + margin
    return np.where(is_found, places, UNKNOWN), (as_small.sum(axis=1) > 1) & (share + margin > 0)


def _chosen(view: View, looks: LookColumns, directions: Float, row: int, others: Codes) -> list[int]:
    """The positions, among the targets of a frame, that the baselines pick for one person."""
    ids = view.ids[row].tolist()
    things = [
        (ids[place], _known(view.centers_m[row, place]), _known(view.boxes_px[row, place])) for place in others.tolist()
    ]
    picks = choose_among(things, _known(looks.eyes_m[row]), _known(directions[row]))[:4]
    return [UNKNOWN if pick is None else ids.index(pick) for pick in picks]


def _known(values: Float) -> Any:
    """A vector as plain numbers; None if it is not known."""
    return None if np.isnan(values[0]) else tuple(values.tolist())
