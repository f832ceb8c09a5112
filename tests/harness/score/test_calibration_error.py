"""What probabilities are worth: calibration of drawn ones, the smallest sets with 90 %, and the fit of directions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.labels.labels import Label, LabelRange, Labels
from harness.report.tables import reliability_table
from harness.run.manifest import AnswerTraits
from harness.run.records import AttentionRecord, BoxPx, FrameRecord, SubjectRecord, TargetRecord
from harness.score.calibration import (
    DirectionCheck,
    adaptive_error,
    coverages,
    misfit_notes,
    reliabilities,
    reliability,
)
from harness.score.reference import Reference
from harness.score.score import Scores
from harness.score.verdicts import prediction_set
from tests.records import frame_record, score, subject_record, target_record
from vfoa.types import DirectionFit


def frame(number, totals, focus, configuration="bayes", missing=None):
    targets = (target_record(1, "cup"), target_record(2, "book"))
    subject = subject_record("anna", totals=totals, focus=focus, missing=missing)
    return frame_record(targets, [subject], frame=number, configuration=configuration)


def scored(records, truth, *probabilistic) -> Scores:
    return score(
        records, Reference(labels=truth, traits=dict.fromkeys(probabilistic, AnswerTraits(probabilistic=True)))
    )


def labels(*targets):
    rows = [
        LabelRange(first_frame=number, last_frame=number, subject="anna", label=Label(target=target))
        for number, target in enumerate(targets, start=1)
    ]
    return {"clip": Labels(rows)}


def test_frames_that_are_right_as_often_as_they_say_are_calibrated():
    rng = np.random.default_rng(0)
    confidence = rng.uniform(0.1, 1, 40_000)
    right = rng.random(40_000) < confidence
    found = reliability("honest", np.stack([confidence, right, np.zeros(40_000)], axis=1))
    assert found.calibration_error < 0.02
    assert found.mean_confidence == pytest.approx(found.share_right, abs=0.01)


def test_the_error_is_the_distance_of_each_bin_by_its_weight():
    """Three frames at 0.9 of which one is right, one at 0.5 that is right: (3 |1/3 - 0.9| + |1 - 0.5|) / 4."""
    frames = np.array([[0.91, 1, 0], [0.9, 0, 0], [0.89, 0, 0], [0.5, 1, 0]])
    frames[:3, 0] = 0.95, 0.92, 0.98
    found = reliability("sure", frames)
    assert found.calibration_error == pytest.approx((3 * abs(1 / 3 - 0.95) + 0.5) / 4)


def test_briers_score_counts_every_target_and_nowhere():
    truth = labels("cup", "none", "ignore", "cup")
    records = [
        frame(1, {1: 0.5, 2: 0.3}, 1),
        frame(2, {1: 0.5, 2: 0.3}, 1),
        frame(3, {1: 1.0, 2: 0.0}, 1),
        frame(4, {}, None, missing="no_direction"),
        frame(1, {1: 0.5, 2: 0.3}, 1, configuration="cones"),
    ]
    (found,) = reliabilities(scored(records, truth, "bayes").judged_subjects)
    assert found.n == 2
    assert found.brier == pytest.approx(((0.25 + 0.09 + 0.04) + (0.64 + 0.25 + 0.09)) / 2)
    assert (found.share_right, found.mean_confidence) == (0.5, 0.5)


def test_a_run_without_probabilities_has_no_calibration():
    assert reliabilities(scored([frame(1, {1: 0.5}, 1)], labels("cup")).judged_subjects) == []


def test_the_table_has_rate_confidence_and_both_errors():
    found = [reliability("bayes", np.array([[0.7, 1, 0.1], [0.8, 0, 0.5]]))]
    assert reliability_table(found).rows == (("bayes", "2", "50.0", "75.0", "0.550", "–", "0.550", "0.300"),)


def test_confidences_fall_into_tenths_of_which_the_last_holds_certainty():
    confidence = np.array([0.0, 0.09, 0.1, 0.55, 0.9, 0.99, 1.0])
    right = np.array([0, 1, 1, 0, 1, 1, 1])
    found = reliability("sure", np.stack([confidence, right, right], axis=1))
    assert found.counts.tolist() == [2, 1, 0, 0, 0, 1, 0, 0, 0, 3]
    np.testing.assert_allclose(found.accuracy[[0, 1, 5, 9]], [0.5, 1, 0, 1])


def test_a_target_that_the_frame_has_not_was_given_no_probability():
    (found,) = reliabilities(scored([frame(1, {1: 0.5, 2: 0.3}, 1)], labels("vase"), "bayes").judged_subjects)
    assert found.brier == pytest.approx(1 + 0.25 + 0.09 + 0.04)
    assert (found.share_right, found.mean_confidence) == (0, 0.5)


def test_clips_without_labels_and_configurations_without_frames_have_no_calibration():
    frames = [frame(number, {1: 0.5, 2: 0.3}, 1) for number in (1, 2, 3)]
    free = frame_record(
        [target_record(1, "cup")], [subject_record("anna", focus=1)], clip="free", configuration="bayes"
    )
    truth = labels("cup", "cup", "none")
    (found,) = reliabilities(scored([*frames, free], truth, "bayes", "idle").judged_subjects)
    assert (found.configuration, found.n) == ("bayes", 3)
    assert found.share_right == pytest.approx(2 / 3)


def test_adaptive_bins_hold_as_many_frames_each() -> None:
    """A hundred distinct confidences, ten to a bin: the error is that of a plain loop over sorted tens."""
    rng = np.random.default_rng(4)
    confidence, right = 0.9 + 0.1 * rng.random(100), (rng.random(100) < 0.8).astype(float)
    order = np.argsort(confidence)
    tens = [order[k : k + 10] for k in range(0, 100, 10)]
    expected = sum(abs(float((confidence[each] - right[each]).sum())) for each in tens) / 100
    assert adaptive_error(confidence, right) == pytest.approx(expected)


def test_the_interval_of_the_error_needs_six_clips_and_holds_it() -> None:
    rng = np.random.default_rng(5)
    clips = np.repeat(np.arange(8), 50)
    confidence = rng.uniform(0.5, 1.0, 400)
    right = rng.random(400) < confidence - 0.15
    frames = np.stack([confidence, right, np.zeros(400)], axis=1)
    found = reliability("bayes", frames, clips)
    assert found.interval.low < found.calibration_error < found.interval.high
    assert np.isnan(reliability("bayes", frames, clips % 5).interval.low)


@pytest.mark.parametrize("excess", [0.0, 0.05, 0.2])
def test_the_interval_of_the_error_holds_it_as_often_as_it_says(excess: float) -> None:
    """Looks of twenty frames that are right or wrong together; percentiles hold no error in none of 100 cases."""
    rng, experiments, held = np.random.default_rng(6), 60, 0
    for _ in range(experiments):
        confidence = rng.uniform(0.3, 1.0, 200)
        right = rng.random(200) < confidence - excess
        frames = np.stack([confidence, right, np.zeros(200)], axis=1).repeat(20, axis=0)
        found = reliability("bayes", frames, np.repeat(np.arange(10), 400)).interval
        held += found.low <= excess <= found.high
    assert held / experiments > 0.86  # 95 % less three standard errors


FIT = DirectionFit(tail=0.5, claimed_error_rad=0.2, implied_error_rad=0.2)


def _subject(*totals: float, fit: DirectionFit | None = FIT) -> SubjectRecord:
    """Ann, who looks at instances 1, 2, ... with these probabilities, and elsewhere with the rest."""
    return SubjectRecord(
        track_id=1, name="ann", instance_id=9, head_box_px=None, eye_origin_m=(0.0, 0.0, 0.0), gaze=None,
        gaze_sigma_rad=None, head=None, missing=None, focus=1, tied=(), fit=fit,
        attention=tuple(
            AttentionRecord(instance_id=number, gaze=None, head=total, total=total)
            for number, total in enumerate(totals, start=1)
        ),
    )  # fmt: skip


def _record(frame: int, subject: SubjectRecord) -> FrameRecord:
    targets = tuple(
        TargetRecord(instance_id=n, name=name, label=name, score=1.0, box_px=None, points=0, box=None)
        for n, name in ((1, "cup"), (2, "book"))
    )
    return FrameRecord(clip="c", configuration="p", frame=frame, time_ns=frame, targets=targets, subjects=(subject,))


def test_the_likeliest_come_first_and_nowhere_is_one_of_them() -> None:
    assert prediction_set(_subject(0.1, 0.85)) == (2, 1)
    assert prediction_set(_subject(0.05, 0.92)) == (2,)
    assert prediction_set(_subject(0.2, 0.05)) == (None, 1)
    assert prediction_set(_subject(0.5, 0.5)) == (1, 2)
    assert prediction_set(_subject(0.9, 0.1, fit=None)) == (1,)  # a method without a fit has sets, too
    assert prediction_set(_subject()) == ()
    assert prediction_set(_subject(0.5)) == (1, None)  # nowhere comes after what is as likely
    equal = _subject(0.5, 0.5)
    assert prediction_set(replace(equal, attention=equal.attention[::-1])) == (1, 2)


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8).filter(lambda found: sum(found) > 0))
def test_no_smaller_set_has_as_much(weights: list[float]) -> None:
    totals = [weight / sum(weights) * 0.97 for weight in weights]
    held = prediction_set(_subject(*totals))
    probability = dict(enumerate(totals, start=1)) | {None: 1 - sum(totals)}
    assert sum(probability[key] for key in held) >= 0.9 - 1e-6
    assert sum(sorted(probability.values(), reverse=True)[: len(held) - 1]) < 0.9 + 1e-6


def test_coverage_and_size_are_over_the_scored_frames() -> None:
    truth = Labels(
        LabelRange(first_frame=frame, last_frame=frame, subject="ann", label=Label(target=target))
        for frame, target in ((1, "cup"), (2, "none"), (3, "ignore"), (4, "book"))
    )
    records = [_record(1, _subject(0.95, 0.05)), _record(2, _subject(0.3, 0.1)), _record(3, _subject(0.0, 1.0)),
               _record(4, _subject(0.95, 0.05))]  # fmt: skip
    assert (
        coverages(scored(records, {"c": truth}).judged_subjects) == []
    )  # attention that is no probability has no sets
    (found,) = coverages(scored(records, {"c": truth}, "p").judged_subjects)
    assert (found.configuration, found.n, found.covered, found.mean_size) == ("p", 3, 2, 4 / 3)


def test_the_probability_of_a_name_is_that_of_all_its_objects() -> None:
    """Any cup is right. Where the label's point says which cup is meant, another one is another answer."""
    boxes_px: dict[int, BoxPx] = {1: (0.0, 0.0, 10.0, 10.0), 2: (50.0, 0.0, 60.0, 10.0), 3: (90.0, 0.0, 95.0, 5.0)}
    targets = [target_record(n, "cup" if n < 3 else "book", box_px=box_px) for n, box_px in boxes_px.items()]
    records = [
        frame_record(targets, [subject_record("ann", totals={1: 0.4, 2: 0.3, 3: 0.2}, focus=1)], frame=frame)
        for frame in (1, 2, 3, 4)
    ]
    told = (Label(target="cup"), Label(target="book"), Label(target="none"), Label(target="cup", point_px=(55, 5)))
    rows = [
        LabelRange(first_frame=frame, last_frame=frame, subject="ann", label=label)
        for frame, label in enumerate(told, start=1)
    ]
    (of_subject,) = scored(records, {"clip": Labels(rows)}, "one").judged_subjects
    assert of_subject.confidence == pytest.approx([0.7, 0.7, 0.7, 0.4])
    assert of_subject.on_truth == pytest.approx([0.7, 0.2, 0.1, 0.3])
    briers = [0.09 + 0.04 + 0.01, 0.64 + 0.49 + 0.01, 0.81 + 0.49 + 0.04, 0.49 + 0.16 + 0.04 + 0.01]
    assert of_subject.brier == pytest.approx(briers)


def test_surprising_directions_are_said_in_one_line() -> None:
    wrong = DirectionFit(tail=0.01, claimed_error_rad=0.2, implied_error_rad=0.6)
    records = [_record(frame, _subject(1.0, 0.0, fit=wrong if frame % 2 else FIT)) for frame in range(40)]
    (check,) = scored(records, {}).directions
    assert (check.n, check.surprises, check.fits) == (40, 0.5, False)
    other = replace(check, clip="d")
    fitting = replace(check, configuration="q", surprises=0.0, implied_deg=None)
    (note,) = misfit_notes([check, other, fitting])
    assert "\n" not in note
    assert note.startswith("p: directions do not fit the posterior on 2 of 2 clips (c, d)")


def test_directions_are_checked_once_where_configurations_have_one_posterior() -> None:
    """Such as a posterior and a logit that uses it; ``r`` has directions of its own."""
    of = {"p": FIT, "q": FIT, "r": replace(FIT, tail=0.01)}
    records = [replace(_record(1, _subject(1.0, 0.0, fit=fit)), configuration=name) for name, fit in of.items()]
    assert [check.configuration for check in scored(records, {}).directions] == ["p", "r"]


@pytest.mark.parametrize(
    ("check", "fits"),
    [
        ({}, True),
        ({"surprises": 0.14}, True),
        ({"surprises": 0.16}, False),
        ({"surprises": 1.0, "n": 19}, True),  # too few frames
        ({"implied_deg": 14.0}, True),
        ({"implied_deg": 16.0}, False),
        ({"implied_deg": 7.0}, True),
        ({"implied_deg": 6.0}, False),
        ({"implied_deg": 16.0, "claimed_deg": None}, True),  # no gaze
        ({"share": 0.79}, True),
        ({"share": 0.81}, False),
    ],
)
def test_directions_fit_within_every_limit(check: dict[str, float | None], fits: bool) -> None:
    plain = DirectionCheck(
        clip="c", configuration="p", n=20, surprises=0.05, claimed_deg=10.0, implied_deg=10.0, share=0.5
    )
    assert replace(plain, **check).fits == fits


def test_a_check_has_medians_of_what_is_known_in_degrees() -> None:
    """A frame without a gaze claims no error, and one without a head has no share."""
    fits = [
        DirectionFit(tail=0.01, claimed_error_rad=0.1, implied_error_rad=0.3, implied_share=None),
        DirectionFit(tail=0.5, claimed_error_rad=0.2, implied_error_rad=0.5, implied_share=0.6),
        DirectionFit(tail=0.04, claimed_error_rad=None, implied_error_rad=None, implied_share=0.4),
        DirectionFit(tail=0.06, claimed_error_rad=0.4, implied_error_rad=0.4, implied_share=None),
    ]
    records = [_record(frame, _subject(1.0, 0.0, fit=fit)) for frame, fit in enumerate(fits)]
    (check,) = scored(records, {}).directions
    assert (check.n, check.surprises) == (4, 0.5)
    assert (check.claimed_deg, check.implied_deg, check.share) == pytest.approx((*np.rad2deg([0.2, 0.4]), 0.5))


def test_directions_that_fit_need_no_words() -> None:
    found = scored([_record(frame, _subject(1.0, 0.0)) for frame in range(40)], {})
    assert [check.fits for check in found.directions] == [True]
    assert found.notes == ()


@pytest.mark.parametrize(("share", "fits"), [(None, True), (0.65, True), (0.93, False)])
def test_heads_that_turn_farther_than_people_do_are_not_explained(share: float | None, fits: bool) -> None:
    fit = replace(FIT, implied_share=share)
    (check,) = scored([_record(frame, _subject(1.0, 0.0, fit=fit)) for frame in range(40)], {}).directions
    assert check.fits == fits
