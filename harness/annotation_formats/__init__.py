"""Labels of other programs: one file per format, one protocol for all."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from harness.annotation_formats.exchange import Exchange, Imported
from harness.annotations.labels import Labels
from vfoa.registry import Registry


class AnnotationFormat(Protocol):
    """A format that can be read and written. Built as ``Class()``."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read labels.

        Raises
        ------
        vfoa.errors.VfoaError
            If the file is not of this format, or says what a label cannot say: the message names the place.
        """
        ...

    def write(self, path: Path, labels: Labels, exchange: Exchange) -> tuple[str, ...]:
        """Write labels, whole or not at all; the answer says, a sentence each, what the format cannot hold.

        Raises
        ------
        vfoa.errors.VfoaError
            If what the format needs is not known.
        """
        ...


FORMATS = Registry(
    kind="annotation format",
    builtin={
        "boris": "harness.annotation_formats.boris_tabular:BorisTabular",
        "boris-aggregated": "harness.annotation_formats.boris_aggregated:BorisAggregated",
        "childplay": "harness.annotation_formats.childplay:ChildPlay",
        "cvat": "harness.annotation_formats.cvat:CvatVideo",
        "elan": "harness.annotation_formats.elan:Elan",
        "videoattentiontarget": "harness.annotation_formats.video_attention_target:VideoAttentionTarget",
    },
    group="vfoa.annotation_formats",
)
