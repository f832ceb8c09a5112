"""XML that can be read, and XML that cannot."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.xml_text import parse_xml
from vfoa.errors import VfoaError


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
