"""Label Studio's export (JSON): regions of a timeline, under the name of a control tag, whose label is the target.

[{"data": {"video": "/data/upload/1/3d3ad63e-talk.mp4"},
  "annotations": [{"id": 7, "was_cancelled": false, "result": [
    {"type": "timelinelabels", "from_name": "anna", "to_name": "video",
     "value": {"ranges": [{"start": 1, "end": 15}], "timelinelabels": ["cup"]}},
    {"type": "labels", "from_name": "anna", "to_name": "audio",
     "value": {"start": 0.52, "end": 1.4, "channel": 0, "labels": ["cup"]}}]}]}]

Frames count from 1, and a range holds its last one, unless the next range of the tag begins with it. They are those of
the ``frameRate`` of the tag Video, 24 where it is not set, whatever the film's rate is, and the file does not hold it.
Regions of sound have seconds.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

from msgspec import Struct, field

from harness.files.io import read_bytes
from harness.files.parsing import parse_json_as
from harness.labels.formats.exchange import Exchange, Imported, ReadOnly, file_name
from harness.labels.formats.tiers import Annotation, from_tiers
from harness.sources.media.frame_files import IMAGE_SUFFIXES
from vfoa.errors import VfoaError, check_known, counted

_EXPECTED = "expected what Label Studio exports as JSON (not JSON-MIN)"
_UPLOADED = re.compile(r"[0-9a-f]{8}-(?=.)")
"""What Label Studio puts before the name of a file that is uploaded."""
_LONGEST_S = 1e9


class _StudioRange(Struct):
    start: float
    end: float


class _StudioValue(Struct):
    ranges: list[_StudioRange] = field(default_factory=list)
    timelinelabels: list[str] = field(default_factory=list)
    start: float | str | None = None
    end: float | str | None = None
    channel: int | None = None
    labels: list[str] = field(default_factory=list)


class _StudioRegion(Struct):
    type: str
    value: _StudioValue
    from_name: str = ""


class _StudioAnnotation(Struct):
    id: int | str
    result: list[_StudioRegion]
    was_cancelled: bool = False


class _StudioTask(Struct):
    data: dict[str, Any]
    annotations: list[_StudioAnnotation]


class LabelStudio(ReadOnly):
    """Reads the regions of timelines and of sound; others are left out, with a note."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read those of one film by one annotator: ``exchange.observation`` is the id of the annotation.

        ``exchange.fps`` is the rate of Label Studio's frames.
        """
        tasks = _read(path)
        films = [_film(task) for task in tasks]
        if films and all(Path(name).suffix.lower() in IMAGE_SUFFIXES for name in films):
            raise VfoaError(
                f"{path}: found tasks of images ({films[0]} ...); expected tasks of a film, or, of choices, the "
                "CSV that Label Studio exports, with --format table: each tag <Choices> is called as a person"
            )
        film = exchange.film_of(films, path)
        regions = _chosen([task for task, name in zip(tasks, films, strict=True) if name == film], exchange, path)
        shared = _part_shared_frames(regions, exchange)
        tiers = defaultdict[str, list[Annotation]](list)
        for region in regions:
            for start_ms, end_ms, labels in _spans(region, exchange.fps, f"{path}: region of {region.from_name!r}"):
                tiers[region.from_name].append((start_ms, end_ms, ", ".join(labels)))
        sizes = {tier: len(annotations) for tier, annotations in tiers.items()}
        # the clip's own frames are shown at their own times, whatever the rate of Label Studio's frames is
        shown = exchange if exchange.rate_hz is None else replace(exchange, fps=None)
        imported = from_tiers(sizes, lambda tier: tiers.get(tier, ()), shown, path, kind="tag")
        left_out = {
            ("task", "of other films"): sum(name != film for name in films),
            ("region", "not of a timeline or of sound"): sum(not _is_read(region) for region in regions),
        }
        notes = [f"{path}: left out: {counted(n, noun)} {more}." for (noun, more), n in left_out.items() if n]
        if shared:
            notes.append(f"{path}: {counted(shared, 'frame')} ended a range and began the next: labelled as the next.")
        return Imported(labels=imported.labels, notes=(*imported.notes, *notes))


def _read(path: Path) -> list[_StudioTask]:
    data = read_bytes(path)
    try:
        if data.removeprefix(b"\xef\xbb\xbf").lstrip().startswith(b"{"):  # a task of cloud storage
            return [parse_json_as(_StudioTask, data, path)]
        return parse_json_as(list[_StudioTask], data, path)
    except VfoaError as error:
        raise VfoaError(f"{error}; {_EXPECTED}") from None


def _film(task: _StudioTask) -> str:
    """The name of the film of a task, as it was before an upload; "" without one."""
    addresses = [text for text in task.data.values() if isinstance(text, str)]
    film = next((text for text in addresses if re.search(r"\.\w{2,4}$", text)), "")
    return _UPLOADED.sub("", file_name(film).rpartition("=")[2], count=1)


def _chosen(tasks: Sequence[_StudioTask], exchange: Exchange, path: Path) -> list[_StudioRegion]:
    """The regions of the only annotation that was not cancelled, or of the one with the given id."""
    found = {str(each.id): each.result for task in tasks for each in task.annotations if not each.was_cancelled}
    if exchange.observation is not None:
        check_known(exchange.observation, found, f"{path}: --observation: no annotation")
        return found[exchange.observation]
    if len(found) != 1:
        listed = ", ".join(found) or "none"
        raise VfoaError(f"{path}: found the annotations {listed}; expected one, or --observation ID")
    return next(iter(found.values()))


def _part_shared_frames(regions: Sequence[_StudioRegion], exchange: Exchange) -> int:
    """End ranges of a tag before the frame with which the next one begins, of those not left out; return how many."""
    tags, translate = defaultdict[str, list[_StudioRange]](list), exchange.names.translate
    for region in regions:
        subject = translate(region.from_name)
        if region.type == "timelinelabels" and any(translate(label, subject) for label in region.value.timelinelabels):
            tags[region.from_name] += region.value.ranges
    shared = 0
    for ranges in tags.values():
        ranges.sort(key=lambda each: (each.start, each.end))
        for each, following in pairwise(ranges):
            if each.start < each.end == following.start:
                each.end -= 1
                shared += 1
    return shared


def _is_read(region: _StudioRegion) -> bool:
    return region.type == "timelinelabels" or (region.type == "labels" and region.value.channel is not None)


def _spans(region: _StudioRegion, fps: float | None, where: str) -> Iterator[tuple[int, int, list[str]]]:
    """Start and end, ms, and labels. A range of frames reaches half a frame beyond them, to the next frame's."""
    value = region.value
    times_s: list[tuple[float, float]] = []
    if region.type == "timelinelabels":
        if not fps or fps < 0:
            raise VfoaError(
                f"{where}: --fps: found {fps}; expected the frameRate of Label Studio's Video tag (24 if it has none), "
                "which the file does not hold"
            )
        times_s = [((each.start - 1.5) / fps, (each.end - 0.5) / fps) for each in value.ranges]
        labels = value.timelinelabels
    elif _is_read(region):
        if not (isinstance(value.start, float) and isinstance(value.end, float)):
            raise VfoaError(f"{where}: found {value.start!r} to {value.end!r}; expected seconds")
        times_s, labels = [(value.start, value.end)], value.labels
    for start_s, end_s in times_s:
        if not (abs(start_s) < _LONGEST_S and abs(end_s) < _LONGEST_S):
            raise VfoaError(f"{where}: found {start_s:g} to {end_s:g} s; expected times in a film")
        yield round(1000 * start_s), round(1000 * end_s), labels
