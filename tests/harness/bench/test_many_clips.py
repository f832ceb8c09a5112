"""The table of many small clips: the least of several runs, as a ratio to the pool's."""

from __future__ import annotations

from harness.bench.many_clips import Cost, many_clips_table


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
