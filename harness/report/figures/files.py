"""The figures of runs, and their files: ``NAME_1col.svg``, ``NAME_1col.pdf``, and the same for two columns."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from importlib.util import find_spec
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

from harness.files.io import write_together
from harness.run.directory import Pair, RunDirectory
from harness.run.grid import base_of, is_meant
from harness.run.records import renamed
from harness.run.table_records import TableReader
from harness.score.calibration import reliabilities
from harness.score.finished_run import FinishedRun, read_scores
from harness.score.fit_logit import fit_logit
from harness.score.labelled_run import read_labelled
from harness.score.oracle_ablation import without_oracles
from harness.score.rows import ScoreRow
from harness.score.score import Scores
from harness.score.verdicts import Verdict
from vfoa.errors import VfoaError, listed

if TYPE_CHECKING:
    from matplotlib.figure import Figure

WIDTHS_INCH = {"1col": 3.5, "2col": 7.16}
"""The widths of a column and of a page with two columns, of IEEE's journals, inches."""
FORMATS = ("svg", "pdf")

Draw = Callable[[float], "Figure"]
"""Draws a figure of this width, inches."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Figures:
    """Figures by name, and a note for each one that these runs do not have."""

    drawn: dict[str, Draw] = field(default_factory=dict)
    missing: list[str] = field(default_factory=list)


def check_matplotlib() -> None:
    """Raise a :class:`VfoaError` if Matplotlib is not installed."""
    if find_spec("matplotlib") is None:
        raise VfoaError("figures: needs the package matplotlib; expected vfoa installed with its extra: vfoa[figures]")


def figure_files(folder: Path) -> list[Path]:
    """Every file that figures of runs can have in a folder."""
    return [folder / f"{name}_{width}.{kind}" for name, width, kind in product(NAMES, WIDTHS_INCH, FORMATS)]


NAMES = ("frr", "frr_by_clip", "error_types", "confusion", "calibration", "learning_curve", "failure")


def write_figures(figures: Figures, folder: Path) -> list[Path]:
    """Write every figure into a folder, which is made; all files or none. Equal runs give equal bytes.

    Letters that no font of this machine has are noted in ``figures.missing``.
    """
    from harness.report.figures.style import saved, styled

    contents: dict[Path, str | bytes] = {}
    with styled() as letters:
        for (name, draw), (width, inches) in product(figures.drawn.items(), WIDTHS_INCH.items()):
            figure = draw(inches)
            contents |= {folder / f"{name}_{width}.{kind}": saved(figure, kind) for kind in FORMATS}
    if letters:
        figures.missing.append(
            f"letters of names ({listed(sorted(letters), most=5)}): no font here has them; install one, such as Noto "
            "Sans CJK for Chinese, Japanese and Korean"
        )
    folder.mkdir(parents=True, exist_ok=True)
    write_together(contents)
    return list(contents)


def figures_of(runs: Sequence[Path], wanted: Wanted | None = None) -> Figures:
    """The figures of finished runs; ``wanted`` chooses the failure of the strip.

    Steps of an oracle ablation are left out, as in the figures of the report.

    Raises
    ------
    VfoaError
        If Matplotlib is not installed, a run is not finished, or no frame of a run is labelled.
    """
    check_matplotlib()
    from harness.report.figures import charts

    shown = [_Shown.read(run, name) for run, name in zip(runs, _names(runs), strict=True)]
    overall = [row for each in shown for row in each.rows(each.scores.rows.overall)]
    by_clip = [row for each in shown for row in each.rows(each.scores.rows.by_clip) if row[1].clip is not None]
    figures = Figures()
    figures.drawn["frr"] = lambda width: charts.forest(overall, width)
    figures.drawn["frr_by_clip"] = lambda width: charts.by_clip(by_clip, width)
    if any(row.correct < row.n for _, row in overall):
        figures.drawn["error_types"] = lambda width: charts.error_types(overall, width)
    else:
        figures.missing.append("error_types: no frame is wrong")
    verdicts = {name: found for each in shown for name, found in each.verdicts().items()}
    figures.drawn["confusion"] = lambda width: charts.confusion(verdicts, width)
    calibrations = [
        (each.named(found.configuration), found)
        for each in shown
        for found in reliabilities(each.scores.judged_subjects)
    ]
    if calibrations:
        figures.drawn["calibration"] = lambda width: charts.calibration(calibrations, width)
    else:
        figures.missing.append("calibration: no configuration gives probabilities")
    fits = []
    for each in shown:
        try:
            fits.append((each.name, fit_logit(read_labelled(RunDirectory(each.run))).fit))
        except VfoaError as error:
            figures.missing.append(f"learning_curve: {each.run}: {error}")
    if curves := [(name, fit) for name, fit in fits if fit.curve]:
        figures.drawn["learning_curve"] = lambda width: charts.learning_curve(curves, width)
    elif fits:
        figures.missing.append("learning_curve: too few labelled seconds for two points")
    _add_failure(figures, shown, wanted or Wanted())
    return figures


@dataclass(frozen=True, slots=True, kw_only=True)
class Wanted:
    """The failure of the strip; None: any. Without a wish, one of the commonest error of the best configuration."""

    clip: str | None = None
    configuration: str | None = None
    subject: str | None = None
    frame: int | None = None

    def holds(self, verdict: Verdict) -> bool:
        """Whether a verdict is one of them."""
        places = (self.clip, verdict.clip), (self.subject, verdict.subject), (self.frame, verdict.frame)
        is_of_configuration = is_meant(verdict.configuration, self.configuration)
        return is_of_configuration and all(wish in (None, found) for wish, found in places)


def _add_failure(figures: Figures, shown: Sequence[_Shown], wanted: Wanted) -> None:
    """Add the strip of one failure: of the first run that has a recording of one."""
    from harness.record.composed import find_clips
    from harness.record.frame_reading import read_frame
    from harness.report.figures.strip import WrongFrame, strip

    missing = "no such wrong frame has a recording"
    for each in shown:
        try:
            clips = {clip.files.clip: clip for clip in find_clips(each.run, None, None)}
        except VfoaError as error:
            missing = str(error)
            continue
        recorded = {(name, layers.configuration) for name, clip in clips.items() for layers in clip.layers}
        chosen = _failure(each.scores, recorded, wanted)
        if chosen is None:
            continue
        clip, pair = clips[chosen.clip], (chosen.clip, chosen.configuration)
        directory = RunDirectory(each.run)
        finished = FinishedRun.read(directory)
        reference = finished.reference()
        names_now = reference.names_now[chosen.clip]
        reader = TableReader(directory, finished.manifest, [chosen.clip])
        near = [frame for frame in clip.frames if abs(frame - chosen.frame) <= _AROUND]
        blocks = [block for block in reader.blocks if (block.clip, block.configuration) == pair]
        label = reference.labels[chosen.clip].at(chosen.frame, chosen.subject)
        assert label, "a wrong frame without a label"
        content = read_frame(clip, chosen.configuration, chosen.subject, chosen.frame)
        failure = WrongFrame(
            verdict=chosen,
            label=label,
            content=content,
            records=[
                renamed(record, names_now) for block in blocks for record in reader.read(block) if record.frame in near
            ],
            verdicts=[
                verdict
                for verdict in each.scores.verdicts
                if (verdict.clip, verdict.configuration, verdict.subject) == (*pair, chosen.subject)
                and verdict.frame in near
            ],
            targets=[names_now.get(name, name) for name in _targets(each.run, chosen.clip)],
        )
        figures.drawn["failure"] = partial(strip, failure)
        return
    figures.missing.append(f"failure: {missing}")


_AROUND = 40
"""Frames on either side of a failure that its curves show."""


def _failure(scores: Scores, recorded: set[Pair], wanted: Wanted) -> Verdict | None:
    wrong = [
        verdict
        for verdict in scores.verdicts
        if verdict.outcome == "wrong" and (verdict.clip, verdict.configuration) in recorded and wanted.holds(verdict)
    ]
    if not wrong:
        return None
    rates = {row.configuration: row.frr for row in scores.rows.overall}
    best = max(dict.fromkeys(v.configuration for v in wrong), key=lambda name: rates.get(base_of(name), 0.0))
    of_best = [verdict for verdict in wrong if verdict.configuration == best]
    ((commonest, _),) = Counter(verdict.error_type for verdict in of_best).most_common(1)
    return next(verdict for verdict in of_best if verdict.error_type == commonest)


def _targets(run: Path, clip: str) -> list[str]:
    """The names of a clip in a run in the order in which recordings colour them: targets, then subjects."""
    (about,) = (each for each in RunDirectory(run).read_manifest().clips if each.name == clip)
    return [*about.targets, *about.subjects]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Shown:
    """A run: its folder, its name, empty for a single run, and its scores."""

    run: Path
    name: str
    scores: Scores

    @classmethod
    def read(cls, run: Path, name: str) -> _Shown:
        scores = read_scores(RunDirectory(run))
        if not scores.rows:
            problem = "no labelled frame; expected labels of its clips: `vfoa annotate` or `vfoa labels import`"
            raise VfoaError(f"{run}: {problem}")
        return cls(run=run, name=name, scores=scores)

    def named(self, configuration: str) -> str:
        """The name of a configuration in the figures."""
        return f"{self.name}: {configuration}" if self.name else configuration

    def rows(self, rows: Sequence[ScoreRow]) -> list[tuple[str, ScoreRow]]:
        plain = set(without_oracles(self.scores.scored_configurations))
        return [(self.named(row.configuration), row) for row in rows if row.configuration in plain]

    def verdicts(self) -> dict[str, list[Verdict]]:
        """The scored verdicts of each configuration."""
        found = {name: list[Verdict]() for name in without_oracles(self.scores.configurations)}
        for verdict in self.scores.verdicts:
            if verdict.outcome != "unscored" and verdict.configuration in found:
                found[verdict.configuration].append(verdict)
        return {self.named(name): verdicts for name, verdicts in found.items() if verdicts}


def _names(runs: Sequence[Path]) -> list[str]:
    """A name for each run: its folder's, with the parent's where two are equal; empty for a single run."""
    if len(runs) == 1:
        return [""]
    names = [run.resolve().name for run in runs]
    return [
        name if names.count(name) == 1 else f"{run.resolve().parent.name}/{name}"
        for run, name in zip(runs, names, strict=True)
    ]
