"""The reference that a run is scored against."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from harness.labels.labels import Labels
from harness.run.published import Published


@dataclass(frozen=True, slots=True, kw_only=True)
class Reference:
    """Labels and frames by clip, and the notes that every table must show with the scores.

    A clip without labels is not scored. ``frames`` are those that were to be run, if they are fewer than the labels
    cover (a clip whose numbers have gaps, a run with a limit): a labelled one among them without a record is wrong.
    ``notes`` describe the clips and the experiment, such as how a view was made; ``published`` are published figures.
    ``says_nowhere`` are the configurations whose method can answer "looks at nothing", ``probabilistic`` those whose
    attention is a probability. ``unknown_names`` are names in the results of a clip that its manifest does not know:
    they can only be wrong. ``names_now`` are the present names of renamed targets by clip and name in the results.
    ``factors`` are the labels of each configuration's place in a grid, by dotted key; empty without a grid.
    """

    labels: Mapping[str, Labels]
    frames: Mapping[str, Iterable[int]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    published: Published | None = None
    says_nowhere: frozenset[str] = frozenset()
    probabilistic: frozenset[str] = frozenset()
    unknown_names: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    names_now: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    factors: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
