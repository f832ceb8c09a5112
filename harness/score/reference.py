"""What a run is scored against: the labels of its clips, the frames that count, and what is known of its answers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

from harness.labels.labels import Labels
from harness.run.manifest import AnswerTraits, Published
from harness.run.notes import Note


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Labels and frames by clip, and the notes that every table must show with the scores.

    A clip without labels is not scored. ``frames`` are those that were to be run, if they are fewer than the labels
    cover (a clip whose numbers have gaps, a run with a limit): a labelled frame without a record counts as wrong.
    ``notes`` describe the clips and the experiment, such as how a view was made; ``published`` are published figures.
    ``traits`` say what the answers of each configuration are; the defaults hold of one that is not there.
    ``unknown_names`` are names in the results of a clip that its manifest does not know: they can only be wrong.
    ``names_now`` are the present names of renamed targets by clip and name in the results.
    ``factors`` are the labels of each configuration's place in a grid, by dotted key; empty without a grid.
    ``settings`` are those of each configuration as JSON values, for advice; empty if not known. ``phases`` are those of
    each clip that has some, by the number of things beside people in a frame. ``is_recorded`` says whether the run has
    recordings, for advice. ``all_labels`` are those of all frames if ``labels`` are those that meet conditions:
    baselines are fitted to them, as a rule that was fitted to frames of one target would know the answer.
    """

    labels: Mapping[str, Labels]
    all_labels: Mapping[str, Labels] | None = None
    frames: Mapping[str, Iterable[int]] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    published: Published | None = None
    traits: Mapping[str, AnswerTraits] = field(default_factory=dict)
    unknown_names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    names_now: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    factors: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    phases: Mapping[str, Mapping[int, str]] = field(default_factory=dict)
    is_recorded: bool = True

    def wanted_frames(self, clip: str) -> list[int]:
        """The frames of a clip that are scored if they have a label, in order."""
        if (frames := self.frames.get(clip)) is not None:
            return sorted(set(frames))
        ranges = labels.ranges if (labels := self.labels.get(clip)) else ()
        return sorted({frame for row in ranges for frame in range(row.first_frame, row.last_frame + 1)})
