"""Judged subjects: verdicts as columns of the scored frames of one subject in one clip under one configuration."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from harness.files.groups import grouped
from harness.labels.labels import NOWHERE
from harness.run.columns import Words
from harness.run.directory import Pair
from harness.score.baselines import BASELINES, best_limit_rad, commonest
from harness.score.looks import LEAST_S, correlation_time_s, number_looks
from harness.score.reference import Reference
from harness.score.verdict_columns import PairVerdicts, SubjectVerdicts
from vfoa.scoring import NO_HIT
from vfoa.types import Codes, Flags, Float

NO_PREDICTION = -1


@dataclass(frozen=True, slots=True, kw_only=True)
class JudgedSubject:
    """A subject's frames in order: all of them as judged, and columns (n,) of the scored ones.

    ``truth`` and ``predicted`` are codes of names, the same in a whole run; :data:`NO_PREDICTION` if there is none.
    ``positions`` count the clip's frames, so that a difference above 1 is a gap; ``frames`` are their numbers.
    ``looks`` number the looks (see :mod:`harness.score.looks`). ``no_hit`` are the frames in which nothing got any
    attention, ``nowhere`` those in which the subject looks at nothing, ``says_nowhere`` those in which the method says
    so, ``blocked`` those whose line of sight the label calls blocked. ``confidence``, ``on_truth``, ``brier``,
    ``set_size`` and ``is_covered`` are as in :class:`harness.score.verdicts.Worth`. ``baselines`` (n, baselines)
    says which baselines were right, in the order of :data:`harness.score.baselines.BASELINES`, and ``baselines_right``
    (baselines,) in how many of the labelled frames: of all of them, if only some are scored. ``angles_rad`` is the
    smallest angle from the gaze to a box's centre, NaN if not known. ``rate_hz`` is the rate of the clip's frames, None
    if unknown.
    """

    clip: str
    configuration: str
    subject: str
    judged: SubjectVerdicts
    frames: NDArray[np.int64]
    positions: Codes
    looks: Codes
    correct: Flags
    truth: Codes
    predicted: Codes
    no_hit: Flags
    nowhere: Flags
    says_nowhere: Flags
    blocked: Flags
    confidence: Float
    on_truth: Float
    brier: Float
    set_size: Float
    is_covered: Flags
    baselines: Flags
    baselines_right: Codes
    angles_rad: Float
    rate_hz: float | None

    @property
    def true_names(self) -> list[str | None]:
        """The true target of each scored frame."""
        return self.judged.words.words(self.judged.truth[self.judged.is_scored])

    @property
    def error_types(self) -> dict[str, int]:
        """The number of wrong frames by error type."""
        return self.judged.words.counts(self.judged.error_type)


def judged_subjects(
    judged: Mapping[Pair, PairVerdicts],
    reference: Reference,
    whole: Mapping[Pair, PairVerdicts] | None = None,
    phase: str | None = None,
) -> list[JudgedSubject]:
    """The subjects of all judged records, and of every labelled frame without a record; or of one phase's records.

    In order of clip, configuration (both as they first appear in the records) and subject (by name). The baselines of a
    phase are fitted to that phase of the other clips. ``whole`` are the verdicts on all labelled frames if ``judged``
    are those on some: baselines are fitted to them, and counted on them.
    """
    codes: dict[str, int] = {}
    subjects = _with_longer_looks([*_subjects_of(judged, reference, phase, codes)])
    if not whole:
        return _with_baselines(subjects, subjects, judged, codes)
    of_all = [*_subjects_of(whole, reference, phase, codes)]
    right = {_key(each): each.baselines_right for each in _with_baselines(of_all, of_all, whole, codes)}
    found = _with_baselines(subjects, of_all, judged, codes)
    return [replace(of_subject, baselines_right=right[_key(of_subject)]) for of_subject in found]


def _key(of_subject: JudgedSubject) -> tuple[str, str, str]:
    return of_subject.clip, of_subject.configuration, of_subject.subject


def _subjects_of(
    judged: Mapping[Pair, PairVerdicts], reference: Reference, phase: str | None, codes: dict[str, int]
) -> Iterator[JudgedSubject]:
    for name, parts in grouped((clip, part) for (clip, _), part in judged.items()).items():
        wanted = np.array(reference.wanted_frames(name), dtype=np.int64)
        frames = np.unique(np.concatenate([wanted, *(part.frames for part in parts)]))
        rate = _rate_hz(parts)
        for part in parts:
            for of_subject in part.by_subject.values():
                in_phase = of_subject if phase is None else of_subject.where(part.is_in(of_subject.frames, phase))
                yield _judged_subject(in_phase, frames, rate, codes)


def _rate_hz(parts: Sequence[PairVerdicts]) -> float | None:
    """The frame rate by the median step between frames that have a time; None if all times are equal."""
    frames, times_ns = (np.concatenate([getattr(part, name) for part in parts]) for name in ("frames", "times_ns"))
    _, last = np.unique(frames[::-1], return_index=True)
    times = times_ns[::-1][last]
    step_ns = float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    return 1e9 / step_ns if step_ns > 0 else None


def _with_longer_looks(subjects: list[JudgedSubject]) -> list[JudgedSubject]:
    """The subjects with looks joined until they last twice as long as verdicts of this run stay alike."""
    least_s = 2 * correlation_time_s(
        (of_subject.correct, of_subject.positions, of_subject.rate_hz) for of_subject in subjects
    )
    if least_s <= LEAST_S:
        return subjects
    return [
        replace(of_subject, looks=number_looks(of_subject.truth, of_subject.positions, of_subject.rate_hz, least_s))
        for of_subject in subjects
    ]


def _judged_subject(judged: SubjectVerdicts, frames: Codes, rate: float | None, codes: dict[str, int]) -> JudgedSubject:
    """The columns of a subject. ``frames`` are all of the clip, ``codes`` the numbers of names in the whole run."""
    scored, words = judged.where(judged.is_scored), judged.words
    truth = _coded(scored.truth, words, codes)
    positions = np.searchsorted(frames, scored.frames)
    confidence, on_truth, brier, set_size, is_covered = scored.worth.T
    never = np.zeros((len(truth), 1), dtype=np.bool_)
    return JudgedSubject(
        clip=judged.clip,
        configuration=judged.configuration,
        subject=judged.subject,
        judged=judged,
        frames=scored.frames,
        positions=positions,
        looks=number_looks(truth, positions, rate),
        correct=~scored.is_wrong,
        truth=truth,
        predicted=_coded(scored.answers(), words, codes),
        no_hit=scored.predicted == words.code(NO_HIT),
        nowhere=scored.truth == words.code(NOWHERE),
        says_nowhere=scored.predicted == words.code(NOWHERE),
        blocked=scored.is_blocked,
        confidence=confidence,
        on_truth=on_truth,
        brier=brier,
        set_size=set_size,
        is_covered=is_covered.astype(np.bool_),
        baselines=np.concatenate([never, scored.hits, never], axis=1),
        baselines_right=np.zeros(len(BASELINES), dtype=np.intp),
        angles_rad=scored.angles_rad,
        rate_hz=rate,
    )


def _with_baselines(
    subjects: list[JudgedSubject],
    fitted_to: list[JudgedSubject],
    judged: Mapping[Pair, PairVerdicts],
    codes: Mapping[str, int],
) -> list[JudgedSubject]:
    """The subjects with the hits of the baselines that are fitted to labels, and the counts of all baselines."""
    found = _with_commonest(_with_constant(subjects, fitted_to, codes), fitted_to, judged, codes)
    found = _with_limits(found, fitted_to)
    return [replace(each, baselines_right=np.count_nonzero(each.baselines, axis=0)) for each in found]


def _with_hits(of_subject: JudgedSubject, baseline: str, hits: Flags) -> JudgedSubject:
    baselines = of_subject.baselines.copy()
    baselines[:, list(BASELINES).index(baseline)] = hits
    return replace(of_subject, baselines=baselines)


def _with_constant(
    subjects: list[JudgedSubject], fitted_to: list[JudgedSubject], codes: Mapping[str, int]
) -> list[JudgedSubject]:
    """The subjects with the hits of their own commonest label."""
    own = {_key(each): _commonest_code(np.bincount(each.truth, minlength=len(codes)), codes) for each in fitted_to}
    return [_with_hits(each, "constant", each.truth == own[_key(each)]) for each in subjects]


def _with_commonest(
    subjects: list[JudgedSubject],
    fitted_to: list[JudgedSubject],
    judged: Mapping[Pair, PairVerdicts],
    codes: Mapping[str, int],
) -> list[JudgedSubject]:
    """The subjects with the hits of the commonest label of the other clips, by configuration."""
    counts: dict[tuple[str, str], Codes] = {}
    for of_subject in fitted_to:
        key = of_subject.configuration, of_subject.clip
        counts[key] = counts.get(key, 0) + np.bincount(of_subject.truth, minlength=len(codes))
    totals: dict[str, Codes] = {}
    for (configuration, _), of_clip in counts.items():
        totals[configuration] = totals.get(configuration, 0) + of_clip
    found = []
    for of_subject in subjects:
        others = totals[of_subject.configuration] - counts[of_subject.configuration, of_subject.clip]
        targets = {*judged[of_subject.clip, of_subject.configuration].targets, NOWHERE} - {of_subject.subject}
        always = _commonest_code(others, {name: code for name, code in codes.items() if name in targets})
        found.append(_with_hits(of_subject, "commonest", of_subject.truth == always))
    return found


def _commonest_code(counts: Codes, codes: Mapping[str, int]) -> int | None:
    """The code of the commonest of these names, of counts by code; None if none of them occurs."""
    name = commonest({name: int(counts[code]) for name, code in codes.items() if counts[code]})
    return None if name is None else codes[name]


def _with_limits(subjects: list[JudgedSubject], fitted_to: list[JudgedSubject]) -> list[JudgedSubject]:
    """The subjects with the limit of ``nearest_in_angle`` that is best on the other clips, by configuration."""
    place = list(BASELINES).index("nearest_in_angle")
    by_configuration = grouped((of_subject.configuration, of_subject) for of_subject in fitted_to)
    limits = {name: _limits_rad(group, place) for name, group in by_configuration.items()}
    limited = []
    for of_subject in subjects:
        is_target = of_subject.angles_rad <= limits[of_subject.configuration][of_subject.clip]
        says_nothing = np.isfinite(of_subject.angles_rad) & ~is_target
        hits = (of_subject.baselines[:, place] & is_target) | (of_subject.nowhere & says_nothing)
        limited.append(_with_hits(of_subject, "nearest_in_angle", hits))
    return limited


def _limits_rad(subjects: Sequence[JudgedSubject], place: int) -> dict[str, float]:
    """The limit that is best on the other clips, by clip; infinity where there are none."""
    clips = list(dict.fromkeys(of_subject.clip for of_subject in subjects))
    if len(clips) == 1:
        return {clips[0]: math.inf}
    angles_rad = np.concatenate([of_subject.angles_rad for of_subject in subjects])
    hits = np.concatenate([of_subject.baselines[:, place] for of_subject in subjects])
    nowhere = np.concatenate([of_subject.nowhere for of_subject in subjects])
    numbers = {clip: number for number, clip in enumerate(clips)}
    clip_at = np.repeat([numbers[each.clip] for each in subjects], [len(each.angles_rad) for each in subjects])
    order = np.argsort(angles_rad, kind="stable")  # those of the other clips are then in order for each clip
    frames = [column[order] for column in (angles_rad, hits, nowhere)]
    of_others = ((clip, clip_at[order] != number) for clip, number in numbers.items())
    return {clip: best_limit_rad(*(column[others] for column in frames)) for clip, others in of_others}


def _coded(found: Codes, words: Words, codes: dict[str, int]) -> Codes:
    """The numbers of names in the whole run, which count names as they appear; :data:`NO_PREDICTION` for none."""
    named, first, places = np.unique(found, return_index=True, return_inverse=True)
    numbers = np.full(len(named), NO_PREDICTION, dtype=np.intp)
    for place in np.argsort(first).tolist():
        if (name := words.word(int(named[place]))) is not None:
            numbers[place] = codes.setdefault(name, len(codes))
    return numbers[places]
