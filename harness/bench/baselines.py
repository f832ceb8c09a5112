"""Reconstruction and recording compared with a naive first version, on the same frames in the same run."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.bench.naive import NaiveRecording, naive_clouds
from harness.clips.manifest import ClipManifest
from harness.clips.naming import SubjectNames, name_frame
from harness.record.layers import ClipFiles, layer_names
from harness.record.recorder import Recorder
from harness.run.executors.contract import compute_with
from harness.run.frame_sink import FinishedFrame
from harness.run.records import to_record
from harness.stages.configuration import Configuration
from harness.stages.sharing import SharedPipeline
from vfoa.errors import VfoaError
from vfoa.pipeline import Memory, attend
from vfoa.reconstruction import place_targets


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """One row: milliseconds per frame (medians) of both versions, and the bytes per frame if they write any."""

    what: str
    ours_ms: float
    naive_ms: float
    ours_bytes: float | None = None
    naive_bytes: float | None = None


def compare_with_naive(manifest: ClipManifest, configuration: Configuration, frames: Sequence[int]) -> list[Comparison]:
    """Run both versions on each frame, one right after the other, with one thread; the first frame is left out."""
    compute_with(1)
    configuration = configuration.for_clip(manifest.name)
    clouds: list[tuple[float, float]] = []
    logs: list[tuple[float, float]] = []
    with tempfile.TemporaryDirectory() as folder:
        naive = Path(folder) / "naive.rrd"
        files = ClipFiles(run=Path(folder), clip=manifest.name)
        layers = layer_names({configuration.name: configuration.plain()})[configuration.name]
        naive_recording = NaiveRecording(naive)
        subjects, targets = tuple(manifest.subjects), tuple(manifest.targets)
        with Recorder(files, layers, rate_hz=None, subjects=subjects, targets=targets) as recorder:
            for each in _frames(manifest, configuration, frames):
                clouds.append(_reconstruct(each, configuration))
                logs.append(_record(each, recorder, naive_recording))
        naive_recording.close()
        written = sum(path.stat().st_size for path in files.of(layers))
        sizes = [size / len(frames) for size in (written, naive.stat().st_size)]
    return [_row("clouds and boxes of all things", clouds), _row("recording, light", logs, sizes)]


def _frames(manifest: ClipManifest, configuration: Configuration, frames: Sequence[int]) -> Iterator[FinishedFrame]:
    memory, names = Memory(), SubjectNames()
    for shared in SharedPipeline([configuration], manifest.open_images()).frames(frames):
        found = shared.by_configuration[configuration.name]
        if isinstance(found, VfoaError):
            raise found
        percepts, scene, timings = found
        result, memory = attend(scene, memory, configuration.attend)
        named, names = name_frame(result, manifest.subjects, manifest.targets, names)
        record = to_record(manifest.name, configuration.name, result, named, None)
        yield FinishedFrame(frame=shared.frame, percepts=percepts, result=result, record=record, timings=timings)


def _reconstruct(each: FinishedFrame, configuration: Configuration) -> tuple[float, float]:
    percepts = each.percepts
    assert percepts is not None, "the clip was opened for its images"
    seen = (percepts.disparity, percepts.instances, percepts.rig)
    started = time.perf_counter()
    place_targets(*seen, configuration.reconstruction)
    between = time.perf_counter()
    naive_clouds(*seen)
    return between - started, time.perf_counter() - between


def _record(each: FinishedFrame, recorder: Recorder, naive: NaiveRecording) -> tuple[float, float]:
    started = time.perf_counter()
    recorder.write(each)
    between = time.perf_counter()
    assert each.frame is not None, "the clip was opened for its images"
    assert each.percepts is not None, "the clip was opened for its images"
    naive.log(each.frame, each.percepts, each.result)
    return between - started, time.perf_counter() - between


def _row(what: str, seconds: Sequence[tuple[float, float]], sizes: Sequence[float] = ()) -> Comparison:
    ours_ms, naive_ms = 1e3 * np.median(seconds[1:], axis=0)
    ours_bytes, naive_bytes = sizes or (None, None)
    return Comparison(
        what=what, ours_ms=float(ours_ms), naive_ms=float(naive_ms), ours_bytes=ours_bytes, naive_bytes=naive_bytes
    )
