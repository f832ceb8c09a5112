"""Attend: the scenes and directions of a run become answers, without images and stages.

Scenes are read once for all configurations that share them, and attended to in their order, a few frames at a time. A
run attends to a clip when it is perceived (:mod:`harness.run.loop`), and a script to a finished run under other
settings.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import fields
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeVar

from harness.files.groups import grouped
from harness.pipeline.configuration import METHODS_OF_CLIP, Configuration, open_method
from harness.pipeline.stage_runner import Timings, guarded, timed
from harness.run.answers import AnswerWriter, answer_rows, filtered_cues
from harness.run.directory import Pair, RunDirectory
from harness.run.frame_sink import ClipContext, FinishedFrame, FrameSink, SinkContext, SinkFactory
from harness.run.records import to_record
from harness.run.scene_identity import Keys, paths_of
from harness.run.table_files import Row, find_tables
from harness.run.table_scenes import SceneFrame, read_scenes
from harness.sources import Clip, MeasuredClip
from vfoa.config import dotted_tables, read_steps
from vfoa.errors import StageError, VfoaError, check_known
from vfoa.methods import MethodSettings
from vfoa.pipeline import Attending, AttendSettings
from vfoa.types import FrameResult

_Name = TypeVar("_Name")

CHANGEABLE = ("attention", "gaze_filter")
"""Tables of a configuration that decide neither scenes nor directions."""


class AttendedFrame(NamedTuple):
    """A frame, the seconds that it took, and its result."""

    frame: SceneFrame
    timings: Timings
    result: FrameResult


class Attender:
    """Attends to the frames of a clip in their order. A smoothed method finishes a frame when later ones are known."""

    def __init__(self, attending: Attending) -> None:
        self._attending = attending
        self._waiting: deque[tuple[SceneFrame, Timings]] = deque()

    @property
    def takes_many(self) -> bool:
        """Whether :meth:`steps` answers its frames at once."""
        return self._attending.takes_many

    def steps(self, frames: Sequence[SceneFrame]) -> list[AttendedFrame]:
        """Attend to the next frames; return the frames that are finished now. Raises the errors of the method."""
        together: Timings = {}
        asked = [(frame.scene, frame.tracked, frame.names) for frame in frames]
        with timed(together, "attention"):
            ready = guarded("attention", self._attending.steps, asked)
        self._waiting.extend(
            (frame, {stage: seconds / len(frames) for stage, seconds in together.items()}) for frame in frames
        )
        return self._finished(ready)

    def finish(self) -> list[AttendedFrame]:
        """Return the frames that wait for later ones. Raises the errors of the method."""
        return self._finished(guarded("attention", self._attending.finish))

    def _finished(self, ready: Iterable[FrameResult]) -> list[AttendedFrame]:
        return [AttendedFrame(*self._waiting.popleft(), result) for result in ready]


def attend_scenes(
    paths: Mapping[str, Path], settings: Mapping[str, AttendSettings]
) -> Iterator[tuple[str, SceneFrame, FrameResult]]:
    """Attend to the frames of a scene and its directions under each of these settings.

    Yields the name of the settings, a frame and its result: for each name in the order of the frames.

    Raises
    ------
    VfoaError
        As :func:`read_scenes`, or if a method fails.
    """
    attenders = {name: Attender(guarded("attention", Attending, each)) for name, each in settings.items()}
    clouds = {each.attention.cloud_points for each in settings.values()}
    if len(clouds) > 1:
        raise ValueError(f"found settings with {sorted(clouds)} points of a cloud; expected the same number")
    for block in _blocks(read_scenes(paths, *clouds)):
        for name, frames in _in_turn(block, {name: each.takes_many for name, each in attenders.items()}):
            yield from ((name, attended.frame, attended.result) for attended in attenders[name].steps(frames))
    for name, each in attenders.items():
        yield from ((name, attended.frame, attended.result) for attended in each.finish())


FRAMES_AT_ONCE = 8
"""Frames that are read before they are attended to."""


def _blocks(frames: Iterator[SceneFrame]) -> Iterator[Sequence[SceneFrame]]:
    while block := tuple(islice(frames, FRAMES_AT_ONCE)):
        yield block


def _in_turn(
    block: Sequence[SceneFrame], takes_many: Mapping[_Name, bool]
) -> Iterator[tuple[_Name, Sequence[SceneFrame]]]:
    """Yield who attends next, and to which frames of a block: to all at once, or to one frame, each in turn.

    In turn, methods that ask the same of a frame, such as which of its targets are visible, share the answer.
    """
    yield from ((name, block) for name, many in takes_many.items() if many)
    yield from ((name, (frame,)) for frame in block for name, many in takes_many.items() if not many)


class Answering:
    """Attends to the frames of a clip in order under one configuration, and hands the answers to sinks.

    It is a context manager, which opens and closes the sinks, and marks the answers as finished. An error ends only
    this configuration: ``error`` is None until then.
    """

    def __init__(
        self,
        clip: Clip | MeasuredClip,
        context: ClipContext,
        configuration: Configuration,
        keys: Keys,
        factories: Iterable[SinkFactory],
    ) -> None:
        self.error: VfoaError | None = None
        self._clip, self._configuration, self._factories = clip, configuration, factories
        self._context = context
        self._pair = context.manifest.name, configuration.name
        self._answers = AnswerWriter(context.directory, self._pair, keys, filtered_cues(configuration.plain()))
        self._attender: Attender
        self._sinks: list[FrameSink] = []
        self._open_sinks = ExitStack()

    def __enter__(self) -> Self:
        settings, manifest = self._configuration.attend, self._context.manifest
        try:
            method = guarded("attention", open_method, settings.attention, manifest, self._clip)
            self._attender = Attender(Attending(settings, method))
            context = self._sink_context(probabilistic=method.probabilistic)
            for factory in self._factories:
                if (sink := factory.open(context)) is not None:
                    self._sinks.append(self._open_sinks.enter_context(sink))
            self._sinks.append(self._open_sinks.enter_context(self._answers))
        except VfoaError as error:
            self.fail(error)
        return self

    def _sink_context(self, *, probabilistic: bool) -> SinkContext:
        of_clip = {each.name: getattr(self._context, each.name) for each in fields(ClipContext)}
        return SinkContext(**of_clip, configuration=self._configuration.name, probabilistic=probabilistic)

    def __exit__(self, kind: type[BaseException] | None, *error: Any) -> None:
        if kind is None and self.error is None:
            try:
                self._hand_over(self._attender.finish())
            except VfoaError as late:
                self.fail(late)
        try:
            self._open_sinks.__exit__(kind, *error)
        except VfoaError as late:
            self.error = late
        if kind is None and self.error is None:
            self._answers.finish()

    def fail(self, error: VfoaError) -> None:
        """End this configuration. Its sinks are closed, and their files are not whole."""
        if self.error is None:
            self.error = error
            self._open_sinks.__exit__(type(error), error, error.__traceback__)
            self._open_sinks = ExitStack()

    @property
    def takes_many(self) -> bool:
        """Whether :meth:`attend` answers many frames at once."""
        return self.error is None and self._attender.takes_many

    def attend(self, frames: Sequence[SceneFrame]) -> None:
        """Attend to the next frames; hand the finished ones to the sinks (with smoothing, these may be earlier)."""
        if self.error is not None:
            return
        try:
            self._hand_over(self._attended(frames))
        except VfoaError as error:
            self.fail(error)

    def _attended(self, frames: Sequence[SceneFrame]) -> list[AttendedFrame]:
        """The frames that are finished now. A method that fails at many frames is asked again: the error names one."""
        try:
            return self._attender.steps(frames)
        except VfoaError as error:
            if len(frames) == 1:
                if isinstance(error, StageError):
                    error.frame = frames[0].scene.index
                raise
        return [each for frame in frames for each in self._attended((frame,))]

    def _hand_over(self, attended: Iterable[AttendedFrame]) -> None:
        """Hand frames to every sink, with their records. The time of the sinks, but the last one, counts as writing."""
        for frame, timings, result in attended:
            fx_px = frame.camera.rig.fx_px if frame.camera else None
            record = to_record(*self._pair, result, fx_px, frame.targets)
            finished = FinishedFrame(camera=frame.camera, result=result, record=record, timings=timings)
            for sink in self._sinks:
                with timed(timings, "answers"):
                    sink.write(finished)


def _read_together(
    tables: Mapping[_Name, Mapping[str, Path]], settings: Mapping[_Name, AttendSettings]
) -> Iterator[list[_Name]]:
    """Group the names whose scene, directions and number of points of a cloud are the same: they are read once."""
    alike = grouped(
        ((paths["frames"], paths["directions"], settings[name].attention.cloud_points), name)
        for name, paths in tables.items()
    )
    yield from alike.values()


def attend_clip(
    clip: Clip | MeasuredClip,
    context: ClipContext,
    configurations: Iterable[Configuration],
    keys: Mapping[str, Keys],
    sinks: Iterable[SinkFactory],
    check: Callable[[int], None],
) -> dict[str, VfoaError]:
    """Attend to the scenes of a clip under each configuration, and write the answers; return the errors by name.

    Parameters
    ----------
    keys
        Those of the scene and directions of each configuration, by name.
    sinks
        Open the receivers of the answers.
    check
        Called after each frame with the number of times that the clip is read; an error of it ends all.
    """
    named = {configuration.name: configuration for configuration in configurations}
    tables = {name: paths_of(context.directory, context.manifest.name, keys[name]) for name in named}
    errors: dict[str, VfoaError] = {}
    groups = [*_read_together(tables, {name: each.attend for name, each in named.items()})]
    for names in groups:
        paths, settings = tables[names[0]], named[names[0]].attend
        answering = [Answering(clip, context, named[name], keys[name], sinks) for name in names]
        with ExitStack() as opened:
            for each in answering:
                opened.enter_context(each)
            try:
                for block in _blocks(read_scenes(paths, settings.attention.cloud_points)):
                    for number, frames in _in_turn(block, {n: each.takes_many for n, each in enumerate(answering)}):
                        answering[number].attend(frames)
                    for _ in block:
                        check(len(groups))
            except VfoaError as error:  # a table that is damaged
                for each in answering:
                    each.fail(error)
        errors |= {name: each.error for name, each in zip(names, answering, strict=True) if each.error}
    return errors


def attend_again(
    directory: RunDirectory, changes: Mapping[str, Any], configurations: Collection[str]
) -> Iterator[tuple[dict[str, str], list[Row]]]:
    """Yield the answers of a finished run's configurations with changed settings: keys and rows of each table.

    Tables come by clip and configuration, as the experiment has them. ``changes`` are settings by dotted key, such as
    ``attention.cones_cm``; without a configuration, all are changed.

    Raises
    ------
    VfoaError
        If a key, a value or a configuration is wrong, a setting decides what is perceived, or as :func:`read_scenes`.
    """
    manifest = directory.read_manifest()
    weights: dict[str, Any] = {name: {"attention": each} for name, each in manifest.fitted.items()}
    plain = {name: {**each, **weights.get(name, {})} for name, each in manifest.configurations.items()}
    for name in configurations:
        check_known(name, plain, f"{directory.path}: no configuration")
    tables = dict(find_tables(directory))
    pairs = [pair for pair in tables if not configurations or pair[1] in configurations]
    settings = {name: _changed(plain[name], changes, name) for name in dict.fromkeys(name for _, name in pairs)}
    rows: dict[Pair, list[Row]] = {pair: [] for pair in pairs}
    for group in _read_together({pair: tables[pair] for pair in pairs}, {pair: settings[pair[1]] for pair in pairs}):
        clip = group[0][0]
        of_clip = {name: _of_clip(settings[name], clip) for _, name in group}
        filtered = {name: filtered_cues(each.model_dump(mode="json")) for name, each in of_clip.items()}
        for name, frame, result in attend_scenes(tables[group[0]], of_clip):
            record = to_record(clip, name, result, targets=frame.targets)
            rows[clip, name].extend(answer_rows(record, filtered[name]))
    for pair, of_pair in rows.items():
        scene, directions = (tables[pair][table].parts[-3] for table in ("frames", "directions"))
        yield {"clip": pair[0], "scene": scene, "directions": directions, "configuration": pair[1]}, of_pair


def _of_clip(settings: AttendSettings, clip: str) -> AttendSettings:
    return settings.model_copy(update={"attention": settings.attention.for_clip(clip)})


def with_method(plain: Mapping[str, Any], method: MethodSettings, where: str) -> AttendSettings:
    """The settings of a configuration in a run's manifest, with another method of attention.

    Raises
    ------
    VfoaError
        If the manifest has no settings of the configuration; ``where`` names it.
    """
    tables = _tables_of(plain, ("tracking", "gaze_filter"), where)
    return read_steps(tables, None, where)[1].model_copy(update={"attention": method})


def _tables_of(plain: Mapping[str, Any], steps: Collection[str], where: str) -> dict[str, Any]:
    """The tables of these steps of a configuration in a run's manifest."""
    if missing := [step for step in steps if step not in plain]:
        raise VfoaError(f"{where}: {missing[0]}: missing; expected the settings of the run: run it again")
    return {step: plain[step] for step in steps}


def _changed(plain: Mapping[str, Any], changes: Mapping[str, Any], configuration: str) -> AttendSettings:
    """The settings of a configuration in a run's manifest with these changes."""
    for dotted in changes:
        if dotted.partition(".")[0] not in CHANGEABLE:
            raise VfoaError(
                f"attend: {dotted}: expected settings of {' and '.join(CHANGEABLE)}, which need no images; to change "
                "another one, run the experiment with it"
            )
    tables = _tables_of(plain, ("tracking", *CHANGEABLE), f"attend: {configuration}")
    for table, changed in dotted_tables(changes.items(), CHANGEABLE, "attend").items():
        is_other = changed.get("method", tables[table].get("method")) != tables[table].get("method")
        tables[table] = changed if is_other else {**tables[table], **changed}
    method = tables["attention"]["method"]
    if method in METHODS_OF_CLIP:
        raise VfoaError(
            f'attend: {configuration}: attention.method = "{method}" needs the clip; run the experiment with it'
        )
    return read_steps(tables, None, f"attend: {configuration}")[1]
