"""A finished run as labelled sequences, for fits: everyone's features and labels, and the answers of other methods."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.labels.labels import Labels
from harness.run.attend import with_method
from harness.run.columns import LookColumns, SceneColumns, Words
from harness.run.directory import RunDirectory
from harness.run.executors import GOES_ON, Executor, InProcess, Progress
from harness.run.grid import base_of
from harness.run.table_files import find_tables
from harness.run.table_scenes import NoCloudsError, SceneFrame, read_scenes
from harness.score.finished_run import FinishedRun, how_to_label
from harness.score.picks import picks_of, view_of
from harness.score.reference import Reference
from harness.score.score import pair_verdicts
from harness.score.verdict_columns import LabelColumns, SubjectVerdicts, hits_of, named_by
from vfoa.cones import ConesSettings, pay_attention
from vfoa.errors import VfoaError, check_known
from vfoa.logit import Logit, LogitSettings, Remembered
from vfoa.logit_cues import ROWS, Case, FrameFeatures
from vfoa.logit_fit import UNKNOWN, LabelledSequence
from vfoa.pipeline import Attending, AttendSettings
from vfoa.types import Attention, Float, Scene, Subject

_CONES = ConesSettings(cones_cm=(10, 25))
TWO_CONES = "two cones"

ScoredAnswer = tuple[bool, float, float]
"""Whether an answer is right; its probability, and that of the truth. NaN without probabilities."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LabelledPerson:
    """One labelled person of a clip under one seed, by frame: the sequence, and the answers of other methods.

    ``nearest`` (frames, 2) is the angle of the target nearest to the measured direction, radians, and whether it is the
    true one; ``others`` hold the outcomes (frames, 3) of each method.
    """

    sequence: LabelledSequence
    nearest: Float
    others: Mapping[str, Float]

    @property
    def labelled(self) -> Sequence[int]:
        """The positions of the frames that are scored."""
        return [k for k, target in enumerate(self.sequence.targets) if target != UNKNOWN]

    def only(self, chosen: Iterable[int]) -> LabelledPerson:
        """Return the person with the labels of these frames alone."""
        wanted = set(chosen)
        targets = [target if k in wanted else UNKNOWN for k, target in enumerate(self.sequence.targets)]
        return replace(self, sequence=replace(self.sequence, targets=targets))

    def without(self, chosen: Iterable[int]) -> LabelledPerson:
        """Return the person without the labels of these frames."""
        return self.only(set(self.labelled) - set(chosen))

    def first(self, seconds: float) -> LabelledPerson:
        """Return the person with the first labelled seconds alone."""
        end = np.cumsum([min(self.sequence.gaps_s[k], 1.0) for k in self.labelled])
        return self.only([k for k, until in zip(self.labelled, end, strict=True) if until <= seconds + 1e-9])

    @property
    def labelled_s(self) -> float:
        """Labelled time, seconds."""
        return float(sum(min(self.sequence.gaps_s[k], 1.0) for k in self.labelled))


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledRun:
    """One configuration of a run with labels, under all its seeds."""

    experiment: str
    configuration: str
    seeds: int
    people: Sequence[LabelledPerson]


def read_labelled(directory: RunDirectory, configuration: str | None = None) -> LabelledRun:
    """Read a finished run. Without a name, take its first logit, or else its first configuration.

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
    of_clips = {clip.name: reference.labels.get(clip.name) for clip in run.manifest.clips}
    check_labelled(run.manifest.experiment, of_clips, known.values())
    pairs = _labelled_pairs(run, reference.labels, [chosen], tuple(ROWS))
    return labelled_runs(run.manifest.experiment, pairs, [chosen], InProcess(), _answers(run, reference))[0]


def read_features(
    directory: RunDirectory, configurations: Collection[str], cases: Collection[Case] | None = None
) -> list[LabelledRun]:
    """Read the features and labels of a finished run's configurations, without the answers of other methods.

    ``cases``: those that will be fitted; by default those that a clip has.

    Raises
    ------
    VfoaError
        If the run is not finished, or no labelled frame of a configuration has a measured direction.
    """
    run = FinishedRun.read(directory)
    pairs = _labelled_pairs(run, run.reference().labels, configurations, cases)
    return labelled_runs(run.manifest.experiment, pairs, configurations, InProcess())


def check_labelled(
    experiment: str, labels: Mapping[str, Labels | None], configurations: Collection[Mapping[str, Any]]
) -> None:
    """Reject an experiment in which nobody has a label that counts; ``labels`` are those of each clip, by its name.

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
    """

    answers: tuple[int | None, ...]
    angle_rad: float
    is_nearest: bool


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
        of_frames = map(LabelTruth, answers, picks.angles_rad[people].tolist(), is_nearest)
        truths[subject] = dict(zip(frames.tolist(), of_frames, strict=True))
    return truths


@dataclass(frozen=True, slots=True, kw_only=True)
class LabelledPair:
    """A labelled clip under a configuration, to be read.

    ``tables`` are the files of its scene and directions, ``settings`` filter them and look for their features.
    ``cases`` are those that will be fitted, by default those that the clip has.
    """

    clip: str
    configuration: str
    tables: Mapping[str, Path]
    settings: AttendSettings
    truths: LabelTruths
    cases: Collection[Case] | None = None


def _labelled_pairs(
    run: FinishedRun, labels: Mapping[str, Labels], configurations: Collection[str], cases: Collection[Case] | None
) -> Iterator[LabelledPair]:
    tables = dict(find_tables(run.directory, manifest=run.manifest))
    settings = LogitSettings(method="logit")
    for each in run.columns(configurations):
        if each.clip in labels:
            plain = run.manifest.configurations[each.configuration]
            yield LabelledPair(
                clip=each.clip,
                configuration=each.configuration,
                tables=tables[each.clip, each.configuration],
                settings=with_method(plain, settings, f"{run.directory.manifest}: {each.configuration}"),
                truths=truths_of(each.scene, each.looks, labels[each.clip], each.words),
                cases=cases,
            )


Answers = Mapping[tuple[str, str, int], Mapping[str, ScoredAnswer]]
"""The outcome of each configuration by clip, subject and labelled frame."""


def labelled_runs(
    experiment: str,
    pairs: Iterable[LabelledPair],
    configurations: Collection[str],
    executor: Executor,
    others: Answers | None = None,
) -> list[LabelledRun]:
    """Return the features and labels of configurations, by their names without seeds; workers read the pairs.

    ``others`` are the answers of all configurations. Without them, those of two cones are left out, too.

    Raises
    ------
    VfoaError
        If no labelled frame of a configuration has a measured direction, or as :func:`read_people`.
    """
    pairs = list(pairs)
    people: dict[str, list[list[LabelledPerson]]] = {name: [] for name in configurations}
    work = partial(read_people, others=others)
    for pair, found in zip(pairs, executor.run(work, pairs, _silent, _given_up), strict=True):
        people[base_of(pair.configuration)].append(found)
    runs = []
    for name, by_pair in people.items():
        seeds = len({pair.configuration for pair in pairs if base_of(pair.configuration) == name})
        of_all = [replace(each, sequence=replace(each.sequence, weight=1 / seeds)) for of in by_pair for each in of]
        if not any(person.labelled for person in of_all):
            raise VfoaError(
                f"fit: {experiment}: found no labelled frame with a measured direction and the target that is looked "
                "at; expected some: the error types of its run say what is missing"
            )
        runs.append(LabelledRun(experiment=experiment, configuration=name, seeds=seeds, people=of_all))
    return runs


def _silent(clip: str) -> None:
    """Report no progress: the frames are counted when they are attended to."""


def _given_up(pair: LabelledPair, why: str) -> list[LabelledPerson]:
    raise VfoaError(f"fit: {pair.clip}: {pair.configuration}: {why}")


def read_people(pair: LabelledPair, progress: Progress, *, others: Answers | None = None) -> list[LabelledPerson]:
    """Read everyone's features and labels in a clip: a job of :func:`labelled_runs`.

    Raises
    ------
    VfoaError
        If a table is missing or damaged, or the run kept no clouds of its targets.
    """
    try:
        frames = list(read_scenes(pair.tables, pair.settings.attention.cloud_points))
    except NoCloudsError as error:
        raise VfoaError(
            f"fit: {pair.clip}: {pair.configuration} kept no clouds of its targets, which the logit looks at; "
            f'expected a run with attention.method = "logit" or "bayes" ({error})'
        ) from None
    return labelled_people(pair, frames, others, partial(progress, GOES_ON))


def labelled_people(
    pair: LabelledPair,
    frames: Sequence[SceneFrame],
    others: Answers | None = None,
    check: Callable[[], None] = lambda: None,
) -> list[LabelledPerson]:
    """Return everyone's features and labels in the frames of a clip, each of the weight 1.

    A frame whose true target has no box counts as unlabelled. ``check`` is called at each frame; an error of it ends
    all.
    """
    measured = list(_attended(frames, pair.settings, None, check))
    found = {seen.case for people in measured for each in people if (seen := _seen(each))}
    single = ({*ROWS} if pair.cases is None else {*pair.cases}) - {"both"} if "both" in found else set[Case]()
    if pair.cases is None:
        single &= found
    alone = {case: list(_attended(frames, pair.settings, case, check)) for case in sorted(single)}
    rows_of: dict[str, list[_LabelledFrame]] = {}
    for at, (frame, people) in enumerate(zip(frames, measured, strict=True)):
        number, named = frame.scene.index, [each.subject.name for each in people]
        for name, of_person in pair.truths.items():
            if name not in named or (seen := _seen(people[place := named.index(name)])) is None:
                continue
            right, *nearest = of_person[number]
            target = next((answer for answer in right if answer in (None, *seen.ids)), UNKNOWN)
            answers = dict[str, ScoredAnswer]()
            if others is not None:
                answers = dict(others.get((pair.clip, name, number), {}))
                if target != UNKNOWN:
                    cones = pay_attention(people[place].subject, frame.scene.targets, _CONES)
                    answers[TWO_CONES] = cones.focus in right, math.nan, math.nan
            by_case = {case: _seen(by_frame[at][place]) for case, by_frame in alone.items()}
            row = _LabelledFrame(frame.scene.time_ns / 1e9, seen, by_case, target, nearest, answers)
            rows_of.setdefault(name, []).append(row)
    return [_person(pair.clip, rows) for rows in rows_of.values()]


def _attended(
    frames: Iterable[SceneFrame], settings: AttendSettings, case: Case | None, check: Callable[[], None]
) -> Iterator[tuple[Attention, ...]]:
    """Yield everyone's attention in each frame; with a case as if only its direction had been measured."""
    attending = Attending(settings, _OfCase(LogitSettings(method="logit"), case))
    for frame in frames:
        check()
        (result,) = attending.step(frame.scene, frame.tracked, frame.names)
        yield result.attentions


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


class _LabelledFrame(NamedTuple):
    """A person in a frame: features, true target, the nearest one as in :class:`LabelledPerson`, and the answers."""

    time_s: float
    seen: FrameFeatures
    alone: Mapping[Case, FrameFeatures | None]
    target: int | None
    nearest: Sequence[float]
    answers: Mapping[str, ScoredAnswer]


def _person(clip: str, rows: Sequence[_LabelledFrame]) -> LabelledPerson:
    missing: ScoredAnswer = (False, math.nan, math.nan)
    names = dict.fromkeys(name for row in rows for name in row.answers)
    return LabelledPerson(
        sequence=LabelledSequence(
            group=clip,
            times_s=[row.time_s for row in rows],
            seen=[row.seen for row in rows],
            alone={case: [row.alone[case] for row in rows] for case in rows[0].alone},
            targets=[row.target for row in rows],
        ),
        nearest=np.array([row.nearest for row in rows], dtype=np.float64),
        others={name: np.array([row.answers.get(name, missing) for row in rows], np.float64) for name in names},
    )


def _answers(run: FinishedRun, reference: Reference) -> Answers:
    """The answers of all configurations, of the first seed of each."""
    answers: dict[tuple[str, str, int], dict[str, ScoredAnswer]] = {}
    for columns in run.columns():
        name, base = columns.configuration, base_of(columns.configuration)
        if columns.clip in reference.labels and (base == name or name.endswith(".seed1")):
            for subject, judged in pair_verdicts(columns, reference).by_subject.items():
                for frame, outcome in _scored_answers(judged):
                    answers.setdefault((columns.clip, subject, frame), {})[base] = outcome
    return answers


def _scored_answers(judged: SubjectVerdicts) -> Iterator[tuple[int, ScoredAnswer]]:
    """Yield the scored frames of a subject."""
    scored = judged.where(judged.is_scored)
    columns = scored.frames, ~scored.is_wrong, *scored.worth[:, :2].T
    for frame, is_right, confidence, on_truth in zip(*(column.tolist() for column in columns), strict=True):
        yield frame, (is_right, confidence, on_truth if confidence >= 0 else math.nan)
