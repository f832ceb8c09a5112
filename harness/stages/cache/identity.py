"""Everything that a stage's outputs on a clip depend on beside its inputs, by name and as a digest.

These are the clip's content, the stage and all its settings, the content of its weights, its code and that of the
clip's adapter (the file itself and all files of the same package, or of vfoa, that it imports, directly or not), the
versions of the packages that these import, the kind of machine, and the code that stores outputs. A stored output is
used only if all of it is the same.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.files.code_digest import code_of
from harness.files.digests import file_digest
from harness.sources import Clip
from harness.stages.cache import values
from harness.stages.slots import SLOTS, StageChoice
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
    slot = SLOTS[choice.slot]
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
        "format": file_digest(Path(values.__file__)),
    }
    # a clip under another name is the same clip
    content = {name: value for name, value in parts.items() if name != "clip"}
    digest = hashlib.sha256(json.dumps([choice.slot, content], sort_keys=True).encode()).hexdigest()
    return Identity(slot=choice.slot, parts=parts, digest=digest[:32])


def difference(parts: Mapping[str, Any], stored: Iterable[Mapping[str, Any]]) -> str:
    """Say why there are no outputs yet: the difference to the most similar stored identity."""
    flat = dict(_flattened(parts))
    same_stage = [dict(_flattened(each)) for each in stored if each.get("stage") == parts["stage"]]
    same_clip = [each for each in same_stage if each.get("clip") == parts["clip"]]
    if not same_clip:
        return "first time on this clip" if same_stage else "first time"
    nearest = min((_differing(flat, each) for each in same_clip), key=len)
    return f"{', '.join(nearest)} changed"


def _differing(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    return sorted(name for name in one.keys() | other.keys() if one.get(name, _ABSENT) != other.get(name, _ABSENT))


_ABSENT = object()


def _flattened(parts: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in parts.items():
        if isinstance(value, dict):
            yield from _flattened(value, f"{prefix}{name}.")
        else:
            yield f"{prefix}{name}", value
