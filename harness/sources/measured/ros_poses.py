"""Poses of bodies that ROS 1 or ROS 2 recorded (``.bag``, ``.db3``, ``.mcap``), without images.

::

    /vrpn_client_node/anna/pose   geometry_msgs/PoseStamped        vrpn_client_ros, mocap_optitrack, qualisys ...
    /vicon/anna/anna              geometry_msgs/TransformStamped   vicon_bridge
    /amcl_pose, /odom             geometry_msgs/PoseWithCovarianceStamped, nav_msgs/Odometry: a robot's estimate
    /tf, /tf_static               tf2_msgs/TFMessage               any tracker; face_ID and gaze_ID of ROS4HRI (REP 155)

A body is a topic, or a coordinate frame of /tf. Its pose turns its own axes into those of the frame in the message's
header; /tf and /tf_static bring these into one frame, which is right-handed with z up (REP 103). Estimates are most
often on /tf, too: they are bodies where they are named, or where a recording has no others.

Messages of bodies have their own times and rates. A frame begins with the first message that is in no frame yet, and
lasts until a body in it is sent again, at most the step (median) of the body with the shortest one. It has the message
of each body that is nearest to its beginning; a body is lost in a frame if that is more than one and a half of the
body's own steps away. A pose that was sent once, or on /tf_static, holds in all frames; that on /tf_static does not
count where /tf has the frame, too.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import field_validator

from harness.files.digests import digest_files
from harness.files.groups import grouped
from harness.files.safe_names import check_name, composed
from harness.sources import Recognised
from harness.sources.measured.motion_capture import (
    MotionCaptureClip,
    MotionCaptureSettings,
    Poses,
    Take,
    Up,
    check_heads,
    poses_in,
)
from harness.sources.recordings.clip import is_of_poses, open_container
from harness.sources.recordings.containers import Container
from harness.sources.recordings.joining import notes_on_clock, notes_on_files
from harness.sources.recordings.messages import MessageType, fields_of, reading
from harness.sources.recordings.topics import Place
from vfoa.errors import VfoaError, check_known, listed, reported_as
from vfoa.types import Float

Times = NDArray[np.int64]

_FARTHEST_STEPS = 1.5
_HEAD = re.compile("(?:face|gaze|head)_(?!(?:link|frame)$)(.+)")
"""ROS4HRI's frames of a head, with its ID; ``head_link`` is a robot's."""
_FACE = re.compile("(?:face|gaze)_.+")
"""Those of a head whose origin is between the eyes."""
_NAMELESS = frozenset({"pose", "poses", "pose_stamped", "transform", "transform_stamped", "tf"})
"""Last parts of topics that say what is sent, not of which body."""


class RosPosesSettings(MotionCaptureSettings):
    """Settings of :class:`RosPosesClip`: ``file`` is a recording, a file or the folder of one that was split.

    ``bodies`` are those that are read, beside the heads: without it all topics of trackers, or without these all frames
    of /tf that move. ``frame`` is the coordinate frame of the clip, without it the one that has no parent. ``stamps``
    are those of the headers, or of the log (when a message was recorded).
    """

    up: Up = "z"
    bodies: tuple[str, ...] | None = None
    frame: str | None = None
    stamps: Literal["header", "log"] = "header"

    @field_validator("bodies", "frame")
    @classmethod
    def _compose_frames(cls, names: tuple[str, ...] | str | None) -> tuple[str, ...] | str | None:
        return tuple(map(composed, names)) if isinstance(names, tuple) else names and composed(names)


class RosPosesClip(MotionCaptureClip):
    """A clip without images from a recording of poses."""

    Settings = RosPosesSettings

    @classmethod
    def recognise(cls, path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
        """Recognise a recording with poses and without images."""
        if not is_of_poses(path):
            return ()
        name = path.stem if path.is_file() else path.name
        layout, source = "a recording of poses, without images", {"file": path.name}
        return (Recognised(root=path.parent, source=source, layout=layout, name=name, calibration="not needed"),)

    def _take(self, path: Path, settings: MotionCaptureSettings) -> Take:
        assert isinstance(settings, RosPosesSettings)
        take = self.read(path, settings.every, settings)
        check_heads(settings, take.poses, f"{path}: a recording without images")
        return take

    @staticmethod
    def read(path: Path, every: int = 1, settings: RosPosesSettings | None = None) -> Take:
        """Read each n-th frame of a recording.

        Raises
        ------
        VfoaError
            For the first mistake, with topic: no pose, a message without time stamp, a quaternion that is not of length
            1, a body in two frames, or frames that no transform joins.
        """
        settings = settings or RosPosesSettings(file=path.name)
        container, losses = open_container(path), list[str]()
        trajectories, ends = _trajectories(container, settings.stamps, path, losses)
        names = _names(trajectories)
        chosen = _chosen(names, trajectories, settings, path)
        tree = _Tree(trajectories, settings.frame, path)
        tree.join(chosen)
        times_ns = _frame_times(tree.used)[::every]
        files = [(f"recording {number}", file) for number, file in enumerate(container.files)]
        once = [
            name for name, key in chosen.items() if not (trajectories[key].is_moving or trajectories[key].is_static)
        ]
        return Take(
            numbers=range(1, 1 + every * len(times_ns), every),
            times_ns=times_ns.tolist(),
            poses={name: tree.poses(key, times_ns) for name, key in chosen.items()},
            faces=frozenset(name for name, key in chosen.items() if _FACE.fullmatch(key)),
            digest=digest_files(files),
            notes=(
                *losses,
                *notes_on_files(ends, container.files),
                *(_clock_notes(tree.used) if settings.stamps == "header" else ()),
                *_apart({name: trajectories[key] for name, key in chosen.items()}),
                *(f"{name}: sent once: taken to be at rest" for name in once),
            ),
        )


@dataclass
class _Trajectory:
    """All poses of one body or coordinate frame: rows x, y, z, w and place, m, and their times, ns.

    ``files`` are the indexes of the files that they are from; ``parents`` the frames of these poses, expected is one.
    """

    where: str
    is_static: bool
    is_estimate: bool = False
    stamps_ns: list[int] = field(default_factory=list)
    files: list[int] = field(default_factory=list)
    cells: list[list[float]] = field(default_factory=list)
    parents: dict[str, None] = field(default_factory=dict)

    @property
    def is_moving(self) -> bool:
        """Whether it was sent at more than one time."""
        return not self.is_static and len(self.in_order[0]) > 1

    @property
    def step_ns(self) -> float:
        """The median time between two poses."""
        return float(np.median(np.diff(self.in_order[0])))

    def add(self, file: int, parent: str, stamp_ns: int, cells: list[float]) -> None:
        """Add one pose; of those that are static the last one holds."""
        if self.is_static:
            self.files, self.stamps_ns, self.cells = [], [], []
        self.parents[parent] = None
        self.files.append(file)
        self.stamps_ns.append(stamp_ns)
        self.cells.append(cells)

    @cached_property
    def in_order(self) -> tuple[Times, Poses]:
        """Ascending times (N,), each once, and the poses (N,)."""
        cells: Float = np.array(self.cells)
        for row in np.flatnonzero(np.isinf(cells).any(axis=1))[:1]:
            raise VfoaError(f"{self.where}: message {row + 1}: found an infinite number; expected finite ones")
        poses = poses_in(cells, 1.0, lambda row: f"{self.where}: message {row + 1}")
        stamps_ns, places = np.unique(np.array(self.stamps_ns, dtype=np.int64), return_index=True)
        return stamps_ns, Poses(rotations=poses.rotations[places], places_m=poses.places_m[places])


def _trajectories(
    container: Container, stamps: str, path: Path, losses: list[str]
) -> tuple[dict[str, _Trajectory], list[Place]]:
    """Trajectories by topic, which begins with a slash, or by coordinate frame, which does not; the ends of files."""
    trajectories: dict[str, _Trajectory] = {}
    ends: dict[int, tuple[Place, Place]] = {}
    for file, topic, kind, log_ns, data in container.poses(losses):
        here = Place(log_ns, file, 0, 0)
        first, last = ends.get(file, (here, here))
        ends[file] = min(first, here), max(last, here)
        where, is_static = f"{path}: {topic}", topic.endswith("tf_static")
        with reading(kind, where):
            for child, parent, stamp_ns, cells in _poses_of(kind, data, where):
                if not stamp_ns and not is_static and stamps == "header":
                    raise VfoaError(
                        f"{where}: a pose without time stamp; expected one, bodies are joined by it "
                        '(stamps = "log" in [source] joins them by the time of recording)'
                    )
                key = composed(f"/{topic.lstrip('/')}") if child is None else child
                new = _Trajectory(where if child is None else f"{where}: {child}", is_static, _is_estimate(kind))
                trajectory = trajectories.setdefault(key, new)
                if trajectory.is_static and not is_static:  # a default: what moves is measured
                    trajectory = trajectories[key] = new
                if trajectory.is_static == is_static:
                    trajectory.add(file, parent, stamp_ns if stamps == "header" else log_ns, cells)
    if not trajectories:
        raise VfoaError(f"{path}: no pose can be read{': ' * bool(losses)}{'; '.join(losses[:3])}")
    return trajectories, [end for both in ends.values() for end in both]


def _is_estimate(kind: MessageType) -> bool:
    """Whether a pose comes with its covariance, as that of a robot that localises itself."""
    return kind.name.endswith(("/PoseWithCovarianceStamped", "/Odometry"))


def _poses_of(kind: MessageType, data: bytes, where: str) -> Iterator[tuple[str | None, str, int, list[float]]]:
    """Of each pose in a message: its own frame if it is of /tf, the frame of its header, its stamp, and its numbers."""
    message = fields_of(kind, data, where)
    given: list[tuple[str | None, Any, Any, Any]]
    if kind.name.endswith("/PoseStamped"):
        pose = message("pose")
        given = [(None, message("header"), pose.orientation, pose.position)]
    elif _is_estimate(kind):
        pose = message("pose").pose
        given = [(None, message("header"), pose.orientation, pose.position)]
    elif kind.name.endswith("/TransformStamped"):
        moved = message("transform")
        given = [(None, message("header"), moved.rotation, moved.translation)]
    else:
        given = [
            (_plain(each.child_frame_id), each.header, each.transform.rotation, each.transform.translation)
            for each in message("transforms")
        ]
    for child, header, turn, place in given:
        cells = [*(float(getattr(turn, axis)) for axis in "xyzw"), *(float(getattr(place, axis)) for axis in "xyz")]
        yield child, _plain(header.frame_id), header.stamp.sec * 10**9 + header.stamp.nanosec, cells


def _plain(frame: object) -> str:
    return composed(str(frame)).removeprefix("/")  # tf's old names began with a slash


def _clock_notes(trajectories: Sequence[_Trajectory]) -> list[str]:
    """A note on the first trajectory whose clock was set back: most often it is the clock of all."""
    notes = (notes_on_clock(each.where, zip(each.files, each.stamps_ns, strict=True)) for each in trajectories)
    return next(filter(None, notes), [])


def _apart(bodies: Mapping[str, _Trajectory]) -> Iterator[str]:
    """A note if two bodies have no time in common, as with two clocks."""
    spans = {name: each.in_order[0][[0, -1]] for name, each in bodies.items() if each.is_moving}
    if not spans:
        return
    early = min(spans, key=lambda name: int(spans[name][1]))
    late = max(spans, key=lambda name: int(spans[name][0]))
    if (apart_s := (spans[late][0] - spans[early][1]) / 1e9) > 0:
        yield (
            f"{late} begins {apart_s:.3f} s after {early} ends; if that is due to clocks that differ, "
            'say stamps = "log" in [source]'
        )


def _names(trajectories: Mapping[str, _Trajectory]) -> dict[str, str]:
    """Trajectories by the names of bodies: the last part that says which body it is, or all parts if others share it.

    A coordinate frame with the name of a topic's body is not a body: drivers send the same poses on /tf, too.
    """
    names: dict[str, str] = {}
    for are_topics in (True, False):
        keys = [key for key in sorted(trajectories) if key.startswith("/") == are_topics]
        for short, those in grouped((_short(key), key) for key in keys).items():
            for key in those:
                name = short if len(those) == 1 and short not in names else key.strip("/")
                with reported_as(trajectories[key].where):
                    check_name(name)
                names.setdefault(name, key)
    return names


def _short(key: str) -> str:
    parts = [part for part in key.split("/") if part]
    while len(parts) > 1 and parts[-1] in _NAMELESS:
        parts.pop()
    return parts[-1] if parts else key


def _chosen(
    names: Mapping[str, str], trajectories: Mapping[str, _Trajectory], settings: RosPosesSettings, path: Path
) -> dict[str, str]:
    """The trajectories of the bodies that are read, by name.

    Frames of ROS4HRI with the ID of a head (``body_ID``, ``torso_ID``) are parts of that person, and no bodies if they
    are not named.
    """
    worn = [body for name, head in settings.heads.items() for body in head.names(name)]
    if settings.bodies is None:
        estimates = [name for name, key in names.items() if trajectories[key].is_estimate]
        topics = [name for name, key in names.items() if key.startswith("/") and name not in estimates]
        moving = [name for name, key in names.items() if trajectories[key].is_moving and name not in estimates]
        parts = tuple(f"_{head[1]}" for name in worn if (head := _HEAD.fullmatch(name)))
        bodies = topics or [name for name in moving or estimates or names if not name.endswith(parts)]
    else:
        bodies = [*settings.bodies]
        for name in bodies:
            check_known(name, names, f"{path}: bodies: no rigid body")
    for name in worn:
        check_known(name, names, f"{path}: heads: no rigid body")
    return {name: names[name] for name in dict.fromkeys([*bodies, *worn])}


class _Tree:
    """Coordinate frames that are joined by transforms, in one of them: ``frame``, or the one that has no parent."""

    def __init__(self, trajectories: Mapping[str, _Trajectory], frame: str | None, path: Path) -> None:
        self._trajectories, self._frame, self._path = trajectories, frame, path
        self._motions: dict[str, Float] = {}
        self.used: list[_Trajectory] = []
        """The trajectories on which the poses of bodies depend."""

    def join(self, bodies: Mapping[str, str]) -> None:
        """Find the trajectories that lead from each body to one frame.

        Raises
        ------
        VfoaError
            If there is no such frame.
        """
        if self._frame is not None:
            frames = {frame for trajectory in self._trajectories.values() for frame in trajectory.parents}
            frames.update(key for key in self._trajectories if not key.startswith("/"))
            check_known(self._frame, frames, f"{self._path}: frame: no coordinate frame")
            bodies = {self._frame: self._frame, **bodies}
        chains = {name: self._chain(key) for name, key in bodies.items()}
        first, top = next((name, chain[-1]) for name, chain in chains.items())
        for name, chain in chains.items():
            if chain[-1] != top:
                raise VfoaError(
                    f"{self._path}: {first} is in the frame {top!r}, {name} in {chain[-1]!r}; expected transforms "
                    "between both in the recording (/tf, /tf_static), or bodies = [NAMES of some] in [source]"
                )
        keys = dict.fromkeys(key for chain in chains.values() for key in chain)
        self.used = [self._trajectories[key] for key in keys if key in self._trajectories]

    def _chain(self, key: str) -> list[str]:
        """A trajectory and the frames in which it is, up to the one that has no parent."""
        chain = [key]
        while (trajectory := self._trajectories.get(chain[-1])) is not None:
            if len(trajectory.parents) > 1:
                frames = listed([*map(repr, trajectory.parents)])
                raise VfoaError(f"{trajectory.where}: found poses in the frames {frames}; expected one")
            (parent,) = trajectory.parents
            if parent in chain:
                raise VfoaError(
                    f"{trajectory.where}: found a loop of frames: {listed([*chain, parent])}; expected a tree"
                )
            chain.append(parent)
        return chain

    def poses(self, key: str, times_ns: Times) -> Poses:
        """The poses of a trajectory at some times (N,)."""
        motions = self._motions_at(key, times_ns)
        if self._frame is not None:
            motions = np.linalg.inv(self._motions_at(self._frame, times_ns)) @ motions
        return Poses(rotations=motions[:, :3, :3], places_m=motions[:, :3, 3])

    def _motions_at(self, key: str, times_ns: Times) -> Float:
        """The motions (N, 4, 4) from a trajectory's axes to the frame that has no parent; NaN where it was lost."""
        if key not in self._trajectories:
            return np.broadcast_to(np.eye(4), (len(times_ns), 4, 4))
        if key not in self._motions:
            trajectory = self._trajectories[key]
            own = _motions(trajectory, times_ns)
            self._motions[key] = self._motions_at(next(iter(trajectory.parents)), times_ns) @ own
        return self._motions[key]


def _motions(trajectory: _Trajectory, times_ns: Times) -> Float:
    """The motions (N, 4, 4) from a trajectory's axes to its parent's at some times (N,), by the rule above."""
    stamps_ns, poses = trajectory.in_order
    motions = np.tile(np.eye(4), (len(stamps_ns), 1, 1))
    motions[:, :3, :3], motions[:, :3, 3] = poses.rotations, poses.places_m
    if not trajectory.is_moving:
        return np.broadcast_to(motions[-1], (len(times_ns), 4, 4))
    after = np.clip(np.searchsorted(stamps_ns, times_ns), 1, len(stamps_ns) - 1)
    is_later = stamps_ns[after] - times_ns < times_ns - stamps_ns[after - 1]
    nearest = np.where(is_later, after, after - 1)
    is_lost = np.abs(stamps_ns[nearest] - times_ns) > _FARTHEST_STEPS * trajectory.step_ns
    return np.where(is_lost[:, np.newaxis, np.newaxis], np.nan, motions[nearest])


def _frame_times(trajectories: Sequence[_Trajectory]) -> Times:
    """The time of each frame, ns, by the rule above."""
    moving = [trajectory for trajectory in trajectories if trajectory.is_moving]
    if not moving:
        return np.array([max(max(trajectory.stamps_ns) for trajectory in trajectories)], dtype=np.int64)
    step_ns = min(trajectory.step_ns for trajectory in moving)
    sent = sorted((stamp_ns, body) for body, each in enumerate(moving) for stamp_ns in each.in_order[0].tolist())
    begins, bodies = list[int](), set[int]()
    for stamp_ns, body in sent:
        if not begins or body in bodies or stamp_ns - begins[-1] > step_ns:
            begins.append(stamp_ns)
            bodies.clear()
        bodies.add(body)
    return np.array(begins, dtype=np.int64)
