"""Logs of passing records, kept in parts: a run is scored again from the parts that have not changed."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import fields, is_dataclass
from typing import Any, Generic, TypeVar

from harness.run.directory import Pair
from harness.run.records import FrameRecord

P = TypeVar("P")


class PartLog(ABC, Generic[P]):
    """What a log takes from records: a part, of plain values, for each clip and configuration."""

    def __init__(self, new: Callable[[], P]) -> None:
        self._new = new
        self.parts: dict[Pair, P] = {}

    def part(self, clip: str, configuration: str) -> P:
        """The part of a configuration on a clip so far."""
        pair = clip, configuration
        if pair not in self.parts:
            self.parts[pair] = self._new()
        return self.parts[pair]

    @abstractmethod
    def take(self, record: FrameRecord) -> None:
        """Add a record."""

    def watch(self, records: Iterable[FrameRecord]) -> Iterator[FrameRecord]:
        """Yield the records unchanged and take them."""
        for record in records:
            self.take(record)
            yield record

    def add(self, clip: str, configuration: str, part: P) -> None:
        """Add a part of another log."""
        _merge(self.part(clip, configuration), part)


def _merge(ours: Any, more: Any) -> None:
    """Extend lists and bytes, dictionaries by key, and dataclasses by field; of two other values the first stays."""
    if isinstance(ours, list | bytearray):
        ours.extend(more)
    elif isinstance(ours, dict):
        for key, value in more.items():
            if key in ours:
                _merge(ours[key], value)
            else:
                ours[key] = value
    elif is_dataclass(ours):
        for field in fields(ours):
            _merge(getattr(ours, field.name), getattr(more, field.name))
