from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from harness.experiment import load_experiment
from harness.ladder import steps, with_ladder
from harness.score import score
from tests.records import answers, labels
from vfoa.errors import VfoaError


def test_each_rung_replaces_one_stage_more_and_leaves_the_rest() -> None:
    base = load_experiment("demo", clips=("studio_table",))
    ladder = with_ladder(base)
    climbed = [each for each in ladder.configurations if each.name.startswith("sgbm-one")]
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
    assert [each for each in ladder.configurations if "+" not in each.name] == list(base.configurations)


def test_a_ladder_with_nothing_to_replace_is_an_error(tmp_path: Path) -> None:
    file = tmp_path / "true.toml"
    file.write_text(
        'clips = ["studio_table"]\n[defaults]\nstereo.matcher = "truth"\nsegmentation.model = "truth"\n'
        'heads.detector = "truth"\nhead_pose.model = "none"\ngaze.model = "truth"\n'
    )
    with pytest.raises(VfoaError, match="no stage that truth could replace"):
        with_ladder(load_experiment(str(file)))


def test_points_are_the_difference_to_the_rung_below() -> None:
    found = {"bm": ["none", "none", "none", "cup"], "bm+disparity": ["cup", "none", "none", "cup"]}
    records = [record for name, said in found.items() for record in answers(said, clip="c", configuration=name)]
    below, above = steps(score(records, {"c": labels(*["cup"] * 4)}))
    assert (below.replaced, below.gained) == (None, None)
    assert above.replaced == "disparity"
    assert above.gained == pytest.approx(0.25)


def test_a_run_without_rungs_has_no_ladder() -> None:
    assert steps(score(answers(["cup"], clip="c", configuration="a+b"), {"c": labels("cup")})) == []
