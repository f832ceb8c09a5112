"""What a run's manifest must look like where it is read: another program, or an editor, may have written it."""

from __future__ import annotations

from typing import Any, Self

from pydantic import BaseModel, ConfigDict, model_validator

from harness.run.published import Published
from vfoa.validation import parse


class _Table(BaseModel):
    """A table of which the keys that are read have these types; others are left alone."""

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


class _Configuration(_Table):
    attention: dict[str, Any] = {}


class _Failure(_Table):
    clip: str
    configuration: str
    error: str


class _RunManifest(_Table):
    """All of it is optional: a run that has just begun has less, and an older one knows less."""

    experiment: str = ""
    annotator: str | None = None
    notes: list[str] = []
    clips: list[_Clip] = []
    configurations: dict[str, _Configuration] = {}
    failed: list[_Failure] = []
    labels_sha256: dict[str, str | None] = {}
    versions: dict[str, Any] = {}
    published: Published | None = None


def check_manifest(data: Any, where: str) -> dict[str, Any]:
    """A run's manifest as it was read.

    Raises
    ------
    VfoaError
        If it is no table, or a key that is read is of another type: which one, what was found and what was expected.
    """
    parse(_RunManifest, data, where)
    return dict(data)
