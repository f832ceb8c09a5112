"""A run's recordings as the viewer opens them: the layers of a clip with a layout."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from harness.files.ascending import numbers_per_second
from harness.record.layers import ClipFiles, LayerNames, layer_names
from harness.run.directory import Pair, RunDirectory
from harness.run.grid import base_of, is_meant
from vfoa.errors import VfoaError, did_you_mean

if TYPE_CHECKING:
    import rerun.blueprint as rrb

    from harness.record.blueprint import ClipContent


@dataclass(frozen=True, slots=True, kw_only=True)
class Composed:
    """Files that form one recording, by a name, and the layout in which they open.

    ``clip`` and ``frames`` are those of the run; none for a file outside a run, which is read if they are needed.
    ``make_layout`` takes the subject whose tab is in front (None: the first). It reads the files, so it is called only
    when they are opened; None for the layout in the files. ``subject`` is in front unless another one is asked for.
    """

    name: str
    files: tuple[Path, ...]
    clip: str | None = None
    frames: tuple[int, ...] = ()
    make_layout: Callable[[str | None], rrb.Blueprint] | None = None
    subject: str | None = None

    @property
    def application_id(self) -> str:
        """The application id of the files, under which the viewer keeps their layout.

        Raises
        ------
        VfoaError
            If the first file cannot be read.
        """
        from harness.record.reading import RecordingFile

        return RecordingFile(self.files[0]).ids.application

    def layout(self, subject: str | None = None) -> rrb.Blueprint | None:
        """Return the layout, with this subject's tab in front; None for the one in the files.

        Raises
        ------
        VfoaError
            If a file cannot be read.
        """
        return self.make_layout(subject or self.subject) if self.make_layout else None

    def files_to_open(self, scratch: Path) -> list[Path]:
        """The files in the order to open them: the layout first, if there is one, saved in the folder ``scratch``.

        Raises
        ------
        VfoaError
            If a file cannot be read.
        """
        if (layout := self.layout()) is None:
            return list(self.files)
        layout.save(self.application_id, str(scratch / "layout.rbl"))
        return [scratch / "layout.rbl", *self.files]

    def expect_files(self) -> None:
        """Reject a recording of which a file is missing."""
        for file in self.files:
            if not file.is_file():
                raise VfoaError(f"{file}: found no such recording; was the run made without it?")

    def expect_frame(self, frame: int) -> None:
        """Reject a frame that the recording does not have: the viewer would silently show the nearest one.

        Raises
        ------
        VfoaError
            Also if a file outside a run cannot be read.
        """
        from harness.record.reading import RecordingFile

        frames = self.frames or RecordingFile(self.files[0]).frames()
        if frame not in frames:
            below, above = [each for each in frames if each < frame], [each for each in frames if each > frame]
            nearest = " or ".join(str(each) for each in (*sorted(below)[-1:], *sorted(above)[:1]))
            known = f"{min(frames)} to {max(frames)}, such as {nearest}" if frames else "(none)"
            raise VfoaError(f"{self.files[0]}: found no frame {frame}; expected one of {known}")


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordedClip:
    """The recordings of one clip in a run, for the selected configurations.

    ``probabilistic`` are the configurations whose attention is a probability.
    """

    files: ClipFiles
    layers: tuple[LayerNames, ...]
    subjects: tuple[str, ...]
    frames: tuple[int, ...]
    rate_hz: float | None
    probabilistic: frozenset[str]

    def expect_subject(self, subject: str | None) -> None:
        """Reject a subject that the clip does not have; None is any."""
        if subject is not None and subject not in self.subjects:
            raise VfoaError(f"{self.files.clip}: no subject {subject!r}; {did_you_mean(subject, self.subjects)}")

    def under(self, configuration: str) -> RecordedClip:
        """Return the clip with only one of these configurations, or with all that repeat it under seeds."""
        layers = tuple(layer for layer in self.layers if is_meant(layer.configuration, configuration))
        return replace(self, layers=layers)

    def layer_files(self) -> dict[str, Path]:
        """Every existing file of the clip, by the part of its name that differs from the clip's other files."""
        files = dict.fromkeys(file for layer in self.layers for file in self.files.of(layer))
        return {file.stem.removeprefix(self.files.clip).removeprefix("__") or "images": file for file in files}

    def compose(self) -> Composed:
        """Combine all layers into one recording: one configuration, or a tab for each."""
        from harness.record.blueprint import clip_layout

        names = [layer.configuration for layer in self.layers]
        return self._composed("__".join((self.files.clip, *(names if len(names) == 1 else ()))), clip_layout)

    def compare(self, first: str, second: str) -> Composed:
        """Two configurations side by side."""
        from harness.record.blueprint import comparison_layout

        both = replace(self, layers=(*self.under(first).layers, *self.under(second).layers))
        return both._composed(f"{self.files.clip}__{first}__vs__{second}", comparison_layout)

    def _composed(self, name: str, make_layout: Callable[..., rrb.Blueprint]) -> Composed:
        return Composed(
            name=name,
            files=tuple(dict.fromkeys(file for layer in self.layers for file in self.files.of(layer))),
            clip=self.files.clip,
            frames=self.frames,
            make_layout=lambda subject: make_layout(self.layers, content_of([self]), self.subjects, subject),
        )


def common_layout(clips: Sequence[RecordedClip]) -> rrb.Blueprint:
    """The layout for any of several clips of a run, at least one: a tab for each person if all have the same people.

    Raises
    ------
    VfoaError
        If a file cannot be read.
    """
    from harness.record.blueprint import clip_layout

    layers = list(dict.fromkeys(layer for clip in clips for layer in clip.layers))
    people = {clip.subjects for clip in clips}
    return clip_layout(layers, content_of(clips), people.pop() if len(people) == 1 else (), None)


def content_of(clips: Sequence[RecordedClip]) -> ClipContent:
    """What the files of clips hold together; the rate is the first one's. Raises as :func:`common_layout`."""
    from harness.record import entities
    from harness.record.blueprint import ClipContent, eye_on
    from harness.record.reading import RecordingFile, first_shapes

    images = [RecordingFile(clip.files.images) for clip in clips if clip.files.images.is_file()]
    attention = [clip.files.attention(layer.configuration) for clip in clips for layer in clip.layers]
    curves = [RecordingFile(file) for file in attention if file.is_file()]
    paths = {chunk.entity_path for file in (*images, *curves) for chunk in file.chunks()}
    times_ns = [span for file in curves if (span := file.times_ns()) is not None]
    files = dict.fromkeys(clip.files.reconstruction(layer.reconstruction) for clip in clips for layer in clip.layers)
    frames = [frame for clip in clips for frame in clip.frames]
    return ClipContent(
        has_images=entities.IMAGE in paths,
        has_right=entities.RIGHT in paths,
        has_measured_depth=entities.MEASURED_DEPTH in paths,
        eye=eye_on([points for file in files if file.is_file() for points in first_shapes(file)]),
        per_second=numbers_per_second(clips[0].frames, clips[0].rate_hz),
        span=(min(frames), max(frames)) if frames else None,
        is_from_0=all(first <= _MOST_LENGTHS * (last - first) for first, last in times_ns),
        curves=frozenset(path for path in paths if path.startswith(f"{entities.ATTENTION}/")),
        probabilistic=clips[0].probabilistic,
    )


_MOST_LENGTHS = 9
"""Lengths of a clip by which its first time may come after 0: its curves then take a tenth of a plot from 0 on."""


def find_clips(run: Path, clip: str | None, configuration: str | None) -> list[RecordedClip]:
    """Find a run's recordings, clip by clip in the order of its manifest; only of one clip or configuration, if given.

    Raises
    ------
    VfoaError
        If ``run`` is no directory of a run, or nothing was recorded of that clip and configuration.
    """
    clips = [recorded_clip for recorded_clip in _clips(run) if recorded_clip.layers]
    if not clips:
        why = "was it run with --recording none?"
        if not RunDirectory(run).read_manifest().finished:
            why = "the run is not finished: repeat the same `vfoa run` to continue it"
        raise VfoaError(f"{run}: expected recordings (*.rrd), found none; {why}")
    if clip is not None:
        known = [recorded_clip.files.clip for recorded_clip in clips]
        clips = [recorded_clip for recorded_clip in clips if recorded_clip.files.clip == clip]
        if not clips:
            raise VfoaError(f"{run}: found no recording of clip {clip!r}; {did_you_mean(clip, known)}")
    if configuration is not None:
        known = [base_of(layers.configuration) for recorded_clip in clips for layers in recorded_clip.layers]
        clips = [under for recorded_clip in clips if (under := recorded_clip.under(configuration)).layers]
        if not clips:
            raise VfoaError(f"{run}: found no recording under {configuration!r}; {did_you_mean(configuration, known)}")
    return clips


def _clips(run: Path) -> list[RecordedClip]:
    """Every clip of a run, with its recorded configurations, if there are any."""
    manifest, recorded = RunDirectory(run).read_manifest(), []
    names = layer_names(manifest.configurations).values()
    probabilistic = frozenset(name for name, method in manifest.methods.items() if method.probabilistic)
    for clip in manifest.clips:
        files = ClipFiles(run=run, clip=clip.name)
        layers = tuple(name for name in names if files.attention(name.configuration).is_file())
        subjects, frames = clip.subjects, tuple(clip.frames)
        recorded.append(
            RecordedClip(
                files=files,
                layers=layers,
                subjects=subjects,
                frames=frames,
                rate_hz=clip.rate_hz,
                probabilistic=probabilistic,
            )
        )
    return recorded


def find_recordings(
    run: Path, clip: str | None, configuration: str | None, subject: str | None = None
) -> list[Composed]:
    """Return the recordings to open: each clip of a run with its configurations, or ``run`` if it is a recording.

    The tab of ``subject`` is in front.

    Raises
    ------
    VfoaError
        If there is none, the first clip does not have that subject, or a part of a recording is asked for.
    """
    if run.suffix == ".rrd" and not run.is_dir():
        if not run.is_file():
            raise VfoaError(f"{run}: no such file")
        if (clip, configuration, subject) != (None, None, None):
            raise VfoaError(f"{run}: one recording has one layout: leave out --clip, --config and --subject")
        return [Composed(name=run.stem, files=(run,))]
    clips = find_clips(run, clip, configuration)
    clips[0].expect_subject(subject)
    return [replace(recorded_clip.compose(), subject=subject) for recorded_clip in clips]


def by_name(recordings: Iterable[Composed]) -> dict[str, Composed]:
    """The recordings by the names under which they are served."""
    return {recording.name: recording for recording in recordings}


def served_recordings(run: Path) -> dict[Pair, Composed]:
    """Every recorded (clip, configuration) of a run, each as a recording of its own; empty without recordings."""
    pairs = [(clip, layers.configuration) for clip in _clips(run) for layers in clip.layers]
    return {(clip.files.clip, name): clip.under(name).compose() for clip, name in pairs}
