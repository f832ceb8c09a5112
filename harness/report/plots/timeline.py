"""One subject over time: the true target, and the outcome of each frame under each configuration."""

from __future__ import annotations

from itertools import groupby

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from harness.report.plots.style import PAGE_IN, error_style
from harness.score.oracle_ablation import without_oracles
from harness.score.score import Scores
from harness.score.verdicts import ERROR_TYPES, Verdict
from vfoa.errors import VfoaError

CORRECT = "#cfe8d5"
UNSCORED = "0.88"


def draw_timeline(scores: Scores, clip: str | None, subject: str | None) -> Figure:
    """Draw one row for each configuration, for one subject of one clip; None: the first ones.

    Raises
    ------
    VfoaError
        If there is no such clip or subject.
    """
    clip = clip or scores.clips[0]
    subjects = dict.fromkeys(each.subject for each in scores.verdicts if each.clip == clip)
    if not subjects:
        raise VfoaError(f"plot: found no subject with a name in {clip!r}; clips: {', '.join(scores.clips)}")
    if subject is not None and subject not in subjects:
        raise VfoaError(f"plot: --subject: found {subject!r}; expected one of {', '.join(subjects)}")
    subject = subject or next(iter(subjects))
    names = without_oracles(scores.configurations)
    strips = {
        name: [each for each in scores.verdicts_of(name) if (each.clip, each.subject) == (clip, subject)]
        for name in names
    }
    strips = {name: verdicts for name, verdicts in strips.items() if verdicts}
    seen = [each for each in ERROR_TYPES if any(v.error_type == each for found in strips.values() for v in found)]
    figure = Figure(figsize=(PAGE_IN, 0.24 * (len(strips) + 1) + 1.1), layout="constrained")
    axes = figure.subplots()
    _draw_truth(axes, next(iter(strips.values())))
    for row, verdicts in enumerate(strips.values(), start=1):
        _draw_strip(axes, row, verdicts)
    axes.set_yticks(range(len(strips) + 1), ["truth", *strips])
    axes.invert_yaxis()
    axes.tick_params(axis="y", length=0)
    axes.spines["left"].set_visible(False)
    axes.set_xlabel("frame")
    axes.set_title(f"{clip}, {subject}")
    patches = [Patch(fc=CORRECT, label="correct"), Patch(fc=UNSCORED, label="unscored")]
    patches += [
        Patch(fc=error_style(each)[0], ec="w", hatch=error_style(each)[1], label=each.replace("_", " "))
        for each in seen
    ]
    figure.legend(handles=patches, loc="outside lower center", ncols=6)
    return figure


def _draw_truth(axes: Axes, verdicts: list[Verdict]) -> None:
    names = list(dict.fromkeys(each.truth for each in verdicts if each.truth is not None))
    span = verdicts[-1].frame - verdicts[0].frame + 1
    for truth, same in groupby(verdicts, key=lambda each: each.truth):
        frames = [each.frame for each in same]
        if truth is None:
            continue
        wide = frames[-1] - frames[0] + 1
        shade = 0.72 + 0.2 * (names.index(truth) % 2)
        axes.barh(0, wide, left=frames[0] - 0.5, height=0.8, color=str(shade), edgecolor="white", lw=0.5)
        if wide / span > 0.013 * len(truth):
            axes.text(frames[0] + wide / 2 - 0.5, 0, truth, ha="center", va="center", fontsize=6.5)


def _draw_strip(axes: Axes, row: int, verdicts: list[Verdict]) -> None:
    for kind, same in groupby(verdicts, key=lambda each: each.error_type or each.outcome):
        frames = [each.frame for each in same]
        face, hatch = (CORRECT if kind == "correct" else UNSCORED), ""
        if kind in ERROR_TYPES:
            face, hatch = error_style(kind)
        axes.barh(
            row,
            frames[-1] - frames[0] + 1,
            left=frames[0] - 0.5,
            height=0.8,
            color=face,
            hatch=hatch,
            edgecolor="white",
            lw=0,
        )
