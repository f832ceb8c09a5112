"""The stage cache: outputs of perception under everything that they depend on, so that none is computed twice.

An output depends, beside its inputs, on the clip's content, the stage and all its settings, the content of its weights,
its code and that of the clip's adapter (the file itself and all files of the same package, or of vfoa, that it imports,
directly or not), the versions of the packages that these import, the kind of machine, and the code that stores outputs.
A stored output is used only if all of it is the same. Only stages that use nothing but their arguments are cached; a
stage that reads the clip's ground truth or files of its own is as fast as the cache.
"""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from harness.files.digests import code_of, file_digest
from harness.files.parsing import differing_keys
from harness.pipeline import cache_store
from harness.pipeline.cache_store import Store, content_digest, decode, encode
from harness.pipeline.configuration import STAGES, Configuration, StageChoice
from harness.sources import Clip
from vfoa.errors import VfoaError
from vfoa.types import StereoFrame
from vfoa.weights import locate, weights_of


@dataclass(frozen=True, slots=True, kw_only=True)
class Identity:
    """A stage on a clip: everything that its outputs depend on, and the digest of that."""

    slot: str
    parts: Mapping[str, Any]
    digest: str

    @property
    def is_in_region(self) -> bool:
        """Whether it is a matcher that is given a region to match."""
        return self.parts["settings"].get("region") == "needed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """A clip by name, the digest of its content, and the code that reads its frames, with its versions."""

    name: str
    digest: str
    code: str
    versions: Mapping[str, str]

    @classmethod
    def of(cls, name: str, clip: Clip, digest: str | None = None) -> Source:
        """The clip as it is read now; ``digest`` is that of its content, if it is known already."""
        code, versions = code_of(type(clip).__module__)
        return cls(name=name, digest=digest or clip.digest(), code=code, versions=versions)


def identify(choice: StageChoice, source: Source) -> Identity | None:
    """Return the identity of a stage on a clip; None for a stage that reads more than its arguments."""
    slot = STAGES[choice.slot]
    if choice.name in slot.of_clip:
        return None
    code, versions = code_of(slot.stage_class(choice.name).__module__)
    parts = {
        "stage": choice.name,
        "clip": source.name,
        "clip sha256": source.digest,
        "clip code": source.code,
        "settings": choice.settings.model_dump(mode="json"),
        "weights": {name: file_digest(locate(name)) for name in weights_of(choice.settings)},
        "code": code,
        "versions": {**source.versions, **versions},
        "format": file_digest(Path(cache_store.__file__)),
    }
    # a clip under another name is the same clip
    content = {name: value for name, value in parts.items() if name != "clip"}
    digest = hashlib.sha256(json.dumps([choice.slot, content], sort_keys=True).encode()).hexdigest()
    return Identity(slot=choice.slot, parts=parts, digest=digest[:32])


def difference(parts: Mapping[str, Any], stored: Iterable[Mapping[str, Any]]) -> str:
    """Say why there are no outputs yet: the difference to the most similar stored identity."""
    same_stage = [identity for identity in stored if identity.get("stage") == parts["stage"]]
    same_clip = [identity for identity in same_stage if identity.get("clip") == parts["clip"]]
    if not same_clip:
        return "first time on this clip" if same_stage else "first time"
    nearest = min((sorted(differing_keys(parts, identity)) for identity in same_clip), key=len)
    return f"{', '.join(nearest)} changed"


_log = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Tally:
    """The outputs of one stage that were reused, computed, and found damaged, by the names of their files."""

    reused: set[str] = field(default_factory=set)
    computed: set[str] = field(default_factory=set)
    damaged: set[str] = field(default_factory=set)

    def __or__(self, other: Tally) -> Tally:
        return Tally(self.reused | other.reused, self.computed | other.computed, self.damaged | other.damaged)

    def take(self) -> Tally:
        """Return all counts so far, and reset them."""
        taken = Tally() | self
        for names in (self.reused, self.computed, self.damaged):
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
            identity
            for identity in self.identities.values()
            if identity.slot == "segmentation" or (identity.slot == "stereo" and not identity.is_in_region)
        ]
        stored = [self.store.names(identity.slot, identity.digest) for identity in alone]
        return [frame for frame in frames if not stored or not all(_file_name(frame, ()) in names for names in stored)]


def open_cache(
    store: Store, name: str, clip: Clip, configurations: Iterable[Configuration], digest: str | None = None
) -> ClipCache:
    """The cache for all stages of these configurations on the clip of this name.

    ``digest`` is that of the clip's content, if it is known already: computing it takes reading all images.
    """
    choices = {choice.key: choice for configuration in configurations for choice in configuration.stages}
    source = Source.of(name, clip, digest)
    identities = {key: identity for key, choice in choices.items() if (identity := identify(choice, source))}
    return ClipCache(store=store, identities=identities)


def _file_name(frame: int | None, inputs: Sequence[object]) -> str:
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
        self.tally.reused.add(path.name)
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
        first, *others = inputs or (None,)
        name = _file_name(first.index, others) if isinstance(first, StereoFrame) else _file_name(None, inputs)
        return self.store.folder(self.identity.slot, self.identity.digest) / name


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
                (folder / stored).unlink(missing_ok=True)

    def rows(self) -> list[dict[str, Any]]:
        """Return one row per stage and clip for the run's manifest; ``why`` is None if all outputs were reused."""
        return [
            {
                "clip": clip,
                "slot": entry.identity.slot,
                "stage": entry.identity.parts["stage"],
                "reused": len(entry.tally.reused - entry.tally.computed),
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
