"""Stages that return the ground truth: each step of the oracle ablation replaces one measurement.

They read the clip's ground truth, so they are built as ``Class(settings, clip)``. If the clip does not have the
requested value, this is an error, never an empty answer.
"""

from __future__ import annotations

from typing import TypeVar
from weakref import WeakKeyDictionary

import numpy as np

from harness.labels.labels import BLOCKED, IGNORED, Label, LabelRange, Labels
from harness.sources import AnyClip, Clip, PersonTruth, SightTruth, Truth
from vfoa.errors import VfoaError
from vfoa.geometry import box_iou
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
        truth = self._truth(frame)
        return self._known(frame, truth.disparity, "disparity", truth.missing.get("disparity"))

    def instances(self, frame: int) -> Instances:
        """The true instances."""
        truth = self._truth(frame)
        return self._known(frame, truth.instances, "instances", truth.missing.get("instances"))

    def people(self, frame: int) -> tuple[PersonTruth, ...]:
        """The true people."""
        truth = self._truth(frame)
        return self._known(frame, truth.people, "people", truth.missing.get("people"))

    def person(self, frame: int, head: Head) -> PersonTruth | None:
        """Return the person whose head overlaps this head most; None if it is nobody's.

        A head's instance has the number that the segmentation gave it, which may differ from the source's: it is used
        only to confirm a head that overlaps too little.
        """
        people = self.people(frame)
        matches = [(box_iou(each.head_box_px, head.box_px), each.instance_id == head.instance_id) for each in people]
        overlap, is_confirmed = max(matches, default=(0.0, False))
        if overlap < LEAST_OVERLAP and not (is_confirmed and overlap > 0):
            return None
        return people[matches.index((overlap, is_confirmed))]

    def own_ids(self, frame: int, instances: Instances) -> set[int]:
        """The ids of these instances if they are the source's own; empty if a segmentation numbered them anew."""
        true = self._truth(frame).instances
        if true is None or not np.array_equal(true.ids, instances.ids):
            return set()
        return {each.id for each in instances.instances}

    def head_direction(self, frame: int, person: PersonTruth) -> Float:
        """True direction of the person's head, a unit vector (3,) in the camera frame."""
        return self._known(frame, person.head_direction, f"head direction of {person.name!r}")

    def gaze_direction(self, frame: int, person: PersonTruth) -> Float:
        """True gaze direction of the person, a unit vector (3,) in the camera frame."""
        return self._known(frame, person.gaze_direction, f"gaze direction of {person.name!r}")

    def _truth(self, frame: int) -> Truth:
        return truth_of(self._clip, frame)

    def _known(self, frame: int, value: T | None, what: str, reason: str | None = None) -> T:
        if value is not None:
            return value
        where = f"{type(self._clip).__name__}, frame {frame}"
        why = f" ({reason})" if reason else ""
        raise VfoaError(f"{where}: the clip has no true {what}; needed by {self._needed_by}{why}")


class TruthMatcher:
    """A matcher that returns the clip's true disparity."""

    Settings = OracleSettings

    def __init__(self, settings: OracleSettings, clip: Clip) -> None:
        self._truth = KnownTruth(clip, 'stereo.matcher = "truth"')

    def match(self, frame: StereoFrame) -> Disparity:
        """The true disparity of the frame."""
        return self._truth.disparity(frame.index)


class TrueMaskSettings(OracleSettings, KeyFrameSettings):
    """True masks of key frames can be carried to the frames between, to see what that costs."""


class TruthSegmenter:
    """A segmenter that returns the clip's true instances."""

    Settings = TrueMaskSettings

    def __init__(self, settings: OracleSettings, clip: Clip) -> None:
        self._truth = KnownTruth(clip, 'segmentation.model = "truth"')

    def segment(self, frame: StereoFrame) -> Instances:
        """The true instances of the frame."""
        return self._truth.instances(frame.index)


class TruthHeads:
    """A head detector that returns the clip's true head boxes, each with its person's instance."""

    Settings = OracleSettings

    def __init__(self, settings: OracleSettings, clip: Clip) -> None:
        self._truth = KnownTruth(clip, 'heads.detector = "truth"')

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


class TruthHeadPose:
    """A head-pose model that returns the true direction of the head; no pose for a head that is nobody's."""

    Settings = OracleSettings

    def __init__(self, settings: OracleSettings, clip: Clip) -> None:
        self._truth = KnownTruth(clip, 'head_pose.model = "truth"')

    def estimate(self, frame: StereoFrame, head: Head) -> HeadPose | None:
        """Return the true direction of one head."""
        person = self._truth.person(frame.index, head)
        return None if person is None else self.of_person(frame.index, person)

    def of_person(self, frame: int, person: PersonTruth) -> HeadPose:
        """Return the true direction of one person's head."""
        return HeadPose(direction=self._truth.head_direction(frame, person))


class TruthGaze:
    """A gaze model that returns the true gaze direction; no gaze for a head that is nobody's."""

    Settings = OracleSettings

    def __init__(self, settings: OracleSettings, clip: Clip) -> None:
        self._truth = KnownTruth(clip, 'gaze.model = "truth"')

    def estimate(self, frame: StereoFrame, head: Head, head_pose: HeadPose | None) -> Gaze | None:
        """Return the true gaze of one head."""
        person = self._truth.person(frame.index, head)
        return None if person is None else self.of_person(frame.index, person)

    def of_person(self, frame: int, person: PersonTruth) -> Gaze:
        """Return the true gaze of one person."""
        return Gaze(direction=self._truth.gaze_direction(frame, person))


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
