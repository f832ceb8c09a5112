"""Writes the layer of the verdicts from a finished run's results and the present labels."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from itertools import groupby
from typing import Any

import rerun as rr

from harness.labels.files import Labels
from harness.record.composed import clip_names
from harness.record.labels import Colours
from harness.record.layer_file import LayerFile
from harness.record.layers import ClipFiles
from harness.record.verdicts import log_verdicts
from harness.run.directory import RunDirectory
from harness.run.results import FrameRecord, read_results
from harness.score.verdicts import judge


def write_verdict_layers(directory: RunDirectory, labels: Mapping[str, Labels]) -> None:
    """Write ``CLIP__CONFIGURATION.verdicts.rrd`` for every recording of a run; older ones are replaced.

    A recording then shows what the tables say, also after a label was edited. ``labels`` are those of the clips by
    name; a clip without any has only predictions.

    Raises
    ------
    VfoaError
        If the manifest or the results of the run cannot be read.
    """
    names = {clip["name"]: clip_names(clip) for clip in directory.read_manifest()["clips"]}
    for (clip, configuration), records in groupby(
        read_results(directory.results), lambda each: (each.clip, each.configuration)
    ):
        files = ClipFiles(run=directory.path, clip=clip)
        if files.attention(configuration).is_file():
            _write(files, configuration, *names[clip], labels.get(clip), records)


def _write(
    files: ClipFiles,
    configuration: str,
    subjects: tuple[str, ...],
    targets: tuple[str, ...],
    labels: Labels | None,
    records: Iterable[FrameRecord],
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
    layer.stream.send_property(configuration, rr.AnyValues(**_properties(files.clip, configuration, outcomes)))
    layer.close(complete=True)


def _properties(clip: str, configuration: str, outcomes: Counter[str]) -> dict[str, Any]:
    """What Rerun's catalogue lists of a configuration."""
    counts = {outcome: outcomes[outcome] for outcome in ("correct", "wrong", "unscored")}
    scored = counts["correct"] + counts["wrong"]
    rate = {"frr": counts["correct"] / scored} if scored else {}
    return {"clip": clip, "configuration": configuration, **counts, **rate}
