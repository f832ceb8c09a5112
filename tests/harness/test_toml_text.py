from __future__ import annotations

import math
import tomllib
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.toml_text import parse_assignment, toml_key, toml_value
from vfoa.errors import VfoaError

TEXTS = st.text(st.characters(codec="utf-8"))
NUMBERS = st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False)
VALUES: st.SearchStrategy[Any] = st.recursive(
    TEXTS | NUMBERS | st.booleans(), lambda inner: st.lists(inner) | st.dictionaries(TEXTS, inner), max_leaves=10
)


@given(value=VALUES, key=TEXTS)
def test_every_value_comes_back(value: Any, key: str) -> None:
    assert tomllib.loads(f"{toml_key(key)} = {toml_value(value)}") == {key: value}


def test_what_json_has_no_words_for() -> None:
    assert math.isnan(tomllib.loads(f"a = {toml_value(math.nan)}")["a"])
    assert tomllib.loads(f"a = {toml_value({'here': 1, 'not': None})}") == {"a": {"here": 1}}


def test_a_name_that_is_not_unicode_is_one_line() -> None:
    with pytest.raises(VfoaError, match=r"'caf\\udce9': not UTF-8; expected a name that is"):
        toml_value({"root": "caf\udce9"})


@pytest.mark.parametrize(
    ("text", "expected"),
    [("a.b=1", ("a.b", 1)), ("a = [1, 2]", ("a", [1, 2])), ("a=word", ("a", "word")), ("a=b=c", ("a", "b=c"))],
)
def test_an_assignment_is_toml_where_it_can_be(text: str, expected: tuple[str, Any]) -> None:
    assert parse_assignment(text, "pass=final") == expected


def test_an_assignment_without_an_equals_sign_shows_the_example() -> None:
    with pytest.raises(VfoaError, match="--set a: expected KEY=VALUE, such as pass=final"):
        parse_assignment("a", "pass=final")
