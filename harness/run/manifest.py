"""The manifest of a run: its checks when it is read, and the differences between two of them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, NonNegativeInt, PositiveInt, model_validator

from vfoa.settings import Settings
from vfoa.validation import parse


class PublishedCount(Settings):
    """``correct`` of ``n`` frames."""

    correct: NonNegativeInt
    n: PositiveInt

    @model_validator(mode="after")
    def _share(self) -> Self:
        if self.correct > self.n:
            raise ValueError(f"found {self.correct} correct of {self.n}; expected at most {self.n}")
        return self


class Published(Settings):
    """``[published]`` of an experiment: the source of the figures, and the counts by configuration."""

    source: str
    counts: dict[str, PublishedCount] = Field(min_length=1)


MOST = 3
"""Number of differences that are named; the others are counted."""

_FOLLOWS = "times_ns"
"""Differs wherever a clip's frames do."""


class _Table(BaseModel):
    """A table whose known keys must have these types; other keys are ignored."""

    model_config = ConfigDict(extra="allow", strict=True)


class _Names(_Table):
    subjects: dict[str, Any] = {}
    targets: dict[str, Any] = {}


class _Clip(_Table):
    name: str
    frames: list[int]
    manifest: str = ""
    notes: list[str] = []
    times_ns: list[int] | None = None
    rate_hz: float | None = None
    licence: str | None = None
    citation: str | None = None
    sha256: str = ""
    names: _Names = _Names()

    @model_validator(mode="after")
    def _one_time_a_frame(self) -> Self:
        if self.times_ns is not None and len(self.times_ns) != len(self.frames):
            raise ValueError(f"found {len(self.times_ns)} times; expected {len(self.frames)}, one for each frame")
        if any(later <= earlier for earlier, later in zip(self.frames, self.frames[1:], strict=False)):
            raise ValueError("found frames out of order, or one twice; expected ascending numbers")
        return self


class _Segmentation(_Table):
    every: int = 1


class _Configuration(_Table):
    attention: dict[str, Any] = {}
    segmentation: _Segmentation | None = None


class _Failure(_Table):
    clip: str
    configuration: str
    error: str


class _RunManifest(_Table):
    """All keys are optional: a run that has just begun has fewer, and older versions wrote fewer."""

    experiment: str = ""
    run_id: str | None = Field(default=None, pattern="^[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}$")
    annotator: str | None = None
    notes: list[str] = []
    clips: list[_Clip] = []
    configurations: dict[str, _Configuration] = {}
    factors: dict[str, dict[str, str]] = {}
    failed: list[_Failure] = []
    labels_sha256: dict[str, str | None] = {}
    versions: dict[str, Any] = {}
    published: Published | None = None


def check_manifest(data: Any, where: str) -> dict[str, Any]:
    """Check a run's manifest and return it.

    Raises
    ------
    VfoaError
        If it is no table, or a known key has another type: the key, what was found and what was expected.
    """
    parse(_RunManifest, data, where)
    return dict(data)


def differences(found: Mapping[str, Any], wanted: Mapping[str, Any]) -> str:
    """Name the differences of a run's manifest from ``wanted``; "" if none: ``attention.n_rays, versions.numpy``.

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
    """Differences within one key. Those of clips name the clip; those of configurations, mostly shared, do not."""
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
