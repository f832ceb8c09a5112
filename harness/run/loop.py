"""The only loop over frames: read, perceive, reconstruct, attend for each configuration, hand to the sinks.

Batch runs, live runs and sweeps all use it; they differ in where frame numbers come from and in their sinks. Each frame
is read once and each distinct stage runs once. A configuration that fails is dropped, and the others continue.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable
from contextlib import ExitStack, closing

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
    """Run one clip under all configurations of a job.

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
    chosen = job.frames if numbers is None else numbers
    if isinstance(clip, MeasuredClip):
        runners = lead(job, clip.rate_hz, measured_frames(job.configurations, clip, chosen), None, progress)
        return ClipOutcome(failures=_failures(job, runners))
    perceived, measured = one_at_a_time(clip, 2) if job.read_ahead or job.perceive_ahead else (clip, clip)
    with closing(SharedPipeline(job.configurations, perceived, job.cache, parallel=job.perceive_ahead > 0)) as pipeline:
        runners = process(job, perceived, pipeline, chosen, progress, truth=measured)
    if job.cache:
        job.cache.store.trim()
    return ClipOutcome(failures=_failures(job, runners), tallies=pipeline.take_tallies())


def process(
    job: ClipJob,
    clip: Clip,
    pipeline: SharedPipeline,
    numbers: Iterable[int],
    progress: Progress,
    *,
    truth: Clip | None = None,
    rehearsal: bool = False,
) -> list[ConfigurationRunner]:
    """Lead frames through the pipeline to the sinks, until they end or every configuration has failed.

    Parameters
    ----------
    truth
        The clip to measure against, if another thread reads ``clip``.

    Returns
    -------
    list
        One runner per configuration of the job, in order, each finished, with its error.
    """
    read = prefetch(read_frames(clip, numbers), job.read_ahead)
    perceived = pipeline.perceive(read)
    reconstructed = prefetch(pipeline.reconstruct(perceived), job.perceive_ahead)
    measurer = Measurer(truth or clip) if job.measured else None
    return lead(job, clip.rate_hz, reconstructed, measurer, progress, rehearsal=rehearsal)


def lead(
    job: ClipJob,
    rate_hz: float | None,
    frames: Generator[SharedFrame],
    measurer: Measurer | None,
    progress: Progress,
    *,
    rehearsal: bool = False,
) -> list[ConfigurationRunner]:
    """Attend to frames and hand them to the sinks, until they end or every configuration has failed."""
    runners = [
        ConfigurationRunner(job, configuration, rate_hz, measurer, rehearsal=rehearsal)
        for configuration in job.configurations
    ]
    with closing(frames), ExitStack() as sinks:
        for runner in runners:
            sinks.enter_context(runner)
        try:
            while any(each.error is None for each in runners) and (shared := next(frames, None)):
                for runner in runners:
                    for finished in runner.attend(shared):
                        runner.hand_over(finished)
                progress(job.manifest.name)
        except VfoaError as error:  # a frame that cannot be read
            for runner in runners:
                runner.fail(error)
    return runners


def _failures(job: ClipJob, runners: list[ConfigurationRunner]) -> dict[Pair, VfoaError]:
    return {pair: each.error for pair, each in zip(job.pairs, runners, strict=True) if each.error is not None}
