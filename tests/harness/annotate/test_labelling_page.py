"""The labelling page in a browser: what clicks, drags and keys do to the file, and what is shown."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from harness.annotate.actions import Action
from harness.clips.manifest import load_manifest
from harness.labels.files import read_annotations
from harness.labels.labels import Timeline
from harness.sources import Clip, Truth
from tests.annotating import FRAMES, Page, shown, wait_for
from tests.browser import dead_buttons, requested, set_width
from tests.disk import write_text
from vfoa.types import Image, StereoFrame

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

Start = Callable[..., Page]


def _is_settled(browser: Chrome) -> bool:
    return bool(browser.execute_script("return document.body.getAttribute('aria-busy') === 'false'"))


def _open(browser: Chrome, page: Page) -> None:
    browser.get(page.address)
    wait_for(lambda: shown(browser) is not None and _is_settled(browser))


def _keys(browser: Chrome, *keys: str) -> None:
    """Press keys, each after the page has shown and saved what the one before did."""
    from selenium.webdriver import ActionChains

    for key in keys:
        ActionChains(browser, duration=0).send_keys(key).perform()
        wait_for(lambda: _is_settled(browser))


def _click(browser: Chrome, selector: str) -> None:
    from selenium.webdriver import ActionChains

    ActionChains(browser, duration=0).move_to_element(browser.find_element("css selector", selector)).click().perform()
    wait_for(lambda: _is_settled(browser))


def _drag(browser: Chrome, first: int, last: int) -> None:
    """Drag over the strip, from one position to another."""
    from selenium.webdriver import ActionChains

    row = browser.find_element("css selector", "#timelines .current > div")
    width = row.size["width"] / len(FRAMES)
    middle = row.size["width"] / 2
    start, end = ((position + 0.5) * width - middle for position in (first, last))
    actions = ActionChains(browser, duration=0).move_to_element_with_offset(row, round(start), 0).click_and_hold()
    actions.move_by_offset(round(end - start), 0).release().perform()


def _targets(page: Page, subject: str = "ann") -> list[str]:
    """The scored labels, a letter per frame; ``-`` for ignore, ``.`` for unlabelled."""
    manifest = load_manifest(str(page.session.manifest.path))
    timeline = Timeline(frames=FRAMES, times_ns=())
    labels = read_annotations(page.file, timeline=timeline, subjects=manifest.subjects, targets=manifest.targets)
    found = [labels.confirmed().at(frame, subject) for frame in FRAMES]
    return ["." if each is None else "-" if each.target == "ignore" else each.target[0] for each in found]


@pytest.mark.parametrize("width", [1280, 390], ids=["wide", "phone"])
def test_it_asks_nobody_else_complains_of_nothing_and_fits_the_screen(
    browser: Chrome, noise: Start, work: Path, width: int
) -> None:
    page = noise(run=work / "run")
    set_width(browser, width)
    _open(browser, page)
    _keys(browser, "1", "h", "d", "r")
    here = f"http://127.0.0.1:{page.port}/"
    assert [url for url in requested(browser) if not url.startswith(here)] == []
    assert browser.get_log("browser") == []
    assert browser.execute_script("return document.documentElement.scrollWidth <= innerWidth")
    assert browser.execute_script("return document.cookie") == ""
    assert browser.current_url == here


def test_names_stand_in_the_strip_as_text_and_patterns_not_colour_alone(browser: Chrome, noise: Start) -> None:
    page = noise()
    _open(browser, page)
    _keys(browser, "1", "]", "[")
    _drag(browser, 4, 7)
    _keys(browser, "i")
    pieces = browser.find_elements("css selector", "#timelines .current .piece")
    assert [piece.get_attribute("textContent") for piece in pieces[:2]] == ["cup", "ignore"] or "cup" in pieces[0].text
    pattern = browser.execute_script(
        "return getComputedStyle(document.querySelector('.piece.is-ignore')).backgroundImage"
    )
    assert "gradient" in pattern


def test_a_click_on_an_object_holds_from_here_until_the_next_change(browser: Chrome, noise: Start, work: Path) -> None:
    page = noise(run=work / "run", blind=True)
    _open(browser, page)
    _click(browser, '[data-name="book"]')
    _keys(browser, *["\ue014"] * 3)  # the right arrow
    _click(browser, '[data-name="cup"]')
    assert _targets(page)[:4] == ["b", "b", "b", "c"]
    _keys(browser, "\ue010")  # End: too far to have been seen on the way
    assert _targets(page)[4:] == ["."] * 8
    _keys(browser, "n")
    assert "".join(_targets(page)) == "bbbccccccccn"


def test_a_drag_on_the_strip_is_a_range(browser: Chrome, noise: Start) -> None:
    page = noise()
    _open(browser, page)
    _drag(browser, 2, 5)
    _keys(browser, "2")
    assert "".join(_targets(page)) == "..bbbb......"
    _drag(browser, 5, 4)
    _keys(browser, "n")
    assert "".join(_targets(page)) == "..bbnn......"
    _drag(browser, 8, 9)
    _keys(browser, "1")
    assert "".join(_targets(page)) == "..bbnn--cc.."
    _drag(browser, 3, 8)
    _keys(browser, "\ue017")  # Delete
    assert "".join(_targets(page)) == "..b------c.."


def test_a_long_clip_has_a_second_strip_with_frames_that_are_wide_enough(browser: Chrome, noise: Start) -> None:
    from selenium.webdriver import ActionChains

    class Long:
        """The same twelve frames again and again, 1,000 in all."""

        frames = range(1, 1001)

        def __init__(self, clip: Clip) -> None:
            self._clip = clip

        def __getattr__(self, name: str) -> Any:
            return getattr(self._clip, name)

        def time_ns(self, number: int) -> int:
            return number * 40_000_000

        def truth(self, number: int) -> Truth:
            return Truth()

        def frame(self, number: int) -> StereoFrame:
            return replace(self._clip.frame((number - 1) % len(FRAMES) + 1), index=number)

        def left(self, number: int) -> Image:
            return self.frame(number).left

    page = noise(open_clip=lambda manifest: Long(manifest.open()))
    _open(browser, page)
    whole = browser.find_element("css selector", "#timelines .current > div")
    ActionChains(browser, duration=0).move_to_element(whole).click().perform()
    wait_for(lambda: shown(browser) != 1 and _is_settled(browser))
    middle = (shown(browser) or 0) - 1
    assert middle == pytest.approx(500, abs=2)
    near = browser.find_element("css selector", "#near .current > div")
    frame_px = near.size["width"] / 120  # the frame in hand is the 61st of them
    actions = (
        ActionChains(browser, duration=0).move_to_element_with_offset(near, round(0.5 * frame_px), 0).click_and_hold()
    )
    actions.move_by_offset(round(9 * frame_px), 0).release().perform()
    _keys(browser, "2")
    assert page.session.state()["tracks"]["ann"][1][:3] == [middle, middle + 9, "book"]


def test_a_change_that_was_hit_late_can_be_moved(browser: Chrome, noise: Start) -> None:
    page = noise()
    _open(browser, page)
    _keys(browser, "1", *["\ue014"] * 6, "2")
    assert "".join(_targets(page)) == "ccccccb....."
    _keys(browser, ",", ",")
    assert "".join(_targets(page)) == "ccccbbb....."
    _keys(browser, ".")
    assert "".join(_targets(page)) == "cccccbb....."


def test_a_second_tab_overwrites_nothing_and_is_shown_the_newer_state(browser: Chrome, noise: Start) -> None:
    page = noise()
    _open(browser, page)
    first = browser.current_window_handle
    _keys(browser, "1")
    browser.switch_to.new_window("tab")
    second = browser.current_window_handle
    try:
        browser.get(f"http://127.0.0.1:{page.port}/")
        wait_for(lambda: shown(browser) is not None and _is_settled(browser))
        page.session.make(Action(kind="range", subject="ann", at=0, last=5, target="book"))  # what the other tab does
        _keys(browser, "n")
        assert "were changed elsewhere" in browser.find_element("id", "notice").text
        assert "ann: book" in browser.find_element("id", "label").text
        assert "".join(_targets(page)) == "bbbbbb......"
        _keys(browser, "n")
        assert "".join(_targets(page)) == "bnnnnn......"
    finally:
        browser.switch_to.window(second)
        browser.close()
        browser.switch_to.window(first)


def test_suggestions_are_taken_over_where_attention_is_high_and_count_when_confirmed(
    browser: Chrome, noise: Start, work: Path
) -> None:
    page = noise(run=work / "run")
    _open(browser, page)
    _keys(browser, "a")
    assert "".join(_targets(page)) == "-------....."
    drawn = [each.text for each in browser.find_elements("css selector", "#timelines .current .suggested")]
    assert drawn == ["? cup", "? book"]
    assert "0 of 24 labelled" in browser.find_element("id", "share").text
    _keys(browser, "\ue007")  # Enter: confirm the first, go to the second
    assert "".join(_targets(page)) == "ccc----....."
    assert shown(browser) == 5
    _keys(browser, "\ue007")
    assert "".join(_targets(page)) == "ccc-bbb....."


def test_from_which_attention_suggestions_are_taken_can_be_set(browser: Chrome, noise: Start, work: Path) -> None:
    page = noise(run=work / "run")
    _open(browser, page)
    slider = browser.find_element("css selector", "#plenty input")
    slider.send_keys(*["\ue012"] * 6)  # from 0.5 to 0.2 by the left arrow
    assert shown(browser) == 1
    browser.execute_script("arguments[0].blur()", slider)
    _keys(browser, "a")
    drawn = [each.text for each in browser.find_elements("css selector", "#timelines .current .suggested")]
    assert drawn == ["? cup", "? book"]
    assert [stretch[:2] for stretch in page.session.state()["tracks"]["ann"]] == [[0, 3], [4, 7], [8, 11]]


def test_brackets_go_to_the_changes_that_the_run_suggests(browser: Chrome, noise: Start, work: Path) -> None:
    page = noise(run=work / "run")
    _open(browser, page)
    _keys(browser, "1", "]", "2", "]", "n", "]")
    assert "".join(_targets(page)) == "ccccbbbbnnnn"


def test_the_frames_in_which_the_run_was_unsure_come_first(browser: Chrome, noise: Start, work: Path) -> None:
    page = noise(run=work / "run", uncertain_first=True)
    _open(browser, page)
    seen = [shown(browser)]
    for _ in range(5):
        _keys(browser, "n", "\ue014")
        seen.append(shown(browser))
    assert seen == [9, 10, 11, 12, 8, 4]  # nothing was predicted, then the least attention
    assert "".join(_targets(page)) == ".......nnnnn"


def test_q_goes_to_the_frames_to_label_first_and_a_label_ends_with_them(
    browser: Chrome, noise: Start, work: Path
) -> None:
    page = noise(run=work / "run")
    page.session.about = partial(_advised, page.session.about)  # type: ignore[method-assign]
    _open(browser, page)
    assert len(browser.find_elements("css selector", "#timelines .row em")) == 2
    _keys(browser, "q")
    assert shown(browser) == 3  # after the first frame, where the page opens
    _keys(browser, "1", "q")
    assert ("".join(_targets(page)), shown(browser)) == ("..ccc.......", 8)
    _click(browser, "#do-label-first")
    _keys(browser, "2", "q")
    assert "".join(_targets(page)) == "..ccc--bb..."  # ignored: not labelled yet
    assert browser.find_element("id", "notice").text == "All frames to label first have a label."


def _advised(about: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    blocks = [{"subject": "ann", "first": 2, "last": 4}, {"subject": "ann", "first": 7, "last": 8}]
    return {**about(), "label_first": blocks}


def test_a_new_target_is_named_in_place_and_stands_in_the_manifest(browser: Chrome, noise: Start, work: Path) -> None:
    page = noise(run=work / "run")
    _open(browser, page)
    _click(browser, '[data-name="clock#4"]')
    form = browser.find_element("id", "new-target")
    assert form.find_element("name", "category").get_attribute("value") == "thing"
    form.find_element("name", "name").send_keys("wall clock")
    form.find_element("xpath", ".//button[text()='Add']").click()
    wait_for(lambda: browser.find_elements("css selector", '[data-name="wall clock"]'))
    rule = load_manifest(str(page.session.manifest.path)).targets["wall clock"]
    assert (rule.category, rule.at_px) == ("thing", (55, 7))  # several of this category: by its place
    _click(browser, '[data-name="wall clock"]')
    assert _targets(page)[0] == "w"


def test_a_note_is_written_with_its_label(browser: Chrome, noise: Start) -> None:
    page = noise()
    _open(browser, page)
    _keys(browser, "i", "m")
    browser.find_element("css selector", "#note input").send_keys("eyes shut, blinks\ue007")
    wait_for(lambda: '1,1,ann,ignore,"eyes shut, blinks"' in page.file.read_text())


def test_whoever_tabs_to_a_button_presses_it_and_stays_there(browser: Chrome, noise: Start) -> None:
    page = noise()
    _open(browser, page)
    button = browser.find_element("css selector", '[data-target="book"]')
    browser.execute_script("arguments[0].focus()", button)
    _keys(browser, "\ue007")  # Enter
    assert _targets(page)[0] == "b"
    assert browser.switch_to.active_element == button
    assert button.get_attribute("aria-pressed") == "true"
    note = browser.find_element("id", "do-note")
    browser.execute_script("arguments[0].focus()", note)
    _keys(browser, " ")  # presses it, plays nothing
    form = browser.find_element("id", "note")
    assert form.is_displayed()
    _keys(browser, "\ue00c")  # Escape
    assert not form.is_displayed()
    assert browser.switch_to.active_element == note
    assert shown(browser) == 1


def test_keys_lead_to_what_is_unlabelled_and_to_what_is_undecided_and_round_again(
    browser: Chrome, noise: Start, work: Path
) -> None:
    rows = [
        "1,2,ann,cup,,",
        "3,4,ann,book,,suggested",
        "7,8,ann,cup,,",
        "9,10,ann,book,,suggested",
    ]
    head = "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note,state\n"
    write_text(work / "annotations" / "noise.csv", head + "\n".join(rows) + "\n")
    _open(browser, noise())
    seen = []
    for key in "gggxxx":
        _keys(browser, key)
        seen.append(shown(browser))
    assert seen == [5, 11, 5, 9, 3, 9]
    assert browser.find_element("id", "unlabelled").text == "ann: 4 without a label, 4 undecided"
    _click(browser, "#unlabelled")
    assert shown(browser) == 11


def test_u_goes_from_the_least_sure_suggestion_to_surer_ones_and_round_again(
    browser: Chrome, noise: Start, work: Path
) -> None:
    _open(browser, noise(run=work / "run"))
    _keys(browser, "\ue014", "\ue014")
    seen = []
    for _ in range(9):
        _keys(browser, "u")
        seen.append(shown(browser))
    assert seen == [8, 4, 6, 7, 3, 1, 2, 5, 8]  # in 9 to 12 nothing was hit
    _keys(browser, "U")
    assert shown(browser) == 5


def test_a_range_is_chosen_by_keys_and_the_axis_is_a_slider(browser: Chrome, noise: Start) -> None:
    page = noise()
    _open(browser, page)
    slider = browser.find_element("css selector", "#timelines [role=slider]")
    browser.execute_script("arguments[0].focus()", slider)
    _keys(browser, *["\ue014"] * 2, "b", *["\ue014"] * 3, "e", "2")
    assert "".join(_targets(page)) == "..bbbb......"
    assert slider.get_attribute("aria-valuenow") == "6"
    assert slider.get_attribute("aria-valuetext") == "frame 6, 0:00.5, ann: book"
    assert "book 3 to 6" in (
        browser.find_element("css selector", "#timelines .current").get_attribute("aria-label") or ""
    )


def test_the_axis_is_dragged_to_move_through_the_clip(browser: Chrome, noise: Start) -> None:
    from selenium.webdriver import ActionChains

    _open(browser, noise())
    axis = browser.find_element("css selector", "#timelines [role=slider]")
    step = axis.size["width"] / len(FRAMES)
    actions = (
        ActionChains(browser, duration=0).move_to_element_with_offset(axis, round(-3.5 * step), 0).click_and_hold()
    )
    for _ in range(4):
        actions.move_by_offset(round(step), 0)
    actions.release().perform()
    wait_for(lambda: shown(browser) == 7 and _is_settled(browser))
    assert not browser.find_element("css selector", "#timelines u").is_displayed()


def test_an_enlarged_image_is_sent_in_detail_and_a_click_means_the_same_object(
    browser: Chrome, noise: Start, work: Path
) -> None:
    page = noise(run=work / "run")
    _open(browser, page)
    _keys(browser, "v")
    assert any("region=" in each for each in requested(browser))
    canvas = browser.find_element("css selector", "#picture canvas")
    assert int(canvas.get_attribute("width") or 0) < 64
    _click(browser, '[data-name="book"]')
    assert _targets(page)[0] == "b"
    _keys(browser, "V")
    box = browser.execute_script("return document.getElementById('overlay').getAttribute('viewBox')")
    assert box == "0 0 64 48"


def test_what_can_be_pressed_or_dragged_is_large_enough_and_all_fits_at_200_percent(
    browser: Chrome, noise: Start, work: Path
) -> None:
    set_width(browser, 640, 450)  # 1280 by 900 at 200 %
    _open(browser, noise(run=work / "run"))
    small = browser.execute_script(
        "return [...document.querySelectorAll('button, select, input, summary, .row > div')]"
        ".filter((each) => each.offsetParent).map((each) => [each.outerHTML, each.getBoundingClientRect()])"
        ".filter(([, box]) => box.width < 24 || box.height < 24).map(([words]) => words)"
    )
    assert small == []
    assert browser.execute_script("return document.documentElement.scrollWidth <= innerWidth")
    unnamed = browser.execute_script(
        "return [...document.querySelectorAll('button, input, select, [role=img], [role=slider]')]"
        ".filter((each) => !(each.getAttribute('aria-label') || each.textContent.trim() || each.closest('label')))"
        ".map((each) => each.outerHTML)"
    )
    assert unnamed == []


def test_fast_presses_are_kept_when_the_page_is_reloaded_or_left(browser: Chrome, noise: Start) -> None:
    from selenium.webdriver import ActionChains

    page = noise()
    before = page.session.state()["revision"]
    for leave in (browser.refresh, lambda: browser.get("about:blank")):
        _open(browser, page)  # and wait for it: before it has its state, it takes no keys
        actions = ActionChains(browser, duration=0)
        for number in range(30):
            actions.send_keys("12n"[number % 3])
        actions.perform()
        leave()
        before += 30
        wait_for(lambda expected=before: page.session.state()["revision"] == expected, at_most_s=30)
    _open(browser, page)
    assert browser.execute_script(
        "return dispatchEvent(new Event('beforeunload', {cancelable: true}))"
    )  # nothing waits
    waits = browser.execute_script(
        "dispatchEvent(new KeyboardEvent('keydown', {key: '1', code: 'Digit1', bubbles: true}));"
        "return Promise.resolve().then(() => null)"
        ".then(() => !dispatchEvent(new Event('beforeunload', {cancelable: true})))"
    )
    assert waits  # a press that is not saved yet: the browser asks


def test_a_change_is_dragged_and_a_stretch_is_chosen_by_a_double_click(browser: Chrome, noise: Start) -> None:
    from selenium.webdriver import ActionChains

    page = noise()
    _open(browser, page)
    _drag(browser, 0, 5)
    _keys(browser, "1")
    _drag(browser, 6, 11)
    _keys(browser, "2")
    assert "".join(_targets(page)) == "ccccccbbbbbb"

    def drag_change(change: int, to: int) -> None:
        row = browser.find_element("css selector", "#timelines .current > div")
        width = row.size["width"] / len(FRAMES)
        start = round((change - len(FRAMES) / 2) * width)
        actions = ActionChains(browser, duration=0).move_to_element_with_offset(row, start, 0).click_and_hold()
        actions.move_by_offset(round((to - change) * width), 0).release().perform()
        wait_for(lambda: _is_settled(browser))

    drag_change(6, 3)
    assert "".join(_targets(page)) == "cccbbbbbbbbb"
    drag_change(3, 8)
    assert "".join(_targets(page)) == "ccccccccbbbb"
    _keys(browser, "z")
    assert "".join(_targets(page)) == "cccbbbbbbbbb"
    row = browser.find_element("css selector", "#timelines .current > div")
    ActionChains(browser, duration=0).move_to_element(row).double_click().perform()
    wait_for(lambda: "frames 4 to 12" in browser.find_element("id", "range").text)
    _keys(browser, "n")
    assert "".join(_targets(page)) == "cccnnnnnnnnn"
    _keys(browser, "\ue011", "c", "2")  # Home; the same by keys
    assert "".join(_targets(page)) == "bbbnnnnnnnnn"


def test_f_finds_the_stretches_of_a_target_and_g_what_is_open_of_every_subject(
    browser: Chrome, noise: Start, work: Path
) -> None:
    rows = ["1,3,ann,cup,", "4,6,ann,book,", "7,8,ann,cup,", "9,12,ann,none,", "1,9,ben,cup,"]
    head = "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note\n"
    write_text(work / "annotations" / "noise.csv", head + "\n".join(rows) + "\n")
    _open(browser, noise())
    seen = []
    for keys in ("f1", "ff", "f2", "F1", "FF", "fn"):
        _keys(browser, *keys)
        seen.append(shown(browser))
    assert seen == [7, 1, 4, 1, 7, 9]
    _keys(browser, "f", "3")
    assert browser.find_element("id", "notice").text == "ann never looks at ann."
    _keys(browser, "f", "\ue00c", "1")  # Escape lets go of it: the key labels again
    assert "ann: cup" in browser.find_element("id", "label").text
    assert browser.find_element("id", "unlabelled").text == "ann: all labelled; ben: 3 without a label"
    _keys(browser, "g")
    assert (shown(browser), browser.find_element("css selector", '#subjects [aria-pressed="true"]').text) == (10, "ben")
    _keys(browser, "2", "\ue014", "\ue014", "g")
    assert browser.find_element("id", "notice").text == "Every frame of every subject has a label."


def test_the_keys_are_shown_above_all_and_the_speed_is_remembered(browser: Chrome, noise: Start) -> None:
    _open(browser, noise())
    assert "plays at ×1" in browser.find_element("id", "frame").text
    _keys(browser, "+")
    browser.refresh()
    wait_for(lambda: shown(browser) is not None and _is_settled(browser))
    assert "plays at ×2" in browser.find_element("id", "frame").text
    for end in ("?", "\ue00c"):
        _keys(browser, "?")
        box = browser.find_element("id", "help").rect
        assert browser.find_element("id", "help").is_displayed()
        assert box["y"] >= 0
        assert box["y"] + box["height"] <= 900
        _keys(browser, "1")  # does nothing now
        _keys(browser, end)
        assert not browser.find_element("id", "help").is_displayed()
    _click(browser, "#do-help")
    _click(browser, "#help button")
    assert not browser.find_element("id", "help").is_displayed()
    assert "not labelled" in browser.find_element("id", "label").text


def test_the_time_left_follows_from_the_pace_without_pauses(browser: Chrome, noise: Start) -> None:
    _open(browser, noise())
    _drag(browser, 0, 5)
    _keys(browser, "1")  # a quarter of 24 labels
    assert "left" not in browser.find_element("id", "share").text
    for _ in range(2):  # an hour each, of which 30 s count
        browser.execute_script("const now = performance.now(); performance.now = () => now + 3.6e6")
        _keys(browser, "l")
    assert browser.find_element("id", "share").text.endswith("labelled (25 %), about 4 min left")


def test_no_button_of_the_page_is_dead(browser: Chrome, noise: Start, work: Path) -> None:
    _open(browser, noise(run=work / "run"))
    browser.get_log("browser")
    _drag(browser, 2, 5)  # so that there is a range to loop
    _keys(browser, "1", "\ue014", "a", "z")
    _drag(browser, 2, 5)
    ids = browser.execute_script("return [...document.querySelectorAll('button')].map((each) => each.id || each.title)")
    assert {"do-play", "do-undo", "do-redo", "do-find", "do-drawing", "do-help", "unlabelled"} <= set(ids)
    assert dead_buttons(browser, "header button, #tools button, #names button, #drawing button") == []
    assert browser.get_log("browser") == []
