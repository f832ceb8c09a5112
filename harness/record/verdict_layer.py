"""Write the layer of the verdicts from a finished run's tables and the present labels."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Container, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import rerun as rr

from harness.files.digests import digest_files
from harness.files.groups import grouped
from harness.labels.labels import Labels
from harness.record import appearance, entities, frame_log, layer_file, verdict_content
from harness.record.appearance import Colours
from harness.record.frame_log import FrameLog, Shown
from harness.record.layer_file import LayerFile
from harness.record.layers import ClipFiles, RecordingIds, recording_ids
from harness.record.reading import RecordingFile
from harness.record.verdict_content import log_palettes, log_styles, log_verdicts
from harness.run.directory import RunDirectory
from harness.run.executors import Bar, no_bar
from harness.run.manifest import AnswerTraits
from harness.run.records import renamed
from harness.run.table_columns import ColumnReader
from harness.run.table_records import Block, TableReader
from harness.score import baselines, verdict_columns
from harness.score import verdicts as scored
from harness.score.verdict_columns import PairVerdicts, judge_columns
from harness.score.verdicts import ERROR_TYPES, Verdict
from vfoa.errors import VfoaError

_MADE_FROM = "made_from"
"""The property of a layer that lists its blocks: what each was made from."""


class _LoggedBlock(msgspec.Struct, frozen=True):
    """A block of the tables as the layer shows it: a digest of its inputs, and its sums.

    ``outcomes`` and ``errors`` (by error type) are counts, ``targets`` the names in order of their first appearance,
    ``shown`` the entities of the last frame, ``paths`` those of any frame.
    """

    key: str
    outcomes: dict[str, int]
    errors: dict[str, int]
    targets: list[str]
    shown: Shown
    paths: list[str]


def write_verdict_layers(
    directory: RunDirectory,
    labels: Mapping[str, Labels],
    names_now: Mapping[str, Mapping[str, str]] | None = None,
    bar: Bar = no_bar,
) -> None:
    """Write ``CLIP__CONFIGURATION.verdicts.rrd`` for every recording of a run; older ones are replaced.

    A recording then agrees with the tables, also after a label was edited. Stretches with the same results, labels and
    code are copied from the older layer; a layer without any change is left as it is.

    Parameters
    ----------
    labels
        The labels of the clips by name; a clip without any has only predictions.
    names_now
        The present names of renamed targets by clip and name in the results.
    bar
        Shows the progress, a recording at a time.

    Raises
    ------
    VfoaError
        If the manifest or the tables of the run cannot be read.
    """
    manifest = directory.read_manifest()
    clips = {clip.name: (clip.subjects, clip.targets) for clip in manifest.clips}
    reader, columns = TableReader(directory, manifest), ColumnReader(directory, manifest)
    blocks = grouped(((block.clip, block.configuration), block) for block in reader.blocks)
    with bar(len(blocks), directory.path.name) as progress:
        for (clip, configuration), its_blocks in blocks.items():
            attention = ClipFiles(run=directory.path, clip=clip).attention(configuration)
            if attention.is_file():
                files = ClipFiles(run=directory.path, clip=clip, ids=_ids(attention, manifest.run_id, clip))
                names = (names_now or {}).get(clip, {})
                traits = manifest.traits(configuration, directory.manifest)
                layer = _VerdictLayer(
                    reader, columns, files, configuration, clips[clip], labels.get(clip), names, traits
                )
                layer.write(its_blocks)
            progress(clip)


def _ids(attention: Path, run_id: str | None, clip: str) -> RecordingIds:
    """The ids of the layer of attention, which an earlier version may have made differently."""
    try:
        return RecordingFile(attention).ids
    except VfoaError:
        if run_id is None:
            raise
        return recording_ids(run_id, clip)  # that layer is damaged: this one fits the other layers


@cache
def _code() -> str:
    """Digest of the code that writes the layer, without its imports: hashing these takes longer than a small layer."""
    modules = (verdict_content, entities, frame_log, layer_file, appearance, scored, verdict_columns, baselines)
    files = [Path(__file__), *(Path(str(module.__file__)) for module in modules)]
    return digest_files((file.name, file) for file in files)


class _VerdictLayer:
    """The layer of one configuration on one clip."""

    def __init__(
        self,
        reader: TableReader,
        columns: ColumnReader,
        files: ClipFiles,
        configuration: str,
        names: tuple[tuple[str, ...], tuple[str, ...]],
        labels: Labels | None,
        names_now: Mapping[str, str],
        traits: AnswerTraits,
    ) -> None:
        self._reader, self._columns, self._configuration, self._labels = reader, columns, configuration, labels
        self._subjects, self._names_now, self._traits = names[0], names_now, traits
        self._targets = tuple(names_now.get(name, name) for name in names[1])
        self._files, self._path = files, files.verdicts(configuration)

    def write(self, blocks: Sequence[Block]) -> None:
        """Write the blocks that have changed; nothing if none has."""
        older, old = _older(self._path, self._files.ids)
        logged, kept_frames = list[_LoggedBlock](), set[int]()
        layer: LayerFile | None = None
        for number, block in enumerate(blocks):
            shown = logged[-1].shown if logged else {}
            key = self._key(block, shown)
            if number < len(old) and old[number].key == key:
                logged.append(old[number])
                kept_frames.update(block.frames)
            else:
                layer = layer or self._open()
                logged.append(self._log(layer, block, key, shown))
        if layer is None and len(logged) == len(old):
            return
        layer = layer or self._open()
        if older and kept_frames:
            _copy(older, layer.stream, kept_frames)
        self._end(layer, logged)

    def _open(self) -> LayerFile:
        layer = LayerFile(self._path, self._files)
        layer.open()
        return layer

    def _key(self, block: Block, shown: Shown) -> str:
        """The digest of all inputs of a block."""
        first, last = min(block.frames), max(block.frames)
        ranges = [
            (max(first, row.first_frame), min(last, row.last_frame), row.subject, row.label.target, row.label.point_px)
            for row in (self._labels.ranges if self._labels else ())
            if row.first_frame <= last and row.last_frame >= first
        ]
        names = self._subjects, self._targets, self._labels is None, self._traits
        inputs = _code(), rr.__version__, self._configuration, names, dict(self._names_now), block.digest, ranges, shown
        return hashlib.sha256(repr(inputs).encode()).hexdigest()[:32]

    def _log(self, layer: LayerFile, block: Block, key: str, shown: Shown) -> _LoggedBlock:
        log = FrameLog(layer.stream, before=shown)
        outcomes, errors, targets = Counter[str](), Counter[str](), dict[str, None]()
        of_block, labels = self._verdicts(block), self._labels or Labels(())
        for record in (renamed(frame, self._names_now) for frame in self._reader.read(block)):
            verdicts = of_block[record.frame]
            outcomes.update(verdict.outcome for verdict in verdicts)
            errors.update(verdict.error_type for verdict in verdicts if verdict.error_type)
            targets.update(dict.fromkeys(target.name for target in record.targets))
            log.begin(record.frame, record.time_ns)
            log_verdicts(log, record, verdicts, labels)
            log.end()
        paths = sorted(log.paths)
        log.send()
        layer.end_frame()
        return _LoggedBlock(
            key=key,
            outcomes=dict(outcomes),
            errors=dict(errors),
            targets=list(targets),
            shown=log.shown,
            paths=paths,
        )

    @cached_property
    def _judged(self) -> PairVerdicts:
        columns = self._columns.read((self._files.clip, self._configuration), self._names_now)
        return judge_columns(columns, self._labels, (), self._traits, {})

    def _verdicts(self, block: Block) -> dict[int, list[Verdict]]:
        """The verdicts of all subjects by frame: unscored for a subject who is neither labelled nor found."""
        nothing = Verdict(
            clip=self._files.clip,
            configuration=self._configuration,
            frame=0,
            subject="",
            truth=None,
            predicted=None,
            outcome="unscored",
            error_type=None,
        )
        verdicts: dict[int, list[Verdict]] = {frame: [] for frame in block.frames}
        for subject in self._subjects:
            known = dict[int, Verdict]()
            if (of_subject := self._judged.by_subject.get(subject)) is not None:
                chosen = of_subject.where(np.isin(of_subject.frames, block.frames))
                known = {verdict.frame: verdict for verdict in chosen.verdicts()}
            for frame, of_frame in verdicts.items():
                of_frame.append(known.get(frame) or replace(nothing, frame=frame, subject=subject))
        return verdicts

    def _end(self, layer: LayerFile, logged: Sequence[_LoggedBlock]) -> None:
        outcomes, errors, colours = Counter[str](), Counter[str](), Colours((*self._targets, *self._subjects))
        for block in logged:
            outcomes.update(block.outcomes)
            errors.update(block.errors)
            for name in block.targets:
                colours.class_of(name)
        log_palettes(layer.stream, self._configuration, self._subjects, colours)
        paths = {path for block in logged for path in block.paths}
        log_styles(layer.stream, self._configuration, self._subjects, paths)
        made_from = msgspec.json.encode(logged).decode()
        properties_of = {**_properties(self._files.clip, self._configuration, outcomes, errors), _MADE_FROM: made_from}
        layer.stream.send_property(self._configuration, rr.AnyValues(**properties_of))
        layer.close(complete=True)


def _older(path: Path, ids: RecordingIds) -> tuple[RecordingFile | None, list[_LoggedBlock]]:
    """The layer that is there, and the blocks that it was made from; none if it is damaged or of other ids."""
    with suppress(VfoaError, msgspec.DecodeError):
        if path.is_file() and (older := RecordingFile(path)).ids == ids:
            return older, msgspec.json.decode(str(older.properties().get(_MADE_FROM)), type=list[_LoggedBlock])
    return None, []


def _copy(layer: RecordingFile, stream: rr.RecordingStream, frames: Container[int]) -> None:
    """Copy the data of these frames, which have chunks of their own. Static data is not copied but logged again."""
    for chunk in layer.chunks():
        if not chunk.is_static and chunk.to_record_batch().column("frame")[0].as_py() in frames:
            stream.send_chunks(chunk)


def _properties(clip: str, configuration: str, outcomes: Counter[str], errors: Counter[str]) -> dict[str, Any]:
    """The properties of a configuration that Rerun's catalogue lists."""
    counts = {outcome: outcomes[outcome] for outcome in ("correct", "wrong", "unscored")}
    scored = counts["correct"] + counts["wrong"]
    rate = {"frr": counts["correct"] / scored} if scored else {}
    # of equal counts, the earliest in the pipeline
    commonest = {"commonest_error": max(ERROR_TYPES, key=lambda name: errors[name])} if errors else {}
    return {"clip": clip, "configuration": configuration, **counts, **rate, **commonest}
