"""Masks in COCO's format of instances: objects that a person drew, or the results of a detector."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from msgspec import Raw
from pydantic import Field

from harness.files.coco import CocoAnnotation, CocoFile, check_ids, read_coco, where
from harness.files.coco_masks import read_mask
from harness.files.digests import digest_files, file_digest
from harness.files.remote import expand
from harness.files.safe_names import check_name
from harness.sources import Clip
from harness.sources.media.frame_files import number_names
from harness.sources.media.maps import small_ids
from vfoa.coco import THINGS, category_ids
from vfoa.errors import VfoaError, reported_as
from vfoa.segmentation.canvas import Canvas
from vfoa.segmentation.key_frames import KeyFrameSettings
from vfoa.types import Instance, Instances, StereoFrame


class CocoInstancesSettings(KeyFrameSettings):
    """Location of the masks, a JSON file under ``root``, and which of them to keep."""

    root: str
    """Folder of the file; ``${CLIP}`` stands for the clip's name."""
    annotations: str = "instances.json"
    """JSON file of COCO's instances, or of a detector's results, below ``root``."""
    dataset: str | None = None
    """JSON file, below ``root``, with the images and categories of results. Not set: ``image_id`` is the image's
    number, and ``category_id`` is COCO's."""
    frame_offset: int = 0
    """The clip's frame less the number of its image: 1 for images that count from 0 where the clip counts from 1."""
    min_score: float = Field(default=0.5, ge=0, le=1)
    """Objects with a lower score are left out; those that a person drew have none."""
    max_hidden: float = Field(default=0.5, ge=0, le=1)
    """An object is left out if those of higher scores cover a larger share of it."""
    partial: bool = False
    """Accept frames that the file does not list until one is read: enough for a run of the first frames."""


class CocoInstances:
    """A segmenter that reads each frame's masks: polygons, or run lengths (RLE).

    Where masks overlap, a pixel belongs to the one with the highest score, of equal ones to the smallest. The id of an
    object is its ``track_id``, where every object of the file has one, else its place in its frame. Its name is its
    ``name``, or attribute ``name``.
    """

    Settings = CocoInstancesSettings

    def __init__(self, settings: CocoInstancesSettings, clip: Clip) -> None:
        root = expand(settings.root, Path.cwd(), "segmentation.root")
        self._settings = settings
        self._files = [root / name for name in (settings.annotations, settings.dataset) if name]
        self._masks = _read(tuple(self._files), tuple(map(file_digest, self._files)))
        missing = [frame for frame in clip.frames if self._number(frame) not in self._masks.by_image]
        if missing and (len(missing) == len(clip.frames) or not (settings.partial or self._masks.are_all_found)):
            raise VfoaError(self._missing(missing[0], f" ({len(missing)} of {len(clip.frames)} frames are missing)"))
        if self._masks.are_all_found:
            self._check_numbers(clip.frames)

    def _check_numbers(self, frames: Sequence[int]) -> None:
        """Reject images of results that are the clip's frames if these are counted from one more, or one less."""
        offset, numbers = self._settings.frame_offset, self._masks.by_image
        first, last = (each(numbers) + offset for each in (min, max))
        for shift in (1, -1):
            is_outside = first < frames[0] or last > frames[-1]
            if is_outside and frames[0] <= first + shift and last + shift <= frames[-1]:
                raise VfoaError(
                    f"{self._files[0]}: image_id: found {first - offset} to {last - offset}, the clip's frames are "
                    f"{frames[0]} to {frames[-1]}; expected these, or segmentation.frame_offset = {offset + shift}"
                )

    def segment(self, frame: StereoFrame) -> Instances:
        """Read one frame's masks.

        Raises
        ------
        VfoaError
            If the file does not list the frame's image, lists it with another size, or a mask is none, or not of the
            image's size.
        """
        objects = self._masks.by_image.get(self._number(frame.index))
        if objects is None and not self._masks.are_all_found:
            raise VfoaError(self._missing(frame.index))
        size = frame.left.shape[:2]
        name, *sides = self._masks.listed.get(self._number(frame.index), ("", *size[::-1]))
        if sides != [*size[::-1]]:
            raise VfoaError(
                f"{self._files[-1]}: {name}: found {sides[0]} x {sides[1]} pixels; expected {size[1]} x {size[0]}, the "
                "size of the left image: masks drawn on images that were not resized"
            )
        kept = [each for each in objects or () if each.instance.score >= self._settings.min_score]
        masks = [read_mask(bytes(each.segmentation), size, each.where) for each in kept]
        order = sorted(range(len(kept)), key=lambda i: (-kept[i].instance.score, int(np.count_nonzero(masks[i]))))
        canvas = Canvas(size, self._settings.max_hidden)
        for i in order:
            canvas.add(masks[i], kept[i].instance)
        return canvas.instances()

    def digest(self) -> str:
        """Hexadecimal sha256 of the files."""
        return digest_files(zip(("annotations", "dataset"), self._files, strict=False))

    def _number(self, frame: int) -> int:
        return frame - self._settings.frame_offset

    def _missing(self, frame: int, how_many: str = "") -> str:
        numbers = sorted(self._masks.by_image)
        span = f"its images: {numbers[0]} to {numbers[-1]}" if numbers else "it has no images"
        hint = "segmentation.frame_offset = 1 for images from 0"
        return f"{self._files[0]}: no image {self._number(frame)}{how_many}; {span}; {hint}"


class _Object(NamedTuple):
    """An object in an image, with its mask in JSON."""

    instance: Instance
    segmentation: Raw
    where: str


class _InstanceMasks(NamedTuple):
    """The objects by the number of their image. ``are_all_found``: in an image that is missing nothing was found.

    ``listed`` are the names, widths and heights of images, of those that the file says, by number.
    """

    by_image: Mapping[int, Sequence[_Object]]
    are_all_found: bool
    listed: Mapping[int, tuple[str, int, int]]


@lru_cache(maxsize=2)
def _read(paths: tuple[Path, ...], digests: tuple[str, ...]) -> _InstanceMasks:
    """Read the files once per content."""
    file = dataset = read_coco(paths[0])
    if len(paths) > 1:
        dataset = read_coco(paths[1])
        check_ids(file.annotations, dataset, paths[0])
    numbers = _numbers(file, dataset, paths)
    labels = _labels(dataset, paths[-1])
    of_category, ids = category_ids(labels.values()), _ids(file.annotations, paths[0])
    found: dict[int, dict[int, _Object]] = {number: {} for number in numbers.values()}
    for place, annotation in enumerate(file.annotations):
        spot = f"{paths[0]}: {where(annotation, place)}"
        if (label := labels.get(annotation.category_id)) is None:
            raise VfoaError(f"{spot}: category_id: found {annotation.category_id}; expected one of COCO's things")
        objects = found[numbers[annotation.image_id]]
        instance = Instance(
            id=ids[annotation.track] if ids else len(objects) + 1,
            label=label,
            category_id=of_category[label],
            is_thing=True,
            score=annotation.score,
            name=_name(annotation, spot),
            keeps_id=bool(ids),
        )
        if instance.id in objects:
            raise VfoaError(f"{spot}: a second object with the track_id {annotation.track} in its image; expected one")
        objects[instance.id] = _Object(instance, annotation.segmentation, f"{spot}: segmentation")
    by_image = {number: tuple(objects.values()) for number, objects in found.items()}
    listed = {
        numbers[image.id]: (image.name, image.width, image.height)
        for image in dataset.images
        if image.width and image.height
    }
    return _InstanceMasks(by_image, are_all_found=not dataset.images, listed=listed)


def _numbers(file: CocoFile, dataset: CocoFile, paths: Sequence[Path]) -> Mapping[int | str, int]:
    """The number of each image by its id; of results without images the id is the number."""
    if dataset.images:
        ids = {image.name: image.id for image in dataset.images}
        return {
            ids[name]: number
            for number, name in number_names((image.name for image in dataset.images), str(paths[-1])).items()
        }
    found = {annotation.image_id: str(annotation.image_id) for annotation in file.annotations}
    for odd in (text for text in found.values() if not text.isdecimal()):
        raise VfoaError(
            f"{paths[0]}: image_id: found {odd!r}; expected a number, or segmentation.dataset with its images"
        )
    return {key: int(text) for key, text in found.items()}


def _labels(dataset: CocoFile, path: Path) -> Mapping[int, str]:
    """The names of the categories; COCO's things of results without a dataset."""
    for category in dataset.categories:
        with reported_as(f"{path}: categories"):
            check_name(category.name)
    return {category.id: category.name for category in dataset.categories} or THINGS


_TRACK_0 = 2**20
"""Stands for the track 0, which is no id of an object: it gets the smallest free one."""


def _ids(annotations: Sequence[CocoAnnotation], path: Path) -> Mapping[str, int]:
    """The id of each track; empty if an object has none."""
    tracks = dict.fromkeys(annotation.track for annotation in annotations)
    if "" in tracks:
        return {}
    if not all(track.isdecimal() for track in tracks):
        return {track: number for number, track in enumerate(sorted(tracks), start=1)}
    numbers = {track: int(track) or _TRACK_0 for track in tracks}
    small = small_ids(numbers.values(), str(path))
    return {track: small[number] for track, number in numbers.items()}


def _name(annotation: CocoAnnotation, where: str) -> str | None:
    name = annotation.name or annotation.named.get("name")
    if not name:
        return None
    with reported_as(where):
        check_name(str(name))
    return str(name)
