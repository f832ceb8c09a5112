"""The cost of hours of video: ``python -m harness.bench.hours 1500 6000 18000``.

Each length is a generated clip of 160 x 120 pixels at 25 Hz, with one person, three objects and labels, under four
configurations: block matching, masks and gazes from files, attention by cones, a filtered gaze and the nearest angle;
with recordings, thumbnails, tables and page. A run, its first scoring, and a scoring after one label was edited are
three fresh processes. CPU seconds are those of the process; wall-clock seconds also depend on the load of the machine.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from rich.console import Console

from harness.bench.mcap_memory import peak_mib
from harness.processes import spawning
from harness.report.formats import Table, to_markdown
from harness.report.sinks import composed_sinks
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.plan import prepare
from harness.run.runner import run_plan
from harness.stages.outputs.coco_panoptic_writer import write_coco_panoptic
from harness.stages.outputs.directions import write_gazes
from harness.stages.outputs.heads import write_heads
from vfoa.types import Gaze, Head, Instance, Instances

WIDTH, HEIGHT, SHIFT_PX = 160, 120, 8
PERSON_PX, THINGS = (slice(10, 110), slice(62, 98)), ("cup", "book", "bottle")
FIXATION = 40
"""Frames of a look."""

_CLIP = """
name = "generated"
adapter = "stereo_folder"
root = "{root}"
source.left = "left"
source.right = "right"
source.rate_hz = 25.0
source.camera = {{ fx_px = 100.0, cx_px = 80.0, cy_px = 60.0, baseline_m = 0.1 }}
subjects.ann.category = "person"
targets.cup.category = "cup"
targets.book.category = "book"
targets.bottle.category = "bottle"
"""

_EXPERIMENT = """
clips = ["{clip}"]
[defaults]
stereo = {{ matcher = "bm", min_depth_m = 0.5 }}
segmentation = {{ model = "coco_panoptic", root = "{outputs}" }}
heads = {{ detector = "files", root = "{outputs}" }}
head_pose.model = "none"
gaze = {{ model = "files", root = "{outputs}" }}

[[configuration]]
name = "one-cone"
[[configuration]]
name = "two-cones"
attention.cones_cm = [10.0, 25.0]
[[configuration]]
name = "filtered"
gaze_filter.cues = "gaze"
[[configuration]]
name = "nearest"
attention.method = "nearest"
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Seconds, CPU seconds, and the peak memory of a fresh process."""

    seconds: float
    cpu_seconds: float
    peak_mib: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Hours:
    """A run of this many frames, its first scoring and the one after an edited label, and the bytes of its files."""

    frames: int
    run: Cost
    scored: Cost
    again: Cost
    results_bytes: int
    recordings_bytes: int
    thumbnails_bytes: int
    page_bytes: int


def measure_hours(frames: int, root: Path) -> Hours:
    """Run and score a generated clip of this many frames in an empty folder."""
    experiment = write_clip(root, frames)
    out = root / "run"
    run = _fresh(run_experiment, experiment, out)
    scored = _fresh(score_run, out)
    write_labels(root, frames, edited=frames // 2)
    again = _fresh(score_run, out)
    return Hours(
        frames=frames,
        run=run,
        scored=scored,
        again=again,
        results_bytes=RunDirectory(out).results.stat().st_size,
        recordings_bytes=_bytes(out, "*.rrd"),
        thumbnails_bytes=_bytes(out, "thumbnails/**/*"),
        page_bytes=(out / "report.html").stat().st_size,
    )


def write_clip(root: Path, frames: int) -> Path:
    """Write the clip, its labels and the outputs of its stages; return the experiment."""
    outputs = root / "outputs"
    _write_views(root, frames)
    write_coco_panoptic(outputs, [(number, _masks()) for number in range(1, frames + 1)])
    head = Head(box_px=np.array([70.0, 12.0, 90.0, 36.0]), score=0.9, instance_id=1)
    write_heads(outputs / "heads.csv", [(number, "1", head) for number in range(1, frames + 1)])
    rng = np.random.default_rng(0)
    gazes = [(number, "1", _gaze(number, rng)) for number in range(1, frames + 1)]
    write_gazes(outputs / "gaze.csv", gazes)
    clip = root / "datasets" / "generated.toml"
    clip.parent.mkdir()
    clip.write_text(_CLIP.format(root=root.as_posix()), encoding="utf-8")
    write_labels(root, frames)
    experiment = root / "hours.toml"
    experiment.write_text(_EXPERIMENT.format(clip=clip.as_posix(), outputs=outputs.as_posix()), encoding="utf-8")
    return experiment


def write_labels(root: Path, frames: int, *, edited: int | None = None) -> None:
    """Write the person's targets, look by look; the look with the frame ``edited`` gets another target."""
    lines = ["# vfoa annotations 1", "first_frame,last_frame,subject,target,note"]
    for first in range(1, frames + 1, FIXATION):
        last = min(first + FIXATION - 1, frames)
        wrong = edited is not None and first <= edited <= last
        lines.append(f"{first},{last},ann,{THINGS[(_looked_at(first) + wrong) % len(THINGS)]},")
    path = root / "annotations" / "generated.csv"
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def run_experiment(experiment: Path, out: Path) -> None:
    """Run an experiment without a cache, with light recordings and thumbnails, in this process."""
    loaded = load_experiment(str(experiment))
    plan = prepare(loaded, sinks=composed_sinks(loaded.configurations, "light"))
    run_plan(plan, out, workers=1, progress=lambda clip: None)


def score_run(out: Path) -> None:
    """Score a run as ``vfoa score`` does."""
    rescore(RunDirectory(out))


def _fresh(work: Callable[..., None], *arguments: Path) -> Cost:
    with spawning().Pool(1) as pool:
        return pool.apply(_cost, (work, arguments))


def _cost(work: Callable[..., None], arguments: tuple[Path, ...]) -> Cost:
    started, cpu = time.perf_counter(), time.process_time()
    work(*arguments)
    return Cost(seconds=time.perf_counter() - started, cpu_seconds=time.process_time() - cpu, peak_mib=peak_mib())


def _write_views(root: Path, frames: int) -> None:
    """A coarse texture at one depth, and a bright bar that moves, so that every frame differs."""
    rng = np.random.default_rng(1)
    coarse = rng.integers(40, 200, (HEIGHT // 3, (WIDTH + SHIFT_PX) // 3, 3), dtype=np.uint8)
    texture = cv2.resize(coarse, (WIDTH + SHIFT_PX, HEIGHT), interpolation=cv2.INTER_NEAREST)
    for side in ("left", "right"):
        (root / side).mkdir(parents=True)
    for number in range(1, frames + 1):
        scene = texture.copy()
        scene[number % HEIGHT] = 255
        cv2.imwrite(str(root / "left" / f"{number:06d}.png"), scene[:, :WIDTH])
        cv2.imwrite(str(root / "right" / f"{number:06d}.png"), scene[:, SHIFT_PX:])


def _masks() -> Instances:
    ids = np.zeros((HEIGHT, WIDTH), np.uint16)
    ids[PERSON_PX] = 1
    found: list[Any] = [Instance(id=1, label="person", category_id=1, is_thing=True, score=0.9)]
    for place, name in enumerate(THINGS):
        ids[80:104, 8 + 18 * place : 20 + 18 * place] = 2 + place
        found.append(Instance(id=2 + place, label=name, category_id=47 + place, is_thing=True, score=0.9))
    return Instances(ids=ids, instances=tuple(found))


def _looked_at(number: int) -> int:
    return ((number - 1) // FIXATION) % len(THINGS)


def _gaze(number: int, rng: np.random.Generator) -> Gaze:
    """The direction from the head's middle to the object's, all at one depth, with an error of a few degrees."""
    target_px = np.array([14.0 + 18 * _looked_at(number), 92.0])
    offset = np.append((target_px - [80.0, 24.0]) / 100.0, 0.0) + rng.normal(0, 0.06, 3)
    return Gaze(direction=offset / np.linalg.norm(offset), sigma_rad=0.06)


def _bytes(out: Path, pattern: str) -> int:
    return sum(path.stat().st_size for path in out.glob(pattern) if path.is_file())


def hours_table(rows: Sequence[Hours]) -> Table:
    """One row per length; rates are per thousand frames, so that linear growth gives the same number in each row."""
    return Table(
        title="Runs of generated clips of 160 x 120 pixels under four configurations",
        columns=(
            *("frames", "run s", "CPU s", "CPU ms a frame", "peak MiB", "results MB", "recordings MB"),
            *("thumbnails MB", "page MB", "score CPU s", "peak MiB", "again s", "CPU s"),
        ),
        rows=tuple(
            (
                str(row.frames),
                f"{row.run.seconds:.0f}",
                f"{row.run.cpu_seconds:.0f}",
                f"{1e3 * row.run.cpu_seconds / row.frames:.1f}",
                f"{row.run.peak_mib:.0f}",
                f"{row.results_bytes / 1e6:.1f}",
                f"{row.recordings_bytes / 1e6:.0f}",
                f"{row.thumbnails_bytes / 1e6:.0f}",
                f"{row.page_bytes / 1e6:.1f}",
                f"{row.scored.cpu_seconds:.1f}",
                f"{row.scored.peak_mib:.0f}",
                f"{row.again.seconds:.1f}",
                f"{row.again.cpu_seconds:.1f}",
            )
            for row in rows
        ),
        words=0,
        notes=("Again: scoring after one label was edited, imports of the fresh process included.",),
    )


def main() -> None:
    """Measure the given lengths."""
    rows = []
    for frames in map(int, sys.argv[1:]):
        with tempfile.TemporaryDirectory() as folder:
            rows.append(measure_hours(frames, Path(folder)))
        Console().print(to_markdown(hours_table(rows)), soft_wrap=True)


if __name__ == "__main__":
    main()
