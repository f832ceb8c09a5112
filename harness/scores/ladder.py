"""The oracle ladder: one stage after another replaced by the truth, to see how many points of FRR each costs."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace

from harness.adapters import Truth
from harness.clips.manifest import load_manifest
from harness.runs.configuration import Configuration
from harness.runs.experiment import Experiment
from harness.runs.stages import StageChoice
from harness.scores.score import ScoreRow, Scores
from harness.scores.statistics import Interval, bootstrap_interval
from harness.truth.oracle import OracleSettings
from vfoa.errors import VfoaError

_TRUTH = "truth"


@dataclass(frozen=True, slots=True)
class Rung:
    """A measurement that truth can replace: its name, the stage that makes it, and whether a frame's truth has it."""

    name: str
    slot: str
    is_known: Callable[[Truth], bool]


RUNGS = (
    Rung("disparity", "stereo", lambda truth: truth.disparity is not None),
    Rung("instances", "segmentation", lambda truth: truth.instances is not None),
    Rung("heads", "heads", lambda truth: truth.people is not None),
    Rung(
        "head_pose",
        "head_pose",
        lambda truth: truth.people is not None and all(each.head_direction is not None for each in truth.people),
    ),
    Rung(
        "gaze",
        "gaze",
        lambda truth: truth.people is not None and all(each.gaze_direction is not None for each in truth.people),
    ),
)
"""In the order of the pipeline, in which they are replaced."""


def with_ladder(experiment: Experiment) -> Experiment:
    """Add to every configuration its rungs, called ``sgbm-one+disparity+instances``.

    A rung is left out where the stage is off or the truth already, and where a clip's first frame does not know the
    truth; of the latter the notes say so.

    Raises
    ------
    VfoaError
        If a clip cannot be opened, or no stage is left to replace.
    """
    rungs, notes = _known_rungs(experiment.clips)
    configurations = [each for base in experiment.configurations for each in (base, *_climb(base, rungs))]
    if len(configurations) == len(experiment.configurations):
        raise VfoaError(
            f"{experiment.name}: --oracle: no stage that truth could replace; {'; '.join(notes) or 'all true'}"
        )
    return replace(experiment, configurations=tuple(configurations), notes=(*experiment.notes, *notes))


def _known_rungs(clips: tuple[str, ...]) -> tuple[list[Rung], list[str]]:
    rungs, notes = list(RUNGS), []
    for name in clips:
        clip = load_manifest(name).open()
        truth = clip.truth(clip.frames[0])
        missing = [rung for rung in RUNGS if not rung.is_known(truth)]
        if missing:
            unknown = ", ".join(rung.name for rung in missing)
            notes.append(f"Oracle ladder: {name} has no true {unknown}, so that these stages are not replaced.")
        rungs = [rung for rung in rungs if rung not in missing]
    return rungs, notes


def _climb(base: Configuration, rungs: list[Rung]) -> Iterator[Configuration]:
    current = base
    for rung in rungs:
        choice = current.choices[rung.slot]
        if choice is None or choice.name == _TRUTH:
            continue
        truth = StageChoice(slot=rung.slot, name=_TRUTH, settings=OracleSettings())
        current = replace(current, name=f"{current.name}+{rung.name}", choices={**current.choices, rung.slot: truth})
        yield current


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A rung that was scored on all clips together.

    ``gained`` is the FRR against the rung below, ``interval`` its 95 % interval by the moving-block bootstrap, both
    rungs on the same resamples. All three are None for the lowest rung.
    """

    configuration: str
    replaced: str | None
    row: ScoreRow
    gained: float | None = None
    interval: Interval | None = None

    @property
    def reads(self) -> str:
        """Whether the rung is better than the one below, as good within the interval, or falls; "" for the lowest."""
        if self.interval is None:
            return ""
        if self.interval.low > 0:
            return "better"
        return "as good" if self.interval.high >= 0 else "falls"


def without_rungs(configurations: Collection[str]) -> list[str]:
    """The configurations that were asked for: all but those that :func:`with_ladder` added."""
    return [name for name in configurations if _rung_below(name, configurations) is None]


def steps(scores: Scores) -> list[Step]:
    """The ladders of a run, each from its configuration upwards; empty for a run without."""
    rows = scores.by_clip()
    pooled = [row for row in rows if row.clip is None] or rows
    scored = {row.configuration: row for row in pooled}
    found: list[Step] = []
    for name, row in scored.items():
        below = _rung_below(name, scored)
        if below is not None:
            found.append(_step(row, scored[below], name.removeprefix(f"{below}+")))
        elif any(f"{name}+{each.name}" in scored for each in RUNGS):
            found.append(Step(configuration=name, replaced=None, row=row))
    return found


def _rung_below(name: str, configurations: Collection[str]) -> str | None:
    """The configuration that this one is a rung above; None if it is no rung."""
    below, _, replaced = name.rpartition("+")
    return below if below in configurations and replaced in {each.name for each in RUNGS} else None


def _step(row: ScoreRow, below: ScoreRow, replaced: str) -> Step:
    return Step(
        configuration=row.configuration,
        replaced=replaced,
        row=row,
        gained=row.frr - below.frr,
        interval=bootstrap_interval([row.resampled, -below.resampled], row.n),
    )
