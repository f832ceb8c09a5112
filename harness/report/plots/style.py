"""One style for all figures: column widths of papers, and colours and markers that stay distinct in grey print."""

from __future__ import annotations

from typing import Any

from harness.score.verdicts import ERROR_TYPES

COLUMN_IN = 3.5
PAGE_IN = 7.16
"""Widths of one column and of two columns in inches, as in IEEE papers."""

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#8C6500", "#56B4E9", "#333333", "#999999")
"""After Okabe and Ito (2008), distinct for the colour-blind; their yellow is too light for lines on paper."""
MARKERS = "os^Dv"
HATCHES = ("", "////", "....", "xxxx", "\\\\\\\\", "++", "oo", "--", "**", "||")
GREY = "0.55"

_ERROR_COLOURS = (
    *("#312e81", "#4338ca", "#6d28d9", "#0e7490", "#0f766e"),
    *("#a16207", "#9d174d", "#525b69", "#c2410c", "#b3261e"),
)
"""Of :data:`ERROR_TYPES`, in their order, as on the report page (``--e0`` to ``--e9`` of its style sheet)."""

STYLE: dict[Any, Any] = {
    "font.size": 8,
    "axes.titlesize": 8.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 8,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.6,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": 7.5,
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "lines.markersize": 4,
    "hatch.linewidth": 0.5,
    "figure.dpi": 100,
    "savefig.dpi": 300,
    "pdf.fonttype": 42,
    "svg.hashsalt": "vfoa",
}
"""Settings of Matplotlib. Type 42: text in a PDF stays text, as publishers require."""


def colour(number: int) -> str:
    """The colour of a configuration, by its place."""
    return COLOURS[number % len(COLOURS)]


def error_style(error_type: str) -> tuple[str, str]:
    """The colour and the hatch of an error type, the same in every figure."""
    number = list(ERROR_TYPES).index(error_type)
    return _ERROR_COLOURS[number % len(_ERROR_COLOURS)], HATCHES[number % len(HATCHES)]


def marker(number: int) -> str:
    """The marker of a configuration, by its place."""
    return MARKERS[number % len(MARKERS)]
