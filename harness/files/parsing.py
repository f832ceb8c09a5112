"""TOML, YAML, XML, JSON and ZIP of unknown origin: parsed within bounds, with an error of one line.

A small file can make a parser recurse, or fill the memory: brackets within brackets, aliases of aliases, an archive of
zeros. Everything that the program reads in these formats goes through this file.
"""

from __future__ import annotations

import codecs
import io
import json
import math
import os
import re
import tomllib
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from xml.etree.ElementTree import Element, ParseError, fromstring

from harness.files.io import read_text
from vfoa.errors import VfoaError, first_line

if TYPE_CHECKING:
    import yaml

Kind = TypeVar("Kind")

MOST_LEVELS = 100
"""Most levels of nested tables; real files have fewer than ten."""
MOST_VALUES = 1_000_000
"""Most values of a TOML or YAML document, including those that an alias repeats."""
MOST_TAGS = 20_000_000
"""Most tags of an XML document, or values of a JSON document."""
MOST_UNPACKED_BYTES = 2**30
MOST_COMPRESSION = 250
"""Most unpacked bytes per packed one. Labels in XML compress to a fiftieth, zeros to a thousandth."""
LARGEST_INTEGER = 2**64 - 1
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
_PART = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+"""
_LONG_KEY = re.compile(rf"(?:^|[\[{{,])[ \t]*+(?:{_PART}){{{MOST_LEVELS},}}", re.MULTILINE)
"""A dotted key: tomllib takes time quadratic in its number of parts."""

_YAML_DAMAGE = (ValueError, OverflowError, RecursionError, KeyError, IndexError, TypeError, AttributeError)
"""Exceptions of PyYAML, beside its own, for values that do not match their tag."""


def read_toml(path: Path) -> dict[str, Any]:
    """Read a TOML file.

    Raises
    ------
    VfoaError
        If there is no such file, or it is not TOML; the message names the line.
    """
    return parse_toml(read_text(path), path)


def parse_toml(text: str, where: object) -> dict[str, Any]:
    """Parse a TOML document.

    Raises
    ------
    VfoaError
        If it is not TOML (with the line), too deep, or has an integer of more than 64 bits.
    """
    if _LONG_KEY.search(text):
        raise _too_deep(where)
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise VfoaError(f"{where}: not TOML: {error}") from None
    except RecursionError:
        raise _too_deep(where) from None
    except ValueError:  # Python reads no integer of more than 4300 digits
        raise _too_large(where) from None
    _check(document, where)
    return document


def parse_json(data: str | bytes, where: object) -> Any:
    """Parse a JSON document.

    Raises
    ------
    VfoaError
        If it is not JSON, too deep, or has an integer of more than 64 bits.
    """
    try:
        document = json.loads(data)
    except RecursionError:
        raise _too_deep(where) from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise VfoaError(f"{where}: not JSON: {error}") from None
    except ValueError:  # Python reads no integer of more than 4300 digits
        raise _too_large(where) from None
    _check(document, where, most=MOST_TAGS)
    return document


def parse_json_as(kind: type[Kind], data: bytes, where: object) -> Kind:
    """Parse a JSON document of known keys, a ``msgspec.Struct``; others are skipped. For files of many values.

    Raises
    ------
    VfoaError
        If it is not JSON or too deep, or a value is not of its type: where it is in the document.
    """
    import msgspec

    try:
        return msgspec.json.decode(data.removeprefix(codecs.BOM_UTF8), type=kind, strict=False)
    except msgspec.ValidationError as error:
        problem, _, key = str(error).partition(" - at `$")
        raise VfoaError(f"{where}: {key.strip('.`') or 'the document'}: {problem}") from None
    except RecursionError:
        raise _too_deep(where) from None
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        raise VfoaError(f"{where}: not JSON: {error}") from None


def parse_yaml(data: str | bytes, where: object, kind: type[yaml.SafeLoader] | None = None) -> Any:
    """Parse a YAML document of plain values; ``kind`` is a loader that knows more types.

    Raises
    ------
    VfoaError
        If it is not YAML (with the line), too deep, or its aliases repeat too much.
    """
    import yaml

    node, kind = None, kind or yaml.SafeLoader
    try:
        loader = kind(data)
        try:
            if (node := loader.get_single_node()) is None:
                return None
            _check_levels([node], _nodes_below, where)
            document = loader.construct_document(node)
        finally:
            loader.dispose()
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = "" if mark is None else f":{mark.line + 1}"
        raise VfoaError(f"{where}{line}: not YAML: {getattr(error, 'problem', None) or 'cannot be parsed'}") from None
    except RecursionError:
        raise _too_deep(where) from None
    except _YAML_DAMAGE as error:
        line = "" if node is None or (found := _unreadable(node, kind(""))) is None else f":{found.start_mark.line + 1}"
        problem = f"a value cannot be read as its type: {first_line(error)}"
        raise VfoaError(
            f"{where}{line}: not YAML: {problem}; expected quotes around a text that looks like a date or a number"
        ) from None
    _check(document, where)
    return document


def parse_xml(data: bytes, path: Path) -> Element:
    """Return the outermost element of a file's content. Expat itself refuses entities that grow without end.

    Raises
    ------
    VfoaError
        If it is not XML (with the line), too deep or too large, or names an unknown encoding.
    """
    if data.count(b"<") > MOST_TAGS:
        raise VfoaError(f"{path}: has more than {MOST_TAGS} tags; expected a smaller document")
    try:
        root = fromstring(data)
    except ParseError as error:
        raise VfoaError(f"{path}:{error.position[0]}: not XML: {error}") from None
    except (LookupError, ValueError) as error:
        raise VfoaError(f"{path}:1: not XML: {error}") from None
    _check_levels([root], list, path, most=2 * MOST_TAGS)
    return root


def check_archive(data: bytes, where: object) -> None:
    """Reject a ZIP archive, to be unpacked by a library, that unpacks to more than a user's file can have.

    Damage is left to the library to find.

    Raises
    ------
    VfoaError
        If it unpacks to more.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = archive.infolist()
    except Exception:  # errors of zipfile for damaged archives have no common base class
        return
    packed, unpacked = (sum(getattr(member, size) for member in members) for size in ("compress_size", "file_size"))
    if unpacked > min(MOST_UNPACKED_BYTES, max(MOST_COMPRESSION * packed, 2**20)):
        raise VfoaError(f"{where}: {packed} bytes unpack to {unpacked}; expected an archive of ordinary files")


def toml_key(key: str) -> str:
    """One part of a key, in quotes if it needs them."""
    return key if _BARE_KEY.fullmatch(key) else _text(key)


def toml_value(value: Any) -> str:
    """A JSON value, an array or a number of NumPy, or a path as TOML text.

    A null in a table is left out, since TOML has no null.

    Raises
    ------
    VfoaError
        If a text is not Unicode: a file's name of other bytes.
    """
    if hasattr(value, "tolist"):  # of NumPy, which is not imported for this
        return toml_value(value.tolist())
    if isinstance(value, os.PathLike):
        return _text(os.fspath(value))
    if isinstance(value, dict):
        pairs = (f"{toml_key(key)} = {toml_value(item)}" for key, item in value.items() if item is not None)
        return "{ " + ", ".join(pairs) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    if isinstance(value, str):
        return _text(value)
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return json.dumps(value)


def _text(text: str) -> str:
    """Text in JSON's quotes, which are valid TOML except for one control character."""
    if not text.isascii():
        try:
            text.encode()
        except UnicodeEncodeError:
            raise VfoaError(f"{text!a}: not UTF-8; expected a name in UTF-8") from None
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def parse_assignment(text: str, example: str) -> tuple[str, Any]:
    """Parse ``KEY=VALUE`` of the option ``--set``: the value is TOML if it is valid TOML, else a string.

    Raises
    ------
    VfoaError
        If there is no equals sign; the message shows the example.
    """
    key, equals, value = text.partition("=")
    if not equals:
        raise VfoaError(f"--set {text}: expected KEY=VALUE, such as {example}")
    try:
        return key.strip(), parse_toml(f"value = {value}", "--set")["value"]
    except VfoaError:
        return key.strip(), value.strip()


def flattened(tables: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of nested tables by dotted key."""
    for key, value in tables.items():
        if isinstance(value, Mapping):
            yield from flattened(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def differing_keys(one: Any, other: Any, path: str = "") -> Iterator[str]:
    """The dotted keys, below ``path``, under which two values of a document differ."""
    if one == other:
        return
    if not isinstance(one, dict) or not isinstance(other, dict):
        yield path
        return
    for key in dict.fromkeys((*other, *one)):
        yield from differing_keys(one.get(key), other.get(key), f"{path}.{key}" if path else key)


def _check(document: Any, where: object, *, most: int = MOST_VALUES) -> None:
    """Reject a document that is too deep, too large, or has an integer of more than 64 bits."""

    def below(value: Any) -> Iterable[Any]:
        if isinstance(value, int):  # first: a run's manifest has two for each frame
            if abs(value) > LARGEST_INTEGER:
                raise _too_large(where)
            return ()
        if isinstance(value, dict):
            return value.values()
        return value if isinstance(value, list | tuple | set) else ()

    _check_levels([document], below, where, most=most)


def _nodes_below(node: yaml.Node) -> Iterable[yaml.Node]:
    """The nodes of a list; keys and values of a table."""
    below = node.value if isinstance(node.value, list) else ()
    return [child for item in below for child in (item if isinstance(item, tuple) else (item,))]


def _unreadable(document: yaml.Node, loader: yaml.SafeLoader) -> yaml.Node | None:
    """A single value that the loader cannot read as its type."""
    import yaml

    level = [document]
    while level:
        for node in level:
            try:
                if not isinstance(node.value, list):
                    loader.construct_object(node)
            except (*_YAML_DAMAGE, yaml.YAMLError):
                return node
        level = [child for node in level for child in _nodes_below(node)]
    return None


def _check_levels(level: list[Any], below: Any, where: object, *, most: int = MOST_VALUES) -> None:
    """Go through a document level by level, without recursion, and stop when it exceeds the limits."""
    count = 0
    for _ in range(MOST_LEVELS):
        next_level: list[Any] = []
        for value in level:
            next_level += below(value)
            if count + len(next_level) > most:
                raise VfoaError(f"{where}: has more than {most} values; expected a smaller document")
        if not next_level:
            return
        count += len(next_level)
        level = next_level
    raise _too_deep(where)


def _too_deep(where: object) -> VfoaError:
    return VfoaError(f"{where}: nested more than {MOST_LEVELS} levels deep; expected a document of few levels")


def _too_large(where: object) -> VfoaError:
    return VfoaError(f"{where}: holds an integer of more than 64 bits; expected numbers within 64 bits")
