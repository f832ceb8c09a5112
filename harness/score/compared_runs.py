"""Runs side by side: configurations ranked, compared on common frames, and the frames that changed their verdict."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import combinations, groupby
from pathlib import Path

from harness.run.directory import RunDirectory
from harness.run.grid import base_of
from harness.run.manifest import differences_in_common
from harness.score.comparison import Comparison, compare, compare_pairs
from harness.score.finished_run import FinishedRun, read_scores
from harness.score.oracle_ablation import without_oracles
from harness.score.rows import ScoreRow
from harness.score.score import Scores
from harness.score.subset import Condition
from harness.score.verdicts import Verdict
from vfoa.errors import VfoaError


@dataclass(frozen=True, slots=True, kw_only=True)
class RankedRow:
    """The scores of a configuration of a run over all its clips. ``name`` is ``run/configuration``."""

    name: str
    run: Path
    scores: ScoreRow


@dataclass(frozen=True, slots=True, kw_only=True)
class VerdictChange:
    """Frames of a subject, one after the other, that two configurations judge differently, with the same answers.

    ``reference`` and ``configuration`` are the names in :class:`Comparison`; ``before`` and ``after`` are their
    verdicts on the first of the frames. The answers of both are the same on all ``frames``.
    """

    reference: str
    configuration: str
    frames: tuple[int, ...]
    before: Verdict
    after: Verdict

    @property
    def is_better(self) -> bool:
        """Whether the configuration is right where the reference is wrong."""
        return self.after.outcome == "correct"


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparedRuns:
    """Runs side by side. ``scores`` are in the order given, the baseline first; the oracle ablation is left out.

    ``comparisons`` of the same configuration are next to each other.
    """

    scores: Mapping[Path, Scores]
    comparisons: tuple[Comparison, ...]
    places: Mapping[str, tuple[Path, str]] = field(repr=False)
    """The run and the configuration of each name ``run/configuration``."""

    def ranked(self) -> list[RankedRow]:
        """Every configuration of every run, by the FRR on all labelled frames of its run, the best first."""
        rows = [
            RankedRow(name=_named(run, row.configuration), run=run, scores=row)
            for run, scores in self.scores.items()
            for row in scores.rows.overall
            if _named(run, row.configuration) in self.places
        ]
        return sorted(rows, key=lambda row: -row.scores.frr)

    @property
    def uncompared(self) -> list[str]:
        """The configurations that no comparison names."""
        compared = {name for comparison in self.comparisons for name in comparison.names}
        return [name for name in self.places if name not in compared]

    def made_otherwise(self) -> dict[Path, str]:
        """The runs that were made otherwise than the first one, and in what."""
        first, *others = (RunDirectory(run) for run in self.scores)
        made = first.read_manifest()
        found = {run.path: differences_in_common(made, run.read_manifest()) for run in others}
        return {run: different for run, different in found.items() if different}

    def relabelled(self) -> dict[Path, list[str]]:
        """The runs whose own tables are of earlier labels, and the clips of which these are."""
        found = {run: FinishedRun.read(RunDirectory(run)).relabelled() for run in self.scores}
        return {run: clips for run, clips in found.items() if clips}

    def changes(self) -> Iterator[VerdictChange]:
        """Yield the frames that are right in one configuration of a comparison and wrong in the other, in order.

        Seeds are compared one by one.
        """
        of_runs = {run: _verdicts(scores) for run, scores in self.scores.items()}
        verdicts = {name: of_runs[run].get(configuration, {}) for name, (run, configuration) in self.places.items()}
        for comparison in self.comparisons:
            reference, configuration = (verdicts[name] for name in comparison.names)
            for track, before in reference.items():
                after = configuration.get(track, {})
                pairs = ((before[frame], after[frame]) for frame in before if frame in after)
                for is_change, stretch in groupby(pairs, _judged):
                    if is_change:
                        found = list(stretch)
                        frames = tuple(first.frame for first, _ in found)
                        yield VerdictChange(
                            reference=comparison.reference,
                            configuration=comparison.configuration,
                            frames=frames,
                            before=found[0][0],
                            after=found[0][1],
                        )


def compare_runs(runs: Sequence[Path], baseline: Path | None = None, where: Sequence[Condition] = ()) -> ComparedRuns:
    """Compare the configurations of runs on their common frames, named ``run/configuration``.

    With a baseline, each configuration is compared with the baseline's of the same name. Otherwise those of one run
    are compared with each other, and those of several runs with the ones of the same name; where no two runs have a
    name in common, all are compared with each other. Holm's correction is over all comparisons.

    Parameters
    ----------
    where
        Only labelled frames that meet all of these conditions.

    Raises
    ------
    VfoaError
        If a run cannot be scored, two runs are the same directory, their labels differ, or the baseline lacks a
        configuration or has no frame in common with it.
    """
    folders = _distinct([*([] if baseline is None else [baseline]), *runs])
    scores = {run: read_scores(RunDirectory(run), where) for run in folders}
    places = {
        _named(run, name): (run, name)
        for run, of_run in scores.items()
        for name in without_oracles(of_run.scored_configurations)
    }
    frames = {name: scores[run].frames_of(configuration) for name, (run, configuration) in places.items()}
    if baseline is None:
        pairs = [pair for pair in combinations(places, 2) if places[pair[0]][1] == places[pair[1]][1]]
        order = list(dict.fromkeys(configuration for _, configuration in places.values()))
        pairs.sort(key=lambda pair: order.index(places[pair[0]][1]))
        with _annotators_named(folders):
            comparisons = compare_pairs(frames, pairs) if pairs else compare(frames)
    else:
        pairs = [
            (_counterpart(run, name, baseline, places), _named(run, name))
            for run, name in places.values()
            if run != baseline
        ]
        with _annotators_named(folders):
            comparisons = compare_pairs(frames, pairs)
        for comparison in comparisons:
            if comparison.n == 0:
                run, name = places[comparison.configuration]
                raise VfoaError(f"{run}: configuration {name!r} has no scored frame in common with {baseline}")
    return ComparedRuns(scores=scores, comparisons=comparisons, places=places)


@contextmanager
def _annotators_named(runs: Sequence[Path]) -> Iterator[None]:
    """End the messages of errors in the block with the annotators of the runs' labels, if they differ."""
    try:
        yield
    except VfoaError as error:
        of_runs = {run: RunDirectory(run).read_manifest().scored_annotator for run in runs}
        if len({*of_runs.values()}) == 1:
            raise
        said = "; ".join(
            f"{run}: the clip's" if who is None else f"{run}: those of {who!r}" for run, who in of_runs.items()
        )
        raise VfoaError(f"{error} ({said}; `vfoa score RUN --annotator NAME` scores against others)") from None


def _named(run: Path, configuration: str) -> str:
    return f"{run}/{configuration}"


def _counterpart(run: Path, name: str, baseline: Path, places: Mapping[str, tuple[Path, str]]) -> str:
    """The baseline's configuration of the same name."""
    if (counterpart := _named(baseline, name)) not in places:
        known = ", ".join(configuration for of_run, configuration in places.values() if of_run == baseline)
        raise VfoaError(f"{baseline}: has no configuration {name!r} of {run}; found {known}")
    return counterpart


def _verdicts(scores: Scores) -> dict[str, dict[tuple[str, str, str], dict[int, Verdict]]]:
    """The scored verdicts of each configuration by clip, subject and seed, and by frame in order."""
    found: dict[str, dict[tuple[str, str, str], dict[int, Verdict]]] = {}
    for verdict in scores.verdicts:
        if verdict.outcome != "unscored":
            configuration = base_of(verdict.configuration)
            track = verdict.clip, verdict.subject, verdict.configuration.removeprefix(configuration)
            found.setdefault(configuration, {}).setdefault(track, {})[verdict.frame] = verdict
    return found


def _judged(verdicts: tuple[Verdict, Verdict]) -> tuple[str | None, ...] | None:
    """What stays the same in a stretch of frames that two configurations judge differently; None if they agree."""
    before, after = verdicts
    if before.outcome == after.outcome:
        return None
    return before.outcome, before.truth, before.predicted, after.predicted, before.error_type, after.error_type


def _distinct(runs: Sequence[Path]) -> list[Path]:
    places = [run.resolve() for run in runs]
    for run, place in zip(runs, places, strict=True):
        if places.count(place) > 1:
            raise VfoaError(f"{run}: given twice; expected different runs")
    return list(runs)
