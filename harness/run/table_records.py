"""The records of a run, read from its tables (:mod:`harness.run.tables`)."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from itertools import zip_longest
from pathlib import Path

import numpy as np

from harness.files.digests import file_digest
from harness.run.answers import filtered_cues
from harness.run.directory import Pair, RunDirectory
from harness.run.manifest import RunManifest
from harness.run.records import AttentionRecord, BoxRecord, FrameRecord, SubjectRecord, TargetRecord
from harness.run.table_files import Row, find_tables, frames_of, numbers_of, read_arrow, read_columns
from vfoa.errors import VfoaError
from vfoa.types import Cue

_KEPT_GROUPS = 40
"""Row groups of scenes, and of directions, that a reader keeps decoded for the next configurations."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """A row group of the tables of one configuration on one clip, and its frames.

    ``digest`` is of the files of all tables, and of the number of the group.
    """

    clip: str
    configuration: str
    group: int
    frames: tuple[int, ...]
    digest: str


class TableReader:
    """Reads the records of a finished run. What configurations share is decoded once for those that follow.

    ``paths`` are the files of the tables of each (clip, configuration), in the order of the experiment.

    Parameters
    ----------
    clips
        Read only these clips; None for all of them.

    Raises
    ------
    VfoaError
        If a table is missing, damaged, of another version, or does not fit the others; the message names the file. This
        also holds for what is read later.
    """

    def __init__(self, directory: RunDirectory, manifest: RunManifest, clips: Collection[str] | None = None) -> None:
        self.paths = dict(find_tables(directory, clips, manifest=manifest))
        self._filtered = {name: filtered_cues(settings) for name, settings in manifest.configurations.items()}
        kept = lru_cache(maxsize=_KEPT_GROUPS)
        self._scene, self._directions = kept(_read_scene), kept(rows_by_frame)

    @cached_property
    def blocks(self) -> list[Block]:
        """All blocks, by clip, configuration and frame as the experiment has them. No record is read for them."""
        groups, digest = cache(frames_of), cache(file_digest)
        found = []
        for pair, paths in self.paths.items():
            files = [digest(path) for path in paths.values()]
            for group, frames in enumerate(groups(paths["frames"])):
                of_group = hashlib.blake2b(repr((files, group)).encode(), digest_size=16).hexdigest()
                found.append(Block(clip=pair[0], configuration=pair[1], group=group, frames=frames, digest=of_group))
        return found

    def read(self, block: Block) -> Iterator[FrameRecord]:
        """Yield the records of a block."""
        pair, group = (block.clip, block.configuration), block.group
        paths = self.paths[pair]
        seen = self._scene(paths["frames"].parent, group)
        looks = self._directions(paths["directions"], "directions", group, block.frames)
        answers = rows_by_frame(paths["answers"], "answers", group, block.frames)
        for parts in zip(seen, looks, answers, strict=True):
            try:
                yield _record(pair, *parts, self._filtered[pair[1]])
            except ValueError as error:
                raise VfoaError(f"{paths['answers']}: {error}") from None


def read_records(directory: RunDirectory, clips: Collection[str] | None = None) -> Iterator[FrameRecord]:
    """Yield the records of a finished run in the order of :attr:`TableReader.blocks`.

    ``clips`` and errors are those of :class:`TableReader`.
    """
    reader = TableReader(directory, directory.read_manifest(), clips)
    for block in reader.blocks:
        yield from reader.read(block)


def most_people(directory: RunDirectory, clips: Collection[str], manifest: RunManifest) -> dict[str, int]:
    """The most people in a frame of each clip, in any scene. Raises the errors of :class:`TableReader`."""
    most = dict.fromkeys(clips, 0)
    of_file = cache(_most_people)
    for (clip, _), paths in find_tables(directory, clips, manifest=manifest):
        most[clip] = max(most[clip], of_file(paths["people"]))
    return most


def _most_people(path: Path) -> int:
    _, counts = np.unique(
        numbers_of(read_arrow(path, "people", ["frame"]).column("frame").combine_chunks(), 0), return_counts=True
    )
    return int(counts.max(initial=0))


@dataclass(frozen=True, slots=True)
class _SeenFrame:
    """What the tables of a scene say about one frame."""

    number: int
    time_ns: int
    masks_from: int | None
    masks_age_s: float | None
    targets: tuple[TargetRecord, ...]
    people: list[Row]


def _read_scene(folder: Path, group: int) -> list[_SeenFrame]:
    path = folder / "frames.parquet"
    rows = list(zip(*read_columns(path, "frames", group), strict=True))
    frames = tuple(row[0] for row in rows)
    instances, people = (
        rows_by_frame(folder / f"{table}.parquet", table, group, frames) for table in ("instances", "people")
    )
    return [
        _SeenFrame(
            number=number,
            time_ns=time_ns,
            masks_from=masks_from,
            masks_age_s=masks_age_s,
            targets=tuple(map(target_record, targets)),
            people=persons,
        )
        for (number, time_ns, masks_from, masks_age_s, *_), targets, persons in zip(
            rows, instances, people, strict=True
        )
    ]


def rows_by_frame(path: Path, table: str, group: int, frames: Sequence[int]) -> list[list[Row]]:
    """The rows of a table in a row group by frame, without the frame's number."""
    found: dict[int, list[Row]] = {frame: [] for frame in frames}
    numbers, *columns = read_columns(path, table, group)
    for number, row in zip(numbers, zip(*columns, strict=True), strict=True):
        if number not in found:
            raise VfoaError(f"{path}: frame {number} is not in this part of frames.parquet")
        found[number].append(row)
    return list(found.values())


@lru_cache(maxsize=1024)
def target_record(row: Row) -> TargetRecord:
    """The record of a row of ``instances``; equal rows, such as those of objects at rest, share one record."""
    instance_id, name, label, _, _, _, score, box_px, points, center_m, half_size_m, axes, depth_from = row
    box = None
    if None not in (center_m, half_size_m, axes):
        box = BoxRecord(center_m=center_m, half_size_m=half_size_m, axes=(axes[:3], axes[3:6], axes[6:]))
    return TargetRecord(
        instance_id=instance_id,
        name=name,
        label=label,
        score=score,
        box_px=box_px,
        points=points,
        box=box,
        depth_from=depth_from,
    )


def _record(
    pair: Pair, seen: _SeenFrame, directions: list[Row], answers: list[Row], filtered: tuple[Cue, ...]
) -> FrameRecord:
    return FrameRecord(
        clip=pair[0],
        configuration=pair[1],
        frame=seen.number,
        time_ns=seen.time_ns,
        targets=seen.targets,
        subjects=tuple(
            _subject(seen.number, *rows, filtered)
            for rows in zip_longest(seen.people, directions, answers, fillvalue=(None,))
        ),
        masks_from=seen.masks_from,
        masks_age_s=seen.masks_age_s,
    )


def _subject(frame: int, person: Row, direction: Row, answer: Row, filtered: tuple[Cue, ...]) -> SubjectRecord:
    """The subject of a row of people, of directions and of answers each."""
    if not person[0] == direction[0] == answer[0]:
        raise ValueError(f"frame {frame}: expected the tracks of people and directions, found {answer[0]}")
    track_id, name, instance_id, head_box_px, *_ = person
    _, eye_origin_m, gaze, gaze_sigma_rad, no_gaze, head, _, head_width_m, depth_from = direction
    _, missing, focus, tied, targets, of_gaze, of_head, totals, fit, gaze_filtered, head_filtered = answer
    return SubjectRecord(
        track_id=track_id,
        name=name,
        instance_id=instance_id,
        head_box_px=head_box_px,
        eye_origin_m=eye_origin_m,
        gaze=gaze_filtered if "gaze" in filtered else gaze,
        gaze_sigma_rad=gaze_sigma_rad,
        head=head_filtered if "head" in filtered else head,
        missing=missing,
        attention=tuple(
            AttentionRecord(instance_id=target, gaze=by_gaze, head=by_head, total=total)
            for target, by_gaze, by_head, total in zip(targets, of_gaze, of_head, totals, strict=True)
        ),
        focus=focus,
        tied=tied,
        fit=fit,
        no_gaze=no_gaze,
        head_width_m=head_width_m,
        depth_from=depth_from,
    )
