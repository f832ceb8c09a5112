"""The stages that can run on this machine, and what would do in place of one whose weights are missing."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from harness.stages.slots import SLOTS, Slot, StageChoice
from harness.stages.weights.catalogue import CatalogueEntry, catalogue
from vfoa.errors import VfoaError
from vfoa.weights import directories, locate, weights_of


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadyStage:
    """A stage of the library that can run here, and the settings that choose it, such as ``gaze.model=l2cs``."""

    slot: str
    name: str
    settings: tuple[str, ...]
    licences: tuple[str, ...]

    @property
    def options(self) -> str:
        """Options of ``vfoa run`` that choose it, with the licences of its weights."""
        options = " ".join(f"--set {setting}" for setting in self.settings)
        return f"{options} ({', '.join(self.licences)})" if self.licences else options


def ready_stages(slot: Slot) -> list[ReadyStage]:
    """The stages of the library in a slot that need no weights, or whose weights are on this machine.

    A stage whose default weights are missing is ready with another network of the catalogue.
    """
    ready = []
    for name in slot.library.builtin:
        needed = default_weights(slot, name)
        chosen: tuple[str, ...] = (f"{slot.name}.{slot.key}={name}",)
        if needed is None or not all(map(_is_here, needed)):
            other = next((entry for entry in _networks(slot, name) if entry.find()), None)
            if other is None or (needed is not None and len(needed) > 1):
                continue
            needed, chosen = (other.file,), (*chosen, f"{slot.name}.weights={other.file}")
        licences = {entry.licence for entry in catalogue().values() if entry.file in needed}
        ready.append(ReadyStage(slot=slot.name, name=name, settings=chosen, licences=tuple(sorted(licences))))
    return ready


def default_weights(slot: Slot, name: str) -> tuple[str, ...] | None:
    """Return the weights files that a stage opens by default; None if its settings must name them."""
    try:
        return tuple(weights_of(slot.settings_class(name)()))
    except ValueError:
        return None


@dataclass(frozen=True, slots=True, kw_only=True)
class MissingWeights:
    """Models of the catalogue that stages name and that are not here, and options of stages that can run instead."""

    models: Mapping[str, CatalogueEntry]
    instead: tuple[str, ...]

    @property
    def fetch(self) -> str:
        """The command that fetches them, or says where to get them."""
        return f"vfoa models fetch {' '.join(self.models)}"


def missing_weights(choices: Iterable[StageChoice]) -> MissingWeights | None:
    """Return what is missing of the weights that the stages name; None if all are here."""
    entries = {entry.file: (name, entry) for name, entry in catalogue().items()}
    absent = {
        file: choice
        for choice in choices
        for file in weights_of(choice.settings)
        if file in entries and not _is_here(file)
    }
    stages = dict.fromkeys((choice.slot, choice.name) for choice in absent.values())
    instead = tuple(options for slot, name in stages if (options := _instead(SLOTS[slot], name)))
    return MissingWeights(models=dict(entries[file] for file in sorted(absent)), instead=instead) if absent else None


def locate_weights(choices: Iterable[StageChoice]) -> dict[str, Path]:
    """Return the path of each weights file that the stages name.

    Raises
    ------
    VfoaError
        If some are missing. For those of the catalogue, the message gives licence and size, the command that fetches
        them, and for each stage without its weights another one that can run here.
    """
    choices = list(choices)
    if missing := missing_weights(choices):
        models = (
            f"{name} ({entry.licence}, {entry.size or 'size not known'})" for name, entry in missing.models.items()
        )
        here = f"; or what is here already: {' '.join(missing.instead)}" if missing.instead else ""
        folders = " and ".join(map(str, directories()))
        raise VfoaError(f"weights missing in {folders}: {', '.join(models)}; expected: {missing.fetch}{here}")
    return {file: locate(file) for file in sorted({name for each in choices for name in weights_of(each.settings)})}


def _instead(slot: Slot, name: str) -> str | None:
    """Options for a stage that can run here: the same one with other weights, else another network, else any."""
    ready = ready_stages(slot)
    ready.sort(key=lambda stage: (stage.name != name, not stage.licences))
    return ready[0].options if ready else None


def _networks(slot: Slot, name: str) -> list[CatalogueEntry]:
    return [entry for entry in catalogue().values() if entry.stage == f"{slot.name}.{name}"]


def _is_here(file: str) -> bool:
    try:
        locate(file)
    except VfoaError:
        return False
    return True
