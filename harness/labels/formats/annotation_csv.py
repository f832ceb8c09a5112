"""The project's own annotation files as a format, for labels that come from a run or from elsewhere."""

from __future__ import annotations

from pathlib import Path

from harness.labels.files import read_annotations, write_annotations
from harness.labels.formats.exchange import Exchange, Imported
from harness.labels.labels import Labels
from harness.labels.timeline import timeline_of


class AnnotationCsv:
    """Reads and writes the CSV of ``annotations/README.md``; nothing is lost."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read a file with the manifest's own names."""
        labels = read_annotations(
            path,
            timeline=timeline_of(exchange.clip),
            subjects=exchange.subjects,
            targets=exchange.targets,
            allow_gaps=True,
        )
        return exchange.labels(labels.ranges, path)

    def write(self, path: Path, labels: Labels, exchange: Exchange) -> tuple[str, ...]:
        """Write the canonical form."""
        write_annotations(path, labels)
        return ()
