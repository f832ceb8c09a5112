"""The frames of a run as columns: what scores and the page take, for whole clips (:mod:`harness.run.table_columns`).

A record of each frame (:mod:`harness.run.table_records`) is the view of one frame; columns hold the same values.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vfoa.types import Codes, Flags, Float

UNKNOWN = -1
"""The code of no word, and the row of nothing."""
NO_ID = np.iinfo(np.int64).min
"""Stands for an instance id that is not there."""
OF_DISPARITY = ("error_px", "over_2_px", "known")
OF_OBJECT = ("mask_iou", "box_iou", "center_error_m")
OF_PERSON = ("head_box_iou", "eye_error_m", "head_error_deg", "gaze_error_deg")
"""Columns of measures of disparities, of objects and of people (:mod:`harness.pipeline.measures`)."""


class Words:
    """Numbers for words, in the order in which they are first used; the same in all columns of a run."""

    def __init__(self) -> None:
        self._codes: dict[str, int] = {}
        self._words: list[str] = []

    def code(self, word: str | None) -> int:
        """The number of a word; :data:`UNKNOWN` for none."""
        if word is None:
            return UNKNOWN
        if (code := self._codes.get(word)) is None:
            code = self._codes[word] = len(self._words)
            self._words.append(word)
        return code

    def codes(self, words: Iterable[str | None]) -> Codes:
        """The numbers of words."""
        return np.array([self.code(word) for word in words], dtype=np.intp)

    def word(self, code: int) -> str | None:
        """The word of a number; None for :data:`UNKNOWN`."""
        return None if code < 0 else self._words[code]

    def __len__(self) -> int:
        return len(self._words)

    def counts(self, codes: Codes) -> dict[str, int]:
        """How often each word is there, of the words that are."""
        known, counts = np.unique(codes[codes != UNKNOWN], return_counts=True)
        return {self._words[code]: count for code, count in zip(known.tolist(), counts.tolist(), strict=True)}

    def words(self, codes: Codes) -> list[str | None]:
        """The words of numbers."""
        return [*map(self.word, codes.tolist())]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SceneColumns:
    """What was found in a clip: F frames, N instances and P people, each in the order of the frames.

    ``frames`` and ``times_ns`` (F,) are ascending; ``pixel_metres`` (F,) is focal length times baseline, NaN without a
    right image. The instances of frame k are the rows ``firsts[k]`` to
    ``firsts[k + 1]``; ``names`` (N,) are codes of their names. Boxes in the image (N, 4), px, and centres of 3D boxes
    (N, 3), metres in the left camera's frame, are NaN where there are none. ``person_at`` (P,) is the place of a
    person's frame, ``bodies`` the id of the person's instance, :data:`NO_ID` without one, ``head_heights_px`` (P,) the
    height of the head's box, NaN without images, and ``is_cut`` says whether the box ends at the image's border.
    ``is_held`` (N,) says which 3D boxes are at the depth of an earlier frame.
    """

    frames: NDArray[np.int64]
    times_ns: NDArray[np.int64]
    has_truth: Flags
    pixel_metres: Float
    firsts: Codes
    instance_at: Codes
    instance_ids: NDArray[np.int64]
    names: Codes
    boxes_px: Float
    centers_m: Float
    is_held: Flags
    person_at: Codes
    tracks: NDArray[np.int64]
    person_names: Codes
    bodies: NDArray[np.int64]
    head_heights_px: Float
    is_cut: Flags

    def instances_of(self, at: Codes) -> Codes:
        """The rows of the instances of frames (n, K), :data:`UNKNOWN` where a frame has fewer than K."""
        rows = self.firsts[at][:, None] + np.arange(np.diff(self.firsts).max(initial=1))
        return np.where(rows < self.firsts[at + 1][:, None], rows, UNKNOWN)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LookColumns:
    """Where the people of a clip look (P, 3): eyes in metres, directions after the filter; NaN: not known.

    ``no_gaze`` are codes of reasons, ``head_widths_m`` (P,) widths of heads; ``is_held`` (P,) says which eyes are at
    the depth of an earlier frame.
    """

    eyes_m: Float
    gaze: Float
    head: Float
    no_gaze: Codes
    head_widths_m: Float
    is_held: Flags


def _none(columns: tuple[str, ...]) -> Float:
    return np.zeros((0, len(columns)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasureColumns:
    """The errors of a clip's stages in the frames with ground truth, in their order, and the number of frames.

    ``disparities``, ``objects`` and ``people`` (n, 3, 3 and 4) have the columns :data:`OF_DISPARITY`,
    :data:`OF_OBJECT` and :data:`OF_PERSON`; ``truth_ids`` (n,) are the numbers of the true objects, of which ``labels``
    are the classes and ``names`` the run's names, as far as something was found for them. NaN: not known.
    """

    frames: int = 0
    disparities: Float = field(default_factory=lambda: _none(OF_DISPARITY))
    objects: Float = field(default_factory=lambda: _none(OF_OBJECT))
    people: Float = field(default_factory=lambda: _none(OF_PERSON))
    truth_ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    labels: Mapping[int, str] = field(default_factory=dict)
    names: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PairColumns:
    """One configuration on one clip: what its P people look at, of A values of attention.

    ``missing`` (P,) are codes of reasons for no answer; ``focus`` (P,) is the row of the instance with the most
    attention, :data:`UNKNOWN` for nowhere. ``attending`` (A,) is the row of the person, ``attended`` that of the
    instance; ``gaze`` and ``head`` (A,) are NaN where they were not measured. ``fits`` (P, 4) are the fields of
    :class:`vfoa.types.DirectionFit`, NaN without a fit. ``measures`` are those of the clip's stages.
    """

    clip: str
    configuration: str
    words: Words
    scene: SceneColumns
    looks: LookColumns
    missing: Codes
    focus: Codes
    attending: Codes
    attended: Codes
    gaze: Float
    head: Float
    total: Float
    fits: Float
    measures: MeasureColumns
