"""The text of a manifest whose targets change: whatever way they are written in, comments and order stay."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.clips.manifest import load_manifest
from harness.clips.manifest_text import with_change, without_target
from tests.disk import write_text
from vfoa.errors import VfoaError

HEAD = 'name = "x"\nadapter = "studio"\n'
BOOK = '\n[targets.book]\ncategory = "book"\n'
WRITTEN = {
    "header": f'{HEAD}{BOOK}\n[targets.cup]  # red\ncategory = "cup"\n\n[subjects.ann]\ncategory = "person"\n',
    "quoted header": f"{HEAD}{BOOK}\n[ targets . 'cup' ]\ncategory = \"cup\"\n",
    "one table": f'{HEAD}\n[targets]\n# red\ncup = {{ category = "cup" }}\nbook = {{ category = "book" }}\n',
    "dotted": f'{HEAD}\n[targets]\n"cup".category = "cup"  # red\nbook.category = "book"\n',
    "dotted at the top": f'{HEAD}targets.cup.category = "cup"\ntargets.book.category = "book"\n',
    "apart": f'{HEAD}{BOOK}\n[subjects.cup2]\ncategory = "person"\n\n[targets.cup]\ncategory = "cup"\n',
    "named elsewhere": f'{HEAD}licence = """\n[targets.cups]\ncup"""\n{BOOK}\n[targets.cup]\ncategory = "cup"\n',
}


@pytest.mark.parametrize("written", WRITTEN)
@pytest.mark.parametrize("new_name", ["mug", "tea cup", "tässchen"])
def test_a_renamed_target_stays_where_it_was_written(written: str, new_name: str, tmp_path: Path) -> None:
    path = write_text(tmp_path / "x.toml", WRITTEN[written])
    before = load_manifest(str(path))
    text = with_change(path, "cup", new_name=new_name, key="9", colour="blue plain")
    path.write_text(text, encoding="utf-8")
    after = load_manifest(str(path))
    assert list(after.targets) == [new_name if name == "cup" else name for name in before.targets]
    assert (rule := after.targets[new_name]).formerly == ("cup",)
    assert (rule.key, rule.colour, rule.category) == ("9", "blue plain", "cup")
    assert after.subjects.keys() == before.subjects.keys()
    assert text.count("# red") == WRITTEN[written].count("# red")


@pytest.mark.parametrize(
    "text",
    [
        f'{HEAD}targets = {{ cup = {{ category = "cup" }} }}\n',
        f'{HEAD}licence = """\n[targets.cup]\n"""\n\n[targets.cup]\ncategory = "cup"\n',
    ],
    ids=["inline", "in a text"],
)
def test_what_cannot_be_renamed_safely_is_refused(text: str, tmp_path: Path) -> None:
    path = write_text(tmp_path / "x.toml", text)
    with pytest.raises(VfoaError, match=r"x\.toml.*by hand"):
        with_change(path, "cup", new_name="mug", key=None, colour="blue plain")


@pytest.mark.parametrize("written", WRITTEN)
def test_a_target_is_taken_out(written: str, tmp_path: Path) -> None:
    path = write_text(tmp_path / "x.toml", WRITTEN[written])
    path.write_text(without_target(path, "cup"), encoding="utf-8")
    assert list(load_manifest(str(path)).targets) == ["book"]
