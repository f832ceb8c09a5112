"""The benchmark of scoring scores what it says."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.bench import scoring
from harness.bench.scoring import time_scoring
from harness.bench.tables import scoring_table
from harness.report.write import rescore
from harness.run.directory import RunDirectory
from harness.score.score import Scores


def test_every_round_scores_a_whole_run_against_other_labels(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[Scores] = []
    pages: list[bool] = []

    def watched(directory: RunDirectory) -> Scores:
        seen.append(rescore(directory))
        pages.append(Path(directory.path / "report.html").is_file())
        return seen[-1]

    monkeypatch.setattr(scoring, "rescore", watched)
    timing = time_scoring(frames=60, configurations=2, subjects=2, rounds=2)
    assert pages == [True, True]
    first, second = ([row.frr for row in scores.by_clip()] for scores in seen)
    assert all(row.n == 120 for scores in seen for row in scores.by_clip())
    assert len(first) == 2
    assert first != second
    assert len(seen[0].measures.pooled()) == 2
    assert scoring_table([timing]).rows[0][:3] == ("60", "2", "2")
