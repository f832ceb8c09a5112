"""A finished run as labelled sequences, for fits: everyone's features and labels, and the answers of other methods."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from harness.labels.labels import Labels
from harness.run.columns import LookColumns, SceneColumns, Words
from harness.run.directory import Pair, RunDirectory
from harness.run.grid import base_of
from harness.run.records import BoxRecord, FrameRecord, SubjectRecord, TargetRecord
from harness.run.table_files import find_tables
from harness.run.table_scenes import Clouds, read_clouds
from harness.score.finished_run import FinishedRun
from harness.score.picks import picks_of, view_of
from harness.score.reference import Reference
from harness.score.score import pair_verdicts
from harness.score.verdict_columns import LabelColumns, SubjectVerdicts, hits_of, named_by
from harness.score.verdicts import find_subject
from vfoa.cones import ConesSettings, pay_attention
from vfoa.errors import VfoaError, check_known
from vfoa.logit import LogitSettings, Remembered
from vfoa.logit import weigh_attentions as weigh
from vfoa.logit_cues import ROWS, Case, Seen
from vfoa.logit_fit import UNKNOWN, LabelledSequence
from vfoa.types import Box3D, Cues, Float, Gaze, HeadPose, Instance, Person, Subject, Target

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
        If the run is not finished, has no such configuration, or no labelled frame with a measured direction.
    """
    run = FinishedRun.read(directory)
    known = run.manifest.configurations
    bases = list(dict.fromkeys(base_of(name) for name in known))
    logits = [base_of(name) for name in known if known[name].get("attention", {}).get("method") == "logit"]
    chosen = configuration or next(iter((*logits, *bases)))
    check_known(chosen, bases, f"{directory.path}: no configuration")
    reference = run.reference()
    truths, answers = _truths(run, reference.labels, [chosen]), _answers(run, reference)
    records, clouds = run.records([chosen]), _clouds(run)
    return labelled_runs(run.manifest.experiment, records, truths, clouds, [chosen], tuple(ROWS), answers)[0]


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
    truths = _truths(run, run.reference().labels, configurations)
    records, clouds = run.records(configurations), _clouds(run)
    return labelled_runs(run.manifest.experiment, records, truths, clouds, configurations, cases)


CloudsOf = Callable[[Pair], Iterator[Clouds]]
"""The clouds of each frame of a clip under a configuration."""


def clouds_of(tables: Mapping[Pair, Mapping[str, Path]]) -> CloudsOf:
    """Return what reads the clouds that the logit asks for from these tables."""
    return lambda pair: read_clouds(tables[pair], LogitSettings(method="logit").cloud_points)


def _clouds(run: FinishedRun) -> CloudsOf:
    return clouds_of(dict(find_tables(run.directory, manifest=run.manifest)))


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


def _truths(run: FinishedRun, labels: Mapping[str, Labels], configurations: Collection[str]) -> dict[Pair, LabelTruths]:
    return {
        (each.clip, each.configuration): truths_of(each.scene, each.looks, labels[each.clip], each.words)
        for each in run.columns(configurations)
        if each.clip in labels
    }


Answers = Mapping[tuple[str, str, int], Mapping[str, ScoredAnswer]]
"""The outcome of each configuration by clip, subject and labelled frame."""


def labelled_runs(
    experiment: str,
    records: Iterable[FrameRecord],
    truths: Mapping[Pair, LabelTruths],
    clouds: CloudsOf,
    configurations: Collection[str],
    cases: Collection[Case] | None = None,
    others: Answers | None = None,
) -> list[LabelledRun]:
    """Return the features and labels of configurations, by their names without seeds, from records in one pass.

    ``truths`` and ``clouds`` are those of each labelled clip under each of them; ``cases`` as in :func:`read_features`;
    ``others`` are the answers of all configurations.

    Raises
    ------
    VfoaError
        If no labelled frame of a configuration has a measured direction, or the run kept no clouds of its targets.
    """
    records_of: dict[str, dict[Pair, list[FrameRecord]]] = {name: {} for name in configurations}
    for record in records:
        if (pair := (record.clip, record.configuration)) in truths:
            records_of[base_of(record.configuration)].setdefault(pair, []).append(record)
    runs = []
    for name, by_run in records_of.items():
        seeds = len({configuration for _, configuration in by_run})
        people = [
            person
            for pair, records in by_run.items()
            for person in labelled_people(
                pair[0], records, truths[pair], others, 1 / seeds, cases, clouds=partial(clouds, pair)
            )
        ]
        if not any(person.labelled for person in people):
            raise VfoaError(f"fit: {experiment}: no labelled frame has measured directions; expected labelled clips")
        runs.append(LabelledRun(experiment=experiment, configuration=name, seeds=seeds, people=people))
    return runs


def labelled_people(
    clip: str,
    records: Sequence[FrameRecord],
    truths: LabelTruths,
    others: Answers | None,
    weight: float,
    cases: Collection[Case] | None = None,
    *,
    clouds: Callable[[], Iterator[Clouds]],
) -> list[LabelledPerson]:
    """Return everyone's features and labels in a clip. A frame whose true target has no box counts as unlabelled.

    Without the answers of ``others``, those of two cones are left out, too. ``cases``: those that will be fitted;
    without it, those that the clip has. ``clouds``: those of each record's targets.
    """
    measured = list(_seen(records, clouds(), None))
    found = {seen.case for by_track in measured for seen in by_track.values()}
    single = ({*ROWS} if cases is None else {*cases}) - {"both"} if "both" in found else set[Case]()
    if cases is None:
        single &= found
    alone = {case: list(_seen(records, clouds(), case)) for case in sorted(single)}
    rows_of: dict[str, list[_Row]] = {}
    for number, record in enumerate(records):
        for name, of_person in truths.items():
            person = find_subject(record, name)
            if person is None or (seen := measured[number].get(person.track_id)) is None:
                continue
            right, *nearest = of_person[record.frame]
            target = next((answer for answer in right if answer in (None, *seen.ids)), UNKNOWN)
            answers = dict[str, ScoredAnswer]()
            if others is not None:
                answers = dict(others.get((clip, name, record.frame), {}))
                if target != UNKNOWN:
                    cones = pay_attention(_subject(person), tuple(map(_target, record.targets)), _CONES)
                    answers[TWO_CONES] = cones.focus in right, math.nan, math.nan
            by_case = {case: by_frame[number].get(person.track_id) for case, by_frame in alone.items()}
            rows_of.setdefault(name, []).append(_Row(record.time_ns / 1e9, seen, by_case, target, nearest, answers))
    return [_person(clip, rows, weight) for rows in rows_of.values()]


def _seen(records: Sequence[FrameRecord], clouds: Iterator[Clouds], case: Case | None) -> Iterator[dict[int, Seen]]:
    """Yield everyone's features in each frame by track; with a case as if only its direction had been measured."""
    settings = LogitSettings(method="logit")
    states: dict[int, Remembered] = {}
    for record, points in zip(records, clouds, strict=True):
        targets = tuple(_with_cloud(target, points, record) for target in record.targets)
        subjects = {subject.track_id: _subject(subject, case) for subject in record.subjects}
        before = tuple(states.get(track, Remembered()) for track in subjects)
        attentions, after = weigh(tuple(subjects.values()), targets, before, settings, record.time_ns)
        states.update(zip(subjects, after, strict=True))
        yield {
            attention.subject.track_id: attention.belief
            for attention in attentions
            if isinstance(attention.belief, Seen)
        }


class _Row(NamedTuple):
    """A person in a frame: features, true target, the nearest one as in :class:`LabelledPerson`, and the answers."""

    time_s: float
    seen: Seen
    alone: Mapping[Case, Seen | None]
    target: int | None
    nearest: Sequence[float]
    answers: Mapping[str, ScoredAnswer]


def _person(clip: str, rows: Sequence[_Row], weight: float) -> LabelledPerson:
    missing: ScoredAnswer = (False, math.nan, math.nan)
    names = dict.fromkeys(name for row in rows for name in row.answers)
    return LabelledPerson(
        sequence=LabelledSequence(
            group=clip,
            times_s=[row.time_s for row in rows],
            seen=[row.seen for row in rows],
            alone={case: [row.alone[case] for row in rows] for case in rows[0].alone},
            targets=[row.target for row in rows],
            weight=weight,
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


def _subject(record: SubjectRecord, case: Case | None = None) -> Subject:
    """A person of a record as attention takes it, with the directions after the filter: all, or that of a case."""
    gaze = head = None
    if record.gaze is not None and case != "head":
        gaze = Gaze(direction=np.array(record.gaze), sigma_rad=record.gaze_sigma_rad)
    if record.head is not None and case != "gaze":
        head = HeadPose(direction=np.array(record.head))
    origin = None if record.eye_origin_m is None else np.array(record.eye_origin_m)
    number = -record.track_id if record.instance_id is None else record.instance_id  # no target has a negative id
    person = Person(view=Cues(head_pose=head, gaze=gaze), instance_id=number, eye_origin_left=origin)
    return Subject(track_id=record.track_id, person=person, gaze=gaze, head_pose=head)


def _with_cloud(target: TargetRecord, clouds: Clouds, record: FrameRecord) -> Target:
    """A target of a record as attention takes it, with its cloud."""
    cloud = clouds.get(target.instance_id)
    if cloud is None and target.points:
        raise VfoaError(
            f"fit: {record.clip}: {record.configuration} kept no clouds of its targets, which the logit looks at; "
            'expected a run with attention.method = "logit" or "bayes"'
        )
    return _target(target) if cloud is None else replace(_target(target), points_left=cloud)


def _target(record: TargetRecord) -> Target:
    """A target of a record as attention takes it, with its box only: records have no clouds."""
    instance = Instance(id=record.instance_id, label=record.label, category_id=0, is_thing=True, score=record.score)
    return Target(
        instance=instance,
        box_px=None,
        points_left=np.zeros((0, 3), np.float32),
        box=None if record.box is None else _box(record.box),
    )


def _box(record: BoxRecord) -> Box3D:
    return Box3D(
        center_m=np.array(record.center_m),
        half_size_m=np.array(record.half_size_m),
        left_from_box=np.array(record.axes).T,
    )
