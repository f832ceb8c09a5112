"""Every setting of every stage and step: name, type, unit, default and meaning, from the settings classes."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from textwrap import dedent
from typing import Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from harness.pipeline.configuration import METHODS, OFF, STAGES, STEPS, TABLES
from vfoa.errors import check_known
from vfoa.registry import AUTO
from vfoa.settings import Settings

_UNITS = {unit: unit for unit in ("m", "cm", "px", "ms", "s", "frames", "bytes")}
_UNITS |= {"deg": "°", "hz": "Hz", "percent": "%"}
_LIMITS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤", "multiple_of": "a multiple of"}


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingDescription:
    """One setting. ``key`` is dotted, as after ``--set``; ``unit`` is empty for a number without one."""

    key: str
    type: str
    unit: str
    default: str
    meaning: str


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingsTable:
    """The settings of one choice of a stage, or of one step.

    ``table`` is the table of a configuration, ``choice`` the key and value that choose these settings (``matcher =
    "sgbm"``), empty if there is no choice.
    """

    table: str
    choice: str
    summary: str
    settings: tuple[SettingDescription, ...]

    @property
    def name(self) -> str:
        """The name of the choice: ``sgbm``."""
        return self.choice.partition(" = ")[2].strip('"')

    @property
    def title(self) -> str:
        """A heading: ``stereo, matcher = "sgbm"``."""
        return f"{self.table}, {self.choice}" if self.choice else self.table


def settings_tables(only: str | None = None) -> tuple[SettingsTable, ...]:
    """Return every table of settings, or those of one stage or step.

    Parameters
    ----------
    only
        A table (``stereo``), or a table and a choice (``stereo.sgbm``).

    Raises
    ------
    VfoaError
        If there is no such stage or choice; the message suggests the nearest one.
    """
    wanted, _, choice = (only or "").partition(".")
    if only:
        check_known(wanted, TABLES, "settings: no stage")
    tables = [settings_table for table in ([wanted] if only else TABLES) for settings_table in _tables_of(table)]
    if choice:
        named = {settings_table.name: settings_table for settings_table in tables}
        check_known(choice, named, f"settings: {wanted}: no")
        tables = [named[choice]]
    return tuple(tables)


def choice_names() -> list[str]:
    """Every argument of :func:`settings_tables` that names one choice of a stage or step: ``stereo.sgbm``."""
    return [
        f"{settings_table.table}.{settings_table.name}" for settings_table in settings_tables() if settings_table.name
    ]


def setting_keys() -> list[str]:
    """Every dotted key that ``--set`` takes, sorted."""
    choices = {*(f"{slot.name}.{slot.key}" for slot in STAGES.values()), "attention.method"}
    return sorted(choices | {setting.key for table in settings_tables() for setting in table.settings})


def _tables_of(table: str) -> Iterator[SettingsTable]:
    if table in STAGES:
        slot = STAGES[table]
        if slot.library.choose:
            choice = f'{slot.key} = "{AUTO}"'
            yield SettingsTable(table=table, choice=choice, summary=_summary(slot.library.choose), settings=())
        for name in slot.names():
            if name != OFF:
                stage = slot.stage_class(name)
                yield _describe(table, f'{slot.key} = "{name}"', stage.Settings, _summary(stage))
    elif table == "attention":
        for method in METHODS.builtin_first():
            yield _describe(table, f'method = "{method}"', METHODS.load(method).Settings, "")
    else:
        yield _describe(table, "", STEPS[table], "")


def _summary(documented: object) -> str:
    """The first sentence of a docstring."""
    return _plain(re.split(r"(?<=\.)\s", inspect.getdoc(documented) or "", maxsplit=1)[0])


def _describe(table: str, choice: str, model: type[Settings], summary: str) -> SettingsTable:
    chosen = choice.partition(" = ")[0]
    fields = {name: field for name, field in model.model_fields.items() if name != chosen}
    meanings = _meanings(model)
    return SettingsTable(
        table=table,
        choice=choice,
        summary=summary,
        settings=tuple(
            SettingDescription(
                key=f"{table}.{name}",
                type=_type(field.annotation, field.metadata),
                unit=_UNITS.get(name.rpartition("_")[2], "") if "_" in name else "",
                default="(required)" if field.is_required() else _value(field.get_default(call_default_factory=True)),
                meaning=_plain(field.description or meanings.get(name, "")),
            )
            for name, field in fields.items()
        ),
    )


@cache
def _meanings(model: type[Settings]) -> dict[str, str]:
    """The docstrings below the fields of a class and of its bases, by field.

    They are read here, and not by pydantic when a class is made: that takes a fifth of the start of every process.
    """
    meanings: dict[str, str] = {}
    for base in reversed(model.__bases__):
        if issubclass(base, Settings):
            meanings |= _meanings(base)
    with suppress(OSError, TypeError, SyntaxError):  # a class of another distribution may come without its source
        definition = ast.parse(dedent(inspect.getsource(model))).body[0]
        for field, below in pairwise(ast.iter_child_nodes(definition)):
            match field, below:
                case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                    meanings[name] = inspect.cleandoc(text)
    return meanings


def _value(value: Any) -> str:
    """A value in TOML, tables inside a table left out; "not set" for a null."""
    if value is None:
        return "(not set)"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple | list):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, BaseModel):
        cells = (f"{key} = {'...' if isinstance(item, BaseModel) else _value(item)}" for key, item in value)
        return "{ " + ", ".join(cells) + " }"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _type(annotation: Any, metadata: list[Any]) -> str:
    """A type in words, with its limits: ``number > 0``, ``"full" or "half"``."""
    origin = get_origin(annotation)
    if annotation.__class__.__name__ == "_AnnotatedAlias":
        inner, *more = get_args(annotation)
        nested = [limit for extra in more for limit in (extra.metadata if isinstance(extra, FieldInfo) else [extra])]
        return _type(inner, [*nested, *metadata])
    if origin is Literal:
        return " or ".join(_value(literal) for literal in get_args(annotation))
    if origin in (Union, type(int | str)):
        return " or ".join(_type(member, metadata) for member in get_args(annotation) if member is not type(None))
    if origin is tuple:
        return f"list of {_type(get_args(annotation)[0], [])}"
    if origin is dict:
        return f"table of names, each a {_type(get_args(annotation)[1], [])}"
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return f"table of {', '.join(annotation.model_fields)}"
    words = {int: "integer", float: "number", str: "text", bool: "true or false"}
    limits = [
        f"{sign} {getattr(limit, name):g}"
        for limit in metadata
        for name, sign in _LIMITS.items()
        if isinstance(getattr(limit, name, None), int | float)
    ]
    return " ".join([words.get(annotation, str(annotation)), ", ".join(limits)]).strip()


def _plain(text: str) -> str:
    """Return text without the mark-up of docstrings, on one line."""
    text = re.sub(r":\w+:`~?(?:[\w.]*\.)?([\w]+)`", r"\1", text)
    return " ".join(text.replace("``", "").split())
