"""The page of ``vfoa compare`` where it is read: in a browser, from disk."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from harness.report.page.compare import render_comparison, report_link
from harness.score.compared_runs import compare_runs
from tests.browser import requested, set_width, wait_until_drawn
from tests.records import answers, write_clip, write_run

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

TRUTH = ["cup"] * 12 + ["can"] * 12
RIGHT = {"a": {"one": 12, "two": 4}, "b": {"one": 12, "two": 10}}
"""Right frames of each configuration of each run: the first ones; the others have no answer."""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of two runs, of which only the second has a report."""
    root = tmp_path_factory.mktemp("runs & more")
    clip = write_clip(root, "table", TRUTH)
    for run, configurations in RIGHT.items():
        records = [
            record
            for name, right in configurations.items()
            for record in answers([*TRUTH[:right], *[None] * (24 - right)], clip="table", configuration=name)
        ]
        write_run(root / run, records, clips=[clip], notes=[])
    (root / "b" / "report.html").write_text("", encoding="utf-8")
    (page := root / "compared.html").write_text(
        render_comparison(compare_runs([root / "a", root / "b"]), report_link(page)), encoding="utf-8"
    )
    return page


def _texts(browser: Chrome, selector: str) -> Sequence[str]:
    return [each.text for each in browser.find_elements("css selector", selector)]


@pytest.mark.parametrize("width", [1400, 390])
def test_the_page_ranks_compares_and_links_to_the_frames_that_changed(browser: Chrome, page: Path, width: int) -> None:
    set_width(browser, width)
    browser.get(page.as_uri())
    wait_until_drawn(browser)
    assert requested(browser) == [page.as_uri()]
    assert browser.get_log("browser") == []
    assert browser.execute_script("return document.documentElement.scrollWidth <= innerWidth")

    ranked = [each.get_attribute("aria-label") for each in browser.find_elements("css selector", "#draw-ranking .row")]
    assert [words.partition(",")[0] for words in ranked] == [
        "a/one: FRR 50.0 %",
        "b/one: FRR 50.0 %",
        "b/two: FRR 41.7 %",
        "a/two: FRR 16.7 %",
    ]
    same, other = browser.find_elements("css selector", "#draw-differences .row")
    assert "one: b vs a" in same.text
    assert "identical" in same.text
    assert "two: b vs a" in other.text
    assert "+25.0" in other.text

    (row,) = browser.find_elements("css selector", "tbody tr")
    cells = [each.text for each in row.find_elements("css selector", "th, td")]
    assert cells[:9] == ["b/two", "a/two", "better", "table", "girl", "5–10", "cup", "no prediction", "cup"]
    (link,) = row.find_elements("css selector", "a")  # the other run has no report
    assert link.text == "cup"
    assert link.get_attribute("href") == (
        (page.parent / "b" / "report.html").as_uri() + "#clip=table&config=two&subject=girl&frame=5"
    )


def test_the_axis_of_runs_that_hardly_differ_has_each_number_once(browser: Chrome, tmp_path: Path) -> None:
    clip = write_clip(tmp_path, "table", TRUTH)
    runs = [tmp_path / "a", tmp_path / "b"]
    for run in runs:
        write_run(run, answers(TRUTH, clip="table"), clips=[clip], notes=[])
    page = tmp_path / "compared.html"
    page.write_text(render_comparison(compare_runs(runs), report_link(page)), encoding="utf-8")
    set_width(browser, 1400)
    browser.get(page.as_uri())
    wait_until_drawn(browser)
    numbers = [words for words in _texts(browser, "#draw-differences .tick") if words]
    assert "0" in numbers
    assert "−0" not in numbers
    assert len(numbers) == len({*numbers})


def test_the_tables_are_sorted_by_any_column(browser: Chrome, page: Path) -> None:
    set_width(browser, 1400)
    browser.get(page.as_uri())
    wait_until_drawn(browser)
    browser.execute_script("document.querySelector('[data-table=\"1\"]').open = true")
    table = '[data-table="1"] '
    assert _texts(browser, table + ".head")[:3] == ["Configuration", "FRR %", "95 %"]
    rates = ["50.0", "50.0", "41.7", "16.7"]
    head = browser.find_elements("css selector", table + ".head")[1]
    for expected in (rates, rates[::-1]):
        head.click()
        assert _texts(browser, table + "tbody td:nth-child(2)") == expected
