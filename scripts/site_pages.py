"""A hook of mkdocs: pages that are generated, and pages that stand elsewhere in the repository.

Settings, columns and commands are written from the code at each build. README.md, CONTRIBUTING.md and the formats of
datasets/ and annotations/ are pages of the site where they stand. Links between files of the repository stay as they
are in the files, so that they also work without the site; they are rewritten here.
"""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent
LOG = logging.getLogger("mkdocs.hooks.site_pages")

ELSEWHERE = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "datasets/README.md": "reference/clips.md",
    "annotations/README.md": "reference/annotations.md",
    "reports/README.md": "reference/reports.md",
}
"""Pages of the site by the file of the repository that they are."""

ASSETS = (".svg", ".png", ".webp", ".ipynb")
_LINK = re.compile(r"(!?\[[^\]]*\])\(([^)\s]+)\)")
_ROLE = re.compile(r":(?:func|class|mod|data|meth|attr|exc):<code>~?")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that do not stand in docs/, and the pictures that they show."""
    from mkdocs.structure.files import File

    sources = [Path(page.abs_src_path) for page in files.documentation_pages() if page.abs_src_path]
    for place, page in ELSEWHERE.items():
        files.append(File.generated(config, page, content=(ROOT / place).read_text(encoding="utf-8")))
    for source in [*sources, *(ROOT / place for place in ELSEWHERE)]:
        for target in _linked(source.read_text(encoding="utf-8"), source):
            name = f"reference/{target.name}"
            shown = target.suffix in ASSETS and not target.is_relative_to(ROOT / "docs")
            if shown and files.get_file_from_path(name) is None:
                files.append(File.generated(config, name, abs_src_path=str(target)))
    generated = {
        "reference/settings.md": settings_page(),
        "reference/columns.md": columns_page(),
        "reference/commands.md": commands_page(),
    }
    for name, text in generated.items():
        files.append(File.generated(config, name, content=text))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Rewrite links to files of the repository: to their pages, or to their names where they have none."""
    own = next((place for place, name in ELSEWHERE.items() if name == page.file.src_uri), f"docs/{page.file.src_uri}")
    here = os.path.dirname(page.file.src_uri)

    def rewritten(match: re.Match[str]) -> str:
        text, address = match.groups()
        place, hash_, anchor = address.partition("#")
        if "://" in address or address.startswith("mailto:") or not place:
            return match[0]
        target = (ROOT / own).parent.joinpath(place).resolve()
        in_docs = os.path.relpath(target, ROOT / "docs")
        if not target.exists() and files.get_file_from_path(in_docs) is not None:
            return match[0]  # a generated page
        if not target.exists():
            LOG.warning("%s: a link to %s, which does not exist", own, place)
            return match[0]
        found = target.relative_to(ROOT).as_posix()
        name = ELSEWHERE.get(found) or found.removeprefix("docs/")
        if not found.startswith("docs/") and found not in ELSEWHERE:
            name = f"reference/{target.name}"
        if files.get_file_from_path(name) is None:
            return f"{text[1:-1].removeprefix('[')} (`{found}`)"
        return f"{text}({os.path.relpath(name, here or '.')}{hash_}{anchor})"

    return _outside_code(markdown, lambda text: _LINK.sub(rewritten, text))


def on_page_content(html: str, **_: Any) -> str:
    """Docstrings name things by Sphinx's roles: leave the name."""
    return _ROLE.sub("<code>", html)


def on_post_page(output: str, page: Page, **_: Any) -> str:
    """Warn, and so fail, where a page would load something from the network."""
    for tag in re.findall(r"<(?:script|link|img|iframe)\b[^>]*(?:src|href)=\"https?://[^>]*>", output):
        if 'rel="canonical"' not in tag:
            LOG.warning("%s: loads from the network: %s", page.file.src_uri, tag)
    return output


def _outside_code(markdown: str, change: Any) -> str:
    parts = re.split(r"(^```.*?^```\s*$)", markdown, flags=re.MULTILINE | re.DOTALL)
    return "".join(part if part.startswith("```") else change(part) for part in parts)


def _linked(text: str, source: Path) -> Iterator[Path]:
    """The files of the repository that a page links to."""
    for _, address in _LINK.findall(text):
        if "://" not in address:
            target = source.parent.joinpath(address.partition("#")[0]).resolve()
            if target.is_file() and target.is_relative_to(ROOT):
                yield target


def settings_page() -> str:
    """Every setting, by stage."""
    from harness.pipeline.configuration import TABLES
    from harness.pipeline.settings_reference import settings_tables

    lines = [
        "# Settings",
        "",
        "Every setting of every stage and step. The same in the terminal: `vfoa settings`, or `vfoa settings stereo`.",
        "",
        "Give a setting in an experiment (`[defaults.stereo]`, a `[grid]`, or a `[[configuration]]`), after `--set` "
        "(`--set stereo.min_depth_m=0.8`), or to `vfoa.Estimator.open`. Angles are degrees, lengths metres, as the "
        "names' endings say.",
        "",
    ]
    for name in TABLES:
        lines += [f"## {name}", ""]
        for table in settings_tables(name):
            lines += [f"### `{table.choice}`", ""] if table.choice else []
            lines += [table.summary, ""] if table.summary else []
            if not table.settings:
                lines += ["Nothing to set.", ""]
                continue
            lines += ["| Key | Type | Unit | Default | Meaning |", "|---|---|---|---|---|"]
            for setting in table.settings:
                cells = (f"`{setting.key}`", _cell(setting.type), setting.unit, f"`{_cell(setting.default)}`")
                lines.append(f"| {' | '.join(cells)} | {_cell(setting.meaning)} |")
            lines.append("")
    return "\n".join(lines)


_OF_FRAMES = {
    "answers": ("answers/CONFIGURATION/CLIP.parquet", "a row is a person in a frame under one configuration."),
    "frames": ("scenes/SCENE/CLIP/frames.parquet", "a row is a frame."),
    "instances": ("scenes/SCENE/CLIP/instances.parquet", "a row is an object or a person in a frame."),
    "people": ("scenes/SCENE/CLIP/people.parquet", "a row is a person who is followed in a frame, as in answers."),
    "objects": ("scenes/SCENE/CLIP/objects.parquet", "a row is a true object against the instance found for it."),
    "clouds": ("scenes/SCENE/CLIP/clouds.parquet", "a row is a choice of the 3D points of an instance in one frame."),
    "directions": ("directions/DIRECTIONS/CLIP/directions.parquet", "a row is a person in a frame, as in answers."),
    "true_people": ("directions/DIRECTIONS/CLIP/true_people.parquet", "a row is a true person against what was found."),
}
"""The tables of frames: their files in a run's directory, and their rows."""


def columns_page() -> str:
    """Every column of the tables for programs."""
    from harness.report import csv_tables as columns
    from harness.report.frames_csv import FRAMES_COLUMNS
    from harness.run.tables import TABLES

    tables = {
        "frr.csv": (columns.frr_columns(), "A row is a subject, a clip, or all of them, under one configuration."),
        "frames.csv": (
            FRAMES_COLUMNS,
            "Written by `vfoa answers export RUN --format frames`. A row is one target of one subject in one frame.",
        ),
        "comparisons.csv": (columns.COMPARISON_COLUMNS, "A row is a pair of configurations."),
    }
    lines = ["# Columns", "", "The tables of a run's directory, and the DataFrames of `harness.load_run`.", ""]
    for name, (meanings, about) in tables.items():
        lines += [f"## {name}", "", about, "", "| Column | Meaning |", "|---|---|"]
        lines += [f"| `{column}` | {_cell(meaning)} |" for column, meaning in meanings.items()]
        lines.append("")
    lines += [
        "# Tables of frames",
        "",
        'Parquet; "?" marks a type that may be null, `vec3` a list of three numbers.',
        "",
    ]
    for name, (place, about) in _OF_FRAMES.items():
        lines += [f"## {name}", "", f"`{place}`: {about}", "", "| Column | Type | Meaning |", "|---|---|---|"]
        lines += [f"| `{key}` | {_cell(each.type)} | {_cell(each.meaning)} |" for key, each in TABLES[name].items()]
        lines.append("")
    return "\n".join(lines)


def commands_page() -> str:
    """The help of every command."""
    from typer.main import get_command

    from harness.cli import app

    lines = ["# Commands", "", "`vfoa COMMAND -h` prints the same. `vfoa --install-completion` completes names.", ""]
    for words, help_text in _helps(get_command(app), ("vfoa",)):
        lines += [f"## {' '.join(words)}", "", "```text", help_text.rstrip(), "```", ""]
    return "\n".join(lines)


def _helps(command: Any, words: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], str]]:
    """The words of each command below one, and its help, 100 columns wide."""
    with command.context_class(
        command, info_name=" ".join(words), max_content_width=100, terminal_width=100
    ) as context:
        yield words, command.get_help(context)
    for name, inner in getattr(command, "commands", {}).items():
        if not inner.hidden:
            yield from _helps(inner, (*words, name))


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
