"""Instances and heads from boxes, points and heads that a person drew. Depth separates an object from its surroundings.

A box holds an object and some of what is around it. The middle of the box usually shows the object:

mode   the depth that most pixels of the middle have: the fullest bins of a histogram of ln z; if the object of another
       drawn box hides the middle, that of most pixels that are left
band   pixels of the whole box within a margin of that depth belong to the object

The margin is a share of the depth (stereo is less exact farther away) or, if that is more, a share of the box's shorter
side in metres (an object is about as deep as it is wide or high). A point is a small disc, a head the ellipse in its
box. Pixels of unknown depth belong to nothing: they could not become points of a cloud. But if too few pixels
have a depth, a shape is all that the model leaves free of it: it is found where it is drawn, and has its last depth
(:mod:`vfoa.depth_memory`).

If the model has an instance of the same label in the box, at the point or around the head, that instance takes the
drawn name and keeps its mask. Otherwise the drawn shape becomes a new instance, which replaces the model's masks where
they overlap. A thing that loses half of its pixels to it was the same object under another label, and is removed.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from vfoa.geometry import box_iou, depth_from_disparity
from vfoa.pixels import Window, window_of
from vfoa.settings import Settings
from vfoa.types import Disparity, Float, Head, Instance, Instances, Mask, StereoFrame, StereoRig

SAME_HEAD = 0.3
"""A detected head belongs to a drawn one if their boxes overlap at least this much (intersection over union)."""

SAME_OBJECT = 0.5
"""Least overlap (intersection over union) of a drawn box with a model's instance, and least share of a head on a
person, to be the same object; also the share of its pixels that another instance may lose to a drawn one."""

DEPTH_SHARE = 0.05
"""Pixels within this share of the object's depth belong to the object."""

SIZE_SHARE = 0.5
"""Pixels also belong to the object within this share of the box's shorter side in metres, if that is more."""

LEAST_PIXELS = 20
"""Fewer pixels of known depth are no cloud (:class:`vfoa.reconstruction.ReconstructionSettings`, ``min_points``)."""

POINT_RADIUS_PX = 6.0
"""Radius of the disc that a drawn point stands for."""


class DrawnSettings(Settings):
    """Which shapes of a clip's ``CLIP.drawn.csv`` are used beside the models, and how depth cuts them out."""

    targets: bool = False
    """Add the drawn boxes and points to the segmenter's masks. ``segmentation.model = "drawn"`` uses only the drawn
    ones."""
    heads: bool = False
    """Add the drawn heads where the detector finds none. ``heads.detector = "drawn"`` uses only the drawn ones."""
    middle: float = Field(default=0.5, gt=0, le=1)
    """Middle part of a box, as a share of its width and height, whose most frequent depth is the object's depth."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnShape:
    """A shape drawn in one frame, with the label that the manifest's rule asks for.

    ``box_px`` (u0, v0, u1, v1) is the box of a target or of a head; for a point, a box without extent.
    """

    name: str
    label: str
    category_id: int
    kind: Literal["box", "point", "head"]
    box_px: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedShape:
    """A shape with the id of its instance: a new one to cut out (``is_new``), or an existing one of the model.

    ``window`` is the part of the image that holds its pixels.
    """

    shape: DrawnShape
    instance_id: int
    is_new: bool
    window: Window


@dataclass(frozen=True, slots=True, kw_only=True)
class _Cut:
    """A shape's depth (infinity where none is known), its pixels in its window, and their share of the window."""

    placed: PlacedShape
    depth_m: float
    mask: Mask
    filled: float


class Drawing(Protocol):
    """The shapes that a person drew on a clip, as :func:`vfoa.pipeline.perceive` uses them."""

    def place(self, frame: StereoFrame, instances: Instances) -> tuple[PlacedShape, ...]:
        """Return the shapes drawn in a frame, each with the instance that it is or will become."""
        ...

    def add_heads(self, frame: StereoFrame, heads: Sequence[Head], drawn: tuple[PlacedShape, ...]) -> tuple[Head, ...]:
        """Return the detected heads, and the drawn heads where none was detected."""
        ...

    def add_masks(
        self, frame: StereoFrame, instances: Instances, drawn: tuple[PlacedShape, ...], disparity: Disparity
    ) -> Instances:
        """Return the model's instances together with the drawn ones."""
        ...


class DrawnShapes:
    """The drawn shapes of a clip by frame, cut out by depth."""

    def __init__(self, settings: DrawnSettings, shapes_at: Callable[[int], Sequence[DrawnShape]]) -> None:
        self._settings, self._shapes_at = settings, shapes_at

    def place(self, frame: StereoFrame, instances: Instances) -> tuple[PlacedShape, ...]:
        """Return the shapes drawn in a frame. Heads come last, so that a box drawn of the same person is theirs."""
        use = {"head": self._settings.heads, "box": self._settings.targets, "point": self._settings.targets}
        shapes = [shape for shape in self._shapes_at(frame.index) if use[shape.kind]]
        placed: list[PlacedShape] = []
        free = max((instance.id for instance in instances.instances), default=0) + 1
        for shape in sorted(shapes, key=lambda shape: shape.kind == "head"):
            window = self._window(shape, frame.rig)
            if instances.ids[window].size == 0:  # the shape is outside the image
                continue
            known = _drawn_already(shape, placed) or _known_instance(shape, window, instances, placed)
            placed.append(PlacedShape(shape=shape, instance_id=known or free, is_new=known is None, window=window))
            free += known is None
        return tuple(placed)

    def add_heads(self, frame: StereoFrame, heads: Sequence[Head], drawn: tuple[PlacedShape, ...]) -> tuple[Head, ...]:
        """Return the detected heads, each with the instance of a head drawn around it; then the other drawn heads.

        Of heads that overlap several, those that overlap most belong together.
        """
        shapes = {
            placed.instance_id: np.array(placed.shape.box_px, dtype=np.float64)
            for placed in drawn
            if placed.shape.kind == "head"
        }
        overlaps = sorted(
            (-overlap, place, instance_id)
            for place, head in enumerate(heads)
            for instance_id, box_px in shapes.items()
            if (overlap := box_iou(head.box_px, box_px)) >= SAME_HEAD
        )
        all_heads = list(heads)
        for _, place, instance_id in overlaps:
            if instance_id in shapes and all_heads[place] is heads[place]:
                all_heads[place] = replace(heads[place], instance_id=instance_id)
                del shapes[instance_id]
        drawn_heads = (Head(box_px=box_px, score=1.0, instance_id=id_) for id_, box_px in shapes.items())
        return (*all_heads, *drawn_heads)

    def add_masks(
        self, frame: StereoFrame, instances: Instances, drawn: tuple[PlacedShape, ...], disparity: Disparity
    ) -> Instances:
        """Return the model's instances and the drawn ones; of two drawn shapes that overlap, the nearer wins."""
        if not drawn:
            return instances
        new = [placed for placed in drawn if placed.is_new]
        ids = instances.ids.copy()
        for cut in sorted(self._cuts(new, disparity, instances, frame.rig), key=lambda cut: -cut.depth_m):
            ids[cut.placed.window][cut.mask] = cut.placed.instance_id
        names = {placed.instance_id: placed.shape.name for placed in drawn if not placed.is_new}
        lost = covered_things(instances, ids) - names.keys()
        ids[np.isin(ids, list(lost))] = 0
        kept = [instance for instance in instances.instances if instance.id not in lost]
        named = [replace(instance, name=names.get(instance.id, instance.name)) for instance in kept]
        return replace(instances, ids=ids, instances=(*named, *map(_instance, new)))

    def _window(self, shape: DrawnShape, rig: StereoRig) -> Window:
        u0, v0, u1, v1 = shape.box_px
        grown = POINT_RADIUS_PX if shape.kind == "point" else 0.0
        return window_of(u0 - grown, v0 - grown, u1 + grown, v1 + grown, rig)

    def _cuts(
        self, new: Sequence[PlacedShape], disparity: Disparity, instances: Instances, rig: StereoRig
    ) -> list[_Cut]:
        """Cut the nearest shape out first: it may hide the others. Of equally near ones, the one that it fills best."""
        taken = np.full(instances.ids.shape, False)
        waiting = [self._cut(placed, disparity, instances, taken, rig) for placed in new]
        done = []
        while waiting:
            nearest = min(cut.depth_m for cut in waiting) * (1 + DEPTH_SHARE)
            first = max((cut for cut in waiting if cut.depth_m <= nearest), key=lambda cut: cut.filled)
            done.append(first)
            mine = np.full(taken.shape, False)
            mine[first.placed.window] = first.mask
            taken |= mine
            waiting = [
                self._cut(cut.placed, disparity, instances, taken, rig)
                if (mine[cut.placed.window] & cut.mask).any()
                else cut
                for cut in waiting
                if cut is not first
            ]
        return done

    def _cut(
        self, placed: PlacedShape, disparity: Disparity, instances: Instances, taken: Mask, rig: StereoRig
    ) -> _Cut:
        """Cut a shape out of what is not ``taken`` (H, W); of everything if too little is left.

        If its pixels are too few, those of unknown depth that the model leaves free are added.
        """
        depth_m = depth_from_disparity(disparity.disparity_px[placed.window], rig)
        middle, (u0, v0, u1, v1) = self._settings.middle, placed.shape.box_px
        if placed.shape.kind == "point":
            width, height = 2 * POINT_RADIUS_PX, 2 * POINT_RADIUS_PX
        else:
            width, height = u1 - u0, v1 - v0
        across, down = _offsets(placed, (width, height))
        outline = np.full(depth_m.shape, True) if placed.shape.kind == "box" else across**2 + down**2 <= 1
        inside = outline & np.isfinite(depth_m)
        is_middle = (np.abs(across) <= middle) & (np.abs(down) <= middle)
        free = inside & ~taken[placed.window]
        least = min(LEAST_PIXELS, int(np.count_nonzero(inside & is_middle))) or 1
        choices = (free & is_middle, free, inside & is_middle, inside)
        samples = next((depth_m[choice] for choice in choices if np.count_nonzero(choice) >= least), np.array([]))
        mode = depth_mode(samples, DEPTH_SHARE) if len(samples) else np.inf
        side_m = mode * min(width / rig.fx_px, height / rig.fy_px)
        margin = max(DEPTH_SHARE * mode, SIZE_SHARE * side_m)
        mask = inside & (np.abs(np.where(inside, depth_m, 0) - mode) <= margin)
        if np.count_nonzero(mask) < LEAST_PIXELS:
            mask |= outline & np.equal(instances.ids[placed.window], 0) & np.isnan(depth_m)
        return _Cut(placed=placed, depth_m=mode, mask=mask, filled=np.count_nonzero(mask) / outline.size)


def depth_mode(depths_m: NDArray[np.floating], share: float) -> float:
    """The most frequent of the depths (N,), metres; of several, the nearest.

    Bins of a histogram of ln z have a width of half of ``share``. The result is the median of the depths in the three
    neighbouring bins that hold most.
    """
    logs = np.log(np.asarray(depths_m, dtype=np.float64))
    bins = ((logs - logs.min()) / (share / 2)).astype(np.intp)
    bins -= bins.min()
    counts = dict(zip(*np.unique(bins, return_counts=True), strict=True))
    fullest = max(counts, key=lambda number: (sum(counts.get(number + by, 0) for by in (-1, 0, 1)), -number))
    return float(np.exp(np.median(logs[np.abs(bins - fullest) <= 1])))


def _offsets(placed: PlacedShape, size: tuple[float, float]) -> tuple[Float, Float]:
    """Distance of each column (1, w) and row (h, 1) of a window from the shape's middle, in half sides of its box."""
    u0, v0, u1, v1 = placed.shape.box_px
    rows, columns = placed.window
    across = (np.arange(columns.start, columns.stop, dtype=np.float64) - (u0 + u1) / 2) / (size[0] / 2)
    down = (np.arange(rows.start, rows.stop, dtype=np.float64) - (v0 + v1) / 2) / (size[1] / 2)
    return across[None, :], down[:, None]


def _drawn_already(shape: DrawnShape, placed: Sequence[PlacedShape]) -> int | None:
    """The drawn instance of the same name: a head belongs to the box that is drawn of its person."""
    return next((other.instance_id for other in placed if other.shape.name == shape.name), None)


def _known_instance(
    shape: DrawnShape, window: Window, instances: Instances, placed: Sequence[PlacedShape]
) -> int | None:
    """The model's free instance of the same label that fits the drawn shape best; None if none fits well enough."""
    taken = {other.instance_id for other in placed}
    same = [
        instance.id for instance in instances.instances if instance.label == shape.label and instance.id not in taken
    ]
    if not same:
        return None
    if shape.kind == "box":
        fits = {number: _overlap(instances.mask(number), np.array(shape.box_px)) for number in same}
    elif shape.kind == "head":
        fits = {number: float(np.mean(instances.ids[window] == number)) for number in same}
    else:
        u, v = (
            min(max(round(at), 0), size - 1) for at, size in zip(shape.box_px, instances.ids.shape[::-1], strict=False)
        )
        fits = {number: float(instances.ids[v, u] == number) for number in same}
    best = max(same, key=lambda number: fits[number])
    return best if fits[best] >= SAME_OBJECT else None


def _overlap(mask: Mask, box_px: Float) -> float:
    """Intersection over union of a mask's extent and a box."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return 0.0
    extent = np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]) - 0.5
    return box_iou(extent, box_px)


def covered_things(instances: Instances, ids: NDArray[np.uint16]) -> set[int]:
    """The ids of a model's things that lose half of their pixels where ``ids`` (H, W) has other objects.

    They were the same objects, under another label. Stuff is kept, since things stand on it.
    """
    lost = np.bincount(instances.ids[instances.ids != ids], minlength=2**16)
    touched = (instance.id for instance in instances.instances if instance.is_thing and lost[instance.id])
    return {number for number in touched if lost[number] >= SAME_OBJECT * np.count_nonzero(instances.ids == number)}


def _instance(placed: PlacedShape) -> Instance:
    shape = placed.shape
    return Instance(
        id=placed.instance_id,
        label=shape.label,
        category_id=shape.category_id,
        is_thing=True,
        score=1.0,
        name=shape.name,
    )
