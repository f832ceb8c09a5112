"""A live run: one configuration on the newest frames of a source, recorded like any other run."""

from __future__ import annotations

import shutil
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event
from typing import Any, Self

from harness.clips.manifest import ClipManifest
from harness.files.io import atomic_write
from harness.run.clip_job import ClipJob
from harness.run.directory import RunDirectory
from harness.run.executors.contract import MOST_THREADS, compute_with
from harness.run.experiment import Experiment
from harness.run.frame_sink import FinishedFrame, SinkContext, SinkFactory
from harness.run.live.clip import Latency, LiveClip
from harness.run.live.newest import Newest
from harness.run.loop import attend_to
from harness.run.partial_results import ResultsSinks
from harness.run.plan import Plan, PreparedClip, describe, drawn_on, said_of_drawn
from harness.run.runner import circumstances, now
from harness.sources.live import LiveSource
from harness.stages.perception import Perception
from harness.stages.prefetch import prefetch
from vfoa.errors import VfoaError


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveReport:
    """Summary of a live run: frames done, dropped and damaged, and milliseconds from a frame's arrival to its end."""

    frames: int
    dropped: int
    damaged: int
    latency_median_ms: float | None
    latency_p95_ms: float | None

    def __str__(self) -> str:
        come = self.frames + self.dropped + self.damaged
        share = f" ({self.dropped / come:.0%})" if come else ""
        text = f"{self.frames} frames, {self.dropped} dropped{share}"
        if self.damaged:
            text += f", {self.damaged} damaged"
        if self.latency_median_ms is None or self.latency_p95_ms is None:
            return text
        return f"{text}; latency {self.latency_median_ms:.0f} ms (median), {self.latency_p95_ms:.0f} ms (95 %)"


def run_live(
    source: LiveSource,
    manifest: ClipManifest,
    experiment: Experiment,
    directory: RunDirectory,
    *,
    stopped: Event,
    frames: Sequence[int] | None = None,
    sinks: Iterable[SinkFactory] = (),
    limit: int | None = None,
    threads: int = 1,
    progress: Callable[[str], None] = lambda clip: None,
) -> LiveReport:
    """Process frames until the source ends, ``stopped`` is set or ``limit`` is reached; finished frames are kept.

    Parameters
    ----------
    manifest
        The names of the source and of the people and things in it.
    frames
        The frame numbers of a clip that is played, whose drawing is used; None for cameras and recordings.
    experiment
        It must have one configuration.
    directory
        That of a new run. It also gets ``latency.csv``: a line per frame, with the number of frames dropped before it.
    sinks
        Further receivers of finished frames, beside the results.
    threads
        With several, the next frame is perceived while the last one is attended to and recorded.

    Raises
    ------
    VfoaError
        If the source cannot be read, or a frame cannot be computed. The frames before are kept, as a finished run.
    """
    if not directory.is_new():
        raise VfoaError(f"{directory.path}: holds a run already; a live run cannot continue it: choose another --out")
    drawn = drawn_on(manifest, frames, experiment)
    if drawn is not None:
        experiment = replace(experiment, notes=(*experiment.notes, said_of_drawn(manifest.name, drawn)))
    started, sinks = now(), tuple(sinks)
    compute_with(min(threads, MOST_THREADS))
    (configuration,) = experiment.configurations
    clip = LiveClip(Newest(source, stopped), source.rate_hz)
    job = ClipJob(
        manifest=manifest,
        frames=(),
        labels=None,
        configurations=(configuration.for_clip(manifest.name),),
        directory=directory,
        sinks=(*sinks, ResultsSinks(), _Arrivals(clip, stopped)),
        perceive_ahead=1 if threads > 1 else 0,
        keeps=True,
        drawn=drawn,
    )
    written, error = _follow(clip, job, limit=limit, progress=progress)
    if error is None and clip.damaged and not clip.frames:
        error = VfoaError(f"no frame can be read; the first: {clip.damaged[0]}")
    if error is not None and not written:
        shutil.rmtree(directory.path, ignore_errors=True)  # the directory was new
        raise error
    report = _report(clip)
    plan = Plan(experiment=experiment, clips=(_prepared(job, clip, written),), sinks=sinks)
    failure = None if error is None else directory.failure(job.pairs[0], error)
    _write(directory, plan, clip, report, {"run_id": job.run_id, **circumstances(plan, started)}, failure)
    if error is not None and failure is not None:
        raise VfoaError(directory.told(failure)) if "traceback" in failure else error
    return report


def _follow(
    clip: LiveClip,
    job: ClipJob,
    *,
    limit: int | None,
    progress: Callable[[str], None],
) -> tuple[int, VfoaError | None]:
    """Run each frame from the source through to the sinks; return the number of frames and the error that ended it."""
    with job.perception(clip) as perception:
        numbers = clip.numbers(lambda first: _rehearse(first, clip, perception, job), limit)
        frames = prefetch(perception.frames(numbers), job.perceive_ahead)
        (runner,) = attend_to(frames, job, clip.rate_hz, progress)
    return runner.written, runner.error


@dataclass(frozen=True, slots=True, eq=False)
class _Arrivals:
    """The last sink of a live run: it notes when a frame is done, and stops the source when the run ends."""

    clip: LiveClip
    stopped: Event

    def described(self) -> Mapping[str, Any]:
        """It writes nothing."""
        return {}

    def open(self, context: SinkContext) -> Self | None:
        """Return the sink itself; none for the frame of the rehearsal."""
        return None if context.rehearsal else self

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.stopped.set()  # a thread may be waiting for the next frame

    def write(self, frame: FinishedFrame) -> None:
        """Note the time at which a frame was done."""
        self.clip.done(frame.record.frame)


def _rehearse(number: int, clip: LiveClip, perception: Perception, job: ClipJob) -> None:
    """Run one frame through all steps and discard the output. Errors are ignored: the run itself will report them."""
    with TemporaryDirectory() as folder:
        job = replace(job, directory=RunDirectory(Path(folder)), keeps=False)
        attend_to(perception.frames([number]), job, clip.rate_hz, lambda clip: None, rehearsal=True)


def _prepared(job: ClipJob, clip: LiveClip, written: int) -> PreparedClip:
    frames = tuple(each.frame for each in clip.latencies[:written])
    return PreparedClip(manifest=job.manifest, clip=clip, frames=frames, labels=None, drawn=job.drawn)


def _write(
    directory: RunDirectory,
    plan: Plan,
    clip: LiveClip,
    report: LiveReport,
    circumstances: dict[str, Any],
    failure: dict[str, str] | None,
) -> None:
    """Write all files but the recordings."""
    finished = [pair for pair in plan.pairs if directory.is_finished(pair)]
    directory.join(finished)
    failed = [failure] if failure and not finished else []
    live = {"live": {**asdict(report), "ended_by": failure}, "failed": failed, "cache": []}
    directory.write_manifest({**describe(plan), **live, **circumstances})
    lines = ["frame,latency_ms,dropped_before", *map(_line, clip.latencies)]
    atomic_write(directory.path / "latency.csv", "\n".join(lines) + "\n")
    if finished and failure is None:
        directory.remove_partial()


def _line(one: Latency) -> str:
    return f"{one.frame},{one.latency_ms:.1f},{one.dropped_before}"


def _report(clip: LiveClip) -> LiveReport:
    latencies = sorted(one.latency_ms for one in clip.latencies)
    return LiveReport(
        frames=len(latencies),
        dropped=sum(one.dropped_before for one in clip.latencies),
        damaged=len(clip.damaged),
        latency_median_ms=statistics.median(latencies) if latencies else None,
        latency_p95_ms=latencies[int(0.95 * (len(latencies) - 1))] if latencies else None,
    )
