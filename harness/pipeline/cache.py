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
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from harness.files.digests import code_of, file_digest
from harness.files.folders import warn_not_stored
from harness.files.parsing import differing_keys
from harness.pipeline import cache_store
from harness.pipeline.cache_store import Store, content_digest, decode, encode, warn_damaged
from harness.pipeline.configuration import STAGES, Configuration, StageChoice
from harness.sources import Clip
from vfoa.errors import VfoaError
from vfoa.types import StereoFrame
from vfoa.weights import locate, weights_of


@dataclass(frozen=True, slots=True, kw_only=True)
class StageIdentity:
    """A stage on a clip: everything that its outputs depend on, and the digest of that."""

    slot: str
    parts: Mapping[str, Any]
    digest: str

    @property
    def is_in_region(self) -> bool:
        """Whether it is a matcher that is given a region to match."""
        return self.parts["settings"].get("region") == "needed"


def parts_of_clip(name: str, clip: Clip, digest: str | None = None) -> dict[str, Any]:
    """Everything that outputs of any stage on a clip depend on: its content, and the code that reads its frames.

    ``digest`` is that of the clip's content, if it is known already: computing it takes reading all images.
    """
    code, versions = code_of(type(clip).__module__)
    return {"clip": name, "clip sha256": digest or clip.digest(), "clip code": code, "versions": versions}


def weights_digests(choice: StageChoice) -> dict[str, str]:
    """Hexadecimal sha256 of the weights that a stage opens, by name; :class:`VfoaError` if some are missing."""
    return {name: file_digest(locate(name)) for name in weights_of(choice.settings)}


def identify(choice: StageChoice, of_clip: Mapping[str, Any]) -> StageIdentity | None:
    """Return the identity of a stage on a clip, given the clip's parts; None if it reads more than its arguments."""
    slot = STAGES[choice.slot]
    if choice.name in slot.of_clip:
        return None
    code, versions = code_of(slot.stage_class(choice.name).__module__)
    parts = {
        **of_clip,
        "stage": choice.name,
        "settings": choice.settings.model_dump(mode="json"),
        "weights": weights_digests(choice),
        "code": code,
        "versions": {**of_clip["versions"], **versions},
        "format": file_digest(Path(cache_store.__file__)),
    }
    # a clip under another name is the same clip
    content = {name: value for name, value in parts.items() if name != "clip"}
    digest = hashlib.sha256(json.dumps([choice.slot, content], sort_keys=True).encode()).hexdigest()
    return StageIdentity(slot=choice.slot, parts=parts, digest=digest[:32])


_log = logging.getLogger(__name__)


@dataclass(slots=True)
class Tally:
    """The outputs of one stage on a clip that were reused, and computed, by the names of their files.

    ``absent`` is the reason why there were none before; None if there were some.
    """

    identity: StageIdentity
    absent: str | None = None
    reused: set[str] = field(default_factory=set)
    computed: set[str] = field(default_factory=set)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipCache:
    """The cache for a job on one clip: the store, and the identity of each stage. It is pickled to other processes."""

    store: Store
    identities: Mapping[str, StageIdentity]

    def outputs_of(self, choice: StageChoice) -> StoredOutputs | None:
        """Return the stored outputs of a stage; None for a stage that is not cached."""
        identity = self.identities.get(choice.key)
        return None if identity is None else StoredOutputs(self.store, identity)

    def lacking(self, frames: Iterable[int]) -> list[int]:
        """The frames with outputs that are not stored, as far as known before anything is read."""
        stored = [
            {path.name for path in self.store.folder(identity.slot, identity.digest).glob("*.bin")}
            for identity in self.identities.values()
            if identity.slot == "segmentation" or (identity.slot == "stereo" and not identity.is_in_region)
        ]
        return [frame for frame in frames if not stored or not all(_file_name(frame, ()) in names for names in stored)]


def open_cache(
    store: Store, name: str, clip: Clip, configurations: Iterable[Configuration], digest: str | None = None
) -> ClipCache:
    """The cache for all stages of these configurations on a clip; the arguments are those of :func:`parts_of_clip`."""
    choices = {choice.key: choice for configuration in configurations for choice in configuration.stages}
    of_clip = parts_of_clip(name, clip, digest)
    identities = {key: identity for key, choice in choices.items() if (identity := identify(choice, of_clip))}
    return ClipCache(store=store, identities=identities)


def _file_name(frame: int | None, inputs: Sequence[object]) -> str:
    name = "any" if frame is None else f"{frame:06d}"
    return f"{name}-{content_digest(*inputs)}.bin"


NOT_STORED = "not in the cache"
"""Why outputs are computed of a stage that has others: new frames, other inputs, or files that were removed."""


def difference(parts: Mapping[str, Any], stored: Iterable[Mapping[str, Any]]) -> str:
    """Say why there are no outputs yet: how the most similar stored identity differs."""
    of_stage = [identity for identity in stored if identity["stage"] == parts["stage"]]
    of_clip = [identity for identity in of_stage if identity["clip"] == parts["clip"]]
    if not of_clip:
        return "first time on this clip" if of_stage else "first time"
    nearest = min((sorted(differing_keys(parts, identity)) for identity in of_clip), key=len)
    return f"{', '.join(nearest)} changed"


class StoredOutputs:
    """The stored outputs of one stage on one clip. Keys are the frame's number and the content of all other inputs."""

    def __init__(self, store: Store, identity: StageIdentity) -> None:
        self._store, self._identity = store, identity
        self._folder = store.folder(identity.slot, identity.digest)
        stored = (parts for _, parts in store.described(identity.slot))
        self._tally = Tally(identity, None if self._folder.exists() else difference(identity.parts, stored))
        self._is_writable = True

    def take(self) -> Tally:
        """Return what was reused and computed since the last call."""
        taken, self._tally = self._tally, Tally(self._identity, self._tally.absent)
        return taken

    def load(self, inputs: Sequence[object]) -> tuple[float, Any] | None:
        """Return the seconds that the output for these inputs took, and the output; None if missing or damaged."""
        path = self._path(inputs)
        if (data := self._store.load(path)) is None:
            return None
        try:
            label, seconds, value = decode(data)
        except Exception:  # a right checksum, but not stored by this program
            label = None
        if label != self._label(path):
            warn_damaged(path)
            return None
        self._tally.reused.add(path.name)
        return seconds, value

    def save(self, inputs: Sequence[object], seconds: float, value: object) -> None:
        """Store an output. What cannot be stored is logged once, and the run goes on, slower."""
        path = self._path(inputs)
        self._tally.computed.add(path.name)
        if not self._is_writable:
            return
        try:
            self._store.describe(self._identity.slot, self._identity.digest, dict(self._identity.parts))
            self._store.save(path, encode((self._label(path), seconds, value)))
        except (OSError, VfoaError) as error:
            self._is_writable = False
            warn_not_stored(self._store.root, error)
        except TypeError as error:
            self._is_writable = False
            _log.warning("%s: results of %s are not stored: %s", path.parent, self._identity.parts["stage"], error)

    def _label(self, path: Path) -> str:
        """The label stored in a file, by which a file in the wrong place is detected."""
        return f"{self._identity.digest}/{path.name}"

    def _path(self, inputs: Sequence[object]) -> Path:
        first, *others = inputs or (None,)
        name = _file_name(first.index, others) if isinstance(first, StereoFrame) else _file_name(None, inputs)
        return self._folder / name


class Account:
    """The use of the cache in a run, by clip and stage."""

    def __init__(self) -> None:
        self._totals: dict[tuple[str, str], Tally] = {}

    def add(self, tallies: Iterable[Tally]) -> None:
        """Add what a job reused and computed."""
        for tally in tallies:
            identity = tally.identity
            total = self._totals.setdefault((identity.parts["clip"], identity.digest), Tally(identity))
            total.absent = total.absent or tally.absent
            total.reused.update(tally.reused)
            total.computed.update(tally.computed)

    def rows(self) -> list[dict[str, Any]]:
        """Return one row per stage and clip for the run's manifest; ``why`` is None if all outputs were reused."""
        return [
            {
                "clip": clip,
                "slot": total.identity.slot,
                "stage": total.identity.parts["stage"],
                "reused": len(total.reused - total.computed),
                "computed": len(total.computed),
                "why": (total.absent or NOT_STORED) if total.computed else None,
            }
            for (clip, _), total in self._totals.items()
        ]


def cache_lines(rows: Iterable[Mapping[str, Any]]) -> Iterator[str]:
    """Yield the rows in words: a line for each stage and reason, over all clips."""
    counts: dict[tuple[str, str | None], Counter[str]] = {}
    for row in rows:
        count = counts.setdefault((f"{row['slot']} {row['stage']}", row["why"]), Counter())
        count.update(reused=row["reused"], computed=row["computed"])
    for (stage, why), count in counts.items():
        reason = f" ({why})" if why else ""
        yield f"Cache: {stage}: {count['reused']} reused, {count['computed']} computed{reason}"
