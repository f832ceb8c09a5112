"""Documents that can be read, documents that cannot, and small ones that would fill the memory or the stack."""

from __future__ import annotations

import io
import math
import os
import tomllib
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.files.digests import file_digest
from harness.files.io import read_bytes
from harness.files.parsing import (
    check_archive,
    parse_assignment,
    parse_json,
    parse_toml,
    parse_xml,
    parse_yaml,
    toml_key,
    toml_value,
)
from harness.sources.calibration_files.read import read_cameras
from vfoa.errors import VfoaError

PATH = Path("it")
TEXTS = st.text(st.characters(codec="utf-8"))
NUMBERS = st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False)
VALUES: st.SearchStrategy[Any] = st.recursive(
    TEXTS | NUMBERS | st.booleans(), lambda inner: st.lists(inner) | st.dictionaries(TEXTS, inner), max_leaves=10
)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "iso-8859-1"])
def test_a_file_says_its_encoding(encoding: str) -> None:
    declared = encoding.removesuffix("-sig")
    data = f'<?xml version="1.0" encoding="{declared}"?>\n<a>é</a>'.encode(encoding)
    assert parse_xml(data, Path("a.xml")).text == "é"


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", r"a\.xml:1: not XML: no element found"),
        (b"<a>\n<b>\n", r"a\.xml:3: not XML: "),
        (b'<?xml version="1.0" encoding="utg-8"?><a/>', r"a\.xml:1: not XML: unknown encoding"),
        (b'<?xml version="1.0" encoding="gb18030"?><a/>', r"a\.xml:1: not XML: multi-byte"),
        (b"<a>\xff</a>", r"a\.xml:1: not XML: "),
    ],
)
def test_what_is_no_xml_is_named_with_its_line(data: bytes, said: str) -> None:
    with pytest.raises(VfoaError, match=said):
        parse_xml(data, Path("a.xml"))


def test_entities_that_grow_without_end_are_refused() -> None:
    entities = "".join(f'<!ENTITY e{n} "{10 * f"&e{n - 1};"}">' for n in range(1, 12))
    data = f'<!DOCTYPE a [<!ENTITY e0 "{100 * "x"}">{entities}]><a>&e11;</a>'.encode()
    with pytest.raises(VfoaError, match="not XML: limit on input amplification"):
        parse_xml(data, Path("a.xml"))


def _nested(opening: str, closing: str, levels: int) -> str:
    return levels * opening + levels * closing


DEEP: dict[str, Callable[[int], Any]] = {
    "TOML arrays": lambda levels: parse_toml(f"a = {_nested('[', ']', levels - 1)}", PATH),
    "TOML keys": lambda levels: parse_toml(f"{'.'.join(levels * 'a')} = {{}}", PATH),
    "TOML keys in quotes": lambda levels: parse_toml("[" + ".".join(levels * ['"a b"']) + "]", PATH),
    "TOML keys with escapes": lambda levels: parse_toml("a = { " + ".".join(levels * [r'"\\"']) + " = 1 }", PATH),
    "JSON": lambda levels: parse_json(_nested("[", "]", levels), PATH),
    "YAML": lambda levels: parse_yaml(_nested("[", "]", levels), PATH),
    "XML": lambda levels: parse_xml(_nested("<a>", "</a>", levels).encode(), PATH),
}


@pytest.mark.parametrize("kind", DEEP)
def test_documents_of_very_many_levels_are_refused_and_of_few_are_read(kind: str) -> None:
    DEEP[kind](20)
    with pytest.raises(VfoaError, match="it: nested more than 100 levels deep"):
        DEEP[kind](100_000 if kind != "YAML" else 5_000)


@pytest.mark.parametrize("digits", [20, 5_000])
@pytest.mark.parametrize("parse", [parse_toml, parse_json], ids=["TOML", "JSON"])
def test_integers_of_more_than_64_bits_are_refused(parse: Callable[[str, object], Any], digits: int) -> None:
    text = "a = {}" if parse is parse_toml else '{{"a": {}}}'
    assert parse(text.format(2**63 - 1), PATH) == {"a": 2**63 - 1}
    with pytest.raises(VfoaError, match=r"it: .*64 bits"):
        parse(text.format(digits * "9"), PATH)


@pytest.mark.parametrize(
    "bomb",
    [
        "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n"
        + "".join(f"a{n}: &a{n} [{', '.join(10 * [f'*a{n - 1}'])}]\n" for n in range(1, 10)),
        "a0: &a0 {x: 1, y: 2}\n"
        + "".join(f"a{n}: &a{n} {{<<: [{', '.join(10 * [f'*a{n - 1}'])}]}}\n" for n in range(1, 10)),
    ],
    ids=["lists", "merged tables"],
)
def test_yaml_whose_aliases_multiply_is_refused(bomb: str, tmp_path: Path) -> None:
    path = tmp_path / "camchain.yaml"
    path.write_text(bomb)
    with pytest.raises(VfoaError, match=r"camchain\.yaml: .*1000000"):
        read_cameras([path], lambda: (64, 48))


def test_yaml_that_holds_itself_or_values_that_are_not_of_their_tag_is_refused() -> None:
    assert parse_yaml("a: &a [1, 2]\nb: *a", PATH) == {"a": [1, 2], "b": [1, 2]}
    assert parse_yaml("", PATH) is None
    with pytest.raises(VfoaError, match="it: nested more than"):
        parse_yaml("&a [*a]", PATH)
    for text in ("!!timestamp x", "!!bool x", "!!int ''", "2001-99-99", f"{5000 * '9'}", "!!binary é"):
        with pytest.raises(VfoaError, match="not YAML"):
            parse_yaml(text, PATH)
    with pytest.raises(VfoaError, match=r"it:3: not YAML: .*month must be in 1\.\.12; expected quotes"):
        parse_yaml("shot:\n  first: 2001-09-09\n  last: 2001-99-99\n", PATH)
    with pytest.raises(VfoaError, match="it:2: not YAML"):
        parse_yaml("a: 1\n b: [", PATH)


def _archive(content: bytes, name: str = "annotations.xml") -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(name, content)
    return data.getvalue()


def test_archives_of_zeros_are_refused_before_they_are_unpacked() -> None:
    ordinary = _archive(b"<annotations/>")
    check_archive(ordinary, PATH)
    bomb = _archive(bytes(50_000_000))
    with pytest.raises(VfoaError, match=r"^it: [0-9]+ bytes unpack to 50000000"):
        check_archive(bomb, PATH)
    check_archive(ordinary[:40], PATH)  # what unpacks it says that it is damaged


@pytest.mark.parametrize("read", [read_bytes, file_digest])
def test_a_pipe_in_place_of_a_file_is_refused_and_not_waited_for(read: Callable[[Path], Any], tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(VfoaError, match="pipe: not a plain file"):
        read(tmp_path / "pipe")


@given(value=VALUES, key=TEXTS)
def test_every_value_comes_back(value: Any, key: str) -> None:
    assert tomllib.loads(f"{toml_key(key)} = {toml_value(value)}") == {key: value}


def test_what_json_has_no_words_for() -> None:
    assert math.isnan(tomllib.loads(f"a = {toml_value(math.nan)}")["a"])
    assert tomllib.loads(f"a = {toml_value({'here': 1, 'not': None})}") == {"a": {"here": 1}}


def test_values_of_numpy_and_paths_are_those_of_the_file() -> None:
    values = {
        "n": np.int64(3),
        "cones": np.array([5.0, 12.5]),
        "is": np.bool_(1),
        "each": [np.float32(0.5)],
        "a": Path("b"),
    }
    found = tomllib.loads("\n".join(f"{key} = {toml_value(value)}" for key, value in values.items()))
    assert found == {"n": 3, "cones": [5.0, 12.5], "is": True, "each": [0.5], "a": "b"}


def test_a_name_that_is_not_unicode_is_one_line() -> None:
    with pytest.raises(VfoaError, match=r"'caf\\udce9': not UTF-8"):
        toml_value({"root": "caf\udce9"})


@pytest.mark.parametrize(
    ("text", "expected"),
    [("a.b=1", ("a.b", 1)), ("a = [1, 2]", ("a", [1, 2])), ("a=word", ("a", "word")), ("a=b=c", ("a", "b=c"))],
)
def test_an_assignment_is_toml_where_it_can_be(text: str, expected: tuple[str, Any]) -> None:
    assert parse_assignment(text, "pass=final") == expected


def test_an_assignment_without_an_equals_sign_shows_the_example() -> None:
    with pytest.raises(VfoaError, match=r"--set a: .*KEY=VALUE"):
        parse_assignment("a", "pass=final")
