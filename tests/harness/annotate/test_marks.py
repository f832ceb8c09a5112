"""Marks of a track, frame by frame: stretches, what an action makes of them, and the labels in the file."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from harness.annotate.actions import Action, edited
from harness.annotate.marks import Mark, Stretch, SubjectMarks, counts, looked_at, stretch_at, stretches, to_labels
from harness.labels.labels import IGNORED

MARKS = st.none() | st.builds(
    Mark,
    target=st.sampled_from(["cup", "book"]),
    note=st.sampled_from(["", "seen well"]),
    tags=st.sampled_from([(), ("far",)]),
    is_suggested=st.booleans(),
    carried=st.booleans(),
)
TRACKS = st.lists(st.tuples(MARKS, st.integers(1, 4)), min_size=1, max_size=5).map(
    lambda runs: [mark and replace(mark) for mark, count in runs for _ in range(count)]  # equal, but not one object
)
PLACES = st.integers(0, 99)


def after(track: SubjectMarks, parts: list[Stretch]) -> SubjectMarks:
    """The track once the parts are set, which must follow each other and be as long as they can."""
    assert all(one.last + 1 == other.first and one.mark != other.mark for one, other in pairwise(parts))
    new = list(track)
    for part in parts:
        new[part.first : part.last + 1] = [part.mark] * (part.last - part.first + 1)
    assert len(new) == len(track)
    return new


@given(TRACKS, PLACES, PLACES)
def test_stretches_are_the_track_and_as_long_as_they_can_be(track: SubjectMarks, one: int, other: int) -> None:
    first, last = sorted(each % len(track) for each in (one, other))
    parts = stretches(track, first, last)
    assert [part.mark for part in parts for _ in range(part.first, part.last + 1)] == track[first : last + 1]
    assert (parts[0].first, parts[-1].last) == (first, last)
    assert all(one.last + 1 == other.first and one.mark != other.mark for one, other in pairwise(parts))
    low, high = stretch_at(track, first, looked_at)
    assert len({looked_at(mark) for mark in track[low : high + 1]}) == 1
    assert all(looked_at(track[at]) != looked_at(track[first]) for at in (low - 1, high + 1) if 0 <= at < len(track))


@given(TRACKS, PLACES)
def test_a_look_is_carried_on_over_what_nobody_labelled(track: SubjectMarks, at: int) -> None:
    at %= len(track)
    new = after(track, edited(Action(kind="look", at=at, target="robot"), track, None, -1))
    _, last = stretch_at(track, at, looked_at)
    for place, (old, mark) in enumerate(zip(track, new, strict=True)):
        if not at <= place <= last:
            assert mark == old
            continue
        is_given = old is not None and not old.is_suggested and not old.carried
        assert mark == Mark(target="robot", tags=old.tags if old else (), carried=place > at and not is_given)


@given(TRACKS, PLACES, PLACES)
def test_a_range_keeps_notes_and_tags(track: SubjectMarks, one: int, other: int) -> None:
    first, last = sorted(each % len(track) for each in (one, other))
    new = after(track, edited(Action(kind="range", at=first, last=last, target="robot"), track, None, -1))
    for place, (old, mark) in enumerate(zip(track, new, strict=True)):
        if first <= place <= last:
            assert mark == Mark(target="robot", note=old.note if old else "", tags=old.tags if old else ())
        else:
            assert mark == old


@given(TRACKS, PLACES)
def test_a_note_is_on_the_whole_label_carried_on_or_not(track: SubjectMarks, at: int) -> None:
    at %= len(track)
    new = after(track, edited(Action(kind="note", at=at, note="behind"), track, None, -1))
    low, high = stretch_at(track, at, lambda mark: mark and replace(mark, carried=False))
    for place, (old, mark) in enumerate(zip(track, new, strict=True)):
        assert mark == (replace(old, note="behind") if old is not None and low <= place <= high else old)


@given(TRACKS, st.integers(-1, 20), st.integers(1, 7))
def test_the_file_has_what_counts_and_ignores_gaps(track: SubjectMarks, seen: int, step: int) -> None:
    frames = [100 + step * at for at in range(len(track))]
    labels = to_labels({"ann": track}, {"ann": seen}, frames)
    marked = [at for at, mark in enumerate(track) if counts(mark, at, seen)]
    for at, (frame, mark) in enumerate(zip(frames, track, strict=True)):
        label = labels.at(frame, "ann")
        if not marked or not marked[0] <= at <= marked[-1]:
            assert label is None
        elif mark is None or not counts(mark, at, seen):
            assert label is not None
            assert label.target == IGNORED
        else:
            said = (mark.target, mark.note, mark.tags, mark.is_suggested)
            assert label is not None
            assert (label.target, label.note, label.tags, label.is_suggested) == said
