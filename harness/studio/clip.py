"""The adapter of the studio: renders a scenario's frames and returns their ground truth."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from functools import lru_cache
from importlib import metadata, resources
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from harness.sources import Truth
from harness.studio.gathering import gathering
from harness.studio.scenario import MEAN_FIXATION_S, SCENARIOS, Scenario, ScenarioName
from harness.studio.stage import RIG, Stage
from vfoa.errors import VfoaError
from vfoa.geometry import disparity_from_depth
from vfoa.settings import Settings
from vfoa.types import Disparity, Image, Instances, Map, StereoFrame

if TYPE_CHECKING:
    from harness.studio.render import LinesOfSight, Renderer


class StudioSettings(Settings):
    """The scenario, the number of frames, and the seed of durations, aims and sensor noise.

    ``mean_fixation_s`` is the mean time of a look at one target: about 0.3 s in a search, seconds in a talk. For a
    ``gathering`` the seed also decides seats, objects and looks. A longer clip begins with the same frames as a shorter
    one. With ``step`` it has every Nth frame of the scenario, so that few frames show many looks.
    """

    scenario: ScenarioName | Literal["gathering"]
    frames: int = Field(default=60, ge=1, le=100_000)
    seed: int = Field(default=7, ge=0)
    mean_fixation_s: float = Field(default=MEAN_FIXATION_S, ge=0.2, le=30)
    step: int = Field(default=1, ge=1, le=1000)


class StudioClip:
    """A rendered clip. It has no files: ``root`` must be None.

    Frame numbers begin at 1. A person's ``target`` is None during a saccade. Boxes are those of the whole bodies,
    visible or not, so they reach further back than stereo can measure; disparity and instances are those of the visible
    surfaces. Table, walls, floor and curtain are stuff.
    """

    Settings = StudioSettings

    def __init__(self, settings: StudioSettings, root: Path | None) -> None:
        if root is not None:
            raise VfoaError(f"root: found {str(root)!r}; expected none: the studio renders its frames")
        self._settings = settings

    nearest_m = 1.0
    """Nothing is nearer to the cameras. A limit of depth below this needs no frame to be rendered for a check."""

    @property
    def frames(self) -> range:
        """Frame numbers, from 1."""
        return range(1, self._settings.frames + 1)

    @property
    def rate_hz(self) -> float:
        """Frames per second of the clip: the scenario's, or a part of them."""
        return _scenario(self._settings).rate_hz / self._settings.step

    @property
    def notes(self) -> tuple[str, ...]:
        """A note that the clip is rendered."""
        return ("Rendered scene: geometry, heads and gaze are exact; labels say what a gaze is aimed at, seen or not.",)

    def time_ns(self, number: int) -> int:
        """Time since the first frame."""
        return round(self._index(number) * 1_000_000_000 / _scenario(self._settings).rate_hz)

    def frame(self, number: int) -> StereoFrame:
        """Render a pair, or read it from the cache."""
        left, right = self._pair(self._index(number))
        return StereoFrame(index=number, time_ns=self.time_ns(number), left=left, right=right, rig=RIG)

    def truth(self, number: int) -> Truth:
        """Return the ground truth, which is complete; disparity and instances are rendered, or read from the cache."""
        index, stage = self._index(number), _stage(self._settings)
        disparity_px, ids = self._geometry(index)
        drawn = set(np.unique(ids).tolist())
        return Truth(
            disparity=Disparity(disparity_px=disparity_px),
            instances=Instances(
                ids=ids, instances=tuple(instance for instance in stage.instances if instance.id in drawn)
            ),
            boxes=stage.boxes(index),
            people=stage.people(index),
        )

    def blockers(self, number: int) -> dict[str, str]:
        """By person, the object between the eyes and the target (:class:`harness.studio.render.LinesOfSight`)."""
        return _lines_of_sight(self._settings).blockers(self._index(number))

    def digest(self) -> str:
        """Sha256 of the settings and of the code that draws: this package's own source."""
        return hashlib.sha256(f"{self._settings.model_dump_json()}\n{_source_digest()}".encode()).hexdigest()

    def _index(self, number: int) -> int:
        """The place of a frame in the scenario, from 0."""
        if number not in self.frames:
            raise VfoaError(
                f"studio {self._settings.scenario}: no frame {number}; expected 1 to {self._settings.frames}"
            )
        return (number - 1) * self._settings.step

    def _pair(self, index: int) -> tuple[Image, Image]:
        from harness.studio.store import load_pair, save_pair

        path = self._stored("frame", index)
        if (stored := load_pair(path, (RIG.height_px, RIG.width_px))) is not None:
            return stored
        renderer = _renderer(self._settings)
        left, right = renderer.image(index, 0), renderer.image(index, 1)
        save_pair(path, left, right)
        return left, right

    def _geometry(self, index: int) -> tuple[Map, NDArray[np.uint16]]:
        """Disparity (H, W), NaN where nothing is, and instance ids (H, W) of the left view."""
        from harness.studio.store import load_geometry, save_geometry

        path = self._stored("truth", index)
        if (stored := load_geometry(path, (RIG.height_px, RIG.width_px))) is not None:
            return stored
        seen = _renderer(self._settings).left_geometry(index)
        depth_m = np.where(np.isfinite(seen.depth_m), seen.depth_m, np.nan)
        disparity_px = disparity_from_depth(depth_m, RIG).astype(np.float32)
        save_geometry(path, disparity_px, seen.ids)
        return disparity_px, seen.ids

    def _stored(self, kind: str, index: int) -> Path:
        from harness.studio.store import cache_folder

        return cache_folder(_cache_key(self.digest())) / f"{kind}_{index + 1:04d}.bin"


@lru_cache(maxsize=64)  # the rate is read for every frame, and a gathering would be drawn again
def _scenario(settings: StudioSettings) -> Scenario:
    usual = gathering(settings.seed) if settings.scenario == "gathering" else SCENARIOS[settings.scenario]
    return replace(usual, mean_fixation_s=settings.mean_fixation_s)


@lru_cache(maxsize=4)
def _stage(settings: StudioSettings) -> Stage:
    return Stage(_scenario(settings), (settings.frames - 1) * settings.step + 1, settings.seed)


@lru_cache(maxsize=1)
def _lines_of_sight(settings: StudioSettings) -> LinesOfSight:
    from harness.studio.render import LinesOfSight

    return LinesOfSight(_stage(settings))


@lru_cache(maxsize=1)
def _renderer(settings: StudioSettings) -> Renderer:
    # Importing Open3D is slow; a clip whose frames are stored is read without it.
    from harness.studio.render import Renderer

    return Renderer(_stage(settings), settings.seed)


@lru_cache(maxsize=1)
def _source_digest() -> str:
    """Digest of this package's files, which changes whenever the renderer changes."""
    total = hashlib.sha256()
    files = [file for file in resources.files(__package__).iterdir() if file.name.endswith(".py")]
    for file in sorted(files, key=lambda file: file.name):
        total.update(f"{file.name}\0{hashlib.sha256(file.read_bytes()).hexdigest()}\n".encode())
    return total.hexdigest()


@lru_cache(maxsize=8)
def _cache_key(digest: str) -> str:
    """The clip's digest and the versions of the libraries that computed the pixels."""
    versions = []
    for name in ("numpy", "open3d-cpu", "open3d", "opencv-contrib-python-headless"):
        try:
            versions.append(f"{name} {metadata.version(name)}")
        except metadata.PackageNotFoundError:
            continue
    return hashlib.sha256("\n".join([digest, *versions]).encode()).hexdigest()
