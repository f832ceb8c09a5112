"""Every method on every material at hand, in one table: ``vfoa run benchmark``.

A material is an experiment's clips under the stages of its first configuration; each is run under every method, into a
folder of its own. What is not on this machine is left out, and the reason is said.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from harness.clips.manifest import load_manifest
from harness.files.parsing import parse_assignment
from harness.files.remote import expand
from harness.pipeline.configuration import METHODS as KNOWN
from harness.pipeline.configuration import Configuration, merged, reads_clip
from harness.run.experiment import Experiment, is_experiment, load_experiment
from vfoa.config import read_steps
from vfoa.errors import VfoaError
from vfoa.methods import MethodSettings

Tables = Mapping[str, Mapping[str, Any]]
"""Settings of attention by the name of the method's row."""

METHODS: Tables = {
    "nearest": {"method": "nearest"},
    "nearest_15": {"method": "nearest", "gaze_share": 0.9, "limit_deg": 15},
    "two_cones": {"cones_cm": [10, 25]},
    "posterior": {"method": "bayes"},
    "posterior_both": {"method": "bayes", "smoothing": "both"},
    "logit": {"method": "logit"},
}
_FITTED: Tables = {
    "logit_fitted": {"method": "logit", "weights": "left-out"},
    "logit_both_fitted": {"method": "logit", "weights": "left-out", "smoothing": "both"},
}
"""The logit fitted to the labels of the material's other clips. Without labels, later frames do not change it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BenchmarkMaterial:
    """What methods are tried on: an experiment with some settings, and the methods that differ or are only there.

    ``setting`` is where it was made; materials of one setting weigh as much together as another one alone.
    """

    title: str
    setting: str
    experiment: str
    settings: tuple[str, ...] = ()
    methods: Tables = field(default_factory=dict)


MATERIALS: Mapping[str, BenchmarkMaterial] = {
    "people_heads": BenchmarkMaterial(
        title="people, heads alone",
        setting="people",
        experiment="people",
        settings=("gaze.model=none",),
        methods=_FITTED,
    ),
    "people_gaze_11": BenchmarkMaterial(
        title="people, gaze 11 deg off",
        setting="people",
        experiment="people",
        settings=("gaze.model=simulated", "gaze.error_deg=11.1"),
        methods=_FITTED,
    ),
    "conversation": BenchmarkMaterial(
        title="conversation, heads alone",
        setting="conversation",
        experiment="conversation",
        methods={
            "idiap_hmm": {
                "method": "answers",
                "file": "${VFOA_DATA}/idiap_vfoa/test_runVfoaModule_data.csv",
            }
        },
    ),
    "rendered": BenchmarkMaterial(
        title="rendered clips",
        setting="rendered clips",
        experiment="demo",
        settings=("stereo.matcher=sgbm",),
    ),
    "drawn": BenchmarkMaterial(title="drawn scenes", setting="drawn scenes", experiment="drawn"),
    "bandage_2": BenchmarkMaterial(
        title="drawn film",
        setting="drawn film",
        experiment="bandage_2",
        settings=("stereo.matcher=sgbm",),
    ),
}
"""By name, which is the folder of its run. ``drawn`` is an experiment that ``scripts/drawn_clips.py`` writes."""


def changed_methods(overrides: Iterable[str]) -> Tables:
    """Return the settings of ``"NAME.key=value"``, by the row NAME, which may be a new one.

    Raises
    ------
    VfoaError
        If one has another form.
    """
    tables: dict[str, dict[str, Any]] = {}
    for text in overrides:
        dotted, value = parse_assignment(text, "theirs.file=answers/${CLIP}.csv")
        name, _, key = dotted.partition(".")
        if not key:
            raise VfoaError(f"--set {dotted}: expected METHOD.key, such as theirs.method=answers")
        tables.setdefault(name, {})[key] = value
    return tables


def material_experiment(
    name: str, material: BenchmarkMaterial, changes: Tables | None = None
) -> tuple[Experiment, list[str]]:
    """Return the experiment of a material, called by its name, and what is left out of it, a sentence each.

    Parameters
    ----------
    changes
        Settings of attention by row, in every material, as :func:`changed_methods` gives them.

    Raises
    ------
    VfoaError
        If its clips are not here, or a setting is wrong.
    """
    if not is_experiment(material.experiment):
        raise VfoaError(f"found no experiment {material.experiment!r}")
    experiment = load_experiment(material.experiment, overrides=material.settings)
    for clip in experiment.clips:
        load_manifest(clip).open()
    configurations, left_out = [], list(experiment.missing)
    for method, settings in _methods(material, changes or {}).items():
        if missing := _missing_answers(settings, experiment.clips):
            left_out.append(f"{method}: not in the table: no file {missing}.")
        else:
            configurations.append(_with_method(experiment.configurations[0], method, settings))
    return replace(
        experiment,
        name=name,
        configurations=tuple(configurations),
        published=None,
        recording="none",
    ), left_out


def _methods(material: BenchmarkMaterial, changes: Tables) -> dict[str, MethodSettings]:
    """The settings of each row of a material."""
    tables = merged({**METHODS, **material.methods}, changes)
    return {
        name: read_steps({"attention": settings}, None, f"benchmark: {name}", methods=KNOWN)[1].attention
        for name, settings in tables.items()
    }


def _missing_answers(settings: MethodSettings, clips: Iterable[str]) -> Path | None:
    """The first file of another system's answers that is not here."""
    if not reads_clip(settings):
        return None
    files = (str(getattr(settings.for_clip(clip), "file", "")) for clip in clips)
    paths = (expand(file, Path.cwd(), "attention.file") for file in files)
    return next((path for path in paths if not path.is_file()), None)


def _with_method(base: Configuration, name: str, settings: MethodSettings) -> Configuration:
    return replace(base, name=name, factors={}, attend=base.attend.model_copy(update={"attention": settings}))
