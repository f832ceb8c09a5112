"""Adding a clip: recognise a path, write its manifest, and an annotation file to start from."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from harness.clips.camera import camera_notes, camera_problems
from harness.clips.families import clip_files
from harness.clips.manifest import ClipManifest, as_clip_name, make_manifest, unknown_categories
from harness.clips.units import own_doubts
from harness.files.folders import find, is_run_of_program
from harness.files.io import read_text, write_together
from harness.files.parsing import parse_toml, toml_key, toml_value
from harness.files.safe_names import vfoa_command
from harness.labels.files import VERSION_LINE, format_annotations
from harness.labels.labels import IGNORED, UNLABELLED, Label, LabelRange, Labels
from harness.sources import ADAPTERS, Clip, MeasuredClip, Recognised, Recogniser
from harness.sources.foreign import refuse_foreign
from harness.sources.media.frame_files import DEPTH, IMAGE_SUFFIXES, walk_files
from vfoa.errors import VfoaError
from vfoa.types import Scene, StereoFrame, StereoRig

_CALIBRATIONS = ("calibration", "camera")


class Reading(NamedTuple):
    """A way to read a path, and its adapter."""

    adapter: str
    recognised: Recognised


def recognise(path: Path, adapter: str | None, given: Mapping[str, Any]) -> Reading:
    """Return the only way to read a path that agrees with the given settings, filled in with them.

    Ways without a calibration count only if no other has one.

    Raises
    ------
    VfoaError
        If no or several ways remain, or the calibration is missing.
    """
    readings = _readings(path, adapter, given)
    complete = [reading for reading in readings if reading.recognised.calibration] or readings
    fitting = [reading for reading in complete if len(complete) == 1 or _agrees(reading.recognised, given)]
    filled = [Reading(reading.adapter, _filled(reading.recognised, given)) for reading in fitting]
    distinct = [reading for place, reading in enumerate(filled) if reading not in filled[:place]]
    if len(distinct) != 1:
        raise VfoaError(f"{path}: {_alternatives(fitting or complete)}{_each_of_its_own(path, fitting or complete)}")
    recognised = distinct[0].recognised
    if recognised.calibration is None:
        missing = "; ".join(recognised.incomplete) or (
            "no calibration was found; expected --calibration FILE (formats: datasets/README.md; in the manifest: "
            "calibration = in [source]), or --fx --cx --cy, and --baseline of a rectified pair, in pixels and metres "
            "(the table [source.camera]), or --fov-deg, from the camera's data sheet, in place of the first three"
        )
        raise VfoaError(f"{path}: {recognised.layout}; {missing}")
    return distinct[0]


def _readings(path: Path, adapter: str | None, given: Mapping[str, Any]) -> list[Reading]:
    """Return every way in which an adapter can read the path."""
    if not path.exists():
        raise VfoaError(f"{path}: no such file or folder")
    if path.suffix == ".toml":
        raise VfoaError(f"{path}: found a manifest or an experiment; expected what a camera or a tracker recorded")
    refuse_foreign(path)
    names = [adapter] if adapter else ADAPTERS.names()
    adapters = {name: cls for name in names if isinstance(cls := ADAPTERS.load(name), Recogniser)}
    recognisers = {name: cls for name, cls in adapters.items() if _has_settings(name, given)}
    recognisers = recognisers or adapters  # a wrong key is named later
    readings: list[Reading] = []
    failures: list[VfoaError] = []
    for name, cls in recognisers.items():
        try:
            readings += [Reading(name, recognised) for recognised in cls.recognise(path, given)]
        except VfoaError as error:
            failures.append(error)
    if readings:
        return readings
    if failures:
        raise failures[0]
    tried = ", ".join(recognisers or names)
    if path.suffix.lower() in _TABLES:
        raise VfoaError(
            f"{path}: a table that is not recognised by {tried}; expected, of people, the columns frame, time_s, "
            "person, x_m, y_m, z_m and those of directions, as people.csv in a folder (docs/sources.md, Measurements "
            "without images), or, of labels, vfoa labels import FILE --clip CLIP"
        )
    found = _held(path) if path.is_dir() else ""
    raise VfoaError(f"{path}: not recognised by {tried}{found}; expected one of the sources in datasets/README.md")


def _has_settings(adapter: str, given: Mapping[str, Any]) -> bool:
    """Whether the given settings are ones of this adapter; a calibration may be of any."""
    return given.keys() - {*_CALIBRATIONS} <= ADAPTERS.load(adapter).Settings.model_fields.keys()


_TABLES = frozenset({".csv", ".tsv", ".txt", ".parquet", ".xlsx"})
"""Ends of the names of what trackers and eye trackers export."""
_RECORDINGS = frozenset({".mcap", ".bag", ".db3", ".svo2", ".mkv"})
"""Ends of the names of files that are clips by themselves."""
_FIRST_VIEW = ("left", "both", "colour")
"""The settings that name the left view, by the kind of source."""
_MOST_KINDS = 5
"""Most kinds of files that a message counts."""


def _held(path: Path) -> str:
    """The files of a folder by the ends of their names, the commonest first: images of a format that is not read."""
    files = [folder / name for folder, names in walk_files(path, None) for name in names]
    kinds = Counter(file.suffix or file.name for file in files)
    commonest = ", ".join(f"{count} {kind}" for kind, count in kinds.most_common(_MOST_KINDS))
    images = ", ".join(sorted(IMAGE_SUFFIXES))
    recording = next((file for file in files if file.suffix.lower() in _RECORDINGS), None)
    hint = "" if recording is None else f"; a recording is added by its own path, such as {path / recording}"
    return f"; found files, {DEPTH} levels of folders deep: {commonest or 'none'} (images are {images}){hint}"


def _agrees(recognised: Recognised, given: Mapping[str, Any]) -> bool:
    return all(recognised.source.get(key, value) == value for key, value in given.items() if key not in _CALIBRATIONS)


def _filled(recognised: Recognised, given: Mapping[str, Any]) -> Recognised:
    calibrations = {key: _below(recognised.root, value) for key, value in given.items() if key in _CALIBRATIONS}
    if not calibrations:
        return replace(recognised, source={**recognised.source, **given})
    seen = {key: value for key, value in recognised.source.items() if key not in _CALIBRATIONS}
    return replace(recognised, source={**seen, **given, **calibrations}, calibration="as given")


def _below(root: Path, calibration: Any) -> Any:
    """Paths of files relative to the clip's root, if they are below it, so that all can be moved together."""
    if isinstance(calibration, list):
        return [_below(root, file) for file in calibration]
    if isinstance(calibration, str) and Path(calibration).is_relative_to(root):
        return str(Path(calibration).relative_to(root))
    return calibration


def _alternatives(readings: Sequence[Reading]) -> str:
    """The settings in which readings differ, each with its values and the option that decides."""
    if len({reading.adapter for reading in readings}) > 1:
        layouts = ", ".join(f"--adapter {adapter} ({recognised.layout})" for adapter, recognised in readings)
        return f"several adapters can read it; expected one of: {layouts}"
    keys = dict.fromkeys(key for reading in readings for key in reading.recognised.source)
    values = {key: [str(reading.recognised.source.get(key)) for reading in readings] for key in keys}
    # One key that distinguishes all of them is enough: the left folder implies the right one.
    deciding = [key for key in keys if len(set(values[key])) == len(readings)][:1]
    choices = [
        f"{'--calibration ' if key == 'calibration' else f'--set {key}='}({' | '.join(dict.fromkeys(values[key]))})"
        for key in deciding or [key for key in keys if len(set(values[key])) > 1]
    ]
    return f"it can be read in {len(readings)} ways; expected {' and '.join(choices)}"


def _each_of_its_own(path: Path, readings: Sequence[Reading]) -> str:
    """How to add a clip of each folder, or of each film, if every reading is of one of its own; empty otherwise."""
    sources = [reading.recognised.source for reading in readings]
    first = [Path(str(next((source[key] for key in _FIRST_VIEW if key in source), ""))) for source in sources]
    folders, films = {file.parts[0] for file in first if len(file.parts) > 1}, {file.name for file in first}
    if len(folders) == len(readings) > 1:
        return f"; or a clip of each folder: {vfoa_command('clips', 'add', path)}/*/"
    is_film = all(str(source.get("layout")).startswith("video_") for source in sources)
    suffixes = {Path(film).suffix for film in films}
    if is_film and not folders and len(films) == len(readings) > 1 and len(suffixes) == 1:
        return f"; or a clip of each film: {vfoa_command('clips', 'add', path)}/*{suffixes.pop()}"
    return ""


_WHO = """
# Who is there and what is looked at, in the segmentation's words (datasets/README.md):
# [subjects.ann]
# category = "person"
# [targets.cup]
# category = "cup"
"""

Names = Mapping[str, str]
"""A name in the annotations -> its category."""

Rules = Mapping[str, Mapping[str, Any]]
"""A name in the annotations -> its rule in the manifest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Added:
    """The source found at a path, and the two files written. ``rig`` is None for a clip without images."""

    name: str
    adapter: str
    layout: str
    calibration: str
    frames: int
    first_frame: int
    last_frame: int
    rate_hz: float | None
    rig: StereoRig | None
    has_right: bool
    has_depth: bool
    notes: tuple[str, ...]
    subjects: tuple[str, ...]
    targets: tuple[str, ...]
    manifest: Path
    annotations: Path


def add_clip(
    path: Path,
    *,
    name: str | None = None,
    adapter: str | None = None,
    source: Mapping[str, Any] | None = None,
    subjects: Names | None = None,
    targets: Names | None = None,
    more_files: Callable[[Added, Clip | MeasuredClip], Mapping[Path, str]] | None = None,
) -> Added:
    """Write ``datasets/NAME.toml`` and ``annotations/NAME.csv`` into the working directory.

    Nothing is overwritten, except the two files of a clip that was added without people and not edited since.

    Parameters
    ----------
    path
        Any path that a registered adapter recognises.
    name
        The clip's name; by default made from the path.
    adapter
        The adapter to use, if several can read the path.
    source
        Settings of the adapter: they choose among several ways to read the path, and override what was found.
    subjects, targets
        The people and objects in the clip; a clip of measurements names them itself. Each subject gets one label,
        ``ignore``, for all frames.
    more_files
        Returns the texts of more files, which are written with these two.

    Raises
    ------
    VfoaError
        If no or several readings fit (the message lists them and the option that decides), no calibration was
        found or given, the first pair cannot be read, a clip or an experiment of vfoa has this name, or a file cannot
        be written. No file is left behind then.
    """
    path = Path(os.path.abspath(os.path.expanduser(path)))  # without .., but with links as they are named
    chosen, recognised = recognise(path, adapter, source or {})
    name = name or as_clip_name(recognised.name)
    bare = _manifest_text(name, chosen, recognised, {}, {})
    manifest_path, annotations_path = _free_paths(name, bare if subjects or targets else None)
    clip, first = _open(path, make_manifest(parse_toml(bare, manifest_path), manifest_path))
    rules: list[Rules] = [_from_left(subjects or {}), _from_left(targets or {})]
    if isinstance(clip, MeasuredClip):
        if subjects or targets:
            raise VfoaError(f"{path}: --subject, --target: expected none: the measurements name all people and objects")
        rules = [
            {measured: {"category": clip.categories[measured], "instance": number} for measured, number in ids.items()}
            for ids in (clip.people, clip.objects)
        ]
    text = _manifest_text(name, chosen, recognised, *rules)
    manifest = make_manifest(parse_toml(text, manifest_path), manifest_path)
    frame = None if isinstance(first, Scene) else first
    added = Added(
        name=name,
        adapter=chosen,
        layout=recognised.layout,
        calibration=str(recognised.calibration),
        frames=len(clip.frames),
        first_frame=clip.frames[0],
        last_frame=clip.frames[-1],
        rate_hz=clip.rate_hz,
        rig=None if frame is None else frame.rig,
        has_right=frame is not None and frame.right is not None,
        has_depth=frame is not None and frame.depth_m is not None,
        notes=(*clip.notes, *own_doubts(clip), *(() if frame is None else _notes(frame, manifest))),
        subjects=tuple(manifest.subjects),
        targets=tuple(manifest.targets),
        manifest=manifest_path,
        annotations=annotations_path,
    )
    more = more_files(added, clip) if more_files else {}
    try:
        # the manifest is put in place last: without it, labels are a left-over
        labels = format_annotations(_first_labels(manifest, clip))
        write_together({manifest_path: text, annotations_path: labels, **more})
    except OSError as error:
        raise VfoaError(f"{error.filename}: cannot be written: {error.strerror or error}") from None
    return added


def _notes(frame: StereoFrame, manifest: ClipManifest) -> Iterator[str]:
    """What is in question of the camera, and of the names."""
    yield from camera_problems([frame], manifest)
    yield from camera_notes(frame.rig)
    yield from unknown_categories(manifest)


def distinct_names(paths: Sequence[str]) -> dict[str, str | None]:
    """A name for each of several paths: None where that of the path itself will do.

    Paths that end alike (``p01/zed.mcap``, ``p02/zed.mcap``) are distinguished by as many of their folders as needed.
    """
    whole = {path: Path(os.path.abspath(os.path.expanduser(path))) for path in paths}
    parts = {path: (found.with_suffix("") if found.is_file() else found).parts for path, found in whole.items()}
    for depth in range(1, max(map(len, parts.values())) + 1):
        names = {path: as_clip_name("_".join(found[-depth:])) for path, found in parts.items()}
        if len({*names.values()}) == len(names):
            break
    return dict.fromkeys(paths) if depth == 1 else dict(names)


def _free_paths(name: str, bare: str | None) -> tuple[Path, Path]:
    """Return the paths of the two files, after checking that ``vfoa run NAME`` can only be this clip.

    ``bare`` is the manifest's text without people and objects: a clip that has it can be added again with them.
    """
    paths = Path.cwd() / "datasets" / f"{name}.toml", Path.cwd() / "annotations" / f"{name}.csv"
    if paths[0].is_file() and read_text(paths[0]) == bare and _is_left_over(paths[1]):
        return paths
    for what, taken in (("a clip", clip_files().get(name)), ("labels", find("annotations", name))):
        if taken is not None and not _is_left_over(taken):
            raise VfoaError(f"{taken}: found {what} of this name; expected another name: --name NAME")
    if is_run_of_program(name):
        raise VfoaError(f"{paths[0]}: vfoa run {name} is an experiment of vfoa; expected another name: --name NAME")
    return paths


def _is_left_over(path: Path) -> bool:
    """Whether labels are left, unedited, from adding a clip that was killed before its manifest was written."""
    if path.suffix != ".csv" or not path.is_file():
        return False
    version, _, *rows = [*read_text(path).splitlines(), "", ""]
    return version == VERSION_LINE and all(f",{IGNORED},{UNLABELLED}" in row for row in rows if row)


def _from_left(names: Names) -> Rules:
    """A rule for each name; several of one category are distinguished by their order from the left."""
    categories = list(names.values())
    rules: dict[str, dict[str, Any]] = {}
    for position, (name, category) in enumerate(names.items()):
        rules[name] = {"category": category}
        if categories.count(category) > 1:
            rules[name]["from_left"] = 1 + categories[:position].count(category)
    return rules


def _manifest_text(name: str, adapter: str, recognised: Recognised, subjects: Rules, targets: Rules) -> str:
    head = {"name": name, "adapter": adapter, "root": _portable(recognised.root), "licence": recognised.licence}
    lines = [f"{key} = {toml_value(value)}" for key, value in head.items() if value is not None]
    lines += ["", "[source]", *(f"{toml_key(key)} = {toml_value(value)}" for key, value in recognised.source.items())]
    for table, rules in (("subjects", subjects), ("targets", targets)):
        for rule_name, rule in rules.items():
            lines += ["", f"[{table}.{toml_key(rule_name)}]"]
            lines += [f"{key} = {toml_value(value)}" for key, value in rule.items()]
    return "\n".join(lines) + "\n" + ("" if subjects or targets else _WHO)


def _portable(root: Path) -> str:
    """The root by ``${VFOA_DATA}`` if it is below that, else absolute."""
    base = Path(os.path.normpath(os.path.expanduser(os.environ.get("VFOA_DATA", ""))))
    if not base.is_absolute() or not root.is_relative_to(base):  # a relative root is relative to the manifest
        return str(root)
    return "/".join(["${VFOA_DATA}", *root.relative_to(base).parts])


def _open(path: Path, manifest: ClipManifest) -> tuple[Clip | MeasuredClip, StereoFrame | Scene]:
    """Open the clip and read its first frame, to check that it can be read."""
    try:
        clip = manifest.open()
        if not clip.frames:
            raise VfoaError("the clip has no frames")
        first = clip.frames[0]
        return clip, clip.scene(first) if isinstance(clip, MeasuredClip) else clip.frame(first)
    except VfoaError as error:
        text = str(error).removeprefix(f"{manifest.path}: ")
        where = "" if text.startswith(str(path)) else f"{path}: "
        hint = " (here as --set KEY=VALUE)" if "[source]" in text else ""
        raise VfoaError(f"{where}{text}{hint}") from None


def _first_labels(manifest: ClipManifest, clip: Clip | MeasuredClip) -> Labels:
    """Label every subject as unscored in all frames: a row to split that cannot be taken for a judgement."""
    todo = Label(target=IGNORED, note=UNLABELLED)
    first, last = clip.frames[0], clip.frames[-1]
    return Labels(
        LabelRange(first_frame=first, last_frame=last, subject=subject, label=todo) for subject in manifest.subjects
    )
