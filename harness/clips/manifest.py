"""Clip manifests: ``datasets/<clip>.toml``, checked and opened.

Several clips may have one (:mod:`harness.clips.families`).
"""

from __future__ import annotations

import difflib
import os
import re
import unicodedata
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

from pydantic import Field, PrivateAttr, field_validator, model_validator

from harness.clips.families import (
    clip_files,
    clips_of,
    families,
    family_of,
    find_manifest,
    is_pattern,
    matching,
    member_of,
)
from harness.clips.naming import NameRule, is_automatic
from harness.files.folders import came_with_program
from harness.files.garbage import collected_later
from harness.files.io import is_file
from harness.files.parsing import read_toml
from harness.files.remote import expand
from harness.files.safe_names import check_name, composed_keys
from harness.labels.drawn_shapes import Drawn, read_drawn
from harness.labels.files import AnnotationFiles, read_annotations
from harness.labels.labels import RESERVED, Labels, Timeline
from harness.sources import ADAPTERS, Clip, MeasuredClip
from harness.sources.media.frame_times import HIGHEST_HZ
from vfoa.coco import STUFF, THINGS
from vfoa.errors import VfoaError, located
from vfoa.scoring import is_word_of_tables
from vfoa.settings import Settings
from vfoa.validation import parse


class PhaseRule(Settings):
    """Which frames of a clip are a phase of it: those with this number of things beside people."""

    things: int = Field(ge=0)


FETCHED = ("idiap_vfoa", "opencv_stereo", "sintel", "vr_objects")
"""What ``vfoa clips fetch`` downloads, each to a folder of this name in ``VFOA_DATA``."""
_FETCHED_ROOT = re.compile(rf"\$\{{VFOA_DATA\}}/({'|'.join(FETCHED)})(/.*)?")
_CLIP_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9.-]*(_[A-Za-z0-9.-]+)*")


class ClipManifest(Settings):
    """One clip: the source of its frames, the people and objects in it, and its licence.

    ``source`` holds the adapter's own settings, ``notes`` are for readers of the tables. ``labels_file`` is an
    annotation file below the root, which counts as long as there is no ``annotations/<clip>.csv``, and must then exist.
    ``phases`` are parts of the recording in which people do something else: tables have their rates apart, too.
    """

    name: str
    adapter: str
    root: str | None = None
    labels_file: str | None = None
    licence: str | None = None
    citation: str | None = None
    notes: tuple[str, ...] = ()
    source: dict[str, Any] = Field(default_factory=dict)
    subjects: dict[str, NameRule] = Field(default_factory=dict)
    targets: dict[str, NameRule] = Field(default_factory=dict)
    phases: dict[str, PhaseRule] = Field(default_factory=dict)

    _path: Path = PrivateAttr()

    @field_validator("name")
    @classmethod
    def _name_of_files(cls, name: str) -> str:
        """Two underscores separate clip and configuration in the names of a run's files."""
        if not _CLIP_NAME.fullmatch(name):
            raise ValueError(
                f"found {name!r}; expected letters (A to Z), digits, '.' and '-', also in words joined by one '_' each"
            )
        return name

    @field_validator("subjects", "targets")
    @classmethod
    def _no_reserved_names(cls, rules: dict[str, NameRule]) -> dict[str, NameRule]:
        for name in rules:
            if name in RESERVED:
                raise ValueError(f"found the name {name!r}; expected a word other than {' and '.join(RESERVED)}")
            if is_word_of_tables(name):
                raise ValueError(f"found the name {name!r}, a word of tables and pages; expected another")
            if is_automatic(name):
                raise ValueError(
                    f"found the name {name!r}, the form of unnamed objects; expected a name without #NUMBER"
                )
            check_name(name)
        return composed_keys(rules)

    @field_validator("phases")
    @classmethod
    def _distinct_phases(cls, rules: dict[str, PhaseRule]) -> dict[str, PhaseRule]:
        names: dict[int, str] = {}
        for name, rule in rules.items():
            check_name(name)
            if names.setdefault(rule.things, name) != name:
                raise ValueError(
                    f"{name}: things: {rule.things} is that of {names[rule.things]!r}; expected another number"
                )
        return rules

    @model_validator(mode="after")
    def _distinct_names(self) -> Self:
        if both := sorted(self.subjects.keys() & self.targets.keys()):
            raise ValueError(
                f"targets.{both[0]}: a subject has this name, and is a target under it already; expected another name"
            )
        keys: dict[str, str] = {}
        for name, rule in (*self.targets.items(), *self.subjects.items()):
            if rule.key is not None and keys.setdefault(rule.key, name) != name:
                raise ValueError(f"{name}: key: {rule.key!r} is the key of {keys[rule.key]!r}; expected another one")
        shared: dict[str, str] = {}
        for name, rule in self.targets.items():
            if rule.is_shared and (other := shared.setdefault(rule.category, name)) != name:
                raise ValueError(
                    f"targets.{name}: every {rule.category!r} is {other!r} already; "
                    "expected instance, from_left, at_px or box_px"
                )
        return self

    @property
    def path(self) -> Path:
        """The file that it was read from."""
        return self._path

    @property
    def word(self) -> str | Path:
        """What names the clip in a command: its name, or its file if this name is that of no clip here or another's."""
        known = clip_files().get(self.name)
        return self.name if known and known.absolute() == self._path else self._path

    def naming(self) -> dict[str, Any]:
        """The subjects and targets as JSON, with everything that decides which person or object gets a name."""
        kinds = ("subjects", "targets")
        return self.model_dump(
            mode="json", include={*kinds}, exclude={kind: {"__all__": {"key", "colour", "formerly"}} for kind in kinds}
        )

    def phase_of_things(self) -> dict[int, str]:
        """The phase of a frame by the number of its things."""
        return {rule.things: name for name, rule in self.phases.items()}

    def names_now(self, then: Mapping[str, Any]) -> dict[str, str]:
        """Return the present name of each target that was renamed since a run, by its name in the run.

        ``then`` are the targets' rules in the run, by name; empty if they are not known. If another target has the
        earlier name by now, the name belongs to the target whose rule is unchanged.
        """
        now: dict[str, Any] = self.naming()["targets"]
        return {
            old: name
            for name, target in self.targets.items()
            for old in target.formerly
            if (old in then or not then) and (then.get(old) == now[name] or not (old in now or name in then))
        }

    @property
    def annotations(self) -> AnnotationFiles:
        """The clip's annotation files, one for each annotator."""
        with_clip = (self.root or ".", self.labels_file) if self.labels_file else None
        return AnnotationFiles(clip=self.name, manifest=self._path, with_clip=with_clip)

    @property
    def files(self) -> tuple[Path, ...]:
        """The manifest, the clip's annotation files, and its recording or video. No output may replace them."""
        root = self.resolve_root()
        return (self._path, *self.annotations.present(), *([root] if root is not None and is_file(root) else []))

    def resolve_root(self) -> Path | None:
        """Return the root with its variables filled in, relative to the manifest; it need not exist."""
        with self._fetch_named():
            return None if self.root is None else expand(self.root, self._path.parent, f"{self._path}: root")

    @property
    def fetch_hint(self) -> str:
        """The command that downloads the root, to end a message with; empty for a clip that none downloads."""
        match = _FETCHED_ROOT.fullmatch(self.root or "")
        return f"; fetch it: vfoa clips fetch {match[1]}" if match else ""

    @contextmanager
    def _fetch_named(self, root: Path | None = None) -> Iterator[None]:
        """End the messages of errors with :attr:`fetch_hint`, if the root is not there."""
        try:
            yield
        except VfoaError as error:
            if root is not None and root.exists():
                raise
            raise VfoaError(f"{error}{self.fetch_hint}") from None

    def with_root(self, root: Path) -> ClipManifest:
        """Return the same clip with its files in another folder."""
        moved = self.model_copy(update={"root": str(root.absolute())})
        moved._path = self._path
        return moved

    def open_images(self, instead: str = "") -> Clip:
        """Open a clip that has images.

        Raises
        ------
        VfoaError
            As :meth:`open`, or if the clip holds measurements; the message ends with what to do ``instead``.
        """
        clip = self.open()
        if isinstance(clip, MeasuredClip):
            raise VfoaError(f"{self._path}: the clip holds measurements; expected one with images{instead}")
        return clip

    def open(self) -> Clip | MeasuredClip:
        """Open the clip.

        Raises
        ------
        VfoaError
            If the adapter or one of its settings is not known, or the source cannot be opened.
        """
        with located(self._path):
            adapter = ADAPTERS.load(self.adapter)
        settings = parse(adapter.Settings, self.source, str(self._path), "source")
        root = self.resolve_root()
        with self._fetch_named(root), located(self._path), collected_later():
            clip: Clip | MeasuredClip = adapter(settings, root)
            _check_times(clip)
        return clip

    def labels(self, timeline: Timeline | None, annotator: str | None = None) -> Labels | None:
        """Read the labels to score, checked against the clip's names and, if they are known, its frames.

        They are those of ``<clip>.csv`` (None if there is none), or those of one annotator. Suggestions become
        ``ignore``.

        Raises
        ------
        VfoaError
            If the file has an error, or the annotator has none.
        """
        path = self.annotations.find() if annotator is None else self.annotations.expect(annotator)
        if path is None:
            return None
        return self.read(path, timeline).confirmed()

    def drawn(self, frames: Sequence[int] | None) -> Drawn | None:
        """Read the shapes drawn on the clip, checked against its names and, if they are known, its frames.

        Raises
        ------
        VfoaError
            If the file has an error.
        """
        path = self.annotations.find_drawn()
        if path is None:
            return None
        return read_drawn(path, frames=frames, subjects=self.subjects, targets=self.targets)

    def read(self, path: Path, timeline: Timeline | None, *, allow_gaps: bool = False) -> Labels:
        """Read one of the clip's annotation files; parameters and errors are those of :func:`read_annotations`."""
        return read_annotations(
            path,
            timeline=timeline,
            subjects=self.subjects,
            targets=self.targets,
            former=self.names_now({}),
            allow_gaps=allow_gaps,
        )


def _check_times(clip: Clip | MeasuredClip) -> None:
    """Reject times that no file of ours and no recording can hold, and more frames per second than cameras take."""
    for number in (*clip.frames[:1], *clip.frames[-1:]):
        if not abs(time_ns := clip.time_ns(number)) < 2**63:
            raise VfoaError(
                f"frame {number}: its time is {time_ns / 1e9:.3g} s; expected less than 9.2e9: numbers that are times "
                'have no rate_hz, but stamps = "ns" (or us, ms, s) in [source]'
            )
    if clip.rate_hz is not None and clip.rate_hz > HIGHEST_HZ:
        raise VfoaError(
            f"found {clip.rate_hz:.6g} frames per second by their times; expected at most {HIGHEST_HZ:g}: are they "
            'in another unit? Numbers in names have stamps = "us" (or ms, s) in [source], tables time_s or time_ns'
        )


def as_clip_name(text: str) -> str:
    """Make a clip's name from any text, letters without their accents; ``clip`` if nothing of it is left."""
    plain = "".join(sign for sign in unicodedata.normalize("NFKD", text) if not unicodedata.combining(sign))
    return re.sub(r"[^A-Za-z0-9.-]+", "_", plain).strip("._-") or "clip"


def load_manifest(name_or_path: str | os.PathLike[str], clip: str | None = None) -> ClipManifest:
    """Read a manifest by the clip's name, or by its path (anything that ends in ``.toml``).

    ``clip`` is the name of one clip of a family, if the path is that of a family.

    Raises
    ------
    VfoaError
        If there is none, or it has an unknown key or a wrong value: file, dotted key, found, expected.
    """
    text = os.fspath(name_or_path)
    by_path = text.endswith(".toml")
    path = Path(text) if by_path else find_manifest(text)
    return make_manifest(read_toml(path), path, clip if by_path else text)


def manifest_of_run(place: str, clip: str, annotator: str | None) -> ClipManifest:
    """Read the manifest of a run's clip where the run found it or, if it is not there now, by name.

    A clip that came with the program can have another manifest of its name by now, a copy with renamed targets. The
    labels are then found beside that one, if there are any by this annotator, and have its names: so it is read.

    Raises
    ------
    VfoaError
        As :func:`load_manifest`; of a clip that is not there, it says where it was.
    """
    if not is_file(Path(place)):
        if place and clip not in clip_files():
            raise VfoaError(
                f"no clip {clip!r}: when the run was made it was {place}, which is not there; expected it there, or a "
                "clip of this name here: if it was renamed, give it and its labels the earlier name, or run it again"
            )
        return load_manifest(clip)
    if (members := clips_of(Path(place))) and clip not in members and clip in clip_files():
        return load_manifest(clip)
    then = load_manifest(place, clip)
    if came_with_program(then.path) and (now := load_manifest(clip)).annotations.find(annotator):
        return now
    return then


def make_manifest(data: dict[str, Any], path: Path, clip: str | None = None) -> ClipManifest:
    """Return the manifest with a file's content; the file need not exist yet. ``clip``: one of a family's.

    Raises
    ------
    VfoaError
        As :func:`load_manifest`.
    """
    if "clips" in data:
        data = member_of(data, path, clip)
    manifest = parse(ClipManifest, data, str(path))
    if manifest.name not in (path.stem, clip):
        raise VfoaError(f"{path}: name: found {manifest.name!r}; expected {path.stem!r}, the name of the file")
    manifest._path = path.absolute()
    return manifest


def clips_here(chosen: Iterable[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Replace each family, by its name or file, and each pattern by its clips, once.

    Return the clips to use, and those whose root is not here.

    Raises
    ------
    VfoaError
        If no clip of a family is here, no clip matches, or a root needs a variable that is not set.
    """
    known = families()
    here: list[str] = []
    absent: list[str] = []
    for name in map(family_of, chosen):
        if name not in known:
            here += matching(name) if is_pattern(name) else [name]
            continue
        roots = {clip: load_manifest(clip).resolve_root() for clip in known[name]}
        present = [clip for clip, root in roots.items() if root is None or root.exists()]
        if not present:
            clip, root = next(iter(roots.items()))
            raise VfoaError(
                f"{name}: none of its {len(roots)} clips is here; expected the first one at {root}"
                f"{load_manifest(clip).fetch_hint}"
            )
        here += present
        absent += [clip for clip in roots if clip not in present]
    return tuple(dict.fromkeys(here)), tuple(absent)


_COCO = frozenset({*THINGS.values(), *STUFF.values()})


def manifest_notes(manifest: ClipManifest, clip: Clip) -> list[str]:
    """Categories that are similar to a word of COCO and occur nowhere in the clip's ground truth."""
    known = known_categories(clip)
    notes = []
    for table, rules in (("subjects", manifest.subjects), ("targets", manifest.targets)):
        for name, rule in rules.items():
            near = _similar(rule.category, known)
            if near is not None:
                notes.append(
                    f"{table}.{name}: no model of COCO's categories knows {rule.category!r}; did you mean {near!r}?"
                )
    return notes


def _similar(category: str, known: Collection[str]) -> str | None:
    """The known category that a word was meant for, in capitals or not; None if it is one, or none is similar."""
    if category in known:
        return None
    folded = {word.casefold(): word for word in known}
    near = difflib.get_close_matches(category.casefold(), folded, n=1, cutoff=0.75)
    return folded[near[0]] if near else None


def unknown_categories(manifest: ClipManifest) -> list[str]:
    """One note about all targets whose category is not in COCO."""
    unknown = []
    for name, rule in manifest.targets.items():
        if rule.category not in _COCO:
            near = _similar(rule.category, _COCO)
            unknown.append(f"{name} ({rule.category}{f'; did you mean {near!r}?' if near else ''})")
    note = (
        f"no model of COCO's categories knows {', '.join(unknown)}: take other masks, or draw: "
        f"vfoa annotate {manifest.name}, key p"
    )
    return [note] if unknown else []


def known_categories(clip: Clip | MeasuredClip) -> frozenset[str]:
    """The categories of the segmentation models, which are COCO's, and those of the clip's ground truth, or its own."""
    if isinstance(clip, MeasuredClip):
        return frozenset(clip.categories.values())
    instances = clip.truth(clip.frames[0]).instances
    return _COCO | frozenset(instance.label for instance in instances.instances) if instances else _COCO
