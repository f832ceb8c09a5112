"""The input and the report of one process that runs one clip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from harness.clips.manifest import ClipManifest
from harness.labels.files import Labels
from harness.run.directory import Pair, RunDirectory
from harness.run.frame_sink import SinkFactory
from harness.stages.cache.stage import ClipCache, Tally
from harness.stages.configuration import Configuration
from harness.stages.drawn import DrawnClip
from vfoa.errors import VfoaError


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipJob:
    """A clip under some configurations: settings, paths and factories only, since it is pickled.

    Each finished frame goes to the ``sinks`` in their order. ``drawn`` is what a person drew on the clip. ``cache`` is
    None where no stage output is stored. ``read_ahead`` and ``perceive_ahead`` are how many frames a thread reads, and
    another one perceives, before they are needed; 0 for no thread. Stages are compared with the ground truth if
    ``measured``. ``keeps``: frames do not come again, so that those that were finished before an error are complete.
    """

    manifest: ClipManifest
    frames: tuple[int, ...]
    labels: Labels | None
    configurations: tuple[Configuration, ...]
    directory: RunDirectory
    sinks: tuple[SinkFactory, ...] = ()
    drawn: DrawnClip | None = None
    cache: ClipCache | None = None
    read_ahead: int = 0
    perceive_ahead: int = 0
    measured: bool = True
    keeps: bool = False

    @property
    def sink_names(self) -> list[str]:
        """A name for each sink factory: its place and its class."""
        return [f"{place} {type(factory).__name__}" for place, factory in enumerate(self.sinks, start=1)]

    @property
    def pairs(self) -> list[Pair]:
        """The (clip, configuration) pairs of the job."""
        return [(self.manifest.name, configuration.name) for configuration in self.configurations]


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipOutcome:
    """How a job ended: the error of each (clip, configuration) that failed, and the use of the cache by stage key."""

    failures: Mapping[Pair, VfoaError]
    tallies: Mapping[str, Tally] = field(default_factory=dict)
