"""A clip without images, and labels of it, for the formats of other programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np
from hypothesis import strategies as st

from harness.annotate.bodies import TrueBodies
from harness.clips.naming import NameRule
from harness.labels.formats.exchange import Exchange
from harness.labels.labels import Label, LabelRange, Labels
from harness.sources import PersonTruth, Truth
from tests.scenes import make_rig
from vfoa.types import Instance, Instances, StereoFrame

SUBJECTS, TARGETS = ("girl", "boy"), ("bird", "cup")


@dataclass
class PlainClip:
    """Black frames; frame n at n over the rate, on a clock that begins ``start_ns`` earlier or later."""

    frames: Sequence[int] = range(1, 51)
    rate_hz: float | None = 25.0
    start_ns: int = 0
    notes: tuple[str, ...] = ()
    truths: dict[int, Truth] = field(default_factory=dict)

    def time_ns(self, number: int) -> int:
        return self.start_ns + round(number * 1e9 / (self.rate_hz or 1.0))

    def frame(self, number: int) -> StereoFrame:
        rig = make_rig(64, 48)
        black = np.zeros((48, 64, 3), np.uint8)
        return StereoFrame(index=number, time_ns=self.time_ns(number), left=black, right=black, rig=rig)

    def truth(self, number: int) -> Truth:
        return self.truths.get(number, Truth())

    def digest(self) -> str:
        return "0" * 64


BOXES = {"bird": (2, 2, 12, 12), "cup": (2, 20, 12, 30), "girl": (30, 2, 40, 40), "boy": (50, 2, 60, 40)}
"""The box of everything in each frame of a :func:`staged` clip: u0, v0, u1, v1, the last pixel not included."""


def staged(frames: Sequence[int] = range(1, 51), **more: Any) -> tuple[PlainClip, TrueBodies]:
    """A clip whose ground truth has all masks and heads (the upper quarter of a person), with their positions."""
    ids = np.zeros((48, 64), dtype=np.uint16)
    for number, (u0, v0, u1, v1) in enumerate(BOXES.values(), start=1):
        ids[v0:v1, u0:u1] = number
    listed = (
        Instance(id=k, label=name, category_id=k, is_thing=True, score=1) for k, name in enumerate(BOXES, start=1)
    )
    people = (
        PersonTruth(name=name, instance_id=k, head_box_px=np.array([BOXES[name][0], 2.0, BOXES[name][2], 12.0]))
        for k, name in ((3, "girl"), (4, "boy"))
    )
    truth = Truth(instances=Instances(ids=ids, instances=tuple(listed)), people=tuple(people))
    clip = PlainClip(frames=frames, truths=dict.fromkeys(frames, truth), **more)
    rules = {name: NameRule(category=name, instance=k) for k, name in enumerate(BOXES, start=1)}
    return clip, TrueBodies(clip=clip, rules=rules)


def exchange(clip: PlainClip | None = None, **more: Any) -> Exchange:
    return Exchange(clip=clip or PlainClip(), subjects=SUBJECTS, targets=TARGETS, **more)


def row(first: int, last: int, target: str, subject: str = "girl", **more: Any) -> LabelRange:
    return LabelRange(first_frame=first, last_frame=last, subject=subject, label=Label(target=target, **more))


NOTES = st.text("ab,;'\"#<&>é漢 ", max_size=8).map(lambda text: " ".join(text.split()))
POINTS = st.none() | st.tuples(*[st.floats(0, 4096, allow_nan=False)] * 2)
FRAMES = st.sets(st.integers(1, 99), min_size=1, max_size=40).map(sorted)
"""Frame numbers of a clip with gaps."""


@st.composite
def labels_of(draw: st.DrawFn, frames: Sequence[int], *, notes: bool, points: bool, suggested: bool) -> Labels:
    """Ranges that follow each other without a gap, each of at least one frame."""
    rows = []
    for subject in draw(st.lists(st.sampled_from(SUBJECTS), unique=True, min_size=1)):
        cuts = sorted(draw(st.sets(st.integers(0, len(frames)), min_size=2, max_size=8)))
        for low, high in pairwise(cuts):
            label = Label(
                target=draw(
                    st.sampled_from([*TARGETS, "none", "ignore", *(each for each in SUBJECTS if each != subject)])
                ),
                note=draw(NOTES) if notes else "",
                point_px=draw(POINTS) if points else None,
                is_suggested=draw(st.booleans()) if suggested else False,
            )
            rows.append(LabelRange(first_frame=frames[low], last_frame=frames[high - 1], subject=subject, label=label))
    return Labels(rows)
