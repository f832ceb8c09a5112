"""The cached outputs of the stages on one clip, and the account of what a run reused and computed."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from harness.sources import Clip
from harness.stages.cache.identity import Identity, Source, difference, identify
from harness.stages.cache.store import Store
from harness.stages.cache.values import content_digest, decode, encode
from harness.stages.configuration import Configuration
from harness.stages.slots import StageChoice
from vfoa.errors import VfoaError
from vfoa.types import StereoFrame

_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Tally:
    """The outputs of one stage that were found, computed, and found damaged, by the names of their files."""

    found: set[str] = field(default_factory=set)
    computed: set[str] = field(default_factory=set)
    damaged: set[str] = field(default_factory=set)

    def __or__(self, other: Tally) -> Tally:
        return Tally(self.found | other.found, self.computed | other.computed, self.damaged | other.damaged)

    def take(self) -> Tally:
        """Return all counts so far, and reset them."""
        taken = Tally() | self
        for names in (self.found, self.computed, self.damaged):
            names.clear()
        return taken


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipCache:
    """The cache for a job on one clip: the store, and the identity of each stage. It is pickled to other processes."""

    store: Store
    identities: Mapping[str, Identity]

    def outputs_of(self, choice: StageChoice, tallies: dict[str, Tally]) -> StoredOutputs | None:
        """Return the stored outputs of a stage; None for a stage that is not cached. Counts go to ``tallies``."""
        identity = self.identities.get(choice.key)
        if identity is None:
            return None
        return StoredOutputs(store=self.store, identity=identity, tally=tallies.setdefault(choice.key, Tally()))

    def lacking(self, frames: Iterable[int]) -> list[int]:
        """The frames with outputs that are not stored, as far as known before anything is read."""
        alone = [
            each
            for each in self.identities.values()
            if each.slot == "segmentation" or (each.slot == "stereo" and not each.is_in_region)
        ]
        stored = [self.store.names(each.slot, each.digest) for each in alone]
        return [frame for frame in frames if not stored or not all(_file_name(frame, ()) in each for each in stored)]


def open_cache(
    store: Store, name: str, clip: Clip, configurations: Iterable[Configuration], digest: str | None = None
) -> ClipCache:
    """The cache for all stages of these configurations on the clip of this name.

    ``digest`` is that of the clip's content, if it is known already: computing it takes reading all images.
    """
    choices = {choice.key: choice for each in configurations for choice in each.choices.values() if choice}
    source = Source.of(name, clip, digest)
    found = {key: identify(choice, source) for key, choice in choices.items()}
    return ClipCache(store=store, identities={key: each for key, each in found.items() if each is not None})


def _place(store: Store, identity: Identity, frame: int | None, inputs: tuple[object, ...]) -> Path:
    return store.folder(identity.slot, identity.digest) / _file_name(frame, inputs)


def _file_name(frame: int | None, inputs: tuple[object, ...]) -> str:
    name = "any" if frame is None else f"{frame:06d}"
    return f"{name}-{content_digest(*inputs)}.bin"


@dataclass(frozen=True, slots=True, kw_only=True)
class StoredOutputs:
    """The stored outputs of one stage on one clip. Keys are the frame's number and the content of all other inputs."""

    store: Store
    identity: Identity
    tally: Tally
    unwritable: list[str] = field(default_factory=list)

    def load(self, inputs: Sequence[object]) -> tuple[float, Any] | None:
        """Return the seconds that the output for these inputs took, and the output; None if missing or damaged."""
        path = self._path(inputs)
        data, damaged = self.store.load(path)
        if data is not None:
            try:
                place, seconds, value = decode(data)
                damaged = place != self._label(path)
            except Exception:  # a right checksum, but not stored by this program
                damaged = True
        if damaged:
            self.tally.damaged.add(path.name)
            _log.warning("%s: damaged; its result is computed again", path)
        if data is None or damaged:
            return None
        self.tally.found.add(path.name)
        return seconds, value

    def save(self, inputs: Sequence[object], seconds: float, value: object) -> None:
        """Store an output. If the cache cannot be written, this is logged once and the run goes on, slower."""
        path = self._path(inputs)
        self.tally.computed.add(path.name)
        if self.unwritable:
            return
        try:
            self.store.describe(self.identity.slot, self.identity.digest, dict(self.identity.parts))
            self.store.save(path, encode((self._label(path), seconds, value)))
        except (OSError, TypeError, VfoaError) as error:
            self.unwritable.append(str(error))
            _log.warning("%s: results of %s are not stored: %s", path.parent, self.identity.parts["stage"], error)

    def _label(self, path: Path) -> str:
        """The label stored in a file, by which a file in the wrong place is detected."""
        return f"{self.identity.digest}/{path.name}"

    def _path(self, inputs: Sequence[object]) -> Path:
        if inputs and isinstance(inputs[0], StereoFrame):
            return _place(self.store, self.identity, inputs[0].index, tuple(inputs[1:]))
        return _place(self.store, self.identity, None, tuple(inputs))


@dataclass(slots=True)
class _Entry:
    """A stage on a clip: the reason why it had no outputs when the run began (None: it had some), and the counts."""

    identity: Identity
    absent: str | None
    tally: Tally = field(default_factory=Tally)


class Account:
    """Counts by clip and stage. Open a stage before anything is computed, so that earlier outputs are known."""

    def __init__(self) -> None:
        self._entries: dict[tuple[str, str], _Entry] = {}

    def open(self, clip: str, key: str, identity: Identity, store: Store) -> None:
        """Look for stored outputs of a stage, by its key, on a clip."""
        stored = store.has(identity.slot, identity.digest)
        absent = None if stored else difference(identity.parts, store.described(identity.slot))
        self._entries[clip, key] = _Entry(identity, absent)

    def add(self, clip: str, tallies: Mapping[str, Tally]) -> None:
        """Add what a job reused and computed, by the keys of its stages."""
        for key, tally in tallies.items():
            self._entries[clip, key].tally |= tally

    def forget(self, clip: str, store: Store) -> None:
        """Remove from the cache what was computed on a clip."""
        for (name, _), entry in self._entries.items():
            folder = store.folder(entry.identity.slot, entry.identity.digest)
            for stored in entry.tally.computed if name == clip else ():
                store.remove(folder / stored)

    def rows(self) -> list[dict[str, Any]]:
        """Return one row per stage and clip for the run's manifest; ``why`` is None if all outputs were reused."""
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
    """Yield the rows in words: a line for each stage and reason, over all clips."""
    sums: dict[tuple[str, str, str | None], tuple[int, int]] = {}
    for row in rows:
        key = row["slot"], row["stage"], row["why"]
        reused, computed = sums.get(key, (0, 0))
        sums[key] = reused + row["reused"], computed + row["computed"]
    for (slot, stage, why), (reused, computed) in sums.items():
        reason = f" ({why})" if why else ""
        yield f"Cache: {slot} {stage}: {reused} reused, {computed} computed{reason}"
