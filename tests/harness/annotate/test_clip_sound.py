"""The sound of a clip on the labelling page: served in ranges, drawn on the timeline, and the clock while it plays."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from tests.annotating import MANIFEST, Page, serve, shown, wait_for
from tests.beeps import write_beeping_video
from tests.browser import chromium, set_width
from tests.disk import write_text

RATE_HZ = 25


@pytest.fixture
def page(tmp_path: Path) -> Iterator[Page]:
    for side in ("left", "right"):
        flashes = [number == RATE_HZ for number in range(3 * RATE_HZ)]
        write_beeping_video(tmp_path / "pairs" / f"{side}.mkv", flashes, rate_hz=RATE_HZ)
    text = MANIFEST.replace('"left"', '"left.mkv"\nlayout = "videos"').replace('"right"', '"right.mkv"')
    with serve(clip=str(write_text(tmp_path / "datasets" / "noise.toml", text))) as page:
        yield page


def test_it_is_sent_in_ranges_with_its_loudness(page: Page) -> None:
    with httpx.Client(headers={"X-Vfoa-Token": page.token}, base_url=f"http://127.0.0.1:{page.port}") as client:
        about = client.get("/api/sound").json()
        assert about["seconds"] == pytest.approx(3, abs=0.01)
        loud_s = [place * about["bin_s"] for place, each in enumerate(about["loudness"]) if each > 20]
        assert (loud_s[0], loud_s[-1]) == pytest.approx((1.0, 1.08), abs=0.021)
        part = client.get("/sound.wav", headers={"Range": "bytes=0-43"})
        assert (part.status_code, part.content[:4], len(part.content)) == (206, b"RIFF", 44)


def test_a_clip_whose_rate_is_told_anew_or_whose_views_are_images_has_none(page: Page, tmp_path: Path) -> None:
    manifest = page.session.manifest.path
    manifest.write_text(manifest.read_text().replace("[source]\n", "[source]\nrate_hz = 50\n"))
    with serve(clip=str(manifest), annotator="other") as other:
        assert other.session.sound.about() is None


def test_it_is_heard_drawn_and_the_clock(page: Page, tmp_path: Path) -> None:
    from selenium.webdriver import ActionChains

    with chromium(tmp_path / "profile") as browser:
        set_width(browser, 1280)
        browser.get(page.address)
        wait_for(lambda: shown(browser) is not None)
        wait_for(lambda: browser.execute_script("return document.getElementById('sound').readyState") == 4)
        assert browser.find_element("css selector", "#strips .wave canvas").is_displayed()
        ActionChains(browser).send_keys(" ").perform()
        wait_for(lambda: browser.execute_script("return !document.body.classList.contains('playing')"))
        wait_for(lambda: shown(browser) == 3 * RATE_HZ - 1)
        assert browser.execute_script("return document.getElementById('sound').currentTime") > 2.5
        assert browser.get_log("browser") == []
