"""List clips and check whether each can be used: files, calibration, rectification, labels."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.clips import frame_checks
from harness.clips.manifest import ClipManifest, clip_files, load_manifest
from harness.clips.manifest_checks import manifest_notes, manifest_problems
from harness.clips.matching import matched_offsets_px
from harness.clips.measured import measurement_problems
from harness.clips.near_limit import first_middle_last, near_notes
from harness.files.folders import folders
from harness.labels.labels import IGNORED
from harness.labels.timeline import timeline_of
from harness.remote import unset_variables
from harness.sources import Clip, MeasuredClip
from vfoa.errors import VfoaError
from vfoa.types import StereoFrame


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipRow:
    """One clip of the list. ``frames`` is None if it cannot be opened; ``problem`` says why."""

    name: str
    adapter: str | None = None
    frames: int | None = None
    subjects: tuple[str, ...] = ()
    targets: tuple[str, ...] = ()
    licence: str | None = None
    labels: int | None = None
    problem: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ClipCheck:
    """The result of checking one clip; it can be used if there are no ``problems``.

    ``labels`` counts (frame, subject) pairs whose label is scored, None without an annotation file.
    ``vertical_error_px`` is the median row difference of matched points, None with too few of them. Without right
    images there are no ``baseline_m`` and no ``matches``. ``notes`` are further facts for the user: losses of the
    source, checks that were not possible, how much depth a sensor measured.
    """

    name: str
    frames: int | None = None
    size_px: tuple[int, int] | None = None
    fx_px: float | None = None
    baseline_m: float | None = None
    vertical_error_px: float | None = None
    matches: int | None = None
    labels: int | None = None
    notes: tuple[str, ...] = ()
    problems: tuple[str, ...] = ()


def list_clips() -> list[ClipRow]:
    """Return every clip that can be found, by name."""
    return [_row(name, path) for name, path in clip_files().items()]


@dataclass(frozen=True, slots=True, kw_only=True)
class AtHand:
    """The clips of the working directory, or of the package if there are none, whose data can be checked.

    ``elsewhere``: by environment variable, clips whose root needs one that is not set. ``packaged``: clips of the
    package that are left out, because the working directory has clips of its own.
    """

    clips: tuple[str, ...]
    elsewhere: dict[str, list[str]]
    packaged: tuple[str, ...]


def clips_at_hand() -> AtHand:
    """Return the clips that ``vfoa clips check`` checks by default; a manifest that cannot be read is included."""
    found = clip_files()
    own = {name: path for name, path in found.items() if path.parent == folders("datasets")[0]}
    here: list[str] = []
    elsewhere: dict[str, list[str]] = {}
    for name, path in (own or found).items():
        try:
            root = load_manifest(path, name).root or ""
        except VfoaError:
            root = ""
        if unset := unset_variables(root):
            elsewhere.setdefault(unset[0], []).append(name)
        else:
            here.append(name)
    packaged = tuple(name for name in found if own and name not in own)
    return AtHand(clips=tuple(here), elsewhere=elsewhere, packaged=packaged)


def check_clip(name_or_path: str, *, every_frame: bool = False) -> ClipCheck:
    """Open a clip, decode its first, middle and last frame, and check calibration, rectification and labels.

    With ``every_frame``, decode all frames, and count those that cannot be read. Of a clip of measurements, check every
    frame: that its names exist and that its positions are in metres.
    """
    name = Path(name_or_path).stem if name_or_path.endswith(".toml") else name_or_path
    unreadable: tuple[str, ...] = ()
    try:
        manifest = load_manifest(name_or_path)
        clip = manifest.open()
        unreadable = _unreadable(clip) if every_frame and not isinstance(clip, MeasuredClip) else ()
        frames = [] if isinstance(clip, MeasuredClip) else _sample(clip)
    except VfoaError as error:
        return ClipCheck(name=name, problems=unreadable or (str(error),))
    labels, label_problems = _labels(manifest, clip)
    if isinstance(clip, MeasuredClip):
        return ClipCheck(
            name=manifest.name,
            frames=len(clip.frames),
            labels=labels,
            notes=clip.notes,
            problems=(*measurement_problems(manifest, clip), *manifest_problems(manifest), *label_problems),
        )
    pairs = [(frame, frame.right) for frame in frames if frame.right is not None]
    offsets = [matched_offsets_px(frame.left, right) for frame, right in pairs]
    matches = sum(map(len, offsets)) if pairs else None
    error_px = None
    if matches is not None and matches >= frame_checks.MIN_MATCHES:
        error_px = float(np.median(np.abs(np.concatenate(offsets)[:, 1])))
    rig = frames[0].rig
    return ClipCheck(
        name=manifest.name,
        frames=len(clip.frames),
        size_px=(rig.width_px, rig.height_px),
        fx_px=rig.fx_px,
        baseline_m=rig.baseline_m if pairs else None,
        vertical_error_px=error_px,
        matches=matches,
        labels=labels,
        notes=(
            *clip.notes,
            *frame_checks.unmeasured(matches),
            *frame_checks.depth_notes(frames),
            *near_notes(frames),
            *manifest_notes(manifest, clip),
        ),
        problems=(
            *unreadable,
            *frame_checks.calibration_problems(frames, says_unit="calibration_unit" in manifest.source),
            *frame_checks.image_problems(frames),
            *frame_checks.rectification_problems(error_px),
            *frame_checks.depth_problems(frames),
            *(frame_checks.order_problems([frame for frame, _ in pairs], offsets) if error_px is not None else ()),
            *manifest_problems(manifest),
            *label_problems,
            *_drawn_problems(manifest, clip),
        ),
    )


def _unreadable(clip: Clip) -> tuple[str, ...]:
    """The frames that cannot be read: their number, each number, and the first error."""
    errors: dict[int, str] = {}
    for number in clip.frames:
        try:
            clip.frame(number)
        except VfoaError as error:
            errors[number] = str(error)
    if not errors:
        return ()
    first = next(iter(errors.values()))
    return (f"{len(errors)} of {len(clip.frames)} frames cannot be read: {', '.join(map(str, errors))}; {first}",)


def _drawn_problems(manifest: ClipManifest, clip: Clip) -> tuple[str, ...]:
    """The first error in the shapes drawn on the clip."""
    try:
        manifest.drawn(clip.frames)
    except VfoaError as error:
        return (str(error),)
    return ()


def _row(name: str, path: Path) -> ClipRow:
    try:
        manifest = load_manifest(path, name)
    except VfoaError as error:
        return ClipRow(name=name, problem=str(error))
    clip, problem = _open(manifest)
    labels, label_problems = _labels(manifest, clip)
    return ClipRow(
        name=manifest.name,
        adapter=manifest.adapter,
        frames=None if clip is None else len(clip.frames),
        subjects=tuple(manifest.subjects),
        targets=tuple(manifest.targets),
        licence=manifest.licence,
        labels=labels,
        problem=problem or next(iter(label_problems), None),
    )


def _open(manifest: ClipManifest) -> tuple[Clip | MeasuredClip | None, str | None]:
    try:
        return manifest.open(), None
    except VfoaError as error:
        return None, str(error)


def _labels(manifest: ClipManifest, clip: Clip | MeasuredClip | None) -> tuple[int | None, tuple[str, ...]]:
    """Number of (frame, subject) pairs with a label that is scored, and problems.

    If the clip cannot be opened, the rows' own lengths count.
    """
    try:
        labels = manifest.labels(None if clip is None else timeline_of(clip))
    except VfoaError as error:
        return None, (str(error),)
    if labels is None:
        return None, ()
    if clip is None:
        scored = [each for each in labels.ranges if each.label.target != IGNORED]
        return sum(each.last_frame - each.first_frame + 1 for each in scored), ()
    return sum(1 for _, _, label in labels.labelled(clip.frames) if label.target != IGNORED), ()


def _sample(clip: Clip) -> list[StereoFrame]:
    """The first, middle and last frame, each once; reading the ground truth checks that it can be read."""
    if not clip.frames:
        raise VfoaError("the clip has no frames")
    numbers = first_middle_last(clip.frames)
    for number in numbers:
        clip.truth(number)
    return [clip.frame(number) for number in numbers]
