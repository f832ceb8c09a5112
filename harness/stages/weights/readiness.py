"""The stages that can run on this machine, and what would do in place of one whose weights are missing."""

from __future__ import annotations

from collections.abc import Iterable
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


def locate_weights(choices: Iterable[StageChoice]) -> dict[str, Path]:
    """Return the path of each weights file that the stages name.

    Raises
    ------
    VfoaError
        If some are missing. For those of the catalogue, the message gives licence and size, the command that fetches
        them, and for each stage without its weights another one that can run here.
    """
    entries = {entry.file: (name, entry) for name, entry in catalogue().items()}
    files: dict[str, StageChoice] = {}
    for choice in choices:
        for file in weights_of(choice.settings):
            files.setdefault(file, choice)
    absent = [file for file in sorted(files) if file in entries and not _is_here(file)]
    if absent:
        stages = dict.fromkeys((files[file].slot, files[file].name) for file in absent)
        instead = [option for slot, name in stages if (option := _instead(SLOTS[slot], name))]
        raise VfoaError(
            f"weights missing in {' and '.join(map(str, directories()))}: "
            + ", ".join(f"{entries[file][0]} ({described(entries[file][1])})" for file in absent)
            + f"; expected: vfoa models fetch {' '.join(entries[file][0] for file in absent)}"
            + (f"; or what is here already: {' '.join(instead)}" if instead else "")
        )
    return {file: locate(file) for file in sorted(files)}


def described(entry: CatalogueEntry) -> str:
    """Licence and size of a model."""
    return f"{entry.licence}, {entry.size or 'size not known'}"


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
