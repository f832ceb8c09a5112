"""Figures by kind, for runs and sweeps."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from harness.report.plots.confusion import draw_confusion
from harness.report.plots.errors import draw_errors
from harness.report.plots.forest import draw_forest
from harness.report.plots.oracle import draw_oracle
from harness.report.plots.style import STYLE
from harness.report.plots.sweep_heatmap import draw_sweep
from harness.report.plots.timeline import draw_timeline
from harness.run.directory import RunDirectory
from harness.score.finished_run import read_scores
from harness.score.oracle_ablation import without_oracles
from harness.score.score import Scores
from harness.score.sweep.read import is_sweep, read_sweep
from vfoa.errors import VfoaError

SCORED: dict[str, Callable[[Scores, str | None, str | None], Figure]] = {
    "forest": lambda scores, clip, subject: draw_forest(scores),
    "errors": lambda scores, clip, subject: draw_errors(scores),
    "oracle": lambda scores, clip, subject: draw_oracle(scores),
    "timeline": draw_timeline,
    "confusion": lambda scores, clip, subject: draw_confusion(scores, clip),
}
"""Figures of a run, by kind; the figure of a sweep is ``sweep``."""

KINDS = (*SCORED, "sweep")
_USES_CLIP = ("timeline", "confusion")


def plot_run(directory: Path, kind: str, *, clip: str | None = None, subject: str | None = None) -> Figure:
    """Draw a figure of a finished run, or of a sweep, in the style for print.

    Parameters
    ----------
    kind
        One of :data:`KINDS`.
    clip
        For ``timeline`` and ``confusion``: the clip; None for the first one, or for all clips together.
    subject
        For ``timeline``: the subject; None for the first one.

    Raises
    ------
    VfoaError
        If the directory holds no such run, a clip or subject is unknown, or the run has nothing to draw.
    """
    if clip is not None and kind not in _USES_CLIP:
        raise VfoaError(f"plot: --clip is for {' and '.join(_USES_CLIP)}; found --kind {kind}")
    if subject is not None and kind != "timeline":
        raise VfoaError(f"plot: --subject is for timeline; found --kind {kind}")
    with mpl.rc_context(STYLE):
        if is_sweep(directory) != (kind == "sweep"):
            wanted = "sweep" if is_sweep(directory) else f"one of {', '.join(_kinds_of(directory))}"
            raise VfoaError(f"{directory}: found --kind {kind}; expected {wanted}, which it has")
        if kind == "sweep":
            return draw_sweep(read_sweep(directory))
        scores = read_scores(RunDirectory(directory))
        if clip is not None and clip not in scores.clips:
            raise VfoaError(f"plot: --clip: found {clip!r}; expected one of {', '.join(scores.clips)}")
        if kind in ("forest", "errors") and not scores.rows:
            raise VfoaError(f"{directory}: no frame is labelled; expected a run with scores")
        return SCORED[kind](scores, clip, subject)


def _kinds_of(run: Path) -> list[str]:
    """The kinds of figures that a run has: an oracle ablation only if it was run with one."""
    configurations = list(RunDirectory(run).read_manifest()["configurations"])
    has_oracle = without_oracles(configurations) != configurations
    return [kind for kind in SCORED if kind != "oracle" or has_oracle]
