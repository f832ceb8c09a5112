"""Accuracy of a matcher against the true disparity of a clip."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.pipeline.configuration import STAGES, Configuration
from harness.report.formats import Table
from harness.sources import Clip
from vfoa.types import Disparity

OFF_PX = 2.0
"""A disparity is off if its error is larger than this."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StereoQuality:
    """One configuration's disparities against the truth, over all pixels with ground truth.

    ``known_share`` is the share of those pixels with a disparity; the errors are over these, which favours a matcher
    that answers only where it is easy. ``right_share`` counts the known pixels that are not off, over all pixels, so
    that no matcher gains by leaving pixels out.
    """

    configuration: str
    frames: int
    known_share: float
    median_error_px: float
    off_share: float
    right_share: float


def measure_stereo(clip: Clip, configurations: Sequence[Configuration], frames: Sequence[int]) -> list[StereoQuality]:
    """Match the frames with each distinct matcher of the configurations; a matcher's first configuration names it.

    Raises
    ------
    VfoaError
        If the clip has no true disparity.
    """
    rows, seen = [], set()
    for configuration in configurations:
        choice = configuration.choices["stereo"]
        if choice is None or choice.name == "truth" or str(choice.plain()) in seen:
            continue
        seen.add(str(choice.plain()))
        matcher = STAGES["stereo"].build(choice, clip)
        pairs = [(matcher.match(clip.frame(number)), clip.truth(number).disparity) for number in frames]
        known = [(disparity, truth) for disparity, truth in pairs if truth is not None]
        if known:
            rows.append(quality(configuration.name, known))
    return rows


def quality(name: str, pairs: Sequence[tuple[Disparity, Disparity]]) -> StereoQuality:
    """Quality of disparities given as pairs (disparity, truth)."""
    maps = [(disparity.disparity_px, truth.disparity_px) for disparity, truth in pairs]
    errors = np.concatenate([np.abs(found_px - true_px)[np.isfinite(true_px)] for found_px, true_px in maps])
    known = errors[np.isfinite(errors)]
    return StereoQuality(
        configuration=name,
        frames=len(pairs),
        known_share=len(known) / max(len(errors), 1),
        median_error_px=float(np.median(known)) if len(known) else float("nan"),
        off_share=float((known > OFF_PX).mean()) if len(known) else float("nan"),
        right_share=float((known <= OFF_PX).sum()) / max(len(errors), 1),
    )


def stereo_table(clip: str, rows: Sequence[StereoQuality]) -> Table:
    """Disparity compared with the ground truth."""
    return Table.of(
        f"Disparity against the truth on {clip}",
        f"matcher of | frames | known | median error px | off by > {OFF_PX:g} px | known and right",
        (
            (
                *(row.configuration, row.frames, f"{row.known_share:.1%}", f"{row.median_error_px:.2f}"),
                *(f"{row.off_share:.1%}", f"{row.right_share:.1%}"),
            )
            for row in rows
        ),
        words=1,
        notes=(
            "Known: share of the pixels with a true disparity that got one. Errors are over the known pixels, "
            "known and right is over all.",
        ),
    )
