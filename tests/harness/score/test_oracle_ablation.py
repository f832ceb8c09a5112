from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from harness.pipeline.configuration import StageChoice
from harness.pipeline.ground_truth import OracleSettings
from harness.report.stages import pooled_measures
from harness.report.write import rescore
from harness.run.columns import OF_DISPARITY, OF_PERSON, MeasureColumns
from harness.run.experiment import load_experiment
from harness.run.grid import ORACLE_STEPS
from harness.run.notes import Note
from harness.run.runner import prepare, run_plan
from harness.score.oracle_ablation import REPLACEMENTS, steps, with_oracle_ablation
from harness.score.reference import Reference
from harness.score.statistics import NO_INTERVAL
from harness.sources import PersonTruth, Truth
from tests.records import answers, labels, score
from vfoa.errors import VfoaError
from vfoa.types import Disparity, Float, Instances


def test_each_step_replaces_one_stage_more_and_leaves_the_rest() -> None:
    base = load_experiment("demo", clips=("studio_table",))
    ablated = with_oracle_ablation(base)
    climbed = [configuration for configuration in ablated.configurations if configuration.name.startswith("sgbm-one")]
    assert [each.name for each in climbed] == [
        "sgbm-one",
        "sgbm-one+disparity",
        "sgbm-one+disparity+head_pose",
        "sgbm-one+disparity+head_pose+gaze",
    ]
    true_stages = [
        {slot for slot, choice in each.choices.items() if choice and choice.name == "truth"} for each in climbed
    ]
    assert all(len(upper - lower) == 1 and lower < upper for lower, upper in pairwise(true_stages))
    assert true_stages[-1] == set(climbed[-1].choices)
    assert {str(each.attend) for each in climbed} == {str(climbed[0].attend)}
    assert [configuration for configuration in ablated.configurations if "+" not in configuration.name] == list(
        base.configurations
    )


def test_the_names_of_steps_are_those_that_no_configuration_has_beside_another() -> None:
    assert tuple(REPLACEMENTS) == ORACLE_STEPS


def test_a_ladder_with_nothing_to_replace_is_an_error(tmp_path: Path) -> None:
    file = tmp_path / "true.toml"
    file.write_text(
        'clips = ["studio_table"]\n[defaults]\nstereo.matcher = "truth"\nsegmentation.model = "truth"\n'
        'heads.detector = "truth"\nhead_pose.model = "none"\ngaze.model = "truth"\n'
    )
    with pytest.raises(VfoaError, match="no stage that the ground truth can replace"):
        with_oracle_ablation(load_experiment(str(file)))


PERSON = PersonTruth(
    name="anna",
    instance_id=1,
    head_box_px=np.zeros(4),
    eye_origin_left=np.zeros(3),
    head_direction=np.array([0.0, 0, 1]),
    gaze_direction=np.array([0.0, 0, 1]),
)
DISPARITY = Disparity(disparity_px=np.ones((2, 2), np.float32))
INSTANCES = Instances(ids=np.zeros((2, 2), np.uint16), instances=())
NO_HEAD, NO_GAZE = replace(PERSON, head_direction=None), replace(PERSON, gaze_direction=None)
TRUTHS = {
    "all": Truth(disparity=DISPARITY, instances=INSTANCES, people=(PERSON,)),
    "depths": Truth(disparity=DISPARITY),
    "masks": Truth(instances=INSTANCES),
    "some heads": Truth(disparity=DISPARITY, instances=INSTANCES, people=(PERSON, NO_HEAD)),
    "some gazes": Truth(disparity=DISPARITY, instances=INSTANCES, people=(NO_GAZE, PERSON)),
}
"""The true data that a clip knows, by the clip's name."""


@pytest.mark.parametrize(
    ("clips", "unknown"),
    [
        (["all"], [set()]),
        (["depths"], [{"instances", "heads", "head_pose", "gaze"}]),
        (["masks"], [{"disparity", "heads", "head_pose", "gaze"}]),
        (["some heads"], [{"head_pose"}]),
        (["some gazes"], [{"gaze"}]),
        (["some heads", "all", "some gazes"], [{"head_pose"}, set(), {"gaze"}]),
    ],
)
def test_what_a_clip_does_not_know_is_not_replaced_and_said(
    monkeypatch: pytest.MonkeyPatch, clips: list[str], unknown: list[set[str]]
) -> None:
    def manifest(name: str) -> Any:
        clip = SimpleNamespace(frames=(7, 8), truth=lambda frame: TRUTHS[name] if frame == 7 else Truth())
        return SimpleNamespace(open=lambda: clip)

    monkeypatch.setattr("harness.score.oracle_ablation.load_manifest", manifest)
    base = load_experiment("demo", clips=("studio_table",))
    choices = {
        slot: StageChoice(slot=slot, name="any", settings=OracleSettings()) for slot in base.configurations[0].choices
    }
    only = replace(base.configurations[0], name="base", choices=choices)
    ablated = with_oracle_ablation(replace(base, clips=tuple(clips), configurations=(only,), notes=(Note("mine"),)))
    names = ["disparity", "instances", "heads", "head_pose", "gaze"]
    known = [each for each in names if each not in set().union(*unknown)]
    assert [configuration.name for configuration in ablated.configurations] == [
        "+".join(["base", *known[:count]]) for count in range(len(known) + 1)
    ]
    expected = [
        f"Oracle ablation: {clip} has no true {', '.join(each for each in names if each in missing)}; "
        "these stages are not replaced."
        for clip, missing in zip(clips, unknown, strict=True)
        if missing
    ]
    assert [note.text for note in ablated.notes] == ["mine", *expected]


def test_a_step_is_of_all_clips_together() -> None:
    said = {"bm": ["none", "cup"], "bm+gaze": ["cup", "cup"]}
    records = [r for clip in "cd" for name, each in said.items() for r in answers(each, clip=clip, configuration=name)]
    found = steps(score(records, Reference(labels=dict.fromkeys("cd", labels("cup", "cup")))))
    assert [(each.row.clip, each.row.n, each.row.frr, each.gained) for each in found] == [
        (None, 4, 0.5, None),
        (None, 4, 1, 0.5),
    ]


def test_points_are_the_difference_to_the_step_below() -> None:
    found = {"bm": ["none", "none", "none", "cup"], "bm+disparity": ["cup", "none", "none", "cup"]}
    records = [record for name, said in found.items() for record in answers(said, clip="c", configuration=name)]
    below, above = steps(score(records, Reference(labels={"c": labels(*["cup"] * 4)})))
    assert (below.replaced, below.gained) == (None, None)
    assert above.replaced == "disparity"
    assert above.gained == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("wrong_below", "wrong_above", "reads"),
    [
        (60, 0, "better"),
        (0, 60, "falls"),
        (20, 34, "falls"),
        (5, 5, "as good"),
    ],
)
def test_a_step_is_read_by_the_interval_of_its_own_difference(wrong_below: int, wrong_above: int, reads: str) -> None:
    """Ten looks of 100 frames."""
    found = {"bm": wrong_below, "bm+gaze": wrong_above}
    looks = ["can" if i // 100 % 2 else "cup" for i in range(1000)]
    said = {
        name: ["none" if i % 100 < wrong + (i // 100 + first) % 2 else look for i, look in enumerate(looks)]
        for first, (name, wrong) in enumerate(found.items())
    }
    records = [record for name, each in said.items() for record in answers(each, clip="c", configuration=name)]
    below, above = steps(score(records, Reference(labels={"c": labels(*looks)})))
    assert (below.reads, above.reads) == ("", reads)
    assert above.interval is not None
    assert above.gained is not None
    assert above.interval.low - 1e-9 <= above.gained <= above.interval.high + 1e-9


def test_a_step_that_changes_no_frame_is_identical_and_has_no_interval() -> None:
    records = [
        record
        for name in ("bm", "bm+gaze")
        for record in answers(["cup", "none", "cup", "none"], clip="c", configuration=name)
    ]
    _, above = steps(score(records, Reference(labels={"c": labels(*["cup"] * 4)})))
    assert (above.reads, above.gained, above.interval) == ("identical", 0, NO_INTERVAL)


def test_a_run_without_steps_has_no_ablation() -> None:
    assert steps(score(answers(["cup"], clip="c", configuration="a+b"), Reference(labels={"c": labels("cup")}))) == []


def test_on_a_rendered_clip_no_step_falls_and_the_truth_is_all_right(tmp_path: Path) -> None:
    """End to end: frames, steps, scores, stage measures, tables."""
    experiment = load_experiment("demo", clips=("studio_table",), overrides=("stereo.matcher=sgbm",))
    only = replace(experiment, configurations=tuple(c for c in experiment.configurations if c.name == "sgbm-two"))
    plan = prepare(with_oracle_ablation(only), limit=6)
    directory = run_plan(plan, tmp_path / "run", workers=1, progress=lambda clip: None)
    scores = rescore(directory)
    climbed = steps(scores)
    assert [step.replaced for step in climbed] == [None, "disparity", "head_pose", "gaze"]
    assert "falls" not in [step.reads for step in climbed]
    assert climbed[-1].row.frr == 1
    measured = {name: found for (_, name), found in pooled_measures(scores.measures).items()}
    wrong = {
        what: [bool((np.nan_to_num(of(measured[step.configuration])) > 0).any()) for step in climbed]
        for what, of in _ERRORS.items()
    }
    assert wrong == {
        "disparity": [True, False, False, False],
        "head pose": [True, True, False, False],
        "gaze": [True, True, True, False],
    }
    assert {"oracle_ablation.csv", "measures.csv", "objects.csv"} <= {path.name for path in directory.path.iterdir()}


_ERRORS: dict[str, Callable[[MeasureColumns], Float]] = {
    "disparity": lambda found: found.disparities[:, OF_DISPARITY.index("error_px")],
    "head pose": lambda found: found.people[:, OF_PERSON.index("head_error_deg")],
    "gaze": lambda found: found.people[:, OF_PERSON.index("gaze_error_deg")],
}
