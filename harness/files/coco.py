"""COCO's JSON of instances: objects in images as boxes and masks, as CVAT, Label Studio and Roboflow export them.

{"images": [{"id": 1, "file_name": "left/00001.png", "width": 1024, "height": 436}],
 "categories": [{"id": 3, "name": "cup"}],
 "annotations": [{"id": 7, "image_id": 1, "category_id": 3, "bbox": [u, v, width, height],
                  "segmentation": [[u, v, u, v, ...]] or {"size": [height, width], "counts": ...},
                  "attributes": {"track_id": 5}}]}

or only a list of annotations, each with a score: the results of a detector. Coordinates begin at the corner of a pixel:
the middle of the first one is 0.5.
"""

from __future__ import annotations

import re
from codecs import BOM_UTF8
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from msgspec import Raw, Struct, field

from harness.files.io import read_bytes
from harness.files.parsing import parse_json_as
from vfoa.errors import VfoaError

_ADDED = re.compile(r"\.rf\.[0-9A-Za-z]{12,}(?=\.|$)|^[0-9a-f]{8}-")
"""What Roboflow adds to the end of an image's name, and Label Studio to its beginning."""

_EXPECTED = "expected COCO's JSON of instances (images, categories, annotations), or a list of a detector's results"


class CocoImage(Struct, gc=False):
    """An image; ``extra`` has the name that it had before Roboflow changed it."""

    id: int | str
    file_name: str
    width: int | None = None
    height: int | None = None
    extra: dict[str, Any] | None = None

    @property
    def name(self) -> str:
        """The name that the image had before it was uploaded, with its folders."""
        given = (self.extra or {}).get("name")
        folder, slash, name = self.file_name.replace("\\", "/").rpartition("/")
        return folder + slash + (given if isinstance(given, str) else _ADDED.sub("", name))


class CocoCategory(Struct):
    """A category."""

    id: int
    name: str


class CocoAnnotation(Struct, gc=False):
    """An object in an image. ``segmentation`` is parsed by who needs it."""

    image_id: int | str
    category_id: int
    id: int | str | None = None
    name: str | None = None
    bbox: list[float] | None = None
    segmentation: Raw = field(default_factory=lambda: Raw(b"null"))
    score: float = 1.0
    track_id: int | str | None = None
    attributes: Any = None

    @property
    def named(self) -> Mapping[str, Any]:
        """The attributes, of annotations that have some."""
        return self.attributes if isinstance(self.attributes, dict) else {}

    @property
    def track(self) -> str:
        """The number of the object, the same in each image; empty if it is not known."""
        number = self.named.get("track_id") if self.track_id is None else self.track_id
        return "" if number is None else str(number)


class CocoFile(Struct):
    """The part of the file that is used."""

    images: list[CocoImage]
    categories: list[CocoCategory]
    annotations: list[CocoAnnotation]


def read_coco(path: Path) -> CocoFile:
    """Read a file; of a detector's results, images and categories are empty.

    Raises
    ------
    VfoaError
        If it is no such file, an id of an image or a category occurs twice, or an annotation is of an image or a
        category that is not in it: which one, found, expected.
    """
    data = read_bytes(path)
    try:
        if data.removeprefix(BOM_UTF8).lstrip().startswith(b"["):
            return CocoFile(images=[], categories=[], annotations=parse_json_as(list[CocoAnnotation], data, path))
        file = parse_json_as(CocoFile, data, path)
    except VfoaError as error:
        raise VfoaError(f"{error}; {_EXPECTED}") from None
    by_key(file.images, "id", f"{path}: images")
    by_key(file.categories, "id", f"{path}: categories")
    check_ids(file.annotations, file, path)
    return file


def check_ids(annotations: Sequence[CocoAnnotation], dataset: CocoFile, path: Path) -> None:
    """Raise a :class:`VfoaError` if an annotation, of the file at ``path``, is of nothing that the data set has."""
    images, categories = {image.id for image in dataset.images}, {category.id for category in dataset.categories}
    for place, annotation in enumerate(annotations):
        for key, known, what in (("image_id", images, "images"), ("category_id", categories, "categories")):
            if (number := getattr(annotation, key)) not in known:
                expected = f"one of the ids of {len(known)} {what}"
                raise VfoaError(f"{path}: {where(annotation, place)}: {key}: found {number!r}; expected {expected}")


def where(annotation: CocoAnnotation, place: int) -> str:
    """An annotation in words: by its id, or its place in the list, from 0."""
    return f"annotation {annotation.id}" if annotation.id is not None else f"annotations[{place}]"


_Entry = TypeVar("_Entry", bound=Struct)


def by_key(entries: Iterable[_Entry], key: str, where: str) -> dict[Any, _Entry]:
    """Entries by one of their fields; a value that occurs twice is a :class:`VfoaError`."""
    found: dict[Any, _Entry] = {}
    for entry in entries:
        if found.setdefault(getattr(entry, key), entry) is not entry:
            raise VfoaError(f"{where}: {key} {getattr(entry, key)!r} occurs twice; expected it once")
    return found
