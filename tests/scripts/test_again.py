"""The table of runs again says how many times faster than the first one they are."""

from __future__ import annotations

from scripts.measure.again import Seconds, again_table


def test_a_run_again_is_compared_with_the_first_one() -> None:
    first, again = (Seconds(start=9.0, plan=0.1, run=run, score=2.0) for run in (60.0, 2.4))
    table = again_table("demo", {"as it is": first, "other cones": again})
    assert table.rows == (
        ("as it is", "60.00", "1.0", "0.10", "2.00", "9.00"),
        ("other cones", "2.40", "25.0", "0.10", "2.00", "9.00"),
    )
