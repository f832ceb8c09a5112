"""Files that are almost right: a strategy that damages whole ones in their bytes, words and lines, or structure.

An example is a whole file and up to four mutations, each with a seed for its own choices: Hypothesis shrinks a failing
one to the mutations that it needs.
"""

from __future__ import annotations

import csv
import io
import json
import re
import struct
import tomllib
import warnings
import zipfile
from collections.abc import Callable, Sequence
from random import Random
from typing import Any
from xml.etree import ElementTree

from hypothesis import strategies as st

from harness.files.parsing import toml_key, toml_value

Mutation = Callable[[Random, bytes, Sequence[bytes]], bytes]

MOST_BYTES = 1 << 18
"""No example is longer, or twice the longest whole file."""
WORDS = (
    *("", " ", "\t", "\n", "\r", "\0", "\x1b[2J", "é", "漢", "\u2028", "\ufeff", "\udc80"),
    *("%s", "%n", "{}", "..", "/", "=", "NaN", "None"),
    *("nan", "inf", "-inf", "none", "ignore", "null", "true", "-0", "0", "-1", "1", "1.5", "1e-300", "1e300", "1e999"),
    *("2147483648", "4294967296", "9223372036854775807", "9223372036854775808", "-9223372036854775809"),
    *("99999999999999999999", "0x7f", "1_0", "٣", "²", "[", "]", "{", "}", '"', "'", "\\", "#", "&", "<", "]]>", "!!x"),
    *("9" * 400, "a" * 3000, "../../x", "1970-01-01", "&a", "*a", "${CLIP}", "%d", "%099999999d"),
)
VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2, 1.5, 1e300, -1e-300, float("nan"), float("inf"), 2**31, 2**53, 2**63, 10**30),
    *("", "a", "é", "\0", "none", "nan", "1", "1e999", " ", "..", "x" * 300, "%d", "text"),
    *([], {}, [[]], [{}], [None], {"": None}, [0, 1], ["a", "a"], {"a": 1}),
)
INTEGERS = (0, 1, 2, *((1 << bits) - less for bits in (7, 8, 15, 16, 31, 32, 63, 64) for less in (0, 1)))
YAML_VALUES = (
    *(b"", b"[]", b"{}", b"~", b"[[1]]", b"{a: b}"),
    *(b"!!opencv-matrix {}", b"&a [*a]", b"<<", b"2001-01-01", b"0o7"),
)


def damaged(whole: Sequence[bytes], kind: str) -> st.SearchStrategy[bytes]:
    """One of these files of a kind (``csv``, ``json``, ..., ``binary``) after one to four mutations."""
    ways = [*BYTEWISE]
    if kind not in ("binary", "zip"):
        ways += 2 * TEXTUAL
    if kind in STRUCTURED:
        ways += 2 * len(ways) * [STRUCTURED[kind]]
    # Hypothesis prefers small numbers in wider ranges
    steps = st.lists(st.tuples(st.sampled_from(ways), st.integers(0, 2**24 - 1)), min_size=1, max_size=4)

    def mutated(data: bytes, steps: list[tuple[Mutation, int]]) -> bytes:
        for way, seed in steps:
            data = way(Random(seed), data, whole)
        return data[: max(MOST_BYTES, 2 * max(map(len, whole)))]

    return st.builds(mutated, st.sampled_from(whole), steps)


# Bytes


def _place(rng: Random, data: bytes) -> tuple[int, int]:
    first = rng.randrange(len(data) + 1)
    return first, min(len(data), first + rng.choice((1, 2, 4, 8, 16, 64, 300)))


def flip(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    changed = bytearray(data)
    for _each in range(rng.choice((1, 1, 2, 8)) if data else 0):
        changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def number(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """An extreme integer, or the one there a little changed, over 1, 2, 4 or 8 bytes."""
    code, size = rng.choice((("B", 1), ("H", 2), ("I", 4), ("Q", 8)))
    if len(data) < size:
        return data
    at, order = rng.randrange(len(data) - size + 1), rng.choice("<>")
    (there,) = struct.unpack_from(order + code, data, at)
    value = rng.choice(INTEGERS) if rng.random() < 0.6 else there + rng.choice((-16, -1, 1, 16))
    return data[:at] + struct.pack(order + code, value % (1 << 8 * size)) + data[at + size :]


def cut(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def replace(rng: Random, data: bytes, whole: Sequence[bytes]) -> bytes:
    """A piece dropped, doubled, inserted, made 0 or 255, or taken from a whole file."""
    first, last = _place(rng, data)
    piece = data[first:last]
    what = rng.randrange(6)
    if what < 2:
        piece = (b"", piece * rng.choice((2, 2, 4, 51)))[what]
    elif what == 2:
        piece = rng.randbytes(rng.choice((1, 2, 4, 8, 32))) + piece
    elif what == 3:
        piece = rng.choice((b"\0", b"\xff")) * len(piece)
    else:
        other = rng.choice(whole)
        begin, end = _place(rng, other)
        piece = other[begin:end] + rng.choice((b"", piece))
    return data[:first] + piece + data[last:]


# Text


def word(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """Another word or number in the place of one."""
    matches = list(re.finditer(rb"[\w.+-]+", data))
    if not matches:
        return data
    match = rng.choice(matches)
    new = rng.choice([rng.choice(WORDS).encode(errors="surrogatepass"), rng.choice(matches)[0]])
    return data[: match.start()] + new + data[match.end() :]


def line(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """A line dropped, doubled, exchanged, pushed in or out, or joined with the next."""
    lines = data.splitlines(keepends=True)
    if not lines:
        return data
    at, to, what = rng.randrange(len(lines)), rng.randrange(len(lines)), rng.randrange(5)
    if what == 0:
        del lines[at]
    elif what == 1:
        lines.insert(to, lines[at])
    elif what == 2:
        lines[at], lines[to] = lines[to], lines[at]
    elif what == 3:
        lines[at] = rng.choice((b"  ", b"- ", b"\t", b"#", b",")) + lines[at]
    else:
        lines[at] = rng.choice((lines[at].lstrip(), lines[at].rstrip(b"\r\n")))
    return b"".join(lines)


# Structure: each raises any exception for a file that is damaged already


def cells(rng: Random, data: bytes) -> bytes:
    """A cell or a column of a table exchanged, doubled or dropped, or a row doubled."""
    text = data.decode("utf-8", "replace")
    delimiter = "\t" if "\t" in text.partition("\n")[0] else ","
    rows = [row for row in csv.reader(io.StringIO(text, newline=""), delimiter=delimiter) if row]
    row, what = rng.choice(rows), rng.randrange(5)
    at = rng.randrange(len(row))
    if what < 3:
        new = rng.choice((rng.choice(WORDS), rng.choice(rng.choice(rows))))
        row[at : at + (what != 1)] = [] if what == 2 else [new]
    elif what == 3:
        for each in rows:
            each[at : at + 1] = each[at : at + 1] * rng.choice((0, 2)) if rng.random() < 0.95 else [""]
    else:
        rows.insert(rng.randrange(len(rows) + 1), list(row))
    written = io.StringIO()
    csv.writer(written, delimiter=delimiter, lineterminator=rng.choice(("\n", "\r\n"))).writerows(rows)
    return written.getvalue().encode(errors="surrogatepass")


def change_tree(rng: Random, tree: Any) -> Any:
    """Plain values with one of them exchanged, removed, doubled, renamed or wrapped."""
    places: list[tuple[Any, Any]] = []

    def visit(node: Any) -> None:
        for key, value in node.items() if isinstance(node, dict) else enumerate(node):
            places.append((node, key))
            if isinstance(value, dict | list):
                visit(value)

    if not isinstance(tree, dict | list) or (visit(tree) or not places):
        return rng.choice(VALUES)
    parent, key = rng.choice(places)
    what, (other_parent, other_key) = rng.randrange(8), rng.choice(places)
    if what <= 2:
        parent[key] = rng.choice(VALUES)
    elif what == 3:
        parent[key] = json.loads(json.dumps(other_parent[other_key], default=str))
    elif what == 4:
        del parent[key]
    elif what == 5:
        parent[key] = rng.choice(([parent[key]], {"a": parent[key]}, str(parent[key])))
    elif isinstance(parent, dict):
        parent[rng.choice(WORDS) if what == 6 else f"{key}{rng.choice(WORDS)}"] = parent[key]
    else:
        parent.insert(key, json.loads(json.dumps(parent[key], default=str)))
    return tree


def json_tree(rng: Random, data: bytes) -> bytes:
    return json.dumps(change_tree(rng, json.loads(data)), default=str).encode()


def json_lines(rng: Random, data: bytes) -> bytes:
    lines = data.split(b"\n")
    at = rng.randrange(max(1, len(lines) - 1))
    lines[at] = json_tree(rng, lines[at]).replace(b'"version": ', b'"version":')
    return b"\n".join(lines)


def toml_tree(rng: Random, data: bytes) -> bytes:
    tree = change_tree(rng, tomllib.loads(data.decode()))
    lines = [f"{toml_key(key)} = {toml_value(value)}\n" for key, value in tree.items() if value is not None]
    return "".join(lines).encode(errors="surrogatepass")


def yaml_lines(rng: Random, data: bytes) -> bytes:
    """Another value behind a key, or none, with or without the lines that are pushed in below it."""
    lines = data.split(b"\n")
    at = rng.choice([number for number, each in enumerate(lines) if b":" in each])
    value = rng.choice((*YAML_VALUES, rng.choice(WORDS).encode(errors="replace")))
    lines[at] = lines[at].partition(b":")[0] + b": " + value
    if rng.random() < 0.5:
        indent = len(lines[at]) - len(lines[at].lstrip())
        while at + 1 < len(lines) and len(lines[at + 1]) - len(lines[at + 1].lstrip()) > indent:
            del lines[at + 1]
    return b"\n".join(lines)


def xml_tree(rng: Random, data: bytes) -> bytes:
    """An attribute, a text or a name exchanged, or an element moved, doubled or dropped."""
    elements = list((root := ElementTree.fromstring(data)).iter())
    element, other, what = rng.choice(elements), rng.choice(elements), rng.randrange(7)
    new = rng.choice([each for each in WORDS if each.isprintable()])
    if what <= 1 and element.attrib:
        element.set(rng.choice(list(element.attrib)), new)
    elif what == 2:
        element.text = new
    elif what == 3 and element.attrib:
        del element.attrib[rng.choice(list(element.attrib))]
    elif what == 4 and len(element):
        element.remove(rng.choice(list(element)))
    elif what == 5 and element not in list(other.iter()):
        element.append(other)  # as it is: written twice
        if root in list(other.iter()):
            element.remove(other)
    else:
        element.tag = rng.choice(elements).tag
    return ElementTree.tostring(root)


def members(rng: Random, data: bytes) -> bytes:
    """A member of an archive changed, removed or renamed."""
    with zipfile.ZipFile(io.BytesIO(data)) as file:
        found = [(info.filename, file.read(info)) for info in file.infolist()]
    at, what = rng.randrange(len(found)), rng.randrange(8)
    name, content = found.pop(at)
    if what == 1:
        found.append((rng.choice((f"../{name}", name.upper(), "a")), content))
    elif what > 1:
        found.insert(at, (name, (XML if what < 6 and b"<" in content[:100] else word)(rng, content, [content])))
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a name that is there twice
        for name, content in found:
            file.writestr(zipfile.ZipInfo(name), content)
    return packed.getvalue()


def _or(change: Callable[[Random, bytes], bytes], other: Mutation) -> Mutation:
    """A change of structure, or another mutation where a file has none any more."""

    def way(rng: Random, data: bytes, whole: Sequence[bytes]) -> bytes:
        try:
            return change(rng, data)
        except Exception:  # of any parser
            return other(rng, data, whole)

    return way


XML = _or(xml_tree, word)
BYTEWISE: list[Mutation] = [flip, flip, number, number, cut, replace, replace, replace]
TEXTUAL: list[Mutation] = [word, word, word, line, replace, flip, cut]
STRUCTURED: dict[str, Mutation] = {
    "csv": _or(cells, word),
    "json": _or(json_tree, word),
    "jsonl": _or(json_lines, line),
    "xml": XML,
    "toml": _or(toml_tree, word),
    "yaml": _or(yaml_lines, line),
    "zip": _or(members, flip),
}
