"""What a run took from the cache, what it computed, and why."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from harness.cache.identity import Identity, difference
from harness.cache.stage import Tally
from harness.cache.store import Store


@dataclass(slots=True)
class _Entry:
    """A stage on a clip: why it had no results when the run began (None: it had some), and how the cache served."""

    identity: Identity
    absent: str | None
    tally: Tally = field(default_factory=Tally)


class Account:
    """Counts by clip and stage. A stage must be opened before anything is computed: then it is known what there was."""

    def __init__(self) -> None:
        self._entries: dict[tuple[str, str], _Entry] = {}

    def open(self, clip: str, key: str, identity: Identity, store: Store) -> None:
        """Look what there is of a stage, by its key, on a clip."""
        stored = store.folder(identity.slot, identity.digest).exists()
        absent = None if stored else difference(identity.parts, store.described(identity.slot))
        self._entries[clip, key] = _Entry(identity, absent)

    def add(self, clip: str, tallies: Mapping[str, Tally]) -> None:
        """Count what a job took and computed, by the keys of its stages."""
        for key, tally in tallies.items():
            self._entries[clip, key].tally |= tally

    def rows(self) -> list[dict[str, Any]]:
        """A row a stage and clip, as it stands in the run's manifest; ``why`` something was computed, None: nothing."""
        return [
            {
                "clip": clip,
                "slot": entry.identity.slot,
                "stage": entry.identity.parts["stage"],
                "reused": len(entry.tally.found - entry.tally.computed),
                "computed": len(entry.tally.computed),
                "damaged": len(entry.tally.damaged),
                "why": _why(entry),
            }
            for (clip, _key), entry in self._entries.items()
        ]


def _why(entry: _Entry) -> str | None:
    if not entry.tally.computed:
        return None
    if entry.tally.computed == entry.tally.damaged:
        return "damaged"
    return entry.absent or "not stored so far, or removed"


def cache_lines(rows: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """The rows in words: a line for each stage and reason, over all clips."""
    sums: dict[tuple[str, str, str | None], tuple[int, int]] = {}
    for row in rows:
        key = row["slot"], row["stage"], row["why"]
        reused, computed = sums.get(key, (0, 0))
        sums[key] = reused + row["reused"], computed + row["computed"]
    for (slot, stage, why), (reused, computed) in sums.items():
        reason = f" ({why})" if why else ""
        yield f"Cache: {slot} {stage}: {reused} reused, {computed} computed{reason}"
