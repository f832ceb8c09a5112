"""The labelling page in a browser: what clicks, drags and keys do to the file, and what is shown."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from harness.annotate.actions import Action
from harness.clips.manifest import load_manifest
from harness.clips.naming import NameRule
from harness.sources import Truth
from tests.annotating import STRIP, LabellingPage, write_labels
from tests.browser import dead_buttons, requested, set_width, wait_for
from tests.disk import write_text
from tests.exchanges import PlainClip
from vfoa.types import Image

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

Open = Callable[..., LabellingPage]
LEFT, RIGHT, HOME, END = "\ue012", "\ue014", "\ue011", "\ue010"
ENTER, ESCAPE, DELETE = "\ue007", "\ue00c", "\ue017"
SUGGESTED = "#timelines .current .suggested"
FITS = "return document.documentElement.scrollWidth <= innerWidth"


@pytest.mark.parametrize("width", [1280, 390], ids=["wide", "phone"])
def test_it_asks_nobody_else_complains_of_nothing_and_fits_the_screen(
    browser: Chrome, open_page: Open, work: Path, width: int
) -> None:
    set_width(browser, width)
    page = open_page(run=work / "run")
    page.keys("1", "h", "d", "r")
    here = page.address.partition("?")[0]
    assert [url for url in requested(browser) if not url.startswith(here)] == []
    assert browser.get_log("browser") == []
    assert page.js(FITS)
    assert page.js("return document.cookie") == ""
    assert browser.current_url == here


def test_a_long_name_in_one_word_fits_a_phone(browser: Chrome, open_page: Open, work: Path) -> None:
    long = "upper_drawer_of_the_kitchen_cabinet_on_the_left"
    manifest = work / "datasets" / "noise.toml"
    write_text(manifest, manifest.read_text().replace("[targets.cup]", f"[targets.{long}]"))
    set_width(browser, 390)
    page = open_page()
    assert long in page.text("#names")
    assert page.js(FITS)


def test_names_stand_in_the_strip_as_text_and_patterns_not_colour_alone(open_page: Open) -> None:
    page = open_page()
    page.keys("1", "]", "[")
    page.drag(4, 7)
    page.keys("i")
    pieces = page.all("#timelines .current .piece")
    assert [piece.get_attribute("textContent") for piece in pieces] == ["cup", "cup …", "ignore", "cup …"]
    assert "gradient" in page.js("return getComputedStyle(document.querySelector('.is-ignore.piece')).backgroundImage")


def test_a_click_on_an_object_holds_from_here_until_the_next_change(open_page: Open, work: Path) -> None:
    page = open_page(run=work / "run", blind=True)
    page.click('[data-name="book"]')
    page.keys(*[RIGHT] * 3)
    page.click('[data-name="cup"]')
    assert page.targets() == "bbbc........"
    page.keys(END)  # too far to have been seen on the way
    assert page.targets() == "bbbc........"
    page.keys("n")
    assert page.targets() == "bbbccccccccn"


def test_caps_lock_changes_no_key(open_page: Open) -> None:
    page = open_page()
    for key in "NSI":
        page.js("dispatchEvent(new KeyboardEvent('keydown', {key: arguments[0], code: `Key${arguments[0]}`}))", key)
        page.settle()
    assert (page.targets("ann"), page.targets("ben")) == ("n...........", "-...........")


def test_a_drag_on_the_strip_is_a_range(open_page: Open) -> None:
    page = open_page()
    page.drag(2, 5)
    page.keys("2")
    assert page.targets() == "..bbbb......"
    page.drag(5, 4)
    page.keys("n")
    assert page.targets() == "..bbnn......"
    page.drag(8, 9)
    page.keys("1")
    assert page.targets() == "..bbnn--cc.."
    page.drag(3, 8)
    page.keys(DELETE)
    assert page.targets() == "..b------c.."


def test_a_range_is_of_the_subject_on_whose_row_it_is_dragged(open_page: Open) -> None:
    page = open_page()
    page.drag(2, 5, on="#timelines [data-subject=ben] > div")
    page.keys("1")
    assert (page.targets("ann"), page.targets("ben")) == ("............", "..cccc......")


def test_a_click_while_it_plays_holds_from_the_frame_in_which_the_button_went_down(open_page: Open, work: Path) -> None:
    page = open_page(run=work / "run")
    page.keys("-", "-")
    page.js(
        "addEventListener('pointerdown', () => { window.pressed = Number(document.body.dataset.frame); }, true);"
        "document.getElementById('do-play').click()"
    )
    page.actions().move_to_element(page.find('#overlay [data-name="book"]')).click_and_hold().perform()
    pressed = page.js("return window.pressed")
    wait_for(lambda: page.shown != pressed)  # its outline was drawn anew
    page.actions().release().perform()
    page.keys("k")
    assert page.targets().startswith("." * (pressed - 1) + "b")


def test_clicks_wait_for_the_keys_before_them_on_a_slow_connection(open_page: Open, work: Path) -> None:
    page = open_page(run=work / "run")
    page.answer_slowly()
    book = page.find('#overlay [data-name="book"]')
    page.actions().send_keys("1]s").move_to_element(book).click().perform()
    page.settle()
    assert (page.targets("ann"), page.targets("ben")) == ("ccccc.......", "b...........")
    row = page.find("#timelines [data-subject=ann] > div")
    place = row.size["width"] * 5 // 24
    page.actions().send_keys("1s").move_to_element_with_offset(row, place, 0).click().send_keys("n").perform()
    page.settle()
    assert page.targets("ann") == "ccccccccn..."


@pytest.mark.parametrize("keys", ["1s", "1,s", "1.s", f"1a{ENTER}s"])
def test_no_key_waits_while_the_clip_plays_so_that_the_next_is_not_late(open_page: Open, work: Path, keys: str) -> None:
    page = open_page(run=work / "run")
    page.keys(*"---", *[RIGHT] * 7)  # 0.8 s a frame
    page.answer_slowly(3)
    page.actions().send_keys(" ", *keys, "2").perform()
    wait_for(lambda: page.shown != 8)
    page.actions().send_keys("k").perform()
    page.settle()
    assert page.session.state()["tracks"]["ben"][1][:3] == [7, 7, "book"]


@pytest.mark.parametrize("layer", ["overlay", "drawn"])
def test_an_image_that_is_dragged_on_an_object_labels_nothing_and_the_next_click_counts(
    open_page: Open, work: Path, layer: str
) -> None:
    page = open_page(run=work / "run") if layer == "overlay" else open_page()
    page.keys("p", "2", ENTER, "p", "v")
    page.actions().move_to_element(page.find(f'#{layer} [data-name="book"]')).click_and_hold().perform()
    for _ in range(2):
        page.actions().move_by_offset(-10, -10).perform()
        page.settle()
    page.actions().release().perform()
    page.settle()
    assert not page.session.path.exists()
    page.click('#names [data-target="cup"]')
    assert page.targets().startswith("c")


def test_a_long_clip_has_a_second_strip_with_frames_that_are_wide_enough(open_page: Open) -> None:
    class Long(PlainClip):
        def truth(self, number: int) -> Truth:
            return Truth()

        def left(self, number: int) -> Image:
            return self.frame(number).left

    page = open_page(open_clip=lambda _: Long(frames=range(1, 1001)))
    page.click(STRIP)
    middle = (page.shown or 0) - 1
    assert middle == pytest.approx(500, abs=2)
    page.drag(60, 69, on="#near .current > div", frames=120)  # the frame in hand is the 61st of them
    page.keys("2")
    assert page.session.state()["tracks"]["ann"][1][:3] == [middle, middle + 9, "book"]


def test_a_change_that_was_hit_late_can_be_moved(open_page: Open) -> None:
    page = open_page()
    page.keys("1", *[RIGHT] * 6, "2")
    assert page.targets() == "ccccccb....."
    page.keys(",", ",")
    assert page.targets() == "ccccbbb....."
    page.keys(".")
    assert page.targets() == "cccccbb....."


def test_a_second_tab_overwrites_nothing_and_is_shown_the_newer_state(open_page: Open) -> None:
    page = open_page()
    page.keys("1")
    with page.second_tab():
        page.session.make(Action(kind="range", subject="ann", at=0, last=5, target="book"))  # what the other tab does
        page.keys("n")
        assert "were changed elsewhere" in page.text("#notice")
        assert "ann: book" in page.text("#label")
        assert page.targets() == "bbbbbb......"
        page.keys("n")
        assert page.targets() == "bnnnnn......"


@pytest.mark.parametrize("by_a_change", [False, True])
def test_a_tab_that_is_behind_is_shown_the_new_targets_too(open_page: Open, by_a_change: bool) -> None:
    page = open_page()
    page.session.add_target("pen", NameRule(category="pen"))  # what another tab does
    if by_a_change:
        page.keys("1")
    else:
        page.js("dispatchEvent(new Event('focus'))")
        page.settle()
    page.keys("5")
    assert page.targets() == "p..........."


def test_targets_that_change_leave_the_page_at_the_frame_to_which_it_goes(open_page: Open) -> None:
    page = open_page()
    page.session.add_target("pen", NameRule(category="pen"))
    page.answer_slowly(of="GET")
    page.js("dispatchEvent(new Event('focus'))")
    page.actions().send_keys(*[RIGHT] * 9).perform()
    page.settle()
    assert page.shown == 10


def test_suggestions_are_taken_over_where_attention_is_high_and_count_when_confirmed(
    open_page: Open, work: Path
) -> None:
    page = open_page(run=work / "run")
    page.keys("a")
    assert page.targets() == "-------....."
    assert [each.text for each in page.all(SUGGESTED)] == ["? cup", "? book"]
    assert "0 of 24 labelled" in page.text("#share")
    page.keys(ENTER)  # confirm the first, go to the second
    assert page.targets() == "ccc----....."
    assert page.shown == 5
    page.keys(ENTER)
    assert page.targets() == "ccc-bbb....."


def test_from_which_attention_suggestions_are_taken_can_be_set(open_page: Open, work: Path) -> None:
    page = open_page(run=work / "run")
    slider = page.find("#plenty input")
    slider.send_keys(*[LEFT] * 6)  # from 0.5 to 0.2 by the left arrow
    assert page.shown == 1
    page.js("arguments[0].blur()", slider)
    page.keys("a")
    assert [each.text for each in page.all(SUGGESTED)] == ["? cup", "? book"]
    assert [stretch[:2] for stretch in page.session.state()["tracks"]["ann"]] == [[0, 3], [4, 7], [8, 11]]


def test_brackets_go_to_the_changes_that_the_run_suggests(open_page: Open, work: Path) -> None:
    page = open_page(run=work / "run")
    page.keys("1", "]", "2", "]", "n", "]")
    assert page.targets() == "ccccbbbbnnnn"


def test_the_frames_in_which_the_run_was_unsure_come_first(open_page: Open, work: Path) -> None:
    page = open_page(run=work / "run", uncertain_first=True)
    assert page.shown == 9
    seen = [page.shown_after("n", RIGHT) for _ in range(5)]
    assert seen == [10, 11, 12, 8, 4]  # nothing was predicted, then the least attention
    assert page.targets() == ".......nnnnn"


def test_q_goes_to_the_frames_to_label_first_and_a_label_ends_with_them(open_page: Open, work: Path) -> None:
    page = open_page(run=work / "run")
    blocks = [{"subject": "ann", "first": 2, "last": 4}, {"subject": "ann", "first": 7, "last": 8}]
    about = page.session.about() | {"label_first": blocks}
    page.session.about = lambda: about  # type: ignore[method-assign]
    page.open()
    assert len(page.all("#timelines .row em")) == 2
    page.keys("q")
    assert page.shown == 3  # after the first frame, where the page opens
    page.keys("1", "q")
    assert (page.targets(), page.shown) == ("..ccc.......", 8)
    page.click("#do-label-first")
    page.keys("2", "q")
    assert page.targets() == "..ccc--bb..."  # ignored: not labelled yet
    assert page.text("#notice") == "All frames to label first have a label."


def test_a_new_target_is_named_in_place_and_stands_in_the_manifest(open_page: Open, work: Path) -> None:
    page = open_page(run=work / "run")
    page.click('[data-name="clock#4"]')
    form = page.find("#new-target")
    assert form.find_element("name", "category").get_attribute("value") == "thing"
    form.find_element("name", "name").send_keys("wall clock")
    form.find_element("xpath", ".//button[text()='Add']").click()
    wait_for(lambda: page.all('[data-name="wall clock"]'))
    rule = load_manifest(str(page.session.manifest.path)).targets["wall clock"]
    assert (rule.category, rule.at_px) == ("thing", (55, 7))  # several of this category: by its place
    page.click('[data-name="wall clock"]')
    assert page.targets().startswith("w")


def test_a_target_is_added_once_however_often_enter_is_pressed(open_page: Open) -> None:
    page = open_page()
    page.keys("t")
    page.answer_slowly()
    page.actions().send_keys("mug", "\ue004", "mug", ENTER, ENTER).perform()
    wait_for(lambda: not page.find("#new-target").is_displayed())
    page.click("#names [title='change mug']")
    page.actions().send_keys("s", ENTER, ENTER).perform()
    wait_for(lambda: not page.find("#target").is_displayed())
    page.keys("5")
    asked = [url.rpartition("/api/")[2] for url in requested(page.browser)]
    assert [path for path in asked if path.startswith("target")] == ["target", "target/change"]
    assert {*load_manifest(str(page.session.manifest.path)).targets} == {"cup", "book", "mugs"}
    assert page.targets() == "m..........."


def test_a_name_that_was_refused_is_not_complained_of_when_another_is_taken(open_page: Open) -> None:
    page = open_page()
    page.keys("t")
    page.actions().send_keys("cup", "\ue004", "mug", ENTER).perform()
    wait_for(lambda: "exists already" in page.text("#notice"))
    page.find("#new-target [name=name]").send_keys("s", ENTER)
    wait_for(lambda: not page.find("#new-target").is_displayed())
    assert page.text("#notice") == ""


def test_a_note_is_written_with_its_label(open_page: Open) -> None:
    page = open_page()
    page.keys("i", "m")
    page.find("#note input").send_keys("eyes shut, blinks", ENTER)
    wait_for(lambda: '1,1,ann,ignore,"eyes shut, blinks"' in page.session.path.read_text())


def test_a_note_that_is_typed_before_its_form_opens_labels_nothing(open_page: Open) -> None:
    page = open_page()
    page.answer_slowly()
    page.actions().send_keys("1m", "blinx", "\ue003", "ks", "t").perform()
    page.settle()
    assert page.find("#note [name=note]").get_attribute("value") == "blinkst"
    page.find("#note [name=note]").send_keys(ENTER)
    page.settle()
    page.actions().send_keys("2t", "mug").perform()
    page.settle()
    form = page.find("#new-target")
    assert form.find_element("name", "name").get_attribute("value") == "mug"
    assert [stretch[2:4] for stretch in page.session.state()["tracks"]["ann"]] == [["book", ""]] * 2
    page.actions().send_keys(ESCAPE, "1sm", "ni", RIGHT).perform()
    page.settle()
    assert page.text("#notice") == "There is no label here to put a note on."
    assert page.targets("ben") == "............"


def test_a_note_is_on_the_label_for_which_its_form_was_opened(open_page: Open) -> None:
    page = open_page()
    page.keys("1", "s", "2", "s", "m")
    page.find("#note [name=note]").send_keys("eyes shut")
    page.click("#subjects button:nth-child(2)")
    page.find("#note [name=note]").send_keys(ENTER)
    page.settle()
    tracks = page.session.state()["tracks"]
    assert [tracks[name][0][3] for name in ("ann", "ben")] == ["eyes shut", ""]


def test_whoever_tabs_to_a_button_presses_it_and_stays_there(open_page: Open) -> None:
    page = open_page()
    button = page.find('[data-target="book"]')
    page.js("arguments[0].focus()", button)
    page.keys(ENTER)
    assert page.targets().startswith("b")
    assert page.focused == button
    assert button.get_attribute("aria-pressed") == "true"
    note = page.find("#do-note")
    page.js("arguments[0].focus()", note)
    page.keys(" ")  # presses it, plays nothing
    form = page.find("#note")
    assert form.is_displayed()
    page.keys(ESCAPE)
    assert not form.is_displayed()
    assert page.focused == note
    assert page.shown == 1


def test_keys_lead_to_what_is_unlabelled_and_to_what_is_undecided_and_round_again(open_page: Open, work: Path) -> None:
    rows = ("1,2,ann,cup,,", "3,4,ann,book,,suggested", "7,8,ann,cup,,", "9,10,ann,book,,suggested")
    write_labels(work, *rows, columns=("note", "state"))
    page = open_page()
    assert [page.shown_after(key) for key in "gggxxx"] == [5, 11, 5, 9, 3, 9]
    assert page.text("#unlabelled") == "ann: 4 without a label, 4 undecided"
    page.click("#unlabelled")
    assert page.shown == 11


def test_u_goes_from_the_least_sure_suggestion_to_surer_ones_and_round_again(open_page: Open, work: Path) -> None:
    page = open_page(run=work / "run")
    page.keys(RIGHT, RIGHT)
    assert [page.shown_after("u") for _ in range(9)] == [8, 4, 6, 7, 3, 1, 2, 5, 8]  # in 9 to 12 nothing was hit
    assert page.shown_after("U") == 5


def test_a_range_is_chosen_by_keys_and_the_axis_is_a_slider(open_page: Open) -> None:
    page = open_page()
    slider = page.find("#timelines [role=slider]")
    page.js("arguments[0].focus()", slider)
    page.keys(*[RIGHT] * 2, "b", *[RIGHT] * 3, "e", "2")
    assert page.targets() == "..bbbb......"
    assert slider.get_attribute("aria-valuenow") == "6"
    assert slider.get_attribute("aria-valuetext") == "frame 6, 0:00.5, ann: book"
    assert "book 3 to 6" in str(page.find("#timelines .current").get_attribute("aria-label"))


def test_the_axis_is_dragged_to_move_through_the_clip(open_page: Open) -> None:
    page = open_page()
    page.drag(2, 6, on="#timelines [role=slider]")
    assert page.shown == 7
    assert not page.find("#timelines u").is_displayed()


def test_an_enlarged_image_is_sent_in_detail_and_a_click_means_the_same_object(open_page: Open, work: Path) -> None:
    page = open_page(run=work / "run")
    page.keys("v")
    assert any("region=" in each for each in requested(page.browser))
    assert page.js("return document.querySelector('#picture canvas').width") < 64
    page.click('[data-name="book"]')
    assert page.targets().startswith("b")
    page.keys("V")
    assert page.js("return document.getElementById('overlay').getAttribute('viewBox')") == "0 0 64 48"


def test_the_wheel_keeps_what_is_under_the_pointer_there_and_names_legible_also_on_a_low_screen(
    browser: Chrome, open_page: Open, work: Path
) -> None:
    set_width(browser, 1366, 700)
    page = open_page(run=work / "run")
    size_px = "return parseFloat(getComputedStyle(document.querySelector('#overlay text')).fontSize) * {}".format(
        "document.getElementById('overlay').getScreenCTM().a"
    )
    assert page.js(size_px) == pytest.approx(17, abs=0.5)
    page.keys("d", "h")  # there is less room for the picture beside two others
    assert page.js(size_px) == pytest.approx(12 if page.find("#stage").size["width"] <= 500 else 17, abs=0.5)
    page.keys("d", "h")
    turn = """
        const [across, down] = arguments;
        const [overlay, box] = ['overlay', 'picture'].map((id) => document.getElementById(id));
        const { x, y, width, height } = (box.querySelector('canvas') ?? box).getBoundingClientRect();
        const at = { clientX: x + across * width, clientY: y + down * height };
        const seen = () => {
            const found = new DOMPoint(at.clientX, at.clientY).matrixTransform(overlay.getScreenCTM().inverse());
            return [found.x, found.y];
        };
        const before = seen();
        overlay.dispatchEvent(new WheelEvent('wheel', { deltaY: -1, bubbles: true, cancelable: true, ...at }));
        window.seen = seen;
        return before;"""
    before = page.js(turn, 0.25, 0.75)
    wait_for(lambda: page.js("return document.getElementById('overlay').viewBox.baseVal.width") < 60)
    assert before == pytest.approx([16, 36], abs=1)
    assert page.js("return window.seen()") == pytest.approx(before, abs=1)


def test_what_can_be_pressed_or_dragged_is_large_enough_and_all_fits_at_200_percent(
    browser: Chrome, open_page: Open, work: Path
) -> None:
    set_width(browser, 640, 450)  # 1280 by 900 at 200 %
    page = open_page(run=work / "run")
    small = page.js(
        "return [...document.querySelectorAll('button, select, input, summary, .row > div')]"
        ".filter((each) => each.offsetParent).map((each) => [each.outerHTML, each.getBoundingClientRect()])"
        ".filter(([, box]) => box.width < 24 || box.height < 24).map(([words]) => words)"
    )
    assert small == []
    assert page.js(FITS)
    unnamed = page.js(
        "return [...document.querySelectorAll('button, input, select, [role=img], [role=slider]')]"
        ".filter((each) => !(each.getAttribute('aria-label') || each.textContent.trim() || each.closest('label')))"
        ".map((each) => each.outerHTML)"
    )
    assert unnamed == []


def test_fast_presses_are_kept_when_the_page_is_reloaded_or_left(open_page: Open) -> None:
    page = open_page()
    before = page.session.state()["revision"]
    for leave in (page.browser.refresh, lambda: page.browser.get("about:blank")):
        page.open()  # and wait for it: before it has its state, it takes no keys
        page.actions().send_keys(*"12n" * 10).perform()
        leave()
        before += 30
        wait_for(lambda expected=before: page.session.state()["revision"] == expected, at_most_s=30)
    page.open()
    assert page.js("return dispatchEvent(new Event('beforeunload', {cancelable: true}))")  # nothing waits
    waits = page.js(
        "dispatchEvent(new KeyboardEvent('keydown', {key: '1', code: 'Digit1', bubbles: true}));"
        "return Promise.resolve().then(() => null)"
        ".then(() => !dispatchEvent(new Event('beforeunload', {cancelable: true})))"
    )
    assert waits  # a press that is not saved yet: the browser asks


def test_a_change_is_dragged_and_a_stretch_is_chosen_by_a_double_click(open_page: Open) -> None:
    page = open_page()
    page.drag(0, 5)
    page.keys("1")
    page.drag(6, 11)
    page.keys("2")
    assert page.targets() == "ccccccbbbbbb"
    page.drag(5.5, 2.5)
    assert page.targets() == "cccbbbbbbbbb"
    page.drag(2.5, 7.5)
    assert page.targets() == "ccccccccbbbb"
    page.keys("z")
    assert page.targets() == "cccbbbbbbbbb"
    page.actions().move_to_element(page.find(STRIP)).double_click().perform()
    wait_for(lambda: "frames 4 to 12" in page.text("#range"))
    page.keys("n")
    assert page.targets() == "cccnnnnnnnnn"
    page.keys(HOME, "c", "2")  # the same by keys
    assert page.targets() == "bbbnnnnnnnnn"


def test_keys_that_depend_on_labels_depend_on_those_that_are_not_saved_yet(open_page: Open) -> None:
    page = open_page()
    page.answer_slowly()
    page.actions().send_keys("1", *[RIGHT] * 3, "2", "cn").perform()
    page.settle()
    assert page.targets() == "cccnnnnnnnnn"
    page.actions().send_keys("z", HOME, *[RIGHT] * 5, "n", "..").perform()
    page.settle()
    assert (page.targets(), page.shown) == ("cccbbbbn....", 8)
    page.actions().send_keys(HOME, "2ff").perform()
    page.settle()
    assert page.text("#label") == "ann: book"


def test_a_key_behind_a_search_waits_for_it(open_page: Open) -> None:
    page = open_page()
    page.drag(0, 3)
    page.keys("1")
    page.drag(6, 9)
    page.keys("2", HOME)
    page.answer_slowly()
    page.actions().send_keys("n", "f2", "1").perform()
    page.settle()
    assert page.targets() == "nnnn--cccc.."


def test_f_finds_the_stretches_of_a_target_and_g_what_is_open_of_every_subject(open_page: Open, work: Path) -> None:
    write_labels(work, "1,3,ann,cup,", "4,6,ann,book,", "7,8,ann,cup,", "9,12,ann,none,", "1,9,ben,cup,")
    page = open_page()
    assert [page.shown_after(*keys) for keys in ("f1", "ff", "f2", "F1", "FF", "fn")] == [7, 1, 4, 1, 7, 9]
    page.keys("f", "3")
    assert page.text("#notice") == "ann never looks at ann."
    page.keys("f", ESCAPE, "1")  # lets go of it: the key labels again
    assert "ann: cup" in page.text("#label")
    assert page.text("#unlabelled") == "ann: all labelled; ben: 3 without a label"
    page.keys("g")
    assert (page.shown, page.text('#subjects [aria-pressed="true"]')) == (10, "ben")
    page.keys("2", RIGHT, RIGHT, "g")
    assert page.text("#notice") == "Every frame of every subject has a label."


@pytest.mark.parametrize("layer", ["overlay", "drawn"])
def test_a_click_on_an_object_after_f_finds_it_and_labels_nothing(open_page: Open, work: Path, layer: str) -> None:
    page = open_page(run=work / "run") if layer == "overlay" else open_page()
    page.keys("p", "2", ENTER, "p")
    page.drag(0, 5)
    page.keys("1")
    page.drag(6, 11)
    page.keys("2", HOME, "f")
    page.click(f'#{layer} [data-name="book"]')
    assert (page.targets(), page.shown) == ("ccccccbbbbbb", 7)


def test_the_keys_are_shown_above_all_and_the_speed_is_remembered(open_page: Open) -> None:
    page = open_page()
    assert "plays at ×1" in page.text("#frame")
    page.keys("+")
    page.open()
    assert "plays at ×2" in page.text("#frame")
    for end in ("?", ESCAPE):
        page.keys("?")
        box = page.find("#help").rect
        assert page.find("#help").is_displayed()
        assert 0 <= box["y"] <= 900 - box["height"]
        page.keys("1")  # does nothing now
        page.keys(end)
        assert not page.find("#help").is_displayed()
    page.click("#do-help")
    page.click("#help button")
    assert not page.find("#help").is_displayed()
    assert "not labelled" in page.text("#label")


def test_the_time_left_follows_from_the_pace_without_pauses(open_page: Open) -> None:
    page = open_page()
    page.drag(0, 5)
    page.keys("1")  # a quarter of 24 labels
    assert "left" not in page.text("#share")
    for _ in range(2):  # an hour each, of which 30 s count
        page.js("const now = performance.now(); performance.now = () => now + 3.6e6")
        page.keys("l")
    assert page.text("#share").endswith("labelled (25 %), about 4 min left")


def test_no_button_of_the_page_is_dead(browser: Chrome, open_page: Open, work: Path) -> None:
    page = open_page(run=work / "run")
    browser.get_log("browser")
    page.drag(2, 5)  # so that there is a range to loop
    page.keys("1", RIGHT, "a", "z")
    page.drag(2, 5)
    ids = page.js("return [...document.querySelectorAll('button')].map((each) => each.id || each.title)")
    assert {"do-play", "do-undo", "do-redo", "do-find", "do-drawing", "do-help", "unlabelled"} <= set(ids)
    assert dead_buttons(browser, "header button, #tools button, #names button, #drawing button") == []
    assert browser.get_log("browser") == []
