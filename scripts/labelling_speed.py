"""Measure the labelling page in Chromium: true speed and pictures a second while it plays, seeks, memory.

    python -m scripts.labelling_speed [FOLDER]

Clips are written to FOLDER (kept there; without one, to a temporary folder): 4K at 30 Hz, and 18,000 frames of
640 x 360 at 30 Hz. Needs the packages of the tests, Debian's chromium and chromium-driver.
"""

from __future__ import annotations

import random
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from tests.annotating import MANIFEST, serve, shown, wait_for
from tests.browser import chromium, set_width

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

RATE_HZ = 30


def say(line: str) -> None:
    """Print at once: the whole takes minutes."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


WATCH = """
window.seen = [];
new MutationObserver(() => window.seen.push([performance.now(), Number(document.body.dataset.frame)]))
    .observe(document.body, {attributeFilter: ["data-frame"]});
"""


def write_clip(folder: Path, frames: int, size_px: tuple[int, int]) -> Path:
    """A stereo clip as two videos (MPEG-4), and its manifest."""
    width, height = size_px
    name = f"clip_{width}_{frames}"
    manifest = folder / "datasets" / f"{name}.toml"
    if manifest.is_file():
        return manifest
    (folder / name).mkdir(parents=True, exist_ok=True)
    noise = np.random.default_rng(1).integers(0, 256, (height // 8, width // 8, 3), dtype=np.uint8)
    image = cv2.resize(noise, size_px, interpolation=cv2.INTER_CUBIC)
    for side in ("left", "right"):
        path, codec = str(folder / name / f"{side}.mp4"), cv2.VideoWriter_fourcc(*"mp4v")
        writer = cv2.VideoWriter(path, cv2.CAP_FFMPEG, codec, RATE_HZ, size_px)
        for number in range(frames):
            writer.write(np.roll(image, 4 * number, axis=1))
        writer.release()
    text = MANIFEST.replace('"noise"', f'"{name}"').replace("../pairs", f"../{name}")
    text = text.replace('"left"', '"left.mp4"\nlayout = "videos"').replace('"right"', '"right.mp4"')
    manifest.parent.mkdir(exist_ok=True)
    manifest.write_text(text)
    return manifest


def write_labels(path: Path, frames: int) -> None:
    """A label of another target every nine frames."""
    rows = [f"{at},{min(at + 8, frames - 1)},ann,{('cup', 'book', 'none')[at // 9 % 3]}," for at in range(0, frames, 9)]
    head = "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note"
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join([head, *rows]) + "\n")


def measure_playing(browser: Chrome, speeds: dict[str, str], seconds: float = 8.0) -> None:
    """Pictures a second, and how fast the clip's time went by, at several speeds."""
    for speed, keys in speeds.items():
        press(browser, "\ue011")  # Home
        wait_for(lambda: shown(browser) == 0)
        browser.execute_script("window.seen = []")
        press(browser, keys, " ")
        time.sleep(seconds)
        press(browser, " ")
        seen = browser.execute_script("return window.seen")
        seen = [each for each in seen if each[0] - seen[0][0] > 1000]  # it starts with what was loaded before
        (start_ms, first), (end_ms, last) = seen[0], seen[-1]
        wall_s, played_s = (end_ms - start_ms) / 1000, (last - first) / RATE_HZ
        say(f"  x{speed}: {(len(seen) - 1) / wall_s:.1f} pictures/s, true speed x{played_s / wall_s:.3f}")


def measure_seeks(browser: Chrome, frames: int, count: int = 30) -> None:
    """From a click on the timeline to the picture."""
    axis = browser.find_element("css selector", "#strips [role=slider]")
    box = axis.rect
    times = []
    for _ in range(count):
        x = box["x"] + random.random() * box["width"]
        before = shown(browser)
        times.append(browser.execute_async_script(SEEK, x, box["y"] + 5 - browser.execute_script("return scrollY")))
        wait_for(lambda before=before: shown(browser) != before)
    times.sort()
    say(f"  seek over {frames} frames: median {statistics.median(times):.0f} ms, slowest {times[-1]:.0f} ms")


SEEK = """
const [x, y, done] = arguments;
const start = performance.now();
const watch = new MutationObserver(() => { watch.disconnect(); done(performance.now() - start); });
watch.observe(document.body, {attributeFilter: ["data-frame"]});
const options = {clientX: x, clientY: y, button: 0, bubbles: true};
document.elementFromPoint(x, y).dispatchEvent(new PointerEvent("pointerdown", options));
dispatchEvent(new PointerEvent("pointerup", options));
"""


def memory_mb(browser: Chrome) -> tuple[float, int]:
    """Of the page's script after a collection, and how many elements it has."""
    browser.execute_cdp_cmd("HeapProfiler.collectGarbage", {})
    heap = browser.execute_cdp_cmd("Runtime.getHeapUsage", {})["usedSize"] / 1e6
    return heap, browser.execute_script("return document.querySelectorAll('*').length")


def press(browser: Chrome, *keys: str) -> None:
    """Press keys one after the other."""
    from selenium.webdriver import ActionChains

    actions = ActionChains(browser, duration=0)
    for key in "".join(keys):
        actions.send_keys(key)
    actions.perform()


def open_page(browser: Chrome, address: str) -> None:
    """Show a page, and note every frame that it shows."""
    browser.get(address)
    wait_for(lambda: shown(browser) is not None)
    browser.execute_script(WATCH)


def main(folder: Path) -> None:
    """Measure and print."""
    with chromium(folder / "profile") as browser:
        set_width(browser, 1280)
        manifest = write_clip(folder, 300, (3840, 2160))
        with serve(clip=str(manifest)) as page:
            say("4K, two videos at 30 Hz:")
            open_page(browser, page.address)
            measure_playing(browser, {"1": "", "2": "+"})
        manifest = write_clip(folder, 18_000, (640, 360))
        write_labels(folder / "annotations" / f"{manifest.stem}.csv", 18_000)
        with serve(clip=str(manifest)) as page:
            say("18,000 frames of 640 x 360 at 30 Hz:")
            open_page(browser, page.address)
            measure_seeks(browser, 18_000, 10)
            before = memory_mb(browser)
            measure_seeks(browser, 18_000, 100)
            measure_playing(browser, {"1": "", "2": "+"})
            after = memory_mb(browser)
            say(f"  heap {before[0]:.1f} MB then {after[0]:.1f} MB, elements {before[1]} then {after[1]}")


if __name__ == "__main__":
    if len(sys.argv) > 1:
        main(Path(sys.argv[1]))
    else:
        with tempfile.TemporaryDirectory() as temporary:
            main(Path(temporary))
