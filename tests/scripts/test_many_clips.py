"""The table of many small clips: the least of several runs, as a ratio to the pool's."""

from __future__ import annotations

import pytest

from scripts.measure.many_clips import Cost, RunModel, many_clips_table, model_tables


def _cost(seconds: float, cpu_seconds: float, results: bytes = b"same") -> Cost:
    return Cost(seconds=seconds, cpu_seconds=cpu_seconds, results=results)


def test_the_least_runs_are_compared() -> None:
    pool, cluster = [_cost(10.0, 19.0), _cost(12.0, 18.0)], [_cost(13.0, 21.0), _cost(11.0, 27.0)]
    table = many_clips_table(200, {"pool": pool, "cluster": cluster})
    assert table.rows == (
        ("pool", "10.0", "1.00", "18.0", "1.00", "yes"),
        ("cluster", "11.0", "1.10", "21.0", "1.17", "yes"),
    )


def test_other_results_are_told() -> None:
    table = many_clips_table(2, {"pool": [_cost(1.0, 1.0)], "cluster": [_cost(1.0, 1.0, b"other")]})
    assert [row[-1] for row in table.rows] == ["yes", "no"]


def test_the_model_counts_whole_rounds_of_clips() -> None:
    model = RunModel(
        clips=32,
        serial_s=2.0,
        start_s=1.0,
        work_s={"match": 24.0, "write": 8.0},
        measured={1: (35.0, 34.0), 2: (20.0, 36.0)},
    )
    assert [model.seconds(workers) for workers in (1, 2, 4, 20, 32, 64)] == pytest.approx([34, 19, 11, 5, 4, 4])
    where, more = model_tables(model, (1, 32))
    assert where.rows[2] == ("match", "24.0", "71%")
    assert more.rows == (("1", "34.0", "1.0", "100%", "35.0", "34.0"), ("32", "4.0", "8.5", "27%", "–", "–"))
