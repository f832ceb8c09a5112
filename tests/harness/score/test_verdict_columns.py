"""Verdicts as columns say of every frame what is said of one frame at a time."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.labels.labels import Label, LabelRange, Labels
from harness.run.columns import Words
from harness.run.manifest import AnswerTraits
from harness.run.records import AttentionRecord, BoxRecord, FrameRecord, SubjectRecord, TargetRecord
from harness.score.reference import Reference
from harness.score.verdict_columns import judge_columns
from tests.frame_by_frame import JudgedPart
from tests.record_tables import columns_of
from tests.records import AXES
from vfoa.types import DirectionFit

PEOPLE, THINGS = ("ann", "ben"), ("cup", "can", "none", "ignore")
# few values, so that there are ties, boxes of no size, and eyes in the middle of a box
lengths = st.sampled_from((-1.5, -0.3, 0.0, 0.1, 0.3, 1.0, 3.0))
vectors = st.tuples(lengths, lengths, lengths)
boxes_px = st.tuples(*(st.sampled_from((0.0, 10.0, 17.5, 30.0)) for _ in range(4)))
shares = st.sampled_from((0.0, 0.1, 0.2, 0.25, 0.7, 1.0)) | st.floats(0, 1)


@st.composite
def frames(draw: st.DrawFn, number: int) -> FrameRecord:
    """A frame of objects and people that share names, and in which anything may be unknown."""
    ids = draw(st.lists(st.integers(1, 9), unique=True, max_size=4))
    boxes = st.builds(BoxRecord, center_m=vectors, half_size_m=st.just((0.1, 0.1, 0.1)), axes=st.just(AXES))
    targets = [
        TargetRecord(
            instance_id=each,
            name=draw(st.sampled_from(("ann", "ben", "cup", "can"))),
            label="thing",
            score=0.5,
            box_px=draw(st.none() | boxes_px),
            points=3,
            box=draw(st.none() | boxes),
        )
        for each in ids
    ]
    subjects = []
    for track in range(draw(st.integers(0, 3))):
        attended = draw(st.lists(st.sampled_from(ids), unique=True)) if ids else []
        totals = [draw(shares) for _ in attended]
        scale = max(1.0, sum(totals))
        subject = SubjectRecord(
            track_id=track + 1,
            name=draw(st.none() | st.sampled_from(PEOPLE)),
            instance_id=draw(st.none() | st.integers(1, 9)),
            head_box_px=None,
            eye_origin_m=draw(st.none() | vectors),
            gaze=draw(st.none() | vectors),
            gaze_sigma_rad=None,
            head=draw(st.none() | vectors),
            missing=draw(
                st.none() | st.sampled_from(("no_eyes_3d", "no_direction", "no_object", "no_hit", "no_answer"))
            ),
            attention=tuple(
                AttentionRecord(instance_id=each, gaze=None, head=None, total=total / scale)
                for each, total in sorted(zip(attended, totals, strict=True), key=lambda each: ids.index(each[0]))
            ),
            focus=draw(st.none() | st.sampled_from(attended)) if attended else None,
            tied=(),
            fit=draw(st.none() | st.builds(DirectionFit, tail=shares, implied_share=st.none() | shares)),
            no_gaze=draw(st.none() | st.just("face_turned_away")),
            head_width_m=draw(st.none() | lengths),
        )
        subjects.append(subject)
    return FrameRecord(
        clip="clip",
        configuration="one",
        frame=number,
        time_ns=number * 40_000_000,
        targets=tuple(targets),
        subjects=tuple(subjects),
    )


points = st.none() | st.tuples(st.sampled_from((0.0, 12.0, 20.0)), st.sampled_from((5.0, 15.0, 40.0)))
labels = st.builds(
    Label,
    target=st.sampled_from((*PEOPLE, *THINGS)),
    note=st.sampled_from(("", "blocked by a lamp")),
    point_px=points,
)
traits = st.builds(AnswerTraits, probabilistic=st.booleans(), says_nowhere=st.booleans(), from_file=st.booleans())


@given(data=st.data())
def test_columns_say_of_every_frame_what_is_said_of_it_alone(data: st.DataObject) -> None:
    numbers = data.draw(st.lists(st.integers(1, 12), unique=True, min_size=1, max_size=6).map(sorted))
    records = [data.draw(frames(number)) for number in numbers]
    ranges = [
        LabelRange(first_frame=frame, last_frame=frame + length, subject=subject, label=data.draw(labels))
        for subject in data.draw(st.sets(st.sampled_from((*PEOPLE, "eve"))))
        for frame, length in ((1, 2), (4, 0), (7, 3))
    ]
    of_clip = Labels(ranges)
    of_method = data.draw(traits)
    phases = {1: "search", 2: "answer"}
    reference = Reference(labels={"clip": of_clip}, traits={"one": of_method}, phases={"clip": phases})
    expected = JudgedPart()
    for record in records:
        expected.take(record, reference)
    words = Words()
    found = judge_columns(columns_of(records, words), of_clip, [*range(1, 14)], of_method, phases)
    for subject, judged in found.by_subject.items():
        told = dict(zip(judged.frames.tolist(), judged.verdicts(), strict=True))
        of_subject = expected.by_subject.get(subject, {})
        assert {frame: told[frame] for frame in of_subject} == {k: each.verdict for k, each in of_subject.items()}
        assert {*told} - {*of_subject} == {
            frame for frame in range(1, 14) if frame not in numbers and of_clip.at(frame, subject)
        }
        for place, frame in enumerate(judged.frames.tolist()):
            one = of_subject.get(frame)
            if one is not None and one.verdict.outcome != "unscored":
                assert judged.is_blocked[place] == one.is_blocked
                assert tuple(judged.hits[place].tolist()) == one.hits
                assert judged.angles_rad[place] == one.angle_rad or math.isnan(one.angle_rad)
                assert judged.worth[place].tolist() == pytest.approx([*map(float, one.worth)], abs=1e-15, nan_ok=True)
    assert {*expected.by_subject} <= {*found.by_subject}
    assert found.aims.ravel().tolist() == expected.aims
    assert sorted(found.head_widths_m) == sorted(expected.head_widths_m)
    assert found.targets == {*expected.targets}
    assert dict(zip(found.frames.tolist(), found.times_ns.tolist(), strict=True)) == expected.times_ns
    phase_of = zip(found.frames.tolist(), words.words(found.phase_of), strict=True)
    assert {frame: phase for frame, phase in phase_of if phase} == expected.phases
    fits = [[math.nan if value is None else value for value in _values(fit)] for fit in expected.fits]
    np.testing.assert_array_equal(found.fits, np.array(fits).reshape(-1, 4))


def _values(fit: DirectionFit) -> tuple[float | None, ...]:
    return fit.tail, fit.claimed_error_rad, fit.implied_error_rad, fit.implied_share


def test_a_frame_without_a_record_has_the_error_of_a_person_who_was_not_found() -> None:
    words, of_clip = (
        Words(),
        Labels([LabelRange(first_frame=1, last_frame=3, subject="ann", label=Label(target="cup"))]),
    )
    record = FrameRecord(clip="clip", configuration="one", frame=2, time_ns=0, targets=(), subjects=())
    found = judge_columns(columns_of([record], words), of_clip, [1, 2], AnswerTraits(), {})
    (judged,) = found.by_subject.values()
    assert [(verdict.frame, verdict.error_type) for verdict in judged.verdicts()] == [
        (1, "no_subject"),
        (2, "no_subject"),
    ]
    from_file = judge_columns(
        columns_of([replace(record, frame=9)], words), of_clip, [1], AnswerTraits(from_file=True), {}
    )
    assert words.words(from_file.by_subject["ann"].error_type) == ["no_answer"]
