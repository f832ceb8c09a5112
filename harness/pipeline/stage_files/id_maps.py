"""Masks as a map for each frame, whose numbers are objects, as video segmenters (SAM 2, Cutie, XMem) write them."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import model_validator

from harness.files.digests import code_of, digest_files, file_digest
from harness.files.remote import expand
from harness.files.safe_names import check_name
from harness.files.tables import read_columns
from harness.pipeline.configuration import OFF
from harness.pipeline.stage_files.maps import MapFiles, check_size
from harness.sources import Clip
from harness.sources.media.frame_files import check_printf
from harness.sources.media.maps import LARGEST_ID, present_ids, read_ids, small_ids
from vfoa.coco import category_ids
from vfoa.drawn import covered_things
from vfoa.errors import VfoaError, did_you_mean, reported_as
from vfoa.measured import PERSON
from vfoa.pixels import relabel
from vfoa.segmentation import SEGMENTERS, Segmenter
from vfoa.segmentation.key_frames import KeyFrameSettings
from vfoa.types import Instance, Instances, StereoFrame
from vfoa.validation import parse
from vfoa.weights import weights_of


class IdMapsSettings(KeyFrameSettings):
    """Location of the maps, and of the table of their objects, under ``root``."""

    root: str
    """Folder of the maps; ``${CLIP}`` stands for the clip's name."""
    pattern: str = "%05d.png"
    """Name of a map below ``root``, with one printf field for its number."""
    frame_offset: int = 0
    """The clip's frame less the number of its map: 1 for maps that count from 0 where the clip counts from 1."""
    objects: str = "ids.csv"
    """Table of the maps' numbers, below ``root``: columns ``id``, ``category``, and ``name`` where it is known."""
    partial: bool = False
    """Accept frames without a map until one is read: enough for a run of the first frames."""
    people: str = OFF
    """A segmenter, such as ``yolo_seg``, whose people are added where the maps have nothing; ``none``: no others."""
    weights: str | None = None
    """Weights of that segmenter. Not set: its own."""

    @model_validator(mode="after")
    def _check_people(self) -> Self:
        if self.people != OFF and self.people not in SEGMENTERS:
            raise ValueError(f"people: no {self.people!r}; {did_you_mean(self.people, [*SEGMENTERS.names(), OFF])}")
        if self.people == OFF and self.weights is not None:
            raise ValueError(
                "weights: found weights without people; expected people = the segmenter whose weights they are"
            )
        if self.people != OFF:
            try:
                self.of_people()
            except VfoaError as error:
                raise ValueError(str(error)) from None
        return self

    @property
    def used_weights(self) -> tuple[str, ...]:
        """The files that are opened, for :func:`vfoa.weights.weights_of`."""
        return () if self.people == OFF else tuple(weights_of(self.of_people()))

    def of_people(self) -> Any:
        """The settings of the segmenter that finds people; :class:`VfoaError` if it needs more, or other ones."""
        own = {} if self.weights is None else {"weights": self.weights}
        return parse(SEGMENTERS.load(self.people).Settings, own, f"people = {self.people!r}")


class IdMaps:
    """A segmenter that reads each frame's map of ids, and the meaning of the ids from a table.

    root/
        ids.csv     id,category,name
        00000.png   one per frame, of the left image's size: gray, or a palette, of 8 or 16 bits; or .npy

    0 and a number without a category are no objects. A person's category is ``person``. An object with a ``name`` of
    the manifest has it without a rule; any other one is found by ``instance``, its id. The people of another segmenter
    fill what the maps leave free; one who loses half to them is the same object.
    """

    Settings = IdMapsSettings

    def __init__(self, settings: IdMapsSettings, clip: Clip) -> None:
        root = expand(settings.root, Path.cwd(), "segmentation.root")
        self._table = root / settings.objects
        check_printf(settings.pattern, "segmentation.pattern")
        if not self._table.is_file():
            raise VfoaError(f"{self._table}: no such file; expected what the maps' numbers are: id,category,name")
        self._small, self._objects = _read_objects(self._table, file_digest(self._table))
        self._people: Segmenter | None = None
        if settings.people != OFF:
            self._people = SEGMENTERS.load(settings.people)(settings.of_people())
        self._maps = MapFiles(
            root,
            settings.pattern,
            clip.frames,
            what="map",
            partial=settings.partial,
            offset=settings.frame_offset,
            hint="; segmentation.frame_offset = 1 for maps from 0",
        )

    def segment(self, frame: StereoFrame) -> Instances:
        """Read one frame's map.

        Raises
        ------
        VfoaError
            If it cannot be read, its size is not the image's, or it holds a number that is not in the table.
        """
        objects = self._read(frame)
        return objects if self._people is None else with_people(objects, self._people.segment(frame))

    def _read(self, frame: StereoFrame) -> Instances:
        path = self._maps.path(frame.index)
        ids = read_ids(path)
        check_size(ids, frame, path)
        present = [number for number in present_ids(ids).tolist() if number]
        if unknown := next((number for number in present if number not in self._objects), None):
            raise VfoaError(f"{path}: holds the number {unknown}; expected a row of it in {self._table}")
        found = tuple(each for number in present if (each := self._objects[number]) is not None)
        return Instances(ids=relabel(ids, self._small), instances=found)

    def digest(self) -> str:
        """Hexadecimal sha256 of the table and every map, and of the code of the segmenter that finds people."""
        files = digest_files(chain([("objects", self._table)], self._maps.parts()))
        if self._people is None:
            return files
        code, versions = code_of(type(self._people).__module__)
        return hashlib.sha256(json.dumps([files, code, versions], sort_keys=True).encode()).hexdigest()


def with_people(objects: Instances, found: Instances) -> Instances:
    """Return the objects with the people of another segmenter in what they leave free, under ids of their own."""
    taken = {instance.id for instance in objects.instances}
    free = (number for number in range(1, 2**16) if number not in taken)
    left = np.where(objects.ids, 0, found.ids)
    covered = covered_things(found, left)
    people = {each.id: each for each in found.instances if each.label == PERSON and each.id not in covered}
    numbers = dict(zip(people, free, strict=False))
    ids = objects.ids + relabel(left.astype(np.uint32), numbers)
    added = (replace(people[theirs], id=ours) for theirs, ours in numbers.items())
    return Instances(ids=ids, instances=(*objects.instances, *added))


@lru_cache(maxsize=2)
def _read_objects(path: Path, digest: str) -> tuple[dict[int, int], dict[int, Instance | None]]:
    """The 16-bit id of each object's number, and the object of each number, None for no object; once per content."""
    table = read_columns(path, ("id", "category", "name"), ("id", "category"))
    numbers, categories = table.integers("id").tolist(), table.cells["category"]
    rows = list(zip(numbers, categories, table.cells.get("name", [""] * len(numbers)), strict=True))
    small = small_ids((number for number, category, _ in rows if category), str(path))
    of_category = category_ids(filter(None, categories))
    objects = dict[int, Instance | None]()
    for row, (number, category, name) in enumerate(rows):
        where = table.where(row)
        if not 0 < number <= LARGEST_ID or number in objects:
            raise VfoaError(f"{where}: id: found {number}; expected a number from 1 to {LARGEST_ID} that occurs once")
        objects[number] = None
        if category:
            with reported_as(where):
                for word in filter(None, (category, name)):
                    check_name(word)
            objects[number] = Instance(
                id=small[number],
                label=category,
                category_id=of_category[category],
                is_thing=True,
                score=1.0,
                name=name or None,
                keeps_id=True,
            )
    return small, objects
