"""The smallest sets with 90 % of the probability, and how often they hold the truth."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.labels.labels import Label, LabelRange, Labels
from harness.run.records import AttentionRecord, DirectionFitRecord, FrameRecord, SubjectRecord, TargetRecord
from harness.score.posterior_checks import DirectionLog, SetLog, misfit_notes, prediction_set

FIT = DirectionFitRecord(tail=0.5, claimed_error_rad=0.2, implied_error_rad=0.2)


def _subject(*totals: float, fit: DirectionFitRecord | None = FIT) -> SubjectRecord:
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
    assert prediction_set(_subject(0.9, 0.1, fit=None)) is None


@given(st.lists(st.floats(0, 1), min_size=1, max_size=8).filter(lambda found: sum(found) > 0))
def test_no_smaller_set_has_as_much(weights: list[float]) -> None:
    totals = [weight / sum(weights) * 0.97 for weight in weights]
    held = prediction_set(_subject(*totals))
    assert held is not None
    probability = dict(enumerate(totals, start=1)) | {None: 1 - sum(totals)}
    assert sum(probability[key] for key in held) >= 0.9 - 1e-6
    assert sum(sorted(probability.values(), reverse=True)[: len(held) - 1]) < 0.9 + 1e-6


def test_coverage_and_size_are_over_the_scored_frames() -> None:
    labels = Labels(
        LabelRange(first_frame=frame, last_frame=frame, subject="ann", label=Label(target=target))
        for frame, target in ((1, "cup"), (2, "none"), (3, "ignore"), (4, "book"))
    )
    log = SetLog({"c": labels})
    records = [_record(1, _subject(0.95, 0.05)), _record(2, _subject(0.3, 0.1)), _record(3, _subject(0.0, 1.0)),
               _record(4, _subject(0.95, 0.05))]  # fmt: skip
    assert list(log.watch(records)) == records
    (found,) = log.coverages()
    assert (found.configuration, found.n, found.covered, found.mean_size) == ("p", 3, 2, 4 / 3)


def test_surprising_directions_are_said_in_one_line() -> None:
    log = DirectionLog()
    wrong = DirectionFitRecord(tail=0.01, claimed_error_rad=0.2, implied_error_rad=0.6)
    list(log.watch([_record(frame, _subject(1.0, 0.0, fit=wrong if frame % 2 else FIT)) for frame in range(40)]))
    (check,) = log.checks()
    assert (check.n, check.surprises, check.fits) == (40, 0.5, False)
    other = replace(check, clip="d")
    fitting = replace(check, configuration="q", surprises=0.0, implied_deg=None)
    (note,) = misfit_notes([check, other, fitting])
    assert "\n" not in note
    assert note.startswith("p: directions do not fit the posterior on 2 of 2 clips (c, d)")


def test_directions_that_fit_need_no_words() -> None:
    log = DirectionLog()
    list(log.watch([_record(frame, _subject(1.0, 0.0)) for frame in range(40)]))
    assert [check.fits for check in log.checks()] == [True]
    assert misfit_notes(log.checks()) == []


@pytest.mark.parametrize(("share", "fits"), [(None, True), (0.65, True), (0.93, False)])
def test_heads_that_turn_farther_than_people_do_are_not_explained(share: float | None, fits: bool) -> None:
    log = DirectionLog()
    fit = replace(FIT, implied_share=share)
    list(log.watch([_record(frame, _subject(1.0, 0.0, fit=fit)) for frame in range(40)]))
    (check,) = log.checks()
    assert check.fits == fits
    assert ("93 % of the way" in check.misfit()) != fits
