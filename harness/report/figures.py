"""Figures as files. The same figure gives the same bytes."""

from __future__ import annotations

import io
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from harness.files.io import atomic_write
from harness.report.plots.style import STYLE
from vfoa.errors import VfoaError

_UNDATED = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": None}


def figure_files(stem: Path, figure: Figure) -> dict[Path, bytes]:
    """The content of ``<stem>.svg`` and ``<stem>.png``."""
    return {path: _drawn(figure, path) for path in (stem.with_name(f"{stem.name}.{kind}") for kind in ("svg", "png"))}


def save_figure(path: Path, figure: Figure) -> None:
    """Write a figure in the format of the file's name: see :func:`check_format`."""
    atomic_write(path, _drawn(figure, path))


def _drawn(figure: Figure, path: Path) -> bytes:
    kind = check_format(path)
    content = io.BytesIO()
    # a Figure without pyplot draws off screen, whatever the back end; without the salt the ids in an SVG are random
    with mpl.rc_context(STYLE):
        figure.savefig(content, format=kind, metadata=_UNDATED[kind])
    return content.getvalue()


def check_format(path: Path) -> str:
    """Return the format given by the file's name: ``pdf``, ``svg`` or ``png``.

    Raises
    ------
    VfoaError
        If it is another one.
    """
    kind = path.suffix.removeprefix(".").lower()
    if kind not in _UNDATED:
        raise VfoaError(f"{path}: found the ending {path.suffix!r}; expected .pdf, .svg or .png")
    return kind
