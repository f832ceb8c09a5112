"""Several seeds of a simulated error, from the experiment to the table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.pipeline.measures import FrameMeasures
from harness.report.stages import pooled_measures
from harness.report.tables import seeds_table
from harness.run.experiment import load_experiment
from harness.run.grid import base_of
from harness.run.manifest import AnswerTraits
from harness.run.records import FrameRecord
from harness.score.calibration import coverages, reliabilities, reliabilities_by_subject
from harness.score.comparison import compare
from harness.score.reference import Reference
from tests.disk import write_text
from tests.record_tables import measured
from tests.records import answers, labels, score
from vfoa.errors import VfoaError
from vfoa.types import DirectionFit

EXPERIMENT = """
clips = ["studio_table"]
seeds = 3

[defaults.segmentation]
model = "truth"

[defaults.heads]
detector = "truth"

[defaults.head_pose]
model = "{model}"

[defaults.gaze]
model = "{model}"

[grid]
"stereo.matcher" = ["bm", "sgbm"]
"""


def test_a_configuration_is_repeated_under_each_seed(tmp_path: Path) -> None:
    path = write_text(tmp_path / "seeds.toml", EXPERIMENT.format(model="simulated"))
    found = load_experiment(str(path), overrides=("gaze.seed=5",)).configurations
    assert [each.name for each in found] == [f"{name}.seed{seed}" for name in ("bm", "sgbm") for seed in (1, 2, 3)]
    seeds = [(each.plain()["gaze"]["seed"], each.plain()["head_pose"]["seed"]) for each in found[:3]]
    assert seeds == [(5, 1), (6, 2), (7, 3)]
    assert {str(each.choices["stereo"]) for each in found[:3]} == {str(found[0].choices["stereo"])}


def test_seeds_without_a_simulated_stage_are_refused(tmp_path: Path) -> None:
    path = write_text(tmp_path / "seeds.toml", EXPERIMENT.format(model="truth"))
    with pytest.raises(VfoaError, match=r"seeds\.toml: seeds: found 3, .*'bm'"):
        load_experiment(str(path))


def test_names_of_seeds_have_a_base() -> None:
    names = ("bm-two.seed12", "bm.seed1+disparity", "bm", "bm.seeds", "bm.seed1.5")
    assert [base_of(name) for name in names] == ["bm-two", "bm+disparity", "bm", "bm.seeds", "bm.seed1.5"]


def test_rows_are_means_over_seeds_and_looks_are_counted_once() -> None:
    rng = np.random.default_rng(2)
    truth = ["cup" if k // 50 % 2 else "can" for k in range(400)]
    said = {
        f"{name}.seed{seed}": [each if rng.random() < share else "jar" for each in truth]
        for name, share in (("good", 0.9), ("poor", 0.5))
        for seed in (1, 2, 3)
    }
    records = [r for name, each in said.items() for r in answers(each, configuration=name)]
    scores = score(records, Reference(labels={"clip": labels(*truth)}))
    assert [row.configuration for row in scores.rows.by_clip] == ["good", "poor"]
    good, poor = scores.rows.by_clip
    rates = [np.mean([a == b for a, b in zip(said[f"good.seed{seed}"], truth, strict=True)]) for seed in (1, 2, 3)]
    assert good.seed_rates == pytest.approx(rates)
    assert good.frr == pytest.approx(np.mean(rates))
    assert (good.looks, good.n) == (8, 1200)
    assert [row[1:3] for row in seeds_table(scores).rows] == [("good", "3"), ("poor", "3")]
    (found,) = compare({name: scores.frames_of(name) for name in scores.scored_configurations})
    assert (found.n, found.looks, found.verdict) == (400, 8, "worse")
    assert found.difference == pytest.approx(poor.frr - good.frr)


def test_checks_of_probabilities_and_of_stages_take_all_seeds_together() -> None:
    seeds = ("bayes.seed1", "bayes.seed2")
    reference = Reference(
        labels={"clip": labels("cup", "cup", "can")}, traits=dict.fromkeys(seeds, AnswerTraits(probabilistic=True))
    )
    said = zip(seeds, (["cup", "can", "can"], ["cup", "cup", "can"]), strict=True)
    records = [record for configuration, words in said for record in answers(words, configuration=configuration)]
    scores = score(map(fitted_and_measured, records), reference)
    (calibration,) = reliabilities(scores.judged_subjects)
    assert (calibration.configuration, calibration.n) == ("bayes", 6)
    assert calibration.share_right == pytest.approx(5 / 6)
    assert [(each.configuration, each.n) for *_, each in reliabilities_by_subject(scores.judged_subjects)] == [
        ("bayes", 6)
    ]
    assert [(each.configuration, each.n) for each in coverages(scores.judged_subjects)] == [("bayes", 6)]
    assert [(each.configuration, each.n) for each in scores.directions] == [("bayes", 6)]
    assert {key: found.frames for key, found in pooled_measures(scores.measures).items()} == {("clip", "bayes"): 6}


def fitted_and_measured(record: FrameRecord) -> FrameRecord:
    """The record with a fit of every subject and with empty measures."""
    fit = DirectionFit(tail=0.5, claimed_error_rad=0.2, implied_error_rad=0.2)
    subjects = tuple(replace(subject, fit=fit) for subject in record.subjects)
    return measured(replace(record, subjects=subjects), FrameMeasures(disparity=None, targets=(), people=()))


def test_runs_under_other_numbers_of_seeds_are_not_compared() -> None:
    records = [r for name in ("a.seed1", "a.seed2", "b") for r in answers(["cup"], configuration=name)]
    scores = score(records, Reference(labels={"clip": labels("cup")}))
    with pytest.raises(VfoaError, match="a and b: found runs under 2 and under 1 seeds"):
        compare({name: scores.frames_of(name) for name in scores.scored_configurations})
