"""``attention.weights = "left-out"``: every clip gets weights that were fitted to the experiment's other clips."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from harness.run.directory import RunDirectory
from harness.run.experiment import Experiment
from harness.run.grid import base_of
from harness.score.fit_logit import fitted_to
from harness.score.labelled_run import read_features
from harness.stages.configuration import Configuration
from vfoa.errors import VfoaError
from vfoa.logit import LogitSettings, LogitWeights
from vfoa.nearest import NearestSettings


def with_left_out_weights(experiment: Experiment, run: Callable[[Experiment], RunDirectory]) -> Experiment:
    """Return the experiment with weights wherever a configuration has ``"left-out"``.

    ``run`` runs an experiment: the clips under the stages of these configurations, which give the features. The seeds
    of a configuration are fitted together. A clip without labels gets weights fitted to all clips with labels.

    Raises
    ------
    VfoaError
        If fewer than two clips have labels.
    """
    wanted = {each.name: each for each in experiment.configurations if _is_left_out(each)}
    if not wanted:
        return experiment
    stages: dict[str, str] = {}  # the first configuration with the same stages, by base name
    alike: dict[str, str] = {}
    for each in wanted.values():
        base = base_of(each.name)
        stages.setdefault(base, alike.setdefault(_stages(each), base))
    used = [each for each in wanted.values() if base_of(each.name) in set(stages.values())]
    plain = tuple(
        replace(each, attend=each.attend.model_copy(update={"attention": NearestSettings(method="nearest")}))
        for each in used
    )
    directory = run(replace(experiment, configurations=plain, notes=(), published=None))
    found: dict[str, dict[str, LogitWeights]] = {}
    of_all: dict[str, LogitWeights] = {}
    for labelled in read_features(directory, dict.fromkeys(stages.values())):
        base, people = labelled.configuration, labelled.people
        clips = list(dict.fromkeys(str(person.sequence.group) for person in people))
        if len(clips) < 2:
            raise VfoaError(
                f'{experiment.name}: attention.weights = "left-out": labels of {", ".join(clips)} alone; expected two '
                "labelled clips or more"
            )
        smoothings = {_settings(each).smoothing for each in wanted.values() if stages[base_of(each.name)] == base}
        of_all[base] = fitted_to(people, sorted(smoothings))
        found[base] = {
            clip: fitted_to([each for each in people if each.sequence.group != clip], sorted(smoothings))
            for clip in clips
        }
    filled = {
        name: replace(
            each,
            attend=each.attend.model_copy(
                update={
                    "attention": _settings(each).model_copy(
                        update={"weights": of_all[stages[base_of(name)]], "by_clip": found[stages[base_of(name)]]}
                    )
                }
            ),
        )
        for name, each in wanted.items()
    }
    return replace(experiment, configurations=tuple(filled.get(each.name, each) for each in experiment.configurations))


def _is_left_out(configuration: Configuration) -> bool:
    attention = configuration.attend.attention
    return isinstance(attention, LogitSettings) and attention.weights == "left-out"


def _settings(configuration: Configuration) -> LogitSettings:
    attention = configuration.attend.attention
    if not isinstance(attention, LogitSettings):
        raise TypeError(f"expected the settings of a logit, found {attention!r}")
    return attention


def _stages(configuration: Configuration) -> str:
    """A text that is the same for configurations that differ in attention alone."""
    plain = {key: value for key, value in configuration.plain().items() if key != "attention"}
    return repr(plain)
