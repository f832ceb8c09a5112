"""A finished run as labelled sequences, for fits: everyone's features and labels, and the answers of other methods."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from harness.labels.labels import Labels
from harness.run.attend import with_method
from harness.run.columns import LookColumns, SceneColumns, Words
from harness.run.directory import RunDirectory
from harness.run.executors import Bar, Executor, InProcess, Progress, no_bar
from harness.run.grid import base_of
from harness.run.table_files import count_frames, find_tables
from harness.run.table_scenes import NoCloudsError, SceneFrame, read_scenes
from harness.score.baselines import picks_of, view_of
from harness.score.finished_run import FinishedRun, how_to_label
from harness.score.reference import Reference
from harness.score.score import pair_verdicts
from harness.score.verdict_columns import LabelColumns, SubjectVerdicts, hits_of, named_by
from vfoa.cones import ConesSettings, pay_attention
from vfoa.errors import VfoaError, check_known
from vfoa.logit import Logit, LogitSettings, Remembered
from vfoa.logit_cues import ROWS, Case, FrameFeatures
from vfoa.logit_fit import LabelledSequence
from vfoa.pipeline import Attending, AttendSettings
from vfoa.types import Attention, Flags, Float, Scene, Subject

_CONES = ConesSettings(cones_cm=(10, 25))
TWO_CONES = "two cones"

Names = Mapping[int, str]
"""The name of each instance of a frame, by its id."""

ScoredAnswer = tuple[bool, float, float]
"""Whether an answer is right; its probability, and that of the truth. NaN without probabilities."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LabelledPerson:
    """One labelled person of a clip under one seed, by frame: the sequence, and the answers of other methods.

    ``names`` are those of the instances in each frame. ``nearest`` (frames, 2) is the angle of the target nearest to
    the measured direction, radians, and whether it is the true one; ``others`` hold the outcomes (frames, 3) of each
    method.
    """

    sequence: LabelledSequence
    names: Sequence[Names]
    nearest: Float
    others: Mapping[str, Float]

    @property
    def labelled(self) -> Sequence[int]:
        """The positions of the frames that are scored."""
        return [k for k, right in enumerate(self.sequence.targets) if right]

    def only(self, chosen: Iterable[int]) -> LabelledPerson:
        """Return the person with the labels of these frames alone."""
        wanted = set(chosen)
        targets = [right if k in wanted else () for k, right in enumerate(self.sequence.targets)]
        return replace(self, sequence=replace(self.sequence, targets=targets))

    def without(self, chosen: Iterable[int]) -> LabelledPerson:
        """Return the person without the labels of these frames."""
        return self.only(set(self.labelled) - set(chosen))

    def first(self, seconds: float) -> LabelledPerson:
        """Return the person with the first labelled seconds alone."""
        end = np.cumsum(self._seconds)
        return self.only([k for k, until in zip(self.labelled, end, strict=True) if until <= seconds + 1e-9])

    @property
    def labelled_s(self) -> float:
        """Labelled time, seconds."""
        return float(self._seconds.sum())

    @property
    def _seconds(self) -> Float:
        """The time that each label stands for (labelled,), seconds."""
        return np.minimum(self.sequence.label_s[self.labelled], 1.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledRun:
    """One configuration of a run with labels, under all its seeds; ``clips_sha256``: digests of its clips' content."""

    experiment: str
    configuration: str
    seeds: int
    people: Sequence[LabelledPerson]
    clips_sha256: Mapping[str, str | None] = field(default_factory=dict)


def read_labelled(
    directory: RunDirectory, configuration: str | None = None, *, executor: Executor | None = None, bar: Bar = no_bar
) -> LabelledRun:
    """Read a finished run. Without a name, take its first logit, or else its first configuration.

    Workers of the ``executor`` read the features (None: this process does), and ``bar`` shows how far they are.

    Raises
    ------
    VfoaError
        If the run is not finished, has no such configuration or no label that counts, or nobody labelled has a measured
        direction.
    """
    run = FinishedRun.read(directory)
    known = run.manifest.configurations
    bases = list(dict.fromkeys(base_of(name) for name in known))
    logits = [base_of(name) for name in known if known[name].get("attention", {}).get("method") == "logit"]
    chosen = configuration or next(iter((*logits, *bases)))
    check_known(chosen, bases, f"{directory.path}: no configuration")
    reference = run.reference()
    of_clips = {clip.word: reference.labels.get(name) for name, clip in run.manifests().items()}
    check_labelled(run.manifest.experiment, of_clips, known.values())
    pairs, answers = _labelled_pairs(run, reference, chosen), _answers(run, reference)
    (labelled,) = labelled_runs(run.manifest.experiment, pairs, [chosen], executor or InProcess(), answers, bar)
    return replace(labelled, clips_sha256={clip.name: clip.sha256 for clip in run.manifest.clips})


def check_labelled(
    experiment: str, labels: Mapping[str | Path, Labels | None], configurations: Collection[Mapping[str, Any]]
) -> None:
    """Reject an experiment in which nobody has a label that counts.

    ``labels`` are those of each clip, by its word in a command (:attr:`harness.clips.manifest.ClipManifest.word`).

    Raises
    ------
    VfoaError
        The message says how the first clip is labelled.
    """
    if not any(of_clip.are_scored for of_clip in labels.values() if of_clip):
        how = how_to_label(next(iter(labels)), configurations)
        raise VfoaError(f"fit: {experiment}: found no label of who looks at what; expected some: {how}")


class LabelTruth(NamedTuple):
    """What is right for a person in a frame: instances, None for nowhere; nothing without a label.

    ``angle_rad`` is that of the target nearest to the measured direction, and ``is_nearest`` says whether it is right.
    ``names`` are those of the instances of the frame.
    """

    answers: tuple[int | None, ...]
    angle_rad: float
    is_nearest: bool
    names: Names = MappingProxyType({})


LabelTruths = Mapping[str, Mapping[int, LabelTruth]]
"""The truth by labelled person and frame in which the person was found."""


def truths_of(scene: SceneColumns, looks: LookColumns, labels: Labels, words: Words) -> LabelTruths:
    """What is right in a clip under one configuration."""
    view, picks, truths = view_of(scene), picks_of(scene, looks), dict[str, dict[int, LabelTruth]]()
    for subject in labels.subjects:
        people = np.flatnonzero(scene.person_names == words.code(subject))[::-1]  # the first, if tracks share the name
        frames = scene.frames[scene.person_at[people]]
        label = LabelColumns(labels.of(subject), labels.places(subject, frames), words)
        named = named_by(label, view, people)
        rows = zip(view.ids[people], named, label.is_nowhere.tolist(), strict=True)
        answers = ((None,) if is_nowhere else tuple(ids[right].tolist()) for ids, right, is_nowhere in rows)
        is_nearest = hits_of(named, picks.picks[people, 3:])[:, 0].tolist()
        names = [
            {number: name for number, name in zip(numbers, words.words(codes), strict=True) if name is not None}
            for numbers, codes in zip(view.ids[people].tolist(), view.names[people], strict=True)
        ]
        of_frames = map(LabelTruth, answers, picks.angles_rad[people].tolist(), is_nearest, names)
        truths[subject] = dict(zip(frames.tolist(), of_frames, strict=True))
    return truths


Answers = Mapping[tuple[str, int], Mapping[str, ScoredAnswer]]
"""The outcome of each configuration by subject and labelled frame."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledPair:
    """A labelled clip under a configuration, to be read.

    ``tables`` are the files of its scene and directions, ``settings`` filter them and look for their features.
    ``alone`` are directions: there are also the features as if only this one had been measured.
    """

    clip: str
    configuration: str
    tables: Mapping[str, Path]
    settings: AttendSettings
    truths: LabelTruths
    alone: Collection[Case] = ()


def _labelled_pairs(run: FinishedRun, reference: Reference, configuration: str) -> Iterator[LabelledPair]:
    tables = dict(find_tables(run.directory, manifest=run.manifest))
    settings = LogitSettings(method="logit")
    for each in run.columns([configuration]):
        if each.clip in reference.labels:
            plain = run.manifest.configurations[each.configuration]
            yield LabelledPair(
                clip=each.clip,
                configuration=each.configuration,
                tables=tables[each.clip, each.configuration],
                settings=with_method(plain, settings, f"{run.directory.manifest}: {each.configuration}"),
                truths=truths_of(each.scene, each.looks, reference.labels[each.clip], each.words),
                alone=[case for case in ROWS if case != "both"] if "both" in cases_of(each.looks) else (),
            )


def cases_of(looks: LookColumns) -> set[Case]:
    """The cases that the people of a clip have, of those whose eyes are known."""
    eyes, gaze, head = (np.isfinite(vectors[:, 0]) for vectors in (looks.eyes_m, looks.gaze, looks.head))
    rows: dict[Case, Flags] = {"both": eyes & gaze & head, "gaze": eyes & gaze & ~head, "head": eyes & head & ~gaze}
    return {case for case, found in rows.items() if found.any()}


def labelled_runs(
    experiment: str,
    pairs: Iterable[LabelledPair],
    configurations: Collection[str],
    executor: Executor,
    answers: Mapping[str, Answers] | None = None,
    bar: Bar = no_bar,
) -> list[LabelledRun]:
    """Return the features and labels of configurations, by their names without seeds; workers read the features.

    ``answers`` are those of all configurations, by clip. Without them, those of two cones are left out, too.

    Raises
    ------
    VfoaError
        If no labelled frame of a configuration has a measured direction, or as :func:`read_features`.
    """
    pairs = list(pairs)
    cases: list[tuple[LabelledPair, Case | None]] = [(pair, case) for pair in pairs for case in (None, *pair.alone)]
    parts = [PairCase(pair, case, asks_cones=case is None and answers is not None) for pair, case in cases]
    frames = sum(count_frames(pair.tables["frames"]) * (1 + len(pair.alone)) for pair in pairs)
    with bar(frames, f"{experiment}: features") as progress:
        found = dict(zip(parts, executor.run(read_features, parts, progress, _given_up), strict=True))
    people: dict[str, list[list[LabelledPerson]]] = {name: [] for name in configurations}
    for pair in pairs:
        of_pair = {part.case: features for part, features in found.items() if part.pair is pair}
        of_clip = (answers or {}).get(pair.clip, {})
        people[base_of(pair.configuration)].append(labelled_people(pair, of_pair, of_clip))
    runs = []
    for name, by_pair in people.items():
        seeds = len({pair.configuration for pair in pairs if base_of(pair.configuration) == name})
        everyone = itertools.chain.from_iterable(by_pair)
        of_all = [replace(each, sequence=replace(each.sequence, weight=1 / seeds)) for each in everyone]
        if not any(person.labelled for person in of_all):
            raise VfoaError(
                f"fit: {experiment}: found no labelled frame with a measured direction and the target that is looked "
                "at; expected some: the error types of its run say what is missing"
            )
        runs.append(LabelledRun(experiment=experiment, configuration=name, seeds=seeds, people=of_all))
    return runs


@dataclass(frozen=True, slots=True, eq=False)
class PairCase:
    """A job: the features of a pair, of the directions as they were measured (None) or as if only one had been.

    ``asks_cones``: also what two cones answer.
    """

    pair: LabelledPair
    case: Case | None
    asks_cones: bool = False


class FoundFeatures(NamedTuple):
    """The features of the labelled people of a clip by name and frame, and what two cones answer, where asked for.

    ``times_s`` are the times of the frames.
    """

    times_s: dict[int, float]
    seen: dict[str, dict[int, FrameFeatures]]
    cones: dict[str, dict[int, int | None]]


def _given_up(part: PairCase, why: str) -> FoundFeatures:
    raise VfoaError(f"fit: {part.pair.clip}: {part.pair.configuration}: {why}")


def read_features(part: PairCase, progress: Progress) -> FoundFeatures:
    """Read the features of a pair: a job of :func:`labelled_runs`.

    ``progress`` is called once for each frame of the clip, at the end for those that are not needed.

    Raises
    ------
    VfoaError
        If a table is missing or damaged, or the run kept no clouds of its targets.
    """
    pair, advance = part.pair, partial(progress, part.pair.clip)
    try:
        found = features_of(part, read_scenes(pair.tables, pair.settings.attention.cloud_points), advance)
    except NoCloudsError:
        raise VfoaError(
            f"fit: {pair.clip}: {pair.configuration} has no clouds of its targets; "
            'expected a run with attention.method = "logit" or "bayes"'
        ) from None
    for _ in range(count_frames(pair.tables["frames"]) - len(found.times_s)):
        advance()
    return found


AFTER_S = 10.0
"""Frames that come later than this after the last labelled one have no weight: their means last a second."""


def _needed(frames: Iterable[SceneFrame], truths: LabelTruths) -> Iterator[SceneFrame]:
    """Yield the frames up to the last labelled one, and those whose features it needs."""
    labelled = [number for of_person in truths.values() for number, truth in of_person.items() if truth.answers]
    last, until_ns = max(labelled, default=-1), math.inf
    for frame in frames:
        if frame.scene.time_ns > until_ns:
            return
        if frame.scene.index == last:
            until_ns = frame.scene.time_ns + 1e9 * AFTER_S
        yield frame


def features_of(
    part: PairCase, frames: Iterable[SceneFrame], advance: Callable[[], None] = lambda: None
) -> FoundFeatures:
    """Return the features in the frames of a clip that are needed; ``advance`` is called after each of them."""
    pair, found = part.pair, FoundFeatures({}, {name: {} for name in part.pair.truths}, {})
    for frame, attentions in _attended(_needed(frames, pair.truths), pair.settings, part.case):
        number = frame.scene.index
        found.times_s[number] = frame.scene.time_ns / 1e9
        people = {each.subject.name: each for each in reversed(attentions)}  # the first, if tracks share the name
        for name, truth_of in pair.truths.items():
            if name not in people or (seen := _seen(people[name])) is None:
                continue
            found.seen[name][number] = seen
            if part.asks_cones and _right(truth_of[number], seen):
                cones = pay_attention(people[name].subject, frame.scene.targets, _CONES)
                found.cones.setdefault(name, {})[number] = cones.focus
        advance()
    return found


def labelled_people(
    pair: LabelledPair, found: Mapping[Case | None, FoundFeatures], answers: Answers
) -> list[LabelledPerson]:
    """Return everyone's features and labels in a clip, each of the weight 1, and the answers of other methods.

    A frame whose true target has no box counts as unlabelled.
    """
    names = [name for name, seen in found[None].seen.items() if seen]
    by_first_frame = sorted(names, key=lambda name: min(found[None].seen[name]))
    return [_person(pair, name, found, answers) for name in by_first_frame]


def _attended(
    frames: Iterable[SceneFrame], settings: AttendSettings, case: Case | None
) -> Iterator[tuple[SceneFrame, tuple[Attention, ...]]]:
    """Yield each frame with everyone's attention; with a case as if only its direction had been measured."""
    attending = Attending(settings, _OfCase(LogitSettings(method="logit"), case))
    for frame in frames:
        (result,) = attending.step(frame.scene, frame.tracked, frame.names)
        yield frame, result.attentions


def _seen(attention: Attention) -> FrameFeatures | None:
    """The features of an answer of the logit; None if no direction was measured."""
    return attention.belief if isinstance(attention.belief, FrameFeatures) else None


class _OfCase(Logit):
    """The logit for people of whom only the direction of a case is measured; None: all that are."""

    def __init__(self, settings: LogitSettings, case: Case | None) -> None:
        super().__init__(settings)
        self._case = case

    def attend(
        self, subjects: tuple[Subject, ...], scene: Scene, states: tuple[Remembered, ...]
    ) -> tuple[tuple[Attention, ...], tuple[Remembered, ...]]:
        """As :class:`vfoa.logit.Logit`."""
        if self._case == "head":
            subjects = tuple(replace(subject, gaze=None) for subject in subjects)
        if self._case == "gaze":
            subjects = tuple(replace(subject, head_pose=None) for subject in subjects)
        return super().attend(subjects, scene, states)


def _right(truth: LabelTruth, seen: FrameFeatures) -> tuple[int | None, ...]:
    """The right answers, (None,) for nowhere; none without a label or if no true target has a box."""
    return tuple(answer for answer in truth.answers if answer in (None, *seen.ids))


def _person(
    pair: LabelledPair, name: str, found: Mapping[Case | None, FoundFeatures], of_clip: Answers
) -> LabelledPerson:
    measured, truth_of = found[None], pair.truths[name]
    seen = measured.seen[name]
    cones = measured.cones.get(name, {})
    answers = [dict(of_clip.get((name, number), {})) for number in seen]
    for number, of_frame in zip(seen, answers, strict=True):
        if number in cones:
            of_frame[TWO_CONES] = cones[number] in truth_of[number].answers, math.nan, math.nan
    methods = dict.fromkeys(method for of_frame in answers for method in of_frame)
    missing: ScoredAnswer = (False, math.nan, math.nan)
    return LabelledPerson(
        sequence=LabelledSequence(
            group=pair.clip,
            times_s=[measured.times_s[number] for number in seen],
            seen=list(seen.values()),
            alone={case: [found[case].seen[name].get(number) for number in seen] for case in pair.alone},
            targets=[_right(truth_of[number], features) for number, features in seen.items()],
        ),
        names=[truth_of[number].names for number in seen],
        nearest=np.array([truth_of[number][1:3] for number in seen], dtype=np.float64),
        others={method: np.array([each.get(method, missing) for each in answers], np.float64) for method in methods},
    )


def _answers(run: FinishedRun, reference: Reference) -> Mapping[str, Answers]:
    """The answers of all configurations, of the first seed of each, by clip."""
    answers: dict[str, dict[tuple[str, int], dict[str, ScoredAnswer]]] = {}
    for columns in run.columns():
        name, base = columns.configuration, base_of(columns.configuration)
        if columns.clip in reference.labels and (base == name or name.endswith(".seed1")):
            of_clip = answers.setdefault(columns.clip, {})
            for subject, judged in pair_verdicts(columns, reference).by_subject.items():
                for frame, outcome in _scored_answers(judged):
                    of_clip.setdefault((subject, frame), {})[base] = outcome
    return answers


def _scored_answers(judged: SubjectVerdicts) -> Iterator[tuple[int, ScoredAnswer]]:
    """Yield the scored frames of a subject."""
    scored = judged.where(judged.is_scored)
    outcomes = zip(*(column.tolist() for column in (~scored.is_wrong, *scored.worth[:, :2].T)), strict=True)
    yield from zip(scored.frames.tolist(), outcomes, strict=True)
