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

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from harness.clips.manifest import clips_here
from harness.files.folders import find, names
from harness.files.parsing import parse_assignment, read_toml
from harness.pipeline.configuration import (
    OFF,
    STAGES,
    TABLES,
    Configuration,
    check_all_used,
    inherited,
    make_configuration,
    merged,
    takes,
)
from harness.run.grid import base_of, repeated, variants
from harness.run.manifest import Published
from harness.run.notes import Note, fitted_on_reported
from vfoa import __version__
from vfoa.config import Tables, dotted_tables
from vfoa.errors import VfoaError, check_known, did_you_mean
from vfoa.logit import LogitSettings
from vfoa.methods import DEFAULT_METHOD
from vfoa.registry import AUTO
from vfoa.removed import removed
from vfoa.settings import Settings
from vfoa.validation import parse


class MethodScore(Settings):
    """The scores of one method. Without probabilities it has no log loss and no calibration error."""

    method: str
    n: int
    log_loss: float | None = None
    calibration_error: float | None = None
    balanced_frr: float | None = None
    frr: float
    recall_on_targets: float | None = None


class FitRecord(Settings):
    """What weights were fitted to, and their scores on what was left out."""

    experiment: str
    configuration: str
    clips: tuple[str, ...]
    people: int
    labelled_s: float
    seeds: int = 1
    version: str
    held_out: tuple[MethodScore, ...] = ()
    curve: tuple[MethodScore, ...] = ()

    def score_of(self, method: str) -> MethodScore | None:
        """Return the scores of a method, if it was scored."""
        return next((method_score for method_score in self.held_out if method_score.method == method), None)


class FittedWeights(Settings):
    """A whole file."""

    fit: FitRecord
    attention: LogitSettings


def read_fitted(path: Path) -> FittedWeights:
    """Read a file of ``vfoa fit``.

    Raises
    ------
    VfoaError
        If it is missing, a key or value is wrong, or a later version of this program wrote it.
    """
    table = read_toml(path)
    _check_version(table, path)  # first: a later version may have other keys
    return parse(FittedWeights, table, str(path))


def _check_version(table: Mapping[str, Any], path: Path) -> None:
    record = table.get("fit")
    version = record.get("version") if isinstance(record, dict) else None
    if isinstance(version, str) and not () < _release(version) <= _release(__version__):
        raise VfoaError(
            f"{path}: fit.version: found {version!r}; expected that of this program, {__version__}, or an earlier one: "
            "update vfoa, or fit the weights again"
        )


def _release(version: str) -> tuple[int, ...]:
    """The numbers that a version begins with; none if it is no version."""
    numbers = re.match(r"\d{1,9}(\.\d{1,9})*", version, re.ASCII)
    return tuple(map(int, numbers[0].split("."))) if numbers else ()


def logit_only(tables: Mapping[str, Mapping[str, Any]], method: object) -> Mapping[str, Mapping[str, Any]]:
    """Return the tables of a preset that apply to a configuration of this method; None: it sets no method."""
    if "attention" not in tables or method in (None, tables["attention"].get("method")):
        return tables
    return {name: table for name, table in tables.items() if name != "attention"}


PRESETS: dict[str, dict[str, dict[str, Any]]] = {
    "none": {},
    # for clips of recorded 3D poses, which have no images
    "measured": {slot.name: {slot.key: OFF} for slot in STAGES.values()},
    # half the disparities of a quarter of the pixels, where objects and heads are; masks carried by optical flow;
    # in an image 1024 px wide, faces are found from 25 px on; clouds and heads of fewer points
    "realtime": {
        "stereo": {"resolution": "half", "region": "needed"},
        "segmentation": {"every": 5},
        "heads": {"max_size_px": 416},
        "reconstruction": {"max_points": 400, "max_eye_points": 1000},
    },
}


def preset_tables(name: str | None, where: str) -> Mapping[str, Mapping[str, Any]]:
    """Return the settings of a preset by table; none without a name. A ``.toml`` file is one that ``vfoa fit`` wrote.

    Raises
    ------
    VfoaError
        If there is no such preset; ``where`` opens the message.
    """
    if name is None:
        return {}
    if isinstance(name, str) and name.endswith(".toml"):
        return {"attention": {"method": "logit", "weights": read_fitted(Path(name)).attention.model_dump()["weights"]}}
    if not isinstance(name, str) or name not in PRESETS:
        problem = removed(("preset",), name) or did_you_mean(str(name), PRESETS)
        raise VfoaError(f"{where}: preset: no {name!r}; {problem}")
    return PRESETS[name]


RecordingKind = Literal["light", "jpeg", "none"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """Clips x configurations. ``notes`` are printed with the table.

    ``limit`` is the number of frames to take of each clip; None for all. ``annotator`` names the annotator whose labels
    are scored; None for ``annotations/<clip>.csv``. ``published`` are published figures for these configurations.
    ``missing`` says which clips of a family are not here. ``recording``: whether it is recorded, and with
    which pictures, unless the command line says so.
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
    if twice := next((clip for clip in chosen if chosen.count(clip) > 1), None):
        raise VfoaError(f"{where}: clips: {twice!r} occurs twice; expected each clip once")
    try:
        present, absent = clips_here(chosen)
    except VfoaError as error:
        raise VfoaError(f"{where}: clips: {error}") from None
    missing = (f"Not here, and not run: {', '.join(absent)}.",) if absent else ()
    changes = [parse_assignment(text, "stereo.matcher=sgbm") for text in overrides]
    configurations, partly = _configurations(file, changes, preset, where)
    if file.seeds > 1:
        configurations = tuple(
            configuration for base in configurations for configuration in repeated(base, file.seeds, where)
        )
    _check_published(file, [base_of(configuration.name) for configuration in configurations], where)
    return Experiment(
        name=path.stem,
        clips=present,
        configurations=configurations,
        limit=None if clips else file.limit,
        notes=(
            *map(Note, (*file.notes, *missing, *partly)),
            *_fitted_notes(file, preset, present),
            *shipped_notes(configurations, present),
        ),
        annotator=file.annotator,
        published=file.published,
        missing=missing,
        recording=file.recording,
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


def _configurations(
    file: _File, changes: list[tuple[str, Any]], preset: str | None, where: str
) -> tuple[tuple[Configuration, ...], list[str]]:
    """Return every configuration of the file with its defaults and the changes, and notes on changes that some lack."""
    made = []
    used: set[tuple[str, str]] = set()
    of_variants = list(variants(file.grid, file.configuration, where))
    presets = {variant.name: variant.preset or file.preset for variant in of_variants}
    bundles = {name: _bundle(preset, own, where) for name, own in presets.items()}
    tables_of = {
        variant.name: _with_quick_auto(
            merged(
                merged(file.defaults, bundles[variant.name]),
                dotted_tables([*variant.differences, *changes], TABLES, where),
            ),
            _preset_name(preset, presets[variant.name]),
        )
        for variant in of_variants
    }
    lacking = {key: [name for name, tables in tables_of.items() if not takes(tables, key)] for key, _ in changes}
    lacking = {key: names if len(names) < len(of_variants) else [] for key, names in lacking.items()}  # all: an error
    for variant in of_variants:
        of_file = dotted_tables(variant.differences, TABLES, where)
        taken = [(key, value) for key, value in changes if variant.name not in lacking[key]]
        own = dotted_tables([*variant.differences, *taken], TABLES, where)
        for chosen in (of_file, own):  # a stage that a change exchanges has still used its defaults
            used |= {(table, key) for table, settings in inherited(file.defaults, chosen).items() for key in settings}
        bundle = bundles[variant.name]
        default, of_own = (tables.get("attention", {}) for tables in (file.defaults, own))
        attention = {**default, **of_own}
        # a default that only names a method yields to fitted weights
        is_chosen = "method" in of_own if default.keys() == {"method"} else bool(attention)
        bundle = logit_only(bundle, attention.get("method", DEFAULT_METHOD) if is_chosen else None)
        tables = merged(inherited(merged(file.defaults, bundle), own), own)
        tables = _with_quick_auto(tables, _preset_name(preset, presets[variant.name]))
        of_variant = f"{where}: configuration {variant.name!r}"
        made.append(make_configuration(variant.name, tables, variant.factors, of_variant))
    check_all_used(file.defaults, used, where)
    notes = [
        f"{key} is not set in {', '.join(names)}: no such setting there." for key, names in lacking.items() if names
    ]
    return tuple(made), notes


def _with_quick_auto(tables: Tables, preset: str | None) -> Tables:
    """Return the tables in which the gaze model ``"auto"`` is the quick one, under the real-time preset.

    For one face on one core, MobileGaze takes 65 ms and ADAS-0002 8.
    """
    is_slow = preset == "realtime" and tables.get("gaze", {}).get("model") == AUTO
    return merged(tables, {"gaze": {"model": "adas_0002"}}) if is_slow else tables


def _preset_name(given: str | None, own: str | None) -> str | None:
    """Return the preset that counts: the given one, unless it is a file of fitted settings, else the experiment's."""
    return own if given is not None and given.endswith(".toml") else given or own


def _bundle(given: str | None, own: str | None, where: str) -> Tables:
    """Return the settings of presets: a given preset replaces the experiment's own; fitted settings override it."""
    tables = preset_tables(_preset_name(given, own), where)
    is_fitted = given is not None and given.endswith(".toml")
    return merged(tables, preset_tables(given, where)) if is_fitted else tables


def _fitted_notes(file: _File, preset: str | None, clips: tuple[str, ...]) -> Iterator[Note]:
    """Yield a note for each file of fitted settings: a warning if it was fitted on a clip that is reported."""
    names = [preset] if preset else [*(table.get("preset") for table in file.configuration), file.preset]
    for path in dict.fromkeys(Path(name) for name in names if isinstance(name, str) and name.endswith(".toml")):
        fitted_on = read_fitted(path).fit.clips
        if seen := [clip for clip in clips if clip in fitted_on]:
            yield fitted_on_reported(f"the weights of {path.name}", seen)
        else:
            yield Note(f"Weights of {path.name}, fitted on other clips: {', '.join(fitted_on)}.")


def shipped_notes(configurations: Iterable[Configuration], clips: tuple[str, ...]) -> Iterator[Note]:
    """Yield what weights that ship with a method have seen of the clips, as a warning, and what to expect on others."""
    methods = [configuration.attend.attention for configuration in configurations]
    fitted_on = {clip for method in methods for clip in method.fitted_on}
    if seen := [clip for clip in clips if clip in fitted_on]:
        yield fitted_on_reported("the default weights", seen)
    if len(seen) < len(clips):
        yield from map(Note, dict.fromkeys(method.elsewhere for method in methods if method.fitted_on))


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
