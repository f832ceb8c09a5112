"""A clip without images, and labels of it, for the formats of other programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from hypothesis import strategies as st

from harness.labels.formats.exchange import Exchange
from harness.labels.labels import Label, LabelRange, Labels, timeline_of
from tests.scenes import make_rig
from vfoa.types import StereoFrame

SUBJECTS, TARGETS = ("girl", "boy"), ("bird", "cup")


@dataclass
class PlainClip:
    """Black frames; frame n is at n over the rate, on a clock that begins ``start_ns`` earlier or later."""

    frames: Sequence[int] = range(1, 51)
    rate_hz: float | None = 25.0
    start_ns: int = 0

    def time_ns(self, number: int) -> int:
        return self.start_ns + round(number * 1e9 / (self.rate_hz or 1.0))

    def frame(self, number: int) -> StereoFrame:
        black = np.zeros((48, 64, 3), np.uint8)
        rig = make_rig(64, 48)
        return StereoFrame(index=number, time_ns=self.time_ns(number), left=black, right=black, rig=rig)


def exchange(clip: PlainClip | None = None, **more: Any) -> Exchange:
    clip = clip or PlainClip()
    return Exchange(timeline=timeline_of(clip), rate_hz=clip.rate_hz, subjects=SUBJECTS, targets=TARGETS, **more)


def row(first: int, last: int, target: str, subject: str = "girl", **more: Any) -> LabelRange:
    return LabelRange(first_frame=first, last_frame=last, subject=subject, label=Label(target=target, **more))


Box = tuple[float, float, float, float]


def cvat_document(*elements: str, size: tuple[int, int] = (64, 48)) -> str:
    width, height = size
    return (
        "<?xml version='1.0' encoding='utf-8'?>\n<annotations><version>1.1</version><meta><job><size>50</size></job>"
        f"<original_size><width>{width}</width><height>{height}</height></original_size></meta>{''.join(elements)}"
        "</annotations>"
    )


def cvat_box(frame: int, place: Box, *, key: bool = True, outside: bool = False, **attributes: str) -> str:
    sides = " ".join(f'{name}="{value}"' for name, value in zip(("xtl", "ytl", "xbr", "ybr"), place, strict=True))
    inside = "".join(f'<attribute name="{name}">{value}</attribute>' for name, value in attributes.items())
    return f'<box frame="{frame}" keyframe="{key:d}" outside="{outside:d}" occluded="0" {sides}>{inside}</box>'


def cvat_track(label: str, *shapes: str, number: int = 0) -> str:
    return f'<track id="{number}" label="{label}" source="manual">{"".join(shapes)}</track>'


NOTES = st.text("ab,;'\"#<&>é漢 ", max_size=8).map(lambda text: " ".join(text.split()))
POINTS = st.none() | st.tuples(*[st.floats(0, 4096, allow_nan=False)] * 2)
TAGS = st.sets(st.sampled_from(["child", "far", "x-1.5"])).map(sorted).map(tuple)
FRAMES = st.sets(st.integers(1, 99), min_size=1, max_size=40).map(sorted)
"""Frame numbers of a clip with gaps."""


@st.composite
def labels_of(
    draw: st.DrawFn, frames: Sequence[int], *, notes: bool, points: bool, tags: bool, suggested: bool
) -> Labels:
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
                tags=draw(TAGS) if tags else (),
            )
            rows.append(LabelRange(first_frame=frames[low], last_frame=frames[high - 1], subject=subject, label=label))
    return Labels(rows)
