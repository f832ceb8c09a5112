"""Notes that question the unit of a clip's depth."""

from __future__ import annotations

from dataclasses import replace

import pytest

from harness.run.notes import NoteKind
from harness.score.reference import Reference
from tests.records import frame_record, score, subject_record


@pytest.mark.parametrize(
    ("widths_m", "is_questioned"),
    [
        ((0.16, 0.18, 0.2), False),
        ((0.12, 0.4, 0.2), False),
        ((0.77, 0.8, 0.75), True),  # 4000 counts per metre read as millimetres
        ((0.04, 0.05, 0.05), True),
        ((0.2, 0.21, 5.0), False),  # one box that is cut off or too large
        ((None, None, None), False),
    ],
)
def test_heads_of_no_usual_size_question_the_unit_of_depth(
    widths_m: tuple[float | None, ...], is_questioned: bool
) -> None:
    records = [
        frame_record(subjects=[replace(subject_record("girl"), head_width_m=width_m)], frame=4 * place + number)
        for place, width_m in enumerate(widths_m)
        for number in range(4)
    ]
    doubts = score(records, Reference(labels={})).notes
    assert [(note.kind, "depth_scale" in note.text) for note in doubts] == [(NoteKind.DOUBT, True)] * is_questioned
