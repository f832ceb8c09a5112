"""Peak resident memory of a whole run (reading, matching, attention, recording), by the length of its clip."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.bench.generated_clip import write_clip
from harness.bench.hours import run_experiment
from harness.bench.mcap_memory import HEIGHT, WIDTH, peak_mib, write_recording
from harness.processes import spawning
from harness.report.sinks import recordings
from harness.run.experiment import load_experiment
from harness.run.plan import prepare
from harness.run.runner import run_plan
from harness.stages.outputs.write import write_coco_panoptic
from vfoa.types import Instance, Instances

_EXPERIMENT = """
clips = ["{clip}"]
[defaults]
stereo = {{ matcher = "bm", min_depth_m = 0.3 }}
segmentation = {{ model = "coco_panoptic", root = "{masks}" }}
heads.detector = "person_mask"
head_pose.model = "none"
gaze.model = "none"
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Peak:
    """The peak of a fresh process that ran this many frames."""

    frames: int
    peak_mib: float


def measure_memory(frames: int) -> Peak:
    """Run a generated recording of 160 x 120 pixels in a fresh process, with a recording in ``light``."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        write_recording(root / "generated.mcap", frames)
        _write_masks(root / "masks", frames)
        clip = root / "datasets" / "generated.toml"
        clip.parent.mkdir()
        source = '[source]\nrecording = "generated.mcap"\n'
        clip.write_text(f'name = "generated"\nadapter = "mcap"\nroot = "{root.as_posix()}"\n{source}', encoding="utf-8")
        experiment = root / "memory.toml"
        text = _EXPERIMENT.format(clip=clip.as_posix(), masks=(root / "masks").as_posix())
        experiment.write_text(text, encoding="utf-8")
        with spawning().Pool(1) as pool:
            return Peak(frames=frames, peak_mib=pool.apply(_run, (experiment, root / "run")))


def measure_four(frames: int) -> Peak:
    """Run a generated clip under four configurations with light recordings, as ``harness.bench.hours`` does."""
    with tempfile.TemporaryDirectory() as folder, spawning().Pool(1) as pool:
        root = Path(folder)
        return Peak(frames=frames, peak_mib=pool.apply(_run_four, (write_clip(root, frames), root / "run")))


def _run_four(experiment: Path, out: Path) -> float:
    run_experiment(experiment, out)
    return peak_mib()


def _write_masks(folder: Path, frames: int) -> None:
    ids = np.zeros((HEIGHT, WIDTH), np.uint16)
    ids[20:100, 20:60], ids[40:80, 90:140] = 1, 2
    person = Instance(id=1, label="person", category_id=1, is_thing=True, score=0.9)
    cup = Instance(id=2, label="cup", category_id=47, is_thing=True, score=0.9)
    masks = Instances(ids=ids, instances=(person, cup))
    write_coco_panoptic(folder, [(number, masks) for number in range(1, frames + 1)])


def _run(experiment: Path, out: Path) -> float:
    loaded = load_experiment(str(experiment))
    sinks = recordings(loaded.configurations, "light")
    run_plan(prepare(loaded, sinks=sinks), out, workers=1, progress=lambda clip: None)
    return peak_mib()
