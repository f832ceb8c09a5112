"""Export of a run's predictions for another program: one file for each clip."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.annotate.bodies import RunBodies
from harness.annotate.predictions import predicted_labels
from harness.files.io import check_new
from harness.labels.formats import FORMATS, SUFFIXES, AnnotationFormat
from harness.labels.formats.exchange import Exchange
from harness.run.clip_records import read_clip_records
from harness.run.directory import RunDirectory
from harness.sources import Truth
from vfoa.errors import VfoaError, did_you_mean
from vfoa.types import StereoFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class Exported:
    """A written file, and notes on what it does not hold."""

    path: Path
    notes: tuple[str, ...]


def is_run(path: Path) -> bool:
    """Whether a path is a run's directory."""
    return RunDirectory(path).manifest.is_file()


def export_predictions(
    run: Path,
    name: str,
    *,
    clip: str | None = None,
    configuration: str | None = None,
    to: Path | None = None,
    fps: float | None = None,
    offset: float = 0.0,
    replace: bool = False,
) -> Iterator[Exported]:
    """Write a run's predictions in the format called ``name``, one file for each clip.

    Parameters
    ----------
    clip, configuration
        The clip and configuration to export; a configuration must be chosen if there are several.
    to
        The file, if one clip is written; by default ``RUN/labels/CLIP__CONFIGURATION.SUFFIX``.
    fps, offset
        As in :class:`Exchange`.
    replace
        Overwrite existing files.

    Raises
    ------
    VfoaError
        If the run has no such clip or configuration, the format needs data that the run lacks, or a file exists.
    """
    manifest = RunDirectory(run).read_manifest()
    clips = {each["name"]: each for each in manifest["clips"]}
    if clip is not None and clip not in clips:
        raise VfoaError(f"{run}: no clip {clip!r}; {did_you_mean(clip, clips)}")
    chosen = [clip] if clip is not None else list(clips)
    if to is not None and len(chosen) > 1:
        raise VfoaError(f"{run}: has the clips {', '.join(chosen)}; expected --clip CLIP with a file of your own")
    written: AnnotationFormat = FORMATS.load(name)()
    for each in chosen:
        records = read_clip_records(run, each, configuration)
        names = clips[each]["names"]
        subjects, targets = tuple(names["subjects"]), tuple(names["targets"])
        found = predicted_labels(records, {*subjects, *targets})
        if not found.labels.ranges:
            raise VfoaError(f"{run}: {each}: nothing was predicted; {' '.join(found.notes) or 'no person was found'}")
        place = to or run / "labels" / f"{each}__{records.configuration}{SUFFIXES.get(name, '')}"
        check_new(place, replace=replace, inputs=RunDirectory(run).inputs)
        exchange = Exchange(
            clip=_RunClip.of(clips[each], run),
            subjects=found.labels.subjects,
            targets=targets,
            fps=fps,
            offset=offset,
            bodies=RunBodies(records=records.by_frame),
        )
        yield Exported(path=place, notes=(*found.notes, *written.write(place, found.labels, exchange)))


@dataclass(frozen=True, slots=True, kw_only=True)
class _RunClip:
    """The frames and times of a clip from a run's manifest, so that the clip's data is not needed."""

    where: str
    frames: Sequence[int]
    times_ns: Mapping[int, int]
    rate_hz: float | None
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, described: Mapping[str, Any], run: Path) -> _RunClip:
        frames = tuple(described["frames"])
        times = dict(zip(frames, described["times_ns"], strict=True))
        return cls(where=f"{run}: {described['name']}", frames=frames, times_ns=times, rate_hz=described["rate_hz"])

    def time_ns(self, number: int) -> int:
        return self.times_ns[number]

    def frame(self, number: int) -> StereoFrame:
        raise VfoaError(f"{self.where}: frame {number}: a run holds no images, and this format needs their size")

    def truth(self, number: int) -> Truth:
        return Truth()

    def digest(self) -> str:
        raise VfoaError(f"{self.where}: a run holds no images to digest")
