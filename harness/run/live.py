"""A live run: one configuration on the newest frames of a source, recorded like any other run.

Frames that arrive while one is processed are dropped and counted.
"""

from __future__ import annotations

import hashlib
import shutil
import statistics
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Condition, Event, Thread
from typing import Any, Self

from harness.clips.manifest import ClipManifest
from harness.files.io import atomic_write
from harness.run.clip_job import ClipJob
from harness.run.directory import RunDirectory
from harness.run.executors import MOST_THREADS, compute_with
from harness.run.experiment import Experiment
from harness.run.frame_sink import FinishedFrame, SinkContext, SinkFactory
from harness.run.loop import attend_to
from harness.run.plan import Plan, PreparedClip, describe, drawn_on, note_on_drawn
from harness.run.resume import ResultsSinks
from harness.run.runner import circumstances, now
from harness.sources import Truth
from harness.sources.live import Arrival, LiveSource
from harness.stages.perception import Perception, prefetch
from vfoa.errors import VfoaError
from vfoa.types import StereoFrame


class Newest:
    """Reads a source in a thread and gives the caller the newest frame; earlier ones are dropped and counted."""

    def __init__(self, source: LiveSource, stopped: Event) -> None:
        self._source = source
        self._dropped = 0
        self._changed = Condition()
        self._waiting: Arrival | None = None
        self._ended = False
        self._error: BaseException | None = None
        self._thread = Thread(target=self._read, args=(stopped,), daemon=True)

    def __iter__(self) -> Iterator[tuple[Arrival, int]]:
        """Yield the newest frame each time one is requested, and the number of frames dropped since the one before.

        Ends when the source ends, and raises its error.
        """
        self._thread.start()
        while (taken := self._take()) is not None:
            yield taken
        self._thread.join()
        if self._error is not None:
            raise self._error

    def begin(self) -> None:
        """Begin to count dropped frames."""
        with self._changed:
            self._dropped = 0
        self._source.begin()

    def _take(self) -> tuple[Arrival, int] | None:
        with self._changed:
            self._changed.wait_for(lambda: self._waiting is not None or self._ended)
            arrival, dropped = self._waiting, self._dropped
            self._waiting, self._dropped = None, 0
            return None if arrival is None else (arrival, dropped)

    def _read(self, stopped: Event) -> None:
        try:
            for arrival in self._source.arrivals(stopped):
                with self._changed:
                    self._dropped += self._waiting is not None
                    self._waiting = arrival
                    self._changed.notify()
        except BaseException as error:  # the thread that waits for a frame must know
            self._error = error
        with self._changed:
            self._ended = True
            self._changed.notify()


@dataclass(frozen=True, slots=True, kw_only=True)
class Latency:
    """Latency of one frame: milliseconds from its arrival to the end of all processing, and the frames that it cost.

    ``dropped_before`` counts the frames that arrived and were dropped since the one before.
    """

    frame: int
    latency_ms: float
    dropped_before: int


class LiveClip:
    """A live source as the pipeline reads it (:class:`harness.sources.Clip`, but only in the order of the source).

    :meth:`numbers` waits for the newest frame, which can be read until the next one is requested. A damaged frame is
    skipped and counted.
    """

    def __init__(self, newest: Newest, rate_hz: float | None) -> None:
        self.rate_hz = rate_hz
        self.latencies: list[Latency] = []
        self.damaged: list[str] = []
        self.notes: tuple[str, ...] = ()
        self._newest = newest
        self._frames: dict[int, StereoFrame] = {}
        self._underway: dict[int, tuple[Arrival, int]] = {}
        self._times_ns: dict[int, int] = {}

    @property
    def frames(self) -> tuple[int, ...]:
        """Numbers of the frames taken so far."""
        return tuple(self._times_ns)

    def numbers(self, rehearse: Callable[[int], None], limit: int | None = None) -> Generator[int]:
        """Yield the number of each frame that is taken, when it has arrived; at most ``limit`` of them.

        ``rehearse`` is called with the first one: things loaded at first use take seconds, and the frames that arrive
        meanwhile do not count as dropped. The first frame is taken again only if no other arrives.
        """
        first: Arrival | None = None
        for arrival, dropped in self._newest:
            is_whole = self._read(arrival)
            if first is None:
                first = arrival
                if is_whole:
                    rehearse(arrival.number)
                self._newest.begin()
            elif is_whole:
                yield self._take(arrival, dropped)
                if limit is not None and len(self._times_ns) >= limit:
                    return
        if first is not None and not self._times_ns and first.number in self._frames:
            yield self._take(first, 0)

    def _read(self, arrival: Arrival) -> bool:
        """Decode a frame; return False if it is damaged."""
        try:
            self._frames = {arrival.number: arrival.read()}
        except VfoaError as error:
            self.damaged.append(str(error))
            return False
        return True

    def _take(self, arrival: Arrival, dropped: int) -> int:
        self._times_ns[arrival.number] = arrival.time_ns
        self._underway[arrival.number] = arrival, dropped
        return arrival.number

    def done(self, number: int) -> None:
        """Note the time at which a frame was done."""
        arrival, dropped = self._underway.pop(number)
        latency_ms = 1e3 * (time.monotonic() - arrival.arrived_s)
        self.latencies.append(Latency(frame=number, latency_ms=latency_ms, dropped_before=dropped))

    def time_ns(self, number: int) -> int:
        """Time of a frame, as given by the source."""
        return self._times_ns[number]

    def frame(self, number: int) -> StereoFrame:
        """Return the frame that was taken last."""
        return self._frames[number]

    def truth(self, number: int) -> Truth:
        """A live source has no ground truth."""
        return Truth()

    def digest(self) -> str:
        """Digest of the frames' numbers and times: the frames themselves are gone."""
        return hashlib.sha256(repr(list(self._times_ns.items())).encode()).hexdigest()


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
        experiment = replace(experiment, notes=(*experiment.notes, note_on_drawn(manifest.name, drawn)))
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
