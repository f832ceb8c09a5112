"""``report.html``: a whole run on one page that opens from disk and asks the network for nothing."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template

from harness.report.compared import compare_configurations
from harness.report.formats import UNKNOWN, Table
from harness.report.oracle import ladder_table
from harness.report.page_data import AttentionLog, Served, confusions, differing_settings, page_data
from harness.report.published import published_table
from harness.report.stage_measures import stage_measures_table, terminal_measures, thing_measures_table
from harness.report.tables import baselines_table, causes_table, frr_table, measures_table, subjects_table
from harness.scores.score import CAUSES, Scores
from harness.stills.reader import Stills

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
    stills: Stills | None = None,
    served: Served | None = None,
) -> str:
    """The page as text, the same for the same arguments.

    Parameters
    ----------
    attention
        Has watched the records that were scored.
    manifest
        The run's, as :meth:`harness.runs.directory.RunDirectory.read_manifest` gives it; None leaves out what was run.
    tables
        What else stands under "More measures"; those without rows are left out.
    stills
        What is shown of wrong frames.
    served
        For a page that a server gives out. Without it no cell leads anywhere, and the page knows no address.
    """
    frr = frr_table(scores)
    stills = stills or Stills()
    return _template().render(
        title=f"Run {manifest['experiment']}" if manifest else "Run",
        clips=_clips(manifest["clips"]) if manifest else None,
        differing=differing_settings(manifest["configurations"]) if manifest else None,
        versions=manifest["versions"] if manifest else None,
        manifest=_printed(manifest) if manifest else None,
        frr=frr,
        bars=[_bar(row.frr, row.wilson.low, row.wilson.high) for row in scores.by_clip()],
        sentences=[each.sentence for each in compare_configurations(scores)],
        ladder=ladder_table(scores),
        published=published_table(scores),
        measures=terminal_measures(scores),
        causes=causes_table(scores),
        more=[
            subjects_table(scores),
            measures_table(scores),
            baselines_table(scores),
            stage_measures_table(scores),
            thing_measures_table(scores),
            *tables,
        ],
        confusions=confusions(scores.verdicts),
        letters=LETTERS,
        stills=stills,
        served=served is not None,
        data={**page_data(scores.verdicts, attention, stills, served), "letters": LETTERS, "causes": CAUSES},
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
    """Percentages, cut to what a screen can show."""
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
