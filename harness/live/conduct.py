"""A live run: one configuration on the newest frames of a source, recorded as any other run is."""

from __future__ import annotations

import shutil
import statistics
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Event

from harness.clips.manifest import ClipManifest
from harness.files import atomic_write
from harness.live import LiveSource
from harness.live.clip import Latency, LiveClip
from harness.live.newest import Newest
from harness.recording import Size
from harness.runs.ahead import ahead
from harness.runs.conduct import circumstances, now
from harness.runs.directory import RunDirectory
from harness.runs.executors import MOST_THREADS, compute_with
from harness.runs.experiment import Experiment
from harness.runs.lane import Lane
from harness.runs.plan import Plan, PreparedClip, describe
from harness.runs.run import ClipJob
from harness.runs.sharing import SharedPipeline
from harness.scores.measures import Measurer
from vfoa.errors import VfoaError


@dataclass(frozen=True, slots=True, kw_only=True)
class LiveReport:
    """How a live run went: frames done, dropped and damaged, and the milliseconds from a frame's arrival to its end."""

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


def conduct_live(
    source: LiveSource,
    manifest: ClipManifest,
    experiment: Experiment,
    directory: RunDirectory,
    *,
    stopped: Event,
    recording: Size | None = "light",
    watched_at: str | None = None,
    limit: int | None = None,
    threads: int = 1,
    progress: Callable[[str], None] = lambda clip: None,
) -> LiveReport:
    """Take frames until the source ends, ``stopped`` is set or ``limit`` is reached; all that was done is kept.

    Parameters
    ----------
    manifest
        What the source and the people and things in it are called.
    experiment
        Its only configuration is run.
    directory
        A new run's. It also gets ``latency.csv``: a line a frame, with how many were dropped before it.
    watched_at
        The address of a Rerun viewer that is shown each frame; None for none.
    threads
        With several, the next frame is perceived while the last one is attended to and recorded.

    Raises
    ------
    VfoaError
        If the source cannot be read, or a frame cannot be computed. What was done before is kept, as a finished run.
    """
    if not directory.is_new():
        raise VfoaError(
            f"{directory.path}: holds a run already; a live one cannot be gone on with: choose another --out"
        )
    started = now()
    compute_with(min(threads, MOST_THREADS))
    (configuration,) = experiment.configurations
    clip = LiveClip(Newest(source, stopped), source.rate_hz)
    job = ClipJob(
        manifest=manifest,
        frames=(),
        labels=None,
        configurations=(configuration.for_clip(manifest.name),),
        directory=directory,
        recording=recording,
        watched_at=watched_at,
    )
    written, error = _follow(clip, job, stopped, limit=limit, depth=1 if threads > 1 else 0, progress=progress)
    if error is None and clip.damaged and not clip.frames:
        error = VfoaError(f"no frame can be read; the first: {clip.damaged[0]}")
    if error is not None and not clip.frames:
        shutil.rmtree(directory.path, ignore_errors=True)  # it was new, and nothing came of it
        raise error
    report = _report(clip)
    plan = Plan(experiment=experiment, clips=(_prepared(manifest, clip, written),), recording=recording)
    failure = None if error is None else directory.failure(job.pairs[0], str(error))
    _write(directory, plan, clip, report, started, failure)
    if error is not None and failure is not None:
        raise VfoaError(directory.told(failure)) if "traceback" in failure else error
    return report


def _follow(
    clip: LiveClip,
    job: ClipJob,
    stopped: Event,
    *,
    limit: int | None,
    depth: int,
    progress: Callable[[str], None],
) -> tuple[int, VfoaError | None]:
    """Lead each frame that is taken from the source to the files; how many, and what ended that, if it was an error."""
    pipeline = SharedPipeline(job.configurations, clip)
    error: VfoaError | None = None
    with Lane(job, job.configurations[0], clip.rate_hz, Measurer(clip), keeps=True) as lane:
        numbers = clip.numbers(lambda first: _rehearse(first, clip, pipeline, job), limit)
        try:
            with closing(ahead(pipeline.frames(numbers), depth)) as frames, _ending(stopped):
                for shared in frames:
                    lane.take(shared)
                    if lane.error is not None:
                        break
                    clip.done(shared.frame.index)
                    progress(job.manifest.name)
        except VfoaError as broken:  # the source's: what it gave until then is worth keeping
            error = broken
    return lane.written, VfoaError(lane.error) if lane.error else error


@contextmanager
def _ending(stopped: Event) -> Iterator[None]:
    """Let the source end with the block, whatever ended that: a thread may be waiting for its next frame."""
    try:
        yield
    finally:
        stopped.set()


def _rehearse(number: int, clip: LiveClip, pipeline: SharedPipeline, job: ClipJob) -> None:
    """Lead a frame through everything once, and keep nothing of it. What fails will fail again, and be said then."""
    with TemporaryDirectory() as folder:
        job = replace(job, directory=RunDirectory(Path(folder)), watched_at=None)
        with Lane(job, job.configurations[0], None, Measurer(clip)) as lane, suppress(VfoaError):
            for shared in pipeline.frames([number]):
                lane.take(shared)


def _prepared(manifest: ClipManifest, clip: LiveClip, written: int) -> PreparedClip:
    frames = tuple(each.frame for each in clip.latencies[:written])
    return PreparedClip(manifest=manifest, clip=clip, frames=frames, labels=None)


def _write(
    directory: RunDirectory,
    plan: Plan,
    clip: LiveClip,
    report: LiveReport,
    started: str,
    failure: dict[str, str] | None,
) -> None:
    """Write all but the recording; a failure before anything was written is that of the whole run."""
    finished = [pair for pair in plan.pairs if directory.has_part(pair)]
    directory.join(finished)
    failed = [failure] if failure and not finished else []
    live = {"live": {**asdict(report), "ended_by": failure}, "failed": failed, "cache": []}
    directory.write_manifest({**describe(plan), **live, **circumstances(plan, started)})
    lines = ["frame,latency_ms,dropped_before", *map(_line, clip.latencies)]
    atomic_write(directory.path / "latency.csv", "\n".join(lines) + "\n")
    if finished and failure is None:
        directory.remove_parts()


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
