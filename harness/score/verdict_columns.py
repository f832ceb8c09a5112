"""The verdicts of a configuration on a clip as columns: a row for each frame of a subject.

All frames of a clip are judged at once; the tests judge frame by frame, by the rules of :mod:`harness.score.verdicts`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.labels.labels import IGNORED, NOWHERE, LabelRange, Labels
from harness.run.columns import NO_ID, UNKNOWN, PairColumns, SceneColumns, Words
from harness.run.manifest import AnswerTraits
from harness.score.baselines import View, picks_of, view_of
from harness.score.verdicts import (
    NO_OBJECT,
    NO_PROBABILITIES,
    OF_SCENE,
    SET_LEVEL,
    SET_ROUNDING,
    UNKNOWN_WORTH,
    Outcome,
    Verdict,
)
from vfoa.scoring import ANOTHER, NO_HIT
from vfoa.types import Codes, Flags, Float

COMPARED_EVERY = 4
"""Every Nth frame is checked for signs of other axes and units."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SubjectVerdicts:
    """A subject's frames in order, as columns (n,): verdicts, and what the answers are worth.

    ``truth``, ``predicted`` and ``error_type`` are codes of ``words``, :data:`harness.run.columns.UNKNOWN` without a
    label, an answer, an error. ``is_scored`` are the frames with a label that is not ``ignore``. ``true_ids`` are the
    ids of the instances that the labels mean, :data:`harness.run.columns.NO_ID` for none, or any of several.
    ``confidence`` is the probability of the answer, NaN without one, also of frames that are not scored. ``worth`` (n,
    5) are the fields of :class:`harness.score.verdicts.Worth`; ``hits`` (n, 4) says which of the baselines that use the
    frame are right, and ``angles_rad`` is the smallest angle from the direction to a box's centre, NaN if not known.
    """

    words: Words
    clip: str
    configuration: str
    subject: str
    frames: NDArray[np.int64]
    truth: Codes
    predicted: Codes
    error_type: Codes
    is_scored: Flags
    is_blocked: Flags
    true_ids: NDArray[np.int64]
    confidence: Float
    worth: Float
    hits: Flags
    angles_rad: Float

    def where(self, chosen: Flags | Codes) -> SubjectVerdicts:
        """The chosen frames."""
        columns = {each.name: getattr(self, each.name) for each in fields(self)}
        of_chosen: dict[str, Any] = {
            name: column[chosen] for name, column in columns.items() if isinstance(column, np.ndarray)
        }
        return replace(self, **of_chosen)

    @property
    def is_wrong(self) -> Flags:
        """The frames with an error type."""
        return self.error_type != UNKNOWN

    def answers(self) -> Codes:
        """The code of the answer that each prediction counts as (:func:`harness.score.verdicts.answer`)."""
        code, answers = self.words.code, self.predicted.copy()
        is_same = self.is_wrong & (self.predicted == self.truth)
        for same in np.unique(self.predicted[is_same]).tolist():
            answers[is_same & (self.predicted == same)] = code(f"{self.words.word(same)} {ANOTHER}")
        answers[self.predicted == code(NO_HIT)] = UNKNOWN
        return np.where(self.is_scored & ~self.is_wrong, self.truth, answers)

    def verdicts(self) -> list[Verdict]:
        """The verdict of each frame."""
        outcomes: list[Outcome] = ["unscored", "correct", "wrong"]
        return [
            Verdict(
                clip=self.clip,
                configuration=self.configuration,
                frame=frame,
                subject=self.subject,
                truth=truth,
                predicted=predicted,
                outcome=outcomes[is_scored + (error_type is not None)],
                error_type=error_type,
                confidence=None if math.isnan(confidence) else confidence,
            )
            for frame, truth, predicted, error_type, is_scored, confidence in zip(
                self.frames.tolist(),
                *map(self.words.words, (self.truth, self.predicted, self.error_type)),
                self.is_scored.tolist(),
                self.confidence.tolist(),
                strict=True,
            )
        ]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PairVerdicts:
    """The verdicts of a configuration on a clip by subject, and what notes and checks take from its F frames.

    ``phase_of`` (F,) are codes of phases. ``fits`` (n, 4) are those of all frames of named subjects, labelled or not.
    ``aims`` (n, 2, 3) are some directions, each with the vector from the eyes to what the label says.
    ``head_widths_m`` and ``head_heights_px`` are some widths and heights of heads, ``depths_m`` some depths of eyes (n,
    2), each with the change of it by a pixel of disparity, ``targets`` the names of all targets that were found.
    ``held_boxes`` and ``held_eyes`` are the shares of 3D boxes and eyes at the depth of an earlier frame, ``cut_heads``
    that of heads that the image's border cuts; 0 of none.
    """

    words: Words
    by_subject: Mapping[str, SubjectVerdicts]
    frames: NDArray[np.int64]
    times_ns: NDArray[np.int64]
    phase_of: Codes
    fits: Float
    aims: Float
    head_widths_m: Float
    head_heights_px: Float
    depths_m: Float
    held_boxes: float
    held_eyes: float
    cut_heads: float
    targets: frozenset[str]

    def is_in(self, frames: NDArray[np.int64], phase: str) -> Flags:
        """Whether each of some frames is in a phase; one without a record is in none."""
        return np.isin(frames, self.frames[self.phase_of == self.words.code(phase)])


def judge_columns(
    columns: PairColumns,
    labels: Labels | None,
    wanted: Iterable[int],
    traits: AnswerTraits,
    phases: Mapping[int, str],
) -> PairVerdicts:
    """Judge every labelled or named subject of a configuration on a clip.

    Parameters
    ----------
    wanted
        The frames that are scored if they have a label: one without a record is wrong, like any without a prediction.
    phases
        The name of each phase by the number of things beside people in a frame.
    """
    scene, looks, words = columns.scene, columns.looks, columns.words
    named = {word: code for code in np.unique(scene.person_names).tolist() if (word := words.word(code)) is not None}
    pair = _Pair(columns, traits)
    judged, at, aims = dict[str, SubjectVerdicts](), [np.zeros(0, dtype=np.intp)], list[Float]([np.zeros((0, 2, 3))])
    absent = np.setdiff1d(np.array([*wanted], dtype=np.int64), scene.frames)
    for subject in sorted({*named, *(labels.subjects if labels else ())}):
        found, places, of_subject = pair.judge(subject, labels, absent)
        if len(found.frames):
            judged[subject] = found
        at.append(places)
        aims.append(of_subject)
    is_compared = scene.person_at % COMPARED_EVERY == 0
    widths_m, heights_px = looks.head_widths_m[is_compared], scene.head_heights_px[is_compared]
    depths_m = looks.eyes_m[is_compared, 2]
    steps_m = depths_m**2 / scene.pixel_metres[scene.person_at[is_compared]]
    return PairVerdicts(
        words=words,
        by_subject=judged,
        frames=scene.frames,
        times_ns=scene.times_ns,
        phase_of=_phases(scene, words, phases),
        fits=columns.fits[~np.isnan(columns.fits[:, 0]) & (scene.person_names != UNKNOWN)],
        aims=np.concatenate(aims)[np.argsort(np.concatenate(at), kind="stable")],  # frame by frame
        head_widths_m=widths_m[~np.isnan(widths_m) & (widths_m != 0)],
        head_heights_px=heights_px[~np.isnan(heights_px)],
        depths_m=np.stack([depths_m, steps_m], axis=1)[np.isfinite(steps_m)],
        held_boxes=_share(scene.is_held[~np.isnan(scene.centers_m[:, 0])]),
        held_eyes=_share(looks.is_held[~np.isnan(looks.eyes_m[:, 0])]),
        cut_heads=_share(scene.is_cut[~np.isnan(scene.head_heights_px)]),
        targets=frozenset(str(word) for word in words.words(np.unique(scene.names))),
    )


def _share(flags: Flags) -> float:
    return float(flags.mean()) if len(flags) else 0.0


def _phases(scene: SceneColumns, words: Words, phases: Mapping[int, str]) -> Codes:
    """The code of the phase of each frame, by its number of instances that are nobody's body."""
    if not phases:
        return np.full(len(scene.frames), UNKNOWN, dtype=np.intp)
    bodies = set(zip(scene.person_at.tolist(), scene.bodies.tolist(), strict=True))
    found = zip(scene.instance_at.tolist(), scene.instance_ids.tolist(), strict=True)
    things = np.array([at for at, number in found if (at, number) not in bodies], dtype=np.intp)
    counts = np.bincount(things, minlength=len(scene.frames))
    return words.codes(phases.get(count) for count in counts.tolist())


class _Pair:
    """One configuration on one clip, to judge each subject of it."""

    def __init__(self, columns: PairColumns, traits: AnswerTraits) -> None:
        self.columns, self.words, self.traits = columns, columns.words, traits
        self.view, self.baselines = view_of(columns.scene), picks_of(columns.scene, columns.looks)
        people = len(columns.missing)
        self.place = columns.attended - self.view.firsts[columns.attending]
        self.totals = np.full(self.view.ids.shape, np.nan)
        self.totals[columns.attending, self.place] = columns.total
        self.has_total = np.bincount(columns.attending, columns.total > 0, people) > 0
        # np.bincount adds one after the other, as for one frame, so that bits are equal
        self.nowhere = np.maximum(0.0, 1 - np.bincount(columns.attending, columns.total, people))

    def judge(
        self, subject: str, labels: Labels | None, absent: NDArray[np.int64]
    ) -> tuple[SubjectVerdicts, Codes, Float]:
        """The verdicts of a subject; the aims in some frames (n, 2, 3), and the places of these frames (n,)."""
        scene = self.columns.scene
        labels = labels or Labels(())
        person_in = np.full(len(scene.frames), UNKNOWN, dtype=np.intp)
        own = np.flatnonzero(scene.person_names == self.words.code(subject))[::-1]
        person_in[scene.person_at[own]] = own  # the first, if tracks share the name
        labelled = labels.places(subject, scene.frames)
        at = np.flatnonzero((person_in != UNKNOWN) | (labelled != UNKNOWN))
        missed = absent[labels.places(subject, absent) != UNKNOWN]
        frames = np.concatenate([scene.frames[at], missed])
        order = np.argsort(frames, kind="stable")
        none = np.full(len(missed), UNKNOWN, dtype=np.intp)
        at, person = (np.concatenate([each, none])[order] for each in (at, person_in[at]))
        label = LabelColumns(labels.of(subject), labels.places(subject, frames := frames[order]), self.words)
        return self._judged(subject, frames, at, person, label)

    def _judged(
        self, subject: str, frames: NDArray[np.int64], at: Codes, person: Codes, label: LabelColumns
    ) -> tuple[SubjectVerdicts, Codes, Float]:
        code, n = self.words.code, len(frames)
        seen = np.flatnonzero(person != UNKNOWN)
        people, label_of = person[seen], label.at(seen)
        answers = _SubjectAnswers(self, people, label_of)
        predicted, error_type = np.full(n, UNKNOWN, dtype=np.intp), np.full(n, code("no_subject"), dtype=np.intp)
        predicted[seen], error_type[seen] = answers.predicted(), answers.error_types(code(subject))
        if self.traits.says_nowhere:
            is_nothing = predicted == code(NO_HIT)
            is_nothing[seen] &= answers.missing != code("no_hit")
            predicted[is_nothing] = code(NOWHERE)
            error_type[is_nothing & (error_type == code("no_hit"))] = code("missed")
        if self.traits.from_file:
            for of_scene, of_file in OF_SCENE.items():
                error_type[error_type == code(of_scene)] = code(of_file)
        error_type[~label.is_scored] = UNKNOWN
        true_ids = np.full(n, NO_ID)
        true_ids[seen] = answers.true_ids()
        confidence, hits, angles_rad = np.full(n, np.nan), np.zeros((n, 4), dtype=np.bool_), np.full(n, np.nan)
        worth = np.tile(NO_PROBABILITIES if self.traits.probabilistic else UNKNOWN_WORTH, (n, 1)).astype(np.float64)
        if self.traits.probabilistic:
            chance = answers.chances()
            is_worth = answers.missing == UNKNOWN
            confidence[seen] = np.where(is_worth, chance, np.nan)
            worth[seen[is_worth]] = answers.worths(chance)[is_worth]
        hits[seen] = hits_of(answers.right, self.baselines.picks[people])
        angles_rad[seen] = self.baselines.angles_rad[people]
        judged = SubjectVerdicts(
            words=self.words,
            clip=self.columns.clip,
            configuration=self.columns.configuration,
            subject=subject,
            frames=frames,
            truth=label.truth,
            predicted=predicted,
            error_type=error_type,
            is_scored=label.is_scored,
            is_blocked=label.is_blocked,
            true_ids=true_ids,
            confidence=confidence,
            worth=worth,
            hits=hits,
            angles_rad=angles_rad,
        )
        is_compared = label_of.is_scored & (at[seen] % COMPARED_EVERY == 0)
        aims, is_known = answers.aims(self.baselines.directions[people])
        return judged, at[seen][is_compared & is_known], aims[is_compared & is_known]


class LabelColumns:
    """The labels of a subject's frames (n,). ``points_px`` (n, 2) are NaN where a label has none."""

    def __init__(self, ranges: Sequence[LabelRange], places: Codes, words: Words) -> None:
        labels = [row.label for row in ranges]
        unknown = (math.nan, math.nan)
        self.truth = np.append(words.codes(label.target for label in labels), UNKNOWN)[places]
        self.is_blocked = np.array([*(label.is_blocked for label in labels), False], dtype=np.bool_)[places]
        self.points_px = np.array([*(label.point_px or unknown for label in labels), unknown])[places]
        self.is_scored = (self.truth != UNKNOWN) & (self.truth != words.code(IGNORED))
        self.is_nowhere = self.truth == words.code(NOWHERE)

    def at(self, chosen: Codes) -> LabelColumns:
        """Those of the chosen frames."""
        part = copy(self)
        for name, column in vars(self).items():
            setattr(part, name, column[chosen])
        return part


class _SubjectAnswers:
    """The answers about one subject in the n frames in which the person was seen."""

    def __init__(self, pair: _Pair, people: Codes, label: LabelColumns) -> None:
        columns, view, self.code = pair.columns, pair.view, pair.words.code
        self.pair, self.people, self.label = pair, people, label
        self.names, self.ids, self.totals = view.names[people], view.ids[people], pair.totals[people]
        self.centers_m, self.has_box = view.centers_m[people], view.has_box[people]
        self.missing, self.no_gaze = columns.missing[people], columns.looks.no_gaze[people]
        self.is_given = np.isin(self.missing, (UNKNOWN, self.code(NO_OBJECT), self.code("no_hit")))
        self.focus = np.where(columns.focus[people] == UNKNOWN, UNKNOWN, columns.focus[people] - view.firsts[people])
        self.truly_nowhere, self.right = label.is_nowhere, named_by(label, view, people)
        self.of_names, self.is_first = _of_names(self.totals, 2 * self.names + self.right)

    def predicted(self) -> Codes:
        """The code of what is predicted, UNKNOWN without an answer."""
        nothing = np.where(self.pair.has_total[self.people], self.code(NOWHERE), self.code(NO_HIT))
        named = np.where(self.focus == UNKNOWN, nothing, self._at_focus(self.names))
        return np.where(self.is_given, named, UNKNOWN)

    def _at_focus(self, values: NDArray[Any]) -> NDArray[Any]:
        """The column of the focus; the last column where there is none."""
        return np.asarray(np.take_along_axis(values, self.focus[:, None] % values.shape[1], axis=1)[:, 0])

    def error_types(self, subject: int) -> Codes:
        """Why each frame is wrong: the first error type that applies, as a code; UNKNOWN if it is correct."""
        code, missing, nowhere = self.code, self.missing, self.truly_nowhere
        is_right = np.where(nowhere, self.focus == UNKNOWN, (self.focus != UNKNOWN) & self._at_focus(self.right))
        is_hit = self.totals > 0
        bodies = self.pair.columns.scene.bodies[self.people]
        is_namesake = self.names == subject
        is_own = (is_namesake & (self.ids == bodies[:, None])).any(axis=1)
        is_another = (bodies != NO_ID) & is_namesake.any(axis=1) & ~is_own
        is_self = (self.focus != UNKNOWN) & (self._at_focus(self.names) == subject)
        cases = (
            ((missing == code("no_direction")) & (self.no_gaze != UNKNOWN), self.no_gaze),
            (np.isin(missing, (code(NO_OBJECT), code("no_hit"))) & nowhere, UNKNOWN),
            (missing != UNKNOWN, missing),
            (is_right, UNKNOWN),
            (nowhere, code("false_attention")),
            (~self.right.any(axis=1), code("target_not_segmented")),
            (~(self.right & self.has_box).any(axis=1), code("target_without_box")),
            (is_another | is_self, code("wrong_subject")),
            (~is_hit.any(axis=1), code("no_hit")),
            ((self.right & is_hit).any(axis=1), code("outscored")),
        )
        return np.select([case for case, _ in cases], [error_type for _, error_type in cases], code("missed"))

    def true_ids(self) -> NDArray[np.int64]:
        """The id of the only instance that is right; NO_ID where none is, or several are."""
        return np.where(
            self.right.sum(axis=1) == 1, self.ids[np.arange(len(self.ids)), self.right.argmax(axis=1)], NO_ID
        )

    def chances(self) -> Float:
        """The probability of each answer, that of all objects of its name; NaN where there is none."""
        chance = np.where(self.focus == UNKNOWN, self.pair.nowhere[self.people], self._at_focus(self.of_names))
        return np.minimum(chance, 1.0)

    def worths(self, chances: Float) -> Float:
        """What the probabilities are worth (n, 5), as :class:`harness.score.verdicts.Worth`."""
        nowhere, n = self.pair.nowhere[self.people], len(self.people)
        is_value = ~np.isnan(self.totals)
        on_target = np.where(self.right & is_value, self.totals, 0).cumsum(axis=1)[:, -1]
        on_truth = np.where(self.truly_nowhere, nowhere, on_target)
        squares = np.where(is_value & self.is_first & ~self.right, self.of_names, 0) ** 2
        wrong = squares.cumsum(axis=1)[:, -1] + np.where(self.truly_nowhere, 0, nowhere) ** 2
        # the smallest set: the likeliest first, of equal ones the lower id, nowhere last
        values = np.append(np.where(is_value, self.totals, -np.inf), nowhere[:, None], axis=1)
        ids = np.append(
            np.where(is_value, self.ids, np.iinfo(np.int64).max - 1), np.full((n, 1), np.iinfo(np.int64).max), axis=1
        )
        order = np.lexsort((ids, -values), axis=1)
        ranked = np.take_along_axis(values, order, axis=1)
        reached = np.where(ranked == -np.inf, 0, ranked).cumsum(axis=1)
        size = 1 + np.argmax(reached >= SET_LEVEL * reached[:, -1:] - SET_ROUNDING, axis=1)
        is_right = np.take_along_axis(np.append(self.right, self.truly_nowhere[:, None], axis=1), order, axis=1)
        is_covered = (is_right & (np.arange(values.shape[1]) < size[:, None])).any(axis=1)
        has_set = is_value.any(axis=1)
        sizes = np.where(has_set, size, np.nan)
        return np.stack([chances, on_truth, (1 - on_truth) ** 2 + wrong, sizes, is_covered & has_set], axis=1)

    def aims(self, directions: Float) -> tuple[Float, Flags]:
        """Each direction with the vector from the eyes to what the label says (n, 2, 3), and whether both are known.

        Of several objects that are right, nobody says which one the direction is to.
        """
        first = np.argmax(self.right, axis=1)
        centers = np.take_along_axis(self.centers_m, first[:, None, None], axis=1)[:, 0]
        aims = np.stack([directions, centers - self.pair.columns.looks.eyes_m[self.people]], axis=1)
        return aims, (self.right.sum(axis=1) == 1) & ~np.isnan(aims).any(axis=(1, 2))


def _of_names(totals: Float, names: Codes) -> tuple[Float, Flags]:
    """The sum of the totals (n, K) of each name, at all of its objects, and whether an object is its first one.

    ``names`` (n, K) are codes. Objects without a total, NaN, have no name.
    """
    sums, is_first = totals.copy(), ~np.isnan(totals)
    alone = np.where(is_first, names, np.iinfo(np.int64).min + np.arange(totals.shape[1]))
    several = np.flatnonzero((np.diff(np.sort(alone, axis=1), axis=1) == 0).any(axis=1))
    codes = np.unique(alone[several], return_inverse=True)[1].reshape(-1, totals.shape[1])
    pairs = codes + np.arange(len(several))[:, None] * codes.size
    _, firsts, places = np.unique(pairs, return_index=True, return_inverse=True)
    sums[several] = np.bincount(places.ravel(), totals[several].ravel())[places].reshape(pairs.shape)
    is_first[several] &= np.isin(np.arange(pairs.size), firsts).reshape(pairs.shape)
    return sums, is_first


def named_by(label: LabelColumns, view: View, people: Codes) -> Flags:
    """The instances (n, K) that the labels name in the frames of people; of several the one nearest to the point."""
    named = (view.names[people] == label.truth[:, None]) & view.is_there[people] & ~label.is_nowhere[:, None]
    several = np.flatnonzero(~np.isnan(label.points_px[:, 0]) & (named.sum(axis=1) > 1))
    if several.size:
        named[several] = _nearest(named[several], view.boxes_px[people[several]], label.points_px[several])
    return named


def hits_of(named: Flags, picks: Codes) -> Flags:
    """Whether what baselines pick (n, B) is among the named instances (n, K)."""
    return np.take_along_axis(named, picks % named.shape[1], axis=1) & (picks != UNKNOWN)


def _nearest(named: Flags, boxes_px: Float, points_px: Float) -> Flags:
    """Of the named instances (n, K) the one nearest to each point: by box, then by its middle; without boxes, all."""
    u0, v0, u1, v1 = np.moveaxis(boxes_px, -1, 0)
    u, v = points_px[:, :1], points_px[:, 1:]
    outside = np.maximum(np.maximum(u0 - u, 0.0), u - u1) ** 2 + np.maximum(np.maximum(v0 - v, 0.0), v - v1) ** 2
    off_center = (u - (u0 + u1) / 2) ** 2 + (v - (v0 + v1) / 2) ** 2
    nearest = named
    for distances in (outside, off_center):
        known = np.where(nearest & ~np.isnan(distances), distances, np.inf)
        nearest = nearest & (known == known.min(axis=1, keepdims=True))
    has_box = (named & ~np.isnan(boxes_px[..., 0])).any(axis=1, keepdims=True)
    return np.where(has_box, np.arange(named.shape[1]) == np.argmax(nearest, axis=1)[:, None], named)
