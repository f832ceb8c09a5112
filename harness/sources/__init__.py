"""Sources of clips, of images or of measurements: one file per kind, one protocol for all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from harness.files.ascending import place_in
from vfoa.errors import VfoaError
from vfoa.registry import Registry
from vfoa.types import Box3D, Disparity, Float, Image, Instances, Scene, StereoFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class PersonTruth:
    """Ground truth of one person in one frame (camera frame, metres, unit directions). None: not known.

    ``head_box_px`` (4,) is NaN in a clip without images.
    ``target`` is the name of the target that the person looks at, ``"none"`` for nothing in the scene.
    """

    name: str
    instance_id: int
    head_box_px: Float
    eye_origin_left: Float | None = None
    head_direction: Float | None = None
    gaze_direction: Float | None = None
    target: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Truth:
    """Ground truth of one frame. None: not known to the source.

    ``boxes`` are keyed by instance id. ``missing`` names, for a field that is None, the missing file, if the source
    knows it; errors about that field quote it.
    """

    disparity: Disparity | None = None
    instances: Instances | None = None
    boxes: dict[int, Box3D] | None = None
    people: tuple[PersonTruth, ...] | None = None
    missing: Mapping[str, str] = field(default_factory=dict)


class AnyClip(Protocol):
    """A sequence of frames: a :class:`Clip` of images or a :class:`MeasuredClip`.

    Built as ``Class(settings, root)``, with ``Class.Settings``; ``root`` is the manifest's resolved ``root`` (None
    without one). Frames are read on demand and in any order; a clip can be pickled to another process.
    """

    @property
    def frames(self) -> Sequence[int]:
        """The source's own frame numbers, ascending; gaps are allowed."""

    @property
    def rate_hz(self) -> float | None:
        """Frames per second; None if the source does not know it."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the reader of a table: a view that was synthesised, frames that were dropped."""

    def time_ns(self, number: int) -> int:
        """Time of a frame, ns on the source's own clock, the same as in the frame, without reading an image."""

    def truth(self, number: int) -> Truth:
        """Return the ground truth of one frame. Read by scoring, and by stages configured as ``truth``."""

    def digest(self) -> str:
        """Hexadecimal sha256 of all that a frame and its truth depend on: contents or settings, not paths of files."""


class Clip(AnyClip, Protocol):
    """A sequence of rectified stereo frames, each read on demand."""

    def frame(self, number: int) -> StereoFrame:
        """Read one stereo pair.

        Raises
        ------
        vfoa.errors.VfoaError
            If it cannot be read: the message names the file.
        """


@runtime_checkable
class MeasuredClip(AnyClip, Protocol):
    """A sequence of measurements without images: each frame is a scene in metres. It needs no stage of perception."""

    @property
    def people(self) -> Mapping[str, int]:
        """Every person whom the source names: the instance id, the same in every frame, by name."""

    @property
    def objects(self) -> Mapping[str, int]:
        """Every other object that can be looked at: the instance id, the same in every frame, by name."""

    @property
    def categories(self) -> Mapping[str, str]:
        """The category of every person and object, by name."""

    def farthest(self) -> tuple[str, int, float] | None:
        """Return whose eyes or middle are ever farthest from the origin: name, frame, metres; None without a place."""

    def scene(self, number: int) -> Scene:
        """Return the measurements of one frame.

        Raises
        ------
        vfoa.errors.VfoaError
            If there is no such frame.
        """


@runtime_checkable
class WornBodies(Protocol):
    """An optional part of a clip of measurements: heads are bodies, and the user says where the face is on them."""

    def forward(self, person: str) -> Float:
        """Return where the face points in the axes of the body that a person wears, a unit vector (3,)."""

    def left_from_body(self, person: str, number: int) -> Float:
        """Return the rotation (3, 3) from these axes into the clip's in one frame; NaN where it was not tracked."""


@runtime_checkable
class DoubtedClip(Protocol):
    """An optional part of a clip: it knows what is probably wrong in its files."""

    @property
    def doubts(self) -> tuple[str, ...]:
        """What is in question about its values, beside its notes; the tables of a run show it with the rates."""


@runtime_checkable
class SightTruth(Protocol):
    """An optional part of a clip: it knows which lines of sight are blocked."""

    def blockers(self, number: int) -> Mapping[str, str]:
        """By person, the name of the object between the eyes and the target in one frame."""


@runtime_checkable
class LeftClip(Protocol):
    """An optional part of a clip: its left image alone, if reading the right one costs as much again.

    The labelling page plays 4K videos four times as fast with it.
    """

    def left(self, number: int) -> Image:
        """Read the left image of :meth:`Clip.frame`; raises the same errors."""


@runtime_checkable
class FilmClip(Protocol):
    """An optional part of a clip: it is read from films, which other programs play while somebody labels them."""

    @property
    def films(self) -> Mapping[str, float]:
        """The name of each film, the left view first, and when a player shows the clip's first frame in it, seconds.

        Frames have the numbers of their pictures in it, from 0.
        """


@dataclass(frozen=True, slots=True, kw_only=True)
class Recognised:
    """One way to read a path as a clip: the values that ``vfoa clips add`` writes into a manifest.

    ``root`` and ``source`` are the manifest's, ``layout`` describes the files, ``name`` is the proposed name of the
    clip. ``calibration`` names where the calibration is from; None: the user must give one. ``incomplete`` has a note
    for each calibration beside the images that cannot be used alone.
    """

    root: Path
    source: Mapping[str, Any]
    layout: str
    name: str
    calibration: str | None
    licence: str | None = None
    incomplete: tuple[str, ...] = ()


@runtime_checkable
class Recogniser(Protocol):
    """An optional part of an adapter's class: it can tell whether it reads a path.

    Every registered adapter is asked, including those of other packages.
    """

    @classmethod
    def recognise(cls, path: Path, given: Mapping[str, Any]) -> Sequence[Recognised]:
        """Return every way to read an existing absolute path; none if it is not of this kind.

        If there are several, they differ in ``source``, and the user chooses by the setting that differs. Only names
        and the first bytes of files are read. Settings that cannot be determined are left out, not guessed.

        Parameters
        ----------
        path
            What the user wants to add.
        given
            The settings that the user gives, which override what is found: an adapter may read the files that they
            name. A calibration is the setting ``calibration`` (a file) or ``camera`` (``fx_px``, ``cx_px``, ``cy_px``,
            ``baseline_m``).

        Raises
        ------
        vfoa.errors.VfoaError
            If files that the user names cannot be read, or candidates are there but none is recognised: it says how
            to name them.
        """


def given_root(root: Path | None) -> Path:
    """The root of a clip whose adapter reads files; raises if its manifest has none."""
    if root is None:
        raise VfoaError("root: missing; expected the path of the clip's files, absolute or relative to the manifest")
    return root


def check_number(number: int, frames: Sequence[int], where: object) -> None:
    """Reject a number that is not one of a clip's frames; ``where`` opens the message."""
    if place_in(frames, number) is None:
        raise VfoaError(f"{where}: no frame {number}; expected {frames[0]} to {frames[-1]}")


ADAPTERS = Registry(
    kind="adapter",
    builtin={
        "azure_kinect": "harness.sources.azure_kinect:AzureKinectClip",
        "depth_folder": "harness.sources.depth_folder:DepthFolderClip",
        "idiap_vfoa": "harness.sources.measured.idiap:IdiapClip",
        "mcap": "harness.sources.recordings.clip:McapClip",
        "measured": "harness.sources.measured.tables:MeasuredTables",
        "motive": "harness.sources.measured.motive:MotiveClip",
        "openface": "harness.sources.measured.openface:OpenFaceClip",
        "qualisys": "harness.sources.measured.qualisys:QualisysClip",
        "ros_poses": "harness.sources.measured.ros_poses:RosPosesClip",
        "rosbag": "harness.sources.recordings.clip:BagClip",
        "sintel": "harness.sources.sintel:SintelClip",
        "stereo_folder": "harness.sources.stereo_folder:StereoFolderClip",
        "studio": "harness.studio:StudioClip",
        "vicon": "harness.sources.measured.vicon:ViconClip",
        "vr_objects": "harness.sources.measured.vr_objects:VrObjectsClip",
    },
    group="vfoa.adapters",
)
