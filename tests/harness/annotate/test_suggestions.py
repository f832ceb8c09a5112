"""The frames to label first: inside the clip, of every subject, and where a label says most."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from harness.annotate.suggestions import Predictions, label_first
from tests.annotating import FRAMES
from tests.records import frame_record, subject_record, target_record, write_run

NAMES = st.sampled_from(["cup", "book", "none"])


@st.composite
def _runs(draw: st.DrawFn) -> tuple[dict[str, list[list[str]]], list[float]]:
    """Answers of up to three configurations for up to twelve subjects, in stretches; 2 to 30 frames a second."""
    rate_hz = draw(st.integers(2, 30))
    count = draw(st.integers(1, 60 * rate_hz))
    answers = {}
    for number in range(draw(st.integers(1, 12))):
        stretches = draw(st.lists(st.lists(NAMES, min_size=1, max_size=3), min_size=1, max_size=8))
        answers[f"p{number}"] = [stretches[at * len(stretches) // count] for at in range(count)]
    return answers, [at / rate_hz for at in range(count)]


@given(_runs())
def test_blocks_cover_every_subject_and_20_seconds_without_overlap(run: Any) -> None:
    answers, times_s = run
    blocks = label_first(answers, times_s)
    step_s = times_s[1] if len(times_s) > 1 else 1.0
    labelled = Counter((block.subject, at) for block in blocks for at in range(block.first, block.last + 1))
    assert {block.subject for block in blocks} == set(answers)
    assert set(labelled.values()) == {1}
    assert all(0 <= at < len(times_s) for _, at in labelled)
    assert all(times_s[block.last] - times_s[block.first] < 4 for block in blocks)
    at_hand_s = len(times_s) * len(answers) * step_s
    block_s = 4 + len(blocks) * step_s  # the longest, and what rounding to frames can add
    assert min(at_hand_s, 20 - block_s) - 1e-6 <= labelled.total() * step_s <= max(20, 2 * len(answers)) + block_s
    assert label_first(answers, times_s) == blocks


def test_blocks_are_where_configurations_disagree_and_cover_what_is_predicted() -> None:
    """60 s at 10 Hz: the cup, but for a look at the book, one at nothing, and one on which the two disagree."""
    answers = [["cup", "cup"]] * 600
    answers[200:240], answers[360:400] = [["book", "book"]] * 40, [["none", "none"]] * 40
    answers[480:520] = [["cup", "book"]] * 40
    blocks = label_first({"ann": answers}, [at / 10 for at in range(600)])
    assert {0, 200, 360, 480} <= {block.first for block in blocks}
    assert len(blocks) == 5


def test_blocks_last_up_to_4_seconds_where_frames_are_missing() -> None:
    times_s = [at / 10 for at in range(600) if at < 300 or at % 40 == 0]
    blocks = label_first({"ann": [["cup"]] * len(times_s)}, times_s)
    assert len(blocks) == 5
    assert all(times_s[block.last] - times_s[block.first] < 4 and times_s[block.last] < 30 for block in blocks)


def test_a_subject_without_answers_is_left_out_and_a_frame_alone_is_a_block() -> None:
    (block,) = label_first({"ann": [["cup"]], "ben": [[]]}, [0.0])
    assert (block.subject, block.first, block.last) == ("ann", 0, 0)
    assert label_first({"ben": [[]]}, [0.0]) == []


def test_all_configurations_of_the_run_count_and_blind_shows_none(opened: Any, work: Path) -> None:
    """Two configurations differ on ben in the last two frames; in 24 s, these are among the 20 s that are chosen."""
    targets = [target_record(1, "cup"), target_record(2, "book")]
    records = [
        frame_record(targets, [subject_record("ben", focus=focus)], frame=n, clip="noise", configuration=name)
        for name, late in (("one", 1), ("two", 2))
        for n in FRAMES
        for focus in [late if n > 10 else 1]
    ]
    (work / "run" / "manifest.json").unlink()
    write_run(work / "run", records)
    session = opened(run=work / "run", configuration="one", annotator="anna")
    shown = session.about()["label_first"]
    assert {each["subject"] for each in shown} == {"ben"}
    assert [at for each in shown for at in range(each["first"], each["last"] + 1)] == [*range(12)]
    assert re.fullmatch(r"Label first.*: (ben \d+-\d+ \(\d+\.\d-\d+\.\d s\)(, )?)+", session.advice)
    blocks = Predictions(work / "run", session.manifest, "one").label_first(["ben"], FRAMES, [2.0 * n for n in FRAMES])
    assert (len(blocks), blocks[-1].last) == (5, 11)
    blind = opened(run=work / "run", configuration="one", blind=True, annotator="ben")
    assert (blind.about()["label_first"], blind.advice) == ([], None)
    about = blind.about()
    assert (about["suggestions"], about["order"], about["configuration"]) == ({"ann": None, "ben": None}, None, None)


def test_probabilities_say_how_sure_the_answer_nowhere_and_several_objects_of_a_name_are(
    opened: Any, work: Path
) -> None:
    targets = [target_record(1, "cup"), target_record(2, "cup"), target_record(3, "book")]
    totals = [{1: 0.02, 2: 0.0, 3: 0.03}, {1: 0.4, 2: 0.35, 3: 0.2}, {1: 0.1, 2: 0.0, 3: 0.5}]
    records = [
        frame_record(targets, [subject_record("ann", totals=total, focus=focus)], frame=frame, clip="noise")
        for frame, total, focus in zip(FRAMES, totals, (None, 1, 3), strict=False)
    ]
    (work / "run" / "manifest.json").unlink()
    methods = {records[0].configuration: {"probabilistic": True, "says_nowhere": True}}
    write_run(work / "run", records, methods=methods)
    session = opened(run=work / "run", uncertain_first=True)
    assert session.about()["suggestions"]["ann"][:3] == [("none", 0.95), ("cup", 0.75), ("book", 0.5)]
    predictions = Predictions(work / "run", session.manifest, None)
    found = [predictions.predict(frame, "ann") for frame in FRAMES[:3]]
    assert [each and round(each.margin, 9) for each in found] == [0.92, 0.55, 0.1]
    assert predictions.order(FRAMES[:3], "ann") == [2, 1, 0]
