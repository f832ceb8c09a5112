"""Lists of changes to undo and redo, with the times of making and undoing: by these, two stores are undone as one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Generic, Self, TypeVar

Change = TypeVar("Change")


def time_of(entry: Mapping[str, Any]) -> float:
    """The time at which a journal entry was made, in seconds since 1970; 0 for an entry of an older version."""
    return float(entry.get("time_s", 0.0))


@dataclass(frozen=True, slots=True)
class _Made(Generic[Change]):
    change: Change
    made_s: float
    undone_s: float = 0.0


class Undo(Generic[Change]):
    """Changes that were made, the last one on top, and those that were undone. Times are seconds since 1970."""

    def __init__(self) -> None:
        self._done: list[_Made[Change]] = []
        self._undone: list[_Made[Change]] = []

    def make(self, change: Change, time_s: float) -> None:
        """Add a new change; nothing can be redone after it."""
        self._done.append(_Made(change, time_s))
        self._undone.clear()

    def undo(self, time_s: float) -> Change:
        """Take the last change back and return it (IndexError if there is none)."""
        last = self._done.pop()
        self._undone.append(replace(last, undone_s=time_s))
        return last.change

    def redo(self) -> Change:
        """Apply the last undone change again and return it (IndexError if there is none)."""
        last = self._undone.pop()
        self._done.append(last)
        return last.change

    @property
    def next_undo(self) -> Change | None:
        """The change that is undone next."""
        return self._done[-1].change if self._done else None

    @property
    def next_redo(self) -> Change | None:
        """The change that is made again next."""
        return self._undone[-1].change if self._undone else None

    def clear(self) -> None:
        """Forget all changes: nothing can be undone or redone."""
        self._done.clear()
        self._undone.clear()

    def copy(self) -> Self:
        """Return an independent copy."""
        copied = type(self)()
        copied._done, copied._undone = list(self._done), list(self._undone)
        return copied

    def plain(self) -> dict[str, Any]:
        """As JSON: whether undo and redo are possible, and when their changes were made and undone."""
        made, undone = self._done[-1:], self._undone[-1:]
        return {
            "can_undo": bool(made),
            "can_redo": bool(undone),
            "made_s": made[0].made_s if made else None,
            "undone_s": undone[0].undone_s if undone else None,
        }

    def __bool__(self) -> bool:
        """Whether anything can be undone."""
        return bool(self._done)

    @property
    def can_redo(self) -> bool:
        """Whether anything can be redone."""
        return bool(self._undone)
