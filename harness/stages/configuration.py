"""A configuration: every setting of one way to run the pipeline, made of tables of settings.

A table belongs to one stage (:data:`harness.stages.stages.STAGES`) or one step. An experiment gives tables as defaults,
presets and differences; each overrides the ones before it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

from harness.stages.stages import DRAWN, STAGES, StageChoice
from vfoa import config
from vfoa.config import Tables, is_in_region, read_steps, step_settings
from vfoa.drawn import DrawnSettings
from vfoa.errors import VfoaError, did_you_mean
from vfoa.logit import LogitSettings
from vfoa.pipeline import AttendSettings
from vfoa.reconstruction import ReconstructionSettings
from vfoa.settings import Settings
from vfoa.validation import parse

if TYPE_CHECKING:
    from vfoa.onnx import Provider

STEPS: Mapping[str, Mapping[str, type[Settings]]] = {"drawn": {"": DrawnSettings}, **config.STEPS}
"""Drawn shapes and the steps after perception, as in :data:`vfoa.config.STEPS`."""

TABLES = (*STAGES, *STEPS)
"""The tables of a configuration: the stages in the order of the pipeline, then the steps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Configuration:
    """Every setting of one way to run the pipeline. ``choices`` has one entry per slot, None for one switched off.

    ``factors`` are the labels of its place in a grid by dotted key; empty without a grid. ``drawn`` is switched on for
    the stages that are ``"drawn"``.
    """

    name: str
    choices: Mapping[str, StageChoice | None]
    reconstruction: ReconstructionSettings
    attend: AttendSettings
    drawn: DrawnSettings = field(default_factory=DrawnSettings)
    factors: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_in_region(self) -> bool:
        """Whether the matcher is asked only for the disparities of things and heads."""
        stereo = self.choices["stereo"]
        return stereo is not None and is_in_region(stereo.settings)

    @property
    def uses_drawn(self) -> bool:
        """Whether any drawn shapes of a clip are used."""
        return self.drawn.targets or self.drawn.heads

    def for_clip(self, clip: str) -> Configuration:
        """Return the configuration with the clip's name in a stage's ``root``, and with the clip's own weights."""
        choices = {slot: choice.for_clip(clip) if choice else None for slot, choice in self.choices.items()}
        attention = self.attend.attention
        if isinstance(attention, LogitSettings):
            attention = attention.for_clip(clip)
        return replace(self, choices=choices, attend=self.attend.model_copy(update={"attention": attention}))

    def on(self, provider: Provider) -> Configuration:
        """Return the configuration with all its networks on one provider of ONNX Runtime."""
        choices = {slot: choice.on(provider) if choice else None for slot, choice in self.choices.items()}
        return replace(self, choices=choices)

    def without_images(self) -> Configuration:
        """Return the configuration for clips of recorded 3D poses: only stages that answer from a person's truth."""
        choices = {
            slot: choice if choice and STAGES[slot].is_true(choice) else None for slot, choice in self.choices.items()
        }
        return replace(self, choices=choices)

    def plain(self) -> dict[str, Any]:
        """Return the configuration as JSON values, with every default, as a run's manifest records it."""
        stages = {name: choice.plain() if choice else None for name, choice in self.choices.items()}
        attend = self.attend.model_dump(mode="json")
        drawn = self.drawn.model_dump(mode="json")
        return {**stages, "drawn": drawn, "reconstruction": self.reconstruction.model_dump(mode="json"), **attend}


def merged(tables: Tables, over: Tables) -> Tables:
    """Return the tables with ``over`` over them, key by key."""
    return {table: {**tables.get(table, {}), **over.get(table, {})} for table in {**tables, **over}}


def inherited(defaults: Tables, own: Tables) -> Tables:
    """Return the defaults that a configuration inherits: a stage inherits only the settings that it has."""
    tables = {}
    for table, settings in defaults.items():
        slot = STAGES.get(table)
        name = {**settings, **own.get(table, {})}.get(slot.key) if slot else None
        tables[table] = {key: value for key, value in settings.items() if slot is None or slot.takes(name, key)}
    return tables


def takes(tables: Tables, dotted: str) -> bool:
    """Whether the stage or step that these tables select has the setting ``table.key``."""
    table, _, key = dotted.partition(".")
    settings = tables.get(table, {})
    if slot := STAGES.get(table):
        return slot.takes(settings.get(slot.key), key)
    if table not in STEPS:
        return False
    model = DrawnSettings if table == "drawn" else step_settings(table, settings)
    return key == "method" or key in model.model_fields


def check_all_used(defaults: Tables, used: set[tuple[str, str]], where: str) -> None:
    """Reject a default, as (table, key), that no configuration has ``used``: it is probably misspelt.

    Raises
    ------
    VfoaError
        With its table and key.
    """
    for table, settings in defaults.items():
        if table not in TABLES:
            raise VfoaError(f"{where}: defaults.{table}: unknown table; {did_you_mean(table, TABLES)}")
        for key in settings:
            if (table, key) not in used:
                raise VfoaError(f"{where}: defaults.{table}.{key}: no configuration's {table} has such a setting")


def make_configuration(name: str, tables: Tables, factors: Mapping[str, str], where: str) -> Configuration:
    """Check the tables of one configuration, and fill in the defaults.

    Raises
    ------
    VfoaError
        If a stage, a key or a value is wrong, or two of them cannot be combined.
    """
    choices = {slot.name: slot.parse(tables.get(slot.name, {}), where) for slot in STAGES.values()}
    stereo = choices["stereo"]
    reconstruction, attend = read_steps(tables, stereo.settings if stereo else None, where)
    drawn = _switched_on(parse(DrawnSettings, tables.get("drawn", {}), where, "drawn"), choices)
    return Configuration(
        name=name, choices=choices, drawn=drawn, reconstruction=reconstruction, attend=attend, factors=factors
    )


def _switched_on(drawn: DrawnSettings, choices: Mapping[str, StageChoice | None]) -> DrawnSettings:
    """Switch on the drawn shapes of a stage that uses nothing else, whatever the table ``drawn`` says."""
    alone = {slot for slot, choice in choices.items() if choice is not None and choice.name == DRAWN}
    on = {"targets": drawn.targets or "segmentation" in alone, "heads": drawn.heads or "heads" in alone}
    return drawn.model_copy(update=on)
