"""A finished run as it is scored: the records that can be compared, and the present labels of its clips.

Where a clip is no longer what the run was made with (labels, names, content), a note says so.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

from harness.clips.manifest import ClipManifest, manifest_of_run
from harness.files.digests import KNOWN, used_digests
from harness.files.folders import read_value, write_value
from harness.files.groups import grouped
from harness.files.safe_names import vfoa_command
from harness.labels.labels import Labels, Timeline
from harness.run.columns import PairColumns
from harness.run.directory import Pair, RunDirectory
from harness.run.grid import base_of
from harness.run.manifest import ClipOfRun, NoteOfRun, RunManifest, differences, has_images
from harness.run.notes import Note, NoteKind, unlabelled
from harness.run.records import FrameRecord, renamed
from harness.run.table_columns import ColumnReader
from harness.run.table_files import count_frames
from harness.run.table_records import TableReader, most_people
from harness.score.reference import Reference
from harness.score.score import Scores, score
from harness.score.subset import Condition, subset
from vfoa.errors import VfoaError, counted


def read_scores(directory: RunDirectory, where: Sequence[Condition] = ()) -> Scores:
    """Score a finished run without writing anything; ``where``: only the labelled frames that meet all conditions.

    Raises
    ------
    VfoaError
        If the run is not finished, no configuration ran on every clip, a clip's manifest or labels cannot be read, or
        no labelled frame meets the conditions.
    """
    run = FinishedRun.read(directory)
    return score(run.columns(), run.reference(where=where))


@dataclass(frozen=True, slots=True, kw_only=True)
class FinishedRun:
    """A run's directory, and its manifest."""

    directory: RunDirectory
    manifest: RunManifest

    @classmethod
    def read(cls, directory: RunDirectory) -> FinishedRun:
        """Read the manifest.

        Raises
        ------
        VfoaError
            If there is none, or the run is not finished.
        """
        manifest = directory.read_manifest()
        if not manifest.finished:
            look = f" (`{vfoa_command('report', directory.path, '--serve')}` shows what is complete)"
            raise VfoaError(f"{directory.path}: this run is not finished{_how_to_go_on(directory, look)}")
        if missing := next((key for key in ("clips", "configurations") if not getattr(manifest, key)), None):
            raise VfoaError(f"{directory.manifest}: {missing}: missing; it is required")
        return cls(directory=directory, manifest=manifest)

    @classmethod
    def read_so_far(cls, directory: RunDirectory) -> FinishedRun:
        """Read the manifest; of a run that is not finished, the part on what is complete, with a note that says so.

        What is complete are the clips that are finished under each configuration that is finished on any clip, under
        all of its seeds.

        Raises
        ------
        VfoaError
            As :meth:`read`, or if no clip is complete.
        """
        whole = directory.read_manifest()
        if whole.finished:
            return cls.read(directory)
        pairs = product((clip.name for clip in whole.clips), whole.configurations)
        done = {pair for pair in pairs if directory.is_finished(pair)}
        lacking = _with_seeds(whole.configurations.keys() - {name for _, name in done}, whole)
        begun = [name for name in whole.configurations if name not in lacking]
        clips = [clip for clip in whole.clips if all((clip.name, name) in done for name in begun)]
        if not (begun and clips):
            raise VfoaError(f"{directory.path}: this run has no complete clip yet{_how_to_go_on(directory)}")
        of_clips = f"{len(clips)} of {counted(len(whole.clips), 'clip')}"
        under = f"{len(begun)} of {counted(len(whole.configurations), 'configuration')}"
        text = f"THE RUN IS NOT FINISHED: this is of {of_clips}, under {under}."
        part = {
            "clips": clips,
            "configurations": {name: whole.configurations[name] for name in begun},
            "notes": [NoteOfRun(text=text, kind=NoteKind.UNFINISHED), *whole.notes],
        }
        return cls(directory=directory, manifest=whole.model_copy(update=part))

    def with_labels_of(self, annotator: str | None) -> FinishedRun:
        """The run as it is scored against the labels of this annotator; None: against those that the run names."""
        if annotator == self.manifest.tables_annotator:
            return self
        return replace(self, manifest=self.manifest.model_copy(update={"tables_annotator": annotator}))

    def records(self) -> Iterator[FrameRecord]:
        """Yield the comparable records: those of every configuration that ran on every clip, on these clips.

        Renamed targets have their present names.
        """
        names = self._names_now(self.manifests())
        reader = TableReader(self.directory, self.manifest)
        scored = {*self._scored(reader.paths)}
        for block in reader.blocks:
            if (block.clip, block.configuration) in scored:
                yield from (renamed(record, names[block.clip]) for record in reader.read(block))

    def columns(self, configurations: Collection[str] | None = None) -> Iterator[PairColumns]:
        """Yield the columns of what :meth:`records` yields, a (clip, configuration) at a time.

        ``configurations``: of these alone, by their names without seeds.

        Raises
        ------
        VfoaError
            If there is no such frame, or a table is missing, damaged, of another version, or has lost frames.
        """
        names = self._names_now(self.manifests())
        reader = ColumnReader(self.directory, self.manifest)
        for pair in self._scored(reader.paths, configurations):
            yield reader.read(pair, names[pair[0]])

    def manifests(self) -> dict[str, ClipManifest]:
        """The present manifest of each clip, whose names the labels have."""
        annotator = self.manifest.scored_annotator
        return {clip.name: manifest_of_run(clip.manifest, clip.name, annotator) for clip in self.manifest.clips}

    def _names_now(self, manifests: Mapping[str, ClipManifest]) -> dict[str, dict[str, str]]:
        """The present names of renamed targets by their names in the results, for each clip."""
        return {
            clip.name: manifests[clip.name].names_now(clip.names.targets if clip.names else {})
            for clip in self.manifest.clips
        }

    def _scored(self, paths: Mapping[Pair, Mapping[str, Path]], wanted: Collection[str] | None = None) -> list[Pair]:
        """Those (clip, configuration) that can be compared, of the files of the tables of all.

        ``wanted``: of these configurations alone, by their names without seeds.

        Raises
        ------
        VfoaError
            If there is none, or tables have lost frames: these would be scored as without a prediction.
        """
        run, (clips, configurations, _) = self.manifest, _left_out(self.manifest)
        if not run.configurations.keys() - configurations:
            raise VfoaError(
                f"{self.directory.path}: no configuration ran on every clip; vfoa run --retry-failed tries again"
            )
        frames, rows_in = {clip.name: len(clip.frames) for clip in run.clips}, cache(count_frames)
        for (clip, configuration), of_pair in paths.items():
            if (count := rows_in(of_pair["frames"])) != frames[clip]:
                raise VfoaError(
                    f"{self.directory.path}: tables: found {count} frames of {clip} under {configuration}; expected "
                    f"{frames[clip]}, as the run had"
                )
        scored = [pair for pair in paths if pair[0] not in clips and pair[1] not in configurations]
        return scored if wanted is None else [pair for pair in scored if base_of(pair[1]) in wanted]

    def reference(self, *, compare_content: bool = False, where: Sequence[Condition] = ()) -> Reference:
        """Read the present labels of the run's clips, by the annotator whose labels its tables use.

        The notes say where labels or names have changed since, and with ``compare_content`` whether the clip has.
        """
        run = self.manifest
        traits = {name: run.traits(name, self.directory.manifest) for name in run.configurations}
        annotator, manifests = run.scored_annotator, self.manifests()
        read = {clip.name: manifests[clip.name].labels(_timeline(clip), annotator) for clip in run.clips}
        labels = {name: of_clip for name, of_clip in read.items() if of_clip is not None and of_clip.ranges}
        without_labels = [manifests[name] for name, of_clip in read.items() if not (of_clip and of_clip.are_scored)]
        chosen, conditions = self._chosen(labels, where) if where else (labels, [])
        of_clips = grouped((note, clip.name) for clip in run.clips for note in clip.notes)
        return Reference(
            labels=chosen,
            all_labels=labels if where else None,
            frames={clip.name: clip.frames for clip in run.clips},
            notes=(
                *map(Note, _left_out(run)[2]),
                *(Note(note.text, note.kind) for note in run.notes),
                *map(Note, carried_mask_notes(run.configurations)),
                *([Note(f"Scored against the labels of {annotator!r}.")] if annotator else []),
                *(Note(f"{', '.join(clips)}: {note}") for note, clips in of_clips.items()),
                *map(Note, self._changes(manifests, compare_content)),
                *_twice_notes(clip for clip in run.clips if clip.name in chosen),
                *self._unlabelled_notes(without_labels),
                *conditions,
            ),
            unknown_names={clip.name: _unknown_names(clip, manifests[clip.name]) for clip in run.clips},
            names_now=self._names_now(manifests),
            traits=traits,
            published=run.published,
            factors=run.factors,
            settings=run.configurations,
            phases={name: manifests[name].phase_of_things() for name in read if manifests[name].phases},
            is_recorded=run.recording is not None,
        )

    def _chosen(
        self, labels: Mapping[str, Labels], where: Sequence[Condition]
    ) -> tuple[Mapping[str, Labels], list[Note]]:
        """The labels of the frames that meet the conditions, and notes on what is left of the clips."""
        frames = {clip.name: clip.frames for clip in self.manifest.clips}
        times_ns = {clip.name: clip.times_ns or () for clip in self.manifest.clips}
        chosen = subset(labels, where, frames, times_ns, self.columns)
        left = {name for name, of_clip in chosen.items() if of_clip.are_scored}
        emptied = (name for name, of_clip in labels.items() if of_clip.are_scored and name not in left)
        notes = [unlabelled(name, "no labelled frame meets the conditions, not scored.") for name in emptied]
        return chosen, [*notes, Note(f"Only frames with {' and '.join(each.text for each in where)}.")]

    def _changes(self, manifests: Mapping[str, ClipManifest], compare_content: bool) -> Iterator[str]:
        """What has changed since the run: labels, names and, with ``compare_content``, the clips."""
        run = self.manifest
        for clip in run.clips:
            manifest, digest = manifests[clip.name], (run.run_labels_sha256 or run.labels_sha256).get(clip.name)
            is_relabelled = manifest.annotations.digest(run.annotator) != digest
            if is_relabelled and run.scored_annotator == run.annotator and digest is not None:
                yield _label_note(clip, manifest, run.annotator)
            yield from _name_notes(clip, manifest)
            if is_relabelled and compare_content:
                yield from _content_notes(clip, manifest, self.directory.noted_inputs)

    def relabelled(self, only: str | None = None) -> list[str]:
        """The clips whose labels have changed since the tables and the verdicts of the recordings were written.

        A clip that is not on this machine is none of them. ``only`` this clip is looked at, if it is given.
        """
        annotator, written, found = self.manifest.scored_annotator, self.manifest.labels_sha256, list[str]()
        for clip in self.manifest.clips:
            if only not in (None, clip.name):
                continue
            with suppress(VfoaError):
                now = manifest_of_run(clip.manifest, clip.name, annotator).annotations.digest(annotator)
                if now not in (None, written.get(clip.name)):
                    found.append(clip.name)
        return found

    def present_labels(self) -> dict[str, str | None]:
        """The digest of the present labels of each clip; None without any."""
        annotator = self.manifest.scored_annotator
        return {name: clip.annotations.digest(annotator) for name, clip in self.manifests().items()}

    def note_labels(self, now: dict[str, str | None]) -> None:
        """Note in the run's manifest which labels its tables use. The labels that it was made with stay in it, too."""
        before = self.manifest.labels_sha256
        of_run = self.manifest.run_labels_sha256
        if now != before:
            labels = {"labels_sha256": now, "run_labels_sha256": before if of_run is None else of_run}
            self.directory.write_manifest(self.manifest.model_copy(update=labels))
        elif self.manifest.tables_annotator != self.directory.read_manifest().tables_annotator:
            self.directory.write_manifest(self.manifest)

    def _unlabelled_notes(self, clips: list[ClipManifest]) -> list[Note]:
        """A note for each clip without labels: it is not scored, and how many people the run found in it."""
        if not clips:
            return []
        people = most_people(self.directory, [clip.name for clip in clips], self.manifest)
        return [
            unlabelled(
                clip.name,
                f"no labels, not scored; {_FOUND.get(people[clip.name], f'up to {people[clip.name]} people')} "
                "found in its frames; "
                f"{'' if clip.subjects else f'write [subjects.NAME] into {clip.path.name}, then '}"
                f"{how_to_label(clip.word, self.manifest.configurations.values())}.",
            )
            for clip in clips
        ]


def _how_to_go_on(directory: RunDirectory, look: str = "") -> str:
    """What to do about a run that is not finished; ``look`` is what shows it while it goes on."""
    again = "repeat the same `vfoa run` to continue it"
    return f": {directory.writer} writes it{look}, or was killed: then {again}" if directory.writer else f"; {again}"


def how_to_label(clip: str | Path, configurations: Collection[Mapping[str, Any]]) -> str:
    """The command that gives labels to a clip (its name or file) of a run: the page needs images."""
    if has_images(configurations):
        return f"`{vfoa_command('annotate', clip)}` labels it"
    return f"`{vfoa_command('labels', 'import', 'FILE', '--clip', clip, '--format', 'FORMAT')}` reads labels"


_FOUND = {0: "nobody", 1: "one person at most"}


def _with_seeds(names: Iterable[str], run: RunManifest) -> set[str]:
    """These configurations of a run, and those that repeat the same ones under other seeds."""
    bases = set(map(base_of, names))
    return {name for name in run.configurations if base_of(name) in bases}


def _left_out(run: RunManifest) -> tuple[set[str], set[str], list[str]]:
    """The clips on which everything failed, the configurations that failed on another clip, and a note for each.

    A configuration that ran on only some of the clips, or under some of its seeds on one, would have a rate over other
    frames than the rest of the table.
    """
    counts = Counter(failure.clip for failure in run.failed)
    clips = {clip for clip, count in counts.items() if count == len(run.configurations)}
    configurations = _with_seeds((failure.configuration for failure in run.failed if failure.clip not in clips), run)
    notes: dict[str, str] = {}
    for failure in run.failed:
        name = base_of(failure.configuration)
        if failure.clip in clips:
            notes.setdefault(failure.clip, f"left out, every configuration failed: {failure.error}")
        else:
            under = "" if name == failure.configuration else f" under {failure.configuration}"
            notes.setdefault(name, f"left out, failed on {failure.clip}{under}: {failure.error}")
    return clips, configurations, [f"{name}: {reason}" for name, reason in notes.items()]


def _timeline(clip: ClipOfRun) -> Timeline | None:
    """The frames of the run and their times; None if an older run did not save the times."""
    if clip.times_ns is None:
        return None
    return Timeline(frames=clip.frames, times_ns=clip.times_ns, is_whole=False)


def _label_note(clip: ClipOfRun, manifest: ClipManifest, annotator: str | None) -> str:
    """The note that the labels are not those of the run: edited since, or another file."""
    path = manifest.annotations.find(annotator)
    now = f"scored against {path.parent.name}/{path.name} as it is" if path else "and there are none now"
    return f"{clip.name}: its labels are not those that the run was made with; {now}."


def _name_notes(clip: ClipOfRun, manifest: ClipManifest) -> Iterator[str]:
    """Yield a note if subjects or targets have another rule, or were added or deleted: the results have the old names.

    Renamed targets are no difference: the results are read with their present names.
    """
    names = manifest.naming()
    if different := differences(_names_then(clip, manifest) or names, names):
        yield (
            f"{clip.name}: the names in {manifest.path.name} are not those that the run was made with "
            f"({different}), and its results have the old ones; to score the new ones, run it again."
        )


def _unknown_names(clip: ClipOfRun, manifest: ClipManifest) -> tuple[str, ...]:
    """Names in the results that the clip's manifest, and so its labels, do not know."""
    then = _names_then(clip, manifest)
    known = {*manifest.subjects, *manifest.targets}
    return tuple(name for kind in ("subjects", "targets") for name in then.get(kind, ()) if name not in known)


def _names_then(clip: ClipOfRun, manifest: ClipManifest) -> dict[str, Any]:
    """The rules of the run, by the present names of renamed targets; empty if an older run did not save them."""
    if clip.names is None:
        return {}
    targets = clip.names.targets
    now = manifest.names_now(targets)
    return {
        **clip.names.plain(),
        "targets": {now.get(name, name): rule for name, rule in targets.items()},
    }


def _content_notes(clip: ClipOfRun, manifest: ClipManifest, digests: Path) -> Iterator[str]:
    """Yield a note if another clip has taken this one's name. ``digests`` are noted there.

    Opening a clip takes time, so that this is asked only if its labels are not the run's. A clip that cannot be opened
    is not compared: scoring needs no images.
    """
    noted = read_value(digests, dict[str, str]) or {}
    KNOWN.update(noted)
    try:
        with used_digests() as used:
            digest = manifest.open().digest()
    except VfoaError:
        return
    if not used.keys() <= noted.keys():
        write_value(digests, {**noted, **used})
    if clip.sha256 not in (None, digest):
        yield (
            f"{clip.name}: the images or the calibration of {manifest.path.name} are not those that the run was "
            "made with, and its labels may be of another clip; to score this one, run it again."
        )


def _twice_notes(clips: Iterable[ClipOfRun]) -> Iterator[Note]:
    """A note on clips of the same content under several names: their looks are not independent."""
    for same in grouped((clip.sha256, clip.name) for clip in clips if clip.sha256 is not None).values():
        if len(same) > 1:
            text = (
                f"{', '.join(same)}: the same recording under {len(same)} names: rates, intervals and tests count them "
                f"{len(same)} times; expected one of them in a run."
            )
            yield Note(text, NoteKind.DOUBT)


def carried_mask_notes(configurations: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield a note for each distance of key frames, with the configurations that have it."""
    distances = (
        ((configuration.get("segmentation") or {}).get("every", 1), name)
        for name, configuration in configurations.items()
    )
    for every, chosen in grouped((every, name) for every, name in distances if every > 1).items():
        yield (
            f"{', '.join(chosen)}: masks are found once in {every} frames (segmentation.every = {every}). Optical flow "
            f"carries them to the frames in between, so they are up to {every - 1} frames old; masks_from and "
            "masks_age_s in frames.parquet say which and how old."
        )
