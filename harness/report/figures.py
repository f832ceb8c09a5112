"""Figures as files, the same bytes for the same figure."""

from __future__ import annotations

import io
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from harness.files import atomic_write


def write_figure(stem: Path, figure: Figure) -> None:
    """Write a figure as ``<stem>.svg`` and ``<stem>.png``."""
    for kind in ("svg", "png"):
        atomic_write(stem.with_name(f"{stem.name}.{kind}"), _drawn(figure, kind))


def _drawn(figure: Figure, kind: str) -> bytes:
    """One figure as a file. A ``Figure`` without pyplot draws off screen, whatever the back end."""
    content = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "vfoa"}):  # else the ids in an SVG are random
        figure.savefig(content, format=kind, metadata={"Date": None} if kind == "svg" else None)
    return content.getvalue()
