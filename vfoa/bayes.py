"""Attention as a posterior probability: which target explains the measured directions best, given how wrong they are.

visible      the direction of each target from the eyes, and its angular extent
posterior/   the likelihood of the directions: their unknown error, how heads follow, how long people look

"Nowhere" is a hypothesis of its own: people who look at nothing look about where their head points, which is anywhere
about where their body faces. A large target is not favoured: its density is spread over its visible part.

A target that up to five frames miss (at more than 25 frames per second, the frames of 0.2 s) is taken to be where it
was, under its number: a look at it goes on, and says nothing about the error of the directions. Until it is found
again, its probability counts as that of nowhere.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import ClassVar, Literal, NamedTuple

import numpy as np
from pydantic import Field

from vfoa.geometry import sigma_rad
from vfoa.instance_tracking import frames_missed
from vfoa.methods import MethodSettings, answer_of, boxes_of_others, revised
from vfoa.posterior.belief import Belief, MeasuredCues, Scenery, fit_of
from vfoa.posterior.cues import cue_shares
from vfoa.posterior.filter import answered, smoothed, update
from vfoa.posterior.grid import Error
from vfoa.recent import Recent
from vfoa.settings import CountsWith
from vfoa.times import Gap, seconds_between
from vfoa.types import Attention, DirectionFit, Float, FrameResult, NoAttention, Scene, Subject, Target
from vfoa.visible import RAYS, visible_targets

_SHARPEST_RAD = float(np.deg2rad(0.01))
"""Smallest angular error: a model that claims less is given this one."""


class BayesSettings(MethodSettings):
    """Settings of :class:`Posterior`."""

    counts_with: ClassVar[CountsWith] = {"look_ahead_s": ("smoothing", ("both",))}

    method: Literal["bayes"]
    """``bayes``: a posterior over the objects."""
    error: Error = "unknown"
    """``unknown``: the claimed error is a prior; scale, bias and gain are learned. ``told``: it is true."""
    spread: Literal["model", "published"] = "model"
    """Claimed error. ``model``: the model's value for a direction if it gives one; ``published``: the published one."""
    gaze_error_deg: float = Field(default=11.1, gt=0, le=60)
    """Published mean angle of the gaze error."""
    head_error_deg: float = Field(default=5.0, gt=0, le=60)
    """Published mean angle of the head-pose error."""
    smoothing: Literal["off", "forward", "both"] = "forward"
    """``off``: each frame by itself; ``forward``: also earlier frames; ``both``: also later ones."""
    look_ahead_s: float = Field(default=2.0, gt=0, le=120)
    """Seconds of later frames that count with ``both``."""

    @property
    def expectation(self) -> str:
        """The calibration errors in the settings of reports/benchmark.md, and those of fits in reports/fit_*.md."""
        return (
            "posterior: nothing is fitted to this clip; in four settings its calibration error was 0.07 to 0.25. That "
            "of a logit fitted to 20 labelled seconds was 0.06 where the posterior's was 0.16 (people in a room), and "
            "0.08 where it was 0.06 (a conversation)."
        )

    @property
    def cloud_points(self) -> int:
        """A ray goes to each of them."""
        return RAYS


class Sights(NamedTuple):
    """The targets of a frame, then those of the last frames that it misses; and the known eye origins (3,) of people.

    ``missed`` is how long each was not seen, by instance id, in the order of the targets, and ``faceless`` how long
    eyes were not known; ``time_ns`` is the time of the frame, nanoseconds (None: before the first one).
    """

    targets: tuple[Target, ...] = ()
    eyes: Mapping[int, Float] = {}
    missed: Mapping[int, Gap] = {}
    faceless: Mapping[int, Gap] = {}
    time_ns: int | None = None

    def then(self, subject: Subject, scene: Scene, eyes: Mapping[int, Float]) -> Sights:
        """Return those of the next frame: without targets that have no box, and without the subject's own body."""
        boxes = boxes_of_others(subject, scene.targets)
        dt_s = seconds_between(self.time_ns, scene.time_ns)
        missed, faceless = frames_missed(self.missed, boxes, dt_s), frames_missed(self.faceless, eyes, dt_s)
        missed.pop(subject.person.instance_id or 0, None)
        known = dict(zip(self.missed, self.targets, strict=True))
        known |= {target.instance.id: target for target in scene.targets if target.instance.id in boxes}
        places = {**self.eyes, **eyes}
        eyes = {number: place for number, place in places.items() if number in missed and number in faceless}
        return Sights(tuple(known[number] for number in missed), eyes, missed, faceless, scene.time_ns)


class HeldBelief(NamedTuple):
    """A person's belief after a frame, and what the next frame starts from.

    ``counted`` is the last belief that counts and ``time_ns`` its time, nanoseconds; ``sights`` are the
    targets of the frame.
    """

    belief: Belief
    counted: Belief
    time_ns: int | None = None
    sights: Sights = Sights()


class Posterior:
    """The posterior over targets and nowhere, as a :class:`vfoa.methods.RevisingMethod`."""

    Settings = BayesSettings
    probabilistic = True
    says_nowhere = True

    def __init__(self, settings: BayesSettings) -> None:
        self._settings = settings
        self.look_ahead_s = settings.look_ahead_s if settings.smoothing == "both" else 0.0

    def start(self) -> None:
        """No belief."""

    def attend(
        self, subjects: tuple[Subject, ...], scene: Scene, states: tuple[HeldBelief | None, ...]
    ) -> tuple[tuple[Attention, ...], tuple[HeldBelief | None, ...]]:
        """Compute every subject's attention in one frame, and the belief that the next frame starts from.

        A frame without a belief leaves it as it was; with ``smoothing = "off"`` there never is one.

        ``total`` is the probability of each target that has a box, except the subject's own instance. "Nowhere" has the
        rest up to 1, also that of remembered targets. The focus is the likeliest of them, by the targets' names
        (:func:`vfoa.methods.likeliest`). The total is divided between the cues by their precision. ``belief`` is the
        input of :func:`smooth`; ``fit`` says how well the directions fit the belief.
        """
        eyes = eyes_of(subjects)
        attentions, after = [], []
        for subject, before in zip(subjects, states, strict=True):
            attention, held = _infer(subject, scene, eyes, before, self._settings)
            attentions.append(attention)
            after.append(before if held is None or self._settings.smoothing == "off" else held)
        return tuple(attentions), tuple(after)

    def revise(self, window: Sequence[FrameResult], count: int) -> list[FrameResult]:
        """Return the first frames with every subject's attention given the whole window: :func:`smooth`."""
        return smooth(window, count, self._settings)


def smooth(window: Sequence[FrameResult], count: int, settings: BayesSettings) -> list[FrameResult]:
    """Return the first ``count`` frames of a window with every subject's probabilities given the later ones, too."""

    def of_person(frames: list[tuple[FrameResult, Attention]]) -> Iterator[Attention]:
        beliefs = [attention.belief for _, attention in frames]
        for (frame, attention), belief, probabilities in zip(frames, beliefs, smoothed(beliefs), strict=True):
            yield _answer(
                attention.subject,
                [value.instance_id for value in attention.values],
                belief,
                measured_cues(attention.subject, settings),
                answered(belief, probabilities, settings.error, later_known=True),
                attention.fit,
                frame.scene.names,
            )

    return revised(window, count, Belief, of_person)


def _infer(
    subject: Subject, scene: Scene, eyes: Mapping[int, Float], before: HeldBelief | None, settings: BayesSettings
) -> tuple[Attention, HeldBelief | None]:
    found = believed(subject, scene, eyes, before, settings)
    if isinstance(found, NoAttention):
        return Attention(subject=subject, missing=found), None
    held, cues = found
    belief = held.belief
    probabilities = answered(belief, belief.probabilities, settings.error)
    ids = boxes_of_others(subject, scene.targets)
    return _answer(subject, ids, belief, cues, probabilities, fit_of(belief, cues), scene.names), held


def _answer(
    subject: Subject,
    ids: Iterable[int],
    belief: Belief,
    cues: MeasuredCues,
    probabilities: Float,
    fit: DirectionFit | None,
    names: Mapping[int, str],
) -> Attention:
    """The attention with these probabilities (T,) of the targets of the belief, for the targets ``ids``."""
    chance = dict(zip(belief.keys, probabilities.tolist(), strict=True))
    totals = {number: chance.get(number, 0.0) for number in ids}
    nowhere = sum((probability for number, probability in chance.items() if number not in totals), 0.0)
    return answer_of(subject, totals, nowhere, cue_shares(cues, belief), names, belief=belief, fit=fit)


_RECENT: Recent[Belief] = Recent(16)
"""The last beliefs of all configurations: those that differ in what they make of a belief share it."""


def believed(
    subject: Subject, scene: Scene, eyes: Mapping[int, Float], before: HeldBelief | None, settings: BayesSettings
) -> tuple[HeldBelief, MeasuredCues] | NoAttention:
    """Return what is held of a subject after a frame, and the cues that it follows from; or why there is no belief.

    Targets are their clouds if any of them has one, and their boxes otherwise (:func:`vfoa.visible.visible_targets`).
    """
    origin = subject.person.eye_origin_left
    if origin is None:
        return NoAttention.NO_EYES_3D
    if subject.gaze is None and subject.head_pose is None:
        return NoAttention.NO_DIRECTION
    cues = measured_cues(subject, settings)
    _, last, last_ns, known = before or (None, None, None, Sights())
    sights = known.then(subject, scene, eyes)
    visible = visible_targets(origin, sights.targets, sights.eyes, clouds=True)
    scenery = Scenery(
        keys=(*visible.ids, None),
        directions=visible.directions,
        variances=visible.variances,
        to_camera=-origin / distance if (distance := math.hypot(*origin.tolist())) else np.array([0.0, 0.0, -1.0]),
    )
    dt_s = seconds_between(last_ns, scene.time_ns)
    measured = tuple(None if cue is None else cue.tobytes() for cue in (cues.gaze, cues.head))
    asked = *measured, cues.gaze_sigma_rad, cues.head_sigma_rad, dt_s, settings.error
    belief = _RECENT.get((visible, last), asked, lambda: update(last, scenery, cues, dt_s, settings.error))
    counted, counted_ns = (belief, scene.time_ns) if last is None or belief.counts else (last, last_ns)
    return HeldBelief(belief, counted, counted_ns, sights), cues


def measured_cues(subject: Subject, settings: BayesSettings) -> MeasuredCues:
    """Return the measured cues with their claimed errors."""
    gaze, head = subject.gaze, subject.head_pose
    claims = []
    for source, error_deg in ((gaze, settings.gaze_error_deg), (head, settings.head_error_deg)):
        claimed = source.sigma_rad if source is not None and settings.spread == "model" else None
        claims.append(max(sigma_rad(error_deg) if claimed is None else claimed, _SHARPEST_RAD))
    return MeasuredCues(
        gaze=None if gaze is None else gaze.direction,
        head=None if head is None else head.direction,
        gaze_sigma_rad=claims[0],
        head_sigma_rad=claims[1],
    )


def eyes_of(subjects: Iterable[Subject]) -> dict[int, Float]:
    """Return the known eye origins (3,) of people by instance id."""
    people = (subject.person for subject in subjects)
    return {
        person.instance_id: person.eye_origin_left
        for person in people
        if person.instance_id is not None and person.eye_origin_left is not None
    }
