"""The networks of stereo, segmentation, heads and gaze on CUDA, beside the CPU (``--only gpu``)."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.clips.manifest import ClipManifest
from harness.pipeline.configuration import STAGES, StageChoice
from harness.report.formats import Table
from harness.run.experiment import Experiment, load_experiment
from harness.sources import Clip
from vfoa.errors import VfoaError
from vfoa.onnx import Provider, RuntimeSettings, available_providers
from vfoa.types import Instances, StereoFrame
from vfoa.weights import check_located, weights_of

PROVIDERS: tuple[Provider, ...] = ("cpu", "cuda")
MOST_FRAMES = 10
_METHODS = {
    "stereo": "match",
    "segmentation": "segment",
    "heads": "detect",
    "head_pose": "estimate",
    "gaze": "estimate",
}

Calls = Mapping[str, Sequence[tuple[Any, ...]]]
"""The inputs of each stage's calls, by slot."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageTime:
    """A stage by slot and name. ``ms``: the median milliseconds of a call by provider, or why there are none."""

    slot: str
    name: str
    ms: Mapping[Provider, float | str]


def measure_gpu(manifest: ClipManifest, experiment: Experiment, frames: Sequence[int]) -> list[StageTime]:
    """Time the matcher and the segmenter of the experiment's first configuration, HITNet and the default networks.

    Networks run with one thread of the CPU, or on CUDA. The heads and their poses are found before, on the CPU. The
    first call of each stage is left out.
    """
    clip = manifest.open_images()
    (default,) = load_experiment("default", clips=(manifest.name,)).configurations
    own = experiment.configurations[0].choices
    choices = {**default.choices, "stereo": STAGES["stereo"].parse({"matcher": "hitnet"}, "bench")}
    if own["segmentation"] and _is_network(own["segmentation"]):
        choices["segmentation"] = own["segmentation"]
    calls = _calls(clip, choices, [clip.frame(number) for number in frames[:MOST_FRAMES]])
    timed = dict.fromkeys(stage_choice for stage_choice in (own["stereo"], *choices.values()) if stage_choice)
    return [
        StageTime(
            slot=stage_choice.slot,
            name=stage_choice.name,
            ms={provider: _ms(stage_choice, provider, clip, calls) for provider in PROVIDERS},
        )
        for stage_choice in timed
    ]


def _is_network(choice: StageChoice) -> bool:
    return isinstance(choice.settings, RuntimeSettings)


def _calls(clip: Clip, choices: Mapping[str, StageChoice | None], frames: Sequence[StereoFrame]) -> Calls:
    """Inputs of all stages; none of heads whose detector is not here."""
    nobody = [Instances(ids=np.zeros(stereo_frame.left.shape[:2], np.uint16), instances=()) for stereo_frame in frames]
    seen = list(zip(frames, nobody, strict=True))
    heads, poses = (_built(choices[slot], clip) for slot in ("heads", "head_pose"))
    heads_in_frames = [(frame, head) for frame, masks in seen for head in (heads.detect(frame, masks) if heads else ())]
    posed = [(frame, head, poses.estimate(frame, head) if poses else None) for frame, head in heads_in_frames]
    alone = [(stereo_frame,) for stereo_frame in frames]
    return {"stereo": alone, "segmentation": alone, "heads": seen, "head_pose": heads_in_frames, "gaze": posed}


def _built(choice: StageChoice | None, clip: Clip) -> Any:
    """The stage; None if its weights are not on this machine."""
    if choice is None or not _are_here(choice):
        return None
    return STAGES[choice.slot].build(choice, clip)


def _are_here(choice: StageChoice) -> bool:
    try:
        check_located(weights_of(choice.settings))
    except VfoaError:
        return False
    return True


def _ms(choice: StageChoice, provider: Provider, clip: Clip, calls: Calls) -> float | str:
    if provider != "cpu" and not _is_network(choice):
        return "CPU only"
    if provider not in available_providers():
        return "not available"
    if not _are_here(choice):
        return "no weights"
    if len(calls[choice.slot]) < 2:
        return "no heads"
    taken_s = []
    try:
        call = getattr(STAGES[choice.slot].build(choice.on(provider), clip), _METHODS[choice.slot])
        for inputs in calls[choice.slot]:
            started = time.perf_counter()
            call(*inputs)
            taken_s.append(time.perf_counter() - started)
    except VfoaError:
        if provider == "cpu":
            raise
        return "fails"  # a driver or a library is missing; `vfoa models check --provider cuda` says which
    return 1e3 * float(np.median(taken_s[1:]))


def gpu_table(clip: str, rows: Sequence[StageTime]) -> Table:
    """One row per stage, one column per provider."""
    return Table(
        title=f"Stages on CUDA and on the CPU, milliseconds a call on {clip}",
        columns=("stage", "name", *PROVIDERS, "times faster"),
        rows=tuple(
            (row.slot, row.name, *(_text(row.ms[provider]) for provider in PROVIDERS), _ratio(row)) for row in rows
        ),
        words=2,
        notes=(
            "A call with its pre- and post-processing: stereo, segmentation and heads of a frame, pose and gaze of a "
            "head. Networks have one thread on the CPU. CPU only: no code of the stage runs on CUDA. Not available: "
            "this build of ONNX Runtime has no CUDA (`pip install onnxruntime-gpu` in place of onnxruntime).",
        ),
    )


def _text(ms: float | str) -> str:
    return ms if isinstance(ms, str) else f"{ms:.1f}"


def _ratio(row: StageTime) -> str:
    cpu, cuda = row.ms["cpu"], row.ms["cuda"]
    return f"{cpu / cuda:.1f}" if isinstance(cpu, float) and isinstance(cuda, float) else ""
