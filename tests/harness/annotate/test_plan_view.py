"""A clip of measurements on the labelling page: the plan says where everyone is and looks, and is labelled by keys."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.annotate.drawing import Draw
from harness.clips.add import add_clip
from tests.annotating import serve, shown, wait_for
from tests.browser import chromium, set_width
from tests.measured import ANNA, BEN, ROBOT, measured_tables
from vfoa.errors import VfoaError
from vfoa.geometry import unit

IMAGE_TOOLS = ("do-right", "do-disparity", "do-head", "do-drawing")


@pytest.fixture
def talk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The manifest of a conversation of twelve frames."""
    monkeypatch.chdir(tmp_path)
    return add_clip(measured_tables(tmp_path / "talk")).manifest


def test_the_plan_has_places_and_directions_to_scale_seen_from_above(talk: Path) -> None:
    with serve(clip=str(talk)) as page:
        first, last = page.session.scene(0), page.session.scene(11)
        about = page.session.about()
    plan = first["plan"]
    middle = {each["name"]: np.mean([each["box_px"][:2], each["box_px"][2:]], axis=0) for each in first["objects"]}
    assert set(middle) == {"anna", "ben", "robot", "cup"}
    scale = plan["px_per_m"]
    for name, place in (("anna", ANNA), ("ben", BEN), ("robot", ROBOT)):
        np.testing.assert_allclose((middle[name] - plan["origin_px"]) / scale, [place[0], -place[2]], atol=1e-3)
    assert {(ray["name"], ray["cue"]) for ray in plan["rays"]} == {("anna", "head"), ("anna", "gaze"), ("ben", "head")}
    for scene, looks_at in ((first, {"anna": BEN, "ben": ANNA}), (last, {"anna": ROBOT, "ben": ROBOT})):
        for ray in scene["plan"]["rays"]:
            eyes = {"anna": ANNA, "ben": BEN}[ray["name"]]
            towards = (looks_at[ray["name"]] - eyes)[[0, 2]] * [1, -1]
            found = np.subtract(ray["to_px"], ray["from_px"])
            np.testing.assert_allclose(unit(found), unit(towards), atol=0.01)
    width, height = first["size_px"]
    corners = np.array([corner for scene in (first, last) for ray in scene["plan"]["rays"] for corner in
                        (ray["from_px"], ray["to_px"])])  # fmt: skip
    assert ((corners >= 0) & (corners <= [width, height])).all()
    assert (about["has_images"], about["categories"]) == (False, ["cup", "person", "robot"])


def test_there_is_no_picture_and_nothing_to_draw_on(talk: Path) -> None:
    with serve(clip=str(talk)) as page:
        with pytest.raises(VfoaError, match="talk: found measurements; expected images for a picture of the left"):
            page.session.picture("left", 0)
        with pytest.raises(VfoaError, match="talk: found measurements; expected images to draw on"):
            page.session.draw(Draw(do="key", revision=0, name="cup", place=(1, 1, 5, 5)))


def test_it_is_labelled_by_keys_while_the_plan_follows_the_time(talk: Path, tmp_path: Path) -> None:
    from selenium.webdriver import ActionChains, Keys

    tip = "return document.querySelector('.ray.by-gaze[data-name=anna] line').getAttribute('x2')"
    shown_part = "return document.getElementById('plan').getAttribute('viewBox')"
    with serve(clip=str(talk)) as page, chromium(tmp_path / "profile") as browser:
        set_width(browser, 1280)
        browser.get(page.address)
        wait_for(lambda: shown(browser) == 1)
        press = lambda *keys: ActionChains(browser).send_keys(*keys).perform()  # noqa: E731
        names = browser.execute_script("return [...document.querySelectorAll('.object')].map((g) => g.dataset.name)")
        assert set(names) == {"anna", "ben", "robot", "cup"}
        assert [each for each in IMAGE_TOOLS if browser.find_elements("id", each)] == []
        towards_ben = browser.execute_script(tip)
        press("4")  # ben
        press(*[Keys.ARROW_RIGHT] * 6)
        wait_for(lambda: shown(browser) == 7)
        assert browser.execute_script(tip) != towards_ben
        press("1")  # the robot
        press(" ")  # plays to the end
        wait_for(lambda: shown(browser) == 12 and not browser.find_elements("css selector", "body.playing"))
        browser.find_element("css selector", ".object[data-name=cup] path:not(.halo)").click()
        wait_for(lambda: "12,12,anna,cup," in page.file.read_text())
        assert "1,6,anna,ben,\n" in page.file.read_text()
        assert "7,11,anna,robot,\n" in page.file.read_text()
        before = browser.execute_script(shown_part)
        press("v")
        wait_for(lambda: browser.execute_script(shown_part) != before)
        assert not [each for each in browser.get_log("browser") if each["level"] == "SEVERE"]
