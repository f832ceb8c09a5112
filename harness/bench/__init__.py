"""The sections of ``vfoa bench`` by name: from a clip and its experiment to tables, each with a baseline of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from harness.clips.manifest import ClipManifest
from harness.report.formats import Table
from harness.run.experiment import Experiment

if TYPE_CHECKING:
    from vfoa.onnx import Provider


@dataclass(frozen=True, slots=True, kw_only=True)
class Bench:
    """An experiment by name, its configurations for the clip to measure, this clip, its frames, the networks' provider.

    ``overrides`` are changed settings, for a section that loads the experiment again.
    """

    name: str
    experiment: Experiment
    manifest: ClipManifest
    frames: tuple[int, ...]
    provider: Provider = "cpu"
    overrides: tuple[str, ...] = ()


def _stages(bench: Bench) -> list[Table]:
    from harness.bench.stages import measure_stages, stages_table
    from harness.run.plan import drawn_on

    drawn = drawn_on(bench.manifest, bench.manifest.open().frames, bench.experiment)
    costs = measure_stages(bench.manifest, bench.experiment.configurations, bench.frames, drawn)
    return [stages_table(bench.manifest.name, costs)]


def _stereo(bench: Bench) -> list[Table]:
    from harness.bench.stereo import measure_stereo, stereo_table

    clip = bench.manifest.open_images()
    is_known = clip.truth(bench.frames[0]).disparity is not None
    measured = measure_stereo(clip, bench.experiment.configurations, bench.frames) if is_known else []
    return [stereo_table(bench.manifest.name, measured)]


def _realtime(bench: Bench) -> list[Table]:
    from harness.bench.realtime import measure_speed, rows_at_hand, speed_table
    from harness.run.executors import cores

    threads = cores()
    rows, notes = rows_at_hand(bench.name, bench.manifest.name, bench.overrides)
    speeds = measure_speed(
        bench.name, bench.manifest, bench.frames, threads, rows=rows, provider=bench.provider, overrides=bench.overrides
    )
    return [speed_table(bench.manifest.name, threads, speeds, notes)]


def _gpu(bench: Bench) -> list[Table]:
    from harness.bench.gpu import gpu_table, measure_gpu

    return [gpu_table(bench.manifest.name, measure_gpu(bench.manifest, bench.experiment, bench.frames))]


def _attention(bench: Bench) -> list[Table]:
    from harness.bench.attention import SIZES, methods_table, scenes_of, seeded_scenes, time_methods
    from harness.run.plan import drawn_on

    drawn = drawn_on(bench.manifest, bench.manifest.open().frames, bench.experiment)
    seeded = {
        f"{boxes} boxes, {count} {'person' if count == 1 else 'people'}": seeded_scenes(boxes=boxes, subjects=count)
        for boxes, count in SIZES
    }
    material = {
        **seeded,
        bench.manifest.name: scenes_of(bench.manifest, bench.experiment.configurations[0], bench.frames, drawn),
    }
    return [methods_table(time_methods(material))]


SECTIONS: dict[str, Callable[[Bench], list[Table]]] = {
    "stages": _stages,
    "stereo": _stereo,
    "realtime": _realtime,
    "gpu": _gpu,
    "attention": _attention,
}
OF_IMAGES = ("stereo", "realtime", "gpu")
"""The sections that need a clip with images."""
