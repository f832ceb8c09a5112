"""Head pose and gaze as models of known accuracy would give them: the truth and a seeded error.

The error is a random turn. Part of it is a slow bias, which a filter over time cannot remove, and part is noise of
each frame. Both are normal in the two tangent directions; together their mean angle is ``error_deg``. Every error
is a function of (seed, draw, person, frame) alone, so frames can be computed in any order and on any worker.
"""

from __future__ import annotations

import hashlib

import numpy as np
from pydantic import Field

from harness.adapters import Clip
from harness.runs.stages import CLIP_VARIABLE
from harness.truth.oracle import KnownTruth
from vfoa.eye_head import sigma_rad
from vfoa.geometry import perturb
from vfoa.settings import Settings
from vfoa.types import Float, Gaze, Head, HeadPose, StereoFrame


class _ErrorSettings(Settings):
    """An error's size and kind.

    ``error_deg`` is the mean angle between truth and answer. ``bias_share`` is the share of its variance that is the
    slow bias, ``bias_frames`` how many frames lie between biases that have nothing to do with each other. Clips of one
    ``draw`` have the same errors, person by person; usually it is the clip's name, so that every clip has its own: only
    then do several clips say more than one.
    """

    error_deg: float = Field(ge=0, le=60)
    bias_share: float = Field(default=0.5, ge=0, le=1)
    bias_frames: int = Field(default=25, ge=1)
    seed: int = Field(default=1, ge=0)
    draw: str = CLIP_VARIABLE


class SimulatedGazeSettings(_ErrorSettings):
    """Default: Gaze360's published mean error on faces turned to the camera (Kellnhofer et al. 2019)."""

    error_deg: float = Field(default=11.1, ge=0, le=60)


class SimulatedHeadPoseSettings(_ErrorSettings):
    """Default: about FSA-Net's published error per angle on AFLW2000 (Yang et al. 2019)."""

    error_deg: float = Field(default=5.0, ge=0, le=60)


class AngularError:
    """The error of one model. ``stream`` keeps the errors of different models apart under the same seed."""

    def __init__(self, settings: _ErrorSettings, stream: int) -> None:
        self.sigma_rad = sigma_rad(settings.error_deg)
        self._bias_share, self._bias_frames = settings.bias_share, settings.bias_frames
        draw = hashlib.sha256(settings.draw.encode()).digest()
        self._key = (settings.seed, stream, int.from_bytes(draw[:8], "big"))

    def apply(self, direction: Float, person: int, frame: int) -> Float:
        """A direction (3,) with the error of this person in this frame."""
        bias, noise = self._bias(person, frame), self._normal(person, 1, frame)
        right, down = self.sigma_rad * (np.sqrt(self._bias_share) * bias + np.sqrt(1 - self._bias_share) * noise)
        return perturb(direction, right, down)

    def _bias(self, person: int, frame: int) -> Float:
        """A standard normal pair (2,) that changes slowly: a quarter turn from each knot's pair to the next one's."""
        knot, within = divmod(frame, self._bias_frames)
        turn = np.pi / 2 * within / self._bias_frames
        return np.cos(turn) * self._normal(person, 0, knot) + np.sin(turn) * self._normal(person, 0, knot + 1)

    def _normal(self, person: int, kind: int, number: int) -> Float:
        # Seeds are not negative, frame numbers can be.
        place = 2 * number if number >= 0 else -2 * number - 1
        return np.random.default_rng([*self._key, person, kind, place]).standard_normal(2)


class SimulatedHeadPose:
    """``head_pose.model = "simulated"``: the true direction of the head with an error."""

    Settings = SimulatedHeadPoseSettings

    def __init__(self, settings: SimulatedHeadPoseSettings, clip: Clip) -> None:
        self._truth = KnownTruth(clip, 'head_pose.model = "simulated"')
        self._error = AngularError(settings, stream=1)

    def estimate(self, frame: StereoFrame, head: Head) -> HeadPose | None:
        """The direction of one head; None for a head that is nobody's."""
        person = self._truth.person(frame.index, head)
        if person is None:
            return None
        direction = self._truth.head_direction(frame.index, person)
        return HeadPose(
            direction=self._error.apply(direction, person.instance_id, frame.index), sigma_rad=self._error.sigma_rad
        )


class SimulatedGaze:
    """``gaze.model = "simulated"``: the true gaze with an error; its sigma is the error's, per tangent direction."""

    Settings = SimulatedGazeSettings

    def __init__(self, settings: SimulatedGazeSettings, clip: Clip) -> None:
        self._truth = KnownTruth(clip, 'gaze.model = "simulated"')
        self._error = AngularError(settings, stream=2)

    def estimate(self, frame: StereoFrame, head: Head, head_pose: HeadPose | None) -> Gaze | None:
        """The gaze of one head; None for a head that is nobody's."""
        person = self._truth.person(frame.index, head)
        if person is None:
            return None
        direction = self._truth.gaze_direction(frame.index, person)
        return Gaze(
            direction=self._error.apply(direction, person.instance_id, frame.index), sigma_rad=self._error.sigma_rad
        )
