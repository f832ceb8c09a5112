"""Where each hypothesis expects gaze and head for each target, and how far the measured ones are from there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vfoa.geometry import lowered, on_the_way, tangent_offset
from vfoa.posterior.belief import Belief, MeasuredCues, Scenery
from vfoa.types import Float

_BELOW_RAD = float(np.deg2rad(8.0))
"""Angle of the gaze below the head's axis: 8 degrees on average, 0.5 to 14 between people (vr_objects)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Offsets:
    """Angles to the right and down from the expected directions to the measured ones; None where not measured.

    ``gaze`` (2, N, T) is from the gaze expected with each of N gains. ``head`` and ``last_head`` (K, T, 2) are from the
    share of the way to each target, for this frame's head and for the last one before it.
    """

    gaze: Float | None
    head: Float | None
    last_head: Float | None


def offsets_of(prior: Belief, scenery: Scenery, cues: MeasuredCues) -> Offsets:
    """Return the offsets of the measured directions of a frame, the last of which are those of nowhere.

    A gaze at nowhere is about the usual place below the head's axis, or about the middle of the targets if no head is
    known; a head that looks at nowhere is about where the body faces.
    """
    head = prior.last_head if cues.head is None else cues.head
    if head is None and cues.gaze is None:
        return Offsets(gaze=None, head=None, last_head=None)
    gains = prior.gaze.gains if cues.gaze is not None else ()
    share = prior.head.share if head is not None else np.zeros(0)
    facing = scenery.middle if prior.facing is None else prior.facing
    middle = scenery.middle if head is None else facing  # the last end, which is replaced where a head is known
    starts = np.repeat([scenery.to_camera, facing], (len(gains), len(share)), axis=0)[:, None]
    ends = np.concatenate([scenery.directions, middle[None]])
    expected = on_the_way(starts, ends, np.concatenate([gains, share])[:, None])
    if head is not None:
        expected[: len(gains), -1] = lowered(head, _BELOW_RAD)
        expected[len(gains) :, -1] = facing
    of_gaze, of_heads = expected[: len(gains)], expected[len(gains) :]
    # eyes at rest look below the head's axis, so that the head stays above the way to a target
    above = np.zeros((len(share), len(ends), 2))
    above[:, :-1, 1] = share[:, None] * _BELOW_RAD
    heads = [each for each in (prior.last_head, cues.head) if each is not None]
    measured = np.array([*[cues.gaze] * len(gains), *[each for each in heads for _ in share]])
    offsets = tangent_offset(np.concatenate([of_gaze, *[of_heads] * len(heads)]), measured[:, None])
    by_head = offsets[len(gains) :].reshape(len(heads), len(share), len(ends), 2) + above
    return Offsets(
        gaze=None if cues.gaze is None else offsets[: len(gains)].transpose(2, 0, 1),
        head=None if cues.head is None else by_head[-1],
        last_head=None if prior.last_head is None else by_head[0],
    )
