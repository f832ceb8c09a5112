"""A whole run: everything checked first, then the jobs, then the tables."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from harness import provenance
from harness.adapters import Clip
from harness.annotations import Labels
from harness.executors import Progress, work_through
from harness.experiment import Experiment
from harness.files import digest_files
from harness.manifest import ClipManifest, load_manifest
from harness.recording import Size
from harness.run import ClipJob, run_clip
from harness.run_directory import Pair, RunDirectory
from harness.signals.saved import owned_slots, write_experiment
from harness.timeline import timeline_of
from vfoa.errors import VfoaError


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
    """Open every clip, read every label file and find every weights file of an experiment.

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
    return Plan(experiment=experiment, clips=clips, recording=recording, save_signals=save_signals)


def _prepare_clip(name: str, limit: int | None, annotator: str | None) -> PreparedClip:
    manifest = load_manifest(name)
    clip = manifest.open()
    labels = manifest.labels(timeline_of(clip), annotator)
    return PreparedClip(manifest=manifest, clip=clip, frames=tuple(clip.frames)[:limit], labels=labels)


def conduct(
    plan: Plan, out: Path, *, workers: int, progress: Progress, beside: bool = False, retry_failed: bool = False
) -> RunDirectory:
    """Run a plan into a directory, and join its results. What an earlier run of the same plan finished is taken over.

    A (clip, configuration) that fails does not stop the others; the manifest's ``failed`` lists it with its error.

    Parameters
    ----------
    beside
        Where ``out`` holds another run, take ``out-2``, ``out-3`` ... instead: the first that is free, or this run's.
    retry_failed
        Try again what failed in an earlier run of the same plan; without it, its failures stand.

    Raises
    ------
    VfoaError
        If the directory holds another run, or nothing at all could be finished.
    """
    identity = describe(plan)
    directory, found = _choose(RunDirectory(out), identity, beside)
    if found and "finished" in found and not (retry_failed and found.get("failed")):
        if not found.get("failed"):
            directory.remove_parts()
        for one in plan.clips:
            _skip(one, progress)
        return directory
    started = _now()
    directory.write_manifest(identity)
    failures = _work(plan, directory, workers, progress)
    finished = [pair for pair in plan.pairs if pair not in failures]
    if not finished:
        others = f" (and {len(failures) - 1} more failed)" if len(failures) > 1 else ""
        raise VfoaError(f"{next(iter(failures.values()))}{others}")
    if plan.save_signals and not failures:
        partial = any(len(one.frames) < len(one.clip.frames) for one in plan.clips)
        write_experiment(directory.signals, plan.experiment, partial=partial)
    directory.join(finished)
    failed = [
        {"clip": clip, "configuration": configuration, "error": failures[clip, configuration]}
        for clip, configuration in plan.pairs
        if (clip, configuration) in failures
    ]
    directory.write_manifest({**identity, "failed": failed, **_circumstances(plan, started)})
    if not failed:
        directory.remove_parts()
    return directory


def _choose(first: RunDirectory, identity: dict[str, Any], beside: bool) -> tuple[RunDirectory, dict[str, Any] | None]:
    """The directory to run in, and the manifest of this very run where it stands there already."""
    for number in itertools.count(1):
        directory = RunDirectory(first.path.with_name(f"{first.path.name}-{number}")) if number > 1 else first
        if directory.is_new():
            return directory, None
        found = directory.read_manifest()
        differing = [key for key in identity if found.get(key) != identity[key]]
        if not differing:
            return directory, found
        if not beside:
            raise VfoaError(
                f"{directory.path}: holds another run (its {', '.join(differing)} differ from this one's); "
                "expected an empty directory, or the same run to go on with: choose another --out"
            )
    raise AssertionError("counting has no end")


def _work(plan: Plan, directory: RunDirectory, workers: int, progress: Progress) -> dict[Pair, str]:
    """Do what is not done, and return the errors of what could not be."""
    jobs = [_job(plan, one, directory) for one in plan.clips]
    todo = [job for job in jobs if job.configurations]
    for one, job in zip(plan.clips, jobs, strict=True):
        if not job.configurations:
            _skip(one, progress)
    failures: dict[Pair, str] = {}
    for outcome in work_through(run_clip, todo, workers, progress):
        failures.update(outcome.failures)
    return failures


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
        "notes": [*one.manifest.notes, *one.clip.notes],
        "rate_hz": one.clip.rate_hz,
        "frames": list(one.frames),
        "times_ns": [one.clip.time_ns(number) for number in one.frames],
        "sha256": one.clip.digest(),
        "names": one.manifest.model_dump(mode="json", include={"subjects", "targets"}),
        "signals_sha256": provenance.signals_digests(experiment, one.manifest.name, one.clip),
    }


def _circumstances(plan: Plan, started: str) -> dict[str, Any]:
    """What is worth knowing of a finished run, but does not make it another one."""
    return {
        "labels_sha256": {one.manifest.name: _labels_digest(one, plan.experiment) for one in plan.clips},
        "commit": provenance.source_commit(),
        "host": provenance.host(),
        "started": started,
        "finished": _now(),
    }


def _labels_digest(one: PreparedClip, experiment: Experiment) -> str | None:
    labels = one.manifest.annotations.find(experiment.annotator)
    return digest_files([("labels", labels)]) if labels else None


def _job(plan: Plan, one: PreparedClip, directory: RunDirectory) -> ClipJob:
    """What is left to do on a clip."""
    clip, everyone = one.manifest.name, plan.experiment.configurations
    todo = [each for each in everyone if not directory.has_part((clip, each.name))]
    return ClipJob(
        manifest=one.manifest,
        frames=one.frames,
        labels=one.labels,
        configurations=tuple(each.for_clip(clip) for each in todo),
        directory=directory,
        recording=plan.recording,
        signals={each.name: owned_slots(each, everyone) for each in everyone} if plan.save_signals else {},
    )


def _skip(one: PreparedClip, progress: Progress) -> None:
    for _ in one.frames:
        progress(one.manifest.name)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
