"""The cost of recordings: bytes a frame of each clip of an experiment, and bytes and time of one long clip.

Whole runs of a longer rendering of ``studio_talk``, one after the other in one process without a cache. Its frames are
rendered and stored before the first run. Compare ratios, not seconds, which depend on the machine.
"""

from __future__ import annotations

import argparse
import re
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.clips.manifest import load_manifest
from harness.files.folders import find
from harness.labels.files import write_annotations
from harness.labels.labels import IGNORED, Label, LabelRange, Labels
from harness.report.formats import Table
from harness.report.sinks import recordings
from harness.report.write import rescore
from harness.run.experiment import Experiment, load_experiment
from harness.run.runner import prepare, run_plan
from harness.run.timings import read_timings
from harness.studio.scenario import SCENARIOS
from harness.studio.stage import Stage
from scripts.measure.printing import print_tables

_KINDS = ("none", "light")
_SEED = 7


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedRun:
    """A run with one kind of recordings: its seconds, those of recording and scoring, and the bytes of its files."""

    kind: str
    frames: int
    seconds: float
    recording_s: float
    scoring_s: float
    bytes_by_layer: dict[str, int]

    @property
    def total(self) -> int:
        """All bytes of the recordings."""
        return sum(self.bytes_by_layer.values())


def measure_clips(experiment: Experiment) -> dict[str, dict[str, float]]:
    """Run and score an experiment with light recordings; return the bytes a frame of each clip by layer."""
    with tempfile.TemporaryDirectory() as folder:
        plan = prepare(experiment, sinks=(recordings(experiment.configurations),))
        directory = run_plan(plan, Path(folder), workers=1, progress=lambda clip: None)
        rescore(directory)
        return {
            clip.manifest.name: {
                layer: size / len(clip.frames)
                for layer, size in _bytes_by_layer(Path(folder), clip.manifest.name).items()
            }
            for clip in plan.clips
        }


def _bytes_by_layer(run: Path, clip: str) -> dict[str, int]:
    by_layer = dict.fromkeys(_LAYERS, 0)
    for file in (run / f"{clip}.rrd", *run.glob(f"{clip}__*.rrd")):
        layer = ".".join(file.name.split(".")[1:-1]) or ("attention" if "__" in file.name else "images")
        by_layer[layer] += file.stat().st_size
    return by_layer


def clips_table(clips: Mapping[str, Mapping[str, float]]) -> Table:
    """One row per clip: kilobytes a frame under all configurations."""
    return Table(
        title="Light recordings of each clip under all configurations, kB a frame",
        columns=("clip", *_LAYERS, "all"),
        words=1,
        rows=tuple(
            (clip, *(f"{sizes[layer] / 1e3:.1f}" for layer in _LAYERS), f"{sum(sizes.values()) / 1e3:.1f}")
            for clip, sizes in clips.items()
        ),
    )


def measure_recordings(frames: int) -> list[RecordedRun]:
    """Run the first ``frames`` of ``studio_talk`` without recordings, and with light ones."""
    with tempfile.TemporaryDirectory() as folder:
        experiment = _write_clip(Path(folder), frames)
        clip = load_manifest(experiment.clips[0]).open_images()
        for number in clip.frames:
            clip.frame(number)
        return [_run(experiment, Path(folder) / kind, kind, frames) for kind in _KINDS]


def _write_clip(root: Path, frames: int) -> Experiment:
    """The experiment ``demo`` on a longer ``studio_talk``, labelled by its script."""
    manifest = find("datasets", "studio_talk")
    assert manifest is not None
    text = manifest.read_text(encoding="utf-8")
    place = root / "datasets" / "studio_talk.toml"
    place.parent.mkdir()
    place.write_text(re.sub(r"(?m)^frames = \d+$", f"frames = {frames}", text), encoding="utf-8")
    stage = Stage(SCENARIOS["talk"], frames, _SEED)
    rows = [
        LabelRange(
            first_frame=frame, last_frame=frame, subject=person.name, label=Label(target=person.target or IGNORED)
        )
        for frame in range(1, frames + 1)
        for person in stage.people(frame - 1)
    ]
    (root / "annotations").mkdir()
    write_annotations(root / "annotations" / "studio_talk.csv", Labels(rows))
    return load_experiment("demo", clips=(str(place),))


def _run(experiment: Experiment, out: Path, kind: str, frames: int) -> RecordedRun:
    started = time.perf_counter()
    sinks = () if kind == "none" else (recordings(experiment.configurations),)
    directory = run_plan(prepare(experiment, sinks=sinks), out, workers=1, progress=lambda clip: None)
    ran = time.perf_counter()
    rescore(directory)
    times = read_timings(directory).to_pandas()
    recording_ms = float(times.loc[times["stage"].isin(("recording", "answers")), "ms"].sum())
    return RecordedRun(
        kind=kind,
        frames=frames,
        seconds=ran - started,
        recording_s=recording_ms / 1e3,
        scoring_s=time.perf_counter() - ran,
        bytes_by_layer=_bytes_by_layer(out, "studio_talk") if sinks else {},
    )


def recordings_table(runs: Sequence[RecordedRun]) -> Table:
    """One row per kind of recordings: megabytes by layer, and times as ratios to the run without any."""
    bare = runs[0]
    return Table(
        title=f"Recordings of studio_talk, {bare.frames} frames, BM and SGBM with one and two cones",
        columns=("recording", *(f"{layer} MB" for layer in _LAYERS), "all MB", "time", "recording s", "scoring s"),
        words=1,
        rows=tuple(
            (
                run.kind,
                *(f"{run.bytes_by_layer.get(layer, 0) / 1e6:.1f}" for layer in _LAYERS),
                f"{run.total / 1e6:.1f}",
                f"{run.seconds / bare.seconds:.2f}",
                f"{run.recording_s:.1f}",
                f"{run.scoring_s:.1f}",
            )
            for run in runs
        ),
        notes=(
            "Time: of the whole run over that without recordings, in one process without a cache. The images were "
            "rendered before; the true masks are cast anew in each run.",
        ),
    )


_LAYERS = ("images", "scene", "attention", "verdicts")


def main() -> None:
    """Measure and print the tables."""
    parser = argparse.ArgumentParser(description="Measure bytes and time of recordings.")
    parser.add_argument("experiment", nargs="?", default="demo", help="Experiment whose clips are recorded.")
    parser.add_argument("--limit", type=int, default=1500, help="Number of frames of the long clip.")
    given = parser.parse_args()
    clips = measure_clips(load_experiment(given.experiment))
    print_tables(clips_table(clips), recordings_table(measure_recordings(given.limit)))
