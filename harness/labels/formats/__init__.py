"""Labels of other programs: one file per format, one protocol for all."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from harness.files.io import read_text
from harness.labels.files import VERSION_LINE, read_annotations, write_annotations
from harness.labels.formats.exchange import Exchange, Imported
from harness.labels.formats.spans import without
from harness.labels.labels import Labels
from vfoa.errors import VfoaError
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


class AnnotationCsv:
    """Reads and writes the CSV of ``annotations/README.md``, of labels of any origin."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read a file with the manifest's own names, or those that are renamed to them."""
        _check_own(exchange, path)
        if not read_text(path).startswith(VERSION_LINE.rpartition(" ")[0]):
            raise VfoaError(f"{path}:1: expected {VERSION_LINE!r}; for a table of your own, add --format table")
        labels = read_annotations(
            path,
            timeline=exchange.timeline,
            subjects=exchange.subjects,
            targets=exchange.targets,
            former=exchange.former,
            allow_gaps=True,
            translate=exchange.names_of_row,
        )
        found = [row for row in labels.ranges if exchange.positions(row)]
        outside = [
            f"{row.subject} in frames {row.first_frame} to {row.last_frame}"
            for row in labels.ranges
            if not exchange.positions(row)
        ]
        return without(outside, exchange.labels(found, path), path)

    def write(self, path: Path, labels: Labels, exchange: Exchange) -> tuple[str, ...]:
        """Write the canonical form, without people whom the manifest does not name."""
        _check_own(exchange, path)
        write_annotations(path, Labels(row for row in labels.ranges if row.subject in exchange.subjects))
        others = [name for name in labels.subjects if name not in exchange.subjects]
        return (f"labels of {', '.join(others)} are left out: no subject of the clip.",) if others else ()


def _check_own(exchange: Exchange, path: Path) -> None:
    """Reject a rate and an offset: the file has the clip's own frames and times."""
    for option, value in (("--fps", exchange.fps), ("--offset", exchange.offset)):
        if value is not None:
            raise VfoaError(
                f"{path}: {option} {value:g}: no effect on --format csv, which has the clip's own frames and times; "
                f"expected it without {option} (a table of another program: --format table)"
            )


FORMATS = Registry(
    kind="annotation format",
    builtin={
        "boris": "harness.labels.formats.boris:Boris",
        "coco": "harness.labels.formats.coco:Coco",
        "csv": "harness.labels.formats:AnnotationCsv",
        "cvat": "harness.labels.formats.cvat:Cvat",
        "datavyu": "harness.labels.formats.datavyu:Datavyu",
        "elan": "harness.labels.formats.elan:Elan",
        "idiap_vfoa": "harness.labels.formats.idiap_vfoa:IdiapGroundTruth",
        "label_studio": "harness.labels.formats.label_studio:LabelStudio",
        "observer": "harness.labels.formats.observer:Observer",
        "praat": "harness.labels.formats.praat:Praat",
        "pupil_cloud": "harness.labels.formats.pupil_cloud:PupilCloud",
        "table": "harness.labels.formats.own_table:OwnTable",
        "via": "harness.labels.formats.via:Via",
    },
    group="vfoa.annotation_formats",
)

SUFFIXES = {"csv": ".csv", "elan": ".eaf"}
"""Default suffix of a file in each format; formats of other distributions have none."""

_OWN = {
    ".eaf": "elan",
    ".boris": "boris",
    ".boris.gz": "boris",
    ".opf": "datavyu",
    ".textgrid": "praat",
    "aoi_fixations.csv": "pupil_cloud",
}
"""Ends of names that files of one format alone have."""


def own_format(path: Path) -> str | None:
    """The format of a file whose name ends as only files of this format do; None for any other name."""
    return next((name for suffix, name in _OWN.items() if path.name.lower().endswith(suffix)), None)


def format_of(path: Path) -> str:
    """As :func:`own_format`; raises a :class:`VfoaError` that lists all formats where the name does not tell."""
    if (name := own_format(path)) is None:
        listed = ", ".join(FORMATS.names())
        raise VfoaError(f"{path}: its name does not tell what wrote it; expected --format, one of: {listed}")
    return name
