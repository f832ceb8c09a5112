from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.labels.labels import Label, LabelRange, Labels, ranges_of
from harness.report.agreement import agreement_tables
from harness.report.formats import to_csv
from harness.score.agreement import (
    Agreement,
    Difference,
    TargetAgreement,
    compare_annotators,
    differences,
)
from harness.score.statistics import NO_INTERVAL
from vfoa.errors import VfoaError


def _labels(subject: str = "girl", first: int = 1, **more: str) -> Labels:
    """One letter a frame: b bird, c cup, n none, i ignore, B a suggested bird, - nothing."""
    meant = {
        "b": Label(target="bird"),
        "c": Label(target="cup"),
        "n": Label(target="none"),
        "i": Label(target="ignore"),
        "B": Label(target="bird", is_suggested=True),
        "-": None,
    }
    by_subject = more or {}
    return Labels(
        row
        for who, letters in by_subject.items()
        for row in ranges_of(who, ((first + k, meant[letter]) for k, letter in enumerate(letters)))
    )


FRAMES = range(1, 101)


def _pair(first: str, second: str) -> Agreement:
    labels = {"anna": _labels(girl=first), "ben": _labels(girl=second)}
    (found,) = compare_annotators(labels, FRAMES, 5.0)
    return found


def test_only_frames_that_both_judged_are_compared() -> None:
    found = _pair("bbbccnniBb---", "bccccnbbbbb--")
    assert (found.n, found.skipped, found.agreed) == (8, 3, 5)
    assert found.targets == ("bird", "cup", "none")
    assert found.confusion.tolist() == [[2, 2, 0], [0, 2, 0], [1, 0, 1]]


def test_by_hand() -> None:
    # anna: 4 bird, 2 cup, 2 none; ben: 3 bird, 4 cup, 1 none; p_o = 5/8, p_e = (12 + 8 + 2) / 64
    found = _pair("bbbccnnb", "bccccnbb")
    assert found.kappa == pytest.approx((5 / 8 - 22 / 64) / (1 - 22 / 64))
    assert found.by_target()[1] == TargetAgreement(
        target="cup", first=2, second=4, both=2, kappa=pytest.approx((6 / 8 - (2 * 4 + 6 * 4) / 64) / (1 - 32 / 64))
    )
    assert found.by_target()[1].share == pytest.approx(2 / 3)


@given(said=st.lists(st.tuples(*[st.sampled_from("bcn")] * 2), min_size=2, max_size=60))
def test_kappa_is_that_of_scikit_learn(said: list[tuple[str, str]]) -> None:
    from sklearn.metrics import cohen_kappa_score

    first, second = ("".join(column) for column in zip(*said, strict=True))
    found = _pair(first, second)
    if len({*first, *second}) > 1:
        assert found.kappa == pytest.approx(cohen_kappa_score(list(first), list(second)))
        assert found.interval == NO_INTERVAL or found.interval.low <= found.interval.high <= 1
    else:
        assert math.isnan(found.kappa)


def test_an_interval_needs_looks_that_differ() -> None:
    assert _pair("bbbcccnnn" * 5, "bbbcccnnn" * 5).interval == NO_INTERVAL  # no resample differs from another
    assert _pair("b" * 40, "b" * 20 + "c" * 20).interval == NO_INTERVAL  # one look


def test_looks_shorter_than_two_seconds_are_joined_for_the_interval() -> None:
    """Looks of 0.6 s make two units, which are too few; where the rate is not known, each of the eight is one."""
    labels = {"anna": _labels(girl="bbbccc" * 4), "ben": _labels(girl="bbbcccbbcccb" * 2)}
    at_5_hz, unknown, slow = (compare_annotators(labels, FRAMES, rate_hz)[0] for rate_hz in (5.0, None, 1.0))
    assert at_5_hz.kappa == unknown.kappa == slow.kappa
    assert at_5_hz.interval == NO_INTERVAL
    assert unknown.interval.low < unknown.kappa < unknown.interval.high
    assert slow.interval == unknown.interval


def test_errors_that_lie_together_widen_the_interval() -> None:
    truth = "b" * 10 + "c" * 10 + "b" * 10 + "c" * 10 + "b" * 10 + "c" * 10 + "b" * 10 + "c" * 10
    other = {"b": "c", "c": "b"}
    scattered = "".join(other[each] if k % 10 < 2 else each for k, each in enumerate(truth))
    lumped = "".join(other[each] if k < 16 else each for k, each in enumerate(truth))
    narrow, wide = _pair(truth, scattered).interval, _pair(truth, lumped).interval
    assert (narrow == NO_INTERVAL) or narrow.high - narrow.low < wide.high - wide.low
    assert wide.low < _pair(truth, lumped).kappa < wide.high


def test_subjects_are_pooled_and_each_stands_alone() -> None:
    labels = {"anna": _labels(girl="bb", boy="cc"), "ben": _labels(girl="bc", boy="cc"), "cat": _labels(girl="nn")}
    found = compare_annotators(labels, FRAMES, None)
    assert [(each.first, each.second, each.subject, each.n) for each in found] == [
        ("anna", "ben", None, 4),
        ("anna", "ben", "boy", 2),
        ("anna", "ben", "girl", 2),
        ("anna", "cat", None, 2),
        ("anna", "cat", "boy", 0),
        ("anna", "cat", "girl", 2),
        ("ben", "cat", None, 2),
        ("ben", "cat", "boy", 0),
        ("ben", "cat", "girl", 2),
    ]


def test_frames_near_a_change_by_either_can_be_left_out() -> None:
    """One marks each change two frames after the other: away from changes they agree."""
    labels = {"anna": _labels(girl="c" * 10 + "b" * 10), "ben": _labels(girl="c" * 12 + "b" * 8)}
    every, away = (compare_annotators(labels, range(1, 21), 10.0, away_s)[0] for away_s in (0.0, 0.16))
    assert (every.n, every.agreed) == (20, 18)
    assert (away.n, away.agreed, away.skipped) == (14, 14, 6)
    with pytest.raises(VfoaError, match="--away"):
        compare_annotators(labels, range(1, 21), None, 0.16)


def test_labels_of_every_other_frame_change_as_those_of_all_frames() -> None:
    labels = {"anna": _labels(girl="ci" * 5 + "bi" * 5), "ben": _labels(girl="ci" * 6 + "bi" * 4)}
    every, away = (compare_annotators(labels, range(1, 21), 10.0, away_s)[0] for away_s in (0.0, 0.16))
    assert (every.n, every.agreed) == (10, 9)
    assert (away.n, away.agreed, away.skipped) == (7, 7, 13)


def test_the_time_from_a_change_is_that_of_the_frames() -> None:
    """The label changes during a pause of 1 s, half a second from both of its ends."""
    labels = {name: _labels(girl="bbbbbccccc") for name in ("anna", "ben")}
    times_s = [place / 10 + (place > 4) for place in range(10)]
    by_rate, by_times = (compare_annotators(labels, range(1, 11), 10.0, 0.3, times)[0].n for times in (None, times_s))
    assert (by_rate, by_times) == (4, 10)


def test_differences_are_ranges_of_the_clips_frames() -> None:
    frames = [1, 2, 3, 7, 8, 9]
    one = Labels([LabelRange(first_frame=1, last_frame=9, subject="girl", label=Label(target="bird"))])
    other = Labels(
        LabelRange(first_frame=first, last_frame=last, subject="girl", label=Label(target=target))
        for first, last, target in [(1, 1, "bird"), (2, 7, "cup"), (8, 8, "ignore"), (9, 9, "cup")]
    )
    assert differences(one, other, frames) == [
        Difference(subject="girl", first_frame=2, last_frame=7, frames=3, first="bird", second="cup"),
        Difference(subject="girl", first_frame=9, last_frame=9, frames=1, first="bird", second="cup"),
    ]


def test_differences_of_every_third_frame_are_one_range() -> None:
    (found,) = differences(_labels(girl="c--b--b--b"), _labels(girl="c--c--c--c"), FRAMES)
    assert (found.first_frame, found.last_frame, found.frames) == (4, 10, 3)


@given(said=st.lists(st.tuples(*[st.sampled_from("bcni-")] * 2), max_size=40))
def test_differences_hold_every_frame_that_differs(said: list[tuple[str, str]]) -> None:
    first, second = ("".join(column) for column in zip(*said, strict=True)) if said else ("", "")
    compared = [k for k, pair in enumerate(said, start=1) if not {*pair} & {"i", "-"}]
    expected = [k for k in compared if len({*said[k - 1]}) > 1]
    found = differences(_labels(girl=first), _labels(girl=second), FRAMES)
    ranges = [[n for n in range(each.first_frame, each.last_frame + 1) if n in compared] for each in found]
    assert [n for numbers in ranges for n in numbers] == expected
    assert [len(numbers) for numbers in ranges] == [each.frames for each in found]
    for before, after in pairwise(found):
        assert after.first_frame > before.last_frame + 1 or (before.first, before.second) != (after.first, after.second)


def test_the_tables_say_it(tmp_path: object) -> None:
    labels = {"anna": _labels(girl="bbbb"), "ben": _labels(girl="bbcc")}
    tables = agreement_tables("clip", labels, compare_annotators(labels, FRAMES, 2.0), FRAMES)
    assert list(tables) == ["agreement", "agreement_by_target", "confusion_anna_ben", "differences"]
    assert to_csv(tables["agreement"]).splitlines()[1].startswith("anna,ben,(all),4,0,50.0,0.00,")
    assert to_csv(tables["agreement_by_target"]).splitlines()[1] == "anna,ben,bird,4,2,2,66.7,0.00"
    assert to_csv(tables["confusion_anna_ben"]) == ",bird,cup\nbird,2,2\ncup,0,0\n"
    assert to_csv(tables["differences"]).splitlines()[1] == "anna,ben,girl,bird,cup,3,4,2"
