"""The weights of the logit that ship with vfoa: fitted on several settings at once, and scored on each when left out.

``python -m scripts.ship_logit people=RUN conversation=RUN drawn=RUN rendered=RUN`` writes vfoa/logit.toml and prints
its scores. The runs of clips with images have ``attention.method = "logit"`` or ``"bayes"``, which keep clouds, and the
others any method; of configurations with the same stages the first one counts:

people        ``vfoa run people``
conversation  ``vfoa run conversation`` with labels of the first half alone
drawn         ``vfoa run drawn`` in two folders of :mod:`scripts.drawn_clips`, one of each generator: two runs joined by
              a comma
rendered      the clips of ``bayes_tune`` and of ``filter`` with the stages of ``bayes_tune``, and a gaze error of 11.1
              and of 20 degrees; the clips of ``bayes`` stay for reports

Every setting weighs the same, and each case (gaze and head, one of them alone) is fitted by itself: of people with both
directions the cases of one direction see that one alone.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import vfoa
from harness.files.io import atomic_write
from harness.report.fit import fitted_text
from harness.run.directory import RunDirectory
from harness.run.fitted import FitRecord, FittedWeights, MethodScore
from harness.score.fit_logit import answers, is_on_target, score
from harness.score.labelled_run import LabelledPerson, read_features
from vfoa.logit import Cases, LogitSettings, LogitWeights, Weights
from vfoa.logit_cues import ROWS, Case
from vfoa.logit_fit import (
    CONSTANT_SPREAD,
    CUE_SPREADS,
    SIZE_SPREAD,
    SMOOTHINGS,
    UNKNOWN,
    Design,
    Smoothing,
    design_of,
    joined,
    maximised,
)

CARRIED = 0.1
"""Factor of the prior's spreads of all cues but the posterior: what a direction says of a target differs between
settings, and the posterior's answer less so."""
SPREAD = 2.0
"""Spread of the constant in a setting that nobody labelled."""
POOLED = 0.5
"""Share of the posterior in a setting that nobody labelled: equal shares, since four settings tell no better ones."""
HEAD = """# The weights that ship with vfoa, as `python -m scripts.ship_logit` wrote them: fitted on several settings
# at once, each of the same weight. held_out: scores on each setting with weights fitted on the others alone.
"""

Settings = Mapping[str, Sequence[LabelledPerson]]
Designs = dict[tuple[Case, Smoothing], Design]


def main(words: Sequence[str]) -> None:
    """Fit, score, write."""
    runs = dict(word.split("=", 1) for word in words)
    settings = {name: list(_people(paths.split(","))) for name, paths in runs.items()}
    everyone = [person for people in settings.values() for person in people]
    designs = {name: _designs(people) for name, people in settings.items()}
    held_out = tuple(_left_out(settings, designs))
    record = FitRecord(
        experiment=", ".join(settings),
        configuration="one of each setting",
        clips=tuple(dict.fromkeys(str(person.sequence.group) for person in everyone)),
        people=len(everyone),
        labelled_s=round(sum(person.labelled_s for person in everyone), 1),
        seeds=1,
        version=vfoa.__version__,
        held_out=held_out,
        curve=(),
    )
    attention = LogitSettings(method="logit", weights=_fitted(list(designs.values())))
    text = fitted_text(FittedWeights(fit=record, attention=attention)).partition("\n")[2]
    atomic_write(Path(vfoa.__file__).with_name("logit.toml"), HEAD + text)
    for each in held_out:
        print(f"{each.method:<48} n {each.n:6} log loss {each.log_loss:.3f} ECE {each.calibration_error:.3f}")  # noqa: T201


def _people(paths: Sequence[str]) -> Iterator[LabelledPerson]:
    """Yield everyone of the runs, once for each configuration with stages of its own."""
    for path in paths:
        directory = RunDirectory(Path(path))
        stages: dict[str, str] = {}
        for name, plain in directory.read_manifest().configurations.items():
            stages.setdefault(repr({key: value for key, value in plain.items() if key != "attention"}), name)
        for run in read_features(directory, tuple(stages.values()), cases=tuple(ROWS)):
            yield from run.people


def _designs(people: Sequence[LabelledPerson]) -> Designs:
    """The frames of a setting by case and smoothing, of the same total weight in every setting."""
    found = {}
    for case, smoothing in itertools.product(ROWS, SMOOTHINGS):
        design = joined([design_of(case, smoothing == "both", person.sequence) for person in people])
        total = design.weight[design.looked != UNKNOWN].sum()
        if total > 0:
            found[case, smoothing] = replace(design, weight=design.weight * (1000 / total))
    return found


def _fitted(settings: Sequence[Designs]) -> LogitWeights:
    """Weights fitted on the frames of all these settings."""
    cases: dict[Smoothing, dict[Case, Weights]] = {smoothing: {} for smoothing in SMOOTHINGS}
    for case, smoothing in itertools.product(ROWS, SMOOTHINGS):
        scales = 3 if smoothing == "both" else 2
        carried = [CUE_SPREADS[row] * (1.0 if row == max(ROWS[case]) else CARRIED) for row in ROWS[case]]
        spreads = np.array([CONSTANT_SPREAD, SIZE_SPREAD, *np.repeat(carried, scales)])
        design = joined([each[case, smoothing] for each in settings if (case, smoothing) in each])
        vector = maximised(design, spreads**-2.0).round(4).tolist()
        cases[smoothing][case] = Weights.of(case, vector).model_copy(update={"spread": SPREAD, "pooled": POOLED})
    return LogitWeights(**{smoothing: Cases(**of_each) for smoothing, of_each in cases.items()})


def _left_out(settings: Settings, designs: Mapping[str, Designs]) -> Iterator[MethodScore]:
    """Yield the score on each setting, and each case of it, of weights fitted on all others."""
    for name, people in settings.items():
        weights = _fitted([of_other for other, of_other in designs.items() if other != name])
        for case in ROWS:
            chosen = _distinct(each for person in people if (each := _with(person, case)).labelled)
            for smoothing in SMOOTHINGS if chosen else ():
                outcomes = np.concatenate([answers(person, weights, smoothing) for person in chosen])
                targets = np.concatenate([is_on_target(person) for person in chosen])
                yield score(f"{name} left out, {case}, {smoothing}", outcomes, targets)


def _distinct(people: Iterable[LabelledPerson]) -> list[LabelledPerson]:
    """Everyone once: runs of several gaze errors have the same heads."""
    found: dict[tuple[object, ...], LabelledPerson] = {}
    for person in people:
        frames = b"".join(seen.now.tobytes() for seen in person.sequence.seen)
        found.setdefault((person.sequence.group, frames), person)
    return list(found.values())


def _with(person: LabelledPerson, case: Case) -> LabelledPerson:
    """A person in the frames of a case alone."""
    sequence = person.sequence
    shown = sequence.alone.get(case, sequence.seen)
    kept = [k for k, seen in enumerate(shown) if seen is not None and seen.case == case]
    return replace(
        person,
        sequence=replace(
            sequence,
            times_s=[sequence.times_s[k] for k in kept],
            seen=[shown[k] for k in kept],
            targets=[sequence.targets[k] for k in kept],
            alone={},
        ),
    )


if __name__ == "__main__":
    main(sys.argv[1:])
