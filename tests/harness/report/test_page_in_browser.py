"""The report page where it is read: in a browser, from disk."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import msgspec
import numpy as np
import pytest
from PIL import Image, ImageColor

from harness.files.io import atomic_write
from harness.labels.labels import Label, LabelRange, Labels
from harness.report.page.data import ERROR_COLOURS
from harness.report.thumbnails import Thumbnail, ThumbnailSubject, lines_path, picture_path
from harness.report.thumbnails.writer import picture
from harness.report.write import report_page
from harness.run.records import FrameRecord, TargetRecord
from harness.score.reference import Reference
from harness.score.verdicts import ERROR_TYPES
from tests.browser import BrowserPage, point_at, requested, set_width, wait_for, wait_until_drawn
from tests.records import (
    answers,
    frame_record,
    labels,
    score_run,
    subject_record,
    target_record,
    write_clip,
    write_run,
)

if TYPE_CHECKING:
    from selenium.webdriver import Chrome
    from selenium.webdriver.remote.webelement import WebElement

CUP, CAN = target_record(1, "cup"), target_record(2, "can")
TRUTH = ("cup", "cup", "dragon", "none", "ignore", "cup")
GIVEN = {
    "one": ("cup", "dragon", "dragon", "cup", "cup", None),
    "it's two": ("cup", "cup", "dragon", "none", "cup", "cup"),
}
LEFT, RIGHT, DOWN, PAGE_DOWN = "\ue012", "\ue014", "\ue015", "\ue00f"
ENTER, ESCAPE = "\ue007", "\ue00c"
PICTURE_RGB = (200, 40, 160)
SEEN = Thumbnail(
    frame=2,
    size=(200, 100),
    boxes=[(1, "cup", (20, 30, 60, 70)), (2, "dragon", (120, 30, 160, 70)), (3, "lamp", (180, 10, 190, 30))],
    subjects=[ThumbnailSubject(name="girl", head=(90, 5, 110, 25), focus=2, lines=[("gaze", [100, 15, 140, 50])])],
)
"""The verdict of frame 2, whose truth is the cup and whose answer is the dragon."""


class ReportPage(BrowserPage):
    """A report page in the browser, as a person reads it."""

    def open(self, path: Path, *, width_px: int = 1280, **shown: Any) -> None:
        """Open the page of a run, as at an address with what is shown, and wait until it has drawn everything."""
        self.browser.get("about:blank")
        self.browser.get_log("browser")
        requested(self.browser)
        set_width(self.browser, width_px)
        self.browser.get(path.as_uri() + ("#" + _address(**shown) if shown else ""))
        wait_until_drawn(self.browser)

    def wait(self, condition: Callable[[], Any], said: str = "") -> Any:
        """What a condition returns, as soon as it holds."""
        return wait_for(condition, said)

    @contextmanager
    def media(self, **emulated: Any) -> Iterator[None]:
        """Show pages as this says (CDP's ``setEmulatedMedia``) until the block ends."""
        self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", emulated)
        try:
            yield
        finally:
            self.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "", "features": []})

    def click(self, part: WebElement) -> None:
        """Click a part, also one that something covers or that is drawn as SVG."""
        self.js("arguments[0].dispatchEvent(new MouseEvent('click', {bubbles: true}))", part)

    def press(self, *keys: str) -> None:
        self.find("#timeline").send_keys(*keys)

    def box(self, text: str) -> str:
        """The text of a frame's box, as soon as it contains this."""
        box = self.find("#frame")
        self.wait(lambda: text in box.text, text)
        return box.text

    def button(self, words: str) -> WebElement:
        """The part of a figure whose label begins with these words, as soon as it is drawn."""
        return self.wait(lambda: self.all(f'[role="button"][aria-label^="{words}"]'), words)[0]

    def wait_for_place(self, configuration: str, clip: str, subject: str, frame: int | str) -> None:
        canvas, place = self.find("#timeline"), [configuration, clip, subject, str(frame)]
        keys = ("data-config", "data-clip", "data-subject", "data-frame")
        self.wait(lambda: [canvas.get_attribute(key) for key in keys] == place, str(place))


def _address(**shown: Any) -> str:
    return "&".join(f"{key}={value}" for key, value in shown.items())


def _write(run: Path, given: Mapping[str, Sequence[str | None]], **truth: Sequence[str]) -> Path:
    """The page of a run of these clips, each with the answers that the configurations give."""
    records = [
        record
        for clip in truth
        for name, answered in given.items()
        for record in answers(answered, configuration=name, clip=clip)
    ]
    return _write_records(run, records, **truth)


def _write_records(run: Path, records: Sequence[FrameRecord], **truth: Sequence[str]) -> Path:
    score_run(run, records, Reference(labels={clip: labels(*targets) for clip, targets in truth.items()}))
    return run / "report.html"


@pytest.fixture
def report(chrome: Chrome) -> ReportPage:
    return ReportPage(chrome)


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of two clips under two configurations, with the picture of one wrong frame."""
    run = tmp_path_factory.mktemp("a run")
    _write_picture(run, "clip", 2)
    atomic_write(lines_path(run, "clip", "one"), msgspec.json.encode(SEEN) + b"\n")
    return _write(run, GIVEN, clip=TRUTH, other=TRUTH)


def _write_picture(run: Path, clip: str, frame: int) -> None:
    atomic_write(picture_path(run, clip, frame), picture(np.full((100, 200, 3), PICTURE_RGB, dtype=np.uint8)))


@pytest.fixture(params=[1280, 390], ids=["wide", "phone"])
def page(report: ReportPage, small: Path, request: pytest.FixtureRequest) -> ReportPage:
    """The small page, freshly opened."""
    report.open(small, width_px=request.param)
    return report


def test_it_asks_nobody_for_anything_complains_of_nothing_and_fits(page: ReportPage, small: Path) -> None:
    for fold in page.all("details:not([open]) > summary"):
        page.click(fold)
    assert requested(page.browser) == [small.as_uri()]
    assert page.browser.get_log("browser") == []
    assert page.js("return document.documentElement.scrollWidth <= innerWidth")


def test_a_frame_of_a_run_without_recordings_has_no_command_that_opens_one(report: ReportPage, tmp_path: Path) -> None:
    reference = Reference(labels={"clip": labels(*TRUTH)}, is_recorded=False)
    score_run(tmp_path, answers(GIVEN["one"], configuration="one"), reference)
    report.open(tmp_path / "report.html", clip="clip", config="one", subject="girl", frame=2)
    assert "--recording light" in report.box("Frame 2 – wrong")
    assert report.all("#frame code") == []


def test_a_page_outside_its_run_has_the_commands_that_open_frames_of_that_run(
    report: ReportPage, tmp_path: Path
) -> None:
    clips, said = [write_clip(tmp_path, "clip", TRUTH)], answers([*GIVEN["one"][:5], "cup"], clip="clip")
    directory = write_run(tmp_path / "my runs" / "1", said, clips=clips, recording="light")
    page = tmp_path / "pages" / "cups.html"
    atomic_write(page, report_page(directory, None, "target=cup", "../my%20runs/1/"))
    report.open(page, clip="clip", config="one", subject="girl", frame=2)
    report.box("Frame 2 – wrong")
    assert report.find("#frame code").text.startswith(f"vfoa view '{directory.path}' --clip clip ")
    assert f"(vfoa view '{directory.path}' --failures)" in report.find("#verdict").text
    report.js("for (const fold of document.querySelectorAll('details')) fold.open = true")
    notes = "return [...document.querySelectorAll('details[data-table] li')].map((note) => note.textContent).join()"
    wait_for(lambda: f"vfoa view '{directory.path}'" in report.js(notes))
    assert "RUN" not in report.js(notes)


@pytest.mark.parametrize("width_px", [1280, 390])
def test_names_of_any_length_fit(report: ReportPage, tmp_path: Path, width_px: int) -> None:
    long = "a_name_of_cones_of_ten_and_of_twenty_five_centimetres_on_the_eighth_of_the_month_in_the_other_room"
    given = {"one": GIVEN["one"], long: GIVEN["it's two"]}
    report.open(_write(tmp_path, given, **{long: TRUTH, "other": TRUTH}), width_px=width_px)
    assert report.js("return document.documentElement.scrollWidth <= innerWidth")


@pytest.mark.parametrize("width_px", [1280, 390])
def test_long_names_that_differ_at_their_ends_are_told_apart_and_keep_their_rates(
    report: ReportPage, tmp_path: Path, width_px: int
) -> None:
    name = "cones_of_ten_and_of_twenty_five_centimetres_and_a_mean_of_gaze_and_head_{}"
    given = {name.format(number): answers for number, answers in enumerate(GIVEN.values())}
    report.open(_write(tmp_path, given, **{name.format("clip"): TRUTH, "other": TRUTH}), width_px=width_px)
    for figure, rates in (("#draw-forest figure", ("40.0 %", "100.0 %")), ("#draw-errors figure", ("60.0 %", "0.0 %"))):
        words = report.find(f"{figure} svg").text.replace("\n", " ")
        for number, rate in enumerate(rates):
            assert "…" in words
            assert f"_{number} " in words
            assert rate in words


def test_the_first_screen_is_the_answer(page: ReportPage) -> None:
    best, baseline, difference = page.find("#verdict").text.split("\n")
    assert best.startswith("Best of 2: it's two, right in 100.0 % ")
    assert "simple rule" in baseline
    assert "one or it's two" in difference
    assert "60.0 points" in difference
    for rate in ("one: FRR 40.0 %", "it's two: FRR 100.0 %"):
        assert "n 10," in str(page.button(rate).get_attribute("aria-label"))
    low = page.find("#draw-forest [role=button]").rect
    assert low["y"] + low["height"] < 900


def test_the_keyboard_goes_from_failure_to_failure_round_and_round(page: ReportPage, small: Path) -> None:
    assert not page.find("#frame").is_displayed()
    for frame, truth, predicted, error_type in (
        (2, "cup", "dragon", "missed"),
        (4, "none", "cup", "false_attention"),
        (6, "cup", "no prediction", "no_subject"),
        (2, "cup", "dragon", "missed"),  # of the other clip
    ):
        page.press("n")
        text = page.box(f"Frame {frame} – wrong")
        assert f"Truth: {truth}. Predicted: {predicted}." in text
        assert ERROR_TYPES[error_type].lower() in text.lower()
        assert f"frame={frame}" in page.browser.current_url
        outcome = f"wrong: {error_type.replace('_', ' ')}. Truth {truth}, predicted {predicted}."
        assert page.find("#timeline").get_attribute("aria-valuetext") == f"Frame {frame}, girl, one: {outcome}"
    page.press("p")
    page.box("Frame 6 – wrong")
    page.press(DOWN)
    page.box("Frame 6 – correct")
    command = page.find("#frame code").text
    assert command == f"""vfoa view '{small.parent}' --clip clip --config 'it'"'"'s two' --frame 6 --subject girl"""
    page.press(ESCAPE)
    page.wait(lambda: not page.find("#frame").is_displayed())


@pytest.fixture(scope="module")
def crowded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of two clips, subjects and configurations with five wrong frames; frame numbers are 1 and 2."""
    run, wrong = tmp_path_factory.mktemp("crowded"), set(WRONG)
    records = []
    for clip, name, frame in product(("a", "b"), ("one", "two"), (1, 2)):
        focus = {who: 2 if (name, clip, who, frame) in wrong else 1 for who in ("girl", "boy")}
        subjects = [
            subject_record(who, totals={given: 0.5}, focus=given, track_id=track)
            for track, (who, given) in enumerate(focus.items())
        ]
        records.append(frame_record([CUP, CAN], subjects, frame=frame, clip=clip, configuration=name))
    both = Labels(row for who in ("girl", "boy") for row in labels("cup", "cup", subject=who).ranges)
    score_run(run, records, Reference(labels={"a": both, "b": both}))
    return run / "report.html"


WRONG = (
    ("one", "a", "boy", 1),
    ("one", "a", "girl", 2),
    ("one", "b", "boy", 1),
    ("one", "b", "boy", 2),
    ("two", "a", "girl", 1),
)
"""Configuration, clip, subject and frame of each wrong frame, in the order in which N visits them."""


def test_keys_visit_the_wrong_frames_of_all_configurations_clips_and_subjects(
    report: ReportPage, crowded: Path
) -> None:
    report.open(crowded)
    for place in (*WRONG, *WRONG[:2]):
        report.press("n")
        report.wait_for_place(*place)
    for place in (WRONG[0], *WRONG[::-1]):
        report.press("p")
        report.wait_for_place(*place)
    report.press("n", "n", "n")  # faster than the page is drawn
    report.wait_for_place(*WRONG[3])


def test_keys_stay_in_what_was_selected_in_a_figure(report: ReportPage, crowded: Path) -> None:
    report.open(crowded, clip="b", config="two", subject="girl", frame=1)
    report.wait_for_place("two", "b", "girl", 1)
    report.button("one: 4 of 8 frames missed").send_keys(ENTER)  # of all clips
    for place in (*WRONG[:4], *WRONG[:1]):
        report.wait_for_place(*place)
        report.press("n")
    report.click(report.button("one: truth cup, answer can: 2 of 4"))  # of the first clip
    for place in (*WRONG[:2], *WRONG[:1]):
        report.wait_for_place(*place)
        report.press("n")
    assert report.find(".chip").text.startswith("N and P: cup answered as can, one, a")
    for key, place in (("n", WRONG[0]), ("p", WRONG[1])):
        report.js("location.hash = arguments[0]", _address(clip="b", config="two", subject="girl", frame=1))
        report.wait_for_place("two", "b", "girl", 1)
        report.press(key)
        report.wait_for_place(*place)


def test_a_frame_whose_number_is_a_time_stamp_is_named_to_the_last_digit(report: ReportPage, tmp_path: Path) -> None:
    """JavaScript's numbers have 53 bits, a stamp in nanoseconds 61."""
    stamps = [1_764_320_399_950_000_001 + 40_000_001 * number for number in range(4)]
    given = answers(["cup", "cup", "cup", "dragon"])
    records = [replace(record, frame=stamp) for stamp, record in zip(stamps, given, strict=True)]
    cup = Label(target="cup")
    truth = Labels(LabelRange(first_frame=stamp, last_frame=stamp, subject="girl", label=cup) for stamp in stamps)
    score_run(tmp_path, records, Reference(labels={"clip": truth}))
    report.open(tmp_path / "report.html")
    report.press("n")
    assert f"Frame {stamps[-1]} " in report.box("Frame")
    report.wait(lambda: report.browser.current_url.endswith(f"frame={stamps[-1]}"))
    report.open(tmp_path / "report.html", clip="clip", config="one", subject="girl", frame=stamps[1])
    report.wait_for_place("one", "clip", "girl", stamps[1])


@pytest.mark.parametrize(
    "gone", [{"clip": "gone"}, {"config": "gone"}, {"subject": "gone"}, {"frame": 7}], ids=lambda gone: next(iter(gone))
)
def test_an_address_of_another_run_shows_no_frame_as_if_it_were_that_one(
    report: ReportPage, small: Path, gone: dict[str, Any]
) -> None:
    report.open(small, **{"clip": "other", "config": "one", "subject": "girl", "frame": 2} | gone)
    report.wait_for_place("one", "clip" if "clip" in gone else "other", "girl", "")
    assert not report.find("#frame").is_displayed()
    ((key, name),) = gone.items()
    assert f"{key} {name}" in report.find("#said.seen").text
    report.press("n")
    report.box("Frame 2 – wrong")
    assert not report.all("#said.seen")


def test_the_address_of_a_section_leads_there_and_chooses_no_clip(report: ReportPage, small: Path) -> None:
    report.open(small, clip="other", config="one", subject="girl", frame=2)
    report.box("Frame 2 – wrong")
    report.js("location.hash = 'confusion'")
    report.press(RIGHT)
    report.wait_for_place("one", "other", "girl", 3)


def test_a_click_that_finds_no_frame_says_so(report: ReportPage, small: Path) -> None:
    report.open(small)
    report.click(report.button("it's two: FRR 100.0 %"))
    report.wait(lambda: report.all("#said.seen"))
    assert report.find("#timeline").get_attribute("data-frame") == ""


def test_pointing_at_a_frame_shows_its_attention_and_a_click_keeps_it(page: ReportPage) -> None:
    point_at(page.browser, "one", 2).perform()
    page.box("Frame 2 – wrong")
    rows = [row.text for row in page.all("#frame tr")]
    assert rows == ["Attention total gaze head", "dragon (predicted) 0.50 0.50 –"]
    point_at(page.browser, "it's two", 3).click().perform()
    page.box("Frame 3 – correct")
    assert "frame=3" in page.browser.current_url


WRONG_OF_LONG = (*range(400, 410), 777, 1490)


@pytest.fixture(scope="module")
def long(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of 1,500 frames of which twelve are wrong, the last of them without a person."""
    run = tmp_path_factory.mktemp("long")
    given = [{1490: None}.get(frame, "dragon") if frame in WRONG_OF_LONG else "cup" for frame in range(1, 1501)]
    return _write(run, {"one": given}, clip=["cup"] * 1500)


def test_a_column_of_words_among_numbers_is_sorted(report: ReportPage, small: Path) -> None:
    report.open(small)
    fold = report.find("#rates ~ details[data-table]")
    report.js("arguments[0].open = true", fold)
    (head,) = report.wait(lambda: fold.find_elements("xpath", ".//th[.='Beaten']/button"))
    column = "return [...arguments[0].querySelectorAll('tbody tr')].map((row) => row.cells[arguments[1]].textContent)"
    place = report.js("return arguments[0].parentElement.cellIndex", head)
    before = report.js(column, fold, place)
    assert len({*before}) == 2
    report.click(head)
    assert report.js(column, fold, place) == sorted(before, reverse=True)
    report.click(head)
    assert report.js(column, fold, place) == sorted(before)


@pytest.mark.parametrize("width", [1280, 390])
def test_a_wrong_frame_among_1500_is_found_by_keys_clicks_and_the_filter(
    report: ReportPage, long: Path, width: int
) -> None:
    report.open(long, width_px=width)
    for key, frames in (("n", WRONG_OF_LONG), ("p", WRONG_OF_LONG[-2::-1])):
        for frame in frames:
            report.press(key)
            report.wait_for_place("one", "clip", "girl", frame)
    report.press(RIGHT, PAGE_DOWN, LEFT)
    report.wait_for_place("one", "clip", "girl", 425)
    point_at(report.browser, "one", 777).click().perform()  # its pixel holds others that are right
    report.wait_for_place("one", "clip", "girl", 777)
    report.box("Frame 777 – wrong: missed")
    report.js("document.getElementById('wrong-frames').open = true")
    links = "#wrong-frames tbody a"
    report.wait(lambda: len(report.all(links)) == 12)
    report.find("#wrong-frames input").send_keys("no subject")
    (link,) = report.all(links)
    report.click(link)  # the box of the frame shown covers it
    report.box("Frame 1490 – wrong: no subject")


def test_the_canvas_has_the_outcome_of_each_frame(report: ReportPage, small: Path) -> None:
    report.open(small)
    one, two = (_pixels_of_strip(report, name, len(TRUTH)) for name in GIVEN)
    right, wrong = one[:2]
    assert one[2] == two[0] == two[1] == right
    assert len({right, wrong, *one[3:]}) == 5  # three error types, and unscored


def test_a_page_without_labels_shows_what_people_look_at_over_time(report: ReportPage, tmp_path: Path) -> None:
    page = _write_records(tmp_path, answers(["cup", "cup", "dragon", "cup"]))
    report.open(page)
    assert report.browser.get_log("browser") == []
    cup, again, dragon, later = _pixels_of_strip(report, "one", 4)
    assert cup == again == later != dragon
    row = report.find("#answers ~ details[open] tbody tr").text
    assert row == "clip one girl cup 75.0, dragon 25.0 4 100.0"
    assert report.all("button[aria-label*='wrong frame']") == []
    report.press(RIGHT)
    assert "Predicted: cup." in report.box("Frame 1 ")
    first, *_ = (tmp_path / "frr.md").read_text().splitlines()
    assert first == "# Answers in clips without labels"


def _given(*targets: TargetRecord, **subject: Any) -> FrameRecord:
    """A frame in which the girl looks as this says."""
    return frame_record(targets or [CUP], [subject_record("girl", **subject)])


MISSING = ("no_eyes_3d", "no_direction", "no_answer", "no_object")
TURNED_AWAY = replace(subject_record("girl", missing="no_direction"), no_gaze="face_turned_away")
ONE_OF_EACH = {
    "correct": (answers(["cup"])[0], "cup"),
    "unscored": (answers(["cup"])[0], "ignore"),
    "no_subject": (frame_record([CUP]), "cup"),
    "face_turned_away": (frame_record([CUP], [TURNED_AWAY]), "cup"),
    **{name: (_given(missing=name), "cup") for name in MISSING},
    "target_not_segmented": (_given(CAN, totals={2: 0.5}, focus=2), "cup"),
    "target_without_box": (_given(target_record(1, "cup", center=None)), "cup"),
    "false_attention": (answers(["cup"])[0], "none"),
    "wrong_subject": (_given(CUP, target_record(8, "girl"), totals={8: 0.5}, focus=8), "cup"),
    "no_hit": (_given(totals={1: 0.0}), "cup"),
    "missed": (_given(CUP, CAN, totals={2: 0.5}, focus=2), "cup"),
    "outscored": (_given(totals={1: 0.2}), "cup"),
}
"""For each state of a frame, a record that has it, and the true target."""


@pytest.fixture(scope="module")
def colourful(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of one subject whose frames have one state after the other."""
    run = tmp_path_factory.mktemp("states")
    records = [replace(record, frame=frame) for frame, (record, _) in enumerate(ONE_OF_EACH.values(), start=1)]
    return _write_records(run, records, clip=[target for _, target in ONE_OF_EACH.values()])


@pytest.mark.parametrize(("mode", "scheme"), [(0, "light"), (1, "dark")])
def test_every_error_type_has_a_colour_of_its_own_in_all_figures(
    report: ReportPage, colourful: Path, mode: int, scheme: str
) -> None:
    with report.media(features=[{"name": "prefers-color-scheme", "value": scheme}]):
        report.open(colourful)
        drawn = dict(zip(ONE_OF_EACH, _pixels_of_strip(report, "one", len(ONE_OF_EACH)), strict=True))
        bars, swatches = (
            [_pixel(each) for each in report.all(f"#draw-errors {of}")] for of in (".part rect", ".swatch")
        )
        ground = _rgb(report.js("return getComputedStyle(document.body).backgroundColor"))
        wrong = [drawn[name] for name in ERROR_TYPES]
        assert wrong == [ImageColor.getrgb(ERROR_COLOURS[name][mode]) for name in ERROR_TYPES]
        assert bars == swatches == wrong
    assert len({*drawn.values(), ground}) == len(ONE_OF_EACH) + 1


def _pixels_of_strip(page: ReportPage, configuration: str, frames: int) -> list[tuple[int, ...]]:
    """The RGB colour of each of a clip's frames in the timeline of a configuration."""
    pixels = page.js_async(
        """
        const [name, frames, done] = arguments, sheet = document.getElementById("timeline");
        requestAnimationFrame(() => requestAnimationFrame(() => {
          const {left, width, rows} = JSON.parse(sheet.dataset.places), scale = sheet.width / sheet.clientWidth;
          done(Array.from({length: frames}, (_, i) => {
            const [x, y] = [left + (i + .2) * width / frames, rows[name]].map((each) => Math.round(each * scale));
            return [...sheet.getContext("2d").getImageData(x, y, 1, 1).data];
          }));
        }));
        """,
        configuration,
        frames,
    )
    return [tuple(each[:3]) for each in pixels]


def _pixel(part: WebElement) -> tuple[int, ...]:
    """The colour of a part of the page, left of the letter in its middle."""
    with Image.open(io.BytesIO(part.screenshot_as_png)) as picture:
        return picture.convert("RGB").getpixel((3, picture.height // 2))  # type: ignore[return-value]


def _rgb(css: str) -> tuple[int, ...]:
    return tuple(int(each) for each in re.findall(r"\d+", css)[:3])


def test_a_point_of_the_forest_and_an_error_type_lead_to_frames(page: ReportPage) -> None:
    for words, frame in (
        ("one on other:", "Frame 2 – wrong: missed"),
        ("one: 2 of 10 frames no subject", "Frame 6 – wrong"),
    ):
        page.button(words).send_keys(ENTER)
        page.box(frame)
    assert "clip=clip" in page.browser.current_url


def test_the_forest_rounds_rates_and_intervals_as_the_table_does(report: ReportPage, tmp_path: Path) -> None:
    """1 of 16 is 6.25 %, a tie that Python rounds to 6.2 and JavaScript's toFixed to 6.3."""
    report.open(_write(tmp_path, {"one": ["cup", *["dragon"] * 15]}, a=["cup"] * 16, b=["cup"] * 16))
    last = (tmp_path / "frr.md").read_text(encoding="utf-8").partition("| (all) |")[2].split("|")
    assert last[3].strip() == "6.2"
    assert {"6.2 %", last[4].strip()} <= {element.text for element in report.all("svg text")}


def test_tables_are_sorted_and_filtered(report: ReportPage, small: Path) -> None:
    report.open(small)
    table = "details[data-table='0']"
    report.js(
        "document.querySelectorAll('#wrong-frames, details[data-table=\"0\"]').forEach((each) => each.open = true)"
    )
    report.wait(lambda: report.all(f"{table} tbody tr"))
    (head,) = (each for each in report.all(f"{table} .head") if each.text == "FRR %")
    for expected in (["100.0"] * 3 + ["40.0"] * 3, ["40.0"] * 3 + ["100.0"] * 3):
        report.click(head)
        assert [each.text for each in report.all(f"{table} tbody tr td:nth-of-type(4)")] == expected
    links = report.all("#wrong-frames tbody a")
    assert [link.text for link in links] == ["2", "4", "6"]
    report.click(links[1])
    report.box("Frame 4 – wrong")


def test_what_is_unknown_is_last_in_both_orders(report: ReportPage, tmp_path: Path) -> None:
    said = {"one": ("cup", "dragon", "none")}
    report.open(_write(tmp_path, said, clip=("cup", "cup", "none"), other=["none"] * 3))
    table = "details[data-table='0']"
    report.js("document.querySelector('details[data-table=\"0\"]').open = true")
    (head,) = report.wait(lambda: report.find(table).find_elements("xpath", ".//th[.='Targets %']/button"))
    for falls in (True, False):
        report.click(head)
        place = report.js("return arguments[0].parentElement.cellIndex", head)
        shown = [each.text for each in report.all(f"{table} tbody tr td:nth-of-type({place})")]
        assert (shown, falls) == (["50.0", "50.0", "–"], falls)


def test_a_wrong_frame_shows_its_picture_with_truth_and_answer_marked(page: ReportPage) -> None:
    page.press("n")
    page.box("Frame 2 – wrong")
    thumbnail = page.find("#frame svg.thumbnail")
    page.js("arguments[0].scrollIntoView()", thumbnail)
    shown = np.asarray(Image.open(io.BytesIO(thumbnail.screenshot_as_png)).convert("RGB"))
    height, width = shown.shape[:2]
    assert width / height == pytest.approx(2, rel=0.02)
    corner = shown[int(0.9 * height), int(0.3 * width)]
    assert np.abs(corner.astype(int) - PICTURE_RGB).max() < 12  # lossy, but it is that picture
    for role, place in {"truth": "20 40", "predicted": "120 40", "face": "90 20", "other": "180 10"}.items():
        box = page.find(f"#frame svg.thumbnail rect.{role}")
        assert f"{box.get_dom_attribute('x')} {box.get_dom_attribute('width')}" == place
    texts = [each.text for each in thumbnail.find_elements("tag name", "text")]
    assert {"✓ truth: cup", "✗ predicted: dragon", "girl", "lamp"} == set(texts)
    assert page.find("#frame rect.predicted").value_of_css_property("stroke-dasharray") != "none"
    assert page.find("#frame polyline.gaze").get_dom_attribute("points") == "100,15 140,50"
    page.press("n")
    page.box("Frame 4 – wrong")
    assert page.all("#frame svg.thumbnail") == []


def test_a_frame_whose_attention_is_left_out_shows_that_of_the_nearest(
    report: ReportPage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("harness.report.page.packing.MOST_BYTES", 500)
    things, noise = [target_record(1, "cup"), target_record(2, "dragon")], np.random.default_rng(0).random(1_500)
    records = [
        frame_record(things, [subject_record("girl", totals={1: value / 2, 2: 1.0}, focus=2)], frame=frame)
        for frame, value in enumerate(noise, start=1)
    ]
    score_run(tmp_path, records, Reference(labels={"clip": labels(*["cup"] * 1_500)}))
    report.open(tmp_path / "report.html", clip="clip", subject="girl", frame=1)
    report.box("Frame 1 – wrong")
    stride = report.js("return JSON.parse(document.getElementById('data').textContent).stride")
    last = 1 + (1_500 - 1) // stride * stride
    pairs = {1: 1, 1 + stride: 1 + stride, stride: 1 + stride, 1 + stride + 1: 1 + stride, 1_500: last}
    assert stride > 2
    for frame, of in pairs.items():
        report.open(tmp_path / "report.html", clip="clip", subject="girl", frame=frame)
        text = report.box(f"Frame {frame} – wrong")
        assert (f"Values of frame {of}." in text) == (frame != of)
        assert f"cup (truth) {noise[of - 1] / 2:.2f}" in " ".join(text.split())


def test_of_objects_of_a_name_only_the_one_at_the_labels_point_is_marked_true(
    report: ReportPage, tmp_path: Path
) -> None:
    things = [target_record(number, name, box_px=box) for number, name, box in SEEN.boxes]
    things[2] = replace(things[2], name="cup")
    record = frame_record(things, [subject_record("girl", totals={2: 1.0})], frame=2)
    seen = replace(SEEN, boxes=[(each.instance_id, each.name, each.box_px) for each in things])
    for point_px, marked in (((40.0, 50.0), ["20"]), (None, ["20", "180"])):
        run = tmp_path / str(point_px)
        _write_picture(run, "clip", 2)
        atomic_write(lines_path(run, "clip", "one"), msgspec.json.encode(seen) + b"\n")
        label = Label(target="cup", point_px=point_px)
        truth = Labels([LabelRange(first_frame=2, last_frame=2, subject="girl", label=label)])
        score_run(run, [record], Reference(labels={"clip": truth}))
        report.open(run / "report.html", clip="clip", subject="girl", frame=2)
        report.box("Frame 2 – wrong")
        boxes = report.all("#frame svg.thumbnail rect.truth")
        assert [box.get_dom_attribute("x") for box in boxes] == marked
    run = tmp_path / "another"
    label = Label(target="cup", point_px=(40.0, 50.0))
    truth = Labels([LabelRange(first_frame=2, last_frame=2, subject="girl", label=label)])
    another = replace(record, subjects=(subject_record("girl", totals={3: 1.0}, focus=3),))
    score_run(run, [another], Reference(labels={"clip": truth}))
    report.open(run / "report.html", clip="clip", subject="girl", frame=2)
    assert "Truth: cup. Predicted: cup (another of this name)." in report.box("Frame 2 – wrong")


def _copy(page: ReportPage, figure: str, *kinds: str) -> None:
    """Copy a figure as each of these kinds; ``window.copied`` are the blobs."""
    page.js(
        "window.copied = []; Object.defineProperty(navigator, 'clipboard', {value: {write: async ([item]) => {"
        "window.copied.push(await item.getType(item.types[0]))}}, configurable: true});"
    )
    for kind in kinds:
        page.click(page.find(f'[aria-label="Copy {figure} as {kind}"]'))
    page.wait(lambda: page.js("return window.copied.length") == len(kinds))


def test_figures_are_copied_as_csv_and_svg_that_stand_alone(report: ReportPage, small: Path) -> None:
    report.open(small)
    _copy(report, "Over all clips", "CSV", "SVG")
    table, figure = report.js_async("Promise.all(window.copied.map((each) => each.text())).then(arguments[0])")
    assert table.splitlines()[0] == "clip,configuration,n,looks,frr,low,high,baseline"
    assert table.splitlines()[1].startswith("(all),one,10,")
    with (small.parent / "frr.csv").open(encoding="utf-8", newline="") as file:
        (row,) = (row for row in csv.DictReader(file) if (row["clip"], row["configuration"]) == ("(all)", "one"))
    shares = [row[name] for name in ("frr", "interval_low", "interval_high")]
    assert table.splitlines()[1].split(",")[4:7] == shares
    assert figure.startswith("<svg")
    assert "var(" not in figure


def test_a_wrong_frame_that_the_page_has_no_room_for_shows_the_picture_of_the_run(
    report: ReportPage, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("harness.report.write.BUDGET_BYTES", 0)
    run = tmp_path / "a run"
    for frame in (2, 4):
        _write_picture(run, "my clip", frame)
    seen = b"".join(msgspec.json.encode(replace(SEEN, frame=frame)) + b"\n" for frame in (2, 4))
    atomic_write(lines_path(run, "my clip", "one"), seen)
    path = _write(run, {"one": GIVEN["one"]}, **{"my clip": TRUTH})
    report.open(path, frame=2)
    report.box("Frame 2 – wrong")
    assert report.all("#frame svg.thumbnail")
    report.press("n")
    report.box("Frame 4 – wrong")
    (image,) = report.all("#frame img.thumbnail")
    report.wait(lambda: image.get_property("naturalWidth") == 200)
    picture_path(run, "my clip", 4).unlink()  # as where the page was sent to somebody
    report.open(path, frame=4)
    report.box("Frame 4 – wrong")
    report.wait(lambda: not report.all("#frame img"))


CLIPS = [f"clip {number:02d}" for number in range(20)]


@pytest.fixture(scope="module")
def many_clips(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a run of 20 clips, of which the pager shows eight."""
    run = tmp_path_factory.mktemp("many")
    return _write(run, {"one": ("cup", "dragon"), "two": ("cup", "cup")}, **dict.fromkeys(CLIPS, ("cup", "cup")))


def test_copies_of_figures_hold_every_clip_and_the_legend(report: ReportPage, many_clips: Path) -> None:
    report.open(many_clips)
    shown = report.find("#draw-forest > :last-child .drawing")
    assert "clip 07" in shown.text
    assert "clip 08" not in shown.text
    _copy(report, "By clip", "SVG", "PNG")
    drawing = report.js_async("window.copied.find((each) => each.type.startsWith('text')).text().then(arguments[0])")
    texts = [each.text for each in ElementTree.fromstring(drawing).iter("{http://www.w3.org/2000/svg}text")]
    assert [text for text in texts if text and text.startswith("clip ")] == CLIPS
    assert {"By clip", "one", "two"} <= {*texts}
    width, height = (float(re.search(rf'{name}="([\d.]+)"', drawing)[1]) for name in ("width", "height"))  # type: ignore[index]
    picture = report.js_async(
        "createImageBitmap(window.copied.find((each) => each.type === 'image/png'))"
        ".then(({width, height}) => arguments[0]([width, height]))"
    )
    assert picture == [2 * width, 2 * height]
    assert not report.all("[style*='visibility: hidden']")


def test_the_last_wish_is_what_is_shown(report: ReportPage, many_clips: Path) -> None:
    """While clips are unpacked: what was asked for first takes longest."""
    report.open(many_clips)
    choose = "const [list, clips] = [document.querySelector('#draw-timeline select'), arguments]; "
    change = "list.value = clip; list.dispatchEvent(new Event('change'));"
    report.js(f"{choose} for (const clip of clips) {{ {change} }}", 7, 0)
    report.press(RIGHT)
    report.wait_for_place("one", "clip 00", "girl", 1)
    last, first = (report.button(f"one on clip {number}: FRR") for number in ("05", "04"))
    click = "part.dispatchEvent(new MouseEvent('click', {bubbles: true}));"
    report.js(f"for (const part of arguments) {{ {click} }}", last, first)
    report.press(RIGHT)
    report.wait_for_place("one", "clip 04", "girl", 2)  # the wrong one, where it stays: there are two frames


def test_a_button_above_the_timeline_is_the_same_between_press_and_release(report: ReportPage, small: Path) -> None:
    from selenium.webdriver import ActionChains

    report.open(small)
    following = report.find('[aria-label^="Next wrong frame"]')
    report.js("arguments[0].scrollIntoView({block: 'center'})", following)
    mouse = ActionChains(report.browser, duration=0)
    mouse.click(following).perform()
    report.wait_for_place("one", "clip", "girl", 2)
    mouse.click_and_hold(following).send_keys("n").perform()
    report.wait_for_place("one", "clip", "girl", 4)
    mouse.release().perform()
    report.wait_for_place("one", "clip", "girl", 6)


def test_a_print_holds_every_clip_and_says_which_one_a_figure_is_of(report: ReportPage, many_clips: Path) -> None:
    report.open(many_clips)
    with report.media(media="print"):
        report.js("window.dispatchEvent(new Event('beforeprint'))")
        figure = report.find("#draw-forest > :last-child .drawing")
        assert [clip for clip in CLIPS if clip not in figure.text] == []
        for place in ("errors", "timeline", "confusion"):
            chosen = report.find(f"#draw-{place} select")
            assert chosen.is_displayed()
            assert chosen.get_attribute("value") == ("-1" if place == "errors" else "0")
        assert not any(each.is_displayed() for each in report.all("button"))
    report.js("window.dispatchEvent(new Event('afterprint'))")
    assert "clip 08" not in figure.text


def test_a_confusion_has_names_by_their_numbers_and_nothing_last(report: ReportPage, tmp_path: Path) -> None:
    truth = ["none", "mug 10", "mug 2", "a"]
    report.open(_write(tmp_path, {"one": ("mug 2", "mug 10", "mug 1", "a")}, clip=truth))
    labels = [each.get_attribute("textContent") for each in report.all("#draw-confusion .tick")]
    assert labels == ["a", "mug 2", "mug 10", "none", "mug 1", "a", "mug 2", "mug 10", "none"]


def test_a_page_says_that_it_is_drawn_once_every_figure_is(report: ReportPage, small: Path) -> None:
    empty = "[...document.querySelectorAll('.drawing')].filter((each) => each.checkVisibility() && !each.firstChild)"
    observer = f"new MutationObserver(() => {{ window.empty = {empty}.length; }})"
    script = f"{observer}.observe(document, {{subtree: true, attributes: true, attributeFilter: ['data-ready']}})"
    added = report.browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": script})
    try:
        report.open(small)
        assert report.js("return window.empty") == 0
    finally:
        report.browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", added)


def test_the_oracle_ablation_is_a_waterfall(report: ReportPage, tmp_path: Path) -> None:
    said = {"one": ("cup", "dragon", "dragon", "cup"), "one+gaze": ("cup", "dragon", "cup", "cup")}
    report.open(_write(tmp_path, said, clip=["cup"] * 4))
    titles = report.all("#draw-oracle rect ~ title, #draw-oracle g > title")
    assert [title.get_attribute("textContent") for title in titles] == [
        "as run: FRR 50.0 %",
        "+ true gaze: FRR 75.0 %, +25.0 points",
    ]


def test_the_wrong_frames_of_an_oracle_step_are_listed_while_it_is_shown(report: ReportPage, tmp_path: Path) -> None:
    said = {"one": ("cup", "dragon"), "one+gaze": ("dragon", "cup")}
    report.open(_write(tmp_path, said, clip=["cup"] * 2))
    report.js("document.getElementById('wrong-frames').open = true")
    for name, frames in (("one", ["2"]), ("one+gaze", ["2", "1"]), ("one", ["2"])):
        report.js("location.hash = arguments[0]", f"clip=clip&config={name.replace('+', '%2B')}&subject=girl&frame=1")
        report.wait_for_place(name, "clip", "girl", 1)
        report.wait(lambda frames=frames: [each.text for each in report.all("#wrong-frames tbody a")] == frames)


def test_n_and_p_work_after_a_click_on_the_box_of_oracle_steps(report: ReportPage, tmp_path: Path) -> None:
    report.open(_write(tmp_path, {"one": ("cup", "dragon"), "one+gaze": ("cup", "cup")}, clip=["cup"] * 2))
    box = report.find("#draw-timeline input[type=checkbox]")
    box.click()
    box.send_keys("n")
    report.wait_for_place("one", "clip", "girl", 2)
