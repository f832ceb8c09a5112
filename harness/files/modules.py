"""JavaScript modules as one script: a page that is opened from disk can load none, and a served page asks once."""

from __future__ import annotations

import re
from pathlib import Path

_IMPORT = re.compile(r'^import (?:\* as (\w+)|(\{[^}]*\})) from "\./(\w+)\.js";$', re.MULTILINE)
_EXPORT = re.compile(r"^export ((?:class|const|(?:async )?function) (\w+))", re.MULTILINE)


def bundle(entry: Path) -> str:
    """Join a module and everything that it imports, each module once and before its importers.

    A module imports names, or all names as one, from ``./NAME.js``, and exports constants, functions and classes. Each
    becomes a function of its own that returns its exports, so that two modules may use one name for different things.
    """
    texts: dict[str, str] = {}
    _add(entry.parent, entry.stem, texts, set())
    return '"use strict";\n(() => {\n' + "\n".join(texts.values()) + "})();\n"


def _add(folder: Path, name: str, texts: dict[str, str], begun: set[str]) -> None:
    begun.add(name)
    source = (folder / f"{name}.js").read_text(encoding="utf-8")
    for *_, needed in _IMPORT.findall(source):
        if needed not in begun:
            _add(folder, needed, texts, begun)
    exports = ", ".join(name for _, name in _EXPORT.findall(source))
    body = _EXPORT.sub(r"\1", _IMPORT.sub(lambda found: f"const {found[1] or found[2]} = module_{found[3]};", source))
    texts[name] = f"const module_{name} = (() => {{\n{body}return {{ {exports} }};\n}})();\n"
