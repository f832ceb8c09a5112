"""What the recordings of several configurations show alike of a frame is made once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")

_last: dict[object, tuple[tuple[object, ...], Any]] = {}


def once(make: Callable[..., T], *inputs: object) -> T:
    """Return ``make(*inputs)``; for the very same inputs as the last time, what it made then.

    Text and bytes count by value, all else by identity: configurations that agree on a stage are given its very output.
    """
    known = _last.get(make)
    if known is None or not all(_same(*pair) for pair in zip(known[0], inputs, strict=True)):
        _last[make] = known = (inputs, make(*inputs))
    made: T = known[1]
    return made


def _same(one: object, other: object) -> bool:
    return one is other or (isinstance(one, str | bytes) and one == other)
