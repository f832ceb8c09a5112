"""Boxes of COCO's JSON of instances, as CVAT, Label Studio, Roboflow and detectors' tools write it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from pathlib import Path

from harness.files.coco import CocoAnnotation, CocoCategory, CocoFile, CocoImage, check_ids, read_coco, where
from harness.labels.drawn_shapes import Place
from harness.labels.formats.exchange import Exchange, Imported, ReadOnly
from harness.labels.formats.shapes import Shape, ShapeFile, imported, one_size, tracks_of, turned_box
from vfoa.coco import THINGS
from vfoa.errors import VfoaError

_LARGEST = 1e9
_LEAST_SCORE = 0.5
"""Results with a lower one are left out, as of masks."""
_NO_MASK = (b"null", b"[]", b"[[]]")


class Coco(ReadOnly):
    """Reads the boxes of the manifest's names, and the looks of subjects; others are left out, with a note."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read them, as :func:`harness.labels.formats.shapes.imported` says."""
        file = read_coco(path)
        if not file.images:
            file = _of_results(file, path)
        names = {image.id: image.name for image in file.images}
        shapes = ShapeFile(
            tracks=tracks_of(_shapes(file, names, path)), images=[*names.values()], size_px=_size(file, path)
        )
        return imported(shapes, exchange, path)


def _of_results(results: CocoFile, path: Path) -> CocoFile:
    """The file of a detector's results: the ids of images are their names, those of categories COCO's.

    Raises
    ------
    VfoaError
        If there are none, or one is of no category of COCO.
    """
    found = [annotation for annotation in results.annotations if annotation.score >= _LEAST_SCORE]
    if not found:
        raise VfoaError(f"{path}: found no images; expected images, categories and annotations, or a list of results")
    images = [CocoImage(id=number, file_name=str(number)) for number in dict.fromkeys(each.image_id for each in found)]
    categories = [CocoCategory(id=number, name=name) for number, name in THINGS.items()]
    file = CocoFile(images=images, categories=categories, annotations=found)
    check_ids(found, file, path)
    return file


def _shapes(file: CocoFile, images: Mapping[int | str, str], path: Path) -> Iterator[tuple[str, str, Shape]]:
    """Each annotation with the name of its category and the number of its track."""
    names = {category.id: category.name for category in file.categories}
    for place, annotation in enumerate(file.annotations):
        shape = Shape(
            at=images[annotation.image_id],
            place=_place(annotation, f"{path}: {where(annotation, place)}"),
            is_needed=_is_needed(annotation),
            is_outside=False,
            attributes={key: str(value).strip() for key, value in annotation.named.items() if value is not None},
            where=f"{path}: {where(annotation, place)}",
        )
        yield names[annotation.category_id], annotation.track, shape


def _is_needed(annotation: CocoAnnotation) -> bool:
    """Whether a place is not known from those around it: CVAT moves boxes linearly between key frames."""
    return not (_is_box(annotation) and annotation.named.get("keyframe") is False) or bool(_rotation_deg(annotation))


def _is_box(annotation: CocoAnnotation) -> bool:
    return bytes(annotation.segmentation).strip() in _NO_MASK


def _rotation_deg(annotation: CocoAnnotation) -> float:
    """By how much CVAT turns the box about its middle; the box of a mask is that of its pixels."""
    rotation = annotation.named.get("rotation")
    if not (_is_box(annotation) and isinstance(rotation, int | float)):
        return 0.0
    return float(rotation) if abs(rotation) < _LARGEST else math.inf


def _place(annotation: CocoAnnotation, where: str) -> Place:
    box, rotation_deg = annotation.bbox or [], _rotation_deg(annotation)
    if len(box) != 4 or not all(abs(number) < _LARGEST for number in (*box, rotation_deg)):
        found = f"{box}{f', turned by {rotation_deg:g} degrees' if rotation_deg else ''}"
        raise VfoaError(f"{where}: bbox: found {found}; expected [left, top, width, height] in pixels")
    left, top, width, height = box
    return tuple(round(side - 0.5, 2) for side in turned_box(left, top, left + width, top + height, rotation_deg))


def _size(file: CocoFile, path: Path) -> tuple[int, int] | None:
    """Width and height of all images."""
    return one_size(((image.width, image.height) for image in file.images if image.width and image.height), path)
