"""Settings as tables, made into the steps after perception: one place for ``vfoa run`` and for scripts."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from typing import Any

from vfoa.attention import AttentionSettings
from vfoa.bayes import BayesSettings
from vfoa.errors import VfoaError, did_you_mean
from vfoa.gaze_filter import GazeFilterSettings
from vfoa.logit import LogitSettings
from vfoa.nearest import NearestSettings
from vfoa.pipeline import AttendSettings
from vfoa.reconstruction import ReconstructionSettings
from vfoa.settings import Settings
from vfoa.tracking import TrackingSettings
from vfoa.validation import parse

Tables = Mapping[str, Mapping[str, Any]]
"""Settings by key, by the name of the table."""

STEPS: Mapping[str, Mapping[str, type[Settings]]] = {
    "reconstruction": {"": ReconstructionSettings},
    "tracking": {"": TrackingSettings},
    "gaze_filter": {"": GazeFilterSettings},
    "attention": {
        "cones": AttentionSettings,
        "bayes": BayesSettings,
        "logit": LogitSettings,
        "nearest": NearestSettings,
    },
}
"""The steps after perception: the settings classes of each by its ``method``, which only attention has. The first is
the default."""


def dotted_tables(changes: Iterable[tuple[str, Any]], tables: Collection[str], where: str) -> dict[str, dict[str, Any]]:
    """Convert settings by dotted key to tables.

    Raises
    ------
    VfoaError
        If a key has no dot, or its table is not one of ``tables``; ``where`` opens the message, here and below.
    """
    by_table: dict[str, dict[str, Any]] = {}
    for dotted, value in changes:
        table, dot, key = dotted.partition(".")
        if not dot:
            raise VfoaError(f"{where}: {dotted}: expected a dotted key, such as stereo.matcher")
        if table not in tables:
            raise VfoaError(f"{where}: {dotted}: unknown table; {did_you_mean(table, tables)}")
        by_table.setdefault(table, {})[key] = value
    return by_table


def step_settings(step: str, table: Mapping[str, Any]) -> type[Settings]:
    """The settings class of a step: that of its ``method``, else the default one, which rejects a wrong method."""
    default, *_ = STEPS[step].values()
    return STEPS[step].get(str(table.get("method")), default)


def read_steps(tables: Tables, stereo: Settings | None, where: str) -> tuple[ReconstructionSettings, AttendSettings]:
    """Read the tables of the steps, which must fit the settings of the matcher, ``stereo``.

    Raises
    ------
    VfoaError
        If a key or a value is wrong, or stuff is to be reconstructed where the matcher leaves it out.
    """
    steps: dict[str, Any] = {
        step: parse(step_settings(step, tables.get(step, {})), tables.get(step, {}), where, step) for step in STEPS
    }
    reconstruction: ReconstructionSettings = steps.pop("reconstruction")
    if is_in_region(stereo) and reconstruction.stuff:
        raise VfoaError(
            f'{where}: stereo.region: found "needed", which leaves out stuff, and reconstruction.stuff = '
            f'{list(reconstruction.stuff)}; expected stereo.region = "frame"'
        )
    return reconstruction, AttendSettings(**steps)


def is_in_region(stereo: Settings | None) -> bool:
    """Whether a matcher with these settings is asked only for the disparities of things and heads."""
    return getattr(stereo, "region", None) == "needed"
