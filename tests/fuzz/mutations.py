"""Files that are almost right: seeded mutations of whole files, of their bytes and of what their format means.

The same generator gives the same bytes, so that a case is named by its parser, its seed and its number.
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
from typing import Any, Literal
from xml.etree import ElementTree

from harness.toml_text import toml_key, toml_value

Kind = Literal["binary", "text", "csv", "json", "jsonl", "toml", "xml", "yaml", "zip"]
Mutation = Callable[[Random, bytes, Sequence[bytes]], bytes]

MOST_BYTES = 1 << 18
"""No case is longer, or twice the longest whole file."""
_MOST_MUTATIONS = 4

_WORDS = (
    *("", " ", "\t", "\n", "\r", "\0", "\x1b[2J", "é", "漢", "\u2028", "\ufeff", "\udc80"),
    *("%s", "%n", "{}", "..", "/", "=", "NaN", "None"),
    *("nan", "inf", "-inf", "none", "ignore", "null", "true", "-0", "0", "-1", "1", "1.5", "1e-300", "1e300", "1e999"),
    *("2147483648", "4294967296", "9223372036854775807", "9223372036854775808", "-9223372036854775809"),
    *("99999999999999999999", "0x7f", "1_0", "٣", "²", "[", "]", "{", "}", '"', "'", "\\", "#", "&", "<", "]]>", "!!x"),
    *("9" * 400, "a" * 3000, "../../x", "1970-01-01", "&a", "*a", "${CLIP}", "%d", "%099999999d"),
)
_INTEGERS = (0, 1, 2, *((1 << bits) - less for bits in (7, 8, 15, 16, 31, 32, 63, 64) for less in (0, 1)))
_VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2, 1.5, 1e300, -1e-300, float("nan"), float("inf"), 2**31, 2**53, 2**63, 10**30),
    *("", "a", "é", "\0", "none", "nan", "1", "1e999", " ", "..", "x" * 300, "%d"),
    *([], {}, [[]], [{}], [None], {"": None}, [0, 1], ["a", "a"], {"a": 1}),
)


def mutate(rng: Random, data: bytes, corpus: Sequence[bytes], kind: Kind) -> bytes:
    """One to four mutations of a file, half of them of its structure where the kind has one."""
    most = max(MOST_BYTES, 2 * max(map(len, corpus)))
    for _ in range(rng.randint(1, _MOST_MUTATIONS)):
        structured = _STRUCTURED.get(kind)
        if structured is not None and rng.random() < 0.6:
            data = structured(rng, data, corpus)
        elif kind != "binary" and kind != "zip" and rng.random() < 0.6:
            data = rng.choice(_TEXTUAL)(rng, data, corpus)
        else:
            data = rng.choice(_BYTEWISE)(rng, data, corpus)
    return data[:most]


# Bytes


def _place(rng: Random, data: bytes) -> tuple[int, int]:
    first = rng.randrange(len(data) + 1)
    return first, min(len(data), first + rng.choice((1, 2, 4, 8, 16, 64, 300)))


def _flip(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    changed = bytearray(data)
    for _each in range(rng.choice((1, 1, 2, 8)) if data else 0):
        changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _number(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """An interesting integer, or the one there a little changed, over 1, 2, 4 or 8 bytes."""
    code, size = rng.choice((("B", 1), ("H", 2), ("I", 4), ("Q", 8)))
    if len(data) < size:
        return data
    at, order = rng.randrange(len(data) - size + 1), rng.choice("<>")
    (there,) = struct.unpack_from(order + code, data, at)
    value = rng.choice(_INTEGERS) if rng.random() < 0.6 else there + rng.choice((-16, -1, 1, 16))
    return data[:at] + struct.pack(order + code, value % (1 << 8 * size)) + data[at + size :]


def _truncate(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _drop(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    first, last = _place(rng, data)
    return data[:first] + data[last:]


def _double(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    first, last = _place(rng, data)
    return data[:last] + data[first:last] * rng.choice((1, 1, 3, 50)) + data[last:]


def _insert(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.randbytes(rng.choice((1, 2, 4, 8, 32))) + data[at:]


def _zero(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    first, last = _place(rng, data)
    return data[:first] + rng.choice((b"\0", b"\xff")) * (last - first) + data[last:]


def _splice(rng: Random, data: bytes, corpus: Sequence[bytes]) -> bytes:
    """A piece of a whole file over, or into, this one."""
    other = rng.choice(corpus)
    first, last = _place(rng, other)
    at = rng.randrange(len(data) + 1)
    return data[:at] + other[first:last] + data[at + rng.choice((0, last - first)) :]


_BYTEWISE: tuple[Mutation, ...] = (_flip, _flip, _number, _number, _truncate, _drop, _double, _insert, _zero, _splice)


# Text


def _word(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """Another word or number in the place of one."""
    matches = list(re.finditer(rb"[\w.+-]+", data))
    if not matches:
        return data
    match = rng.choice(matches)
    words = [rng.choice(_WORDS).encode(errors="surrogatepass"), rng.choice(matches)[0]]
    return data[: match.start()] + rng.choice(words) + data[match.end() :]


def _lines(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """A line dropped, doubled, moved, pushed in or out, or joined with the next."""
    lines = data.splitlines(keepends=True)
    if not lines:
        return data
    at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
    what = rng.randrange(6)
    if what == 0:
        del lines[at]
    elif what == 1:
        lines.insert(to, lines[at])
    elif what == 2:
        lines[at], lines[to] = lines[to], lines[at]
    elif what == 3:
        lines[at] = rng.choice((b"  ", b"- ", b"\t", b"#", b",")) + lines[at]
    elif what == 4:
        lines[at] = lines[at].lstrip()
    else:
        lines[at] = lines[at].rstrip(b"\r\n")
    return b"".join(lines)


_TEXTUAL: tuple[Mutation, ...] = (_word, _word, _word, _lines, _splice, _flip, _truncate)


# Structure


def _csv(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    text = data.decode("utf-8", "replace")
    delimiter = "\t" if "\t" in text.partition("\n")[0] else ","
    try:
        rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=delimiter))
    except csv.Error:
        return _word(rng, data, _)
    rows = [row for row in rows if row]
    if not rows:
        return data
    row = rng.choice(rows)
    at, what = rng.randrange(len(row)), rng.randrange(6)
    if what == 0:
        row[at] = rng.choice(_WORDS)
    elif what == 1:
        row[at] = rng.choice(rng.choice(rows))
    elif what == 2:
        row.insert(at, rng.choice(_WORDS))
    elif what == 3:
        del row[at]
    elif what == 4:
        for each in rows:  # a column gone, or there twice
            each[at : at + 1] = each[at : at + 1] * rng.choice((0, 2)) if rng.random() < 0.95 else [""]
    else:
        rows.insert(rng.randrange(len(rows) + 1), list(row))
    written = io.StringIO()
    csv.writer(written, delimiter=delimiter, lineterminator=rng.choice(("\n", "\n", "\r\n"))).writerows(rows)
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
        return rng.choice(_VALUES)
    parent, key = rng.choice(places)
    what, (other_parent, other_key) = rng.randrange(8), rng.choice(places)
    if what <= 2:
        parent[key] = rng.choice(_VALUES)
    elif what == 3:
        parent[key] = json.loads(json.dumps(other_parent[other_key], default=str))
    elif what == 4:
        del parent[key]
    elif what == 5:
        parent[key] = rng.choice(([parent[key]], {"a": parent[key]}, str(parent[key])))
    elif isinstance(parent, dict):
        parent[rng.choice(_WORDS) if what == 6 else f"{key}{rng.choice(_WORDS)}"] = parent[key]
    else:
        parent.insert(key, json.loads(json.dumps(parent[key], default=str)))
    return tree


def _json(rng: Random, data: bytes, corpus: Sequence[bytes]) -> bytes:
    try:
        tree = json.loads(data)
    except (ValueError, RecursionError):
        return _word(rng, data, corpus)
    return json.dumps(change_tree(rng, tree), default=str).encode()


def _jsonl(rng: Random, data: bytes, corpus: Sequence[bytes]) -> bytes:
    lines = data.split(b"\n")
    if rng.random() < 0.2:
        return _lines(rng, data, corpus)
    at = rng.randrange(max(1, len(lines) - 1))
    lines[at] = _json(rng, lines[at], corpus).replace(b'"version": ', b'"version":')
    return b"\n".join(lines)


def _toml(rng: Random, data: bytes, corpus: Sequence[bytes]) -> bytes:
    try:
        tree = change_tree(rng, tomllib.loads(data.decode()))
        lines = [f"{toml_key(key)} = {toml_value(value)}\n" for key, value in tree.items() if value is not None]
    except Exception:  # of no more use as a tree
        return _word(rng, data, corpus)
    return "".join(lines).encode(errors="surrogatepass")


_YAML_VALUES = (
    *(b"", b"[]", b"{}", b"~", b"[[1]]", b"{a: b}"),
    *(b"!!opencv-matrix {}", b"&a [*a]", b"<<", b"2001-01-01", b"0o7"),
)


def _yaml(rng: Random, data: bytes, corpus: Sequence[bytes]) -> bytes:
    """Another value behind a key, or none, with or without the lines that are pushed in below it."""
    lines = data.split(b"\n")
    keys = [number for number, line in enumerate(lines) if b":" in line]
    if not keys or rng.random() < 0.3:
        return _lines(rng, data, corpus)
    at = rng.choice(keys)
    word = rng.choice(_WORDS).encode(errors="replace")
    lines[at] = lines[at].partition(b":")[0] + b": " + rng.choice((*_YAML_VALUES, word))
    if rng.random() < 0.5:
        indent = len(lines[at]) - len(lines[at].lstrip())
        while at + 1 < len(lines) and len(lines[at + 1]) - len(lines[at + 1].lstrip()) > indent:
            del lines[at + 1]
    return b"\n".join(lines)


def _xml(rng: Random, data: bytes, corpus: Sequence[bytes]) -> bytes:
    try:
        root = ElementTree.fromstring(data)
    except (ElementTree.ParseError, LookupError, ValueError):
        return _word(rng, data, corpus)
    elements = list(root.iter())
    element, other = rng.choice(elements), rng.choice(elements)
    what = rng.randrange(7)
    words = [word for word in _WORDS if all(sign >= " " for sign in word) and word.isprintable()]
    if what <= 1 and element.attrib:
        element.set(rng.choice(list(element.attrib)), rng.choice(words))
    elif what == 2:
        element.text = rng.choice(words)
    elif what == 3 and element.attrib:
        del element.attrib[rng.choice(list(element.attrib))]
    elif what == 4 and len(element):
        element.remove(rng.choice(list(element)))
    elif what == 5 and element is not other and element not in list(other.iter()):
        element.append(other)  # as it is: written twice
        if root in list(other.iter()):
            element.remove(other)
    else:
        element.tag = rng.choice([each.tag for each in elements])
    return ElementTree.tostring(root)


def _zip(rng: Random, data: bytes, corpus: Sequence[bytes]) -> bytes:
    """A member changed, removed or doubled."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as file:
            members = [(info.filename, file.read(info)) for info in file.infolist()]
    except Exception:  # of no more use as an archive
        return _flip(rng, data, corpus)
    if not members:
        return data
    at, what = rng.randrange(len(members)), rng.randrange(8)
    name, content = members[at]
    if what == 0:
        del members[at]
    elif what == 1:
        members[at] = rng.choice((f"../{name}", name.upper(), "")), content
    else:
        members[at] = name, (_xml if what < 6 and b"<" in content[:100] else _word)(rng, content, [content])
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a name that is there twice
        for name, content in members:
            file.writestr(zipfile.ZipInfo(name or "a"), content)
    return packed.getvalue()


_STRUCTURED: dict[Kind, Mutation] = {
    "csv": _csv,
    "json": _json,
    "jsonl": _jsonl,
    "toml": _toml,
    "xml": _xml,
    "yaml": _yaml,
    "zip": _zip,
}
