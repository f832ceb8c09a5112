from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import Field

from harness.files.parsing import read_toml
from tests.disk import write_bytes, write_text
from vfoa.errors import VfoaError
from vfoa.settings import Settings
from vfoa.validation import parse


class _Inner(Settings):
    depth_m: float = 1.0
    kind: str = Field(default="a", alias="type")


class _Outer(Settings):
    inner: _Inner = _Inner()
    several: tuple[_Inner, ...] = ()
    named: dict[str, _Inner | None] = Field(default_factory=dict)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ({"iner": {}}, "f: unknown key 'iner'; did you mean 'inner'? expected one of: inner, named, several"),
        (
            {"inner": {"depth": 1}},
            "f: unknown key 'inner.depth'; did you mean 'depth_m'? expected one of: depth_m, type",
        ),
        (
            {"several": [{}, {"typ": 1}]},
            "f: unknown key 'several.1.typ'; did you mean 'type'? expected one of: depth_m, type",
        ),
        (
            {"named": {"x": {"typ": 1}}},
            "f: unknown key 'named.x.typ'; did you mean 'type'? expected one of: depth_m, type",
        ),
        ({"inner": {"depth_m": float("nan")}}, "f: inner.depth_m: expected a finite number, found nan"),
        (
            {"inner": 3, "several": 4},
            "f: inner: expected a table, found 3 (and 1 more)",
        ),
    ],
)
def test_a_mistake_is_one_line(data: object, message: str) -> None:
    with pytest.raises(VfoaError) as error:
        parse(_Outer, data, "f")
    assert str(error.value) == message


def test_the_table_stands_before_the_key() -> None:
    with pytest.raises(VfoaError, match=r"^f: unknown key 'source\.inner\.x'; "):
        parse(_Outer, {"inner": {"x": 1}}, "f", "source")


def test_files_that_are_no_toml_are_named(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"gone\.toml: no such file"):
        read_toml(tmp_path / "gone.toml")
    with pytest.raises(VfoaError, match=r"latin\.toml:1: not UTF-8 .*0xe9"):
        read_toml(write_bytes(tmp_path / "latin.toml", b'a = "\xe9"'))
    with pytest.raises(VfoaError, match=r"twice\.toml: not TOML: .*line 2"):
        read_toml(write_text(tmp_path / "twice.toml", "a = 1\na = 2\n"))
