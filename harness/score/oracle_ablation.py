"""The oracle ablation: the ground truth replaces one stage after another, to see how many points of FRR each costs.

Scoring a run imports none of its stages: only an experiment with steps does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from harness.clips.manifest import load_manifest
from harness.score.intervals import difference_interval
from harness.score.score import ScoreRow, Scores
from harness.score.scored_frames import pair
from harness.score.statistics import Interval
from harness.sources import Truth
from vfoa.errors import VfoaError

if TYPE_CHECKING:
    from harness.pipeline.configuration import Configuration
    from harness.run.experiment import Experiment

_TRUTH = "truth"


@dataclass(frozen=True, slots=True)
class Replacement:
    """A stage whose output the ground truth can replace: its name, its slot, and whether a frame has it."""

    name: str
    slot: str
    is_known: Callable[[Truth], bool]


REPLACEMENTS = (
    Replacement("disparity", "stereo", lambda truth: truth.disparity is not None),
    Replacement("instances", "segmentation", lambda truth: truth.instances is not None),
    Replacement("heads", "heads", lambda truth: truth.people is not None),
    Replacement(
        "head_pose",
        "head_pose",
        lambda truth: truth.people is not None and all(each.head_direction is not None for each in truth.people),
    ),
    Replacement(
        "gaze",
        "gaze",
        lambda truth: truth.people is not None and all(each.gaze_direction is not None for each in truth.people),
    ),
)
"""The stages, in the order of the pipeline, in which they are replaced."""


def with_oracle_ablation(experiment: Experiment) -> Experiment:
    """Add the steps of the oracle ablation to every configuration, named ``sgbm-one+disparity+instances``.

    A step is left out if the stage is off or is the ground truth of every frame already. It is also left out if the
    first frame of a clip has no such ground truth; a note says so.

    Raises
    ------
    VfoaError
        If a clip cannot be opened, or no stage is left to replace.
    """
    replacements, notes = _known_replacements(experiment.clips)
    configurations = [each for base in experiment.configurations for each in (base, *_steps_of(base, replacements))]
    if len(configurations) == len(experiment.configurations):
        raise VfoaError(
            f"{experiment.name}: --oracle: no stage that truth could replace; {'; '.join(notes) or 'all true'}"
        )
    return replace(experiment, configurations=tuple(configurations), notes=(*experiment.notes, *notes))


def _known_replacements(clips: tuple[str, ...]) -> tuple[list[Replacement], list[str]]:
    replacements, notes = list(REPLACEMENTS), []
    for name in clips:
        clip = load_manifest(name).open()
        truth = clip.truth(clip.frames[0])
        missing = [replacement for replacement in REPLACEMENTS if not replacement.is_known(truth)]
        if missing:
            unknown = ", ".join(replacement.name for replacement in missing)
            notes.append(f"Oracle ablation: {name} has no true {unknown}; these stages are not replaced.")
        replacements = [replacement for replacement in replacements if replacement not in missing]
    return replacements, notes


def _steps_of(base: Configuration, replacements: list[Replacement]) -> Iterator[Configuration]:
    from harness.pipeline.configuration import StageChoice
    from harness.pipeline.ground_truth import OracleSettings

    current = base
    for replacement in replacements:
        choice = current.choices[replacement.slot]
        if choice is None or (choice.name == _TRUTH and getattr(choice.settings, "every", 1) == 1):
            continue
        truth = StageChoice(slot=replacement.slot, name=_TRUTH, settings=OracleSettings())
        current = replace(
            current, name=f"{current.name}+{replacement.name}", choices={**current.choices, replacement.slot: truth}
        )
        yield current


@dataclass(frozen=True, slots=True, kw_only=True)
class Step:
    """A step that was scored on all clips together.

    ``gained`` is the FRR minus that of the step before, ``interval`` its 95 % interval by clips or looks. All three are
    None for the first step.
    """

    configuration: str
    replaced: str | None
    row: ScoreRow
    gained: float | None = None
    interval: Interval | None = None

    @property
    def reads(self) -> str:
        """Whether the step is better than the one before, as good within the interval, or worse; "" if unknown."""
        if self.interval is None or math.isnan(self.interval.low):
            return ""
        if self.interval.low > 0:
            return "better"
        return "as good" if self.interval.high >= 0 else "falls"


def without_oracles(configurations: Collection[str]) -> list[str]:
    """The configurations without those that :func:`with_oracle_ablation` added."""
    return [name for name in configurations if _step_before(name, configurations) is None]


def steps(scores: Scores) -> list[Step]:
    """The ablations of a run, each beginning with its configuration; empty for a run without ablation."""
    scored = {row.configuration: row for row in scores.overall()}
    found: list[Step] = []
    for name, row in scored.items():
        before = _step_before(name, scored)
        if before is not None:
            found.append(_step(scores, row, scored[before], name.removeprefix(f"{before}+")))
        elif any(f"{name}+{each.name}" in scored for each in REPLACEMENTS):
            found.append(Step(configuration=name, replaced=None, row=row))
    return found


def _step_before(name: str, configurations: Collection[str]) -> str | None:
    """The configuration of which this is the next step; None if it is no step."""
    before, _, replaced = name.rpartition("+")
    return before if before in configurations and replaced in {each.name for each in REPLACEMENTS} else None


def _step(scores: Scores, row: ScoreRow, before: ScoreRow, replaced: str) -> Step:
    units = pair(scores.frames_of(before.configuration), scores.frames_of(row.configuration)).units
    return Step(
        configuration=row.configuration,
        replaced=replaced,
        row=row,
        gained=row.frr - before.frr,
        interval=None if units is None else difference_interval(units),
    )
