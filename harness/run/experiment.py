"""Experiments: which clips under which configurations.

An experiment is a TOML file::

    clips = ["studio_table", "studio_talk"]
    notes = ["Heads and masks are the truth; gaze and head pose are simulated."]
    limit = 20                              # take the first 20 frames of each of these clips; --limit overrides it
    seeds = 20                              # repeat configurations with a simulated error under 20 seeds
    recording = "none"                      # as --recording of `vfoa run`: light, jpeg or none; light if not given
    preset = "realtime"                     # settings over the defaults, see PRESETS below
    annotator = "anna"                      # score <clip>@anna.csv instead of <clip>.csv

    [defaults.stereo]                       # one table per stage, see vfoa/*/ and harness/pipeline/configuration.py
    matcher = "sgbm"
    min_depth_m = 0.8                       # for every matcher that has such a setting

    [grid]                                  # every combination; a value is named by itself ...
    "stereo.matcher" = ["bm", "sgbm"]
    "attention.cones_cm" = { one = [10], two = [10, 25] }     # ... or by its key
    gaze = { none = { model = "none" }, truth = { model = "truth" } }      # several settings of one table

or, instead of ``[grid]``, a list of ``[[configuration]]`` with a ``name`` and the tables in which it differs.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from harness.clips.manifest import clips_here
from harness.files.folders import find, names
from harness.files.parsing import parse_assignment, read_toml
from harness.pipeline.configuration import (
    STAGES,
    TABLES,
    Configuration,
    check_all_used,
    inherited,
    is_setting,
    make_configuration,
    merged,
    takes,
)
from harness.run.fitted import FitRecord, FittedWeights, read_fitted
from harness.run.grid import Variant, base_of, repeated, variants
from harness.run.manifest import Published
from harness.run.notes import Note, NoteKind
from vfoa.config import Tables, dotted_tables
from vfoa.errors import VfoaError, check_known, did_you_mean, located
from vfoa.methods import DEFAULT_METHOD
from vfoa.registry import AUTO
from vfoa.settings import Settings
from vfoa.validation import parse

PRESETS: dict[str, dict[str, dict[str, Any]]] = {
    "none": {},
    # for clips of measurements, which have no images
    "measured": {slot.name: {slot.key: slot.measured} for slot in STAGES.values()},
    # half the disparities of a quarter of the pixels, where objects and heads are; masks carried by optical flow;
    # in an image 1024 px wide, faces are found from 25 px on; clouds and heads of fewer points
    "realtime": {
        "stereo": {"resolution": "half", "region": "needed"},
        "segmentation": {"every": 5},
        "heads": {"max_size_px": 416},
        "reconstruction": {"max_points": 400, "max_eye_points": 1000},
    },
}


def preset_tables(name: str | None, where: str) -> Tables:
    """Return the settings of a preset by table; none without a name. A ``.toml`` file is one that ``vfoa fit`` wrote.

    Raises
    ------
    VfoaError
        If there is no such preset; ``where`` opens the message.
    """
    if name is None:
        return {}
    if isinstance(name, str) and name.endswith(".toml"):
        with located(where):
            weights = read_fitted(Path(name)).attention.model_dump()["weights"]
        return {"attention": {"method": "logit", "weights": weights}}
    if not isinstance(name, str) or name not in PRESETS:
        raise VfoaError(f"{where}: no {name!r}; {did_you_mean(str(name), PRESETS)}")
    return PRESETS[name]


_Change = tuple[str, Any]
"""A setting's dotted key and its value."""
RecordingKind = Literal["light", "jpeg", "none"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """Clips x configurations. ``notes`` are printed with the table.

    ``limit`` is the number of frames to take of each clip; None for all. ``annotator`` names the annotator whose labels
    are scored; None for ``annotations/<clip>.csv``. ``published`` are published figures for these configurations.
    ``missing`` says which clips of a family are not here. ``recording``: whether it is recorded, and with
    which pictures, unless the command line says so. ``where`` is its file, and what was set over it.
    ``given`` are the keys that its user gave instead of the file's. ``fits`` are the origins of fitted weights that are
    used, by their files.
    """

    name: str
    clips: tuple[str, ...]
    configurations: tuple[Configuration, ...]
    notes: tuple[Note, ...] = ()
    limit: int | None = None
    annotator: str | None = None
    published: Published | None = None
    missing: tuple[str, ...] = ()
    recording: RecordingKind = "light"
    where: str = ""
    given: frozenset[str] = frozenset()
    fits: Mapping[Path, FitRecord] = field(default_factory=dict)

    def wrong(self, key: str, error: VfoaError) -> VfoaError:
        """The error of a key's value, with the file and the key in front if it is from the file."""
        return error if key in self.given else VfoaError(f"{self.where}: {key}: {error}")


class _File(Settings):
    clips: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    limit: int | None = Field(default=None, ge=1)
    annotator: str | None = None
    preset: str | None = None
    seeds: int = Field(default=1, ge=1, le=1000)
    defaults: dict[str, dict[str, Any]] = Field(default_factory=dict)
    grid: dict[str, Any] = Field(default_factory=dict)
    configuration: tuple[dict[str, Any], ...] = ()
    published: Published | None = None
    recording: RecordingKind = "light"


def default_configuration() -> Configuration:
    """Return that of ``vfoa run CLIP``, whatever the clip."""
    (default,) = load_experiment("default", clips=("any",)).configurations
    return default


def load_experiment(
    name_or_path: str, *, clips: tuple[str, ...] = (), overrides: tuple[str, ...] = (), preset: str | None = None
) -> Experiment:
    """Read an experiment by name, if it is in the project, or by path.

    Parameters
    ----------
    clips
        Run these instead of the file's own, and all of their frames.
    overrides
        ``"stereo.min_depth_m=0.5"``: a dotted key and a TOML value (a bare word is a string), set in every
        configuration that has it, over its defaults and its grid; a note names the others.
    preset
        A bundle of settings by name, over the defaults of every configuration, instead of the file's own.

    Raises
    ------
    VfoaError
        If the file, a key or a value is wrong: one line with the file and the dotted key.
    """
    path = _find(name_or_path)
    where = str(path)
    file = _with_fitted_files(parse(_File, read_toml(path), where), path.parent)
    where = " --set ".join((where, *overrides))
    chosen = clips or file.clips
    if not chosen:
        raise VfoaError(f"{where}: clips: expected at least one clip, found none")
    with nullcontext() if clips else located(f"{where}: clips"):
        if twice := next((clip for clip in chosen if chosen.count(clip) > 1), None):
            raise VfoaError(f"clip {twice!r} is given twice; expected each clip once")
        present, absent = clips_here(chosen)
    missing = (f"Not here, and not run: {', '.join(absent)}.",) if absent else ()
    changes = [parse_assignment(text, "stereo.matcher=sgbm") for text in overrides]
    configurations, partly = _configurations(file, changes, preset, where)
    if file.seeds > 1:
        configurations = tuple(
            configuration for base in configurations for configuration in repeated(base, file.seeds, where)
        )
    _check_published(file, [base_of(configuration.name) for configuration in configurations], where)
    fitted = _fitted_files(file, preset)
    return Experiment(
        name=path.stem,
        fits={file: each.fit for file, each in fitted.items() if _uses(each, configurations)},
        clips=present,
        configurations=configurations,
        limit=None if clips else file.limit,
        notes=(
            *map(Note, (*file.notes, *missing)),
            *partly,
            *_unused_notes(fitted, configurations),
        ),
        annotator=file.annotator,
        published=file.published,
        missing=missing,
        recording=file.recording,
        where=where,
        given=frozenset(["clips"] if clips else []),
    )


def _with_fitted_files(file: _File, folder: Path) -> _File:
    """Return the file with the paths of its preset files: below the working directory, else beside the file."""

    def located(name: object) -> object:
        is_file = isinstance(name, str) and name.endswith(".toml")
        return str(folder / str(name)) if is_file and not Path(str(name)).exists() else name

    configurations = (
        {**table, **({"preset": located(table["preset"])} if "preset" in table else {})} for table in file.configuration
    )
    return file.model_copy(update={"preset": located(file.preset), "configuration": tuple(configurations)})


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layers:
    """The settings of one configuration, from the weakest: ``defaults``, ``bundle``, the variant's own, changes.

    ``preset`` is the name of the preset that counts. ``bundle`` are its settings, with those of a given file of fitted
    weights over them; changes are those of the command line.
    """

    variant: Variant
    defaults: Tables
    preset: str | None
    bundle: Tables
    where: str

    @classmethod
    def of(cls, variant: Variant, file: _File, given: str | None, where: str) -> _Layers:
        """The layers of a variant; ``given`` is a preset instead of the file's, or a file of weights beside it."""
        fitted = given if given is not None and given.endswith(".toml") else None
        own = None if fitted else given
        preset = own or variant.preset or file.preset
        of_file = preset_tables(preset, "preset" if own else f"{where}: preset")
        bundle = merged(of_file, preset_tables(fitted, "preset"))
        return cls(variant=variant, defaults=file.defaults, preset=preset, bundle=bundle, where=where)

    def tables(self, changes: Sequence[_Change] = ()) -> Tables:
        """All layers together, with these changes."""
        own = self._own(changes)
        tables = merged(inherited(merged(self.defaults, self._bundle_under(own)), own), own)
        # for one face on one core, MobileGaze takes 65 ms and ADAS-0002 8
        is_slow = self.preset == "realtime" and tables.get("gaze", {}).get("model") == AUTO
        return merged(tables, {"gaze": {"model": "adas_0002"}}) if is_slow else tables

    def used_defaults(self, changes: Sequence[_Change] = ()) -> Iterator[tuple[str, str]]:
        """Yield the table and key of each default that the configuration has."""
        for table, settings in inherited(self.defaults, self._own(changes)).items():
            yield from ((table, key) for key in settings)

    def configuration(self, changes: Sequence[_Change]) -> Configuration:
        """The configuration with these changes."""
        where = f"{self.where}: configuration {self.variant.name!r}"
        return make_configuration(self.variant.name, self.tables(changes), self.variant.factors, where)

    def _own(self, changes: Sequence[_Change]) -> Tables:
        return dotted_tables([*self.variant.differences, *changes], TABLES, self.where)

    def _bundle_under(self, own: Tables) -> Tables:
        """The bundle; without its settings of attention if another method is chosen than the bundle's."""
        default, of_own = (tables.get("attention", {}) for tables in (self.defaults, own))
        # a default that only names a method yields to fitted weights
        is_chosen = "method" in of_own if default.keys() == {"method"} else bool({**default, **of_own})
        method = {**default, **of_own}.get("method", DEFAULT_METHOD)
        if not is_chosen or method == self.bundle.get("attention", {}).get("method", method):
            return self.bundle
        return {table: settings for table, settings in self.bundle.items() if table != "attention"}


def _configurations(
    file: _File, changes: Sequence[_Change], preset: str | None, where: str
) -> tuple[tuple[Configuration, ...], list[Note]]:
    """Return every configuration of the file with the changes that it has, and notes on changes that some lack."""
    found = variants(file.grid, file.configuration, where, is_setting)
    layers = [_Layers.of(variant, file, preset, where) for variant in found]
    changed = {each.variant.name: each.tables(changes) for each in layers}
    lacking = {key: [name for name, tables in changed.items() if not takes(tables, key)] for key, _ in changes}
    partly = {key: names for key, names in lacking.items() if 0 < len(names) < len(layers)}  # all: an error
    made, used = [], set[tuple[str, str]]()
    given = dict.fromkeys(key for key, _ in changes)
    for each in layers:
        taken = [(key, value) for key, value in changes if each.variant.name not in partly.get(key, ())]
        used.update(each.used_defaults(), each.used_defaults(taken))  # a stage that a change exchanges has used its own
        made.append(each.configuration(taken))
        given |= dict.fromkeys(key for key, _ in each.variant.differences)
    check_all_used(file.defaults, used, made, where)
    given |= dict.fromkeys(f"{table}.{key}" for table, settings in file.defaults.items() for key in settings)
    return tuple(made), [
        *(
            Note(f"{key} is not set in {', '.join(names)}: no such setting there.", NoteKind.PARTLY_SET)
            for key, names in partly.items()
        ),
        *(
            Note(f"{key} has no effect: it counts with {needed}.", NoteKind.PARTLY_SET)
            for key, needed in _idle(made).items()
            if key in given
        ),
        *([] if preset else _replaced_notes(layers, changes)),
    ]


def _replaced_notes(layers: Sequence[_Layers], changes: Sequence[_Change]) -> Iterator[Note]:
    """Yield a note on the defaults of the file that would count, if its own preset did not replace them."""
    alone = _counting([replace(each, bundle={}) for each in layers], changes)
    counting = _counting(layers, changes)
    if keys := [key for key in alone if key not in counting]:
        presets = " or ".join(dict.fromkeys(repr(each.preset) for each in layers))
        yield Note(
            f"The preset {presets} replaces {', '.join(keys)} of [defaults]; settings of [grid] and [[configuration]] "
            "come after it.",
            NoteKind.PARTLY_SET,
        )


def _counting(layers: Iterable[_Layers], changes: Sequence[_Change]) -> dict[str, None]:
    """The defaults that some configuration has, by dotted key."""
    pairs = ((each, each.tables(changes)) for each in layers)
    return {
        f"{table}.{key}": None
        for each, tables in pairs
        for table, settings in each.defaults.items()
        for key, value in settings.items()
        if key in tables[table] and tables[table][key] == value
    }


def _idle(configurations: Iterable[Configuration]) -> dict[str, str]:
    """The settings, by dotted key, that have no effect in any configuration, and what each counts with."""
    idle, counting = dict[str, str](), set[str]()
    for configuration in configurations:
        for table, settings in configuration.settings.items():
            keys = {key: f"{table}.{key}" for key in type(settings).model_fields}
            idle |= {keys[key]: f"{table}.{needed}" for key, needed in settings.idle.items()}
            counting.update(keys[key] for key in keys.keys() - settings.idle.keys())
    return {key: needed for key, needed in idle.items() if key not in counting}


def _fitted_files(file: _File, preset: str | None) -> dict[Path, FittedWeights]:
    """The files of fitted settings that an experiment names."""
    names = [preset] if preset else [*(table.get("preset") for table in file.configuration), file.preset]
    paths = dict.fromkeys(Path(name) for name in names if isinstance(name, str) and name.endswith(".toml"))
    return {path: read_fitted(path) for path in paths}


def _uses(fitted: FittedWeights, configurations: Sequence[Configuration]) -> bool:
    return any(has_weights(configuration, fitted) for configuration in configurations)


def _unused_notes(files: Mapping[Path, FittedWeights], configurations: Sequence[Configuration]) -> Iterator[Note]:
    """Notes on files of fitted weights that change nothing: each configuration has another method, or other weights."""
    methods = ", ".join(dict.fromkeys(each.attend.attention.method for each in configurations))
    for path, fitted in files.items():
        if not _uses(fitted, configurations):
            yield Note(f"No configuration uses the weights of {path.name}: attention.method is set to {methods}.")


def has_weights(configuration: Configuration, fitted: FittedWeights) -> bool:
    """Whether the attention of a configuration has the weights of a file of ``vfoa fit``."""
    return getattr(configuration.attend.attention, "weights", None) == fitted.attention.weights


def is_experiment(name_or_path: str) -> bool:
    """Whether this names an experiment: a ``.toml`` file that is not a clip's manifest, or an experiment by name."""
    return find("experiments", name_or_path) is not None or (
        name_or_path.endswith(".toml") and "adapter" not in read_toml(Path(name_or_path))
    )


def _find(name_or_path: str) -> Path:
    if name_or_path.endswith(".toml"):
        return Path(name_or_path)
    path = find("experiments", name_or_path)
    if path is None:
        raise VfoaError(f"experiment: no {name_or_path!r}; {did_you_mean(name_or_path, names('experiments'))}")
    return path


def _check_published(file: _File, configurations: list[str], where: str) -> None:
    for name in file.published.counts if file.published else ():
        check_known(name, configurations, f"{where}: published.counts: no configuration")
