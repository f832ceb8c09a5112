"""The documents: commands that parse, names and links that exist, a notebook that runs."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import BaseModel
from typer.main import get_command

import harness
from harness.cli import app
from harness.clips.manifest import ClipManifest
from harness.files.folders import names
from harness.pipeline.settings_reference import setting_keys
from harness.run.experiment import _File
from harness.run.tables import TABLES
from harness.score.verdicts import ERROR_TYPES
from harness.sources import ADAPTERS
from scripts.pictures import PICTURES
from scripts.quoted_figures import renewed
from scripts.site_pages import columns_page, commands_page, settings_page
from tests.repository import REPOSITORY
from vfoa.validation import _models_in

PAGES = sorted(
    path
    for pattern in (
        "*.md",
        "docs/**/*.md",
        "datasets/*.md",
        "annotations/*.md",
        "reports/README.md",
        ".github/**/*.yml",
    )
    for path in REPOSITORY.glob(pattern)
)
PLACEHOLDERS = re.compile(
    r"^(my_\w+|kitchen(_p\d+)?|dragon|desk|talk|CLIP|NAME|X|PATH|MODEL|[A-Z]{2,}|.*\.(toml|mcap|rrd)|<.*)$"
)
"""Names that stand for a reader's own clip or experiment."""

COMMANDS: Any = get_command(app)
"""The program's commands, apart from those that it runs: a context without its parent changes them."""

SIMULATED = {
    "stereo.matcher": "truth",
    "segmentation.model": "truth",
    "heads.detector": "truth",
    "head_pose.model": "simulated",
    "gaze.model": "simulated",
}


def _shown(text: str) -> Iterator[str]:
    """Every ``vfoa`` command in code blocks: to be typed as it stands."""
    for block in re.findall(r"^```(?:console|text)?\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        for line in re.sub(r"\\\n\s*", " ", block).splitlines():
            command = re.sub(r"^(\$ )?([A-Z_]+=\S+ )*", "", line.strip())
            if command.startswith("vfoa "):
                yield command


def _mentioned(text: str) -> Iterator[str]:
    """Every ``vfoa`` command in the running text, which may leave out what it needs."""
    yield from (" ".join(code.split()) for code in re.findall(r"`(vfoa [a-z][^`.]*)`", text))


CASES = sorted(
    {
        (page.relative_to(REPOSITORY).as_posix(), command, is_whole)
        for page in PAGES
        for is_whole, find in ((True, _shown), (False, _mentioned))
        for command in find(page.read_text(encoding="utf-8"))
    }
)


@pytest.mark.parametrize(("page", "command", "is_whole"), CASES)
def test_every_command_of_the_documents_is_one(page: str, command: str, is_whole: bool) -> None:
    known, words = COMMANDS, shlex.split(command, comments=True)[1:]
    while words and hasattr(known, "commands"):
        assert words[0] in known.commands, f"{page}: no command {words[0]!r}"
        known = known.commands[words.pop(0)]
    required = [word.strip("[]") for word in words]
    known.make_context("vfoa", required, resilient_parsing=not is_whole)
    existing = {"benchmark", "paper_cases", *names("experiments"), *names("datasets")}
    if known.name == "run" and words:
        assert words[0] in existing or PLACEHOLDERS.match(words[0]), f"{page}: no experiment or clip {words[0]!r}"
    for before, word in pairwise(words):
        if before == "--set" and known.name == "run":
            key = word.split("=")[0]
            if words[0] == "benchmark":  # METHOD.key in place of attention.key
                key = f"attention.{key.partition('.')[2]}"
            assert key in {*setting_keys(), "attention.method"}
        if before == "--clip":
            assert word in existing or PLACEHOLDERS.match(word)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(REPOSITORY).as_posix())
def test_every_link_inside_the_repository_leads_to_a_file(page: Path) -> None:
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    places = [place.partition("#")[0] for place in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in place]
    generated = {"settings.md", "columns.md", "commands.md", "clips.md", "annotations.md", "reports.md"}
    missing = [place for place in places if place and not page.parent.joinpath(place).exists()]
    assert [place for place in missing if Path(place).name not in generated] == []


def test_every_page_is_in_the_navigation() -> None:
    text = re.sub(r"^.*?^nav:", "nav:", (REPOSITORY / "mkdocs.yml").read_text(encoding="utf-8"), flags=re.S | re.M)
    listed = {page for part in yaml.safe_load(text)["nav"] for entry in part.values() for page in _leaves(entry)}
    pages = {path.relative_to(REPOSITORY / "docs").as_posix() for path in (REPOSITORY / "docs").rglob("*.md")}
    assert pages - listed == set()


def _leaves(entry: object) -> list[str]:
    if isinstance(entry, list):
        return [leaf for each in entry for inner in each.values() for leaf in _leaves(inner)]
    return [str(entry)]


def test_the_generated_pages_have_every_setting_and_every_command() -> None:
    settings, page = settings_page(), commands_page()
    assert [
        key for key in setting_keys() if f"`{key}`" not in settings and f"`{key.split('.')[1]} =" not in settings
    ] == []
    assert [
        name for name, command in COMMANDS.commands.items() if not command.hidden if f"## vfoa {name}" not in page
    ] == []


def test_the_page_of_columns_has_every_column_of_the_tables_of_frames() -> None:
    page = columns_page().partition("# Tables of frames")[2]
    sections = {part.partition("\n")[0]: part for part in page.split("\n## ")[1:]}
    assert sections.keys() == TABLES.keys()
    assert [
        (name, key) for name, columns in TABLES.items() for key in columns if f"| `{key}` |" not in sections[name]
    ] == []


def _keys(model: type[BaseModel]) -> set[str]:
    """The keys of a table and of the tables in it, as a file has them."""
    fields = model.model_fields.items()
    nested = (_keys(each) for _, field in fields for each in _models_in(field.annotation))
    return {field.alias or name for name, field in fields}.union(*nested)


def test_every_key_of_an_experiment_is_documented() -> None:
    page = (REPOSITORY / "docs" / "frr-table.md").read_text(encoding="utf-8")
    _, _, rest = page.partition("### All keys of an experiment")
    section, _, _ = rest.partition("\n## ")
    words = set(re.findall(r"\w+", " ".join(re.findall(r"`([^`]+)`", section))))
    assert _keys(_File) - words == set()


def test_every_key_of_a_manifest_is_documented() -> None:
    page = (REPOSITORY / "datasets" / "README.md").read_text(encoding="utf-8")
    words = set(re.findall(r"\w+", page))
    settings = [ADAPTERS.load(name).Settings for name in ADAPTERS.names()]
    assert set().union(*map(_keys, [ClipManifest, *settings])) - words == set()


def test_the_page_of_statistics_has_every_error_type_in_their_order() -> None:
    page = (REPOSITORY / "docs/concepts/statistics.md").read_text(encoding="utf-8")
    section = page.partition("## Error types")[2].partition("\n## ")[0]
    assert re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE) == [*ERROR_TYPES]


def test_every_picture_is_drawn_by_the_committed_script() -> None:
    drawn = {f"{make.__name__}.svg" for make in PICTURES}
    assert {path.name for path in (REPOSITORY / "docs/pictures").glob("*.svg")} == drawn


def test_the_notebook_runs_and_shows_a_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    run = harness.run_experiment("default", clips=["studio_crowd"], settings=SIMULATED, out=tmp_path / "run", limit=5)
    assert not run.failures.empty
    monkeypatch.setenv("VFOA_RUN", str(run.path))
    monkeypatch.setenv("PYTHONPATH", str(REPOSITORY))
    monkeypatch.setenv("JUPYTER_PREFER_ENV_PATH", "1")
    notebook = nbformat.read(REPOSITORY / "docs/notebooks/finished_run.ipynb", as_version=4)
    nbclient.NotebookClient(
        notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": tmp_path}}
    ).execute()
    kinds = [kind for cell in notebook.cells for output in cell.get("outputs", []) for kind in output.get("data", {})]
    assert "image/png" in kinds
    assert "application/vnd.jupyter.widget-view+json" in kinds


def test_figures_in_documents_are_those_of_the_reports() -> None:
    stale = [page.name for page in PAGES if renewed(text := page.read_text(encoding="utf-8")) != text]
    assert stale == []


def test_every_report_is_listed_with_the_command_that_made_it() -> None:
    reports = REPOSITORY / "reports"
    listed = re.findall(r"^\| `(\w+\.md)` \| .*`.+`", (reports / "README.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert sorted(listed) == sorted({path.name for path in reports.glob("*.md")} - {"README.md"})


def test_a_figure_that_differs_from_its_report_is_replaced() -> None:
    source = "figure: reports/demo.md | Focus recognition rate | (all), sgbm-two | FRR %"
    stale = f"right in <!-- {source} -->1.2<!-- end --> %"
    assert re.fullmatch(rf"right in <!-- {re.escape(source)} -->\d\d\.\d<!-- end --> %", renewed(stale))
    table = "<!-- table: reports/demo.md | Focus recognition rate | (all) | Configuration, FRR % -->?<!-- end -->"
    assert "| sgbm-two |" in renewed(table)
    with pytest.raises(ValueError, match="no table"):
        renewed(stale.replace("sgbm-two", "sgbm-three"))
