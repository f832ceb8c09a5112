"""Drawing on the image in a browser: what the mouse and the keys do to the file of what is drawn."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from harness.labels.drawn_shapes import Drawn, Place, read_drawn
from tests.annotating import FRAMES, LabellingPage

CONTROL, RIGHT, LEFT, DELETE, ENTER = "\ue009", "\ue014", "\ue012", "\ue017", "\ue007"
NEAR_PX = 1.0
"""The mouse stops at whole pixels of the screen."""


@pytest.fixture
def page(open_page: Callable[..., LabellingPage]) -> LabellingPage:
    """The page, with the drawing tool in hand and the cup chosen."""
    page = open_page()
    page.keys("p", _key_of(page, "cup"))
    return page


def _key_of(page: LabellingPage, name: str) -> str:
    return str(page.session.about()["looks"][name]["key"])


def _ctrl(page: LabellingPage, key: str, times: int) -> None:
    for _ in range(times):
        page.actions().key_down(CONTROL).send_keys(key).key_up(CONTROL).perform()
    page.settle()


def _drag(page: LabellingPage, start: tuple[float, float], end: tuple[float, float] | None = None) -> None:
    """Press at a pixel of the image, move in two steps to another, and let go; without another, a click."""
    layer = page.find("#drawn")

    def offset(place: tuple[float, float]) -> tuple[int, int]:
        """From the middle of the layer, in pixels of the screen."""
        found = page.js(
            "const [layer, u, v] = arguments, box = layer.getBoundingClientRect();"
            "const at = new DOMPoint(u + .5, v + .5).matrixTransform(layer.getScreenCTM());"
            "return [at.x - box.left - box.width / 2, at.y - box.top - box.height / 2];",
            layer,
            *place,
        )
        return round(found[0]), round(found[1])

    actions = page.actions().move_to_element_with_offset(layer, *offset(start)).click_and_hold()
    if end is not None:
        middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
        for place in (middle, end):
            actions.move_to_element_with_offset(layer, *offset(place))
    actions.release().perform()
    page.settle()


def _drawn(page: LabellingPage) -> Drawn:
    path = page.session.manifest.annotations.place_drawn()
    return read_drawn(path, frames=FRAMES, subjects=("ann", "ben"), targets=("cup", "book"))


def _at(page: LabellingPage, name: str, kind: Any, frame: int) -> Place | None:
    (track,) = (track for track in _drawn(page).tracks if (track.name, track.kind) == (name, kind))
    return track.at(frame)


def _state(page: LabellingPage) -> str:
    return str(page.js("return document.getElementById('drawn-state').value"))


def test_a_box_is_drawn_moved_and_resized_with_the_mouse(page: LabellingPage) -> None:
    _drag(page, (10, 10), (30, 25))
    assert _at(page, "cup", "box", 1) == pytest.approx((10, 10, 30, 25), abs=NEAR_PX)
    page.keys(*[RIGHT] * 6)
    assert "between" in _state(page)
    _drag(page, (20, 18), (32, 24))
    assert _at(page, "cup", "box", 7) == pytest.approx((22, 16, 42, 31), abs=2 * NEAR_PX)
    assert _at(page, "cup", "box", 4) == pytest.approx((16, 13, 36, 28), abs=2 * NEAR_PX)

    handles = page.all("#drawn .handle")
    assert [min(handle.rect["width"], handle.rect["height"]) >= 24 for handle in handles] == [True] * 4
    u0, v0, u1, v1 = _at(page, "cup", "box", 7) or ()
    _drag(page, (u1 + 1, v1 + 1), (u1 + 9, v1 + 5))
    assert _at(page, "cup", "box", 7) == pytest.approx((u0, v0, u1 + 9, v1 + 5), abs=2 * NEAR_PX)

    page.keys(LEFT, LEFT, LEFT)
    box = page.js(
        "const b = document.querySelector('#drawn [data-name=cup] rect:not(.halo)');"
        "return ['x', 'y', 'width', 'height'].map((each) => Number(b.getAttribute(each)));"
    )
    expected = _at(page, "cup", "box", 4)
    assert expected is not None
    assert [box[0] - 0.5, box[1] - 0.5, box[0] + box[2] - 0.5, box[1] + box[3] - 0.5] == pytest.approx(expected)


def test_key_frames_come_and_go_by_keys_and_all_can_be_undone(page: LabellingPage) -> None:
    _drag(page, (10, 10), (30, 25))
    page.keys(*[RIGHT] * 4, ENTER, *[RIGHT] * 4, "q")
    assert [_at(page, "cup", "box", frame) is not None for frame in (1, 5, 8, 9, 12)] == [True] * 3 + [False] * 2
    assert _state(page) == "outside, 3 in all"
    page.keys("[")
    assert page.shown == 5
    page.keys(DELETE)
    assert [key.frame for key in _drawn(page).tracks[0].keys] == [1, 9]
    page.keys("z", "z")
    assert [key.frame for key in _drawn(page).tracks[0].keys] == [1, 5]
    page.keys("y", "]")
    assert page.shown == 9
    page.open()  # what is drawn outlives the page
    page.keys("p", "z", "z", "z")
    assert _drawn(page) == Drawn()
    assert page.session.state()["labelled"] == 0  # no key of the labels was meant


def test_labels_and_drawing_are_undone_as_one_in_the_order_in_which_they_were_made(page: LabellingPage) -> None:
    def found() -> tuple[int | None, str | None]:
        """The width of the box, and the target of the labels at the start."""
        tracks = page.session.drawn()["tracks"]
        (first, *_) = page.session.state()["tracks"]["ann"]
        width = tracks[0]["keys"][0][1][2] - tracks[0]["keys"][0][1][0] if tracks else None
        return width and round(width), first[2] if len(first) > 2 else None

    wide = [found()]
    _drag(page, (10, 10), (30, 25))
    wide.append(found())
    page.keys("p", "n", "p")
    wide.append(found())
    _drag(page, (31, 26), (39, 30))
    wide.append(found())
    assert len(set(wide)) == 4
    for expected in (wide[2], wide[1]):
        page.keys("z")
        assert found() == expected
    assert page.text("#notice") == "Undone: the last change of the labels."
    page.open()  # the order outlives the page
    page.keys("z")
    assert found() == wide[0]
    assert not page.find("#do-undo").is_enabled()
    for expected in wide[1:]:
        page.keys("y")
        assert found() == expected
    page.keys("z", "i")
    changed = found()
    assert changed == (wide[2][0], "ignore")
    page.keys("y")  # the box was undone before the label was made: it is gone
    assert found() == changed


def test_a_point_and_a_head_are_drawn_and_moved_by_keys(page: LabellingPage) -> None:
    book, ann = _key_of(page, "book"), _key_of(page, "ann")
    page.keys(book, book)
    _drag(page, (40, 30))
    point = _at(page, "book", "point", 12)
    assert point == pytest.approx((40, 30), abs=NEAR_PX)
    _ctrl(page, RIGHT, 3)
    assert _at(page, "book", "point", 1) == pytest.approx((point[0] + 3, point[1]))
    page.keys(ann)
    _drag(page, (5, 5), (15, 17))
    assert _at(page, "ann", "head", 1) == pytest.approx((5, 5, 15, 17), abs=NEAR_PX)


def test_on_a_slow_connection_no_shape_is_drawn_that_nobody_drew(page: LabellingPage) -> None:
    page.answer_slowly()
    page.actions().send_keys(ENTER, _key_of(page, "book")).key_down(CONTROL).send_keys(LEFT).key_up(CONTROL).perform()
    page.settle()
    (track,) = _drawn(page).tracks
    assert (track.name, [key.place for key in track.keys]) == ("cup", [(25.6, 19.2, 38.4, 28.8)])


def test_on_a_slow_connection_keys_are_for_the_tool_as_soon_as_it_is_opened(page: LabellingPage) -> None:
    page.keys("p")
    page.answer_slowly()
    page.actions().send_keys("ns", "p", _key_of(page, "book"), ENTER, "p", _key_of(page, "cup")).perform()
    page.settle()
    assert [(track.name, len(track.keys)) for track in _drawn(page).tracks] == [("book", 1)]
    assert (page.targets("ann"), page.targets("ben")) == ("n...........", "c...........")


def test_what_is_drawn_can_be_clicked_when_labelling(page: LabellingPage) -> None:
    _drag(page, (10, 10), (30, 25))
    page.keys("p")
    _drag(page, (20, 18))
    assert page.session.state()["tracks"]["ann"][0][2] == "cup"


def test_a_page_that_is_behind_is_told(page: LabellingPage, work: Path) -> None:
    _drag(page, (10, 10), (30, 25))
    path = work / "annotations" / "noise.drawn.csv"
    path.write_text(path.read_text().replace("1,cup,box", "3,cup,box"))
    _drag(page, (20, 18), (26, 18))
    assert "changed elsewhere" in page.text("#notice")
    assert [key.frame for key in _drawn(page).tracks[0].keys] == [3]
