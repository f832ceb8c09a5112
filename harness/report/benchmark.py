"""Every method on every material at hand, in one table: ``vfoa run benchmark``.

A material is an experiment's clips under the stages of its first configuration; each is run under every method, into a
folder of its own. What is not on this machine is left out, and the reason is said.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from harness.clips.manifest import load_manifest
from harness.files.io import atomic_write
from harness.files.parsing import parse_assignment
from harness.pipeline.configuration import METHODS as KNOWN
from harness.pipeline.configuration import Configuration, merged, reads_clip
from harness.remote import expand
from harness.report.formats import UNKNOWN, Table, number, percent, percent_range, to_csv, to_markdown
from harness.report.page.render import render_tables
from harness.report.verdict import verdict_lines
from harness.run.directory import FITTED_ON_REPORTED
from harness.run.experiment import Experiment, is_experiment, load_experiment, shipped_notes
from harness.score.calibration import reliabilities
from harness.score.score import Scores
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
    "logit_both": {"method": "logit", "smoothing": "both"},
}
_LEFT_OUT: Tables = {name: {**METHODS[name], "weights": "left-out"} for name in ("logit", "logit_both")}


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """What methods are tried on: an experiment with some settings, and the methods that differ or are only there."""

    title: str
    experiment: str
    settings: tuple[str, ...] = ()
    methods: Tables = field(default_factory=dict)


MATERIALS: Mapping[str, Material] = {
    "people_heads": Material(
        title="people, heads alone",
        experiment="people",
        settings=("gaze.model=none",),
        methods=_LEFT_OUT,
    ),
    "people_gaze_11": Material(
        title="people, gaze 11 deg off",
        experiment="people",
        settings=("gaze.model=simulated", "gaze.error_deg=11.1"),
        methods=_LEFT_OUT,
    ),
    "conversation": Material(
        title="conversation, heads alone",
        experiment="conversation",
        methods={
            "idiap_hmm": {
                "method": "answers",
                "file": "${VFOA_DATA}/idiap_vfoa/test_runVfoaModule_data.csv",
            }
        },
    ),
    "rendered": Material(title="rendered clips", experiment="demo", settings=("stereo.matcher=sgbm",)),
    "drawn": Material(title="drawn scenes", experiment="drawn"),
    "bandage_2": Material(title="drawn film", experiment="bandage_2", settings=("stereo.matcher=sgbm",)),
}
"""By name, which is the folder of its run. ``drawn`` is an experiment that ``scripts/drawn_clips.py`` writes."""

RULE = "rule: "
"""How the row of the best simple rule begins."""

_NOTES = (
    "FRR: correct / annotated (frame, subject) pairs. Balanced: mean of the shares of right pairs with a true target "
    "and of those whose label is none. 95 %: as in the report of the material's run.",
    "Log loss and ECE (expected calibration error): of methods that give probabilities; lower is better.",
    "rule: the best simple rule on the same frames that has not seen their labels; see the run's table of baselines.",
    "logit on people: fitted to the other people. Elsewhere its weights are those that ship with vfoa.",
)


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


def material_experiment(name: str, changes: Tables | None = None) -> tuple[Experiment, list[str]]:
    """Return the experiment of a material, and what is left out of it, a sentence each.

    Parameters
    ----------
    changes
        Settings of attention by row, in every material, as :func:`changed_methods` gives them.

    Raises
    ------
    VfoaError
        If its clips are not here, or a setting is wrong.
    """
    material = MATERIALS[name]
    if not is_experiment(material.experiment):
        raise VfoaError(f"no experiment {material.experiment!r} here")
    experiment = load_experiment(material.experiment, overrides=material.settings)
    for clip in experiment.clips:
        load_manifest(clip).open()
    configurations, left_out = [], list(experiment.missing)
    for method, settings in _methods(material, changes or {}).items():
        if missing := _missing_answers(settings, experiment.clips):
            left_out.append(f"{method}: not in the table: no file {missing}.")
        else:
            configurations.append(_with_method(experiment.configurations[0], method, settings))
    own = (note for note in experiment.notes if not note.startswith(FITTED_ON_REPORTED))
    notes = tuple(dict.fromkeys((*own, *shipped_notes(configurations, experiment.clips))))
    return replace(
        experiment,
        name=name,
        configurations=tuple(configurations),
        notes=notes,
        published=None,
        recording="none",
    ), left_out


def _methods(material: Material, changes: Tables) -> dict[str, MethodSettings]:
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


def benchmark_table(scores: Mapping[str, Scores], left_out: Iterable[str] = ()) -> Table:
    """The table of all materials, by their names; ``left_out`` are sentences on what is not in it."""
    warnings = (
        f"{name}: {note}" for name, of in scores.items() for note in of.notes if note.startswith(FITTED_ON_REPORTED)
    )
    return Table.of(
        "Every method on every material",
        "Material | Method | n | Clips | FRR % | 95 % | Balanced % | Log loss | ECE",
        (row for name, of_material in scores.items() for row in _rows(MATERIALS[name].title, of_material)),
        words=2,
        notes=(*_NOTES, *warnings, *left_out),
    )


def benchmark_lines(scores: Mapping[str, Scores]) -> list[str]:
    """The answer, a line for each material: its best method, and whether it beats the best simple rule."""
    return [f"{MATERIALS[name].title}: {' '.join(verdict_lines(of)[:2])}" for name, of in scores.items()]


def write_benchmark(folder: Path, scores: Mapping[str, Scores], table: Table) -> Path:
    """Write the table as Markdown and CSV, and as a page that links the report of each material; return the page.

    The runs of the materials are in ``folder``, by name.
    """
    atomic_write(folder / "benchmark.md", to_markdown(table))
    atomic_write(folder / "benchmark.csv", to_csv(table))
    methods = {row.configuration for of in scores.values() for row in of.overall()}
    facts = [f"{len(scores)} of {len(MATERIALS)} materials", f"{len(methods)} methods"]
    links = {MATERIALS[name].title: f"{name}/report.html" for name in scores}
    page = folder / "benchmark.html"
    atomic_write(page, render_tables("Every method on every material", facts, benchmark_lines(scores), [table], links))
    return page


def _rows(title: str, scores: Scores) -> Iterator[tuple[object, ...]]:
    """The rows of a material: the best simple rule, then the methods."""
    errors = {each.configuration: each.calibration_error for each in reliabilities(scores.outcomes)}
    rows = scores.overall()
    for row in rows[:1]:
        rule = row.best_baseline
        rates = percent(row.baselines[rule]), UNKNOWN, percent(row.baselines_balanced[rule])
        yield (title, RULE + rule.replace("_", " "), row.n, row.clips, *rates, UNKNOWN, UNKNOWN)
    for row in rows:
        error = errors.get(row.configuration)
        rates = percent(row.frr), percent_range(row.interval), percent(row.metrics["balanced_frr"])
        losses = number(row.metrics["log_loss"], 3), UNKNOWN if error is None else number(error, 3)
        yield (title, row.configuration, row.n, row.clips, *rates, *losses)
