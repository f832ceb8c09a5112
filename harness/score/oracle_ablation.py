"""The oracle ablation: the ground truth replaces one stage after another, to see how many points of FRR each costs.

Scoring a run imports none of its stages: only an experiment with steps does.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from harness.clips.manifest import load_manifest
from harness.run.notes import Note
from harness.score.intervals import difference_interval, pair
from harness.score.rows import ScoreRow
from harness.score.score import Scores
from harness.score.statistics import NO_INTERVAL, Interval
from harness.sources import Truth
from vfoa.errors import VfoaError

if TYPE_CHECKING:
    from harness.pipeline.configuration import Configuration
    from harness.run.experiment import Experiment

_TRUTH = "truth"


def _all_people(truth: Truth, attribute: str) -> bool:
    return truth.people is not None and all(getattr(person, attribute) is not None for person in truth.people)


REPLACEMENTS: Mapping[str, tuple[str, Callable[[Truth], bool]]] = {
    "disparity": ("stereo", lambda truth: truth.disparity is not None),
    "instances": ("segmentation", lambda truth: truth.instances is not None),
    "heads": ("heads", lambda truth: truth.people is not None),
    "head_pose": ("head_pose", lambda truth: _all_people(truth, "head_direction")),
    "gaze": ("gaze", lambda truth: _all_people(truth, "gaze_direction")),
}
"""What the ground truth can replace, in the order of the pipeline: its stage, and whether a frame has it."""


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
    configurations = [
        configuration for base in experiment.configurations for configuration in (base, *_steps_of(base, replacements))
    ]
    if len(configurations) == len(experiment.configurations):
        raise VfoaError(
            f"{experiment.name}: --oracle: found no stage that the ground truth can replace: "
            f"{'; '.join(notes) or 'all are the ground truth'}"
        )
    return replace(experiment, configurations=tuple(configurations), notes=(*experiment.notes, *map(Note, notes)))


def _known_replacements(clips: tuple[str, ...]) -> tuple[list[str], list[str]]:
    replacements, notes = list(REPLACEMENTS), []
    for name in clips:
        clip = load_manifest(name).open()
        truth = clip.truth(clip.frames[0])
        missing = [replaced for replaced, (_, is_known) in REPLACEMENTS.items() if not is_known(truth)]
        if missing:
            notes.append(f"Oracle ablation: {name} has no true {', '.join(missing)}; these stages are not replaced.")
        replacements = [replaced for replaced in replacements if replaced not in missing]
    return replacements, notes


def _steps_of(base: Configuration, replacements: list[str]) -> Iterator[Configuration]:
    from harness.pipeline.configuration import StageChoice
    from harness.pipeline.ground_truth import OracleSettings

    current = base
    for replaced in replacements:
        slot, _ = REPLACEMENTS[replaced]
        choice = current.choices[slot]
        if choice is None or (choice.name == _TRUTH and getattr(choice.settings, "every", 1) == 1):
            continue
        truth = StageChoice(slot=slot, name=_TRUTH, settings=OracleSettings())
        current = replace(current, name=f"{current.name}+{replaced}", choices={**current.choices, slot: truth})
        yield current


@dataclass(frozen=True, slots=True, kw_only=True)
class AblationStep:
    """A step that was scored on all clips together.

    ``gained`` is the FRR minus that of the step before, ``interval`` its 95 % interval by clips or looks. All three are
    None for the first step. ``is_identical``: both are right on the same frames; the interval is not known then.
    """

    configuration: str
    replaced: str | None
    row: ScoreRow
    gained: float | None = None
    interval: Interval | None = None
    is_identical: bool = False

    @property
    def reads(self) -> str:
        """Whether the step is better than the one before, as good within the interval, or worse; "" if unknown."""
        if self.is_identical:
            return "identical"
        if self.interval is None or math.isnan(self.interval.low):
            return ""
        if self.interval.low > 0:
            return "better"
        return "as good" if self.interval.high >= 0 else "falls"


def without_oracles(configurations: Collection[str]) -> list[str]:
    """The configurations without those that :func:`with_oracle_ablation` added."""
    return [name for name in configurations if _step_before(name, configurations) is None]


def steps(scores: Scores) -> list[AblationStep]:
    """The ablations of a run, each beginning with its configuration; empty for a run without ablation."""
    scored = {row.configuration: row for row in scores.rows.overall}
    ablation: list[AblationStep] = []
    for name, row in scored.items():
        before = _step_before(name, scored)
        if before is not None:
            pairs = pair(scores.frames_of(before), scores.frames_of(name))
            interval = None if pairs.units is None else difference_interval(pairs.units)
            ablation.append(
                AblationStep(
                    configuration=name,
                    replaced=name.removeprefix(f"{before}+"),
                    row=row,
                    gained=row.frr - scored[before].frr,
                    interval=NO_INTERVAL if pairs.is_identical else interval,
                    is_identical=pairs.is_identical,
                )
            )
        elif any(f"{name}+{replaced}" in scored for replaced in REPLACEMENTS):
            ablation.append(AblationStep(configuration=name, replaced=None, row=row))
    return ablation


def _step_before(name: str, configurations: Collection[str]) -> str | None:
    """The configuration of which this is the next step; None if it is no step."""
    before, _, replaced = name.rpartition("+")
    return before if before in configurations and replaced in REPLACEMENTS else None
