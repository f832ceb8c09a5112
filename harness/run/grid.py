"""The configurations of an experiment: combinations of a grid or a list of named ones, each under one or more seeds."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import TYPE_CHECKING, Any

from harness.files.parsing import flattened
from vfoa.errors import VfoaError

if TYPE_CHECKING:
    from harness.pipeline.configuration import Configuration, StageChoice

PRESET = "preset"
"""The only key of a configuration, beside its name, that is not in a table."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9.+_-]*")
ORACLE_STEPS = ("disparity", "instances", "heads", "head_pose", "gaze")
"""What the ground truth can replace, in the order of the pipeline: ``sgbm-one+disparity`` is a step of the ablation."""
OF_LAYERS = ("scene", "verdicts")
"""Ends of names of a recording's files after its configuration's name (:class:`harness.record.layers.ClipFiles`)."""
_MADE_NAMES = (("+", ORACLE_STEPS, "--oracle makes such a step"), (".", OF_LAYERS, "its recording has such a file"))
_SEED = re.compile(r"\.seed\d+(?=\+|$)")


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """A configuration's name, its place in the grid, its differences from the defaults, and its preset."""

    name: str
    factors: Mapping[str, str]
    differences: tuple[tuple[str, Any], ...]
    preset: str | None


def variants(
    grid: Mapping[str, Any],
    configurations: Sequence[Mapping[str, Any]],
    where: str,
    is_setting: Callable[[str, str], bool],
) -> list[Variant]:
    """Return every combination of a grid, or every named configuration.

    ``is_setting`` says whether a table can have a setting.

    Raises
    ------
    VfoaError
        If both are given, or a name or an axis is wrong; ``where`` opens the message.
    """
    if grid and configurations:
        raise VfoaError(f"{where}: expected either [grid] or [[configuration]], found both")
    found = [*(_named(configurations, where) if configurations else _combined(grid, where, is_setting))]
    names: dict[str, str] = {}  # by their form in files: macOS and Windows have one file for A and a
    for name in (each.name for each in found):
        if (other := names.get(name.lower())) is not None:
            raise VfoaError(
                f"{where}: configuration {name!r}: expected another name beside {other!r}, different in more than "
                "capitals; values of a grid can have names: { one = [10], two = [10, 25] }"
            )
        names[name.lower()] = name
    for form, name in names.items():
        if base_of(form) != form:
            raise VfoaError(
                f"{where}: configuration {name!r}: expected no name of a seed: seeds = 20 makes and names them"
            )
        for sign, ends, what in _MADE_NAMES:
            before, _, end = form.rpartition(sign)
            if before in names and end in ends:
                beside = f"expected another name beside {names[before]!r}: {what}"
                raise VfoaError(f"{where}: configuration {name!r}: {beside}")
    return found


def _combined(grid: Mapping[str, Any], where: str, is_setting: Callable[[str, str], bool]) -> Iterator[Variant]:
    axes = [_alternatives(key, values, where) for key, values in _dotted(grid, where, is_setting)]
    for combination in itertools.product(*axes):
        name = "-".join(label for label, _, _ in combination) or "default"
        factors = {key: label for label, key, _ in combination}
        differences = (difference for _, key, value in combination for difference in flattened({key: value}))
        yield _variant(name, where, factors, differences)


def _named(configurations: Sequence[Mapping[str, Any]], where: str) -> Iterator[Variant]:
    for number, table in enumerate(configurations, start=1):
        name = table.get("name")
        if not isinstance(name, str):
            raise VfoaError(f"{where}: [[configuration]] number {number}: expected a name, found {name!r}")
        yield _variant(name, where, {}, flattened({key: value for key, value in table.items() if key != "name"}))


def _variant(name: str, where: str, factors: Mapping[str, str], differences: Iterable[tuple[str, Any]]) -> Variant:
    if not _NAME.fullmatch(name):
        raise VfoaError(f"{where}: configuration {name!r}: expected a name of letters, digits and . + _ - alone")
    others = dict(differences)
    preset = others.pop(PRESET, None)
    return Variant(name=name, factors=factors, differences=tuple(others.items()), preset=preset)


def _dotted(grid: Mapping[str, Any], where: str, is_setting: Callable[[str, str], bool]) -> Iterator[tuple[str, Any]]:
    """Key and values of each axis: without quotes, TOML reads ``attention.cones_cm`` as a table in a table."""
    for key, values in grid.items():
        inner = values if "." not in key and isinstance(values, dict) else {}
        settings = [name for name, value in inner.items() if not _is_named_table(key, name, value, is_setting)]
        if not settings:
            yield key, values
        elif len(settings) == len(inner):
            yield from ((f"{key}.{name}", value) for name, value in inner.items())
        else:
            raise VfoaError(
                f"{where}: grid.{key}: expected settings with their values, or named tables of settings; found both, "
                f"such as {settings[0]!r} and {next(name for name in inner if name not in settings)!r}"
            )


def _is_named_table(table: str, name: str, value: Any, is_setting: Callable[[str, str], bool]) -> bool:
    """Whether ``name`` is a label for a table of settings; otherwise it is the key of a setting."""
    if not isinstance(value, dict):
        return False
    return any(is_setting(table, key) for key in value) or not is_setting(table, name)


def _alternatives(key: str, values: Any, where: str) -> list[tuple[str, str, Any]]:
    """(label, dotted key, value) for each alternative of one axis of the grid."""
    if isinstance(values, list) and values:
        return [(_label(value), key, value) for value in values]
    if isinstance(values, dict) and values:
        return [(label, key, value) for label, value in values.items()]
    raise VfoaError(f"{where}: grid.{key}: expected a list of values or a table of named values, found {values!r}")


def _label(value: Any) -> str:
    """The label of a value without a name; the values of a list are joined, so that ``[10, 25]`` is ``10_25``."""
    return "_".join(map(str, value)) if isinstance(value, list) else str(value)


def repeated(configuration: Configuration, seeds: int, where: str) -> Iterator[Configuration]:
    """Yield the configuration under this many seeds, its own and the next ones, named ``sgbm-two.seed1`` and so on.

    Stages without a seed are the same in all of them, so that their outputs are computed once and shared.

    Raises
    ------
    VfoaError
        If no stage has a seed; ``where`` opens the message.
    """
    first_seeds = {
        choice.slot: int(seed)
        for choice in configuration.stages
        if (seed := getattr(choice.settings, "seed", None)) is not None
    }
    if not first_seeds:
        raise VfoaError(
            f"{where}: seeds: found {seeds}, but configuration {configuration.name!r} has no simulated stage; expected "
            'gaze.model = "simulated" or head_pose.model = "simulated"'
        )
    for step in range(seeds):
        seeds_now = {slot: seed + step for slot, seed in first_seeds.items()}
        name = f"{configuration.name}.seed{min(seeds_now.values())}"
        yield replace(configuration.changed(partial(_with_seed, seeds_now)), name=name)


def _with_seed(seeds: Mapping[str, int], choice: StageChoice) -> StageChoice:
    return choice.updated({"seed": seeds[choice.slot]}) if choice.slot in seeds else choice


@cache
def base_of(name: str) -> str:
    """The name of the configuration that this one repeats under another seed; its own name otherwise."""
    return _SEED.sub("", name)


def is_meant(configuration: str, name: str | None) -> bool:
    """Whether a name is that of a configuration or of the one that it repeats under a seed; None is any."""
    return name in (None, configuration, base_of(configuration))
