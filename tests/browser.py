"""Chromium, or Chrome, without a display, driven by its own driver: no downloads and no outside requests."""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import pytest

if TYPE_CHECKING:
    from selenium.webdriver import ActionChains, Chrome
    from selenium.webdriver.remote.webelement import WebElement

FLAGS = (
    *("--headless", "--no-sandbox", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
    *("--renderer-process-limit=1", "--disable-site-isolation-trials"),
)
"""The last two: a page in the process of the page before, which is a quarter of its processor time."""
NO_GPU = ("--disable-gpu",)
WEBGL = (
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
    "--js-flags=--liftoff-only --wasm-lazy-compilation",
)
"""WebGL computed by the processor, for pages that draw with it; their 40 MB of WebAssembly are compiled as needed."""

GONE = "aborted by navigation"
"""What the driver says if the page that it asks something is left meanwhile, and be it on its own order."""

NOT_IN_PAGE = "does not belong to the document"
"""What the driver says of an element of a page that is being left."""


@contextmanager
def chromium(profile: Path, graphics: Sequence[str] = NO_GPU) -> Iterator[Chrome]:
    """A browser with a profile of its own; skips the test if it or its driver is missing."""
    program = next(filter(None, map(shutil.which, ("chromium", "google-chrome"))), None)
    driver = shutil.which("chromedriver")
    if program is None or driver is None:
        pytest.skip("needs chromium (or google-chrome) and chromedriver; Debian: chromium chromium-driver")
    from selenium.webdriver import ChromeOptions, ChromeService

    options = ChromeOptions()
    options.binary_location = program
    for flag in (*FLAGS, *graphics, f"--user-data-dir={profile}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    browser = _driven()(options=options, service=ChromeService(driver))
    try:
        yield browser
    finally:
        browser.quit()


def _driven() -> type[Chrome]:
    """Chrome that is told a second time to open or reload a page where its driver lost the page before on the way.

    The driver asks the page that it leaves how far it has loaded, and now and then has no answer but that it has gone.
    """
    from selenium.common.exceptions import WebDriverException
    from selenium.webdriver import Chrome
    from selenium.webdriver.remote.command import Command

    class Driven(Chrome):
        def execute(self, driver_command: str, params: dict[str, Any] | None = None) -> dict[str, Any]:
            try:
                return super().execute(driver_command, params)
            except WebDriverException as error:
                if driver_command not in (Command.GET, Command.REFRESH) or GONE not in str(error.msg):
                    raise
            return super().execute(driver_command, params)

    return Driven


Held = TypeVar("Held")


def wait_for(
    condition: Callable[[], Held],
    said: str = "it did not come to hold",
    *,
    at_most_s: float = 120.0,
    every_s: float = 0.02,
) -> Held:
    """Return what a condition gives as soon as it holds; fail if it does not within a time that only a fault can take.

    A page that software draws answers between two pictures: ask it less often than it draws.
    """
    end = time.monotonic() + at_most_s
    while not (held := condition()):
        assert time.monotonic() < end, said
        time.sleep(every_s)
    return held


def is_gone(element: WebElement) -> bool:
    """Whether an element is no longer in the page; while the page is left, the driver says so in words of its own."""
    from selenium.common.exceptions import StaleElementReferenceException, WebDriverException

    try:
        element.is_enabled()
    except StaleElementReferenceException:
        return True
    except WebDriverException as error:
        if NOT_IN_PAGE not in str(error.msg):
            raise
        return True
    return False


def set_width(browser: Chrome, width_px: int, height_px: int = 900) -> None:
    """Show pages as on a screen of this size; a window cannot be as narrow as a phone."""
    size = {"width": width_px, "height": height_px, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


def wait_until_drawn(browser: Chrome) -> None:
    """Wait until a report page has drawn everything."""
    wait_for(lambda: browser.execute_script("return document.documentElement.dataset.ready === 'yes'"))


class BrowserPage:
    """A page in a browser: its parts, by CSS selectors, and what its scripts answer."""

    def __init__(self, browser: Chrome) -> None:
        self.browser = browser

    def js(self, script: str, *arguments: object) -> Any:
        return self.browser.execute_script(script, *arguments)

    def js_async(self, script: str, *arguments: object) -> Any:
        return self.browser.execute_async_script(script, *arguments)

    def find(self, selector: str) -> WebElement:
        return self.browser.find_element("css selector", selector)

    def all(self, selector: str) -> list[WebElement]:
        return self.browser.find_elements("css selector", selector)

    def text(self, selector: str) -> str:
        return self.find(selector).text


DEAD_BUTTONS = """
const [selectors, done] = arguments;
const all = () => selectors.flatMap((each) => [...document.querySelectorAll(each)]);
const wait = async (holds) => {
    for (const end = Date.now() + 60000; !holds() && Date.now() < end;) {
        await new Promise((next) => setTimeout(next, 5));
    }
    return holds();
};
let did = 0;
const count = async () => { did += 1; };
new MutationObserver((changes) => { did += changes.length; }).observe(document, {
    subtree: true, childList: true, attributes: true, characterData: true});
document.addEventListener('submit', (event) => {
    if (event.target.method === 'get' && !event.defaultPrevented) {
        event.preventDefault();  // the page would be loaded anew, without this script
        did += 1;
    }
});
Object.defineProperty(navigator, 'clipboard', {value: {write: count, writeText: count}});
(async () => {
    const dead = [];
    for (let number = 0; number < all().length; number += 1) {
        const button = all()[number];
        if (!button.checkVisibility() || button.disabled) {
            continue;
        }
        const name = button.getAttribute('aria-label') || button.textContent;
        button.scrollIntoView({block: 'center'});
        const box = button.getBoundingClientRect();
        const hit = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
        did = 0;
        if (!button.contains(hit)) {
            dead.push(`${name}: covered`);
            continue;
        }
        button.click();
        if (!await wait(() => did)) {
            dead.push(name);
        }
        await wait(() => document.body.getAttribute('aria-busy') !== 'true');
        const ends = document.querySelectorAll('#help[open] button, form:not([hidden]) [value=cancel]');
        ends.forEach((end) => end.click());
    }
    done(dead);
})();
"""


def dead_buttons(browser: Chrome, *selectors: str) -> list[str]:
    """Click every visible button of a page, and tell those that are covered, or after which nothing changes.

    Dialogues that a button opens are cancelled.
    """
    browser.set_script_timeout(300)
    return list(browser.execute_async_script(DEAD_BUTTONS, selectors))


def point_at(browser: Chrome, configuration: str, frame: int) -> ActionChains:
    """Move the pointer of a report page to a frame in the timeline of a configuration; frames have no gaps."""
    from selenium.webdriver import ActionChains

    wait_until_drawn(browser)
    canvas = browser.find_element("id", "timeline")
    browser.execute_script("arguments[0].scrollIntoView({block: 'start'})", canvas)
    places = json.loads(wait_for(lambda: canvas.get_attribute("data-places")) or "")
    share = (frame - int(places["first"]) + 0.5) / places["count"]
    x = places["left"] + share * places["width"] - canvas.size["width"] / 2
    y = places["rows"][configuration] - canvas.size["height"] / 2
    return ActionChains(browser, duration=0).move_to_element_with_offset(canvas, round(x), round(y))


_NO_REQUESTS = ("data:", "chrome:", "chrome-untrusted:")
"""How addresses begin of data in a page, and of what the browser's own first page loads."""


def requested(browser: Chrome) -> list[str]:
    """Requests of pages since the last call, except data in the page itself and the browser's own first page."""
    sent = [
        each["params"]["request"]["url"] for each in _messages(browser) if each["method"] == "Network.requestWillBeSent"
    ]
    return [url for url in sent if not url.startswith(_NO_REQUESTS)]


def let_out(browser: Chrome) -> list[str]:
    """As :func:`requested`, without requests that a page's own policy blocked."""
    messages = _messages(browser)
    sent = [message["params"] for message in messages if message["method"] == "Network.requestWillBeSent"]
    failed = [message["params"] for message in messages if message["method"] == "Network.loadingFailed"]
    kept = {each["requestId"] for each in failed if each.get("blockedReason") == "csp"}
    urls = [each["request"]["url"] for each in sent if each["requestId"] not in kept]
    return [url for url in urls if not url.startswith(_NO_REQUESTS)]


def _messages(browser: Chrome) -> list[dict[str, Any]]:
    return [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
