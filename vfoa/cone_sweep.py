"""The focus under thousands of cone settings at once, for little more than the cost of casting their rays.

Settings that differ only in their weights, or in the cones that they combine, share rays. Every distinct cone is cast
and scored once per cue. One matrix product sums the scores of cones to shares, another one the shares to totals.
:func:`vfoa.attention.pay_attention` defines the result; this module computes the same for all settings together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from vfoa.attention import (
    AttentionSettings,
    boxes_of_others,
    cue_weights,
    first_hits,
    pay_attention,
    pencil,
    score_rays,
)
from vfoa.geometry import entry_distance, left_from_crop
from vfoa.types import CUES, Box3D, Cue, Float, Rays, Subject, Target

T = TypeVar("T")

NOWHERE = 0
"""The focus of a subject who looks at nothing; instance ids begin at 1."""

UNKNOWN = -1
"""The focus where there is no attention at all: no eye origin, or no usable direction."""

_TIE = 1e-9
"""Totals whose relative difference is smaller may be equal but for rounding."""

_Bundle = tuple[float, int, bool]
"""A hollow cone: full apex angle (rad), number of rays on the surface, and whether one ray goes along the axis."""


class ConeSweep:
    """Evaluates many settings of :func:`vfoa.attention.pay_attention` together.

    Parameters
    ----------
    settings
        In any order; repetitions are allowed. Answers come in the same order.
    """

    def __init__(self, settings: Sequence[AttentionSettings]) -> None:
        self._settings = tuple(settings)
        joined = [_bundles(each) for each in self._settings]
        bundles = _distinct([bundle for bundles in joined for bundle in bundles])
        joins, self._join_of = _numbered(joined)
        self._occlusions, self._occlusion_of = _numbered([each.occlusion for each in self._settings])
        self._weightings, self._weighting_of = _numbered([each.weighting for each in self._settings])

        rays = [pencil((fov,), n_rays, axis_ray)[0] for fov, n_rays, axis_ray in bundles]
        self._rays = np.concatenate(rays)
        self._first_ray = np.cumsum([0, *(len(each) for each in rays[:-1])])
        column = {bundle: number for number, bundle in enumerate(bundles)}
        self._join = np.zeros((len(joins), len(bundles)))
        for row, members in enumerate(joins):
            for bundle in members:
                self._join[row, column[bundle]] += 1 / sum(len(rays[column[each]]) for each in members)

    def foci(self, subject: Subject, targets: tuple[Target, ...]) -> NDArray[np.int64]:
        """The focus under each of S settings (S,): an instance id, :data:`NOWHERE` or :data:`UNKNOWN`."""
        axes = {cue: axis for cue in CUES if (axis := subject.direction(cue)) is not None}
        if subject.person.eye_origin_left is None or not axes:
            return np.full(len(self._settings), UNKNOWN)
        boxes = boxes_of_others(subject, targets)
        weights = [cue_weights(axes, weighting) for weighting in self._weightings]
        known = np.array([bool(each) for each in weights])[self._weighting_of]
        if not boxes:
            return np.where(known, NOWHERE, UNKNOWN)

        by_cue = np.array([[each.get(cue, 0.0) for cue in axes] for each in weights])
        shares = self._shares(subject.person.eye_origin_left, axes, tuple(boxes.values()))
        totals = np.einsum("wc,cojt->wojt", by_cue, shares)
        picked = totals[self._weighting_of, self._occlusion_of, self._join_of]
        most = picked.max(axis=1)
        foci = np.where(most > 0, np.array(list(boxes))[picked.argmax(axis=1)], NOWHERE)
        near_ties = (most > 0) & ((picked >= (1 - _TIE) * most[:, None]).sum(axis=1) > 1)
        for number in np.flatnonzero(near_ties & known):
            foci[number] = pay_attention(subject, targets, self._settings[number]).focus or NOWHERE
        return np.where(known, foci, UNKNOWN)

    def _shares(self, origin: Float, axes: dict[Cue, Float], boxes: tuple[Box3D, ...]) -> Float:
        """Share s (C, O, J, T) for each cue, occlusion rule, combination of cones, and target."""
        shares = []
        for axis in axes.values():
            directions = self._rays @ left_from_crop(axis).T
            entry_m = entry_distance(origin, directions, boxes)
            cone_index = np.zeros(len(directions), dtype=np.int64)
            rays = Rays(origin_left=origin, directions=directions, cone_index=cone_index, entry_m=entry_m)
            scores = [
                score_rays(rays if way == "ignore" else replace(rays, entry_m=first_hits(entry_m)), boxes)
                for way in self._occlusions
            ]
            shares.append(self._join @ np.add.reduceat(np.array(scores), self._first_ray, axis=1))
        return np.array(shares)


def _bundles(settings: AttentionSettings) -> tuple[_Bundle, ...]:
    return tuple((fov, settings.n_rays, settings.axis_ray) for fov in settings.cones_rad)


def _distinct(values: Sequence[T]) -> list[T]:
    return list(dict.fromkeys(values))


def _numbered(values: Sequence[T]) -> tuple[list[T], NDArray[np.int64]]:
    """Return the distinct values, and for each value the index of its distinct one."""
    distinct = _distinct(values)
    number = {value: position for position, value in enumerate(distinct)}
    return distinct, np.array([number[value] for value in values], dtype=np.int64)
