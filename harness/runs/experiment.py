"""Experiments: which clips under which configurations.

An experiment is a TOML file::

    clips = ["studio_table", "studio_talk"]
    notes = ["Heads and masks are the truth; gaze and head pose are simulated."]
    preset = "realtime"                     # a bundle of settings over the defaults, see harness/runs/presets.py
    annotator = "anna"                      # if not <clip>.csv, but <clip>@anna.csv is what is scored

    [defaults.stereo]                       # one table per stage, see vfoa/*/ and harness/runs/stages.py
    matcher = "sgbm"
    min_depth_m = 0.8                       # for every matcher that has such a setting

    [grid]                                  # every combination; a value is named by itself ...
    "stereo.matcher" = ["bm", "sgbm"]
    "attention.cones_cm" = { one = [10], two = [10, 25] }     # ... or by its key

or, instead of ``[grid]``, a list of ``[[configuration]]`` with a ``name`` and the tables in which it differs.

A grid of thousands is a sweep, of which only the scores are kept (see :mod:`harness.sweep`)::

    [sweep]
    per = "gaze.error_deg"                  # which setting is best at each of these ...
    across = "attention.cones_deg"          # ... and how the rate goes over these: the figure's lines and its abscissa
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import Field

from harness.clips.locate import find, names
from harness.config_errors import parse, read_toml
from harness.runs.presets import preset_tables
from harness.runs.published import Published
from harness.runs.stages import SLOTS, StageChoice
from harness.runs.variants import variants
from harness.toml_text import parse_assignment
from vfoa.attention import AttentionSettings
from vfoa.bayes import BayesSettings
from vfoa.errors import VfoaError, did_you_mean
from vfoa.gaze_filter import GazeFilterSettings
from vfoa.pipeline import AttendSettings
from vfoa.reconstruction import ReconstructionSettings
from vfoa.settings import Settings
from vfoa.tracking import TrackingSettings

_ATTEND: dict[str, type[Settings]] = {
    "tracking": TrackingSettings,
    "gaze_filter": GazeFilterSettings,
    "attention": AttentionSettings,
}
_TABLES = (*SLOTS, "reconstruction", *_ATTEND)
_Tables = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Configuration:
    """Every setting of one way to run the pipeline. ``choices`` has one entry per slot, None for one switched off.

    ``factors`` are the labels of its place in a grid by dotted key; empty where there was no grid.
    """

    name: str
    choices: Mapping[str, StageChoice | None]
    reconstruction: ReconstructionSettings
    attend: AttendSettings
    factors: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_in_region(self) -> bool:
        """Whether disparities are asked for only where things and heads are."""
        stereo = self.choices["stereo"]
        return stereo is not None and getattr(stereo.settings, "region", None) == "needed"

    def for_clip(self, clip: str) -> Configuration:
        """The configuration with the clip's name filled in where a stage's ``root`` asks for it."""
        choices = {slot: choice.for_clip(clip) if choice else None for slot, choice in self.choices.items()}
        return replace(self, choices=choices)

    def plain(self) -> dict[str, Any]:
        """The configuration as JSON values, every default written out: what a run's manifest records."""
        stages = {name: choice.plain() if choice else None for name, choice in self.choices.items()}
        attend = self.attend.model_dump(mode="json")
        return {**stages, "reconstruction": self.reconstruction.model_dump(mode="json"), **attend}


class SweepView(Settings):
    """How a sweep is looked at: the best setting for each value of ``per``, and the rate over those of ``across``."""

    per: str
    across: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """Clips x configurations. ``notes`` are printed with the table.

    ``annotator`` is the one whose labels are scored; None for ``annotations/<clip>.csv``. ``sweep``: only scores are
    kept; None for a run. ``published`` are somebody's figures for these configurations.
    """

    name: str
    clips: tuple[str, ...]
    configurations: tuple[Configuration, ...]
    notes: tuple[str, ...] = ()
    annotator: str | None = None
    sweep: SweepView | None = None
    published: Published | None = None


class _File(Settings):
    clips: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    annotator: str | None = None
    preset: str | None = None
    defaults: dict[str, dict[str, Any]] = Field(default_factory=dict)
    grid: dict[str, Any] = Field(default_factory=dict)
    configuration: tuple[dict[str, Any], ...] = ()
    sweep: SweepView | None = None
    published: Published | None = None


def load_experiment(
    name_or_path: str, *, clips: tuple[str, ...] = (), overrides: tuple[str, ...] = (), preset: str | None = None
) -> Experiment:
    """Read an experiment by the name of one in the project, or by path.

    Parameters
    ----------
    clips
        Run these instead of the file's own.
    overrides
        ``"stereo.min_depth_m=0.5"``: a dotted key and a TOML value (a bare word is a string), set in every
        configuration, over its defaults and its grid.
    preset
        A bundle of settings by name, over the defaults of every configuration, instead of the file's own.

    Raises
    ------
    VfoaError
        If the file, a key or a value is wrong: one line with the file and the dotted key.
    """
    path = _find(name_or_path)
    where = str(path)
    file = parse(_File, read_toml(path), where)
    chosen = clips or file.clips
    if not chosen:
        raise VfoaError(f"{where}: clips: expected at least one clip, found none")
    changes = [parse_assignment(text, "stereo.matcher=sgbm") for text in overrides]
    _check_sweep(file, where)
    configurations = []
    used: set[tuple[str, str]] = set()
    for variant in variants(file.grid, file.configuration, where):
        own = _tables([*variant.differences, *changes], where)
        inherited = _inherited(file.defaults, own)
        used |= {(table, key) for table, settings in inherited.items() for key in settings}
        bundle = preset_tables(preset or variant.preset or file.preset, where)
        inherited = _inherited(_merged(file.defaults, bundle), own)
        configuration = _configuration(
            variant.name, _merged(inherited, own), f"{where}: configuration {variant.name!r}"
        )
        configurations.append(replace(configuration, factors=variant.factors))
    _all_used(file.defaults, used, where)
    _check_published(file, [each.name for each in configurations], where)
    return Experiment(
        name=path.stem,
        clips=chosen,
        configurations=tuple(configurations),
        notes=file.notes,
        annotator=file.annotator,
        sweep=file.sweep,
        published=file.published,
    )


def is_experiment(name_or_path: str) -> bool:
    """Whether this names an experiment: a ``.toml`` file that is not a clip's manifest, or one by name."""
    return find("experiments", name_or_path) is not None or (
        name_or_path.endswith(".toml") and "adapter" not in read_toml(Path(name_or_path))
    )


def _find(name_or_path: str) -> Path:
    if name_or_path.endswith(".toml"):
        return Path(name_or_path)
    path = find("experiments", name_or_path)
    if path is None:
        raise VfoaError(f"experiment: no {name_or_path!r}; {did_you_mean(name_or_path, names('experiments'))}")
    return path


def _check_sweep(file: _File, where: str) -> None:
    for role in ("per", "across") if file.sweep else ():
        key = getattr(file.sweep, role)
        if key not in file.grid:
            raise VfoaError(f"{where}: sweep.{role}: {key!r} is not in the grid; {did_you_mean(key, file.grid)}")


def _check_published(file: _File, configurations: list[str], where: str) -> None:
    for name in file.published.counts if file.published else ():
        if name not in configurations:
            raise VfoaError(
                f"{where}: published.counts: no configuration {name!r}; {did_you_mean(name, configurations)}"
            )


def _tables(changes: list[tuple[str, Any]], where: str) -> dict[str, dict[str, Any]]:
    """Dotted keys as tables."""
    tables: dict[str, dict[str, Any]] = {}
    for dotted, value in changes:
        table, dot, key = dotted.partition(".")
        if not dot:
            raise VfoaError(f"{where}: {dotted}: expected a dotted key, such as stereo.matcher")
        if table not in _TABLES:
            raise VfoaError(f"{where}: {dotted}: unknown table; {did_you_mean(table, _TABLES)}")
        tables.setdefault(table, {})[key] = value
    return tables


def _merged(tables: _Tables, over: _Tables) -> _Tables:
    return {table: {**tables.get(table, {}), **over.get(table, {})} for table in {**tables, **over}}


def _inherited(defaults: _Tables, own: _Tables) -> _Tables:
    """The defaults that a configuration takes over: a stage takes those of its settings that it has."""
    tables = {}
    for table, settings in defaults.items():
        slot = SLOTS.get(table)
        name = {**settings, **own.get(table, {})}.get(slot.key) if slot else None
        tables[table] = {key: value for key, value in settings.items() if slot is None or slot.takes(name, key)}
    return tables


def _all_used(defaults: _Tables, used: set[tuple[str, str]], where: str) -> None:
    for table, settings in defaults.items():
        if table not in _TABLES:
            raise VfoaError(f"{where}: defaults.{table}: unknown table; {did_you_mean(table, _TABLES)}")
        for key in settings:
            if (table, key) not in used:
                raise VfoaError(f"{where}: defaults.{table}.{key}: no configuration's {table} has such a setting")


def _configuration(name: str, tables: _Tables, where: str) -> Configuration:
    choices = {slot.name: slot.parse(tables.get(slot.name, {}), where) for slot in SLOTS.values()}
    bayes = tables.get("attention", {}).get("method") == "bayes"
    models: dict[str, type[Settings]] = {**_ATTEND, **({"attention": BayesSettings} if bayes else {})}
    settings: dict[str, Any] = {
        key: parse(model, tables.get(key, {}), f"{where}: {key}") for key, model in models.items()
    }
    configuration = Configuration(
        name=name,
        choices=choices,
        reconstruction=parse(ReconstructionSettings, tables.get("reconstruction", {}), f"{where}: reconstruction"),
        attend=AttendSettings(**settings),
    )
    if configuration.is_in_region and configuration.reconstruction.stuff:
        raise VfoaError(
            f'{where}: stereo.region: found "needed", which leaves out stuff, and reconstruction.stuff = '
            f'{list(configuration.reconstruction.stuff)}; expected stereo.region = "frame"'
        )
    return configuration
