"""The text of a clip's manifest with a target added, changed or deleted; comments and order are kept.

The first change writes every name's key and colour, so that they stay the same from then on.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from harness.clips.manifest import ClipManifest, make_manifest
from harness.clips.naming import NameRule, keys_and_colours
from harness.files.folders import came_with_program
from harness.files.io import read_bytes
from harness.files.parsing import parse_toml
from harness.files.safe_names import composed
from vfoa.errors import VfoaError, check_known
from vfoa.validation import parse


def with_target(path: Path, name: str, rule: NameRule) -> str:
    """Return the text with a target's rule at the end of the manifest's targets; it gets the next free key and colour.

    Raises
    ------
    VfoaError
        If the name is taken or not a word, the rule contradicts another, or the manifest came with the program.
    """
    document, manifest = _open(path)
    if name in manifest.targets:
        raise VfoaError(f"{path}: targets.{name}: exists already; expected a new name")
    if "targets" not in document:
        document["targets"] = tomlkit.table(is_super_table=True)
    targets: Any = document["targets"]
    targets[name] = _table(rule)
    _text(path, document)  # refuses a wrong rule before its look is found among the others'
    look = keys_and_colours({**manifest.targets, **manifest.subjects, name: rule})[name]
    for key, value in (("key", look.key), ("colour", look.colour)):
        if value is not None:
            targets[name].setdefault(key, value)
    return _text(path, document)


def with_change(path: Path, name: str, *, new_name: str, key: str | None, colour: str) -> str:
    """Return the text that gives a target another name, key or colour; a subject, another key or colour. None: no key.

    Earlier names stay in the manifest (``formerly``): results of runs have them.

    Raises
    ------
    VfoaError
        If there is no such target, the name or the key is taken, or the manifest came with the program.
    """
    document, manifest = _open(path)
    is_subject = name in manifest.subjects
    table: Any = document["subjects"] if is_subject else _targets(path, document, name)
    if key is None:
        table[name].pop("key", None)
    else:
        table[name]["key"] = key
    table[name]["colour"] = colour
    if new_name != name:
        if is_subject:
            raise VfoaError(
                f"{path}: found the name of a subject; expected a target: to rename a subject, edit it here and in the "
                "annotation files"
            )
        if new_name in {*manifest.targets, *manifest.subjects}:
            raise VfoaError(f"{path}: targets.{new_name}: exists already; expected a new name")
        table[name]["formerly"] = [former for former in (*table[name].get("formerly", ()), name) if former != new_name]
        plain = document.unwrap()
        plain["targets"] = {new_name if target == name else target: rule for target, rule in plain["targets"].items()}
        return _checked(path, _renamed(tomlkit.dumps(document), name, new_name), plain)
    return _text(path, document)


def without_target(path: Path, name: str) -> str:
    """Return the text without a target.

    Raises
    ------
    VfoaError
        If there is no such target, or the manifest came with the program.
    """
    document, _ = _open(path)
    del _targets(path, document, name)[name]
    return _text(path, document)


def _open(path: Path) -> tuple[tomlkit.TOMLDocument, ClipManifest]:
    """The manifest, and its text with every key and colour written down."""
    if came_with_program(path):
        raise VfoaError(f"{path} came with vfoa and is read-only; copy it to your own datasets/ to change its targets")
    text = read_bytes(path).decode()
    plain = parse_toml(text, path)
    manifest = make_manifest(plain, path)
    for name in (*plain.get("subjects", ()), *plain.get("targets", ())):
        text = text.replace(name, composed(name))
    try:
        document = tomlkit.parse(text)
    except TOMLKitError as error:
        raise VfoaError(f"{path}: not TOML: {error}") from None
    for name, look in keys_and_colours({**manifest.targets, **manifest.subjects}).items():
        tables: Any = document["targets" if name in manifest.targets else "subjects"]
        if look.key is not None and "key" not in tables[name]:
            tables[name]["key"] = look.key
        tables[name].setdefault("colour", look.colour)
    return document, manifest


def _text(path: Path, document: tomlkit.TOMLDocument) -> str:
    return _checked(path, tomlkit.dumps(document), document.unwrap())


def _checked(path: Path, text: str, expected: dict[str, Any]) -> str:
    """Return the text; reject one that is not a manifest, or that does not express the intended change."""
    plain = parse_toml(text, path)
    parse(ClipManifest, plain, str(path))
    if plain != expected:
        raise VfoaError(f"{path}: the targets cannot be changed automatically; edit the file by hand")
    return text


def _targets(path: Path, document: tomlkit.TOMLDocument, name: str) -> Any:
    targets: Any = document.get("targets", {})
    check_known(name, targets, f"{path}: no target")
    return targets


def _table(rule: NameRule) -> Any:
    table = tomlkit.table()
    table.update(rule.model_dump(mode="json", exclude_defaults=True))
    return table


def _renamed(text: str, name: str, new_name: str) -> str:
    """The text in which a target's key is another one: in the headers of its tables, or before its values."""
    old = "|".join(map(re.escape, (name, f'"{name}"', f"'{name}'")))
    new = new_name if re.fullmatch(r"[\w-]+", new_name, re.ASCII) else json.dumps(new_name, ensure_ascii=False)
    lines, table = [], ""
    for line in text.splitlines(keepends=True):
        if header := re.match(r"\s*\[+\s*(.*?)\s*\]", line):
            table = header[1]
            before = r"\s*\[\s*targets\s*\.\s*"
        else:
            before = {"": r"\s*targets\s*\.\s*", "targets": r"\s*"}.get(table, "(?!)")
        lines.append(re.sub(rf"^({before})(?:{old})(?=\s*[].=])", lambda key: key[1] + new, line))
    return "".join(lines)
