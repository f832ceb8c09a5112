"""One style for all figures: column widths of papers, and colours and markers that stay distinct in grey print."""

from __future__ import annotations

from typing import Any

COLUMN_IN = 3.5
PAGE_IN = 7.16
"""Widths of one column and of two columns in inches, as in IEEE papers."""

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#8C6500", "#56B4E9", "#333333", "#999999")
"""After Okabe and Ito (2008), distinct for the colour-blind; their yellow is too light for lines on paper."""
MARKERS = "osD^vPX*"
HATCHES = ("", "////", "....", "xxxx", "\\\\\\\\", "++", "oo", "--", "**", "||")
GREY = "0.55"

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


def marker(number: int) -> str:
    """The marker of a configuration, by its place."""
    return MARKERS[number % len(MARKERS)]
