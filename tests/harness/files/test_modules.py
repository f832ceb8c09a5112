"""JavaScript modules as one script: what a browser makes of it, and that the pages' modules fit together."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

import harness
from harness.files.modules import bundle
from tests.disk import write_text

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

PAGES = [Path(harness.__file__).parent / page for page in ("annotate/page", "report/page")]
SHARED = """
export const LEAST = 2;
export class Kept {
    static count = 40;
}
export async function later() {
    return LEAST;
}
const hidden = "shared";
"""
FIRST = """
import { Kept, LEAST } from "./shared.js";

const hidden = Kept.count;
export const sum = () => hidden + LEAST;
"""
MAIN = """
import * as shared from "./shared.js";
import {
    sum,
} from "./first.js";

document.title = [sum(), typeof shared.hidden, typeof later, shared.later() instanceof Promise, this].join();
"""


def test_modules_do_in_one_script_what_they_do_apart(browser: Chrome, tmp_path: Path) -> None:
    for name, source in (("shared", SHARED), ("first", FIRST), ("main", MAIN)):
        write_text(tmp_path / f"{name}.js", source)
    browser.execute_script(bundle(tmp_path / "main.js"))
    assert browser.title == "42,undefined,undefined,true,"


def _named(text: str) -> list[tuple[str, str]]:
    """Every name that a module takes from another one, with that module."""
    found = [
        (module, each.strip())
        for names, module in re.findall(r'^import \{([^}]*)\} from "\./(\w+)\.js";$', text, re.MULTILINE)
        for each in names.split(",")
        if each.strip()
    ]
    for alias, module in re.findall(r'^import \* as (\w+) from "\./(\w+)\.js";$', text, re.MULTILINE):
        found += [(module, each) for each in re.findall(rf"(?<![./\w]){alias}\.(\w+)", text)]
    return found


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.parent.name)
def test_every_name_that_a_module_imports_is_exported_there(page: Path) -> None:
    texts = {path.stem: path.read_text(encoding="utf-8") for path in page.glob("*.js")}
    exported = {
        name: set(re.findall(r"^export (?:async )?(?:class|const|function) (\w+)", text, re.MULTILINE))
        for name, text in texts.items()
    }
    imported = [(name, *each) for name, text in texts.items() for each in _named(text)]
    assert imported
    assert [each for each in imported if each[2] not in exported[each[1]]] == []


ENTRIES = {"labelling": PAGES[0] / "main.js", "report": PAGES[1] / "main.js", "comparison": PAGES[1] / "compare.js"}


@pytest.mark.parametrize("entry", ENTRIES.values(), ids=ENTRIES)
def test_no_import_and_no_export_is_left(entry: Path) -> None:
    assert not re.search(r"^\s*(?:import|export) ", bundle(entry), re.MULTILINE)
