"""New targets, written into the clip's manifest; its comments and its order stay."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError

from harness.clips.manifest import ClipManifest
from harness.clips.naming import NameRule
from harness.config_errors import parse
from harness.data_folders import came_with_program
from harness.files import atomic_write, read_bytes
from vfoa.errors import VfoaError


def add_target(path: Path, name: str, rule: NameRule) -> None:
    """Write a target's rule at the end of the manifest's targets.

    Raises
    ------
    VfoaError
        If the name is taken or not a word, the rule contradicts another, or the manifest came with the package.
    """
    if came_with_program(path):
        raise VfoaError(f"{path} came with vfoa and is read-only; copy it to your own datasets/ to change its targets")
    text = read_bytes(path).decode()
    if name in tomllib.loads(text).get("targets", {}):
        raise VfoaError(f"{path}: targets.{name}: there already; expected a new name")
    changed = _with_target(path, text, name, rule.model_dump(mode="json", exclude_none=True))
    parse(ClipManifest, tomllib.loads(changed), str(path))
    atomic_write(path, changed)


def _with_target(path: Path, text: str, name: str, rule: dict[str, Any]) -> str:
    try:
        document = tomlkit.parse(text)
    except TOMLKitError as error:
        raise VfoaError(f"{path}: not TOML: {error}") from None
    if "targets" not in document:
        document["targets"] = tomlkit.table(is_super_table=True)
    table = tomlkit.table()
    table.update(rule)
    targets: Any = document["targets"]
    targets[name] = table
    return tomlkit.dumps(document)
