"""Frames per second of matching alone, and of the pipeline without and with the models, from images in memory."""

from __future__ import annotations

import time
from collections.abc import Generator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from harness.bench.stereo import OFF_PX, StereoQuality, quality
from harness.clips.manifest import ClipManifest
from harness.pipeline.configuration import STAGES, Configuration, StageChoice
from harness.pipeline.prefetch import prefetch
from harness.report.formats import UNKNOWN, Table
from harness.run.executors import compute_with
from harness.run.experiment import load_experiment
from vfoa.errors import VfoaError
from vfoa.following import Following
from vfoa.onnx import Provider
from vfoa.pipeline import Attending, Stages, perceive
from vfoa.types import Disparity, Float, Instances, Percepts, StereoFrame
from vfoa.weights import check_located, weights_of


@dataclass(frozen=True, slots=True, kw_only=True)
class SpeedRow:
    """The name of a row and its content: a matcher under a preset, with the default models of heads or without any.

    Masks are in memory.
    """

    what: str
    matcher: str
    preset: str
    has_models: bool = False


BASELINE = "SGBM"
"""The row whose frames per second divide those of the others."""

ROWS = (
    SpeedRow(what="BM", matcher="bm", preset="none"),
    SpeedRow(what=BASELINE, matcher="sgbm", preset="none"),
    SpeedRow(what="BM, realtime", matcher="bm", preset="realtime"),
    SpeedRow(what="SGBM, realtime", matcher="sgbm", preset="realtime"),
    SpeedRow(what="SGBM, realtime, with models", matcher="sgbm", preset="realtime", has_models=True),
)

_HEAD_SLOTS = ("heads", "head_pose", "gaze")


@dataclass(frozen=True, slots=True, kw_only=True)
class Speed:
    """One row: milliseconds of a match (median, 95th percentile).

    ``fps`` are the frames per second of the pipeline. ``cpu_ms`` is the CPU time of a frame, over all threads: it
    depends less on the load of the machine. ``stereo`` is the quality of the disparities, None if the clip has no true
    ones.
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
        disparity: Disparity = getattr(self._matcher, method)(*inputs)
        self.milliseconds.append(1e3 * (time.perf_counter() - started))
        self.found.append(disparity)
        return disparity


def measure_speed(
    experiment: str,
    manifest: ClipManifest,
    frames: Sequence[int],
    threads: int,
    *,
    rows: Sequence[SpeedRow] = ROWS,
    provider: Provider = "cpu",
    overrides: tuple[str, ...] = (),
    rounds: int = 3,
) -> list[Speed]:
    """Run the frames through matching, models, reconstruction and attention, with this many threads.

    The ``rows`` are those of :func:`rows_at_hand`. Their configuration is the first one of the ``experiment`` with its
    ``overrides`` (as of ``vfoa run --set``). Images and masks are read before; the first
    frame is left out. All rows are measured in several rounds; each row's fastest round counts.
    """
    compute_with(threads)
    configurations = [configuration_of(experiment, manifest.name, row, overrides).on(provider) for row in rows]
    held = _hold(manifest, configurations[0], frames)
    pairs = list(zip(rows, configurations, strict=True))
    by_round = [[_measure(row, manifest, chosen, held, threads) for row, chosen in pairs] for _ in range(rounds)]
    return [max(same, key=lambda speed: speed.fps) for same in zip(*by_round, strict=True)]


def rows_at_hand(experiment: str, clip: str, overrides: tuple[str, ...] = ()) -> tuple[list[SpeedRow], list[str]]:
    """The rows that can be measured, and a note: which models those with models have, or why they are left out."""
    with_models = next(row for row in ROWS if row.has_models)
    choices = configuration_of(experiment, clip, with_models, overrides).choices
    models = [choice for slot in _HEAD_SLOTS if (choice := choices[slot])]
    try:
        check_located(name for choice in models for name in weights_of(choice.settings))
    except VfoaError as error:
        return [row for row in ROWS if not row.has_models], [f"Rows with models are left out: {error}"]
    return [*ROWS], [f"Models: {', '.join(f'{choice.slot} {choice.name}' for choice in models)}."]


def configuration_of(experiment: str, clip: str, row: SpeedRow, given: tuple[str, ...]) -> Configuration:
    """The experiment's first configuration with the heads, poses and gazes of the default models, or of none.

    Its own may be the ground truth, whose rendering takes longer than any model.
    """
    overrides = (*given, f"stereo.matcher={row.matcher}")
    first = load_experiment(experiment, clips=(clip,), overrides=overrides, preset=row.preset).configurations[0]
    heads: dict[str, StageChoice | None]
    if row.has_models:
        (default,) = load_experiment("default", clips=(clip,), preset=row.preset).configurations
        heads = {slot: default.choices[slot] for slot in _HEAD_SLOTS}
    else:
        person_mask = STAGES["heads"].parse({"detector": "person_mask"}, "bench")
        heads = {**dict.fromkeys(_HEAD_SLOTS), "heads": person_mask}
    return replace(first, choices={**first.choices, **heads}).for_clip(clip)


def _hold(manifest: ClipManifest, configuration: Configuration, frames: Sequence[int]) -> _Held:
    clip = manifest.open_images()
    choice = configuration.choices["segmentation"]
    assert choice is not None
    segmenter = STAGES["segmentation"].build(choice, clip)
    read = [clip.frame(number) for number in frames]
    masks = {frame.index: segmenter.segment(frame) for frame in read}
    return _Held(frames=read, instances=masks, truths=[clip.truth(number).disparity for number in frames])


def _measure(row: SpeedRow, manifest: ClipManifest, configuration: Configuration, held: _Held, threads: int) -> Speed:
    clip = manifest.open_images()
    with ThreadPoolExecutor(1) as thread:
        built: dict[str, Any] = {
            slot: STAGES[slot].build(choice, clip) if choice and slot != "segmentation" else None
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
        perceived = (perceive(frame, stages, executor=thread if threads > 1 else None) for frame in held.frames)
        wall_s, cpu_s = _follow(prefetch(perceived, 1 if threads > 1 else 0), configuration)
    match_ms = matcher.milliseconds[1:]
    pairs = [(disparity, true) for disparity, true in zip(matcher.found, held.truths, strict=True) if true is not None]
    return Speed(
        what=row.what,
        match_ms=(float(np.median(match_ms)), float(np.percentile(match_ms, 95))),
        fps=float((len(wall_s) - 1) / np.ptp(wall_s)),
        cpu_ms=float(1e3 * np.ptp(cpu_s) / (len(cpu_s) - 1)),
        stereo=quality(configuration.name, pairs) if pairs else None,
    )


def _follow(perceived: Generator[Percepts], configuration: Configuration) -> Float:
    """The time and the CPU time at the end of each frame, seconds (2, n)."""
    following = Following(configuration.reconstruction, configuration.attend.tracking)
    attending, ends = Attending(configuration.attend), []
    for found in perceived:
        _, scene, tracked = following.step(found)
        attending.step(scene, tracked)
        ends.append((time.perf_counter(), time.process_time()))
    return np.transpose(ends)


def speed_table(clip: str, threads: int, rows: Sequence[Speed], notes: Sequence[str]) -> Table:
    """Matching alone, and the pipeline."""
    baseline = next(row for row in rows if row.what == BASELINE)
    return Table.of(
        f"Frames a second on {clip}, one process with {threads} threads",
        "configuration | match ms | frames/s | ratio | CPU ms | known | error px | off",
        (
            (
                *(row.what, "{:.1f} / {:.1f}".format(*row.match_ms), f"{row.fps:.1f}"),
                *(f"{row.fps / baseline.fps:.2f}", f"{row.cpu_ms:.0f}"),
                *_quality(row.stereo),
            )
            for row in rows
        ),
        words=1,
        notes=(
            "From images and masks in memory to attention: frames/s of the whole pipeline, and CPU ms a frame over all "
            f"threads. Ratio: frames/s over those of {BASELINE}. Rows without models have no head detector, head pose "
            "and gaze. All rows are measured in turn, three times; the best of three counts.",
            "Known: share of the pixels of the image with a true disparity that got one. Errors are over the known "
            f"pixels: the median, and the share of those that are off by more than {OFF_PX:g} px.",
            *notes,
        ),
    )


def _quality(quality: StereoQuality | None) -> tuple[str, str, str]:
    if quality is None:
        return UNKNOWN, UNKNOWN, UNKNOWN
    return f"{quality.known_share:.1%}", f"{quality.median_error_px:.3f}", f"{quality.off_share:.1%}"
