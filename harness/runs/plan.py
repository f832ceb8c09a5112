"""What a run is made of: an experiment whose every input has been opened once, and the description of it all."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any

from harness.adapters import Clip
from harness.annotations.files import Labels
from harness.annotations.timeline import timeline_of
from harness.clips.manifest import ClipManifest, load_manifest
from harness.recording import Size
from harness.runs import provenance
from harness.runs.configuration import Configuration
from harness.runs.directory import Pair
from harness.runs.experiment import Experiment
from harness.runs.stages import SLOTS


@dataclass(frozen=True, slots=True, kw_only=True)
class PreparedClip:
    """A clip that was opened and whose labels were read."""

    manifest: ClipManifest
    clip: Clip
    frames: tuple[int, ...]
    labels: Labels | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """A run in which every input has been opened once: what can be known to fail has failed by now."""

    experiment: Experiment
    clips: tuple[PreparedClip, ...]
    recording: Size | None
    save_signals: bool = False

    @property
    def pairs(self) -> list[Pair]:
        """Every (clip, configuration), in the order of the tables."""
        return [(one.manifest.name, each.name) for one in self.clips for each in self.experiment.configurations]

    @property
    def frames(self) -> int:
        """Frames to read, over all clips."""
        return sum(len(one.frames) for one in self.clips)


def prepare(
    experiment: Experiment,
    *,
    limit: int | None = None,
    recording: Size | None = "light",
    save_signals: bool = False,
) -> Plan:
    """Open every clip, read every label file and find every weights file of an experiment; note what cannot go well.

    Parameters
    ----------
    limit
        Take only the first frames of each clip.
    recording
        How much the recordings hold; None for none.
    save_signals
        Also save what every stage found, with an experiment that runs from it.

    Raises
    ------
    VfoaError
        For the first thing that is missing or wrong.
    """
    clips = tuple(_prepare_clip(name, limit, experiment.annotator) for name in experiment.clips)
    noted = replace(experiment, notes=(*experiment.notes, *_said_of_names(clips, experiment.configurations)))
    return Plan(experiment=noted, clips=clips, recording=recording, save_signals=save_signals)


def _prepare_clip(name: str, limit: int | None, annotator: str | None) -> PreparedClip:
    manifest = load_manifest(name)
    clip = manifest.open()
    labels = manifest.labels(timeline_of(clip), annotator)
    return PreparedClip(manifest=manifest, clip=clip, frames=tuple(clip.frames)[:limit], labels=labels)


def _said_of_names(clips: Iterable[PreparedClip], configurations: Iterable[Configuration]) -> Iterator[str]:
    """A sentence where names go by the source's own ids, and masks come from a network, which numbers them anew."""
    choices = [each.choices["segmentation"] for each in configurations]
    networks = sorted({each.name for each in choices if each and each.name not in SLOTS["segmentation"].of_clip})
    for clip in clips if networks else ():
        rules = {**clip.manifest.subjects, **clip.manifest.targets}
        if names := [name for name, rule in rules.items() if rule.instance is not None]:
            yield (
                f"{clip.manifest.name}: the manifest finds {', '.join(names)} by their ids in the source, "
                f"which are not those of {' and '.join(networks)}: the names can be wrong."
            )


def describe(plan: Plan) -> dict[str, Any]:
    """All that a plan's results depend on, as it stands in the run's manifest."""
    return {
        "experiment": plan.experiment.name,
        "notes": list(plan.experiment.notes),
        "published": plan.experiment.published.model_dump() if plan.experiment.published else None,
        "annotator": plan.experiment.annotator,
        "recording": plan.recording,
        "signals": plan.save_signals,
        "clips": [_describe_clip(one, plan.experiment) for one in plan.clips],
        "configurations": {one.name: one.plain() for one in plan.experiment.configurations},
        "weights_sha256": provenance.weights_digests(plan.experiment),
        "versions": provenance.versions(),
        "source_sha256": provenance.source_digest(),
    }


def _describe_clip(one: PreparedClip, experiment: Experiment) -> dict[str, Any]:
    return {
        "name": one.manifest.name,
        "manifest": str(one.manifest.path),
        "licence": one.manifest.licence,
        "citation": one.manifest.citation,
        "notes": [*one.manifest.notes, *one.clip.notes],
        "rate_hz": one.clip.rate_hz,
        "frames": list(one.frames),
        "times_ns": [one.clip.time_ns(number) for number in one.frames],
        "sha256": one.clip.digest(),
        "names": one.manifest.model_dump(mode="json", include={"subjects", "targets"}),
        "signals_sha256": provenance.signals_digests(experiment, one.manifest.name, one.clip),
    }
