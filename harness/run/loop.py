"""The only loop over frames: read, perceive, reconstruct, attend for each configuration, hand to the sinks.

Batch runs, live runs and sweeps all use it; they differ in where frame numbers come from and in their sinks. Each frame
is read once and each distinct stage runs once. A configuration that fails is dropped, and the others continue.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import ExitStack, closing

from harness.run import checkpoint
from harness.run.checkpoint import Checkpoint, read_checkpoint
from harness.run.clip_job import ClipJob, ClipOutcome
from harness.run.configuration_runner import ConfigurationRunner
from harness.run.directory import Pair
from harness.run.executors.contract import Progress
from harness.sources import Clip, MeasuredClip
from harness.stages.measured import measured_frames
from harness.stages.measures import Measurer
from harness.stages.prefetch import one_at_a_time, prefetch
from harness.stages.sharing import SharedFrame, SharedPipeline, read_frames
from vfoa.errors import VfoaError


def run_clip(job: ClipJob, progress: Progress, numbers: Iterable[int] | None = None) -> ClipOutcome:
    """Run one clip under all configurations of a job, from their checkpoints where there are any.

    Parameters
    ----------
    progress
        Called with the name of the clip after each frame.
    numbers
        The frames of the job, each as soon as it may be read; those of the job if not given.
    """
    try:
        clip = job.manifest.open()
    except VfoaError as error:
        return ClipOutcome(failures=dict.fromkeys(job.pairs, error))
    resumed = checkpoints(job)
    first = first_frame(job, resumed)
    for _ in range(sum(number < first for number in job.frames)):
        progress(job.manifest.name)
    chosen = (number for number in (job.frames if numbers is None else numbers) if number >= first)
    if isinstance(clip, MeasuredClip):
        frames = measured_frames(job.configurations, clip, chosen)
        runners = lead(job, clip.rate_hz, frames, None, progress, resumed=resumed)
        return ClipOutcome(failures=_failures(job, runners))
    perceived, measured = one_at_a_time(clip, 2) if job.read_ahead or job.perceive_ahead else (clip, clip)
    with closing(
        SharedPipeline(
            job.configurations,
            perceived,
            job.cache,
            drawn=job.drawn,
            parallel=job.perceive_ahead > 0,
            begins={name: each.frame + 1 for name, each in resumed.items()},
            starts={name: each.window for name, each in resumed.items() if each.window},
        )
    ) as pipeline:
        runners = process(job, perceived, pipeline, chosen, progress, truth=measured, resumed=resumed)
    if job.cache:
        job.cache.store.trim()
    return ClipOutcome(failures=_failures(job, runners), tallies=pipeline.take_tallies())


def checkpoints(job: ClipJob, tell: Callable[[str], None] = lambda line: None) -> dict[str, Checkpoint]:
    """Where the configurations of a job stand, by name: those with a checkpoint that fits. ``tell`` is told of each."""
    frames = frozenset(job.frames)
    found: dict[str, Checkpoint] = {}
    for clip, name in job.pairs:
        read, misfit = read_checkpoint(job.directory, (clip, name), frames, job.sink_names)
        if read is not None:
            found[name] = read
            tell(f"{clip} under {name}: goes on after frame {read.frame}")
        elif misfit is not None:
            tell(f"{clip} under {name}: its checkpoint does not fit ({misfit}); it begins with the first frame")
    return found


def first_frame(job: ClipJob, resumed: Mapping[str, Checkpoint]) -> int:
    """The first frame that a job must read: that of the configuration that is least far."""
    begin = min(job.frames, default=0)
    return min(resumed[each.name].first_read if each.name in resumed else begin for each in job.configurations)


def process(
    job: ClipJob,
    clip: Clip,
    pipeline: SharedPipeline,
    numbers: Iterable[int],
    progress: Progress,
    *,
    truth: Clip | None = None,
    rehearsal: bool = False,
    resumed: Mapping[str, Checkpoint] | None = None,
) -> list[ConfigurationRunner]:
    """Lead frames through the pipeline to the sinks, until they end or every configuration has failed.

    Parameters
    ----------
    truth
        The clip to measure against, if another thread reads ``clip``.
    resumed
        Where configurations go on, by name.

    Returns
    -------
    list
        One runner per configuration of the job, in order, each finished, with its error.
    """
    read = prefetch(read_frames(clip, numbers), job.read_ahead)
    perceived = pipeline.perceive(read)
    reconstructed = prefetch(pipeline.reconstruct(perceived), job.perceive_ahead)
    measurer = Measurer(truth or clip) if job.measured else None
    return lead(job, clip.rate_hz, reconstructed, measurer, progress, rehearsal=rehearsal, resumed=resumed)


def lead(
    job: ClipJob,
    rate_hz: float | None,
    frames: Generator[SharedFrame],
    measurer: Measurer | None,
    progress: Progress,
    *,
    rehearsal: bool = False,
    resumed: Mapping[str, Checkpoint] | None = None,
) -> list[ConfigurationRunner]:
    """Attend to frames and hand them to the sinks, until they end or every configuration has failed.

    Checkpoints are written from time to time, unless the frames do not come again.
    """
    begun = resumed or {}
    runners = [
        ConfigurationRunner(job, each, rate_hz, measurer, rehearsal=rehearsal, resumed=begun.get(each.name))
        for each in job.configurations
    ]
    written_s = time.monotonic()
    with closing(frames), ExitStack() as sinks:
        for runner in runners:
            sinks.enter_context(runner)
        try:
            while any(each.error is None for each in runners) and (shared := next(frames, None)):
                for runner in runners:
                    for finished in runner.attend(shared):
                        runner.hand_over(finished)
                due = not job.keeps and time.monotonic() - written_s >= checkpoint.SECONDS
                if due and _checkpoint(runners):
                    written_s = time.monotonic()
                progress(job.manifest.name)
        except VfoaError as error:  # a frame that cannot be read
            for runner in runners:
                runner.fail(error)
    return runners


def _checkpoint(runners: list[ConfigurationRunner]) -> bool:
    """Write the checkpoint of each configuration; whether there is one now."""
    written = [runner.checkpoint() for runner in runners]
    return any(written)


def _failures(job: ClipJob, runners: list[ConfigurationRunner]) -> dict[Pair, VfoaError]:
    return {pair: each.error for pair, each in zip(job.pairs, runners, strict=True) if each.error is not None}
