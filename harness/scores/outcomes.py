"""From records and labels to columns: the scored frames of one subject in one clip under one configuration."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from harness.annotations.files import Label, Labels
from harness.runs.results import FrameRecord
from harness.scores.baselines import Choices, Rules, commonest
from harness.scores.reference import Reference
from harness.scores.statistics import Codes, Flags, block_length, resampled_sums
from harness.scores.verdicts import Verdict, find_subject, judge, judge_absent, true_targets
from vfoa.types import Float

NO_PREDICTION = -1
ANOTHER = "(another of this name)"
"""Appended to a predicted name that is the truth's, but of another instance: it must not count as agreement."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcomes:
    """A subject's frames in order: all verdicts, and columns (n,) of the scored ones.

    ``truth`` and ``predicted`` are codes of names, the same in a whole run; :data:`NO_PREDICTION` where there is none.
    ``positions`` count the clip's frames, so that a difference above 1 is a gap. ``baselines`` (n, rules) says
    which rule was right, in the order of :data:`harness.scores.baselines.RULES`. ``causes`` are the wrong frames'.
    ``resampled`` (replicates,) are the correct frames in each resample of the bootstrap.
    """

    clip: str
    configuration: str
    subject: str
    verdicts: tuple[Verdict, ...]
    positions: Codes
    correct: Flags
    truth: Codes
    predicted: Codes
    baselines: Flags
    causes: tuple[str, ...]
    resampled: Float


_Hits = tuple[bool, bool, bool]
_NO_HITS: _Hits = (False, False, False)


_Judged = dict[int, tuple[Verdict, _Hits]]
"""By frame: the verdict, and which of the rules that look at the frame were right."""


@dataclass(slots=True)
class _Clip:
    """What is known of a clip over all its configurations."""

    labels: Labels | None
    wanted: list[int]
    times_ns: dict[int, int] = field(default_factory=dict)
    _by_frame: dict[int, dict[str, Label]] = field(default_factory=dict)

    def labels_in(self, frame: int) -> dict[str, Label]:
        """The labels of a frame by subject; every configuration asks for the same ones again."""
        if frame not in self._by_frame:
            found = self.labels.labelled([frame]) if self.labels else ()
            self._by_frame[frame] = {subject: label for _, subject, label in found}
        return self._by_frame[frame]

    def positions(self) -> dict[int, int]:
        """Every frame's place in the clip."""
        return {frame: place for place, frame in enumerate(sorted({*self.wanted, *self.times_ns}))}

    def frames_per_second(self) -> float | None:
        """The rate by the median step between the frames that have a time; None where time stands still."""
        times = np.array([time for _, time in sorted(self.times_ns.items())])
        step_ns = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
        return 1e9 / step_ns if step_ns > 0 else None


def collect_outcomes(records: Iterable[FrameRecord], reference: Reference) -> list[Outcomes]:
    """Judge every frame of every labelled or named subject, and every labelled frame of which there is no record.

    In order of clip, configuration (both as they first appear in the records) and subject (by name).
    """
    clips: dict[str, _Clip] = {}
    tracks: dict[tuple[str, str], dict[str, _Judged]] = {}
    for record in records:
        if record.clip not in clips:
            labels = reference.labels.get(record.clip)
            clips[record.clip] = _Clip(labels=labels, wanted=_wanted(labels, reference.frames.get(record.clip)))
        clip = clips[record.clip]
        clip.times_ns[record.frame] = record.time_ns
        _judge_record(record, clip, tracks.setdefault((record.clip, record.configuration), {}))
    for (name, configuration), by_subject in tracks.items():
        _judge_absent_frames(name, configuration, clips[name], by_subject)
    codes: dict[str, int] = {}
    places = {name: clip.positions() for name, clip in clips.items()}
    rates = {name: clip.frames_per_second() for name, clip in clips.items()}
    first_seen = {name: order for order, name in enumerate(clips)}
    return [
        _outcomes((name, configuration, subject), judged, places[name], rates[name], codes)
        for (name, configuration), by_subject in sorted(tracks.items(), key=lambda item: first_seen[item[0][0]])
        for subject, judged in sorted(by_subject.items())
    ]


def _wanted(labels: Labels | None, frames: Iterable[int] | None) -> list[int]:
    if frames is not None:
        return sorted(set(frames))
    if labels is None:
        return []
    return sorted({frame for row in labels.ranges for frame in range(row.first_frame, row.last_frame + 1)})


def _judge_record(record: FrameRecord, clip: _Clip, by_subject: dict[str, _Judged]) -> None:
    labels = clip.labels_in(record.frame)
    rules = Rules(record) if labels else None
    named = [subject.name for subject in record.subjects if subject.name is not None]
    for subject in dict.fromkeys((*labels, *named)):
        label = labels.get(subject)
        verdict = judge(record, subject, label)
        hits = _NO_HITS
        if rules and label and verdict.outcome != "unscored":
            hits = _hits(record, rules.choose(find_subject(record, subject)), label)
        by_subject.setdefault(subject, {})[record.frame] = verdict, hits


def _hits(record: FrameRecord, choices: Choices, label: Label) -> _Hits:
    right = {target.instance_id for target in true_targets(record, label)}
    return choices.nearest in right, choices.largest in right, choices.central in right


def _judge_absent_frames(clip: str, configuration: str, known: _Clip, by_subject: dict[str, _Judged]) -> None:
    for frame in known.wanted:
        for subject, label in known.labels_in(frame).items():
            judged = by_subject.setdefault(subject, {})
            if frame not in judged:
                judged[frame] = judge_absent(clip, configuration, frame, subject, label), _NO_HITS


def _outcomes(
    key: tuple[str, str, str], judged: _Judged, places: dict[int, int], rate: float | None, codes: dict[str, int]
) -> Outcomes:
    clip, configuration, subject = key
    in_order = [judged[frame] for frame in sorted(judged)]
    scored = [(verdict, hits) for verdict, hits in in_order if verdict.outcome != "unscored"]
    truths = [str(verdict.truth) for verdict, _ in scored]
    always = commonest(truths)
    correct = np.array([verdict.outcome == "correct" for verdict, _ in scored], dtype=np.bool_)
    positions = np.array([places[verdict.frame] for verdict, _ in scored], dtype=np.intp)
    return Outcomes(
        clip=clip,
        configuration=configuration,
        subject=subject,
        verdicts=tuple(verdict for verdict, _ in in_order),
        positions=positions,
        correct=correct,
        truth=_coded(truths, codes),
        predicted=_coded([answer(verdict) for verdict, _ in scored], codes),
        baselines=np.array([(truth == always, *hits) for truth, (_, hits) in zip(truths, scored, strict=True)]),
        causes=tuple(verdict.cause for verdict, _ in scored if verdict.cause is not None),
        resampled=resampled_sums(correct, _block(positions, rate), key=f"{clip}/{subject}"),
    )


def _block(positions: Codes, rate: float | None) -> int:
    """Scored frames in a bootstrap block: labels may be sparser than the clip's frames."""
    stride = float(np.median(np.diff(positions))) if len(positions) > 1 else 1.0
    return block_length(len(positions), rate / stride if rate else None)


def answer(verdict: Verdict) -> str | None:
    """The predicted name, marked where it is the truth's but another instance was meant; None without prediction."""
    if verdict.outcome == "wrong" and verdict.predicted == verdict.truth:
        return f"{verdict.predicted} {ANOTHER}"
    return verdict.predicted


def _coded(names: Iterable[str | None], codes: dict[str, int]) -> Codes:
    coded = [NO_PREDICTION if name is None else codes.setdefault(name, len(codes)) for name in names]
    return np.array(coded, dtype=np.intp)
