"""The page's JavaScript modules as one script: a page that opens from disk can load no module."""

from __future__ import annotations

import re
from pathlib import Path

_IMPORT = re.compile(r'^import (\{[^}]*\}) from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:async )?(?:const|function) (\w+))", re.MULTILINE)


def bundle(entry: Path) -> str:
    """A module and all that it imports, each once and before what needs it.

    A module imports names from ``./NAME.js`` and exports constants and functions. Each becomes a function of its own
    that returns its exports, so that two may use one name for different things.
    """
    texts: dict[str, str] = {}
    _add(entry.parent, entry.stem, texts, set())
    return '"use strict";\n(() => {\n' + "\n".join(texts.values()) + "})();\n"


def _add(folder: Path, name: str, texts: dict[str, str], begun: set[str]) -> None:
    begun.add(name)
    source = (folder / f"{name}.js").read_text(encoding="utf-8")
    for _, needed in _IMPORT.findall(source):
        if needed not in begun:
            _add(folder, needed, texts, begun)
    exports = ", ".join(found for _, found in _EXPORT.findall(source))
    body = _EXPORT.sub(r"\1", _IMPORT.sub(r"const \1 = module_\2;", source))
    texts[name] = f"const module_{name} = (() => {{\n{body}return {{ {exports} }};\n}})();\n"
