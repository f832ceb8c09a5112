from __future__ import annotations

import pytest

from harness.scores.comparison import compare, format_p
from harness.scores.reference import Reference
from harness.scores.score import Scores, score
from harness.scores.verdicts import Verdict
from tests.records import answers, labels

PAPER = {"BM, 1 cone": 28, "SGBM, 1 cone": 35, "BM, 2 cones": 31, "SGBM, 2 cones": 38}


def _scores(correct: dict[str, int], n: int = 50) -> Scores:
    """Configurations that are right in the first frames, so that each differs from the next in as few as it can."""
    records = [
        record
        for name, right in correct.items()
        for record in answers(["bird"] * right + ["cup"] * (n - right), configuration=name)
    ]
    return score(records, Reference(labels={"clip": labels(*["bird"] * n)}))


def _verdicts(*correct: bool | None) -> list[Verdict]:
    """Verdicts of frames 1, 2, ...; None: not scored."""
    outcomes = {True: "correct", False: "wrong", None: "unscored"}
    return [
        Verdict(
            clip="clip",
            configuration="",
            frame=frame,
            subject="girl",
            truth="cup",
            predicted="cup",
            outcome=outcomes[each],  # type: ignore[arg-type]
            cause=None,
        )
        for frame, each in enumerate(correct, start=1)
    ]


def test_the_papers_best_case_is_not_distinguishable() -> None:
    scores = _scores(PAPER)
    (found,) = compare({"1": scores.verdicts_of("BM, 1 cone"), "2 cones": scores.verdicts_of("BM, 2 cones")})
    assert (found.better, found.worse, found.n, found.p) == (3, 0, 50, 0.25)
    assert found.sentence == "2 cones vs 1: 3 frames better, 0 worse, p = 0.25: not distinguishable"
    (back,) = compare({"2 cones": scores.verdicts_of("BM, 2 cones"), "1": scores.verdicts_of("BM, 1 cone")})
    assert back.worse == 3
    assert not back.is_significant_drop


def test_several_comparisons_are_corrected_together() -> None:
    scores = _scores(PAPER)
    found = compare({name: scores.verdicts_of(name) for name in scores.configurations})
    assert len(found) == 6
    sgbm_two = next(each for each in found if each.reference == "BM, 1 cone" and each.configuration == "SGBM, 2 cones")
    assert sgbm_two.p == pytest.approx(2 * 0.5**10)
    assert sgbm_two.p_holm == pytest.approx(6 * sgbm_two.p)
    assert sgbm_two.sentence == (
        "SGBM, 2 cones vs BM, 1 cone: 10 frames better, 0 worse, p = 0.002 (p = 0.012 after Holm): significantly better"
    )


def test_a_significant_drop_is_said_so() -> None:
    scores = _scores({"new": 20, "old": 40})
    (found,) = compare({name: scores.verdicts_of(name) for name in ("old", "new")})
    assert found.is_significant_drop
    assert found.sentence.endswith("0 frames better, 20 worse, p < 0.001: significantly worse")
    (upward,) = compare({name: scores.verdicts_of(name) for name in ("new", "old")})
    assert upward.is_significant
    assert not upward.is_significant_drop


def test_only_frames_that_both_scored_are_compared() -> None:
    (found,) = compare({"a": _verdicts(True, False, None, False), "b": _verdicts(False, True, True)})
    assert (found.n, found.better, found.worse, found.p) == (2, 1, 1, 1.0)
    assert "1 frame better" in found.sentence


def test_without_common_frames_nothing_is_claimed() -> None:
    (found,) = compare({"a": _verdicts(None), "b": _verdicts(True)})
    assert (found.n, found.p, found.is_significant) == (0, 1.0, False)
    assert compare({"a": _verdicts(True)}) == ()


def test_p_values_for_people() -> None:
    shown = {1.0: "p = 1", 0.25: "p = 0.25", 0.0312: "p = 0.031", 0.001: "p = 0.001", 0.00099: "p < 0.001"}
    assert {p: format_p(p) for p in shown} == shown
