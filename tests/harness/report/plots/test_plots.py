"""Figures for a paper: what they show is what was scored, and files say what they are."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from typer.testing import CliRunner

from harness.cli import app
from harness.report.figures import save_figure
from harness.report.plots.confusion import draw_confusion
from harness.report.plots.errors import draw_errors
from harness.report.plots.forest import draw_forest
from harness.report.plots.oracle import draw_oracle
from harness.report.plots.timeline import draw_timeline
from harness.report.sweep import write_sweep
from harness.report.sweep_grid import edges, grid_of
from harness.run.experiment import SweepView
from harness.score.reference import Reference
from harness.score.score import Scores, score
from harness.score.sweep.read import read_sweep
from harness.score.sweep.runner import Sweep, SweepRow
from tests.records import answers, labels
from vfoa.errors import VfoaError

TRUTH = ("cup", "cup", "dragon", "none")
GIVEN = {"one": ("cup", "dragon", "dragon", "cup"), "one+gaze": ("cup", "cup", "dragon", "cup")}


@pytest.fixture
def scores() -> Scores:
    records = [
        each
        for clip in ("a", "b")
        for name, given in GIVEN.items()
        for each in answers(given, configuration=name, clip=clip)
    ]
    return score(records, Reference(labels={clip: labels(*TRUTH) for clip in ("a", "b")}))


def _bars(axes: Axes) -> list[tuple[float, float]]:
    """Start and length of each bar, along the axis on which it grows."""
    return [(round(each.get_x(), 3), round(each.get_width(), 3)) for each in axes.patches]  # type: ignore[attr-defined]


def test_bars_and_points_are_the_rates(scores: Scores) -> None:
    points = [line for line in draw_forest(scores).axes[0].lines if line.get_marker() == "o"]
    assert [list(each.get_xdata()) for each in points] == [[50.0]]  # the oracle's step takes no part
    assert _bars(draw_errors(scores).axes[0]) == [(0.0, 25.0), (25.0, 25.0)]  # false attention, then missed
    waterfall = [(each.get_y(), each.get_height()) for each in draw_oracle(scores).axes[0].patches]  # type: ignore[attr-defined]
    assert waterfall == [(0.0, 50.0), (50.0, 25.0)]


def test_a_timeline_has_a_strip_of_every_frame(scores: Scores) -> None:
    axes = draw_timeline(scores, "b", "girl").axes[0]
    strip = [each for each in axes.patches if round(each.get_y() + each.get_height() / 2) == 1]  # type: ignore[attr-defined]
    assert [(each.get_x(), each.get_width()) for each in strip] == [(0.5, 1), (1.5, 1), (2.5, 1), (3.5, 1)]  # type: ignore[attr-defined]
    assert [each.get_text() for each in axes.get_yticklabels()] == ["truth", "one"]
    with pytest.raises(VfoaError, match="expected one of girl"):
        draw_timeline(scores, "b", "boy")


def test_a_confusion_counts_all_clips_or_one(scores: Scores) -> None:
    for clip, counts in ((None, ["2", "2", "2", "2"]), ("a", ["1", "1", "1", "1"])):
        (axes,) = (each for each in draw_confusion(scores, clip).axes if each.texts)
        assert [each.get_text() for each in axes.texts] == counts
        assert [each.get_text() for each in axes.get_xticklabels()] == ["cup", "dragon", "none"]


def test_equal_figures_are_equal_bytes_in_each_format(scores: Scores, tmp_path: Path) -> None:
    for ending, start in ((".pdf", b"%PDF"), (".svg", b"<?xml"), (".png", b"\x89PNG")):
        for place in ("1", "2"):
            save_figure(tmp_path / f"{place}{ending}", draw_errors(scores))
        content = (tmp_path / f"1{ending}").read_bytes()
        assert content.startswith(start)
        assert content == (tmp_path / f"2{ending}").read_bytes()


@pytest.fixture
def sweep() -> Sweep:
    cones = ("40", "5", "10.4", "10.4+40")
    rows = tuple(
        SweepRow(
            factors={"gaze.error_deg": error, "rays": rays, "cones": cone},
            n=100,
            correct=10 * e + 5 * c + r,
            predicted=90,
        )
        for e, error in enumerate(("2.0", "11.1"))
        for r, rays in enumerate(("8", "16"))
        for c, cone in enumerate(cones)
    )
    view = SweepView(per="gaze.error_deg", across="cones")
    return Sweep(name="s", clips=("a",), frames=50, notes=("A note.",), view=view, rows=rows)


def _write(sweep: Sweep, place: Path) -> Path:
    place.mkdir()
    write_sweep(place, sweep)
    about = {"per": sweep.view.per, "across": sweep.view.across, "clips": sweep.clips, "frames": sweep.frames}
    described = {"experiment": sweep.name, "sweep": {**about, "notes": sweep.notes}}
    (place / "sweep.json").write_text(json.dumps(described), encoding="utf-8")
    return place


def test_a_sweep_is_read_as_it_was_written(sweep: Sweep, tmp_path: Path) -> None:
    place = _write(sweep, tmp_path / "sweep")
    assert read_sweep(place) == sweep
    (place / "sweep.csv").write_text("gaze.error_deg,n\n", encoding="utf-8")
    with pytest.raises(VfoaError, match="expected the column 'correct'"):
        read_sweep(place)


def test_a_grid_has_numbers_in_order_then_words_and_borders_half_way(sweep: Sweep) -> None:
    grid = grid_of(sweep)
    assert grid.columns == ("5", "10.4", "40", "10.4+40")
    assert (grid.numbers, grid.row_numbers) == (3, (2.0, 11.1))
    assert grid.mean[0].tolist() == pytest.approx([0.055, 0.105, 0.005, 0.155])
    assert grid.best[1].tolist() == pytest.approx([0.16, 0.21, 0.11, 0.26])
    assert edges([5.0, 10.0, 40.0]) == [2.5, 7.5, 25.0, 55.0]


def test_the_command_draws_sweeps_and_runs_and_says_what_it_cannot(sweep: Sweep, tmp_path: Path) -> None:
    place, out = _write(sweep, tmp_path / "sweep"), tmp_path / "sweep.svg"

    def call(*arguments: str) -> str:
        return CliRunner().invoke(app, [*arguments], catch_exceptions=False).stdout

    assert call("plot", str(place), "--kind", "sweep", "--out", str(out)) == f"Figure: {out}\n"
    assert "focus recognition rate" in out.read_text(encoding="utf-8")
    assert call("report", str(place)) == f"Page: {place / 'report.html'}\n"
    page = (place / "report.html").read_text(encoding="utf-8")
    assert "Sweep s" in page
    assert re.findall(r'(?:src|href)="([^"]*)"', page) == ["data:,"]
    for arguments, message in (
        (("--kind", "sweep", "--out", str(out)), "exists already"),
        (("--kind", "sweep", "--out", str(tmp_path / "x.jpg")), r"expected \.pdf, \.svg or \.png"),
        (("--kind", "forest", "--out", str(tmp_path / "x.pdf")), "expected sweep, which it has"),
        (("--kind", "sweep", "--clip", "a", "--out", str(tmp_path / "x.pdf")), "--clip is for timeline and confusion"),
    ):
        with pytest.raises(VfoaError, match=message):
            call("plot", str(place), *arguments)
    with pytest.raises(VfoaError, match="a sweep has no recordings"):
        call("report", str(place), "--serve")


def test_a_figure_without_its_data_is_refused(scores: Scores) -> None:
    plain = score(answers(("cup",)), Reference(labels={"clip": labels("cup")}))
    with pytest.raises(VfoaError, match="no oracle ablation"):
        draw_oracle(plain)
    assert isinstance(draw_forest(plain), Figure)
