"""Settings as tables, made into the steps after perception: one place for ``vfoa run`` and for scripts."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from functools import partial
from typing import Any

from vfoa.errors import VfoaError, did_you_mean, located
from vfoa.gaze_filter import GazeFilterSettings
from vfoa.methods import DEFAULT_METHOD, METHODS, MethodSettings, look_ahead_s, open_method
from vfoa.pipeline import AttendSettings
from vfoa.reconstruction import ReconstructionSettings
from vfoa.registry import Registry
from vfoa.settings import Settings
from vfoa.tracking import TrackingSettings
from vfoa.validation import parse

Tables = Mapping[str, Mapping[str, Any]]
"""Settings by key, by the name of the table."""

STEPS: Mapping[str, type[Settings]] = {
    "reconstruction": ReconstructionSettings,
    "tracking": TrackingSettings,
    "gaze_filter": GazeFilterSettings,
    "attention": MethodSettings,
}
"""The steps after perception, with the settings class of each; attention has that of its ``method``."""

METHOD_OF_CLIP = {"attention.method": "logit"}
"""The method of ``vfoa run CLIP``."""


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


def _method_class(table: Mapping[str, Any], methods: Registry, where: str) -> Any:
    """Return the class of the method that a table of attention names; without a name, the default one.

    Raises
    ------
    VfoaError
        If there is no such method.
    """
    with located(where):
        return methods.load(str(table.get("method", DEFAULT_METHOD)))


def read_steps(
    tables: Tables, stereo: Settings | None, where: str, *, methods: Registry = METHODS
) -> tuple[ReconstructionSettings, AttendSettings]:
    """Read the tables of the steps, which must fit the settings of the matcher, ``stereo``.

    ``methods`` are those that the table of attention may name.

    Raises
    ------
    VfoaError
        If a key or a value is wrong, or stuff is to be reconstructed where the matcher leaves it out.
    """
    models = {**STEPS, "attention": _method_class(tables.get("attention", {}), methods, where).Settings}
    owners = {"attention": partial(methods.choices_with, "attention.method")}
    steps: dict[str, Any] = {
        step: parse(model, tables.get(step, {}), where, step, owners=owners.get(step)) for step, model in models.items()
    }
    reconstruction: ReconstructionSettings = steps.pop("reconstruction")
    if is_in_region(stereo) and reconstruction.stuff:
        raise VfoaError(
            f'{where}: stereo.region: found "needed", which leaves out stuff, and reconstruction.stuff = '
            f'{list(reconstruction.stuff)}; expected stereo.region = "frame"'
        )
    return reconstruction, AttendSettings(**steps)


def is_in_region(stereo: Settings | None) -> bool:
    """Whether a matcher with these settings is asked only for the disparities of objects and heads."""
    return getattr(stereo, "region", None) == "needed"


def check_immediate(settings: AttendSettings) -> None:
    """Refuse (:class:`VfoaError`) a method that needs later frames."""
    name, seconds = settings.attention.method, look_ahead_s(open_method(settings.attention))
    if seconds:
        raise VfoaError(
            f"settings: attention.method: {name!r} needs {seconds:g} s of later frames with these settings; expected "
            "settings that need none, such as attention.smoothing = 'forward' (`vfoa run` waits for later frames)"
        )
