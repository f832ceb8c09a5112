"""The views of a frame on the labelling page: images as JPEG, and the outlines and heads drawn over the left one.

With a run, outlines are its boxes; without one, they come from the clip's own masks, if it has any.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, Literal

import cv2
import numpy as np
from pydantic import NonNegativeInt

from harness.annotate.suggestions import Predictions
from harness.clips.manifest import ClipManifest
from harness.clips.naming import SubjectNames, name_instances
from harness.run.records import BoxPx, FrameRecord
from harness.sources import Clip, LeftClip
from harness.sources.media.images import encode_rgb
from vfoa.stereo import MATCHERS
from vfoa.types import Disparity, Image, Instance, Instances, Mask, StereoFrame

PictureKind = Literal["left", "right", "disparity", "head"]
RegionPx = tuple[NonNegativeInt, NonNegativeInt, NonNegativeInt, NonNegativeInt]
"""u0, v0, u1, v1."""
Outline = list[list[list[int]]]
"""Polygons of points (u, v)."""
SceneObject = dict[str, Any]

_CACHED_FRAMES = 2
"""A frame's picture and its scene are requested one after the other. Large images take tens of MB."""
_CACHED_PICTURES = 256
_CACHED_SCENES = 2048
_QUALITY = 90
_HEAD_HEIGHT_PX = 360
_HEAD_MARGIN = 0.35
"""Margin around a head box, as a share of its side."""
_SMOOTHING_PX = 0.8
"""Greatest distance of an outline from the mask's own edge."""


class ClipPictures:
    """The images of a clip, its disparity, and the scene of each frame. Not for several threads at once."""

    def __init__(self, clip: Clip, manifest: ClipManifest, predictions: Predictions | None) -> None:
        self._clip, self._manifest, self._predictions = clip, manifest, predictions
        self._frame = lru_cache(_CACHED_FRAMES)(clip.frame)
        self._left = lru_cache(_CACHED_FRAMES)(self._read_left)
        self._matcher = lru_cache(lambda name: (matcher := MATCHERS.load(name))(matcher.Settings()))
        self.picture = lru_cache(_CACHED_PICTURES)(self._picture)
        self.scene = lru_cache(_CACHED_SCENES)(self._scene)

    def use(self, manifest: ClipManifest, predictions: Predictions | None) -> None:
        """Use the names of a changed manifest."""
        self._manifest, self._predictions = manifest, predictions
        self.scene.cache_clear()

    def _picture(
        self, view: PictureKind, number: int, subject: str | None, region: RegionPx | None, width: int | None
    ) -> bytes | None:
        """A region of a view, or all of it, as JPEG; None if the clip or the subject does not have it."""
        if view == "head":
            box = self.scene(number)["heads_px"].get(subject)
            return None if box is None else jpeg(head(self._left(number), box))
        if view == "disparity":
            return jpeg(shrunk(colour(self._disparity(self._frame(number))), region, width))
        image = self._left(number) if view == "left" else self._frame(number).right
        return None if image is None else jpeg(shrunk(image, region, width))

    def _scene(self, number: int) -> dict[str, Any]:
        """As JSON: the objects of a frame, the smallest last so that they can be clicked, and the subjects' heads."""
        if self._predictions is None:
            objects, heads = self._of_truth(number)
        else:
            objects, heads = self._of_run(self._predictions.records.get(number))
        height, width = self._left(number).shape[:2]
        ordered = sorted(objects, key=lambda scene_object: -_area(scene_object["box_px"]))
        return {"objects": ordered, "heads_px": heads, "size_px": (width, height)}

    def _of_run(self, record: FrameRecord | None) -> tuple[list[SceneObject], dict[str, BoxPx]]:
        if record is None:
            return [], {}
        names = _names_of_run(record, self._manifest)
        objects = [
            _scene_object(names[target.instance_id], target.label, box, _rectangle(box))
            for target in record.targets
            if (box := target.box_px) is not None
        ]
        return objects, {
            subject.name: box for subject in record.subjects if subject.name and (box := subject.head_box_px)
        }

    def _of_truth(self, number: int) -> tuple[list[SceneObject], dict[str, BoxPx]]:
        truth, subjects = self._clip.truth(number), self._manifest.subjects
        heads = {person.name: _box(person.head_box_px) for person in truth.people or () if person.name in subjects}
        return [] if truth.instances is None else _named(truth.instances, self._manifest), heads

    def _read_left(self, number: int) -> Image:
        return self._clip.left(number) if isinstance(self._clip, LeftClip) else self._frame(number).left

    def _disparity(self, frame: StereoFrame) -> Disparity:
        """The disparity of a frame: measured, else the true one, else by semi-global matching."""
        if frame.depth_m is not None:
            return self._matcher("sensor").match(frame)
        known = self._clip.truth(frame.index).disparity
        return known if known is not None else self._matcher("sgbm").match(frame)


def outline(mask: Mask) -> Outline:
    """The outer edges of a mask (H, W), as polygons in pixels."""
    edges, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return [cv2.approxPolyDP(edge, _SMOOTHING_PX, True)[:, 0].tolist() for edge in edges]


def _scene_object(name: str, label: str, box_px: BoxPx, edges: Outline) -> SceneObject:
    """As JSON; the name is ``label#id`` if no rule of the manifest names the instance."""
    return {"name": name, "label": label, "box_px": box_px, "outline": edges}


def _named(instances: Instances, manifest: ClipManifest) -> list[SceneObject]:
    """Instances with their names by the manifest's rules, as in a run; stuff is left out."""
    masks = {thing: instances.mask(thing.id) for thing in instances.instances if thing.is_thing}
    boxes = {thing: _extent(mask) for thing, mask in masks.items() if mask.any()}
    names = _by_rules([*boxes.items()], manifest)
    return [_scene_object(names[thing.id], thing.label, box, outline(masks[thing])) for thing, box in boxes.items()]


def _names_of_run(record: FrameRecord, manifest: ClipManifest) -> dict[int, str]:
    """The run's names, and those of targets that the manifest has gained since."""
    instances = [
        (
            Instance(id=target.instance_id, label=target.label, category_id=0, is_thing=True, score=target.score),
            target.box_px,
        )
        for target in record.targets
    ]
    fresh = _by_rules(instances, manifest)
    known = {*manifest.targets, *manifest.subjects}
    return {
        target.instance_id: fresh[target.instance_id]
        if target.name not in known and fresh[target.instance_id] in manifest.targets
        else target.name
        for target in record.targets
    }


def _by_rules(boxed: Sequence[tuple[Instance, BoxPx | None]], manifest: ClipManifest) -> Mapping[int, str]:
    """Names by instance id."""
    seen = [(instance, None if box is None else np.array(box)) for instance, box in boxed]
    return name_instances(seen, {}, manifest.subjects, manifest.targets, SubjectNames())


def _area(box_px: BoxPx) -> float:
    return (box_px[2] - box_px[0]) * (box_px[3] - box_px[1])


def _extent(mask: Mask) -> BoxPx:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return float(columns[0]), float(rows[0]), float(columns[-1]), float(rows[-1])


def _box(array: np.ndarray[Any, np.dtype[np.float64]]) -> BoxPx:
    u0, v0, u1, v1 = array.tolist()
    return u0, v0, u1, v1


def _rectangle(box_px: BoxPx) -> Outline:
    u0, v0, u1, v1 = map(round, box_px)
    return [[[u0, v0], [u1, v0], [u1, v1], [u0, v1]]]


def jpeg(image: Image) -> bytes:
    """An image (H, W, 3) RGB as JPEG."""
    return encode_rgb(image, ".jpg", cv2.IMWRITE_JPEG_QUALITY, _QUALITY)


def shrunk(image: Image, region: RegionPx | None, width: int | None) -> Image:
    """Cut a region (u0, v0, u1, v1) out of an image and shrink it to at most ``width``; None: no limit."""
    if region is not None:
        u0, v0, u1, v1 = region
        image = image[max(v0, 0) : max(v1, v0 + 1), max(u0, 0) : max(u1, u0 + 1)]
    if width is None or width >= image.shape[1] or not image.size:
        return image
    size = (width, max(round(image.shape[0] * width / image.shape[1]), 1))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)


def colour(disparity: Disparity) -> Image:
    """A disparity map (H, W) in colours: near is red, far is blue, unknown is black."""
    values = disparity.disparity_px
    known = np.isfinite(values)
    if not known.any():
        return np.zeros((*values.shape, 3), np.uint8)
    low, high = np.percentile(values[known], (1, 99))
    scaled = np.clip((np.where(known, values, low) - low) / max(high - low, 1e-6), 0, 1)
    coloured = cv2.applyColorMap((255 * scaled).astype(np.uint8), cv2.COLORMAP_TURBO)
    coloured[~known] = 0
    return cv2.cvtColor(coloured, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)


def head(image: Image, box_px: tuple[float, float, float, float]) -> Image:
    """A head with its surroundings, enlarged to a constant height; cut at the image's edges."""
    u0, v0, u1, v1 = box_px
    margin_u, margin_v = _HEAD_MARGIN * (u1 - u0), _HEAD_MARGIN * (v1 - v0)
    rows = slice(max(round(v0 - margin_v), 0), max(round(v1 + margin_v), 1))
    columns = slice(max(round(u0 - margin_u), 0), max(round(u1 + margin_u), 1))
    crop = image[rows, columns]
    if crop.size == 0:
        return np.zeros((_HEAD_HEIGHT_PX, _HEAD_HEIGHT_PX, 3), np.uint8)
    scale = _HEAD_HEIGHT_PX / crop.shape[0]
    size = (max(round(crop.shape[1] * scale), 1), _HEAD_HEIGHT_PX)
    return cv2.resize(crop, size, interpolation=cv2.INTER_CUBIC).astype(np.uint8, copy=False)
