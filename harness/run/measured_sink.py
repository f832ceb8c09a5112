"""The sink that saves a run's scenes as a clip of measurements, which ``vfoa clips add`` reads.

    <run>/measured/<clip>__<configuration>/people.csv, objects.csv

People have their measured directions, before any filter of the attention stage. Names are those of the run; if several
things have one name, their number is added to it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from harness.clips.manifest import ClipManifest
from harness.run.frame_sink import FinishedFrame, SinkContext
from harness.sources.measured.clip import PERSON, MeasuredFrame, MeasuredObject, MeasuredPerson
from harness.sources.measured.tables import write_measured


class MeasuredSink:
    """Saves the scenes of one clip under one configuration in ``folder``."""

    def __init__(self, folder: Path, manifest: ClipManifest) -> None:
        self._folder = folder
        self._shared = {name for name, rule in manifest.targets.items() if rule.is_shared}
        self._frames: dict[int, MeasuredFrame] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if kind is None:
            write_measured(self._folder, self._frames)

    def write(self, frame: FinishedFrame) -> None:
        """Keep one frame's scene."""
        names = {
            each.instance_id: f"{each.name}#{each.instance_id}" if each.name in self._shared else each.name
            for each in frame.record.targets
        }
        scene = frame.result.scene
        people = tuple(_people(frame, names))
        boxes = [
            MeasuredObject(name=names[each.instance.id], category=each.instance.label, box=each.box)
            for each in scene.targets
            if each.box is not None
        ]
        known = {each.name for each in boxes}
        boxless = [MeasuredObject(name=each.name, category=PERSON, box=None) for each in people]
        self._frames[scene.index] = MeasuredFrame(
            time_ns=scene.time_ns,
            people=people,
            objects=(*boxes, *(each for each in boxless if each.name not in known)),
        )


def _people(frame: FinishedFrame, names: Mapping[int, str]) -> Iterator[MeasuredPerson]:
    for attention, record in zip(frame.result.attentions, frame.record.subjects, strict=True):
        person = attention.subject.person
        own = names.get(person.instance_id or 0)
        yield MeasuredPerson(
            name=own or record.name or f"track#{record.track_id}",
            eyes_m=person.eye_origin_left,
            head_pose=person.view.head_pose,
            gaze=person.view.gaze,
        )


@dataclass(frozen=True, slots=True)
class MeasuredSinks:
    """A factory of sinks for these configurations: the first ones of those with the same scenes."""

    configurations: frozenset[str]

    def described(self) -> Mapping[str, Any]:
        """They come with the stage outputs."""
        return {}

    def open(self, context: SinkContext) -> MeasuredSink | None:
        """The scenes of one configuration on one clip; None if another configuration has the same."""
        if context.configuration not in self.configurations or context.rehearsal:
            return None
        return MeasuredSink(context.directory.measured / "__".join(context.pair), context.manifest)
