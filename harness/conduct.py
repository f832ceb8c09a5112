"""A whole run: everything checked first, then the jobs, then the tables."""

from __future__ import annotations

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
from harness.signals.saved import write_experiment
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


def conduct(plan: Plan, out: Path, *, workers: int, progress: Progress) -> RunDirectory:
    """Run a plan into a directory, and join its results. What an earlier run of the same plan finished is taken over.

    Raises
    ------
    VfoaError
        If the directory holds another run, or a clip could not be finished: the others are finished first, and
        nothing is joined.
    """
    directory, identity = RunDirectory(out), describe(plan)
    if _is_finished(directory, identity):
        for one in plan.clips:
            _skip(one, progress)
        return directory
    started = _now()
    directory.write_manifest(identity)
    jobs = [_job(plan, one, directory) for one in plan.clips]
    todo = [job for job in jobs if not all(directory.has_part(pair) for pair in job.pairs)]
    for one, job in zip(plan.clips, jobs, strict=True):
        if job not in todo:
            _skip(one, progress)
    failures = [outcome.error for outcome in work_through(run_clip, todo, workers, progress) if outcome.error]
    if failures:
        others = f" (and {len(failures) - 1} more clips failed)" if len(failures) > 1 else ""
        raise VfoaError(f"{failures[0]}{others}")
    if plan.save_signals:
        partial = any(len(one.frames) < len(one.clip.frames) for one in plan.clips)
        write_experiment(directory.signals, plan.experiment, partial=partial)
    directory.join(plan.pairs)
    directory.write_manifest({**identity, **_circumstances(started)})
    return directory


def describe(plan: Plan) -> dict[str, Any]:
    """All that a plan's results depend on, as it stands in the run's manifest."""
    return {
        "experiment": plan.experiment.name,
        "notes": list(plan.experiment.notes),
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
    labels = one.manifest.annotations.find(experiment.annotator)
    return {
        "name": one.manifest.name,
        "manifest": str(one.manifest.path),
        "licence": one.manifest.licence,
        "notes": [*one.manifest.notes, *one.clip.notes],
        "rate_hz": one.clip.rate_hz,
        "frames": list(one.frames),
        "times_ns": [one.clip.time_ns(number) for number in one.frames],
        "sha256": one.clip.digest(),
        "labels_sha256": digest_files([("labels", labels)]) if labels else None,
        "signals_sha256": provenance.signals_digests(experiment, one.manifest.name, one.clip),
    }


def _is_finished(directory: RunDirectory, identity: dict[str, Any]) -> bool:
    """Whether the directory holds this very run, finished; False if it is new, or this very run broken off."""
    if not directory.path.exists() or not any(directory.path.iterdir()):
        return False
    found = directory.read_manifest()
    differing = [key for key in identity if found.get(key) != identity[key]]
    if differing:
        raise VfoaError(
            f"{directory.path}: holds another run (its {', '.join(differing)} differ from this one's); "
            "expected an empty directory, or the same run to go on with: choose another --out"
        )
    return "finished" in found


def _circumstances(started: str) -> dict[str, Any]:
    """What is worth knowing of a finished run, but does not make it another one."""
    return {
        "commit": provenance.source_commit(),
        "host": provenance.host(),
        "started": started,
        "finished": _now(),
    }


def _job(plan: Plan, one: PreparedClip, directory: RunDirectory) -> ClipJob:
    return ClipJob(
        manifest=one.manifest,
        frames=one.frames,
        labels=one.labels,
        configurations=tuple(each.for_clip(one.manifest.name) for each in plan.experiment.configurations),
        directory=directory,
        recording=plan.recording,
        save_signals=plan.save_signals,
    )


def _skip(one: PreparedClip, progress: Progress) -> None:
    for _ in one.frames:
        progress(one.manifest.name)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
