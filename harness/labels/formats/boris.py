"""BORIS: its project file, or its tables of events (CSV, TSV, XLSX), distinguished by their content.

A file called ``.boris`` is written as a project, any other as a table of tabular events.
"""

from __future__ import annotations

from pathlib import Path

from harness.files.io import read_bytes
from harness.labels.formats.boris_aggregated import REQUIRED as AGGREGATED
from harness.labels.formats.boris_aggregated import BorisAggregated
from harness.labels.formats.boris_project import SUFFIXES, read_project, write_project
from harness.labels.formats.boris_tabular import BorisTabular
from harness.labels.formats.exchange import Exchange, Imported
from harness.labels.formats.tables import rows_of
from harness.labels.labels import Labels


class Boris:
    """State events. Point events have no length and are left out, with a note."""

    def read(self, path: Path, exchange: Exchange) -> Imported:
        """Read one observation."""
        if path.name.lower().endswith(SUFFIXES) or read_bytes(path)[:1] == b"{":
            return read_project(path, exchange)
        if any(set(AGGREGATED) <= set(cells) for _, cells in rows_of(path)):
            return BorisAggregated().read(path, exchange)
        return BorisTabular().read(path, exchange)

    def write(self, path: Path, labels: Labels, exchange: Exchange) -> tuple[str, ...]:
        """Write a project or a table, by the file's name."""
        if path.name.lower().endswith(".boris"):
            return write_project(path, labels, exchange)
        return BorisTabular().write(path, labels, exchange)
