"""One clip under many configurations: each distinct stage runs once per frame.

All calls of a stage go through :class:`harness.pipeline.stage_runner.StageRunner`. A clip of recorded 3D poses has no
images: its frames are scenes already (:func:`pose_frames`). People are followed and named here, too: once for all
configurations that see the same.

Frames are read in a thread while the last ones are perceived (:mod:`harness.pipeline.prefetch`).
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from harness.clips.manifest import ClipManifest
from harness.clips.naming import FrameNames, Namer, NameRule
from harness.files.unchanged import read_unchanged
from harness.pipeline.cache import ClipCache, Tally
from harness.pipeline.configuration import OFF, STAGES, Configuration, StageChoice, open_method, reads_clip
from harness.pipeline.drawn_stage import DrawnClip
from harness.pipeline.prefetch import prefetch
from harness.pipeline.stage_files.answers import FileAnswers
from harness.pipeline.stage_runner import Memo, StageRunner, Timings, guarded, timed
from harness.sources import Clip, MeasuredClip, PersonTruth
from vfoa.depth_memory import DepthMemory, EyeMemory
from vfoa.divided_people import join_people
from vfoa.drawn import DrawnSettings
from vfoa.errors import StageError, VfoaError
from vfoa.gaze import TemporalGazeModel
from vfoa.gaze.temporal import HeadWindow, with_gazes
from vfoa.instance_tracking import InstanceTracker
from vfoa.pipeline import Stages, perceive
from vfoa.reconstruction import place_people, place_targets
from vfoa.tracking import Tracked, Tracker
from vfoa.types import Gaze, Percepts, Person, Scene, StereoFrame

_Followed = TypeVar("_Followed")


class FollowedFrame(NamedTuple):
    """A frame under one configuration: the scene, the tracks of its people, the names, and the seconds per stage.

    A clip of recorded poses has no percepts.
    """

    percepts: Percepts | None
    scene: Scene
    tracked: Tracked
    names: FrameNames
    timings: Timings


@dataclass(frozen=True, slots=True, kw_only=True)
class SharedFrame:
    """A frame under each configuration, by its name. A clip of recorded poses has no images.

    A configuration that has failed, in this frame or an earlier one, has its error instead.
    """

    index: int
    frame: StereoFrame | None
    by_configuration: Mapping[str, FollowedFrame | VfoaError]


def read_frames(clip: Clip, numbers: Iterable[int]) -> Generator[tuple[StereoFrame, float]]:
    """Read the frames with these numbers, each with the seconds that reading took.

    Raises
    ------
    VfoaError
        If one cannot be read.
    """
    for number in numbers:
        started = time.perf_counter()
        frame = read_unchanged(clip.frame, number)
        yield frame, time.perf_counter() - started


@dataclass(frozen=True, slots=True, eq=False)
class _Group:
    """The stages that some configurations, by name, have in common."""

    stages: Stages
    person: tuple[str, ...]
    instances: InstanceTracker
    names: list[str] = field(default_factory=list)


class _Followers(NamedTuple):
    """What a configuration follows and names people with; configurations share what they agree on."""

    group: _Group
    tracker: Tracker
    depths: DepthMemory
    namer: Namer
    window: HeadWindow | None
    eyes: EyeMemory


class _GroupPercepts(NamedTuple):
    """The percepts of a frame, without the gazes of a temporal model, with divided people joined; and their timings.

    ``places`` are those of the views among the heads that were found and followed, which the masks of parts gave, too.
    """

    percepts: Percepts
    places: tuple[int, ...]
    timings: Timings

    def of_people(self, values: tuple[_Followed, ...]) -> tuple[_Followed, ...]:
        """Those of the values of all heads that belong to the views."""
        return values if len(values) == len(self.places) else tuple(values[place] for place in self.places)


_Perceived = tuple[StereoFrame, float, Mapping[_Group, _GroupPercepts], Memo]
"""A frame, the seconds that reading it took, its percepts, and the steps of its trackers."""


class Perception:
    """Percepts, scenes, tracks and names of one clip for every configuration.

    A stage that cannot be built, or fails on a frame, ends the configurations that use it.

    Parameters
    ----------
    cache
        Outputs of earlier runs; None for no cache.
    manifest
        The clip's manifest, which has the rules of names; None for none.
    drawn
        The shapes drawn on the clip; None for none.
    parallel
        Run the models of the heads beside the matchers, in a thread.
    """

    def __init__(
        self,
        configurations: Sequence[Configuration],
        clip: Clip,
        cache: ClipCache | None = None,
        *,
        manifest: ClipManifest | None = None,
        drawn: DrawnClip | None = None,
        parallel: bool = False,
    ) -> None:
        self._rules = (manifest.subjects, manifest.targets) if manifest else ({}, {})
        self._answers = {} if manifest is None else _answers(configurations, manifest, clip)
        self._configurations, self._clip, self._cache, self._drawn = configurations, clip, cache, drawn
        self._heads_thread = ThreadPoolExecutor(1) if parallel else None
        self._memo = Memo()
        self._failed: dict[str, VfoaError] = {}
        self._stages: dict[str, StageRunner] = {}
        self._drawings: dict[DrawnSettings, StageRunner] = {}
        self._groups: dict[tuple[object, ...], _Group] = {}
        self._followers: dict[str, _Followers] = {}
        self._instances: dict[tuple[object, ...], InstanceTracker] = {}
        self._depths: dict[tuple[object, ...], DepthMemory] = {}
        self._trackers: dict[tuple[object, ...], Tracker] = {}
        self._namers: dict[tuple[object, ...], Namer] = {}
        self._windows: dict[tuple[object, ...], HeadWindow] = {}
        for configuration in configurations:
            with self._isolated([configuration.name]):
                self._build(configuration)
        self._look_ahead = max((window.look_ahead for window in self._windows.values()), default=0)

    def __enter__(self) -> Perception:
        return self

    def __exit__(self, *error: object) -> None:
        if self._heads_thread:
            self._heads_thread.shutdown(cancel_futures=True)

    def frames(self, numbers: Iterable[int], read_ahead: int = 0) -> Generator[SharedFrame]:
        """Read and perceive frames in ascending order, and place what they show in space.

        A frame is yielded when all frames that its gaze depends on have been read: at once without a temporal model.
        ``read_ahead`` frames are read in advance, in a thread.
        """
        waiting: deque[_Perceived] = deque()
        with closing(prefetch(read_frames(self._clip, numbers), read_ahead)) as frames:
            for frame, decode_s in frames:
                waiting.append(self._perceive(frame, decode_s))
                while waiting and waiting[0][0].index + self._look_ahead <= frame.index:
                    yield self._reconstruct(*waiting.popleft())
        for perceived in waiting:
            yield self._reconstruct(*perceived)

    def warm(self, number: int) -> None:
        """Only perceive a frame, to fill the cache. A failure is ignored: :meth:`frames` will meet it again."""
        with suppress(VfoaError):
            frame = read_unchanged(self._clip.frame, number)
            self._memo.outputs = {}
            for group in self._groups.values():
                with suppress(VfoaError):
                    perceive(frame, group.stages)

    def take_tallies(self) -> tuple[Tally, ...]:
        """Return the outputs of each cached stage that were reused and computed since the last call."""
        return tuple(runner.stored.take() for runner in self._stages.values() if runner.stored)

    def _perceive(self, frame: StereoFrame, decode_s: float) -> _Perceived:
        perceived: dict[_Group, _GroupPercepts] = {}
        tracks = Memo()
        fed: set[HeadWindow] = set()
        self._memo.outputs = {}
        for group in self._groups.values():
            names = [name for name in group.names if name not in self._failed]
            if names:
                with self._isolated(names, frame.index):
                    self._memo.timings = {}
                    found = perceive(frame, group.stages, executor=self._heads_thread)
                    percepts = self._memo.call("tracking", guarded, "tracking", join_people, found, group.person)
                    people = set(map(id, percepts.views))
                    places = tuple(place for place, view in enumerate(found.views) if id(view) in people)
                    step = "tracking", group.instances, guarded, "tracking", group.instances.step
                    instances = self._memo.once(*step, percepts.instances, frame.time_ns)
                    perceived[group] = _GroupPercepts(instances.renumber(percepts), places, self._memo.timings)
                    for name in names:
                        tracker, window = self._followers[name].tracker, self._followers[name].window
                        tracked = tracks.once("tracking", tracker, _tracked, found, tracker)
                        if window and window not in fed:
                            window.add(found, tracked.ids)
                            fed.add(window)
        return frame, decode_s, perceived, tracks

    def _reconstruct(
        self,
        frame: StereoFrame,
        decode_s: float,
        perceived: Mapping[_Group, _GroupPercepts],
        memo: Memo,
    ) -> SharedFrame:
        """Place the objects and people in space and name them, for every configuration that has not failed."""
        results: dict[str, FollowedFrame | VfoaError] = {}
        gazes: dict[HeadWindow, tuple[tuple[Gaze | None, ...], float]] = {}
        for configuration in self._configurations:
            name = configuration.name
            if name in self._failed:
                continue
            with self._isolated([name], frame.index):
                group, tracker, depths, namer, window, eyes = self._followers[name]
                percepts, of_people = perceived[group].percepts, perceived[group].of_people
                memo.timings = {"decode": decode_s, **perceived[group].timings}
                if window:
                    if window not in gazes:
                        self._memo.timings = {}
                        gazes[window] = window.gazes(frame.index), self._memo.timings.get("gaze", 0.0)
                    memo.charge("gaze", gazes[window][1])
                    percepts = memo.call("gaze", with_gazes, percepts, of_people(gazes[window][0]))
                seen, settings = (percepts.disparity, percepts.instances, percepts.rig), configuration.reconstruction
                place = ("reconstruction", guarded, "reconstruction")
                targets = memo.call(*place, place_targets, *seen, settings)
                step = "reconstruction", depths, guarded, "reconstruction", depths.step
                targets = memo.once(*step, targets, percepts)
                scene = memo.call(*place, place_people, percepts, targets, settings)
                tracked = memo.once("tracking", tracker, _tracked, percepts, tracker)  # it took its step before
                if (ids := of_people(tracked.ids)) is not tracked.ids:
                    tracked = replace(tracked, ids=ids)
                people = eyes.step(scene.people, tracked.ids, percepts)
                names = memo.once("tracking", namer, namer.step, scene, tracked)
                scene = replace(scene, people=people, names=names.targets)
                if answers := self._answers.get(name):
                    scene, tracked, names = answers.complete(scene, tracked, names, percepts.instances.ids)
                results[name] = FollowedFrame(percepts, scene, tracked, names, memo.timings)
        return SharedFrame(index=frame.index, frame=frame, by_configuration={**self._failed, **results})

    @contextmanager
    def _isolated(self, names: Iterable[str], frame: int | None = None) -> Iterator[None]:
        """Let an error of configurations, in a frame or before the first, end only these configurations."""
        try:
            yield
        except VfoaError as error:
            if isinstance(error, StageError):
                error.frame = frame
            self._failed.update(dict.fromkeys(names, error))

    def _build(self, configuration: Configuration) -> None:
        """Build the stages of one configuration, except those already built for another one."""
        keys = {slot: choice.key if choice else OFF for slot, choice in configuration.choices.items()}
        for choice in configuration.stages:
            if choice.key not in self._stages:
                self._stages[choice.key] = self._stage(choice)
        chosen: dict[str, Any] = {slot: self._stages.get(key) for slot, key in keys.items()}
        for slot in ("stereo", "segmentation", "heads"):
            if chosen[slot] is None:
                raise VfoaError(
                    f'{slot}.{STAGES[slot].key}: found "none"; expected a stage, which a clip with images needs (vfoa '
                    f"settings {slot})"
                )
        drawing = self._drawing(configuration)
        drawn = configuration.drawn if drawing else None
        gaze = chosen["gaze"]
        temporal = gaze is not None and isinstance(gaze.stage, TemporalGazeModel)
        stages = Stages(
            matcher=chosen["stereo"],
            segmenter=chosen["segmentation"],
            heads=chosen["heads"],
            head_pose=chosen["head_pose"],
            gaze=None if temporal else gaze,
            temporal_gaze=gaze if temporal else None,
            region_matcher=chosen["stereo"] if configuration.is_in_region else None,
            drawing=drawing,
        )
        # heads and crops depend on nothing else, so configurations that agree on this have the same tracks and gazes
        seen = (keys["segmentation"], keys["heads"], drawn, configuration.attend.tracking)
        with_gaze, with_depth = (*seen, keys["gaze"]), (*seen, keys["stereo"], configuration.reconstruction)
        if temporal and with_gaze not in self._windows:
            self._windows[with_gaze] = HeadWindow(gaze, self._clip.rate_hz, number_step(self._clip))
        person = configuration.reconstruction.person
        found = (keys["stereo"], keys["segmentation"], keys["heads"], drawn, person)  # people are joined by depth
        instances = self._instances.setdefault(found, InstanceTracker())
        group = self._groups.setdefault((*keys.values(), drawn, person), _Group(stages, person, instances))
        group.names.append(configuration.name)
        self._followers[configuration.name] = _Followers(
            group=group,
            tracker=self._trackers.setdefault(seen, Tracker(configuration.attend.tracking)),
            depths=self._depths.setdefault((*found, configuration.reconstruction), DepthMemory()),
            namer=self._namers.setdefault(with_depth, Namer(*self._rules)),
            window=self._windows[with_gaze] if temporal else None,
            eyes=EyeMemory(),
        )

    def _stage(self, choice: StageChoice) -> StageRunner:
        slot = STAGES[choice.slot]
        name = f'{slot.name}.{slot.key} = "{choice.name}"'
        stored = self._cache.outputs_of(choice) if self._cache else None
        stage = guarded(name, slot.build, choice, self._clip)
        return StageRunner(stage, slot=slot.name, name=name, memo=self._memo, stored=stored)

    def _drawing(self, configuration: Configuration) -> StageRunner | None:
        """The drawn shapes as a configuration uses them; their time is charged to the segmentation."""
        settings = configuration.drawn
        if self._drawn is None or not configuration.uses_drawn:
            return None
        if settings not in self._drawings:
            shapes = self._drawn.shapes(settings)
            self._drawings[settings] = StageRunner(shapes, slot="segmentation", name="drawn", memo=self._memo)
        return self._drawings[settings]


def number_step(clip: Clip) -> int:
    """The usual difference of the numbers of two frames that follow each other at the clip's rate.

    It is 1 for most sources, also if frames are missing, and 10 for files that are numbered in tens and have the times
    of their rate.
    """
    numbers = np.array(clip.frames[:_FRAMES_OF_STEP], dtype=np.int64)
    times_ns = np.array([clip.time_ns(number) for number in numbers.tolist()], dtype=np.int64)
    steps, seconds = np.diff(numbers), np.diff(times_ns) / 1e9
    if clip.rate_hz is not None:
        steps, seconds = steps[seconds > 0], seconds[seconds > 0]
        steps = steps / (seconds * clip.rate_hz)
    return max(1, round(float(np.median(steps)))) if len(steps) else 1


_FRAMES_OF_STEP = 200
"""Frames from whose numbers and times the step is found."""


def _tracked(percepts: Percepts, tracker: Tracker) -> Tracked:
    """The tracks of the heads."""
    people = tuple(Person(view=view, instance_id=None, eye_origin_left=None) for view in percepts.views)
    return guarded("tracking", tracker.step, people)


def _answers(
    configurations: Iterable[Configuration], manifest: ClipManifest, clip: Clip | MeasuredClip
) -> dict[str, FileAnswers]:
    """The answers of the configurations that read them from a file: they may name what was not found."""
    settings = {each.name: each.attend.attention for each in configurations if reads_clip(each.attend.attention)}
    return {name: open_method(attention, manifest, clip) for name, attention in settings.items()}


_DIRECTIONS = {"head_pose": "head_direction", "gaze": "gaze_direction"}
"""The slots whose stages can answer from the truth of a person, and the direction that each needs."""


def pose_frames(
    configurations: Sequence[Configuration], clip: MeasuredClip, numbers: Iterable[int], manifest: ClipManifest
) -> Generator[SharedFrame]:
    """Read frames of recorded 3D poses in ascending order: scenes without percepts.

    If the clip knows the true directions of its people, the stages ``truth`` and ``simulated`` give heads and gazes. A
    direction whose stage is switched off is left out; with any other stage it is as measured. If the clip never knows a
    true direction, a configuration that needs it fails. Configurations with the same stages get the same scene, and
    those with the same tracking the same tracks and names.
    """
    directions, unknown = dict[str, _Directions](), dict[str, VfoaError]()
    for configuration in configurations:
        try:
            directions[configuration.name] = _Directions.of(configuration, clip)
        except VfoaError as error:
            unknown[configuration.name] = error
    following = {
        tracking: (Tracker(tracking), Namer(*_own_rules(manifest, clip)))
        for tracking in dict.fromkeys(configuration.attend.tracking for configuration in configurations)
    }
    answers = _answers(configurations, manifest, clip)
    for number in numbers:
        started = time.perf_counter()
        scene, people = clip.scene(number), clip.truth(number).people
        decode_s = time.perf_counter() - started
        scenes: dict[tuple[str, ...], Scene] = {}
        for own in directions.values():
            if own.keys not in scenes:
                scenes[own.keys] = own.of_scene(scene, people)
        tracks = {}
        for tracking, (tracker, namer) in following.items():
            timings: Timings = {"decode": decode_s}
            with timed(timings, "tracking"):
                tracked = tracker.step(scene.people)
                tracks[tracking] = tracked, namer.step(scene, tracked), timings
        results: dict[str, FollowedFrame | VfoaError] = {**unknown}
        for configuration in (each for each in configurations if each.name in directions):
            name = configuration.name
            tracked, names, timings = tracks[configuration.attend.tracking]
            seen = replace(scenes[directions[name].keys], names=names.targets)
            if name in answers:
                seen, tracked, names = answers[name].complete(seen, tracked, names)
            results[name] = FollowedFrame(None, seen, tracked, names, {**timings})
        yield SharedFrame(index=number, frame=None, by_configuration=results)


def _own_rules(manifest: ClipManifest, clip: MeasuredClip) -> tuple[dict[str, NameRule], dict[str, NameRule]]:
    """The rules of subjects and targets: those that the clip names are nobody and nothing else.

    This also holds where they are not in a frame. A target that is called as its category is all of this category.
    """

    def own(name: str, rule: NameRule, ids: Mapping[str, int]) -> NameRule:
        return NameRule(category=clip.categories[name], instance=ids[name]) if name in ids else rule

    return (
        {name: own(name, rule, clip.people) for name, rule in manifest.subjects.items()},
        {
            name: rule if rule.is_shared and name == rule.category else own(name, rule, {**clip.people, **clip.objects})
            for name, rule in manifest.targets.items()
        },
    )


def _is_known(clip: MeasuredClip, direction: str) -> bool:
    """Whether the clip knows a true direction of somebody in some frame."""
    truths = (person for number in clip.frames for person in clip.truth(number).people or ())
    return any(getattr(person, direction) is not None for person in truths)


@dataclass(frozen=True, slots=True)
class _Directions:
    """The directions that a configuration changes: by slot the stage that gives the true one, None to leave it out.

    ``keys`` are equal for configurations that have the same ones.
    """

    keys: tuple[str, ...]
    stages: Mapping[str, Any]

    @classmethod
    def of(cls, configuration: Configuration, clip: MeasuredClip) -> _Directions:
        """Those of a configuration, on a clip; a :class:`VfoaError` says that the clip knows no true direction."""
        keys, stages = [], {}
        for slot, direction in _DIRECTIONS.items():
            choice = configuration.choices[slot]
            if choice and STAGES[slot].is_true(choice) and not _is_known(clip, direction):
                of_tables = ', or gaze = "truth" in [source] of tables' if slot == "gaze" else ""
                raise VfoaError(
                    f'{slot}.model = "{choice.name}": the clip has no true {slot.replace("_", " ")}; expected '
                    f'"{STAGES[slot].measured}"{of_tables}'
                )
            if choice is None or STAGES[slot].is_true(choice):
                keys.append(choice.key if choice else f"{slot} {OFF}")
                stages[slot] = STAGES[slot].stage_class(choice.name)(choice.settings, clip) if choice else None
        return cls(tuple(keys), stages)

    def of_scene(self, scene: Scene, people: Iterable[PersonTruth] | None) -> Scene:
        """The scene with these directions; none where the truth is not known, as in a blink."""
        truths = {person.instance_id: person for person in people or ()}
        placed = []
        for person in scene.people:
            truth = truths.get(person.instance_id or 0)
            cues = {}
            for slot, stage in self.stages.items():
                is_known = truth is not None and getattr(truth, _DIRECTIONS[slot]) is not None
                cues[slot] = stage.of_person(scene.index, truth) if stage and is_known else None
            placed.append(replace(person, view=replace(person.view, **cues)))
        return replace(scene, people=tuple(placed))
