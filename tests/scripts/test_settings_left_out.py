"""Weights that were fitted in other settings: who is fitted, how much each setting weighs, and the table."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.report.benchmark import BenchmarkMaterial
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.score.labelled_run import LabelledPerson
from scripts.measure import settings_left_out
from scripts.measure.settings_left_out import (
    METHODS,
    OF_SETTINGS,
    measure_settings,
    read_people,
    settings_table,
    weighing_the_same,
)
from tests.disk import write_text
from tests.experiments import experiment_of
from tests.harness.score.test_fit_logit import labelled_clips
from vfoa.logit import LogitWeights, default_weights

CONFIGURATIONS = {
    "posterior": {"attention.method": "bayes"},
    "posterior_both": {"attention.method": "bayes", "attention.smoothing": "both"},
}
CLIPS = {"office": "one", "heads": "two", "street": "three"}
"""The clip of each material; ``heads`` is of the office, too."""
MATERIALS = {
    name: BenchmarkMaterial(title=name, setting="street" if name == "street" else "office", experiment=name)
    for name in CLIPS
}

People = Mapping[str, Sequence[LabelledPerson]]


@pytest.fixture(scope="module")
def people(tmp_path_factory: pytest.TempPathFactory) -> People:
    """The people of three materials of two settings, as they are read from their runs."""
    folder = tmp_path_factory.mktemp("settings")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(settings_left_out, "OF_SETTINGS", MATERIALS)
        patch.setattr("harness.run.executors.cores", lambda: 1)
        labelled_clips(folder, tuple(CLIPS.values()), frames=12)
        for name, clip in CLIPS.items():
            path = write_text(folder / f"{name}.toml", experiment_of([clip], CONFIGURATIONS, preset="measured"))
            plan = prepare(load_experiment(str(path)))
            run_plan(plan, folder / "runs" / name, workers=1, progress=lambda clip: None)
        return read_people(Path("runs"))


@pytest.fixture(autouse=True)
def _these_materials(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(settings_left_out, "OF_SETTINGS", MATERIALS)


def _weight(people: Sequence[LabelledPerson]) -> float:
    return sum(person.labelled_s * person.sequence.weight for person in people)


def test_settings_weigh_the_same_and_as_much_together_as_before(people: People) -> None:
    weighed = weighing_the_same(people)
    of_street = [person for person in weighed if person.sequence.group == CLIPS["street"]]
    assert len(of_street) == 2
    assert _weight(of_street) == pytest.approx(_weight(weighed) / 2)
    assert _weight(weighed) == pytest.approx(sum(map(_weight, people.values())))


def test_a_setting_is_scored_with_weights_that_saw_none_of_its_labels(
    people: People, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Collection[str]] = []

    def fitted_to(of: Sequence[LabelledPerson]) -> LogitWeights:
        seen.append({str(person.sequence.group) for person in of})
        return default_weights()

    monkeypatch.setattr(settings_left_out, "fitted_to", fitted_to)
    rows = list(measure_settings(people))
    assert seen == [{"three"}, {"one", "two"}]
    assert {(row.material, row.smoothing) for row in rows} == {
        (name, smoothing) for name in CLIPS for smoothing in ("forward", "both")
    }
    assert all(row.scores["fitted"].log_loss == row.scores["logit"].log_loss for row in rows)


def test_the_means_weigh_settings_and_not_materials(people: People) -> None:
    rows = list(measure_settings(people))
    table = settings_table(rows)
    assert [row[:2] for row in table.rows] == [
        *((name, smoothing) for name in CLIPS for smoothing in ("forward", "both")),
        ("(mean over settings)", ""),
    ]
    for method in METHODS:
        column = table.columns.index(f"{method} log loss")
        *losses, mean = (float(row[column]) for row in table.rows)
        assert mean == pytest.approx(np.mean([np.mean(losses[:4]), np.mean(losses[4:])]), abs=0.002)
    assert rows[0].scores["posterior"].n == len(people["office"][0].labelled) * 2


def test_the_settings_are_those_of_the_benchmark_and_heads_alone() -> None:
    drawn, heads = OF_SETTINGS["drawn"], OF_SETTINGS["drawn_heads"]
    assert replace(heads, title=drawn.title, settings=()) == drawn
