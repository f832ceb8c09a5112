"""``report.html``: a whole run on one page that opens from disk and makes no network requests."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

from harness.files.modules import bundle
from harness.report.formats import UNKNOWN, Picture, Table, draw_panels
from harness.report.page.data import ERROR_COLOURS, Served, differing_settings, page_data
from harness.report.page.packing import RunAttention, pack_json
from harness.report.stages import StageTimes
from harness.report.tables import remarks
from harness.report.thumbnails import Thumbnails
from harness.report.verdict import verdict_lines
from harness.run.manifest import ClipOfRun, RunManifest
from harness.run.notes import NoteKind
from harness.score.calibration import reliabilities
from harness.score.oracle_ablation import without_oracles
from harness.score.score import Scores
from vfoa.errors import listed

_FOLDER = Path(__file__).parent
RunTables = Mapping[str, Table]
"""Tables by name, as :func:`harness.report.write.run_tables` makes them."""
_GROUPS = {
    "answers": ("unlabelled",),
    "rates": ("frr", "phases", "comparisons", "factors", "seeds", "visible", "nowhere", "published"),
    "errors": ("errors",),
    "oracle": ("ablation",),
    "calibration": ("calibration", "calibration by subject", "sets", "directions"),
}
_MORE = ("subjects", "agreement", "baselines", "stages", "objects")
NO_LINKS: Mapping[str, str] = {}
NO_RENAMES: Mapping[str, Mapping[str, str]] = {}
NO_THUMBNAILS, NO_TIMES = Thumbnails(), StageTimes(configurations=(), ms={})


def render_page(
    scores: Scores,
    tables: RunTables,
    attention: RunAttention,
    manifest: RunManifest,
    *,
    times: StageTimes = NO_TIMES,
    thumbnails: Thumbnails = NO_THUMBNAILS,
    served: Served | None = None,
    where: str = "",
    run_folder: str = "",
    names_now: Mapping[str, Mapping[str, str]] = NO_RENAMES,
) -> str:
    """Return the page as text; the same arguments give the same text.

    Parameters
    ----------
    tables
        All tables, from :func:`harness.report.write.run_tables`.
    attention
        That of the scored records.
    manifest
        The run's.
    times
        Times of the stages; without any, their table is left out.
    thumbnails
        Thumbnails of wrong frames.
    served
        For a page that a server delivers. None: no frame is a link, and the page contains no address.
    where
        The conditions on labelled frames, as their user wrote them; "" for all frames.
    run_folder
        The address of the run's directory, relative to the page, with a slash at its end; "" for a page inside.
    names_now
        The present names of renamed targets, by clip and name in the results.
    """
    clips = {clip.name: clip for clip in manifest.clips}
    names_of = {
        clip.name: [names_now.get(clip.name, {}).get(name, name) for name in (*clip.targets, *clip.subjects)]
        for clip in manifest.clips
    }
    data, packs = page_data(scores, attention, thumbnails, served, clips, run_folder, names_of)
    panels = draw_panels(scores)
    differing = differing_settings(manifest.configurations)
    groups, shown = _numbered(
        {
            **{group: [tables[name] for name in names] for group, names in _GROUPS.items()},
            "more": [
                *(tables[name] for name in _MORE),
                *(panel for panel in panels if isinstance(panel, Table)),
                *([times.table()] if times.ms else []),
            ],
            "settings": [_clips(manifest.clips), differing],
        }
    )
    packs["tables"] = pack_json([plain_table(table) for table in shown])
    packs["manifest"] = pack_json(_printed(manifest))
    unfinished = [note.text for note in scores.notes if note.kind == NoteKind.UNFINISHED]
    return template("page.html.jinja").render(
        title=f"Run {manifest.experiment}",
        facts=_facts(scores, manifest),
        is_scored=bool(scores.rows),
        compared=_compared(scores, differing),
        verdict=[*unfinished, *verdict_lines(scores)],
        remarks=[remark for remark in remarks(scores) if remark not in scores.notes],
        notes=scores.notes,
        versions=manifest.versions,
        groups=groups,
        titles=[table.title for table in shown],
        drawings=[panel for panel in panels if isinstance(panel, Picture)],
        thumbnails=thumbnails,
        is_served=served is not None,
        where=where,
        script=script("main"),
        packs=packs,
        data={**data, **_figures(scores, tables)},
    )


def _figures(scores: Scores, tables: RunTables) -> dict[str, Any]:
    """Data of the small figures.

    ``oracle``: the rows of ``oracle_ablation.csv``. ``calibration``: ``{configuration, error, bins: [[confidence,
    right, frames]]}``.
    """
    return {
        "oracle": tables["oracle_ablation.csv"].rows,
        "calibration": [
            {
                "configuration": reliability.configuration,
                "error": reliability.calibration_error,
                "bins": [
                    [round(confidence, 4), round(accuracy, 4), int(count)]
                    for confidence, accuracy, count in zip(
                        reliability.confidence, reliability.accuracy, reliability.counts, strict=True
                    )
                    if count
                ],
            }
            for reliability in reliabilities(scores.judged_subjects)
        ],
    }


def page_of_tables(
    title: str,
    facts: Sequence[str],
    answer: Sequence[str],
    tables: Sequence[Table],
    links: Mapping[str, str] = NO_LINKS,
) -> str:
    """Return a page of tables; ``answer`` are sentences before them, ``links`` addresses by their text."""
    return template("tables.html.jinja").render(
        title=title,
        facts=facts,
        verdict=answer,
        links=links,
        tables=[table.title for table in tables],
        packs={"tables": pack_json([plain_table(table) for table in tables])},
        script=script("table_page"),
        data={},
    )


def _facts(scores: Scores, manifest: RunManifest) -> list[str]:
    """Date, commit, clips, frames and n, as words."""
    labelled = sum(
        len(of_subject.frames)
        for of_subject in scores.judged_subjects
        if of_subject.configuration == scores.configurations[0]
    )
    finished, commit = manifest.finished or "", manifest.commit
    facts = [finished.replace("T", " ").replace("+00:00", " UTC")] if finished else []
    facts += [f"commit {commit[:10]}{'-dirty' if commit.endswith('-dirty') else ''}"] if commit else []
    frames = sum(len(clip.frames) for clip in manifest.clips)
    facts += [f"{printed_count(len(manifest.clips), 'clip')}, {printed_count(frames, 'frame')}"]
    return [*facts, f"n = {labelled:,} labelled frames of subjects".replace(",", " ")]


def address_of(place: Path, page: Path) -> str:
    """The address of a file or a folder in a page on the disk: relative to the page's folder."""
    return quote(Path(os.path.relpath(place.resolve(), page.resolve().parent)).as_posix())


def printed_count(n: int, what: str) -> str:
    """A number, its thousands set apart, and its noun, which gets an s."""
    return f"{n:,} {what}{'' if n == 1 else 's'}".replace(",", " ")


def _compared(scores: Scores, differing: Table) -> str:
    names = without_oracles(scores.scored_configurations)
    if not names:
        return ""
    shown = listed(names, 8)
    chosen = [place for place, name in enumerate(differing.columns) if name in names]
    keys = [row[0] for row in differing.rows if len({row[place] for place in chosen}) > 1]
    places = keys if len(keys) <= 4 else list(dict.fromkeys(key.partition(".")[0] for key in keys))
    apart = f" They differ in {', '.join(places)}." if places else ""
    return f"Compared: {shown}.{apart}" if len(names) > 1 else f"Configuration: {shown}."


def _numbered(groups: Mapping[str, Sequence[Table]]) -> tuple[dict[str, list[int]], list[Table]]:
    """Return the tables that have rows, and their numbers by group."""
    tables: list[Table] = []
    numbers: dict[str, list[int]] = {}
    for name, group in groups.items():
        shown = [table for table in group if table.rows]
        numbers[name] = list(range(len(tables), len(tables) + len(shown)))
        tables += shown
    return numbers, tables


def plain_table(table: Table) -> dict[str, Any]:
    """Convert a table to the form that ``tables.js`` reads."""
    return {name: getattr(table, name) for name in ("title", "columns", "words", "rows", "notes")}


def _clips(clips: Sequence[ClipOfRun]) -> Table:
    return Table.of(
        "Clips, licences",
        "Clip | Licence | To be cited | Frames | Hz",
        (
            (UNKNOWN if value is None else value for value in values)
            for clip in clips
            for values in [(clip.name, clip.licence, clip.citation, len(clip.frames), clip.rate_hz)]
        ),
        words=3,
    )


def _printed(manifest: RunManifest) -> str:
    """The manifest as readable text: a clip's frames on one line."""
    plain = manifest.plain()
    for clip in plain["clips"]:
        clip.update({key: " ".join(map(str, clip[key])) for key in ("frames", "times_ns") if key in clip})
    return json.dumps(plain, indent=2, ensure_ascii=False)


@cache
def script(entry: str) -> str:
    """The script of a page, from the module where it starts."""
    return bundle(_FOLDER / f"{entry}.js")


@cache
def template(name: str) -> Template:
    """A page's template."""
    environment = Environment(
        loader=FileSystemLoader(_FOLDER),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":")}
    environment.globals["error_colours"] = ERROR_COLOURS
    return environment.get_template(name)
