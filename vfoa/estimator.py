"""The pipeline for scripts: numpy images in, "who looks at what" out, with the defaults of ``vfoa run``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Self

import numpy as np

import vfoa.gaze
import vfoa.head_pose
import vfoa.heads
import vfoa.segmentation
import vfoa.stereo
from vfoa.config import METHOD_OF_CLIP, STEPS, check_immediate, dotted_tables, is_in_region, read_steps
from vfoa.errors import VfoaError
from vfoa.estimate import Estimate
from vfoa.following import Following
from vfoa.pipeline import Attending, AttendSettings, Stages, perceive
from vfoa.reconstruction import ReconstructionSettings
from vfoa.registry import Registry
from vfoa.segmentation.key_frames import KeyFrameSegmenter, KeyFrameSettings, path_to
from vfoa.settings import Settings
from vfoa.times import time_of_frame
from vfoa.types import Image, StereoFrame, StereoRig
from vfoa.validation import parse
from vfoa.weights import check_located, weights_of

DEFAULTS: Mapping[str, str] = {
    "stereo.matcher": "sgbm",
    "segmentation.model": "rf_detr_seg",
    "heads.detector": "yunet",
    "head_pose.model": "3ddfa_v2",
    "gaze.model": "auto",
    **METHOD_OF_CLIP,
}
"""The stages and the method of ``vfoa run CLIP``."""

_REGISTRIES = {
    registry.kind: registry
    for registry in (
        vfoa.stereo.MATCHERS,
        vfoa.segmentation.SEGMENTERS,
        vfoa.heads.DETECTORS,
        vfoa.head_pose.MODELS,
        vfoa.gaze.MODELS,
    )
}
_OPTIONAL = ("head_pose.model", "gaze.model")
_TABLES = (*(kind.partition(".")[0] for kind in _REGISTRIES), *STEPS)


class Estimator:
    """Estimates who looks at what. Open it once and use it for any number of frames, clips and cameras.

    Parameters
    ----------
    stages
        Models and matchers: any objects that follow the protocols of :mod:`vfoa.pipeline`. :meth:`open` makes them
        from settings.
    reconstruction, attend
        Settings of the two steps after perception.
    key_frames
        Which frames of a sequence are segmented. None: every frame.

    Raises
    ------
    VfoaError
        If the method of attention needs later frames.

    Examples
    --------
    >>> estimator = vfoa.Estimator.open({"stereo.matcher": "bm", "attention.method": "nearest"})
    >>> print(estimator.estimate(left, right, rig))
    person 1 looks at cup#2 (attention 0.43), 1.21 m away
    """

    def __init__(
        self,
        stages: Stages,
        *,
        reconstruction: ReconstructionSettings | None = None,
        attend: AttendSettings | None = None,
        key_frames: KeyFrameSettings | None = None,
    ) -> None:
        self.stages = stages
        self.key_frames = key_frames or KeyFrameSettings()
        self.reconstruction = reconstruction or ReconstructionSettings()
        self.attend = attend or AttendSettings()
        check_immediate(self.attend)

    @classmethod
    def open(cls, settings: Mapping[str, Any] | None = None) -> Self:
        """Open the models and the method of ``vfoa run CLIP``; ``settings`` changes values as ``--set`` does.

        Parameters
        ----------
        settings
            Values by dotted key, such as ``{"gaze.model": "l2cs"}``; ``vfoa settings`` prints every key.

        Raises
        ------
        VfoaError
            If a key or a value is wrong, a model's file is missing (the message names all missing files), or
            the configuration needs later frames (a temporal gaze model, smoothing in both directions).
        """
        tables = dotted_tables({**DEFAULTS, **(settings or {})}.items(), _TABLES, "settings")
        chosen = {kind: found for kind, registry in _REGISTRIES.items() if (found := _choose(registry, tables))}
        stereo, segmentation = (chosen[kind][1] for kind in ("stereo.matcher", "segmentation.model"))
        reconstruction, attend_settings = read_steps(tables, stereo, "settings")
        check_immediate(attend_settings)
        check_located(name for _, checked in chosen.values() for name in weights_of(checked))
        stages = {kind: stage(checked) for kind, (stage, checked) in chosen.items()}
        matcher = stages["stereo.matcher"]
        return cls(
            Stages(
                matcher=matcher,
                segmenter=stages["segmentation.model"],
                heads=stages["heads.detector"],
                head_pose=stages.get("head_pose.model"),
                gaze=stages.get("gaze.model"),
                region_matcher=matcher if is_in_region(stereo) else None,
            ),
            reconstruction=reconstruction,
            attend=attend_settings,
            key_frames=segmentation if isinstance(segmentation, KeyFrameSettings) else None,
        )

    def estimate(self, left: Image, right: Image, rig: StereoRig) -> Estimate:
        """Estimate who looks at what in one pair, without memory of earlier ones.

        Parameters
        ----------
        left, right
            The rectified pair, (H, W, 3) uint8 RGB. OpenCV reads BGR: ``cv2.cvtColor(image, cv2.COLOR_BGR2RGB)``.
        rig
            Its calibration: see :func:`rectified_rig`.

        Raises
        ------
        VfoaError
            If an image does not match the rig, or a model fails.
        """
        return self.follow(rig).step(left, right)

    def follow(self, rig: StereoRig) -> Follower:
        """Begin a sequence of frames: people and objects keep their numbers, and the settings may filter the gaze."""
        return Follower(self, rig)


class Follower:
    """Follows people and objects over the frames of one sequence, and holds the memory.

    Made by :meth:`Estimator.follow`.
    """

    def __init__(self, estimator: Estimator, rig: StereoRig) -> None:
        self._rig = rig
        self._following = Following(estimator.reconstruction, estimator.attend.tracking)
        self._attending = Attending(estimator.attend)
        self._frames = 0
        self._time_ns: int | None = None
        self._stages, every = estimator.stages, estimator.key_frames.every
        if every > 1:
            on_key_frames = KeyFrameSegmenter(
                self._stages.segmenter, lambda number: path_to(number, range(number + 1), every)
            )
            self._stages = replace(self._stages, segmenter=on_key_frames)

    def step(self, left: Image, right: Image, *, time_ns: int | None = None) -> Estimate:
        """Estimate who looks at what in the next pair.

        Parameters
        ----------
        left, right
            As for :meth:`Estimator.estimate`.
        time_ns
            The frame's time, nanoseconds, after that of the frame before. The logit and the posterior
            (``attention.method``: ``"logit"``, ``"bayes"``) use it; without times, frames count as 40 ms apart.

        Raises
        ------
        VfoaError
            If an image does not match the rig, the time is not later than that of the frame before, or a model fails.
            The memory then stays unchanged.
        """
        now_ns = time_of_frame(time_ns, self._time_ns)
        try:
            frame = StereoFrame(index=self._frames, time_ns=now_ns, left=left, right=right, rig=self._rig)
        except ValueError as error:
            raise VfoaError(f"frame {self._frames}: {error}") from None
        percepts, scene, tracked = self._following.step(perceive(frame, self._stages))
        (result,) = self._attending.step(scene, tracked)
        self._frames, self._time_ns = self._frames + 1, now_ns
        return Estimate(percepts=percepts, result=result)


def rectified_rig(
    left: Image,
    *,
    fx_px: float,
    cx_px: float,
    cy_px: float,
    baseline_m: float,
    fy_px: float | None = None,
    cx_right_px: float | None = None,
) -> StereoRig:
    """Return the rig of a rectified pair of images of the size of ``left`` (H, W, 3).

    ``fy_px`` defaults to ``fx_px``, and ``cx_right_px`` to ``cx_px``. ``harness.read_rig`` reads calibration files.

    Raises
    ------
    VfoaError
        If there is no image, a number is not finite, or a length is not positive.
    """
    if np.ndim(left) < 2:
        raise VfoaError(f"rectified_rig: left: expected an image (H, W, 3), found {type(left).__name__}")
    height, width = np.shape(left)[:2]
    try:
        return StereoRig(
            width_px=width,
            height_px=height,
            fx_px=fx_px,
            fy_px=fx_px if fy_px is None else fy_px,
            cx_px=cx_px,
            cy_px=cy_px,
            baseline_m=baseline_m,
            cx_right_px=cx_px if cx_right_px is None else cx_right_px,
        )
    except ValueError as error:
        raise VfoaError(f"rectified_rig: {error}") from None


_Choice = tuple[Any, Settings]
"""A stage's class and its checked settings."""


def _choose(registry: Registry, tables: Mapping[str, Mapping[str, Any]]) -> _Choice | None:
    table, _, key = registry.kind.partition(".")
    settings = dict(tables[table])
    name = registry.resolve(str(settings.pop(key)))
    if name == "none" and registry.kind in _OPTIONAL:
        return None
    stage = registry.load(name)
    if hasattr(stage, "estimate_sequence"):
        raise VfoaError(
            f"settings: {registry.kind}: {name!r} needs later frames; expected a model of single frames (`vfoa run` "
            "runs both)"
        )
    return stage, parse(stage.Settings, settings, "settings", table)
