"""What the real-time preset and each of its shortcuts cost in FRR: ``reports/presets.md``."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from harness.api import RunResults
from harness.files.io import atomic_write
from harness.pipeline.cache_store import open_store
from harness.report.formats import UNKNOWN, Table, to_markdown
from harness.report.stages import stage_measures_table
from harness.run.directory import RunDirectory
from harness.run.executors import cores
from harness.run.experiment import Experiment, load_experiment
from harness.run.runner import prepare, run_plan
from harness.score.finished_run import read_scores

PRESET = "realtime"


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """A preset, and the setting that is changed: none, or ``key=value``."""

    preset: str
    change: str = ""

    @property
    def title(self) -> str:
        """The first cell of the row."""
        return self.change or self.preset


ROWS = (
    Row(preset="none"),
    Row(preset=PRESET),
    *(
        Row(preset=PRESET, change=change)
        for change in (
            "stereo.resolution=full",
            "stereo.region=frame",
            "segmentation.every=1",
            "segmentation.every=3",
            "segmentation.every=8",
            "heads.max_size_px=640",
            "heads.max_size_px=320",
            "reconstruction.max_points=1000",
            "reconstruction.max_eye_points=100000",
        )
    ),
)
"""Both presets, then the real-time preset with one of its shortcuts taken back or changed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """An experiment, configurations of it by title, settings of all rows, and tables that it lacks."""

    experiment: str
    configurations: Mapping[str, str]
    settings: tuple[str, ...] = ()
    lacks: tuple[str, ...] = ()

    def has(self, row: Row) -> bool:
        """Whether it has what the row changes."""
        return row.change.partition(".")[0] not in self.lacks

    def in_all_rows(self, limit: int | None) -> Experiment:
        """One experiment with these configurations under every row, named ``NUMBER-CONFIGURATION``."""
        made = []
        for number, row in enumerate(ROWS):
            if self.has(row):
                changes = (*self.settings, *filter(None, (row.change,)))
                loaded = load_experiment(self.experiment, overrides=changes, preset=row.preset)
                own = (each for each in loaded.configurations if each.name in self.configurations.values())
                made += [replace(each, name=f"{number}-{each.name}", factors={}) for each in own]
        return replace(loaded, configurations=tuple(made), limit=limit, published=None, notes=())


MATERIAL = {
    "demo": Material(
        experiment="demo", configurations={"one cone": "sgbm-one", "two cones": "sgbm-two"}, lacks=("heads",)
    ),
    "bandage_2": Material(
        experiment="bandage_2", configurations={"60 deg": "truth-60deg"}, settings=("stereo.matcher=sgbm",)
    ),
}


def presets_table(runs: Mapping[str, RunDirectory]) -> Table:
    """A row for each of :data:`ROWS`, and the columns of each run, by the name of its material."""
    columns = {"Preset, and what is changed": [row.title for row in ROWS]}
    for name, run in runs.items():
        columns |= {f"{name}: {title}": cells for title, cells in _columns(MATERIAL[name], run).items()}
    return Table(
        title="What the presets cost in FRR",
        columns=tuple(columns),
        rows=tuple(zip(*columns.values(), strict=True)),
        words=1,
        notes=(
            "SGBM on the experiments demo (masks and heads from the ground truth) and bandage_2 (its models, one "
            "cone). FRR: % of n pairs of frame and subject. Below the presets: one setting changed.",
            "Carried: frames whose masks were carried from a key frame. Disparity px: median over frames of the median "
            "error. Over 2 px: mean share of the errors. Known: mean share of pixels with a disparity; with a region, "
            "none is outside of it.",
            "Written by python -m scripts.measure presets.",
        ),
    )


def _columns(material: Material, run: RunDirectory) -> dict[str, list[str]]:
    """The cells of one material by title, a cell for each of :data:`ROWS`."""
    scores = read_scores(run)
    frr = {row.configuration: f"{100 * row.frr:.1f} of {row.n}" for row in scores.rows.overall}
    carried = {name: f"{100 * share:.0f}" for name, share in _carried(RunResults(run.path)).items()}
    measured = {configuration: cells for _, configuration, *cells in stage_measures_table(scores).rows}  # all: last
    first, *_ = material.configurations.values()
    columns = {f"FRR, {title}": (frr, name) for title, name in material.configurations.items()}
    columns["carried %"] = carried, first
    for place, title in enumerate(("disparity px", "over 2 px %", "known %")):
        columns[title] = {name: cells[place] for name, cells in measured.items()}, first
    return {
        title: [cells.get(f"{number}-{name}", UNKNOWN) for number in range(len(ROWS))]
        for title, (cells, name) in columns.items()
    }


def _carried(run: RunResults) -> dict[str, float]:
    """The share of each configuration's frames that have the masks of another frame."""
    frame = ["clip", "scene", "frame"]
    seen = run.answers[["configuration", *frame]].drop_duplicates().merge(run.scenes["frames"], on=frame)
    is_carried = seen["masks_from"].notna() & (seen["masks_from"] != seen["frame"])
    return {str(name): float(share) for name, share in is_carried.groupby(seen["configuration"]).mean().items()}


def main() -> None:
    """Run both materials under every row and write the table."""
    parser = argparse.ArgumentParser(description="Measure what the real-time preset and its shortcuts cost in FRR.")
    parser.add_argument("--out", type=Path, default=Path("reports/presets.md"), help="The Markdown file to write.")
    parser.add_argument("--limit", type=int, help="Number of frames of each clip; default: all.")
    given = parser.parse_args()
    workers, cache = cores(), open_store(None)
    with TemporaryDirectory() as folder:
        runs = {
            name: run_plan(
                prepare(material.in_all_rows(given.limit)),
                Path(folder) / name,
                workers=workers,
                progress=lambda clip: None,
                cache=cache,
            )
            for name, material in MATERIAL.items()
        }
        atomic_write(given.out, to_markdown(presets_table(runs)))
