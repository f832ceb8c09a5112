"""Notes on labels of another time, and on exchanged names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from harness.labels.labels import Labels
from harness.run.notes import NoteKind
from harness.run.records import FrameRecord
from harness.score.mistaken_labels import _by_shift
from harness.score.reference import Reference
from tests.records import answers, labels, score

RATE_HZ, MINUTE = 25, 1500
"""Frames per second of the records, and the frames of a minute."""


def _looks(seed: int, names: Sequence[str] = ("bird", "cup", "mug", "none")) -> list[str]:
    """Two minutes of looks of 0.5 to 3 s."""
    random, found = np.random.default_rng(seed), list[str]()
    while len(found) < 2 * MINUTE:
        found += [str(random.choice(names))] * int(random.integers(RATE_HZ // 2, 3 * RATE_HZ))
    return found[: 2 * MINUTE]


def _answered(truth: Sequence[str], seed: int) -> list[str]:
    """Answers of which one look in five is wrong."""
    wrong, random = _looks(seed + 1000), np.random.default_rng(seed)
    is_wrong = np.repeat(random.random(len(truth) // RATE_HZ + 1) < 0.2, RATE_HZ)
    return [other if bad else name for name, other, bad in zip(truth, wrong, is_wrong, strict=False)]


def _said(records: Sequence[FrameRecord], labelled: Labels) -> list[str]:
    """The notes on labels and names."""
    notes = score(records, Reference(labels={"clip": labelled})).notes
    return [note.text for note in notes if note.kind == NoteKind.DOUBT]


@pytest.mark.parametrize("late", [-1000, -50, -20, 20, 50, 1000])
def test_labels_of_another_time_are_told_by_how_much(late: int) -> None:
    """Labels on a film that begins at another time are all as early, or late."""
    film = [*_looks(2), *_looks(1), *_looks(3)]
    begin = 2 * MINUTE
    shown, labelled = (film[at : at + 2 * MINUTE] for at in (begin, begin - late))
    (said,) = _said(answers(_answered(shown, 1)), labels(*labelled))
    assert f" {abs(late) / RATE_HZ:.1f} s too {'late' if late > 0 else 'early'}" in said
    assert "--offset" in said


@pytest.mark.parametrize("seed", range(4))
def test_labels_that_fit_or_never_fit_are_not_doubted(seed: int) -> None:
    truth = _looks(seed)
    assert _said(answers(_answered(truth, seed)), labels(*truth)) == []
    assert _said(answers(_looks(seed + 50)), labels(*truth)) == []


def _two(girl: Sequence[str], boy: Sequence[str]) -> list[FrameRecord]:
    """Frames of two people, of whom each can be looked at."""
    frames = zip(answers(girl), answers(boy, subject="boy"), strict=True)
    return [replace(one, subjects=(*one.subjects, *other.subjects), targets=one.targets) for one, other in frames]


@pytest.mark.parametrize("is_exchanged", [True, False])
def test_people_who_have_each_others_names_are_named(is_exchanged: bool) -> None:
    things = ("bird", "cup", "mug")
    girl, boy = _looks(7, things), _looks(8, things)
    given = (boy, girl) if is_exchanged else (girl, boy)
    labelled = Labels([*labels(*given[0]).ranges, *labels(*given[1], subject="boy").ranges])
    said = _said(_two(_answered(girl, 7), _answered(boy, 8)), labelled)
    assert len(said) == is_exchanged
    assert all("girl and boy" in text or "boy and girl" in text for text in said)


@pytest.mark.parametrize("is_exchanged", [True, False])
def test_things_that_have_each_others_names_are_named(is_exchanged: bool) -> None:
    """Two cups that are counted from the other side."""
    truth = _looks(9)
    names = {"cup": "mug", "mug": "cup"} if is_exchanged else {}
    said = _said(answers([names.get(name, name) for name in _answered(truth, 9)]), labels(*truth))
    assert len(said) == is_exchanged
    assert all("if cup and mug had" in text or "if mug and cup had" in text for text in said)


def test_a_thing_that_is_always_taken_for_its_neighbour_is_not_doubted() -> None:
    """A bias to one side moves each look on to the next thing."""
    neighbours = {"bird": "cup", "cup": "mug", "mug": "none"}
    truth = _looks(10)
    assert _said(answers([neighbours.get(name, name) for name in truth]), labels(*truth)) == []


@given(
    rows=st.integers(1, 30).flatmap(
        lambda size: st.tuples(*[arrays(np.float64, size, elements=st.integers(0, 1))] * 2)
    ),
    most=st.integers(1, 40),
)
def test_sums_by_shift_are_those_of_every_pair(rows: tuple[np.ndarray, np.ndarray], most: int) -> None:
    now, later = rows
    size = len(now)
    expected = [
        sum(now[place] * later[place + by] for place in range(size) if 0 <= place + by < size)
        for by in range(-most, most + 1)
    ]
    assert _by_shift(now, later, most).tolist() == expected
