from __future__ import annotations

from pathlib import Path

from harness.bench.report_page import PageSize, PageTiming, page_table, synthetic_page

SMALL = PageSize(name="small", clips=2, frames=90, configurations=2, subjects=2)


def test_the_page_of_a_seeded_run_is_the_same_again_and_has_all_of_it(tmp_path: Path) -> None:
    page = synthetic_page(SMALL, tmp_path / "once")
    assert page == synthetic_page(SMALL, tmp_path / "again")
    assert "n = 360 labelled frames of subjects" in page
    assert all(f'id="pack-{name}"' in page for name in ("clip-1", "attention-1", "pictures-1", "rows", "tables"))


def test_without_a_browser_the_table_has_sizes_alone() -> None:
    timing = PageTiming(size=SMALL, megabytes=1.25, first_paint_s=None, drawn_s=None, redraw_ms=None)
    assert page_table([timing]).rows == (("small", "2", "90", "2", "2", "1.2", "–", "–", "–"),)
