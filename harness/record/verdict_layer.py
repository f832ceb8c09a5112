"""Writes the layer of the verdicts from a finished run's results and the present labels."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterable, Mapping
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import Any

import rerun as rr

from harness.files import digest_files, file_digest
from harness.labels.labels import Labels
from harness.record import appearance, entities, frame_log, layer_file, verdicts
from harness.record.appearance import Colours
from harness.record.composed import clip_names
from harness.record.layer_file import LayerFile
from harness.record.layers import ClipFiles
from harness.record.reading import properties
from harness.record.verdicts import log_verdicts
from harness.run.directory import Pair, RunDirectory
from harness.run.records import FrameRecord
from harness.run.results import read_results
from harness.score import posterior_checks
from harness.score import verdicts as scored
from harness.score.verdicts import judge
from vfoa.errors import VfoaError

_MADE_FROM = "made_from"
"""The property of a layer that says what it was written from."""


_Names = tuple[tuple[str, ...], tuple[str, ...]]
"""Subjects and targets of a clip."""


def write_verdict_layers(directory: RunDirectory, labels: Mapping[str, Labels]) -> None:
    """Write ``CLIP__CONFIGURATION.verdicts.rrd`` for every recording of a run; older ones are replaced.

    A recording then shows what the tables say, also after a label was edited. A layer that was written from the same
    results and labels by the same code is left as it is. ``labels`` are those of the clips by name; a clip without any
    has only predictions.

    Raises
    ------
    VfoaError
        If the manifest or the results of the run cannot be read.
    """
    manifest = directory.read_manifest()
    clips = {clip["name"]: clip_names(clip) for clip in manifest["clips"]}
    stale = _stale(directory, manifest["configurations"], clips, labels)
    if not stale:
        return
    for pair, records in groupby(read_results(directory.results), lambda each: (each.clip, each.configuration)):
        if pair in stale:
            clip, configuration = pair
            files = ClipFiles(run=directory.path, clip=clip)
            _write(files, configuration, *clips[clip], labels.get(clip), records, stale[pair])


def _stale(
    directory: RunDirectory, configurations: Iterable[str], clips: Mapping[str, _Names], labels: Mapping[str, Labels]
) -> dict[Pair, str]:
    """The layers that must be written, with what they are then made from."""
    results = file_digest(directory.results)
    stale: dict[Pair, str] = {}
    for clip, names in clips.items():
        files, made_from = ClipFiles(run=directory.path, clip=clip), _digest(results, names, labels.get(clip))
        for configuration in configurations:
            if files.attention(configuration).is_file() and _made_from(files.verdicts(configuration)) != made_from:
                stale[clip, configuration] = made_from
    return stale


def _digest(results: str, names: object, labels: Labels | None) -> str:
    ranges = labels and [
        (each.first_frame, each.last_frame, each.subject, each.label.target, each.label.point_px)
        for each in labels.ranges
    ]
    return hashlib.sha256(repr((_code(), rr.__version__, results, names, ranges)).encode()).hexdigest()


@cache
def _code() -> str:
    """The digest of what writes the layer. That of all that it imports would take longer than to write a small one."""
    modules = (verdicts, entities, frame_log, layer_file, appearance, scored, posterior_checks)
    files = [Path(__file__), *(Path(str(each.__file__)) for each in modules)]
    return digest_files((file.name, file) for file in files)


def _made_from(layer: Path) -> object:
    """What a layer was made from; None where there is none, or it is damaged: then it is written anew."""
    if not layer.is_file():
        return None
    try:
        return properties(layer).get(_MADE_FROM)
    except VfoaError:
        return None


def _write(
    files: ClipFiles,
    configuration: str,
    subjects: tuple[str, ...],
    targets: tuple[str, ...],
    labels: Labels | None,
    records: Iterable[FrameRecord],
    made_from: str,
) -> None:
    layer = LayerFile(files.verdicts(configuration), files)
    colours, outcomes = Colours((*targets, *subjects)), Counter[str]()
    layer.open()
    log = layer.part("verdicts")
    for record in records:
        verdicts = [judge(record, name, labels.at(record.frame, name) if labels else None) for name in subjects]
        outcomes.update(each.outcome for each in verdicts)
        for target in record.targets:
            colours.class_of(target.name)
        log.begin(record.frame, record.time_ns)
        log_verdicts(log, record, verdicts, colours)
        log.end()
        layer.end_frame()
    properties_of = {**_properties(files.clip, configuration, outcomes), _MADE_FROM: made_from}
    layer.stream.send_property(configuration, rr.AnyValues(**properties_of))
    layer.close(complete=True)


def _properties(clip: str, configuration: str, outcomes: Counter[str]) -> dict[str, Any]:
    """What Rerun's catalogue lists of a configuration."""
    counts = {outcome: outcomes[outcome] for outcome in ("correct", "wrong", "unscored")}
    scored = counts["correct"] + counts["wrong"]
    rate = {"frr": counts["correct"] / scored} if scored else {}
    return {"clip": clip, "configuration": configuration, **counts, **rate}
