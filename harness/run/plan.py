"""The plan of a run: an experiment with every input opened once, and the description of all that it depends on."""

from __future__ import annotations

import platform
import subprocess
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from harness.clips.check_measured import nameless_subjects
from harness.clips.families import clip_files
from harness.clips.manifest import ClipManifest, load_manifest
from harness.clips.matching import first_middle_last, near_notes
from harness.clips.units import clip_doubts
from harness.files.digests import code_digest, file_digest
from harness.files.safe_names import vfoa_command
from harness.labels.labels import Labels, timeline_of
from harness.pipeline.configuration import METHODS, STAGES, Configuration, StageChoice, open_method, reads_clip
from harness.pipeline.drawn_stage import DrawnClip, check_drawn
from harness.pipeline.stage_runner import guarded
from harness.pipeline.weights import locate_weights, missing_weights
from harness.run.directory import Pair
from harness.run.executors import Executor, cores
from harness.run.experiment import Experiment, load_experiment
from harness.run.fitted import notes_on_fits
from harness.run.frame_sink import SinkFactory
from harness.run.manifest import AnswerTraits, ClipOfRun, NamesOfClip, NoteOfRun, RunManifest
from harness.run.notes import Note, NoteKind
from harness.sources import Clip, FilmClip, MeasuredClip
from vfoa.errors import VfoaError, located
from vfoa.methods import MethodSettings
from vfoa.stereo.block_matching_settings import BlockMatchingSettings


@dataclass(frozen=True, kw_only=True)
class PreparedClip:
    """An opened clip with its labels and, if used, its drawn shapes."""

    manifest: ClipManifest
    clip: Clip | MeasuredClip
    frames: tuple[int, ...]
    labels: Labels | None
    drawn: DrawnClip | None = None

    @cached_property
    def digest(self) -> str:
        """The digest of the clip's content, computed at the first call and kept: it takes reading all images."""
        return self.clip.digest()


@dataclass(frozen=True, slots=True)
class Fit:
    """Fits the weights that configurations lack.

    ``weights`` returns them by the configuration's name, from the tables of each (clip, configuration) that has some,
    with the workers of the run. The code of ``modules`` decides them.
    """

    weights: Callable[[Plan, Mapping[Pair, Mapping[str, Path]], Executor], Mapping[str, MethodSettings]]
    modules: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A run whose inputs have all been opened once, so that errors that can be found early are found by now."""

    experiment: Experiment
    clips: tuple[PreparedClip, ...]
    sinks: tuple[SinkFactory, ...] = ()
    fit: Fit | None = None

    @property
    def pairs(self) -> list[Pair]:
        """Every (clip, configuration), in the order of the tables."""
        return [
            (prepared.manifest.name, configuration.name)
            for prepared in self.clips
            for configuration in self.experiment.configurations
        ]

    @property
    def stages(self) -> list[StageChoice]:
        """The stages of every configuration."""
        return [choice for configuration in self.experiment.configurations for choice in configuration.stages]

    @property
    def unfitted(self) -> list[Configuration]:
        """The configurations whose weights are still to be fitted."""
        return [each for each in self.experiment.configurations if each.attend.attention.is_unfitted]

    @property
    def deciding_modules(self) -> tuple[str, ...]:
        """The modules whose code decides the results: a change to any other does not make another run."""
        stages = {STAGES[choice.slot].stage_class(choice.name).__module__ for choice in self.stages}
        adapters = {type(prepared.clip).__module__ for prepared in self.clips}
        methods = {METHODS.load(each.attend.attention.method).__module__ for each in self.experiment.configurations}
        fits = self.fit.modules if self.fit and self.unfitted else ()
        return tuple(sorted({"harness.run.loop", *stages, *adapters, *methods, *fits}))

    @property
    def frames(self) -> int:
        """Number of frames to read, over all clips."""
        return sum(len(prepared.frames) for prepared in self.clips)


def prepare(
    experiment: Experiment, *, limit: int | None = None, sinks: Iterable[SinkFactory] = (), fit: Fit | None = None
) -> Plan:
    """Open every clip, read every label file and find every weights file of an experiment; note likely problems.

    Parameters
    ----------
    limit
        Take only the first frames of each clip; the experiment's own limit if None.
    sinks
        Sinks of the finished frames, beside the results.
    fit
        Fits the weights of configurations that have none; None: there must be none.

    Raises
    ------
    VfoaError
        For the first thing that is missing or wrong.
    """
    limit = experiment.limit if limit is None else limit
    manifests = [manifest_of(name, experiment) for name in experiment.clips]
    _check_names(manifests, experiment)
    clips = tuple(_prepare_clip(manifest, limit, experiment) for manifest in manifests)
    experiment = _for_clips(experiment, (prepared.clip for prepared in clips))
    notes = (
        *_notes_on_names(clips, experiment.configurations),
        *(f"{prepared.manifest.name}: {prepared.drawn.summary}" for prepared in clips if prepared.drawn),
        *_notes_on_near(clips, experiment.configurations),
    )
    doubts = (
        Note(f"{prepared.manifest.name}: {doubt}", NoteKind.DOUBT)
        for prepared in clips
        for doubt in (
            *clip_doubts(prepared.clip, prepared.frames),
            *_doubts_on_answers(prepared, experiment.configurations),
        )
    )
    noted = replace(experiment, notes=(*experiment.notes, *map(Note, notes), *doubts))
    return Plan(experiment=noted, clips=clips, sinks=tuple(sinks), fit=fit)


def _for_clips(experiment: Experiment, clips: Iterable[Clip | MeasuredClip]) -> Experiment:
    """The experiment with the stages that these clips have input for."""
    if not all(isinstance(clip, MeasuredClip) for clip in clips):
        return experiment
    without_images = tuple(configuration.without_images() for configuration in experiment.configurations)
    return replace(experiment, configurations=without_images)


def needed_stages(experiment: Experiment) -> list[StageChoice]:
    """The stages that a run of an experiment has, without the rest of its plan.

    Raises
    ------
    VfoaError
        If a clip cannot be opened.
    """
    experiment = _for_clips(experiment, [manifest_of(name, experiment).open() for name in experiment.clips])
    return [choice for configuration in experiment.configurations for choice in configuration.stages]


def default_stages(clip: str) -> list[StageChoice]:
    """The stages of the default run of a clip, or of a family of clips; see :func:`needed_stages`."""
    return needed_stages(load_experiment("default", clips=(clip,)))


def fetch_command(clip: str) -> str:
    """The command that fetches the models of the default run of a clip, or of a family of clips."""
    return vfoa_command("models", "fetch", "--for", clip)


def manifest_of(name: str, experiment: Experiment) -> ClipManifest:
    """Read the manifest of a clip of an experiment.

    Raises
    ------
    VfoaError
        As :func:`harness.clips.manifest.load_manifest`; of an unknown clip, the file that names it comes first.
    """
    try:
        return load_manifest(name)
    except VfoaError as error:
        is_here = Path(name).is_file() if name.endswith(".toml") else name in clip_files()
        if is_here:
            raise
        raise experiment.wrong("clips", error) from None


def _check_names(manifests: Iterable[ClipManifest], experiment: Experiment) -> None:
    """Refuse two clips of one name, whose results would be in the same files; names are given, or paths.

    Names that differ only in capitals count as one: macOS and Windows have one file for both.
    """
    earlier: dict[str, ClipManifest] = {}
    for manifest in manifests:
        other = earlier.setdefault(manifest.name.lower(), manifest)
        if other is manifest:
            continue
        both = f"{other.path} and {manifest.path} are both called {manifest.name!r}"
        if other.name != manifest.name:
            both = f"the names {other.name!r} and {manifest.name!r} differ only in capitals, and may share files"
        raise experiment.wrong("clips", VfoaError(f"{both}; expected each clip once, with a name of its own"))


def _prepare_clip(manifest: ClipManifest, limit: int | None, experiment: Experiment) -> PreparedClip:
    clip = manifest.open()
    if isinstance(clip, MeasuredClip) and (problem := next(nameless_subjects(manifest, clip), None)):
        raise VfoaError(f"{manifest.path}: {problem}")
    _check_annotator(manifest, experiment)
    labels = manifest.labels(timeline_of(clip), experiment.annotator)
    drawn = None if isinstance(clip, MeasuredClip) else drawn_on(manifest, clip.frames, experiment)
    return PreparedClip(manifest=manifest, clip=clip, frames=tuple(clip.frames)[:limit], labels=labels, drawn=drawn)


def _check_annotator(manifest: ClipManifest, experiment: Experiment) -> None:
    try:
        if experiment.annotator is not None:
            manifest.annotations.expect(experiment.annotator)
    except VfoaError as error:
        raise experiment.wrong("annotator", error) from None


def drawn_on(manifest: ClipManifest, frames: Sequence[int], experiment: Experiment) -> DrawnClip | None:
    """The drawing of a clip with these frames, if a configuration uses it.

    Raises
    ------
    VfoaError
        If the file is wrong, or if a configuration uses nothing but the drawing and nothing is drawn.
    """
    if not any(configuration.uses_drawn for configuration in experiment.configurations):
        return None
    drawn = manifest.drawn(frames)
    for configuration in experiment.configurations:
        check_drawn(manifest.name, drawn, configuration)
    return DrawnClip.of(manifest, drawn) if drawn else None


def _notes_on_names(clips: Iterable[PreparedClip], configurations: Iterable[Configuration]) -> Iterator[str]:
    """Notes on names that use the source's own ids while masks come from a network, which numbers them anew."""
    choices = [configuration.choices["segmentation"] for configuration in configurations]
    networks = sorted(
        {choice.name for choice in choices if choice and choice.name not in STAGES["segmentation"].of_clip}
    )
    for clip in [prepared for prepared in clips if not isinstance(prepared.clip, MeasuredClip)] if networks else ():
        rules = {**clip.manifest.subjects, **clip.manifest.targets}
        if names := [name for name, rule in rules.items() if rule.instance is not None]:
            yield (
                f"{clip.manifest.name}: the manifest finds {', '.join(names)} by their ids in the source, "
                f"which differ from those of {' and '.join(networks)}: the names can be wrong."
            )


def _notes_on_near(clips: Iterable[PreparedClip], configurations: Iterable[Configuration]) -> Iterator[str]:
    """Notes on objects nearer than a matcher searches. Unreadable images are ignored: the run reports them."""
    stereo = [choice.settings for configuration in configurations if (choice := configuration.choices["stereo"])]
    limits_m: set[float] = {settings.min_depth_m for settings in stereo if isinstance(settings, BlockMatchingSettings)}
    for clip in clips:
        images = clip.clip
        searched_m = [limit_m for limit_m in sorted(limits_m) if limit_m > getattr(images, "nearest_m", 0.0)]
        if isinstance(images, MeasuredClip) or not searched_m:
            continue
        try:
            frames = [images.frame(number) for number in first_middle_last(clip.frames)]
        except VfoaError:
            continue
        for limit_m in searched_m:
            yield from (f"{clip.manifest.name}: {note}." for note in near_notes(frames, limit_m))


def describe(plan: Plan) -> RunManifest:
    """Return everything that a plan's results depend on, as a run's manifest begins.

    Raises
    ------
    VfoaError
        If weights are missing: which, how to fetch them, and which models can replace them.
    """
    configurations = plan.experiment.configurations
    weights = locate_weights(
        plan.stages, _default_fetch(plan), where=plan.experiment.where
    )  # before a stage of a clip opens them
    of_sinks = {key: value for sink in plan.sinks for key, value in sink.described().items()}
    digests = {prepared.manifest.name: prepared.digest for prepared in plan.clips}
    notes = (*plan.experiment.notes, *notes_on_fits(plan.experiment.fits, digests))
    return RunManifest(
        experiment=plan.experiment.name,
        notes=[NoteOfRun(text=note.text, kind=note.kind) for note in notes],
        published=plan.experiment.published,
        annotator=plan.experiment.annotator,
        clips=[_describe_clip(prepared, plan.experiment) for prepared in plan.clips],
        configurations={configuration.name: configuration.plain() for configuration in configurations},
        methods={configuration.name: _describe_method(configuration, plan.clips) for configuration in configurations},
        left_out_labels_sha256=_labels_of_fits(plan),
        factors={configuration.name: dict(configuration.factors) for configuration in configurations},
        weights_sha256={name: file_digest(path) for name, path in weights.items()},
        versions=versions(),
        source_sha256=code_digest(plan.deciding_modules),
        **{"recording": None, **of_sinks},
    )


def _labels_of_fits(plan: Plan) -> dict[str, str | None] | None:
    """The digests of the labels by clip, if weights are still to be fitted to them."""
    if not plan.unfitted:
        return None
    clips = (prepared.manifest for prepared in plan.clips)
    return {manifest.name: manifest.annotations.digest(plan.experiment.annotator) for manifest in clips}


def _doubts_on_answers(prepared: PreparedClip, configurations: Iterable[Configuration]) -> Iterator[str]:
    """What is in question about the tables of answers of a clip, each once; for unreadable ones describe raises."""
    doubts: dict[str, None] = {}
    for configuration in configurations:
        if reads_clip(configuration.attend.attention):
            with suppress(VfoaError):
                doubts |= dict.fromkeys(getattr(_open(configuration, prepared), "doubts", ()))
    yield from doubts


def _open(configuration: Configuration, prepared: PreparedClip) -> Any:
    """The method of a configuration for a clip."""
    settings = configuration.attend.attention.for_clip(prepared.manifest.name)
    return guarded(f"{configuration.name}: attention", open_method, settings, prepared.manifest, prepared.clip)


def _describe_method(configuration: Configuration, clips: Iterable[PreparedClip]) -> AnswerTraits:
    """What the answers of a configuration are: scores need it, and import no method.

    Raises
    ------
    VfoaError
        If a method cannot be opened, or the answers of clips differ in this.
    """
    described: dict[str, dict[str, bool]] = {}
    for prepared in clips if reads_clip(configuration.attend.attention) else [*clips][:1]:
        method = _open(configuration, prepared)
        described[prepared.manifest.name] = {
            "probabilistic": method.probabilistic,
            "says_nowhere": method.says_nowhere,
            "from_file": getattr(method, "from_file", False),
        }
    (first, of_first), *others = described.items()
    if other := next((name for name, of_other in others if of_other != of_first), None):
        differ = next(key for key, value in of_first.items() if value != described[other][key])
        raise VfoaError(
            f"{configuration.name}: attention: {differ} is {of_first[differ]} for {first} and "
            f"{described[other][differ]} for {other}; expected answers of one kind, or a configuration for each"
        )
    return AnswerTraits(**of_first)


def _default_fetch(plan: Plan) -> str | None:
    """The command that fetches the models of a default run, if it fetches just what is missing for this one."""
    missing = missing_weights(plan.stages)
    if missing is None:
        return None
    of_default = missing_weights(default_stages(plan.experiment.clips[0]))
    same = of_default is not None and of_default.models == missing.models
    return fetch_command(plan.experiment.clips[0]) if same else None


def _describe_clip(prepared: PreparedClip, experiment: Experiment) -> ClipOfRun:
    return ClipOfRun(
        name=prepared.manifest.name,
        manifest=str(prepared.manifest.path),
        licence=prepared.manifest.licence,
        citation=prepared.manifest.citation,
        notes=[*prepared.manifest.notes, *prepared.clip.notes],
        rate_hz=prepared.clip.rate_hz,
        frames=list(prepared.frames),
        times_ns=[prepared.clip.time_ns(number) for number in prepared.frames],
        films=dict(prepared.clip.films) if isinstance(prepared.clip, FilmClip) else {},
        sha256=prepared.digest,
        drawn_sha256=None if prepared.drawn is None else prepared.drawn.digest,
        names=NamesOfClip.model_validate(prepared.manifest.naming()),
        stage_outputs_sha256=output_digests(experiment, prepared.manifest, prepared.clip),
    )


_PACKAGES = (
    *("vfoa", "filterpy", "mcap", "numpy", "onnxruntime", "open3d", "open3d-cpu"),
    *("opencv-contrib-python-headless", "pandas", "rerun-sdk", "scipy"),
)


def output_digests(experiment: Experiment, manifest: ClipManifest, clip: Clip | MeasuredClip) -> list[str]:
    """The sha256 of the files that each distinct stage reads for a clip, in their order, then those of methods.

    Raises
    ------
    VfoaError
        If a file that a method reads is missing or wrong: the experiment, the configuration, and what is wrong.
    """
    own = [configuration.for_clip(manifest.name) for configuration in experiment.configurations]
    of_methods: dict[str, str] = {}
    for each in own:
        settings, name = each.attend.attention, each.attend.attention.model_dump_json()
        if reads_clip(settings) and name not in of_methods:
            with located(f"{experiment.where}: configuration {each.name!r}"):
                of_methods[name] = open_method(settings, manifest, clip).digest()
    if isinstance(clip, MeasuredClip):
        return [*of_methods.values()]
    distinct = {f"{choice.slot} {choice.plain()}": choice for each in own for choice in each.stages}
    digests = (STAGES[choice.slot].files_digest(choice, clip) for choice in distinct.values())
    return [*(digest for digest in digests if digest is not None), *of_methods.values()]


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that can change a result."""
    installed = {package: found for package in _PACKAGES if (found := _version(package))}
    return {"python": platform.python_version(), **installed}


@cache
def _version(package: str) -> str | None:
    """The version of a package, read once in a process; None if it is not installed."""
    with suppress(PackageNotFoundError):
        return version(package)
    return None


def source_commit() -> str | None:
    """The git commit of this source tree, with ``-dirty`` if it was changed; None outside a checkout."""
    root = Path(__file__).parent.parent.parent
    if not (root / ".git").exists():
        return None
    # `git describe --dirty` would lock and rewrite the index of the checkout
    command = ["git", "--no-optional-locks", "status", "--porcelain=v2", "--branch", "--untracked-files=no"]
    with suppress(OSError):  # no git here
        lines = subprocess.run(command, cwd=root, capture_output=True, text=True, check=False).stdout.splitlines()
        commits = [line.rpartition(" ")[2] for line in lines if line.startswith("# branch.oid ")]
        is_dirty = not all(line.startswith("#") for line in lines)
        return f"{commits[0]}{'-dirty' * is_dirty}" if commits else None
    return None


def host() -> dict[str, Any]:
    """The machine, without anything that identifies its owner."""
    return {"system": platform.system(), "machine": platform.machine(), "cores": cores()}
