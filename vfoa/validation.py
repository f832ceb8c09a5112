"""Check plain values against a settings class. A mistake is reported in one line."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError

from vfoa.errors import VfoaError, did_you_mean

Model = TypeVar("Model", bound=BaseModel)
Owners = Callable[[str], Iterable[str]]

EXPECTED = {
    **dict.fromkeys(("bool_parsing", "bool_type"), "true or false"),
    **dict.fromkeys(("int_parsing", "int_type", "int_from_float"), "a whole number"),
    **dict.fromkeys(("float_parsing", "float_type"), "a number"),
    "string_type": "text",
    **dict.fromkeys(("tuple_type", "list_type"), "a list"),
    **dict.fromkeys(("dict_type", "model_type"), "a table"),
}
"""What pydantic expects, by the type of its error, in the words of a TOML file."""


def parse(
    model: type[Model],
    data: Any,
    where: str,
    table: str = "",
    siblings: Iterable[str] = (),
    owners: Owners | None = None,
) -> Model:
    """Check ``data`` against a model and return the model.

    Parameters
    ----------
    model
        Any pydantic model.
    data
        Values read from a file.
    where
        The start of the message, such as a file.
    table
        Where ``data`` stands in that file, put before the key: ``"source"`` makes ``source.scene``.
    siblings
        Other keys that the same table of the file may have: suggestions for a misspelt key.
    owners
        Gives the choices, such as ``attention.method = "cones"``, under which the table may have an unknown key.

    Raises
    ------
    VfoaError
        For one mistake (an unknown key first, since it often explains a missing one): where, the dotted key,
        what was found and what was expected.
    """
    try:
        return model.model_validate(data)
    except ValidationError as error:
        mistakes = sorted(error.errors(include_url=False), key=lambda mistake: mistake["type"] != "extra_forbidden")
        more = f" (and {len(mistakes) - 1} more)" if len(mistakes) > 1 else ""
        raise VfoaError(f"{where}: {_sentence(model, mistakes[0], table, siblings, owners)}{more}") from None


def _sentence(model: type[BaseModel], mistake: Any, table: str, siblings: Iterable[str], owners: Owners | None) -> str:
    """One pydantic error as ``key: expected and found``."""
    location, kind = tuple(part for part in mistake["loc"] if not _is_tag(part)), mistake["type"]
    path = (*([table] if table else []), *location)
    key = ".".join(map(str, path))
    prefix = f"{key}: " if key else ""
    if kind == "extra_forbidden":
        if owners and len(location) == 1 and (choices := " or ".join(owners(str(location[0])))):
            return f"unknown key {key!r}; it is a setting of {choices}"
        keys = _keys_beside(model, location) | set(siblings if len(location) == 1 else ())
        return f"unknown key {key!r}; {did_you_mean(str(location[-1]), keys)}"
    if kind == "missing":
        return f"{prefix}missing; it is required"
    return f"{prefix}{expected_and_found(mistake)}"


_TAG = re.compile(r"[a-z-]+\[.*\]")


def _is_tag(part: int | str) -> bool:
    """Whether a part of pydantic's location is no key: it names which type of a union it is about."""
    return isinstance(part, str) and _TAG.fullmatch(part) is not None


def expected_and_found(mistake: Any) -> str:
    """One pydantic error of a value in the words of a file: what was expected, and what was found."""
    if mistake["type"] == "value_error":  # our own validators raise it, and say what was found
        return str(mistake["ctx"]["error"])
    message = mistake["msg"].removeprefix("Input should be ")
    expected = f"expected {EXPECTED.get(mistake['type'], message)}" if message != mistake["msg"] else message
    return f"{expected}, found {_short(mistake['input'])}"


def _short(value: object) -> str:
    """Text of a value for a message; a long one is cut."""
    text = repr(value)
    return text if len(text) <= 200 else f"{text[:200]}..."


def _keys_beside(model: type[BaseModel], location: tuple[int | str, ...]) -> set[str]:
    """Keys that the table holding ``location`` may have.

    A part of the location that is no field (a key of a dict, an index, a tag of a union) keeps the same models.
    """
    models = {model}
    for part in location[:-1]:
        fields = [_named_fields(holder)[str(part)] for holder in models if part in _named_fields(holder)]
        models = {nested for field in fields for nested in _models_in(field)} or models
    return {name for holder in models for name in _named_fields(holder)}


def _named_fields(model: type[BaseModel]) -> dict[str, Any]:
    """The annotations of a model's fields by the name they have in a file."""
    return {field.alias or name: field.annotation for name, field in model.model_fields.items()}


def _models_in(annotation: Any) -> set[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return {annotation}
    return {model for argument in get_args(annotation) for model in _models_in(argument)}
