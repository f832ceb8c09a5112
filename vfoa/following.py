"""The percepts of a sequence become scenes, whose objects and people are followed from frame to frame."""

from __future__ import annotations

from dataclasses import replace

from vfoa.depth_memory import DepthMemory, EyeMemory
from vfoa.divided_people import join_people
from vfoa.instance_tracking import InstanceTracker
from vfoa.reconstruction import ReconstructionSettings, reconstruct
from vfoa.tracking import Tracked, Tracker, TrackingSettings
from vfoa.types import Percepts, Scene


class Following:
    """Reconstructs and follows one sequence under one configuration, and holds the memory.

    A run has the same steps in :mod:`harness.pipeline.perception`, where configurations share them.
    """

    def __init__(self, reconstruction: ReconstructionSettings, tracking: TrackingSettings) -> None:
        self._settings = reconstruction
        self._instances, self._tracker = InstanceTracker(), Tracker(tracking)
        self._depths, self._eyes = DepthMemory(), EyeMemory()

    def step(self, found: Percepts) -> tuple[Percepts, Scene, Tracked]:
        """Return the next frame: its percepts under lasting numbers, its scene in metres, and its tracks.

        The parts of a divided person are joined; objects and eyes without a depth have their last one.
        """
        joined = join_people(found, self._settings.person)
        percepts = self._instances.step(joined.instances, found.time_ns).renumber(joined)
        scene = reconstruct(percepts, self._settings)
        tracked = self._tracker.step(scene.people)
        targets = self._depths.step(scene.targets, percepts)
        people = self._eyes.step(scene.people, tracked.ids, percepts)
        return percepts, replace(scene, targets=targets, people=people), tracked
