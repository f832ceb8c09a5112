from __future__ import annotations

import pytest

from vfoa.errors import did_you_mean


@pytest.mark.parametrize(("count", "others"), [(40, None), (41, "1 more"), (146, "106 more")])
def test_of_many_names_the_nearest_and_the_first_are_named(count: int, others: str | None) -> None:
    names = [f"session_{number:03d}" for number in range(count)]
    told = did_you_mean("sesion_039", reversed(names))
    assert told.startswith("did you mean 'session_039'? ")
    assert told.count("session_") == 1 + min(count, 40)
    assert told.endswith(f" and {others}" if others else "session_039")


def test_names_that_occur_several_times_are_named_once() -> None:
    assert did_you_mean("cup", ["person", "robot", "person"]) == "expected one of: person, robot"


@pytest.mark.parametrize("found", ["CUP", "Cup", "cups", "CUPS"])
def test_capitals_hide_no_name(found: str) -> None:
    assert did_you_mean(found, ["lamp", "cup", "Person"]).startswith("did you mean 'cup'? ")
    assert did_you_mean("PERSON", ["lamp", "cup", "Person"]).startswith("did you mean 'Person'? ")
