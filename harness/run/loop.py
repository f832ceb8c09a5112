"""The only loop over frames: read, perceive, reconstruct, attend for each configuration, hand to the sinks.

Batch runs and live runs use it; they differ in where frame numbers come from and in their sinks. Each frame
is read once and each distinct stage runs once. A configuration that fails is dropped, and the others continue.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Iterable, Mapping, Sequence
from contextlib import ExitStack, closing

from harness.run import checkpoint
from harness.run.checkpoint import Checkpoint
from harness.run.clip_job import ClipJob, ClipOutcome, checkpoints, first_frame
from harness.run.configuration_runner import ConfigurationRunner
from harness.run.executors.contract import Progress
from harness.sources import Clip, MeasuredClip
from harness.stages.measured import measured_frames
from harness.stages.measures import Measurer
from harness.stages.prefetch import one_at_a_time, prefetch
from harness.stages.sharing import SharedFrame, SharedPipeline, UnreadableFrameError, read_frames
from vfoa.errors import VfoaError

_NEXT, _NAMED = 1000, 10
"""After a frame that cannot be read, how many are tried, and how many of those that cannot be read are named."""


def run_clip(job: ClipJob, progress: Progress, numbers: Iterable[int] | None = None) -> ClipOutcome:
    """Run one clip under all configurations of a job, each from its checkpoint if it has one.

    ``progress`` is called with the name of the clip after each frame. ``numbers`` yields the frames of the job, each as
    soon as it may be read; default: the job's own frames.
    """
    try:
        clip = job.manifest.open()
        unchanged = job.unchanged(clip)
    except VfoaError as error:
        return ClipOutcome(failures=dict.fromkeys(job.pairs, error))
    resumed = checkpoints(job)
    first = first_frame(job, resumed)
    for _ in range(sum(number < first for number in job.frames)):
        progress(job.manifest.name)
    chosen = (number for number in (job.frames if numbers is None else numbers) if number >= first)
    if isinstance(clip, MeasuredClip):
        scenes = measured_frames(job.configurations, clip, chosen)
        return job.outcome(each.error for each in attend_to(scenes, job, clip.rate_hz, progress, resumed=resumed))
    images, truth = one_at_a_time(clip, 2) if job.read_ahead or job.perceive_ahead else (clip, clip)
    shared = closing(
        SharedPipeline(
            job.configurations,
            images,
            job.cache,
            drawn=job.drawn,
            parallel=job.perceive_ahead > 0,
            begins={name: each.frame + 1 for name, each in resumed.items()},
            starts={name: each.window for name, each in resumed.items() if each.window},
        )
    )
    with unchanged(), shared as pipeline:
        scenes = reconstructed(images, pipeline, chosen, job)
        measurer = Measurer(truth) if job.measured else None
        runners = attend_to(scenes, job, images.rate_hz, progress, measurer=measurer, resumed=resumed)
    if job.cache:
        job.cache.store.trim()
    return job.outcome(_with_others([each.error for each in runners], clip, job.frames), pipeline.take_tallies())


def _with_others(errors: Sequence[VfoaError | None], clip: Clip, numbers: Sequence[int]) -> list[VfoaError | None]:
    """Add to the error of a frame that cannot be read which of the next frames cannot be read either."""
    first = next((each for each in errors if isinstance(each, UnreadableFrameError)), None)
    if first is None:
        return list(errors)
    next_ones = [number for number in numbers if number > first.frame][:_NEXT]
    others = [number for number in next_ones if not _is_readable(clip, number)]
    if others:
        named = ", ".join(map(str, others[:_NAMED])) + (" ..." if len(others) > _NAMED else "")
        found = f"{len(others)} of the next {len(next_ones)} frames cannot be read either: {named}"
    else:
        found = f"the next {len(next_ones)} frames can be read"
    said = VfoaError(f"{first}; {found}")
    return [said if each is first else each for each in errors]


def _is_readable(clip: Clip, number: int) -> bool:
    try:
        clip.frame(number)
    except VfoaError:
        return False
    return True


def reconstructed(clip: Clip, pipeline: SharedPipeline, numbers: Iterable[int], job: ClipJob) -> Generator[SharedFrame]:
    """Read, perceive and reconstruct frames, in threads that run ahead by as many frames as the job says."""
    read = prefetch(read_frames(clip, numbers), job.read_ahead)
    perceived = pipeline.perceive(read)
    return prefetch(pipeline.reconstruct(perceived), job.perceive_ahead)


def attend_to(
    frames: Generator[SharedFrame],
    job: ClipJob,
    rate_hz: float | None,
    progress: Progress,
    *,
    measurer: Measurer | None = None,
    rehearsal: bool = False,
    resumed: Mapping[str, Checkpoint] | None = None,
) -> list[ConfigurationRunner]:
    """Attend to frames and hand them to the sinks, until they end or every configuration has failed.

    Checkpoints are written from time to time, unless the source cannot be read again. ``resumed`` holds the states that
    configurations continue from, by name. Returns one runner per configuration of the job, in order, each finished,
    with its error.
    """
    begun = resumed or {}
    runners = [
        ConfigurationRunner(job, each, rate_hz, measurer, rehearsal=rehearsal, resumed=begun.get(each.name))
        for each in job.configurations
    ]
    began_s = written_s = time.monotonic()
    with closing(frames), ExitStack() as sinks:
        for runner in runners:
            sinks.enter_context(runner)
        try:
            while any(each.error is None for each in runners) and (frame := next(frames, None)):
                for runner in runners:
                    for finished in runner.attend(frame):
                        runner.hand_over(finished)
                if not job.keeps and time.monotonic() - written_s >= checkpoint.pause_s(written_s - began_s):
                    written = [runner.checkpoint() for runner in runners]
                    written_s = time.monotonic() if any(written) else written_s
                progress(job.manifest.name)
        except VfoaError as error:  # a frame that cannot be read
            for runner in runners:
                runner.fail(error)
    return runners
