"""Frames per second of matching alone, and of the pipeline without and with the models, from images in memory."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from harness.bench.stereo import StereoQuality, quality
from harness.clips.manifest import ClipManifest
from harness.run.executors.contract import compute_with
from harness.run.experiment import load_experiment
from harness.stages.configuration import Configuration
from harness.stages.prefetch import prefetch
from harness.stages.slots import SLOTS
from vfoa.onnx import Provider
from vfoa.pipeline import Memory, Stages, attend, perceive, reconstruct
from vfoa.types import Disparity, Instances, Percepts, StereoFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """The name of a row and its content: a matcher under a preset, with the experiment's models or without any.

    ``changes`` are settings over those of the preset, as of ``vfoa run --set``.
    """

    what: str
    matcher: str
    preset: str
    has_models: bool = False
    changes: tuple[str, ...] = ()


BASELINE = "SGBM"
"""The row whose frames per second divide those of the others."""

_GUIDED = ("stereo.search=guided",)
ROWS = (
    Row(what="BM", matcher="bm", preset="none"),
    Row(what=BASELINE, matcher="sgbm", preset="none"),
    Row(what="SGBM, guided", matcher="sgbm", preset="none", changes=_GUIDED),
    Row(what="SGBM, guided, needed region", matcher="sgbm", preset="guided"),
    Row(what="SGBM, guided, needed region, with models", matcher="sgbm", preset="guided", has_models=True),
    Row(what="BM, realtime", matcher="bm", preset="realtime"),
    Row(what="SGBM, realtime", matcher="sgbm", preset="realtime"),
    Row(what="SGBM, realtime, with models", matcher="sgbm", preset="realtime", has_models=True),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Speed:
    """One row: milliseconds of a match (median, 95th percentile), and frames per second of the pipeline.

    ``cpu_ms`` is the CPU time of a frame of the pipeline, over all threads: it depends less on the load of the machine.
    ``stereo`` is the quality of the disparities, None if the clip has no true ones.
    """

    what: str
    match_ms: tuple[float, float]
    fps: float
    cpu_ms: float
    stereo: StereoQuality | None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Held:
    """Frames with their masks, and the true disparities if there are any, in memory."""

    frames: list[StereoFrame]
    instances: dict[int, Instances]
    truths: list[Disparity | None]

    def segment(self, frame: StereoFrame) -> Instances:
        """Return masks computed before, as a :class:`vfoa.segmentation.Segmenter`."""
        return self.instances[frame.index]


class _TimedMatcher:
    """Records the time and the output of each match."""

    def __init__(self, matcher: object) -> None:
        self._matcher = matcher
        self.milliseconds: list[float] = []
        self.found: list[Disparity] = []

    def match(self, *inputs: object) -> Disparity:
        """As :class:`vfoa.stereo.StereoMatcher`."""
        return self._timed("match", inputs)

    def match_region(self, *inputs: object) -> Disparity:
        """As :class:`vfoa.stereo.RegionMatcher`."""
        return self._timed("match_region", inputs)

    def _timed(self, method: str, inputs: tuple[object, ...]) -> Disparity:
        started = time.perf_counter()
        found: Disparity = getattr(self._matcher, method)(*inputs)
        self.milliseconds.append(1e3 * (time.perf_counter() - started))
        self.found.append(found)
        return found


def measure_speed(
    experiment: str,
    manifest: ClipManifest,
    frames: Sequence[int],
    threads: int,
    *,
    provider: Provider = "cpu",
    rounds: int = 3,
) -> list[Speed]:
    """Run the frames through matching, models, reconstruction and attention, with this many threads.

    The configuration is the first one of the ``experiment``, with the changes of each row. Images and masks are read
    before; the first frame is left out. All rows are measured in several rounds; each row's fastest round counts.
    """
    compute_with(threads)
    configurations = [_configuration(experiment, manifest.name, row).on(provider) for row in ROWS]
    held = _hold(manifest, configurations[0], frames)
    measured = [
        [_measure(row.what, manifest, each, held, threads) for row, each in zip(ROWS, configurations, strict=True)]
        for _ in range(rounds)
    ]
    return [max(same, key=lambda speed: speed.fps) for same in zip(*measured, strict=True)]


def _configuration(experiment: str, clip: str, row: Row) -> Configuration:
    overrides = (f"stereo.matcher={row.matcher}", *row.changes)
    first = load_experiment(experiment, clips=(clip,), overrides=overrides, preset=row.preset).configurations[0]
    if not row.has_models:
        heads = SLOTS["heads"].parse({"detector": "person_mask"}, "bench")
        first = replace(first, choices={**first.choices, "heads": heads, "head_pose": None, "gaze": None})
    return first.for_clip(clip)


def _hold(manifest: ClipManifest, configuration: Configuration, frames: Sequence[int]) -> _Held:
    clip = manifest.open_images()
    choice = configuration.choices["segmentation"]
    assert choice is not None
    segmenter = SLOTS["segmentation"].build(choice, clip)
    read = [clip.frame(number) for number in frames]
    masks = {frame.index: segmenter.segment(frame) for frame in read}
    return _Held(frames=read, instances=masks, truths=[clip.truth(number).disparity for number in frames])


def _measure(what: str, manifest: ClipManifest, configuration: Configuration, held: _Held, threads: int) -> Speed:
    clip = manifest.open_images()
    built: dict[str, Any] = {
        slot: SLOTS[slot].build(choice, clip) if choice and slot != "segmentation" else None
        for slot, choice in configuration.choices.items()
    }
    matcher = _TimedMatcher(built["stereo"])
    stages = Stages(
        matcher=matcher,
        segmenter=held,
        heads=built["heads"],
        head_pose=built["head_pose"],
        gaze=built["gaze"],
        region_matcher=matcher if configuration.is_in_region else None,
    )
    beside = ThreadPoolExecutor(1) if threads > 1 else None
    perceived = (perceive(frame, stages, beside=beside) for frame in held.frames)
    fps, cpu_ms = _follow(prefetch(perceived, 1 if threads > 1 else 0), configuration)
    ms = matcher.milliseconds[1:]
    pairs = [(found, true) for found, true in zip(matcher.found, held.truths, strict=True) if true is not None]
    return Speed(
        what=what,
        match_ms=(float(np.median(ms)), float(np.percentile(ms, 95))),
        fps=fps,
        cpu_ms=cpu_ms,
        stereo=quality(configuration.name, pairs) if pairs else None,
    )


def _follow(perceived: Generator[Percepts], configuration: Configuration) -> tuple[float, float]:
    """Frames per second, and CPU milliseconds per frame, from the end of the first frame to that of the last."""
    memory, ends = Memory(), []
    for percepts in perceived:
        scene = reconstruct(percepts, configuration.reconstruction)
        _, memory = attend(scene, memory, configuration.attend)
        ends.append((time.perf_counter(), time.process_time()))
    seconds, computing_s = np.subtract(ends[-1], ends[0])
    count = len(ends) - 1
    return float(count / seconds), float(1e3 * computing_s / count)
