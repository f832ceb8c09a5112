"""``report.html``: a whole run on one page that opens from disk and asks the network for nothing."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

from harness.report.comparisons import compare_configurations
from harness.report.formats import UNKNOWN, Table
from harness.report.oracle_ablation import ablation_table
from harness.report.page_data import AttentionLog, Served, confusions, differing_settings, page_data
from harness.report.panels import draw_panels
from harness.report.published import published_table
from harness.report.stage_measures import terminal_measures
from harness.report.tables import error_types_table, frr_table
from harness.report.thumbnails.reader import Thumbnails
from harness.score.score import ERROR_TYPES, Scores

LETTERS = {
    "correct": "",
    "unscored": "·",
    "no_subject": "S",
    "no_eyes_3d": "E",
    "no_direction": "D",
    "target_not_segmented": "T",
    "target_without_box": "B",
    "false_attention": "F",
    "wrong_subject": "W",
    "no_hit": "N",
    "missed": "M",
    "outscored": "O",
}
"""What stands in a cell, so that outcomes can be told apart without colour."""


def render_page(
    scores: Scores,
    attention: AttentionLog,
    *,
    manifest: Mapping[str, Any] | None = None,
    tables: Sequence[Table] = (),
    thumbnails: Thumbnails | None = None,
    served: Served | None = None,
) -> str:
    """The page as text, the same for the same arguments.

    Parameters
    ----------
    attention
        Has watched the records that were scored.
    manifest
        The run's, as :meth:`harness.run.directory.RunDirectory.read_manifest` gives it; None leaves out what was run.
    tables
        What else stands under "More measures"; those without rows are left out.
    thumbnails
        What is shown of wrong frames.
    served
        For a page that a server gives out. Without it no cell leads anywhere, and the page knows no address.
    """
    frr = frr_table(scores)
    thumbnails = thumbnails or Thumbnails()
    return _template().render(
        title=f"Run {manifest['experiment']}" if manifest else "Run",
        clips=_clips(manifest["clips"]) if manifest else None,
        differing=differing_settings(manifest["configurations"]) if manifest else None,
        versions=manifest["versions"] if manifest else None,
        manifest=_printed(manifest) if manifest else None,
        frr=frr,
        bars=[_bar(row.frr, row.interval.low, row.interval.high) for row in scores.by_clip()],
        sentences=[each.sentence for each in compare_configurations(scores)],
        ablation=ablation_table(scores),
        published=published_table(scores),
        measures=terminal_measures(scores),
        error_types=error_types_table(scores),
        more=[*draw_panels(scores), *(table for table in tables if table.rows)],
        confusions=confusions(scores.verdicts),
        letters=LETTERS,
        thumbnails=thumbnails,
        served=served is not None,
        data={
            **page_data(scores.verdicts, attention, thumbnails, served),
            "letters": LETTERS,
            "error_types": ERROR_TYPES,
        },
    )


def _clips(clips: Sequence[Mapping[str, Any]]) -> Table:
    return Table(
        title="Clips",
        columns=("Clip", "Licence", "To be cited", "Frames", "Hz"),
        words=3,
        rows=tuple(
            (
                each["name"],
                *map(_text, (each["licence"], each.get("citation"))),
                str(len(each["frames"])),
                _text(each["rate_hz"]),
            )
            for each in clips
        ),
    )


def _text(value: object) -> str:
    return UNKNOWN if value is None else str(value)


def _bar(frr: float, low: float, high: float) -> dict[str, float]:
    """Percentages, cut to what a screen can show; an unknown interval has no width."""
    low, high = (frr, frr) if math.isnan(low) else (low, high)
    return {"frr": round(100 * frr, 1), "low": round(100 * low, 1), "high": round(100 * high, 1)}


def _printed(manifest: Mapping[str, Any]) -> str:
    """The manifest for reading: a clip's frames on one line."""
    clips = [{**clip, "frames": " ".join(map(str, clip["frames"]))} for clip in manifest["clips"]]
    return json.dumps({**manifest, "clips": clips}, indent=2, ensure_ascii=False)


@cache
def _template() -> Template:
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":")}
    return environment.get_template("page.html.jinja")
