"""The look of figures in print: light, sans-serif at 7 to 8 points, the colours and shapes of the report's page."""

from __future__ import annotations

import io
import math
import re
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import matplotlib as mpl
from matplotlib import font_manager
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

INK, SOFT, LINE, PANEL = "#1c1f24", "#59616e", "#d9dde4", "#f4f5f8"
RIGHT, OFF = "#2e8b57", "#d9480f"
_COLOURS = ("#0b62c4", "#c2410c", "#0b7a4b", "#a21caf", "#7a5a00", "#0e7490", "#be123c", "#475569")
_SHAPES = ("o", "s", "^", "D", "v", "P", "X")

_STYLE = {
    "svg.hashsalt": "vfoa",  # equal runs give equal bytes
    "svg.fonttype": "path",  # letters as outlines: the same in every program
    "pdf.fonttype": 42,  # TrueType, embedded
    "font.family": "DejaVu Sans",  # comes with Matplotlib
    "font.size": 7,
    "axes.titlesize": 7.5,
    "axes.labelsize": 7.5,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "legend.handlelength": 1.4,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "axes.axisbelow": True,
    "grid.color": LINE,
    "grid.linewidth": 0.6,
    "text.color": INK,
    "text.parse_math": False,  # names may have dollar signs
    "figure.dpi": 100,
    "savefig.dpi": 300,  # of pictures inside
    "lines.linewidth": 1.1,
    "hatch.linewidth": 0.5,
}


_FURTHER_FONTS = (
    *("Noto Sans CJK SC", "Noto Sans CJK JP", "Source Han Sans SC", "WenQuanYi Zen Hei", "Droid Sans Fallback"),
    *("PingFang SC", "Hiragino Sans", "Microsoft YaHei", "Yu Gothic", "Malgun Gothic", "Arial Unicode MS"),
)
"""Fonts of common systems for the letters that DejaVu Sans lacks, such as Chinese, Japanese and Korean ones."""
_MISSING = re.compile(r"Glyph (\d+) .* missing from font")


@contextmanager
def styled() -> Iterator[set[str]]:
    """Draw and save in this style within the block, whatever the user's own settings of Matplotlib are.

    Letters that no font has are drawn as boxes; at the end of the block they are in the set that it is given.
    """
    installed = {font.name for font in font_manager.fontManager.ttflist}
    families = [_STYLE["font.family"], *(name for name in _FURTHER_FONTS if name in installed)]
    letters = set[str]()
    with mpl.rc_context(), warnings.catch_warnings(record=True) as caught:
        mpl.rcdefaults()
        warnings.filterwarnings("always", message="Glyph")
        mpl.rcParams.update({**_STYLE, "font.family": families})
        yield letters
    for warning in caught:
        if match := _MISSING.match(str(warning.message)):
            letters.add(chr(int(match[1])))
        else:
            warnings.warn_explicit(warning.message, warning.category, warning.filename, warning.lineno)


def canvas(width_inch: float, height_inch: float) -> Figure:
    """A figure whose parts, legends included, keep clear of each other and of its edges."""
    layout = ConstrainedLayoutEngine(w_pad=0.03, h_pad=0.03)
    return Figure(figsize=(width_inch, height_inch), layout=layout, facecolor="white")


def add_legend_below(figure: Figure, handles: Sequence[Any], columns: int) -> None:
    """Add a legend in as many columns as fit, ``columns`` at most; further lines make the figure higher."""
    for fewer in range(columns, 0, -1):
        legend = figure.legend(handles=handles, loc="outside lower center", ncols=fewer)
        if legend.get_window_extent().width <= figure.bbox.width or fewer == 1:
            break
        legend.remove()
    further = math.ceil(len(handles) / fewer) - math.ceil(len(handles) / columns)
    figure.set_figheight(figure.get_figheight() + 0.14 * further)


def saved(figure: Figure, kind: str) -> bytes:
    """The figure as a file of this kind, ``svg`` or ``pdf``, without the time at which it was made."""
    file = io.BytesIO()
    figure.savefig(file, format=kind, metadata={"Date" if kind == "svg" else "CreationDate": None})
    return file.getvalue()


def colour(number: int) -> str:
    """The colour of the configuration with this number."""
    return _COLOURS[number % len(_COLOURS)]


def shape(number: int) -> str:
    """The marker of the configuration with this number; with the colour, 56 configurations differ."""
    return _SHAPES[number % len(_SHAPES)]


def is_wide(width_inch: float) -> bool:
    """Whether a figure takes two columns."""
    return width_inch > 5
