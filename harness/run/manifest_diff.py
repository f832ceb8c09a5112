"""In what a run that stands somewhere is another one than that which is wanted there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

MOST = 3
"""This many differences are named; the others are counted."""

_FOLLOWS = "times_ns"
"""Differs wherever a clip's frames do."""


def differences(found: Mapping[str, Any], wanted: Mapping[str, Any]) -> str:
    """Differences of a run's manifest from ``wanted``, in words; "" if nothing: ``attention.n_rays, versions.numpy``.

    Keys that ``wanted`` does not have do not count.
    """
    every = list(dict.fromkeys(_differing(found, wanted)))
    more = f" and {len(every) - MOST} more" if len(every) > MOST else ""
    return f"{', '.join(every[:MOST])}{more}"


def _differing(found: Mapping[str, Any], wanted: Mapping[str, Any]) -> Iterator[str]:
    for key, value in wanted.items():
        if found.get(key) != value:
            yield from _within(key, _named(found.get(key)), _named(value)) or [key]


def _within(key: str, found: Any, wanted: Any) -> list[str]:
    """Differences within one key: leaves of clips with the clip, of configurations without, as they mostly share."""
    if key not in ("clips", "configurations"):
        return list(_leaves(found, wanted, key))
    if not isinstance(found, dict) or list(found) != list(wanted):
        return [key]
    leaves = [(name, list(_leaves(found[name], wanted[name]))) for name in wanted]
    if key == "configurations":
        return [leaf for _, each in leaves for leaf in each]
    return [f"{leaf} of {name}" for name, each in leaves for leaf in each if leaf != _FOLLOWS or "frames" not in each]


def _named(value: Any) -> Any:
    """A list of clips by their names; other values unchanged."""
    return {each["name"]: each for each in value} if isinstance(value, list) and value and "name" in value[0] else value


def _leaves(found: Any, wanted: Any, path: str = "") -> Iterator[str]:
    """The dotted keys, below ``path``, under which two values differ."""
    if found == wanted:
        return
    if not isinstance(found, dict) or not isinstance(wanted, dict):
        yield path
        return
    for key in dict.fromkeys((*wanted, *found)):
        yield from _leaves(found.get(key), wanted.get(key), f"{path}.{key}" if path else key)
