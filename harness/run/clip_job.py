"""The job of one process (one clip), its progress and its outcome."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field

from harness.clips.manifest import ClipManifest
from harness.files.digests import KNOWN
from harness.files.io import UnchangedFiles
from harness.labels.labels import Labels
from harness.pipeline.cache import ClipCache, Tally
from harness.pipeline.configuration import Configuration
from harness.pipeline.drawn import DrawnClip
from harness.pipeline.perception import Perception
from harness.run.directory import Pair, RunDirectory, new_run_id
from harness.run.frame_sink import SinkFactory
from harness.run.resume import Checkpoint, read_checkpoint
from harness.sources import Clip, MeasuredClip
from vfoa.errors import VfoaError
from vfoa.gaze.temporal import WindowStart


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipJob:
    """A clip under some configurations. It is pickled, so it holds only settings, paths and factories.

    ``run_id`` is the random id of the run, for its recordings. Finished frames go to the ``sinks`` in their order.
    ``drawn`` holds the shapes drawn on the clip. ``digest`` is that of the clip's content, of which every frame must be
    read (None: not checked), and ``known`` are digests by the stamp of their files. ``cache`` is None if no output of a
    stage is stored. ``read_ahead`` and ``perceive_ahead`` are the numbers of frames that one thread reads and another
    one perceives in advance; 0 for no thread.
    """

    manifest: ClipManifest
    frames: tuple[int, ...]
    labels: Labels | None
    configurations: tuple[Configuration, ...]
    directory: RunDirectory
    run_id: str = field(default_factory=new_run_id)
    sinks: tuple[SinkFactory, ...] = ()
    drawn: DrawnClip | None = None
    digest: str | None = None
    known: Mapping[str, str] = field(default_factory=dict)
    cache: ClipCache | None = None
    read_ahead: int = 0
    perceive_ahead: int = 0

    @property
    def sink_names(self) -> list[str]:
        """A name for each sink factory: its position and its class."""
        return [f"{place} {type(factory).__name__}" for place, factory in enumerate(self.sinks, start=1)]

    @property
    def pairs(self) -> list[Pair]:
        """The (clip, configuration) pairs of the job."""
        return [(self.manifest.name, configuration.name) for configuration in self.configurations]

    def unchanged(self, clip: Clip | MeasuredClip) -> Callable[[], AbstractContextManager[None]]:
        """The blocks in which the clip is read as it was when the run began (:class:`.unchanged.UnchangedFiles`).

        Raises
        ------
        VfoaError
            If it has changed already.
        """
        if self.digest is None:
            return nullcontext
        KNOWN.add(self.known)
        return UnchangedFiles(self.manifest.name, clip.digest, self.digest).active

    def perception(
        self,
        clip: Clip,
        *,
        begins: Mapping[str, int] | None = None,
        starts: Mapping[str, WindowStart] | None = None,
    ) -> Perception:
        """Percepts and scenes of the clip for the job's configurations; ``begins`` and ``starts`` as there."""
        parallel = self.perceive_ahead > 0
        return Perception(
            self.configurations, clip, self.cache, drawn=self.drawn, parallel=parallel, begins=begins, starts=starts
        )

    def outcome(self, errors: Iterable[VfoaError | None], tallies: Mapping[str, Tally] | None = None) -> ClipOutcome:
        """The outcome of the job, from each configuration's error in order (None: it is finished)."""
        failures = {pair: error for pair, error in zip(self.pairs, errors, strict=True) if error is not None}
        return ClipOutcome(failures=failures, tallies=tallies or {})


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipOutcome:
    """Outcome of a job: the error of each (clip, configuration) that failed, and the use of the cache by stage key."""

    failures: Mapping[Pair, VfoaError]
    tallies: Mapping[str, Tally] = field(default_factory=dict)


def checkpoints(job: ClipJob, tell: Callable[[str], None] = lambda line: None) -> dict[str, Checkpoint]:
    """Read the usable checkpoints of a job by configuration name; ``tell`` is called with a line about each."""
    frames = frozenset(job.frames)
    found: dict[str, Checkpoint] = {}
    for clip, name in job.pairs:
        read, misfit = read_checkpoint(job.directory, (clip, name), frames, job.sink_names)
        if read is not None:
            found[name] = read
            tell(f"{clip} under {name}: continues after frame {read.frame}")
        elif misfit is not None:
            tell(f"{clip} under {name}: its checkpoint does not fit ({misfit}); it starts again with the first frame")
    return found


def first_frame(job: ClipJob, resumed: Mapping[str, Checkpoint]) -> int:
    """Return the first frame that a job must read: that of the configuration that is least advanced."""
    begin = min(job.frames, default=0)
    return min(resumed[each.name].first_read if each.name in resumed else begin for each in job.configurations)
