"""One person where a segmenter finds two: something in front, such as the edge of a table, divides a mask.

The lower part is then a person of its own: others look at it, its own person does, and a head is found at its top. So
it joins the part above. It differs from another person, one in front who turns away, in three ways: it begins where the
part above ends, below it, and as far away. A person in front hides only a part of the one behind, whose mask goes on
beside the head in front, or is much nearer.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from vfoa.pixels import ViewMaps, known_pixels, points_of, relabel
from vfoa.reconstruction import covering_person
from vfoa.types import Head, Percepts

MOST_OVERLAP = 0.5
"""Heights of the head by which the lower part may begin above the end of the upper one: the edge may be slanted."""
MOST_GAP = 2.0
"""Heights of the head between the parts: as much as a table top hides."""
MOST_DEPTH = 3.0
"""Heights of the head between the depths of the parts: the legs of a seated person are in front."""
LEAST_SHARED = 0.5
"""Least share of the columns of the narrower part in which the other part is, too."""
_POINTS = 300


@dataclass(frozen=True, slots=True)
class _PersonPart:
    """A person's mask: its rows and columns, its median depth in metres (NaN: not known), and whether it has a face.

    ``id`` is that of the person to whom it belongs, ``head_px`` the height of that person's head (NaN: none).
    """

    id: int
    rows: slice
    columns: slice
    depth_m: float
    has_face: bool
    head_px: float


def join_people(percepts: Percepts, labels: Collection[str]) -> Percepts:
    """Return the percepts with the lower parts of divided people joined to the upper ones; the same if there are none.

    ``labels`` are those of people. A head that the mask of a lower part gave is left out. People whom the source knows,
    by a name or a lasting number, stay as they are, and so do those with a face of their own.
    """
    owners: dict[int, int] = {}
    above: list[_PersonPart] = []
    for part in sorted(_parts(percepts, labels), key=lambda part: part.rows.start):
        upper = [] if part.has_face else [each for each in above if _continues(each, part, percepts.rig.fy_px)]
        if upper:
            whole = max(upper, key=lambda each: each.rows.stop)
            owners[part.id] = whole.id
            part = replace(part, id=whole.id, head_px=whole.head_px)
        above.append(part)
    return _joined(percepts, owners) if owners else percepts


def _parts(percepts: Percepts, labels: Collection[str]) -> Iterator[_PersonPart]:
    """The people who may be parts of one; none if there is only one."""
    from scipy.ndimage import find_objects

    instances = percepts.instances
    people = [it.id for it in instances.instances if it.label in labels and not (it.keeps_id or it.name)]
    if len(people) < 2:
        return
    seen = ViewMaps(disparity=percepts.disparity, instances=instances, rig=percepts.rig)
    heads = _heads(percepts, labels)
    for id_, window in zip(range(1, 2**16), find_objects(instances.ids), strict=False):
        if window is None or id_ not in people:
            continue
        rows, columns = window
        points = points_of(known_pixels(instances.ids[window] == id_, (rows, columns), seen, most=_POINTS), seen)
        depth_m = float(np.median(points[:, 2])) if len(points) else np.nan
        head, has_face = heads.get(id_, (None, False))
        head_px = np.nan if head is None else head.box_px[3] - head.box_px[1]
        yield _PersonPart(id_, rows, columns, depth_m, has_face, head_px)


def _heads(percepts: Percepts, labels: Collection[str]) -> dict[int, tuple[Head, bool]]:
    """The best head of each person by instance id, and whether it was found without the person's mask."""
    heads: dict[int, tuple[Head, bool]] = {}
    for view in percepts.views:
        head = view.head
        owner = head.instance_id or covering_person(head, percepts.instances, percepts.rig, labels)
        if owner is not None:
            heads.setdefault(owner, (head, not _is_of_mask(head)))
    return heads


def _is_of_mask(head: Head) -> bool:
    return head.face_box_px is None and head.instance_id is not None


def _continues(upper: _PersonPart, lower: _PersonPart, fy_px: float) -> bool:
    """Whether one part goes on in another; never if the head or a depth is not known."""
    gap = lower.rows.start - upper.rows.stop
    widths = [part.columns.stop - part.columns.start for part in (upper, lower)]
    shared = min(upper.columns.stop, lower.columns.stop) - max(upper.columns.start, lower.columns.start)
    head_m = upper.head_px * upper.depth_m / fy_px
    return (
        -MOST_OVERLAP * upper.head_px <= gap <= MOST_GAP * upper.head_px
        and shared >= LEAST_SHARED * min(widths)
        and abs(lower.depth_m - upper.depth_m) <= MOST_DEPTH * head_m
    )


def _joined(percepts: Percepts, owners: Mapping[int, int]) -> Percepts:
    """The percepts with these parts, by id, given to the people who own them."""
    instances = percepts.instances
    whole = tuple(each for each in instances.instances if each.id not in owners)
    ids = relabel(instances.ids, {each.id: owners.get(each.id, each.id) for each in instances.instances})
    views = tuple(view for view in percepts.views if view.head.instance_id not in owners)
    return replace(percepts, instances=replace(instances, ids=ids, instances=whole), views=views)
