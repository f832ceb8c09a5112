"""A configuration: every setting of one way to run the pipeline, made of tables of settings.

A table belongs to one of the five exchangeable stages (:data:`STAGES`) or to one step. An experiment gives tables as
defaults, presets and differences; each overrides the ones before it.

A stage of the library knows only frames and is built as ``Class(settings)``. A stage of the harness reads something
that belongs to the clip (its ground truth, files of other programs) and is built as ``Class(settings, clip)``.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import vfoa.gaze
import vfoa.head_pose
import vfoa.heads
import vfoa.methods
import vfoa.segmentation
import vfoa.stereo
from harness.clips.manifest import ClipManifest
from harness.sources import Clip, MeasuredClip
from vfoa import config
from vfoa.config import Tables, is_in_region, read_steps
from vfoa.drawn import DrawnSettings
from vfoa.errors import VfoaError, did_you_mean
from vfoa.methods import DEFAULT_METHOD, MethodSettings
from vfoa.pipeline import AttendSettings
from vfoa.reconstruction import ReconstructionSettings
from vfoa.registry import Registry
from vfoa.segmentation.key_frames import KeyFrameSegmenter, KeyFrameSettings, path_to
from vfoa.settings import Settings
from vfoa.validation import parse

if TYPE_CHECKING:
    from vfoa.onnx import Provider


DRAWN = "drawn"
"""The name of the stages that use only the shapes drawn on the clip."""
OFF = "none"
"""The name that switches a stage off. Clips with images need a matcher, segmentation and heads."""
MEASURED = "measured"
"""The name of the stages that give the directions of a clip of measurements."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageKind:
    """One place in the pipeline: its table in a configuration, the key that selects a stage, and the stages.

    ``of_clip`` are those that read something of the clip, by name.
    """

    name: str
    key: str
    library: Registry
    of_clip: Mapping[str, str]

    def __contains__(self, name: object) -> bool:
        """Whether this slot takes the name."""
        return isinstance(name, str) and (name == OFF or name in self.of_clip or name in self.library)

    def parse(self, table: Mapping[str, Any], where: str) -> StageChoice | None:
        """Read ``{key: name, **settings}``; None for a stage that is switched off. ``"auto"`` becomes a stage's name.

        Raises
        ------
        VfoaError
            If the name or a setting is not known; ``where`` opens the message.
        """
        name = table.get(self.key)
        if name is None:
            if unknown := table.keys() - (known := self.settings()):
                key = min(unknown)
                raise VfoaError(f"{where}: unknown key '{self.name}.{key}'; {did_you_mean(key, known)}")
            found = f" (found: {', '.join(f'{self.name}.{key}' for key in table)})" if table else ""
            expected = ", ".join(self.names())
            raise VfoaError(f"{where}: {self.name}.{self.key}: missing; expected one of: {expected}{found}")
        settings = {key: value for key, value in table.items() if key != self.key}
        if name == OFF:
            return None
        name = self.library.resolve(name)
        if name not in self:
            raise VfoaError(f"{where}: {self.name}.{self.key}: no {name!r}; {did_you_mean(str(name), self.names())}")
        owners = partial(self.library.choices_with, f"{self.name}.{self.key}")
        checked = parse(
            self.stage_class(name).Settings, settings, where, self.name, siblings=(self.key,), owners=owners
        )
        return StageChoice(slot=self.name, name=name, settings=checked)

    def takes(self, name: object, key: str) -> bool:
        """Whether the stage called ``name`` has a setting called ``key``; False for an unknown name."""
        if key == self.key:
            return True
        stage = self.library.resolve(str(name))
        return stage != OFF and stage in self and key in self.stage_class(stage).Settings.model_fields

    def settings(self) -> set[str]:
        """Every key that the slot's table can have, with one stage or another."""
        stages = (self.stage_class(name) for name in self.names() if name != OFF)
        return {self.key}.union(*(stage.Settings.model_fields for stage in stages))

    def build(self, choice: StageChoice, clip: Clip) -> Any:
        """Build the stage for one clip."""
        stage, settings = self._of_every_frame(choice, clip), choice.settings
        if not isinstance(settings, KeyFrameSettings) or settings.every == 1:
            return stage
        return KeyFrameSegmenter(stage, lambda number: path_to(number, clip.frames, settings.every), clip.frame)

    def _of_every_frame(self, choice: StageChoice, clip: Clip) -> Any:
        cls = self.stage_class(choice.name)
        return cls(choice.settings, clip) if choice.name in self.of_clip else cls(choice.settings)

    def is_true(self, choice: StageChoice) -> bool:
        """Whether the stage answers from the ground truth of a person, without an image."""
        return hasattr(self.stage_class(choice.name), "of_person")

    def without_images(self, choice: StageChoice) -> StageChoice | None:
        """What takes the place of a stage on a clip of measurements: itself, what is measured, or nothing."""
        return choice if self.is_true(choice) else self.parse({self.key: self.measured}, "clip of measurements")

    @property
    def measured(self) -> str:
        """The name of the stage for clips of measurements: what is measured, or :data:`OFF` if nothing is."""
        return MEASURED if MEASURED in self.of_clip else OFF

    def finds_faces(self, name: str) -> bool:
        """Whether heads of the detector called ``name`` can have a face."""
        return getattr(self.stage_class(name), "finds_faces", True)

    def needs_face(self, choice: StageChoice) -> bool:
        """Whether the stage has no answer for a head without a face."""
        return getattr(self.stage_class(choice.name), "needs_face", False)

    def files_digest(self, choice: StageChoice, clip: Clip) -> str | None:
        """Hexadecimal sha256 of the files that the stage reads for a clip; None for a stage that reads none."""
        if choice.name not in self.of_clip or not hasattr(self.stage_class(choice.name), "digest"):
            return None
        digest: str = self._of_every_frame(choice, clip).digest()
        return digest

    def names(self) -> list[str]:
        """Every name this slot takes, sorted."""
        return sorted({*self.library.names(), *self.of_clip, OFF})

    def stage_class(self, name: str) -> Any:
        """The class of the stage called ``name``."""
        registry = Registry(kind=self.library.kind, builtin=self.of_clip, group="") if name in self.of_clip else None
        return (registry or self.library).load(name)


CLIP_VARIABLE = "${CLIP}"
"""Placeholder of the clip's name in a stage's settings, so that one configuration reads the files of every clip."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StageChoice:
    """A stage by name with its checked settings."""

    slot: str
    name: str
    settings: Settings

    @property
    def key(self) -> str:
        """A text that identifies the stage with its settings."""
        return f"{self.slot} {json.dumps(self.plain(), sort_keys=True)}"

    def for_clip(self, clip: str) -> StageChoice:
        """Return the choice with the clip's name filled in wherever its settings have the placeholder."""
        texts = {key: value for key, value in dict(self.settings).items() if isinstance(value, str)}
        filled = {key: text.replace(CLIP_VARIABLE, clip) for key, text in texts.items() if CLIP_VARIABLE in text}
        return self.updated(filled) if filled else self

    def on(self, provider: Provider) -> StageChoice:
        """Return the choice with its networks on a provider of ONNX Runtime; a stage without networks is unchanged."""
        return self.updated({"provider": provider}) if "provider" in type(self.settings).model_fields else self

    def updated(self, settings: Mapping[str, Any]) -> StageChoice:
        """Return the choice with some of its settings replaced, which are not checked."""
        return replace(self, settings=self.settings.model_copy(update=settings))

    def plain(self) -> dict[str, Any]:
        """Return the choice as JSON values, with every default."""
        return {STAGES[self.slot].key: self.name, **self.settings.model_dump(mode="json")}


_OF_CLIP: Sequence[tuple[Registry, Mapping[str, str]]] = (
    (vfoa.stereo.MATCHERS, {"truth": "ground_truth:TruthMatcher", "files": "stage_files.maps:FileMatcher"}),
    (
        vfoa.segmentation.SEGMENTERS,
        {
            "truth": "ground_truth:TruthSegmenter",
            "coco_instances": "stage_files.coco_instances:CocoInstances",
            "coco_panoptic": "stage_files.coco_panoptic:CocoPanoptic",
            "id_maps": "stage_files.id_maps:IdMaps",
            DRAWN: "drawn_stage:DrawnMasks",
        },
    ),
    (
        vfoa.heads.DETECTORS,
        {"truth": "ground_truth:TruthHeads", "files": "stage_files.heads:FileHeads", DRAWN: "drawn_stage:DrawnHeads"},
    ),
    (
        vfoa.head_pose.MODELS,
        {
            "truth": "ground_truth:TruthHeadPose",
            "simulated": "ground_truth:SimulatedHeadPose",
            MEASURED: "measured_stage:MeasuredHeadPose",
            "files": "stage_files.directions:FileHeadPose",
        },
    ),
    (
        vfoa.gaze.MODELS,
        {
            "truth": "ground_truth:TruthGaze",
            "simulated": "ground_truth:SimulatedGaze",
            MEASURED: "measured_stage:MeasuredGaze",
            "files": "stage_files.directions:FileGaze",
        },
    ),
)
"""The stages of the library, and beside them those that read something of the clip, in the order of the pipeline."""
STAGES: dict[str, StageKind] = {
    name: StageKind(
        name=name,
        key=key,
        library=library,
        of_clip={stage: f"harness.pipeline.{place}" for stage, place in of_clip.items()},
    )
    for library, of_clip in _OF_CLIP
    for name, key in [library.kind.split(".")]
}


METHODS_OF_CLIP = {"answers": "harness.pipeline.stage_files.answers:FileAnswers"}
"""Methods of attention that read something of the clip: built as ``Class(settings, manifest, clip)``."""
METHODS = Registry(
    kind=vfoa.methods.METHODS.kind,
    builtin={**vfoa.methods.METHODS.builtin, **METHODS_OF_CLIP},
    group=vfoa.methods.METHODS.group,
)
"""The methods of the library, and those of a clip."""


def reads_clip(settings: MethodSettings) -> bool:
    """Whether the method that these settings name reads something of the clip, which has a ``digest``."""
    return settings.method in METHODS_OF_CLIP


def open_method(settings: MethodSettings, manifest: ClipManifest, clip: Clip | MeasuredClip) -> Any:
    """Return the method that these settings name, a :class:`vfoa.methods.AttentionMethod`, for one clip.

    Raises
    ------
    VfoaError
        If a file of the clip that it reads is missing or wrong.
    """
    cls = METHODS.load(settings.method)
    return cls(settings, manifest, clip) if reads_clip(settings) else cls(settings)


STEPS: Mapping[str, type[Settings]] = {"drawn": DrawnSettings, **config.STEPS}
"""Drawn shapes and the steps after perception, as in :data:`vfoa.config.STEPS`."""

TABLES = (*STAGES, *STEPS)
"""The tables of a configuration: the stages in the order of the pipeline, then the steps."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Configuration:
    """Every setting of one way to run the pipeline. ``choices`` has one entry per slot, None for one switched off.

    ``factors`` are the labels of its place in a grid by dotted key; empty without a grid. ``drawn`` is switched on for
    the stages that are ``"drawn"``.
    """

    name: str
    choices: Mapping[str, StageChoice | None]
    reconstruction: ReconstructionSettings
    attend: AttendSettings
    drawn: DrawnSettings = field(default_factory=DrawnSettings)
    factors: Mapping[str, str] = field(default_factory=dict)

    @property
    def stages(self) -> list[StageChoice]:
        """The stages that are not switched off."""
        return [choice for choice in self.choices.values() if choice]

    @property
    def settings(self) -> dict[str, Settings]:
        """The settings by table, of the stages that are not switched off and of all steps."""
        steps = {name: getattr(self.attend, name) for name in type(self.attend).model_fields}
        of_stages = {choice.slot: choice.settings for choice in self.stages}
        return {**of_stages, "drawn": self.drawn, "reconstruction": self.reconstruction, **steps}

    @property
    def is_in_region(self) -> bool:
        """Whether the matcher is asked only for the disparities of objects and heads."""
        stereo = self.choices["stereo"]
        return stereo is not None and is_in_region(stereo.settings)

    @property
    def uses_drawn(self) -> bool:
        """Whether any drawn shapes of a clip are used."""
        return self.drawn.targets or self.drawn.heads

    def for_clip(self, clip: str) -> Configuration:
        """Return the configuration with the clip's name in a stage's ``root``, and with the clip's own weights."""
        changed = self.changed(lambda choice: choice.for_clip(clip))
        return changed.attending(self.attend.attention.for_clip(clip))

    def attending(self, attention: MethodSettings) -> Configuration:
        """Return the configuration with another method of attention."""
        return replace(self, attend=self.attend.model_copy(update={"attention": attention}))

    def on(self, provider: Provider) -> Configuration:
        """Return the configuration with all its networks on one provider of ONNX Runtime."""
        return self.changed(lambda choice: choice.on(provider))

    def without_images(self) -> Configuration:
        """Return the configuration for clips of measurements: a head pose or gaze is the true or the measured one."""
        return self.changed(lambda choice: STAGES[choice.slot].without_images(choice))

    def changed(self, change: Callable[[StageChoice], StageChoice | None]) -> Configuration:
        """Return the configuration with each stage that is not switched off replaced by another choice, or None."""
        choices = {slot: change(choice) if choice else None for slot, choice in self.choices.items()}
        return replace(self, choices=choices)

    def plain(self) -> dict[str, Any]:
        """Return the configuration as JSON values, with every default, as a run's manifest records it."""
        stages = {name: choice.plain() if choice else None for name, choice in self.choices.items()}
        attend = self.attend.model_dump(mode="json")
        drawn = self.drawn.model_dump(mode="json")
        return {**stages, "drawn": drawn, "reconstruction": self.reconstruction.model_dump(mode="json"), **attend}


def clouds_of(configurations: Iterable[Configuration]) -> tuple[int, ...]:
    """The numbers of points that the methods of these configurations use of a target's cloud."""
    return tuple(sorted({each.attend.attention.cloud_points for each in configurations} - {0}))


def merged(tables: Tables, over: Tables) -> Tables:
    """Return the tables with ``over`` over them, key by key."""
    return {table: {**tables.get(table, {}), **over.get(table, {})} for table in {**tables, **over}}


def inherited(defaults: Tables, own: Tables) -> Tables:
    """Return the defaults that a configuration inherits: a stage, or a method of its own, has only its settings.

    A table without a stage, or without a method of its own, keeps all of them, of which one can be misspelt.
    """
    tables = {}
    for table, settings in defaults.items():
        chosen = {**settings, **own.get(table, {})}
        slot = STAGES.get(table)
        name = chosen.get(slot.key) if slot else own.get(table, {}).get("method")
        tables[table] = {
            key: value for key, value in settings.items() if name is None or takes({table: chosen}, f"{table}.{key}")
        }
    return tables


def takes(tables: Tables, dotted: str) -> bool:
    """Whether the stage or step that these tables select has the setting ``table.key``."""
    table, _, key = dotted.partition(".")
    settings = tables.get(table, {})
    if slot := STAGES.get(table):
        return slot.takes(settings.get(slot.key), key)
    if table == "attention" and key != "method":
        name = str(settings.get("method", DEFAULT_METHOD))
        return name in METHODS and key in METHODS.load(name).Settings.model_fields
    return table in STEPS and key in STEPS[table].model_fields


def is_setting(table: str, key: str) -> bool:
    """Whether any stage or step can have the setting ``table.key``."""
    if slot := STAGES.get(table):
        return key in slot.settings()
    if table == "attention":
        return key == "method" or bool(METHODS.choices_with("attention.method", key))
    return table in STEPS and key in STEPS[table].model_fields


def check_all_used(
    defaults: Tables, used: set[tuple[str, str]], configurations: Iterable[Configuration], where: str
) -> None:
    """Reject a default that none of the configurations has ``used``, as (table, key): it is probably misspelt.

    Raises
    ------
    VfoaError
        With its table and key.
    """
    for table, settings in defaults.items():
        if table not in TABLES:
            raise VfoaError(f"{where}: defaults.{table}: unknown table; {did_you_mean(table, TABLES)}")
        for key in settings:
            if (table, key) not in used:
                chosen = [each.choices[table] for each in configurations if table in STAGES]
                known = {name for choice in chosen if choice for name in type(choice.settings).model_fields}
                known.update([STAGES[table].key] if table in STAGES else STEPS[table].model_fields)
                if table == "attention":
                    known.update(*(type(each.attend.attention).model_fields for each in configurations))
                problem = f"no configuration's {table} has such a setting; {did_you_mean(key, known)}"
                raise VfoaError(f"{where}: defaults.{table}.{key}: {problem}")


def make_configuration(name: str, tables: Tables, factors: Mapping[str, str], where: str) -> Configuration:
    """Check the tables of one configuration, and fill in the defaults.

    Raises
    ------
    VfoaError
        If a stage, a key or a value is wrong, or two of them cannot be combined.
    """
    choices = {slot.name: slot.parse(tables.get(slot.name, {}), where) for slot in STAGES.values()}
    stereo = choices["stereo"]
    reconstruction, attend = read_steps(tables, stereo.settings if stereo else None, where, methods=METHODS)
    drawn = _switched_on(parse(DrawnSettings, tables.get("drawn", {}), where, "drawn"), choices)
    return Configuration(
        name=name, choices=choices, drawn=drawn, reconstruction=reconstruction, attend=attend, factors=factors
    )


def _switched_on(drawn: DrawnSettings, choices: Mapping[str, StageChoice | None]) -> DrawnSettings:
    """Switch on the drawn shapes of a stage that uses nothing else, whatever the table ``drawn`` says."""
    alone = {slot for slot, choice in choices.items() if choice is not None and choice.name == DRAWN}
    on = {"targets": drawn.targets or "segmentation" in alone, "heads": drawn.heads or "heads" in alone}
    return drawn.model_copy(update=on)
