"""Stages that answer from the ground truth, exactly or with a simulated error of known size.

Each step of the oracle ablation replaces one measurement by the truth. These stages read the clip's ground truth, so
they are built as ``Class(settings, clip)``. If the clip does not have the requested value, this is an error, never an
empty answer.

A simulated error is a random rotation. Part of it is a slow bias, which a filter over time cannot remove, and part is
noise of each frame; together their mean angle is ``error_deg``. A model can also have systematic errors: a bias that is
constant for a person and clip, angles that shrink towards the camera, noise with heavy tails, and a claimed error that
differs from the true one. Every error is a function of (seed, draw, person, frame) alone, so frames can be computed in
any order and on any worker.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import replace
from typing import Any, ClassVar, Literal, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from pydantic import Field

from harness.files.ascending import usual_step
from harness.labels.labels import BLOCKED, IGNORED, Label, LabelRange, Labels
from harness.pipeline.configuration import CLIP_VARIABLE
from harness.sources import AnyClip, PersonTruth, SightTruth, Truth
from vfoa.errors import VfoaError
from vfoa.geometry import angle_between, box_iou, perturb, sigma_rad, unit
from vfoa.segmentation.key_frames import KeyFrameSettings
from vfoa.settings import Settings
from vfoa.types import Disparity, Float, Gaze, Head, HeadPose, Instances, StereoFrame

T = TypeVar("T")

LEAST_OVERLAP = 0.3
"""Boxes that overlap less (intersection over union) do not belong to the same head."""


class OracleSettings(Settings):
    """The ground truth has no settings."""


_last_truths: WeakKeyDictionary[AnyClip, tuple[int, Truth]] = WeakKeyDictionary()
"""Each clip's last ground truth: several stages ask for it, some of them once for every head."""


def truth_of(clip: AnyClip, frame: int) -> Truth:
    """Return a clip's ground truth of one frame. The last one is kept, if clips of this class allow it."""
    try:
        last = _last_truths.get(clip)
    except TypeError:  # no hash (a dataclass that is not frozen), or no weak reference (one with slots)
        return clip.truth(frame)
    if last is None or last[0] != frame:
        last = _last_truths[clip] = frame, clip.truth(frame)
    return last[1]


class KnownTruth:
    """The parts of a clip's ground truth that one stage needs; a missing part is an error."""

    def __init__(self, clip: AnyClip, needed_by: str) -> None:
        self._clip, self._needed_by = clip, needed_by

    def disparity(self, frame: int) -> Disparity:
        """The true disparity map."""
        return self.known(frame, self.truth(frame).disparity, "disparity")

    def instances(self, frame: int) -> Instances:
        """The true instances."""
        return self.known(frame, self.truth(frame).instances, "instances")

    def people(self, frame: int) -> tuple[PersonTruth, ...]:
        """The true people."""
        return self.known(frame, self.truth(frame).people, "people")

    def person(self, frame: int, head: Head) -> PersonTruth | None:
        """Return the person whose head overlaps this head most; None if it is nobody's.

        A head's instance has the number that the segmentation gave it, which may differ from the source's: it is used
        only to confirm a head that overlaps too little.
        """
        people = self.people(frame)
        matches = [
            (box_iou(person_truth.head_box_px, head.box_px), person_truth.instance_id == head.instance_id)
            for person_truth in people
        ]
        overlap, is_confirmed = max(matches, default=(0.0, False))
        if overlap < LEAST_OVERLAP and not (is_confirmed and overlap > 0):
            return None
        return people[matches.index((overlap, is_confirmed))]

    def own_ids(self, frame: int, instances: Instances) -> set[int]:
        """The ids of these instances if they are the source's own; empty if a segmentation numbered them anew."""
        true = self.truth(frame).instances
        if true is None or not np.array_equal(true.ids, instances.ids):
            return set()
        return {instance.id for instance in instances.instances}

    def truth(self, frame: int) -> Truth:
        """The ground truth of a frame."""
        return truth_of(self._clip, frame)

    def known(self, frame: int, value: T | None, what: str) -> T:
        """Return a part of the ground truth; ``what`` names it if it is missing."""
        if value is not None:
            return value
        reason = self.truth(frame).missing.get(what)
        where, why = f"{type(self._clip).__name__}, frame {frame}", f" ({reason})" if reason else ""
        raise VfoaError(f"{where}: the clip has no true {what}; needed by {self._needed_by}{why}")


class _OfTruth:
    """A stage that answers from a clip's ground truth; ``needed_by`` is the setting that chooses it."""

    Settings: type[Settings] = OracleSettings
    needed_by: ClassVar[str]

    def __init__(self, settings: object, clip: AnyClip) -> None:
        self._truth = KnownTruth(clip, self.needed_by)


class TruthMatcher(_OfTruth):
    """A matcher that returns the clip's true disparity."""

    needed_by = 'stereo.matcher = "truth"'

    def match(self, frame: StereoFrame) -> Disparity:
        """The true disparity of the frame."""
        return self._truth.disparity(frame.index)


class TrueMaskSettings(OracleSettings, KeyFrameSettings):
    """True masks of key frames can be carried to the frames in between, to measure what that costs."""


class TruthSegmenter(_OfTruth):
    """A segmenter that returns the clip's true instances."""

    Settings = TrueMaskSettings
    needed_by = 'segmentation.model = "truth"'

    def segment(self, frame: StereoFrame) -> Instances:
        """The true instances of the frame, which have the same ids in every frame."""
        true = self._truth.instances(frame.index)
        return replace(true, instances=tuple(replace(each, keeps_id=True) for each in true.instances))


class TruthHeads(_OfTruth):
    """A head detector that returns the clip's true head boxes, each with its person's instance."""

    needed_by = 'heads.detector = "truth"'
    finds_faces = False

    def detect(self, frame: StereoFrame, instances: Instances) -> tuple[Head, ...]:
        """Return the true heads of the frame. They have an instance only if ``instances`` are the true ones."""
        own_ids = self._truth.own_ids(frame.index, instances)
        return tuple(
            Head(
                box_px=person.head_box_px,
                score=1.0,
                instance_id=person.instance_id if person.instance_id in own_ids else None,
            )
            for person in self._truth.people(frame.index)
        )


class _OfPerson(_OfTruth):
    """A stage that answers from the truth of the person to whom a head belongs; None if it belongs to nobody."""

    def of_person(self, frame: int, person: PersonTruth) -> Any:
        """Return the answer for one person."""
        raise NotImplementedError

    def estimate(self, frame: StereoFrame, head: Head, head_pose: HeadPose | None = None) -> Any:
        """Return the answer for one head; None for a head that belongs to nobody."""
        person = self._truth.person(frame.index, head)
        return None if person is None else self.of_person(frame.index, person)


class TruthHeadPose(_OfPerson):
    """A head-pose model that returns the true direction of the head; no pose for a head that belongs to nobody."""

    needed_by = 'head_pose.model = "truth"'

    def of_person(self, frame: int, person: PersonTruth) -> HeadPose:
        """Return the direction of one person's head."""
        what = f"head direction of {person.name!r}"
        return HeadPose(direction=self._truth.known(frame, person.head_direction, what))


class TruthGaze(_OfPerson):
    """A gaze model that returns the true gaze direction; no gaze for a head that belongs to nobody."""

    needed_by = 'gaze.model = "truth"'

    def of_person(self, frame: int, person: PersonTruth) -> Gaze:
        """Return the gaze of one person."""
        what = f"gaze direction of {person.name!r}"
        return Gaze(direction=self._truth.known(frame, person.gaze_direction, what))


def true_labels(clip: AnyClip, unknown: str = "saccade") -> Labels:
    """Return labels made from a clip's ground truth: the target of each person, ``ignore`` where it is not known.

    ``unknown`` is the note of those. If the clip knows that something blocks the line of sight, the note says so.

    Raises
    ------
    VfoaError
        If the clip does not know its people.
    """
    truth = KnownTruth(clip, "true labels")
    rows: list[LabelRange] = []
    current: dict[str, LabelRange] = {}
    for frame in clip.frames:
        blockers = clip.blockers(frame) if isinstance(clip, SightTruth) else {}
        for person in truth.people(frame):
            note = f"{BLOCKED} by {blockers[person.name]}" if person.name in blockers else ""
            label = Label(target=person.target, note=note) if person.target else Label(target=IGNORED, note=unknown)
            before = current.get(person.name)
            first = before.first_frame if before and before.label == label else frame
            if before and first == frame:
                rows.append(before)
            current[person.name] = LabelRange(first_frame=first, last_frame=frame, subject=person.name, label=label)
    return Labels([*rows, *current.values()])


_SLOW, _NOISE, _CONSTANT, _STUDENT = range(4)
"""The kinds of random numbers."""

_STUDENT_MEAN = math.sqrt(6 / math.pi)
"""E[sqrt(3 / chi^2_3)]: the factor by which Student's distribution with three degrees of freedom lengthens a pair."""

_STRAIGHT_RAD = 1e-6
"""A direction nearer to the camera's, or to its opposite, defines no plane of rotation."""


class _ErrorSettings(Settings):
    """Size and kind of an error. Clips are independent samples only if every clip has a ``draw`` of its own."""

    error_deg: float = Field(ge=0, le=60)
    """Mean angle between the truth and the answer."""
    bias_share: float = Field(default=0.5, ge=0, le=1)
    """Share of the error's variance that is a slow bias; the rest is new in each frame."""
    bias_frames: int = Field(default=25, ge=1)
    """Frames after which the bias is independent of the earlier one."""
    seed: int = Field(default=1, ge=0)
    """Seed of the errors."""
    claimed_error_deg: float | None = Field(default=None, ge=0, le=90)
    """Mean angle that the model claims as its error; if not set, the true ``error_deg``."""
    clip_bias_deg: float = Field(default=0.0, ge=0, le=60)
    """Mean angle of a bias that is constant for a person in a clip, beside ``error_deg``."""
    gain: float = Field(default=1.0, ge=0.1, le=1.5)
    """Factor of a direction's angle from the camera; below 1, directions shrink towards the camera."""
    noise: Literal["normal", "student"] = "normal"
    """Distribution of the noise of each frame; Student's has three degrees of freedom and the same mean angle."""
    draw: str = CLIP_VARIABLE
    """Clips of one draw have the same errors, person by person. With the clip's name, each clip has its own."""


class SimulatedGazeSettings(_ErrorSettings):
    """Settings of the simulated gaze. Default: Gaze360's published error on frontal faces (Kellnhofer et al. 2019)."""

    error_deg: float = Field(default=11.1, ge=0, le=60)
    """Mean angle between the truth and the answer; 11.1 is Gaze360's published error on frontal faces."""


class SimulatedHeadPoseSettings(_ErrorSettings):
    """Settings of the simulated head pose. Default: about FSA-Net's published error on AFLW2000 (Yang et al. 2019)."""

    error_deg: float = Field(default=5.0, ge=0, le=60)
    """Mean angle between the truth and the answer; 5 is about FSA-Net's published error."""


class AngularError:
    """The error of one model. ``stream`` makes the errors of different models independent under the same seed.

    ``step`` is the usual difference of the numbers of two frames.
    """

    def __init__(self, settings: _ErrorSettings, stream: int, step: int = 1) -> None:
        self.sigma_rad = sigma_rad(settings.error_deg)
        claimed = settings.error_deg if settings.claimed_error_deg is None else settings.claimed_error_deg
        self.claimed_sigma_rad = sigma_rad(claimed)
        self._settings, self._every = settings, settings.bias_frames * step
        draw = hashlib.sha256(settings.draw.encode()).digest()
        self._key = (settings.seed, stream, int.from_bytes(draw[:8], "big"))

    def apply(self, direction: Float, person: int, frame: int, towards_camera: Float | None = None) -> Float:
        """Return a direction (3,) with the error of this person in this frame.

        ``towards_camera`` (3,) is the unit vector from the person to the camera; None: no shrinking towards it.
        """
        share = self._settings.bias_share
        shrunk = direction if towards_camera is None else _shrunk(direction, towards_camera, self._settings.gain)
        slow = self.sigma_rad * np.sqrt(share) * self._slow_bias(person, frame)
        constant = sigma_rad(self._settings.clip_bias_deg) * self._normal(person, _CONSTANT, 0)
        right, down = constant + slow + self._noise(person, frame, self.sigma_rad * np.sqrt(1 - share))
        return perturb(shrunk, right, down)

    def _noise(self, person: int, frame: int, sigma: float) -> Float:
        """The noise (2,) of this frame, radians in the two tangent directions."""
        pair = self._normal(person, _NOISE, frame)
        if self._settings.noise == "student":
            return sigma * pair * self._student_factor(person, frame)
        return np.asarray(sigma * pair)

    def _student_factor(self, person: int, frame: int) -> float:
        """Factor from a normal pair to one of Student's with three degrees of freedom and the same mean length."""
        chi_squared = float((self._generator(person, _STUDENT, frame).standard_normal(3) ** 2).sum())
        return math.sqrt(3 / chi_squared) / _STUDENT_MEAN

    def _slow_bias(self, person: int, frame: int) -> Float:
        """A standard normal pair (2,) that changes slowly: a quarter turn leads from each knot's pair to the next."""
        knot, within = divmod(frame, self._every)
        turn = np.pi / 2 * within / self._every
        return np.cos(turn) * self._normal(person, _SLOW, knot) + np.sin(turn) * self._normal(person, _SLOW, knot + 1)

    def _normal(self, person: int, kind: int, number: int) -> Float:
        return self._generator(person, kind, number).standard_normal(2)

    def _generator(self, person: int, kind: int, number: int) -> np.random.Generator:
        # Seeds must not be negative, but frame numbers can be.
        place = 2 * number if number >= 0 else -2 * number - 1
        return np.random.default_rng([*self._key, person, kind, place])


def _shrunk(direction: Float, towards_camera: Float, gain: float) -> Float:
    """Return the direction at ``gain`` times its angle from the camera, in the same plane."""
    angle = float(angle_between(direction, towards_camera))
    if gain == 1.0 or angle < _STRAIGHT_RAD or angle > np.pi - _STRAIGHT_RAD:
        return direction
    start, end = np.sin((1 - gain) * angle), np.sin(gain * angle)
    return unit((start * towards_camera + end * direction) / np.sin(angle))


class _Simulated(_OfPerson):
    """A stage that adds a simulated error to the true direction; its sigma is the claimed error."""

    stream: ClassVar[int]

    def __init__(self, settings: _ErrorSettings, clip: AnyClip) -> None:
        super().__init__(settings, clip)
        self._error = AngularError(settings, self.stream, max(1, round(usual_step(clip.frames))))

    def of_person(self, frame: int, person: PersonTruth) -> Any:
        """Return the direction of one person with its error."""
        true = super().of_person(frame, person)
        direction = self._error.apply(true.direction, person.instance_id, frame, _towards_camera(person))
        return replace(true, direction=direction, sigma_rad=self._error.claimed_sigma_rad)


class SimulatedHeadPose(_Simulated, TruthHeadPose):
    """A head-pose model that returns the true direction of the head with a simulated error."""

    Settings = SimulatedHeadPoseSettings
    needed_by = 'head_pose.model = "simulated"'
    stream = 1


class SimulatedGaze(_Simulated, TruthGaze):
    """A gaze model that returns the true gaze with a simulated error.

    Its sigma is the claimed error per tangent direction.
    """

    Settings = SimulatedGazeSettings
    needed_by = 'gaze.model = "simulated"'
    stream = 2


def _towards_camera(person: PersonTruth) -> Float | None:
    """The unit vector (3,) from the person to the camera; None if the eyes are not known, or in its place."""
    eyes = person.eye_origin_left
    return None if eyes is None or not eyes.any() else unit(-eyes)
