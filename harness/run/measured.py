"""The measures of a run's stages against the ground truth, as columns; NaN: not known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from harness.run.directory import Pair
from harness.run.grid import base_of
from vfoa.types import Float

OF_DISPARITY = ("error_px", "over_2_px", "known")
OF_OBJECT = ("mask_iou", "box_iou", "center_error_m")
OF_PERSON = ("head_box_iou", "eye_error_m", "head_error_deg", "gaze_error_deg")


def _none(columns: tuple[str, ...]) -> Float:
    return np.zeros((0, len(columns)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Measured:
    """The measures of the frames with ground truth; their number, and columns in the order of the frames.

    ``disparities``, ``objects`` and ``people`` (n, 3, 3 and 4) have the columns :data:`OF_DISPARITY`,
    :data:`OF_OBJECT` and :data:`OF_PERSON`; ``truth_ids`` (n,) are the numbers of the true objects, of which ``labels``
    are the classes and ``names`` the run's names, as far as something was found for them.
    """

    frames: int = 0
    disparities: Float = field(default_factory=lambda: _none(OF_DISPARITY))
    objects: Float = field(default_factory=lambda: _none(OF_OBJECT))
    people: Float = field(default_factory=lambda: _none(OF_PERSON))
    truth_ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    labels: Mapping[int, str] = field(default_factory=dict)
    names: Mapping[int, str] = field(default_factory=dict)


def pooled_measures(parts: Mapping[Pair, Measured]) -> dict[tuple[str | None, str], Measured]:
    """The measures of each (clip, configuration) and, of several clips, of all together under the clip None.

    The seeds of a configuration are taken together, here and below; what is pooled has no ids and names.
    """
    groups: dict[tuple[str | None, str], list[Measured]] = {}
    for (clip, configuration), part in parts.items():
        if part.frames:
            groups.setdefault((clip, base_of(configuration)), []).append(part)
    if len({clip for clip, _ in groups}) > 1:
        for (_, name), of_clip in list(groups.items()):
            groups.setdefault((None, name), []).extend(of_clip)
    return {key: _joined(group) for key, group in groups.items()}


def _joined(group: Iterable[Measured]) -> Measured:
    group = [*group]
    return Measured(
        frames=sum(part.frames for part in group),
        disparities=np.concatenate([part.disparities for part in group]),
        objects=np.concatenate([part.objects for part in group]),
        people=np.concatenate([part.people for part in group]),
    )


def measures_by_thing(parts: Mapping[Pair, Measured]) -> dict[tuple[str, str, str], Float]:
    """The measures (n, 3) of each (clip, true object, configuration), the object by the run's own name for it."""
    names: dict[tuple[str, int], str] = {}
    for (clip, _), part in parts.items():
        for number, name in part.names.items():
            names.setdefault((clip, number), name)
    by_thing: dict[tuple[str, str, str], list[Float]] = {}
    for (clip, configuration), part in parts.items():
        for number, label in part.labels.items():
            name = names.get((clip, number), f"{label}#{number}")
            of_thing = part.objects[part.truth_ids == number]
            by_thing.setdefault((clip, name, base_of(configuration)), []).append(of_thing)
    in_order = sorted(by_thing.items(), key=lambda item: item[0][:2])
    return {key: np.concatenate(found) for key, found in in_order}
