"""Mutations that know a format: of the rows of a table, of the values in a tree, of the members of an archive."""

from __future__ import annotations

import csv
import io
import json
import tomllib
import warnings
import zipfile
from collections.abc import Sequence
from random import Random
from typing import Any
from xml.etree import ElementTree

from harness.toml_text import toml_key, toml_value
from tests.fuzz.bytewise import WORDS, Mutation, change_lines, exchange_word, flip

_VALUES: tuple[Any, ...] = (
    *(None, True, False, 0, -1, 1, 2, 1.5, 1e300, -1e-300, float("nan"), float("inf"), 2**31, 2**53, 2**63, 10**30),
    *("", "a", "é", "\0", "none", "nan", "1", "1e999", " ", "..", "x" * 300, "%d"),
    *([], {}, [[]], [{}], [None], {"": None}, [0, 1], ["a", "a"], {"a": 1}),
)


def _csv(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    text = data.decode("utf-8", "replace")
    delimiter = "\t" if "\t" in text.partition("\n")[0] else ","
    try:
        rows = list(csv.reader(io.StringIO(text, newline=""), delimiter=delimiter))
    except csv.Error:
        return exchange_word(rng, data, _)
    rows = [row for row in rows if row]
    if not rows:
        return data
    row = rng.choice(rows)
    at, what = rng.randrange(len(row)), rng.randrange(6)
    if what == 0:
        row[at] = rng.choice(WORDS)
    elif what == 1:
        row[at] = rng.choice(rng.choice(rows))
    elif what == 2:
        row.insert(at, rng.choice(WORDS))
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
        parent[rng.choice(WORDS) if what == 6 else f"{key}{rng.choice(WORDS)}"] = parent[key]
    else:
        parent.insert(key, json.loads(json.dumps(parent[key], default=str)))
    return tree


def _json(rng: Random, data: bytes, corpus: Sequence[bytes]) -> bytes:
    try:
        tree = json.loads(data)
    except (ValueError, RecursionError):
        return exchange_word(rng, data, corpus)
    return json.dumps(change_tree(rng, tree), default=str).encode()


def _jsonl(rng: Random, data: bytes, corpus: Sequence[bytes]) -> bytes:
    lines = data.split(b"\n")
    if rng.random() < 0.2:
        return change_lines(rng, data, corpus)
    at = rng.randrange(max(1, len(lines) - 1))
    lines[at] = _json(rng, lines[at], corpus).replace(b'"version": ', b'"version":')
    return b"\n".join(lines)


def _toml(rng: Random, data: bytes, corpus: Sequence[bytes]) -> bytes:
    try:
        tree = change_tree(rng, tomllib.loads(data.decode()))
        lines = [f"{toml_key(key)} = {toml_value(value)}\n" for key, value in tree.items() if value is not None]
    except Exception:  # of no more use as a tree
        return exchange_word(rng, data, corpus)
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
        return change_lines(rng, data, corpus)
    at = rng.choice(keys)
    word = rng.choice(WORDS).encode(errors="replace")
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
        return exchange_word(rng, data, corpus)
    elements = list(root.iter())
    element, other = rng.choice(elements), rng.choice(elements)
    what = rng.randrange(7)
    words = [word for word in WORDS if all(sign >= " " for sign in word) and word.isprintable()]
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
        return flip(rng, data, corpus)
    if not members:
        return data
    at, what = rng.randrange(len(members)), rng.randrange(8)
    name, content = members[at]
    if what == 0:
        del members[at]
    elif what == 1:
        members[at] = rng.choice((f"../{name}", name.upper(), "")), content
    else:
        members[at] = name, (_xml if what < 6 and b"<" in content[:100] else exchange_word)(rng, content, [content])
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as file, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a name that is there twice
        for name, content in members:
            file.writestr(zipfile.ZipInfo(name or "a"), content)
    return packed.getvalue()


STRUCTURED: dict[str, Mutation] = {
    "csv": _csv,
    "json": _json,
    "jsonl": _jsonl,
    "toml": _toml,
    "xml": _xml,
    "yaml": _yaml,
    "zip": _zip,
}
"""By the kind of a file."""
