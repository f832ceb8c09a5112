"""All values that flow through the pipeline, and their conventions.

Frames      The camera frame is the rectified left camera with OpenCV axes: x right, y down, z forward, in metres.
            It is also the world, unless a source has poses. Names say the frame: ``points_left``,
            ``left_from_box``.
Pixels      (u, v), an integer is a pixel's centre. Boxes are (u0, v0, u1, v1).
Units       Suffixes ``_px _m _rad _deg _ns``. Angles are radians here and degrees in files and on the command line.
Images      (H, W, 3) uint8 RGB.
Maps        (H, W) float32. NaN means unknown, never 0, -1 or inf.
Times       int nanoseconds.
Disparity   Positive: x_right = x_left - d.
Depth       z of the camera frame, in metres: along the optical axis, not along the ray.

Values are frozen. Their arrays are checked for shape and dtype when a value is made, and are read-only.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

Float = NDArray[np.float64]
Map = NDArray[np.float32]
Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]
Flags = NDArray[np.bool_]
Codes = NDArray[np.intp]
"""Numbers for names, or places in another array."""

Cue = Literal["gaze", "head"]
CUES: tuple[Cue, ...] = ("gaze", "head")

NOMINAL_BASELINE_M = 0.1
"""Baseline of the rig of a camera that measures depth and has no second view.

The pipeline carries depth as disparity: d = fx B / z. Without a second view, B cancels: any value gives the same points
(float32 rounds z by less than 1e-7 of it). Disparities of such a rig are not shifts between two images, so pages and
recordings show depth instead.
"""

_UNIT_ROUNDING = 4 * float(np.finfo(np.float64).eps)
"""How far the length of a normalised vector may be from 1, due to rounding."""


def _set(value: object, name: str, given: ArrayLike, dtype: DTypeLike, *shape: int | None) -> None:
    """Store ``given`` on a frozen value as a read-only array of the given dtype and shape (None: any length).

    Arrays of another dtype are refused, not converted: a silent copy of an image costs time, and an integer disparity
    has usually lost its sixteenths. Plain sequences of numbers are converted.
    """
    expected = np.dtype(dtype).name
    try:
        array = given.view() if isinstance(given, np.ndarray) else np.asarray(given, dtype=dtype)
    except (TypeError, ValueError):  # such as None, which cv2.imread returns for a file that is not there
        found = type(given).__name__
        raise ValueError(f"{type(value).__name__}.{name}: expected an array of {expected}, found {found}") from None
    if array.dtype != dtype:
        raise ValueError(f"{type(value).__name__}.{name}: expected dtype {expected}, found {array.dtype.name}")
    if array.shape != shape and (
        array.ndim != len(shape) or any(n not in (None, m) for n, m in zip(shape, array.shape, strict=True))
    ):
        expected = ", ".join("any" if n is None else str(n) for n in shape)
        raise ValueError(f"{type(value).__name__}.{name}: expected shape ({expected}), found {array.shape}")
    array.flags.writeable = False
    object.__setattr__(value, name, array)


def _set_unit(value: object, name: str, given: ArrayLike) -> None:
    """Store a direction as a read-only unit vector (3,); a zero or unknown direction is an error.

    A vector of length 1 is stored unchanged, so that a direction is the same after writing and reading.
    """
    vector = np.array(given, dtype=np.float64)
    length = math.hypot(*vector.tolist()) if vector.shape == (3,) else math.nan
    if not 0 < length < math.inf:
        raise ValueError(f"{type(value).__name__}.{name}: expected a direction (3,), found {vector}")
    if abs(length - 1) > _UNIT_ROUNDING:
        vector /= length
    vector.flags.writeable = False
    object.__setattr__(value, name, vector)


def _finite(value: object, *names: str) -> None:
    for name in names:
        if not np.isfinite(getattr(value, name)):
            raise ValueError(f"{type(value).__name__}.{name}: expected a finite number, found {getattr(value, name)}")


def _angle_or_none(value: object, name: str) -> None:
    angle = getattr(value, name)
    if angle is not None and not 0 <= angle < math.inf:
        raise ValueError(f"{type(value).__name__}.{name}: expected an angle of at least 0 or None, found {angle}")


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoRig:
    """A rectified stereo pair of pin-hole cameras with parallel axes.

    ``cx_right_px`` differs from ``cx_px`` if rectification kept separate principal points; depth is then z = fx B / (d
    + cx_right - cx). :meth:`of_depth_camera` describes a single camera that measures depth.
    """

    width_px: int
    height_px: int
    fx_px: float
    fy_px: float
    cx_px: float
    cy_px: float
    baseline_m: float
    cx_right_px: float

    def __post_init__(self) -> None:
        _finite(self, "fx_px", "fy_px", "cx_px", "cy_px", "baseline_m", "cx_right_px")
        for name in ("width_px", "height_px", "fx_px", "fy_px", "baseline_m"):
            if getattr(self, name) <= 0:
                raise ValueError(f"StereoRig.{name}: expected a positive number, found {getattr(self, name)}")

    @classmethod
    def of_depth_camera(
        cls, *, width_px: int, height_px: int, fx_px: float, fy_px: float, cx_px: float, cy_px: float
    ) -> StereoRig:
        """Return the rig of a single pin-hole camera whose depth is measured; its baseline is nominal."""
        return cls(
            width_px=width_px,
            height_px=height_px,
            fx_px=fx_px,
            fy_px=fy_px,
            cx_px=cx_px,
            cy_px=cy_px,
            baseline_m=NOMINAL_BASELINE_M,
            cx_right_px=cx_px,
        )

    @property
    def camera_matrix(self) -> Float:
        """K (3, 3) of the left camera, pixels."""
        return np.array([[self.fx_px, 0, self.cx_px], [0, self.fy_px, self.cy_px], [0, 0, 1.0]])


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoFrame:
    """One frame: a left image with a right image, with a measured depth map, or with both.

    Images are (H, W, 3) uint8 RGB, rectified. ``depth_m`` (H, W) float32 is z in metres of each pixel of the left
    image, NaN where the sensor measured nothing. ``index`` is the source's own frame number.
    """

    index: int
    time_ns: int
    left: Image
    right: Image | None = None
    depth_m: Map | None = None
    rig: StereoRig

    def __post_init__(self) -> None:
        height, width = self.rig.height_px, self.rig.width_px
        _set(self, "left", self.left, np.uint8, height, width, 3)
        if self.right is None and self.depth_m is None:
            raise ValueError("StereoFrame: expected a right image, a measured depth map or both, found neither")
        if self.right is not None:
            _set(self, "right", self.right, np.uint8, height, width, 3)
        if self.depth_m is not None:
            _set(self, "depth_m", self.depth_m, np.float32, height, width)
            if ((self.depth_m <= 0) | np.isinf(self.depth_m)).any():
                raise ValueError(
                    "StereoFrame.depth_m: expected positive depths or NaN, found 0, a negative or infinity"
                )


@dataclass(frozen=True, slots=True, kw_only=True)
class Disparity:
    """A disparity map of the left view, pixels, NaN = unknown; confidence in [0, 1] if the matcher has one."""

    disparity_px: Map
    confidence: Map | None = None

    def __post_init__(self) -> None:
        _set(self, "disparity_px", self.disparity_px, np.float32, None, None)
        if self.confidence is not None:
            _set(self, "confidence", self.confidence, np.float32, *self.disparity_px.shape)

    @property
    def known_share(self) -> float:
        """Share of the pixels with a known disparity, in [0, 1]."""
        return float(np.isfinite(self.disparity_px).mean())


@dataclass(frozen=True, slots=True, kw_only=True)
class Instance:
    """One segment: a thing (countable, such as a cup) or stuff (such as sky).

    ``id`` is its value in :attr:`Instances.ids`; ``category_id`` is the source's own number for ``label``. ``name`` is
    set if the source knows it, as for a drawn shape. None: the manifest's rules on labels and places give the name.
    ``keeps_id`` says that the source gives this object the same id in every frame.
    """

    id: int
    label: str
    category_id: int
    is_thing: bool
    score: float
    name: str | None = None
    keeps_id: bool = False

    @property
    def automatic_name(self) -> str:
        """The name of an object that nobody named, ``label#id``: it does not depend on what else is in the frame."""
        return f"{self.label}#{self.id}"


@dataclass(frozen=True, slots=True, kw_only=True)
class Instances:
    """A panoptic segmentation of the left view: ``ids`` (H, W) uint16, 0 = no instance, and the instance of each id.

    ``carried_from`` is the number of the key frame whose masks these are, moved to this frame, and ``carried_s`` the
    seconds from that frame to this one; None: found in it.
    """

    ids: NDArray[np.uint16]
    instances: tuple[Instance, ...]
    carried_from: int | None = None
    carried_s: float | None = None

    def __post_init__(self) -> None:
        _set(self, "ids", self.ids, np.uint16, None, None)
        listed = [instance.id for instance in self.instances]
        pixels = self.ids.ravel()
        starts = np.concatenate([pixels[:1], pixels[1:][pixels[1:] != pixels[:-1]]])  # of runs, far fewer than pixels
        drawn = np.flatnonzero(np.bincount(starts)).tolist()
        if len(set(listed)) != len(listed) or 0 in listed:
            raise ValueError(f"Instances.instances: expected distinct ids above 0, found {listed}")
        if unknown := set(drawn) - {0, *listed}:
            raise ValueError(f"Instances.ids: holds {sorted(unknown)}, which no instance has; instances: {listed}")

    def mask(self, instance_id: int) -> Mask:
        """Pixels (H, W) of one instance."""
        return np.equal(self.ids, instance_id)


@dataclass(frozen=True, slots=True, kw_only=True)
class Head:
    """A head seen in the left view.

    ``box_px`` (4,) is the box of the whole head (u0, v0, u1, v1), not of the face alone. If a face was found,
    ``face_box_px`` (4,) is its box, forehead to chin, and ``landmarks_px`` (5, 2) are the person's own right eye, left
    eye, nose, right and left mouth corner. ``instance_id`` is the person's instance if the detector knows it; otherwise
    it is found by overlap.
    """

    box_px: Float
    score: float
    face_box_px: Float | None = None
    landmarks_px: Float | None = None
    instance_id: int | None = None

    def __post_init__(self) -> None:
        _finite(self, "score")
        if self.landmarks_px is not None:
            _set(self, "landmarks_px", self.landmarks_px, np.float64, 5, 2)
        for name in ("box_px", "face_box_px"):
            if (box := getattr(self, name)) is not None:
                _set(self, name, box, np.float64, 4)
                u0, v0, u1, v1 = getattr(self, name)
                if not (-math.inf < u0 < u1 < math.inf and -math.inf < v0 < v1 < math.inf):
                    raise ValueError(f"Head.{name}: expected u0 < u1 and v0 < v1, found {box}")


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadPose:
    """The pose of a head: ``direction`` (3,) is the unit vector in which it points, camera frame.

    The angles are those of the model, in the crop's axes: yaw > 0 turns to the image's left, pitch > 0 up, roll > 0
    clockwise in the image. If the angles are unknown (ground truth), only the direction is set. ``sigma_rad`` is the
    angular error that the source claims, if it claims one.
    """

    direction: Float
    yaw_rad: float = float("nan")
    pitch_rad: float = float("nan")
    roll_rad: float = float("nan")
    sigma_rad: float | None = None

    def __post_init__(self) -> None:
        _set_unit(self, "direction", self.direction)
        _angle_or_none(self, "sigma_rad")


@dataclass(frozen=True, slots=True, kw_only=True)
class Gaze:
    """A gaze: ``direction`` (3,) unit, camera frame; ``sigma_rad`` is its uncertainty, None if unknown."""

    direction: Float
    sigma_rad: float | None = None

    def __post_init__(self) -> None:
        _set_unit(self, "direction", self.direction)
        _angle_or_none(self, "sigma_rad")


@dataclass(frozen=True, slots=True, kw_only=True)
class NoGaze:
    """A gaze model's reason to give no gaze. ``face_turned_away``: the head is turned too far to read the eyes."""

    cause: Literal["face_turned_away"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Cues:
    """Head pose and gaze of one person in one frame. None: not measured; ``no_gaze`` is the reason, if there is one."""

    head_pose: HeadPose | None
    gaze: Gaze | None
    no_gaze: NoGaze | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadView(Cues):
    """The head of one person in one frame's image, and its measured cues. None: that stage gave nothing.

    ``crop`` is the head's image (h, w, 3) uint8 RGB, kept if a temporal gaze model needs it.
    """

    head: Head
    crop: Image | None = None

    def __post_init__(self) -> None:
        if self.crop is not None:
            _set(self, "crop", self.crop, np.uint8, None, None, 3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Percepts:
    """Output of :func:`vfoa.pipeline.perceive` for one frame: the outputs of all stages, not yet combined."""

    index: int
    time_ns: int
    rig: StereoRig
    disparity: Disparity
    instances: Instances
    views: tuple[HeadView, ...]

    def __post_init__(self) -> None:
        size = (self.rig.height_px, self.rig.width_px)
        for name, shape in (
            ("disparity", self.disparity.disparity_px.shape),
            ("instances", self.instances.ids.shape),
        ):
            if shape != size:
                raise ValueError(f"Percepts.{name}: expected a map of {size}, found {shape}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Box3D:
    """A box in the camera frame: centre (3,), half extents (3,) along its own axes, and their rotation (3, 3).

    The columns of ``left_from_box`` are the box's axes in the camera frame; the identity for an axis-aligned box.
    """

    center_m: Float
    half_size_m: Float
    left_from_box: Float

    def __post_init__(self) -> None:
        _set(self, "center_m", self.center_m, np.float64, 3)
        _set(self, "half_size_m", self.half_size_m, np.float64, 3)
        _set(self, "left_from_box", self.left_from_box, np.float64, 3, 3)
        numbers = np.concatenate([self.center_m, self.half_size_m, self.left_from_box.ravel()])
        if not (np.isfinite(numbers).all() and (self.half_size_m > 0).all()):
            raise ValueError(
                "Box3D: expected finite numbers and positive half sizes, found "
                f"{self.center_m}, {self.half_size_m} and {self.left_from_box.tolist()}"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class Target:
    """An object that can be looked at: an instance, its cloud (N, 3) in metres (camera frame), and its box.

    ``box`` is None if too few points were known. ``box_px`` (4,) is the extent of the mask; None if the target was
    measured without an image. ``depth_from`` is the number of the frame whose depth places it, if this frame measured
    none of it (:mod:`vfoa.depth_memory`); None otherwise.
    """

    instance: Instance
    box_px: Float | None
    points_left: Map
    box: Box3D | None
    depth_from: int | None = None

    def __post_init__(self) -> None:
        if self.box_px is not None:
            _set(self, "box_px", self.box_px, np.float64, 4)
        _set(self, "points_left", self.points_left, np.float32, None, 3)


@dataclass(frozen=True, slots=True, kw_only=True)
class Person:
    """A person in the scene: the head, the person's instance, and the eye origin (3,) in metres, None if not known.

    ``view`` holds only the cues if the person was measured without an image. The source then identifies the person, and
    ``instance_id`` is the same in every frame. ``depth_from`` is the number of the frame whose depth places the eyes,
    if this frame measured none (:mod:`vfoa.depth_memory`); None otherwise.
    """

    view: Cues
    instance_id: int | None
    eye_origin_left: Float | None
    depth_from: int | None = None

    def __post_init__(self) -> None:
        if self.head is None and self.instance_id is None:
            raise ValueError("Person.instance_id: expected a number for a person measured without an image, found None")
        if self.eye_origin_left is not None:
            _set(self, "eye_origin_left", self.eye_origin_left, np.float64, 3)
            if not np.isfinite(self.eye_origin_left).all():
                raise ValueError(f"Person.eye_origin_left: expected a point or None, found {self.eye_origin_left}")

    @property
    def head(self) -> Head | None:
        """The head as seen in the image; None if there was no image."""
        return self.view.head if isinstance(self.view, HeadView) else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """One frame in metres: the targets and the people.

    Of other frames it has only the last depth of targets and eyes without one (:mod:`vfoa.depth_memory`).

    It comes from :func:`vfoa.pipeline.reconstruct`, or from a clip that holds measurements instead of images.
    ``masks_from`` is the number of the key frame whose masks were carried to this frame, and ``masks_age_s`` the
    seconds between; None if they were found in it. ``names`` are the targets' by instance id, in their order; empty
    where nobody names them. ``looked_at`` has, by the name of a person, the instance at the point of the image that
    another system says the person looks at; 0: none.
    """

    index: int
    time_ns: int
    targets: tuple[Target, ...]
    people: tuple[Person, ...]
    masks_from: int | None = None
    masks_age_s: float | None = None
    names: Mapping[int, str] = field(default_factory=dict)
    looked_at: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """A person followed over frames: the track's id, and the cues after filtering. None: not measured.

    ``name`` is None where nobody names the person.
    """

    track_id: int
    person: Person
    gaze: Gaze | None
    head_pose: HeadPose | None
    name: str | None = None

    def direction(self, cue: Cue) -> Float | None:
        """The cue's direction (3,), camera frame, or None if it was not measured."""
        source = self.gaze if cue == "gaze" else self.head_pose
        return None if source is None else source.direction


@dataclass(frozen=True, slots=True, kw_only=True)
class Cone:
    """A hollow cone of rays about one cue's direction: apex (3,) at the eyes, full apex angle ``fov_rad``."""

    cue: Cue
    apex_left: Float
    axis: Float
    fov_rad: float
    n_rays: int

    def __post_init__(self) -> None:
        _set(self, "apex_left", self.apex_left, np.float64, 3)
        _set_unit(self, "axis", self.axis)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rays:
    """All rays of one subject: a common origin (3,), directions (R, 3), and the cone (R,) of each ray.

    ``entry_m`` (R, T) is the distance along each ray to its entry into each target's box, NaN where it does not count
    (a miss, or a hit hidden by a nearer box). Its columns are :attr:`Attention.values`, in their order.
    """

    origin_left: Float
    directions: Float
    cone_index: NDArray[np.intp]
    entry_m: Float

    def __post_init__(self) -> None:
        rays = len(self.directions)
        _set(self, "origin_left", self.origin_left, np.float64, 3)
        _set(self, "directions", self.directions, np.float64, rays, 3)
        _set(self, "cone_index", self.cone_index, np.intp, rays)
        _set(self, "entry_m", self.entry_m, np.float64, rays, None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Cast:
    """The rays of one subject as they were computed, of which :attr:`cones` and :attr:`rays` are made when asked for.

    ``axes`` (C, 3) are the directions of the ``cues``, each with a cone of each angle ``fovs_rad`` about it. A cone has
    ``n_rays`` rays on its surface, and perhaps one along its axis. ``directions`` (R, 3) are those of the rays, one
    cone after another, ``entry_m`` (R, T) as of :class:`Rays`.
    """

    origin_left: Float
    cues: tuple[Cue, ...]
    axes: Float
    fovs_rad: tuple[float, ...]
    n_rays: int
    directions: Float
    entry_m: Float

    @property
    def cones(self) -> tuple[Cone, ...]:
        """The cones, cue by cue."""
        return tuple(
            Cone(cue=cue, apex_left=self.origin_left, axis=axis, fov_rad=fov_rad, n_rays=self.n_rays)
            for cue, axis in zip(self.cues, self.axes, strict=True)
            for fov_rad in self.fovs_rad
        )

    @property
    def rays(self) -> Rays:
        """All rays."""
        cones = len(self.cues) * len(self.fovs_rad)
        return Rays(
            origin_left=self.origin_left,
            directions=self.directions,
            cone_index=np.repeat(np.arange(cones), len(self.directions) // cones),
            entry_m=self.entry_m,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class TargetAttention:
    """One target's attention in [0, 1]: each cue's weighted part (NaN: the cue was not measured), and their sum."""

    instance_id: int
    gaze: float
    head: float
    total: float


class NoAttention(Enum):
    """Why a subject has no attention at all in a frame."""

    NO_EYES_3D = "no_eyes_3d"
    NO_DIRECTION = "no_direction"
    NO_ANSWER = "no_answer"
    """Of a method that reads its answers: they have none for this person and frame."""
    NO_OBJECT = "no_object"
    """The point that the person looks at lies on no target."""
    NO_HIT = "no_hit"
    """Of a method that reads its answers: no ray of the other method hit a target, and it cannot say "nowhere"."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DirectionFit:
    """How well one subject's measured directions fit the posterior's belief.

    ``tail`` is the probability, before the frame was seen, of directions that fit worse: in [0, 1], and seldom small if
    the model is right. ``claimed_error_rad`` is the mean gaze error that its model claims, ``implied_error_rad`` the
    one that the directions so far imply, bias included; None if no gaze was measured. ``implied_share`` is the share of
    the way to the targets that the head turns, as the directions imply; None if no head was measured.
    """

    tail: float
    claimed_error_rad: float | None = None
    implied_error_rad: float | None = None
    implied_share: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Attention:
    """One subject's attention in one frame: a value per target, and the focus.

    ``focus`` is the instance id of the target with the most attention, None when no target has any.
    ``tied`` are the ids of the other targets with exactly the same value (the nearest won).
    ``missing`` says why nothing could be computed; then ``values`` is empty and ``focus`` is None.
    ``fit`` and ``belief`` are there where the attention is a posterior: ``belief`` is a
    :class:`vfoa.posterior.belief.Belief`, which smoothing needs. ``cast`` is there where rays were cast.
    """

    subject: Subject
    values: tuple[TargetAttention, ...] = ()
    focus: int | None = None
    tied: tuple[int, ...] = ()
    missing: NoAttention | None = None
    fit: DirectionFit | None = None
    belief: Any = field(default=None, repr=False, compare=False)
    cast: Cast | None = field(default=None, repr=False, compare=False)

    @property
    def cones(self) -> tuple[Cone, ...]:
        """The cones of rays about the subject's cues; none where the method casts no rays."""
        return self.cast.cones if self.cast else ()

    @property
    def rays(self) -> Rays | None:
        """The rays about the subject's cues; None where the method casts none."""
        return self.cast.rays if self.cast else None


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameResult:
    """The result of the pipeline for one frame."""

    scene: Scene
    attentions: tuple[Attention, ...]
