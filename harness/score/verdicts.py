"""Right or wrong: one verdict per frame and annotated subject, and exactly one error type for every wrong one.

The error type is the first of these that applies, in the order of the pipeline:

``no_subject``            no record of the frame, or no tracked person in it has the subject's name
``no_eyes_3d``            the subject was seen, but the 3D position of the eyes is not known
``face_turned_away``      nothing but gaze was asked for, and the face is turned too far for the gaze model
``no_direction``          neither gaze nor head direction was measured
``no_answer``             the file of another system's answers has none: only there, in place of all above and the next
                          two
``no_object``             the point in the image that another system gave lies on no object, and there is a true target
``target_not_segmented``  no instance has the true target's name
``target_without_box``    instances have the name, but none has a 3D box
``false_attention``       the subject looks at nothing, and a target was predicted
``wrong_subject``         the record under the subject's name is somebody else's body: see below
``no_hit``                nothing in the frame got any attention: no ray hit anything
``missed``                the true target got no attention, something else or nowhere did
``outscored``             it got some, but another target, or nowhere, won (including a lost tie)

Results alone show a wrong subject in two ways: instances of the frame have the subject's name and the record's head was
joined to another instance; or the predicted target has the subject's own name, which nobody can look at, so the head
was joined to another body. If name and body were exchanged together, this cannot be seen, and counts as ``missed`` or
``outscored``.

Probabilities are judged, too, as answers are: that of a name is the sum of those of all its objects. Where a label's
point says which of them is meant, the others are another answer. Brier's score (1950) is the squared distance of all of
them from the truth, from 0 to 2. A *set* holds the fewest objects, nowhere among them, that have :data:`SET_LEVEL` of
the probability together.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from harness.labels.labels import NOWHERE, Label
from harness.run.manifest import AnswerTraits
from harness.run.records import BoxPx, FrameRecord, SubjectRecord, TargetRecord
from vfoa.scoring import ANOTHER, NO_HIT, NO_PREDICTION

Outcome = Literal["correct", "wrong", "unscored"]

ERROR_TYPES = {
    "no_subject": "the person was not found",
    "no_eyes_3d": "where the eyes are in space is not known",
    "face_turned_away": "no gaze: face turned away",
    "no_direction": "neither gaze nor head was measured",
    "no_answer": "the file of answers has none",
    "no_object": "the point looked at lies on no object",
    "target_not_segmented": "the true target was not found",
    "target_without_box": "the true target was found, without a 3D box",
    "false_attention": "a target was predicted, and there is none",
    "wrong_subject": "this is somebody else's body",
    "no_hit": "no ray hit anything",
    "missed": "the true target got no attention, another or nowhere did",
    "outscored": "the true target got some attention, another or nowhere more",
}
"""Each error type, in order, with an explanation for new readers."""


NO_OBJECT = "no_object"
"""The reason of a point that lies on no object: like a ray that hits nothing, it is right if the label is none."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """The prediction for a subject in a frame, and whether it is right.

    ``truth`` and ``predicted`` are targets' names, ``"none"`` for nowhere. ``truth`` is None if there is no label,
    ``predicted`` None if no prediction was made, :data:`NO_HIT` if nothing got any attention of a method that cannot
    say "nowhere": that is right if the label is ``none``, as in the paper, and an error type of its own otherwise.
    ``error_type`` is one of :data:`ERROR_TYPES` for a wrong frame, None for every other. ``confidence`` is the
    probability of the prediction; None without a prediction, or if attention is no probability.
    """

    clip: str
    configuration: str
    frame: int
    subject: str
    truth: str | None
    predicted: str | None
    outcome: Outcome
    error_type: str | None
    confidence: float | None = None


OF_SCENE = {"no_subject": "no_answer", "target_not_segmented": "missed", "target_without_box": "missed"}
"""Error types of what the stages found, and what they are for answers by name, which need nothing of it."""
PLAIN = AnswerTraits()
"""Of cones: no probabilities, and no answer where no ray hit anything."""


def find_subject(record: FrameRecord, subject: str) -> SubjectRecord | None:
    """Return the person of this name; the first in the record if tracks share it."""
    return next((person for person in record.subjects if person.name == subject), None)


def true_targets(record: FrameRecord, label: Label) -> list[TargetRecord]:
    """Return the instances with the label's name; if the label has an image point, only the one nearest to it.

    A point says nothing of instances of which none has a box in the image.
    """
    named = [target for target in record.targets if target.name == label.target]
    if label.point_px is None or len(named) < 2 or all(target.box_px is None for target in named):
        return named
    point = label.point_px
    return [min(named, key=lambda target: _distance_px(target.box_px, point))]


def _distance_px(box_px: BoxPx | None, point_px: tuple[float, float]) -> tuple[float, float]:
    """Squared distance of a point from a box (0 inside), then from its centre: boxes that hold it may overlap.

    A target without a box in the image is infinitely far away.
    """
    if box_px is None:
        return math.inf, math.inf
    (u0, v0, u1, v1), (u, v) = box_px, point_px
    outside = max(u0 - u, 0.0, u - u1) ** 2 + max(v0 - v, 0.0, v - v1) ** 2
    return outside, (u - (u0 + u1) / 2) ** 2 + (v - (v0 + v1) / 2) ** 2


def answer(verdict: Verdict) -> str | None:
    """The answer that a verdict's prediction counts as: a name; None without one, or if wrongly nothing was hit.

    A name that equals the true one, though another instance was meant, is marked.
    """
    if verdict.outcome == "correct":
        return verdict.truth
    if verdict.predicted == NO_HIT:
        return None
    if verdict.outcome == "wrong" and verdict.predicted == verdict.truth:
        return f"{verdict.predicted} {ANOTHER}"
    return verdict.predicted


def answered(verdict: Verdict) -> str:
    """The answer as text: a target, "nothing hit" if that is an error, or :data:`NO_PREDICTION`."""
    if verdict.outcome == "wrong" and verdict.predicted == NO_HIT:
        return NO_HIT
    return answer(verdict) or NO_PREDICTION


SET_LEVEL = 0.9
"""The least probability of a set."""
SET_ROUNDING = 1e-9
"""How far below that level the sum of its probabilities may end: they are rounded."""


class Worth(NamedTuple):
    """The probability of a subject's answer and of the true one, Brier's score, and the set; NaN where there is none.

    ``set_size`` is the number of objects in the set, nowhere among them, ``is_covered`` says whether a true one is.
    """

    confidence: float = math.nan
    on_truth: float = math.nan
    brier: float = math.nan
    set_size: float = math.nan
    is_covered: bool = False


UNKNOWN_WORTH = Worth()
NO_PROBABILITIES = Worth(on_truth=0.0, brier=1.0)
"""A frame without an answer of a method that gives probabilities: it has none anywhere."""


def probabilities(subject: SubjectRecord) -> dict[int | None, float]:
    """The probability of each target by instance id. None stands for nowhere, which has the rest up to 1."""
    chances: dict[int | None, float] = {value.instance_id: value.total for value in subject.attention}
    chances[None] = max(0.0, 1 - sum(chances.values()))
    return chances


def name_probabilities(record: FrameRecord, subject: SubjectRecord) -> dict[str, float]:
    """The probability of each name, that of all objects which have it, and of :data:`NOWHERE`."""
    return {**record.sums_by_name(subject), NOWHERE: probabilities(subject)[None]}


def prediction_set(subject: SubjectRecord) -> tuple[int | None, ...]:
    """Instance ids of the smallest set by a subject's probabilities, the likeliest first; None stands for nowhere.

    It is empty without any target. Of equally likely objects those with the lower id come first, and nowhere last.
    """
    if not subject.attention:
        return ()
    chances = probabilities(subject)
    ranked = sorted(chances, key=lambda key: (-chances[key], key is None, key or 0))
    reached = np.cumsum([chances[key] for key in ranked])
    return tuple(ranked[: 1 + int(np.argmax(reached >= SET_LEVEL * reached[-1] - SET_ROUNDING))])
