"""The manifest of a run, ``manifest.json``: what was run, with which versions, on which data, and what failed."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, NonNegativeInt, PositiveInt, field_validator, model_validator

from harness.files.parsing import differing_keys
from harness.run.notes import NoteKind
from vfoa.errors import VfoaError, listed
from vfoa.settings import Settings

MOST = 3
"""Number of differences that are named; the others are counted."""

_FOLLOWS = "times_ns"
"""Differs wherever a clip's frames do."""
_STEPS = ("reconstruction", "tracking", "gaze_filter", "attention")
"""Tables of a configuration that are never off."""
_DERIVED = "methods"
"""Follows from the configurations and the code, which are compared."""


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


class _ManifestTable(BaseModel):
    """A table whose known keys must have these types; other keys are kept as they are."""

    model_config = ConfigDict(extra="allow", strict=True, frozen=True)

    def plain(self) -> dict[str, Any]:
        """The keys that were given, with values as in JSON."""
        return self.model_dump(exclude_unset=True)


class NamesOfClip(_ManifestTable):
    """The rules of subjects and targets by their names, as in the clip's manifest."""

    subjects: dict[str, Any] = {}
    targets: dict[str, Any] = {}


class ClipOfRun(_ManifestTable):
    """A clip of a run. ``manifest`` is the path of its own; ``names`` and ``times_ns`` are None in older runs.

    ``films`` are those of :class:`harness.sources.FilmClip`.
    """

    name: str
    manifest: str = ""
    licence: str | None = None
    citation: str | None = None
    notes: list[str] = []
    rate_hz: int | float | None = None
    frames: list[int]
    times_ns: list[int] | None = None
    films: dict[str, float] = {}
    sha256: str | None = None
    drawn_sha256: str | None = None
    names: NamesOfClip | None = None
    stage_outputs_sha256: list[str] = []

    @model_validator(mode="after")
    def _one_time_a_frame(self) -> Self:
        if self.times_ns is not None and len(self.times_ns) != len(self.frames):
            raise ValueError(f"found {len(self.times_ns)} times; expected {len(self.frames)}, one for each frame")
        if any(later <= earlier for earlier, later in zip(self.frames, self.frames[1:], strict=False)):
            raise ValueError("found frames out of order, or one twice; expected ascending numbers")
        return self

    @property
    def subjects(self) -> tuple[str, ...]:
        """The names of its subjects; none if an older run did not save them."""
        return tuple(self.names.subjects) if self.names else ()

    @property
    def targets(self) -> tuple[str, ...]:
        """The names of its targets; none if an older run did not save them."""
        return tuple(self.names.targets) if self.names else ()


class NoteOfRun(_ManifestTable):
    """A note of the experiment."""

    text: str
    kind: NoteKind = Field(default=NoteKind.FACT, strict=False)


class AnswerTraits(_ManifestTable):
    """What the answers of a method are: probabilities, and whether no focus is the answer "looks at nothing".

    Those ``from_file`` are another system's, which needs nothing of what the stages found.
    """

    probabilistic: bool = False
    says_nowhere: bool = False
    from_file: bool = False


class Failure(_ManifestTable):
    """A (clip, configuration) that failed. ``traceback`` is the file of a stage's fault, below the run's directory."""

    clip: str
    configuration: str
    error: str
    traceback: str | None = None


class RunManifest(_ManifestTable):
    """The keys of ``manifest.json``.

    All are optional: a run that has just begun has fewer, and older versions wrote fewer. Only keys that were given are
    written. ``configurations`` are their settings by table; a stage that is off is None.
    """

    experiment: str = ""
    notes: list[NoteOfRun] = []
    published: Published | None = None
    annotator: str | None = None
    recording: str | None = None
    clips: list[ClipOfRun] = []
    configurations: dict[str, dict[str, Any]] = {}
    methods: dict[str, AnswerTraits] = {}
    left_out_labels_sha256: dict[str, str | None] | None = None
    factors: dict[str, dict[str, str]] = {}
    weights_sha256: dict[str, str] = {}
    versions: dict[str, Any] = {}
    source_sha256: str | None = None
    run_id: str | None = Field(default=None, pattern="^[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}$")
    failed: list[Failure] = []
    cache: list[dict[str, Any]] = []
    fitted: dict[str, dict[str, Any]] = {}
    labels_sha256: dict[str, str | None] = {}
    """The labels that the tables use, by clip."""
    commit: str | None = None
    host: dict[str, Any] = {}
    started: str | None = None
    finished: str | None = None
    """None while the run goes on."""
    run_labels_sha256: dict[str, str | None] | None = None
    """The labels that the run was made with, if its tables use other labels."""
    tables_annotator: str | None = None
    """The annotator whose labels the tables use, if not those that the run names."""
    directory: str = ""
    """The absolute path of the run's directory when this was written."""

    @field_validator("configurations")
    @classmethod
    def _tables(cls, configurations: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        for name, tables in configurations.items():
            for table, settings in tables.items():
                if not isinstance(settings, dict) and (settings is not None or table in _STEPS):
                    raise ValueError(f"{name}.{table}: found {settings!r}; expected a table")
            every = (tables.get("segmentation") or {}).get("every", 1)
            if not isinstance(every, int):
                raise ValueError(f"{name}.segmentation.every: found {every!r}; expected a whole number")
        return configurations

    def traits(self, configuration: str, path: Path) -> AnswerTraits:
        """What the answers of a configuration are. ``path`` is the manifest's file, for the error.

        Raises
        ------
        VfoaError
            If the manifest does not say it: an earlier version of this program wrote it.
        """
        traits = self.methods.get(configuration)
        if traits is None and "method" in self.configurations.get(configuration, {}).get("attention", {}):
            raise VfoaError(
                f"{path}: methods.{configuration}: missing, as in runs of earlier versions; run the experiment again"
            )
        return traits or AnswerTraits()

    @property
    def scored_annotator(self) -> str | None:
        """The annotator whose labels the run is scored against."""
        return self.tables_annotator or self.annotator

    @property
    def failed_pairs(self) -> set[tuple[str, str]]:
        """Every (clip, configuration) that failed."""
        return {(failure.clip, failure.configuration) for failure in self.failed}


def has_images(configurations: Collection[Mapping[str, Any]]) -> bool:
    """Whether a run has images: for clips of measurements, the stages of perception are off (null)."""
    return not configurations or any(configuration.get("stereo", True) for configuration in configurations)


def differences(actual: Mapping[str, Any], wanted: Mapping[str, Any]) -> str:
    """Name the differences of a run's manifest from ``wanted``; "" if none: ``attention.n_rays, versions.numpy``.

    Keys that ``wanted`` does not have do not count.
    """
    return listed(list(dict.fromkeys(_differing(actual, wanted))), MOST)


_OF_CLIPS = ("frames", "sha256", "drawn_sha256", "stage_outputs_sha256")
"""What decides a clip's answers, beside the settings."""


def differences_in_common(one: RunManifest, other: RunManifest) -> str:
    """Name how another run was made differently, as :func:`differences`, on what both have; "" if it was not.

    That is the settings of configurations of the same name, the files of clips and weights, the versions, and the code.
    """
    first, second = one.plain(), other.plain()
    named = [{clip.name: clip for clip in run.clips} for run in (one, other)]
    for run, clips in zip((first, second), named, strict=True):
        kept = [name for name in named[1] if name in named[0]]
        run["clips"] = {name: {key: getattr(clips[name], key) for key in _OF_CLIPS} for name in kept}
        run["code"] = run.get("source_sha256")
    for key in ("configurations", "weights_sha256"):
        kept = [name for name in second.get(key, {}) if name in first.get(key, {})]
        for run in (first, second):
            run[key] = {name: run[key][name] for name in kept}
    compared = ("clips", "configurations", "weights_sha256", "versions", "code")
    return differences(first, {key: second[key] for key in compared if key in second})


def _differing(actual: Mapping[str, Any], wanted: Mapping[str, Any]) -> Iterator[str]:
    for key, value in wanted.items():
        if key != _DERIVED and actual.get(key) != value:
            yield from _within(key, _named(actual.get(key)), _named(value)) or [key]


def _within(key: str, actual: Any, wanted: Any) -> list[str]:
    """Differences within one key. Those of clips name the clip; those of configurations, mostly shared, do not."""
    if key not in ("clips", "configurations"):
        return list(differing_keys(actual, wanted, key))
    if not isinstance(actual, dict) or list(actual) != list(wanted):
        return [key]
    leaves = [(name, list(differing_keys(actual[name], wanted[name]))) for name in wanted]
    if key == "configurations":
        return [leaf for _, keys in leaves for leaf in keys]
    return [f"{leaf} of {name}" for name, keys in leaves for leaf in keys if leaf != _FOLLOWS or "frames" not in keys]


def _named(value: Any) -> Any:
    """A list of clips by their names; other values unchanged."""
    return {clip["name"]: clip for clip in value} if isinstance(value, list) and value and "name" in value[0] else value
