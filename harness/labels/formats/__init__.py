"""Labels of other programs: one file per format, one protocol for all."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from harness.labels.formats.exchange import Exchange, Imported
from harness.labels.labels import Labels
from vfoa.registry import Registry


class AnnotationFormat(Protocol):
    """A format that can be read and written. Built as ``Class()``."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read labels.

        Raises
        ------
        vfoa.errors.VfoaError
            If the file is not of this format, or holds something that no label can express; the message says where.
        """
        ...

    def write(self, path: Path, labels: Labels, exchange: Exchange) -> tuple[str, ...]:
        """Write labels atomically; return a note for each thing that the format cannot hold.

        Raises
        ------
        vfoa.errors.VfoaError
            If data that the format needs is not known.
        """
        ...


FORMATS = Registry(
    kind="annotation format",
    builtin={
        "boris": "harness.labels.formats.boris:Boris",
        "boris-aggregated": "harness.labels.formats.boris_aggregated:BorisAggregated",
        "csv": "harness.labels.formats.annotation_csv:AnnotationCsv",
        "childplay": "harness.labels.formats.childplay:ChildPlay",
        "cvat": "harness.labels.formats.cvat:CvatVideo",
        "elan": "harness.labels.formats.elan:Elan",
        "idiap_vfoa": "harness.labels.formats.idiap_vfoa:IdiapGroundTruth",
        "videoattentiontarget": "harness.labels.formats.video_attention_target:VideoAttentionTarget",
    },
    group="vfoa.annotation_formats",
)

SUFFIXES = {
    "boris": ".boris",
    "boris-aggregated": ".csv",
    "childplay": ".csv",
    "csv": ".csv",
    "cvat": ".xml",
    "elan": ".eaf",
}
"""Default suffix of a file in each format; formats of other distributions have none."""
