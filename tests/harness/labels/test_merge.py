from __future__ import annotations

from typing import get_args

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.labels.files import read_annotations, write_annotations
from harness.labels.labels import Label, LabelRange, Labels, MergeRule, Timeline, merge_labels, to_decide
from tests.exchanges import SUBJECTS, TARGETS, labels_of, row

FRAMES = range(1, 41)
ANNA = Labels([row(1, 4, "bird", note="eyes shut"), row(5, 6, "cup"), row(7, 8, "none")])
BEN = Labels([row(1, 3, "bird"), row(4, 6, "cup"), row(7, 7, "cup", is_suggested=True), row(11, 12, "cup")])


@pytest.mark.parametrize(
    ("rule", "expected"),
    [
        (
            "agree",
            [
                row(1, 3, "bird", note="eyes shut"),
                row(4, 4, "ignore", note="annotators differ"),
                row(5, 6, "cup"),
                row(7, 8, "ignore", note="annotators differ"),
                row(9, 10, "ignore", note="not labelled yet"),
                row(11, 12, "ignore", note="annotators differ"),
            ],
        ),
        (
            "first",
            [
                row(1, 4, "bird", note="eyes shut"),
                row(5, 6, "cup"),
                row(7, 8, "none"),
                row(9, 10, "ignore", note="not labelled yet"),
                row(11, 12, "cup"),
            ],
        ),
        (
            "adjudicate",
            [
                row(1, 3, "bird", note="eyes shut"),
                row(4, 4, "ignore", note="to decide: anna bird, ben cup"),
                row(5, 6, "cup"),
                row(7, 8, "ignore", note="to decide: anna none, ben -"),
                row(9, 10, "ignore", note="not labelled yet"),
                row(11, 12, "ignore", note="to decide: anna -, ben cup"),
            ],
        ),
    ],
)
def test_by_rule(rule: MergeRule, expected: list[LabelRange]) -> None:
    assert merge_labels({"anna": ANNA, "ben": BEN}, FRAMES, rule) == Labels(expected)


@pytest.mark.parametrize("rule", get_args(MergeRule))
def test_frames_that_one_has_not_come_to_are_as_if_they_were_not_there(rule: MergeRule) -> None:
    begun = Labels([row(1, 4, "bird"), row(5, 8, "ignore", note="not labelled yet")])
    short = Labels([row(1, 4, "bird")])
    rest = Labels([row(1, 8, "bird")])
    frames = range(1, 9)
    assert merge_labels({"a": begun, "b": rest}, frames, rule) == merge_labels({"a": short, "b": rest}, frames, rule)


def test_what_is_left_to_a_person_is_known() -> None:
    merged = merge_labels({"anna": ANNA, "ben": BEN}, FRAMES, "adjudicate")
    assert [each.first_frame for each in to_decide(merged)] == [4, 7, 11]


@given(data=st.data(), rule=st.sampled_from(get_args(MergeRule)))
def test_a_merged_file_is_whole_and_labels_of_one_stay(
    data: st.DataObject, rule: MergeRule, tmp_path_factory: pytest.TempPathFactory
) -> None:
    drawn = [data.draw(labels_of(list(FRAMES), notes=True, points=True, suggested=True)) for _ in range(2)]
    path = tmp_path_factory.mktemp("merged") / "a.csv"
    write_annotations(path, merge_labels(dict(zip("ab", drawn, strict=True)), FRAMES, rule))
    timeline = Timeline(frames=FRAMES, times_ns=())
    read_annotations(path, timeline=timeline, subjects=SUBJECTS, targets=TARGETS)  # no gap, no overlap
    alike = merge_labels({"a": drawn[0].confirmed(), "b": drawn[0].confirmed()}, FRAMES, rule)
    for frame, subject, label in drawn[0].confirmed().labelled(FRAMES):
        assert alike.at(frame, subject) == label


def test_the_points_of_the_first_are_kept() -> None:
    one, two = (Labels([LabelRange(first_frame=1, last_frame=2, subject="girl", label=label)]) for label in LABELS)
    assert merge_labels({"a": one, "b": two}, FRAMES, "agree") == one


LABELS = (Label(target="cup", point_px=(1.0, 2.0)), Label(target="cup", point_px=(9.0, 9.0)))
