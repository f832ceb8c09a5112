"""Masks as a map for each frame, whose numbers are objects, as video segmenters (SAM 2, Cutie, XMem) write them."""

from __future__ import annotations

from functools import lru_cache
from itertools import chain
from pathlib import Path

from harness.files.digests import digest_files, file_digest
from harness.files.remote import expand
from harness.files.safe_names import check_name
from harness.files.tables import read_columns
from harness.pipeline.stage_files.maps import MapFiles, check_size
from harness.sources import Clip
from harness.sources.media.frame_files import check_printf
from harness.sources.media.maps import LARGEST_ID, present_ids, read_ids, relabel, small_ids
from vfoa.errors import VfoaError, reported_as
from vfoa.segmentation.key_frames import KeyFrameSettings
from vfoa.types import Instance, Instances, StereoFrame


class IdMapsSettings(KeyFrameSettings):
    """Location of the maps: ``pattern`` (one printf field for the frame number) and ``objects`` under ``root``.

    With ``partial``, a frame without a map is an error only when it is read: enough for a run of the clip's first
    frames.
    """

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


class IdMaps:
    """A segmenter that reads each frame's map of ids, and the meaning of the ids from a table.

    root/
        ids.csv     id,category,name
        00000.png   one per frame, of the left image's size: gray, or a palette, of 8 or 16 bits; or .npy

    0 and a number without a category are no objects. A person's category is ``person``. An object with a ``name`` of
    the manifest has it without a rule; any other one is told by ``instance``, its id.
    """

    Settings = IdMapsSettings

    def __init__(self, settings: IdMapsSettings, clip: Clip) -> None:
        root = expand(settings.root, Path.cwd(), "segmentation.root")
        self._table = root / settings.objects
        check_printf(settings.pattern, "segmentation.pattern")
        if not self._table.is_file():
            raise VfoaError(f"{self._table}: no such file; expected what the maps' numbers are: id,category,name")
        self._small, self._objects = _read_objects(self._table, file_digest(self._table))
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
        path = self._maps.path(frame.index)
        ids = read_ids(path)
        check_size(ids.shape, frame, path)
        present = [number for number in present_ids(ids).tolist() if number]
        if unknown := next((number for number in present if number not in self._objects), None):
            raise VfoaError(f"{path}: holds the number {unknown}; expected a row of it in {self._table}")
        found = tuple(each for number in present if (each := self._objects[number]) is not None)
        return Instances(ids=relabel(ids, self._small), instances=found)

    def digest(self) -> str:
        """Hexadecimal sha256 of the table and every map."""
        return digest_files(chain([("objects", self._table)], self._maps.parts()))


@lru_cache(maxsize=2)
def _read_objects(path: Path, digest: str) -> tuple[dict[int, int], dict[int, Instance | None]]:
    """The 16-bit id of each object's number, and the object of each number, None for no object; once per content."""
    table = read_columns(path, ("id", "category", "name"), ("id", "category"))
    numbers, categories = table.integers("id").tolist(), table.cells["category"]
    rows = list(zip(numbers, categories, table.cells.get("name", [""] * len(numbers)), strict=True))
    small = small_ids((number for number, category, _ in rows if category), str(path))
    places = {category: place for place, category in enumerate(dict.fromkeys(filter(None, categories)), start=1)}
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
                category_id=places[category],
                is_thing=True,
                score=1.0,
                name=name or None,
            )
    return small, objects
