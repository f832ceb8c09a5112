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

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import Field

from harness.clips.locate import find, names
from harness.config_errors import parse, read_toml
from harness.runs.configuration import (
    Configuration,
    check_all_used,
    dotted_tables,
    inherited,
    make_configuration,
    merged,
)
from harness.runs.presets import preset_tables
from harness.runs.published import Published
from harness.runs.variants import variants
from harness.toml_text import parse_assignment
from vfoa.errors import VfoaError, did_you_mean
from vfoa.settings import Settings


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
    where = " --set ".join((where, *overrides))
    chosen = clips or file.clips
    if not chosen:
        raise VfoaError(f"{where}: clips: expected at least one clip, found none")
    changes = [parse_assignment(text, "stereo.matcher=sgbm") for text in overrides]
    _check_sweep(file, where)
    configurations = _configurations(file, changes, preset, where)
    _check_published(file, [each.name for each in configurations], where)
    return Experiment(
        name=path.stem,
        clips=chosen,
        configurations=configurations,
        notes=file.notes,
        annotator=file.annotator,
        sweep=file.sweep,
        published=file.published,
    )


def _configurations(
    file: _File, changes: list[tuple[str, Any]], preset: str | None, where: str
) -> tuple[Configuration, ...]:
    """Every variant of the file, with the changes made in each; what it does not say is inherited."""
    found = []
    used: set[tuple[str, str]] = set()
    for variant in variants(file.grid, file.configuration, where):
        own = dotted_tables([*variant.differences, *changes], where)
        used |= {(table, key) for table, settings in inherited(file.defaults, own).items() for key in settings}
        bundle = preset_tables(preset or variant.preset or file.preset, where)
        tables = merged(inherited(merged(file.defaults, bundle), own), own)
        of_variant = f"{where}: configuration {variant.name!r}"
        found.append(make_configuration(variant.name, tables, variant.factors, of_variant))
    check_all_used(file.defaults, used, where)
    return tuple(found)


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
