"""Masks in COCO's panoptic format."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Annotated, Literal

import cv2
import numpy as np
from msgspec import Meta, Struct

from harness.files.coco import by_key
from harness.files.digests import digest_files, file_digest
from harness.files.io import read_bytes
from harness.files.parsing import parse_json_as
from harness.files.remote import expand
from harness.files.safe_names import check_name
from harness.pipeline.stage_files.maps import check_size
from harness.sources import Clip
from harness.sources.media.frame_files import FolderFiles, number_names
from harness.sources.media.images import read_raw
from harness.sources.media.maps import present_ids, small_ids
from vfoa.errors import VfoaError, did_you_mean
from vfoa.pixels import relabel
from vfoa.segmentation.key_frames import KeyFrameSettings
from vfoa.types import Instance, Instances, StereoFrame


class CocoPanopticSettings(KeyFrameSettings):
    """Location of the masks: a JSON file and a folder of PNG under ``root``."""

    root: str
    """Folder of the masks; ``${CLIP}`` stands for the clip's name."""
    annotations: str = "panoptic.json"
    """JSON file of COCO's panoptic format, below ``root``."""
    masks: str = "png"
    """Folder of the PNG files, below ``root``."""
    stuff: Literal["all"] | tuple[str, ...] = ()
    """Labels of the stuff to keep, or ``all``. Things are always kept."""
    partial: bool = False
    """Accept frames without masks until one is read: enough for a run of the first frames."""


class CocoPanoptic:
    """A segmenter that reads each frame's id map (id = R + 256 G + 65536 B) and the meaning of its ids.

    root/
        panoptic.json       images, annotations[].{file_name, segments_info[].{id, category_id}}, categories
        png/frame_0001.png  one per frame, of the left image's size; the digits are the clip's frame number

    Ids that fit 16 bits stay unchanged; larger ones get the smallest free number, the same in every frame. An id is
    that of one object in all frames, unless one has several categories: then each frame has ids of its own. Crowd
    regions and stuff that is not named do not become instances.
    """

    Settings = CocoPanopticSettings

    def __init__(self, settings: CocoPanopticSettings, clip: Clip) -> None:
        root = expand(settings.root, Path.cwd(), "segmentation.root")
        self._json, self._png = root / settings.annotations, root / settings.masks
        self._masks = _read(self._json, file_digest(self._json))
        self._stuff = _named_stuff(settings.stuff, self._masks.categories.values(), self._json)
        missing = [number for number in clip.frames if number not in self._masks.files]
        if missing and not settings.partial:
            raise VfoaError(
                f"{self._json}: no annotation for frame {missing[0]}; expected one of each frame of the clip "
                f"({len(missing)} are missing)"
            )

    def segment(self, frame: StereoFrame) -> Instances:
        """Read one frame's masks.

        Raises
        ------
        VfoaError
            If the frame has none, its size is not the image's, or it holds ids that are not in the JSON.
        """
        if frame.index not in self._masks.files:
            raise VfoaError(f"{self._json}: no annotation for frame {frame.index}; expected one of each frame")
        path = self._png / self._masks.files[frame.index]
        segments = self._masks.segments(frame.index)
        ids = _read_ids(path)
        check_size(ids, frame, path, "masks are")
        drawn = set(present_ids(ids).tolist()) - {0}
        if unknown := drawn - {segment.id for segment in segments}:
            raise VfoaError(f"{path}: found segment {min(unknown)}; expected one of segments_info in {self._json.name}")
        kept = [segment for segment in segments if segment.id in drawn and self._is_wanted(segment)]
        small = {segment.id: self._masks.small[segment.id] for segment in kept}
        return Instances(ids=relabel(ids, small), instances=tuple(self._instance(segment) for segment in kept))

    def digest(self) -> str:
        """Hexadecimal sha256 of the JSON and every PNG that it names."""
        maps = ((str(number), self._png / name) for number, name in self._masks.files.items())
        return digest_files(chain([("json", self._json)], maps))

    def _is_wanted(self, segment: _Segment) -> bool:
        if segment.category_id not in self._masks.categories:
            raise VfoaError(
                f"{self._json}: segment {segment.id} has category_id {segment.category_id}; "
                f"expected one of the categories' ids: {sorted(self._masks.categories)}"
            )
        category = self._masks.categories[segment.category_id]
        return not segment.iscrowd and (bool(category.isthing) or category.name in self._stuff)

    def _instance(self, segment: _Segment) -> Instance:
        category = self._masks.categories[segment.category_id]
        return Instance(
            id=self._masks.small[segment.id],
            label=category.name,
            category_id=category.id,
            is_thing=bool(category.isthing),
            score=segment.score,
            name=segment.name,
            keeps_id=self._masks.keep_ids,
        )


class _Segment(Struct, gc=False):
    id: Annotated[int, Meta(ge=0, lt=1 << 24)]
    category_id: Annotated[int, Meta(ge=-(1 << 63), le=(1 << 63) - 1)]
    iscrowd: int | bool = 0
    score: float = 1.0
    name: str | None = None

    def __post_init__(self) -> None:
        if self.name is not None:
            check_name(self.name)


class _PanopticAnnotation(Struct, gc=False):
    file_name: str
    segments_info: list[_Segment]


class _Category(Struct):
    id: int
    name: str
    isthing: int | bool = 1

    def __post_init__(self) -> None:
        check_name(self.name)


class _PanopticFile(Struct):
    """The part of COCO's panoptic JSON that is used; the file may hold more."""

    annotations: list[_PanopticAnnotation]
    categories: list[_Category]


_PACKED = np.dtype([("id", np.uint32), ("category_id", np.int64), ("iscrowd", np.bool_), ("score", np.float64)])


class _Masks:
    """The content of a file: the categories by id, the PNG files by frame below their folder, and the segments.

    ``small`` are the 16-bit ids; ``keep_ids`` says that each has one category in all
    frames. Segments are packed: an hour of four objects has 360,000 of them.
    """

    def __init__(self, file: _PanopticFile, path: Path) -> None:
        self.categories: dict[int, _Category] = by_key(file.categories, "id", f"{path}: categories")
        by_name = by_key(file.annotations, "file_name", f"{path}: annotations")
        for annotation in file.annotations:
            by_key(annotation.segments_info, "id", f"{path}: {annotation.file_name}: segments_info")
        names = number_names(by_name, f"{path}: annotations") if by_name else {}
        self.files = FolderFiles(Path(), names)
        in_order = [by_name[name].segments_info for name in names.values()]
        every = [segment for segments in in_order for segment in segments]
        self.small = small_ids((segment.id for segment in every), str(path))
        meanings = {(segment.id, segment.category_id) for segment in every}
        self.keep_ids = len(meanings) == len({id_ for id_, _ in meanings})
        self._begins = np.cumsum([0, *map(len, in_order)])
        self._packed = np.fromiter(
            ((segment.id, segment.category_id, bool(segment.iscrowd), segment.score) for segment in every),
            _PACKED,
            len(every),
        )
        self._names = {place: segment.name for place, segment in enumerate(every) if segment.name is not None}

    def segments(self, frame: int) -> list[_Segment]:
        """The segments of a frame, in the file's order."""
        place = self.files.place(frame)
        begin, end = self._begins[place : place + 2].tolist()
        return [
            _Segment(id=id_, category_id=category, iscrowd=crowd, score=score, name=self._names.get(begin + offset))
            for offset, (id_, category, crowd, score) in enumerate(self._packed[begin:end].tolist())
        ]


@lru_cache(maxsize=2)
def _read(path: Path, digest: str) -> _Masks:
    """Read the file once per content: the stage needs it, and the description of the run."""
    return _Masks(parse_json_as(_PanopticFile, read_bytes(path), path), path)


def _named_stuff(
    stuff: Literal["all"] | tuple[str, ...], categories: Iterable[_Category], path: Path
) -> frozenset[str]:
    names = [category.name for category in categories if not category.isthing]
    if stuff == "all":
        return frozenset(names)
    if unknown := next((name for name in stuff if name not in names), None):
        raise VfoaError(f"{path}: no stuff category {unknown!r}; {did_you_mean(unknown, names)}")
    return frozenset(stuff)


def _read_ids(path: Path) -> np.ndarray[tuple[int, ...], np.dtype[np.uint32]]:
    image = read_raw(path)
    if image.ndim != 3 or image.dtype != np.uint8:
        raise VfoaError(f"{path}: found {image.ndim} dimensions of {image.dtype}; expected an 8-bit RGB PNG")
    # reads red, green, blue and a fourth byte as the bytes of one number; a matrix product is slower
    return cv2.cvtColor(image, cv2.COLOR_RGB2RGBA).view("<u4")[..., 0] & np.uint32(0xFFFFFF)
