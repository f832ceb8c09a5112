"""Output of ``vfoa run --save-outputs``: every stage output once, and an experiment that runs from it.

<run>/stage_outputs/
    <experiment>.toml                  run it with VFOA_STAGE_OUTPUTS set to this folder; the folder may be moved
    <clip>/<configuration>/
        disparity/frame_0001.npy         (H, W) float32, pixels, NaN = unknown
        panoptic.json, png/              masks in COCO's panoptic format
        heads.csv, head_pose.csv, gaze.csv

Configurations that share a stage and all of its inputs share its output. It is saved for the first of them, and the
experiment refers the others to it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.files.io import atomic_write
from harness.files.parsing import toml_value
from harness.run.experiment import Experiment
from harness.stages.configuration import Configuration
from harness.stages.slots import CLIP_VARIABLE, OFF, SLOTS

VARIABLE = "VFOA_STAGE_OUTPUTS"
DISPARITY = "disparity/frame_%04d.npy"

_READS: Mapping[str, tuple[str, ...]] = {
    "stereo": ("stereo",),
    "segmentation": ("segmentation",),
    "heads": ("segmentation", "heads"),
    "head_pose": ("segmentation", "heads", "head_pose"),
    "gaze": ("segmentation", "heads", "head_pose", "gaze"),
}
"""The stages whose settings can change a stage's output."""


def owner(slot: str, configuration: Configuration, configurations: Sequence[Configuration]) -> str:
    """The name of the first configuration that has the same output of a stage."""
    wanted = _key(slot, configuration)
    return next(each.name for each in configurations if _key(slot, each) == wanted)


def owned_slots(configuration: Configuration, configurations: Sequence[Configuration]) -> frozenset[str]:
    """The stages whose output a configuration saves: those that are on and not shared with an earlier configuration."""
    on = (slot for slot, choice in configuration.choices.items() if choice)
    return frozenset(slot for slot in on if owner(slot, configuration, configurations) == configuration.name)


def owns_scenes(configuration: Configuration, configurations: Sequence[Configuration]) -> bool:
    """Whether no configuration before this one has the same scenes: the same stages and reconstruction."""

    def key(each: Configuration) -> str:
        return json.dumps([*(_key(slot, each) for slot in _READS), each.reconstruction.model_dump(mode="json")])

    return next(each.name for each in configurations if key(each) == key(configuration)) == configuration.name


def write_experiment(folder: Path, experiment: Experiment, *, partial: bool) -> None:
    """Write ``<folder>/<experiment>.toml``, which runs from the stage outputs in ``folder``.

    ``partial``: only the first frames of the clips were saved.
    """
    limit = " --limit N" if partial else ""
    lines = [
        f"# {VARIABLE}=<this folder> vfoa run <this file>{limit}",
        f"clips = {toml_value(list(experiment.clips))}",
        f"notes = {toml_value(list(experiment.notes))}",
        *([f"annotator = {toml_value(experiment.annotator)}"] if experiment.annotator else []),
    ]
    for configuration in experiment.configurations:
        lines += ["", "[[configuration]]", f"name = {toml_value(configuration.name)}"]
        lines += _tables(configuration, experiment.configurations, partial)
    atomic_write(folder / f"{experiment.name}.toml", "\n".join(lines) + "\n")


def _key(slot: str, configuration: Configuration) -> str:
    choices = [configuration.choices[each] for each in _READS[slot]]
    if configuration.uses_drawn and slot != "stereo":
        drawn = configuration.drawn.model_dump(mode="json")
        choices += [configuration.choices["stereo"]] if slot == "segmentation" else []  # depth cuts out the drawn masks
    else:
        drawn = None
    return json.dumps([drawn, *(choice.plain() if choice else None for choice in choices)], sort_keys=True)


def _tables(configuration: Configuration, configurations: Sequence[Configuration], partial: bool) -> Iterator[str]:
    for table, settings in configuration.plain().items():
        if table in SLOTS:
            yield f"{table} = {toml_value(_source(table, configuration, configurations, partial))}"
        elif table == "drawn":  # the saved masks and heads include the drawn ones
            yield f"{table} = {toml_value({**settings, 'targets': False, 'heads': False})}"
        else:
            yield f"{table} = {toml_value(settings)}"


def _source(
    slot: str, configuration: Configuration, configurations: Sequence[Configuration], partial: bool
) -> dict[str, Any]:
    """The table of a stage in the written experiment."""
    if configuration.choices[slot] is None:
        return {SLOTS[slot].key: OFF}
    folder = owner(slot, configuration, configurations)
    source: dict[str, Any] = {
        SLOTS[slot].key: "coco_panoptic" if slot == "segmentation" else "files",
        "root": f"${{{VARIABLE}}}/{CLIP_VARIABLE}/{folder}",
    }
    if slot == "stereo":
        source["pattern"] = DISPARITY
    if slot == "segmentation":
        source["stuff"] = "all"
    if slot in ("head_pose", "gaze"):
        source["heads"] = f"../{owner('heads', configuration, configurations)}/heads.csv"
    if slot in ("stereo", "segmentation") and partial:
        source["partial"] = True
    return source
