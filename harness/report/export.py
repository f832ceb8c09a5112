"""A run's table with its data sheet in one file, for a paper's supplement, a website, or another run's comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from harness.report.csv_tables import scores_table
from harness.report.formats import LATEX_HEAD, Table, to_csv, to_latex, to_markdown
from harness.report.tables import frr_table
from harness.score.exported import ExportedClip, ExportedSubject, ExportedTable, Sheet, labels_digest
from harness.score.intervals import LEAST_CLIPS
from harness.score.score import Scores
from harness.score.verdicts import Verdict


def exported_table(scores: Scores, manifest: Mapping[str, Any]) -> ExportedTable:
    """The table of a scored run, from its scores and its manifest."""
    rows = scores_table(scores)
    return ExportedTable(
        sheet=_sheet(scores, manifest),
        configurations={name: manifest["configurations"].get(name, {}) for name in scores.configurations},
        rows=tuple(dict(zip(rows.columns, row, strict=True)) for row in rows.rows),
        frames=_frames(scores),
    ).with_digest()


def _sheet(scores: Scores, manifest: Mapping[str, Any]) -> Sheet:
    scored: dict[str, list[Verdict]] = {}
    first = scores.configurations[0] if scores.configurations else None
    for verdict in scores.verdicts:
        if verdict.outcome != "unscored" and verdict.configuration == first:
            scored.setdefault(verdict.clip, []).append(verdict)
    clips = tuple(
        ExportedClip(
            name=each["name"],
            licence=each.get("licence"),
            citation=each.get("citation"),
            frames=len(each["frames"]),
            scored=len(scored.get(each["name"], ())),
            sha256=each.get("sha256", ""),
            labels_sha256=labels_digest(
                [(verdict.frame, verdict.subject, str(verdict.truth)) for verdict in scored.get(each["name"], ())]
            ),
        )
        for each in manifest["clips"]
    )
    return Sheet(
        experiment=manifest.get("experiment", ""),
        clips=clips,
        subjects=len({(verdict.clip, verdict.subject) for found in scored.values() for verdict in found}),
        pairs=sum(map(len, scored.values())),
        units=f"clips, then looks of at least 2 s within them; below {LEAST_CLIPS} clips looks of these clips only",
        seeds={name: _seeds(manifest["configurations"].get(name, {})) for name in scores.configurations},
        notes=scores.notes,
        versions=manifest.get("versions", {}),
        source_sha256=manifest.get("source_sha256"),
        commit=manifest.get("commit"),
    )


def _seeds(configuration: Mapping[str, Any]) -> dict[str, int]:
    """The seed of each stage that has one."""
    return {
        stage: settings["seed"]
        for stage, settings in configuration.items()
        if isinstance(settings, Mapping) and "seed" in settings
    }


def _frames(scores: Scores) -> tuple[ExportedSubject, ...]:
    found: dict[tuple[str, str], ExportedSubject] = {}
    for each in scores.outcomes:
        if not each.frames:
            continue
        key = each.clip, each.subject
        if key not in found:
            found[key] = ExportedSubject(
                clip=each.clip,
                subject=each.subject,
                frames=each.frames,
                looks=tuple(each.looks.tolist()),
                truth=tuple(str(verdict.truth) for verdict in each.verdicts if verdict.outcome != "unscored"),
                correct={},
            )
        found[key].correct[each.configuration] = "".join("1" if right else "0" for right in each.correct)
    return tuple(found.values())


def _sheet_lines(table: ExportedTable) -> list[str]:
    """The data sheet in words, one line per entry."""
    sheet = table.sheet
    seeds = {f"{stage} {seed}" for stages in sheet.seeds.values() for stage, seed in stages.items()}
    return [
        f"Experiment: {sheet.experiment}",
        f"Scored: {sheet.pairs} (frame, subject) pairs of {sheet.subjects} subjects in {len(sheet.clips)} clips",
        f"Units of intervals and tests: {sheet.units}",
        *(
            f"Clip {clip.name}: {clip.scored} pairs, licence {clip.licence or 'unknown'}, content sha256 "
            f"{clip.sha256[:12] or 'unknown'}, labels sha256 {clip.labels_sha256[:12]}"
            for clip in sheet.clips
        ),
        f"Seeds: {', '.join(sorted(seeds)) or 'none'}",
        f"Versions: {', '.join(f'{name} {number}' for name, number in sheet.versions.items())}",
        f"Commit: {sheet.commit or 'unknown'}; source sha256 {(sheet.source_sha256 or 'unknown')[:12]}",
        f"Digest of this table: {table.digest}",
    ]


def _csv(scores: Scores, table: ExportedTable) -> str:
    """``frr.csv`` under the data sheet, whose lines begin with ``#``."""
    return "".join(f"# {line}\n" for line in _sheet_lines(table)) + to_csv(scores_table(scores))


def _with_sheet(scores: Scores, table: ExportedTable) -> Table:
    main = frr_table(scores)
    return replace(main, notes=(*main.notes, *_sheet_lines(table)))


def _tex(scores: Scores, table: ExportedTable) -> str:
    return LATEX_HEAD + to_latex(_with_sheet(scores, table), label="tab:frr")


def _markdown(scores: Scores, table: ExportedTable) -> str:
    return to_markdown(_with_sheet(scores, table))


def _json(scores: Scores, table: ExportedTable) -> str:
    return table.model_dump_json(indent=1) + "\n"


FORMATS = {"csv": _csv, "tex": _tex, "md": _markdown, "json": _json}
"""Functions by format that write a table with its data sheet."""
