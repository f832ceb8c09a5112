"""Size and drawing time of report pages: ten minutes of two people, and hundreds of clips."""

from __future__ import annotations

import json
import shutil
import statistics
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.bench.scoring import synthetic_subject, synthetic_target
from harness.files.io import atomic_write
from harness.labels.labels import Label, LabelRange, Labels
from harness.report.formats import UNKNOWN, Table
from harness.report.thumbnails import Thumbnail, ThumbnailSubject, lines_path, picture_path
from harness.report.write import render_run
from harness.run.records import FrameRecord
from harness.score.outcomes import Reference

THINGS = ("mug", "book", "bottle", "vase", "laptop", "ball")
PEOPLE = ("anna", "ben")
LOOK = 45
"""Mean frames of a look."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PageSize:
    """The size of a synthetic run: number of clips, frames of each, configurations and subjects."""

    name: str
    clips: int
    frames: int
    configurations: int
    subjects: int


SIZES = (
    PageSize(name="ten minutes at 30 Hz", clips=1, frames=18_000, configurations=4, subjects=2),
    PageSize(name="500 clips", clips=500, frames=60, configurations=8, subjects=1),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PageTiming:
    """A page's size in MB, and in Chromium the seconds to its first paint and to the last figure.

    ``redraw_ms`` are the median and the longest redraw while zooming. None without a browser.
    """

    size: PageSize
    megabytes: float
    first_paint_s: float | None
    drawn_s: float | None
    redraw_ms: tuple[float, float] | None


def time_page(size: PageSize) -> PageTiming:
    """Make the page of a seeded run of this size, and open it."""
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "report.html"
        page.write_text(synthetic_page(size, Path(folder)), encoding="utf-8")
        painted = _in_chromium(page, Path(folder) / "profile")
        return PageTiming(size=size, megabytes=page.stat().st_size / 1e6, **painted)


def synthetic_page(size: PageSize, folder: Path) -> str:
    """The page of a run whose configurations are right in 60 to 90 % of the frames, and wrong in runs of frames."""
    names = [f"m{k // 2}-{('one', 'two')[k % 2]}" for k in range(size.configurations)]
    clips = [f"clip_{k:03}" for k in range(size.clips)]
    rng = np.random.default_rng(0)
    truths = {clip: rng.integers(0, len(THINGS), (size.subjects, size.frames // LOOK + 1)) for clip in clips}
    labels = {clip: _labels(size, truths[clip]) for clip in clips}
    frames = list(range(1, size.frames + 1))
    manifest = {
        "experiment": size.name,
        "clips": [
            {"name": clip, "licence": "MIT", "citation": None, "notes": [], "rate_hz": 30.0, "frames": frames}
            for clip in clips
        ],
        "configurations": {name: {"attention": {"cones_cm": [k]}} for k, name in enumerate(names)},
        "versions": {},
        "finished": "2026-01-01T00:00:00+00:00",
        "commit": "0" * 40,
    }
    records = (
        record
        for clip in clips
        for k, name in enumerate(names)
        for record in _records(size, clip, name, k, truths[clip])
    )
    _write_thumbnails(folder, clips, names, frames)
    reference = Reference(labels=labels, frames=dict.fromkeys(clips, frames))
    return render_run(folder / "results.jsonl", reference, records=records, manifest=manifest, served=None)


def _labels(size: PageSize, truth: np.ndarray) -> Labels:
    return Labels(
        LabelRange(
            first_frame=LOOK * look + 1,
            last_frame=min(LOOK * (look + 1), size.frames),
            subject=PEOPLE[s],
            label=Label(target=THINGS[truth[s, look]]),
        )
        for s in range(size.subjects)
        for look in range(-(-size.frames // LOOK))
    )


def _records(size: PageSize, clip: str, name: str, number: int, truth: np.ndarray) -> Iterator[FrameRecord]:
    """Attention to the true target and to two others, each with noise of its own in every frame."""
    rng = np.random.default_rng([number, *clip.encode()])
    targets = tuple(synthetic_target(k, thing) for k, thing in enumerate(THINGS, start=1))
    lapses = _lapses(rng, (size.subjects, size.frames), 0.4 - 0.04 * number)
    for frame in range(1, size.frames + 1):
        subjects = []
        for s in range(size.subjects):
            parts = np.zeros((len(THINGS), 2))
            true = truth[s, (frame - 1) // LOOK]
            others = rng.permutation(len(THINGS))[:2]
            parts[others] = rng.uniform(0, 0.5, (2, 2))
            parts[true] = rng.uniform(0, 0.3, 2) if lapses[s, frame - 1] else rng.uniform(0.5, 1, 2)
            subjects.append(synthetic_subject(PEOPLE[s], s, parts))
        yield FrameRecord(
            clip=clip,
            configuration=name,
            frame=frame,
            time_ns=frame * 33_333_333,
            targets=targets,
            subjects=tuple(subjects),
        )


def _lapses(rng: np.random.Generator, shape: tuple[int, int], share: float) -> np.ndarray:
    """Frames in which configurations are wrong: runs of about ten frames."""
    noise = rng.normal(size=shape)
    smooth = np.apply_along_axis(lambda row: np.convolve(row, np.ones(10), mode="same"), 1, noise)
    return smooth < np.quantile(smooth, share)


def _write_thumbnails(folder: Path, clips: Sequence[str], names: Sequence[str], frames: Sequence[int]) -> None:
    """A picture of every 15th frame: more than fit on a page."""
    import cv2

    image = cv2.GaussianBlur(np.random.default_rng(1).integers(0, 255, (203, 360, 3), dtype=np.uint8), (0, 0), 2)
    _, encoded = cv2.imencode(".webp", image, [cv2.IMWRITE_WEBP_QUALITY, 55])
    seen = Thumbnail(
        frame=0,
        size=(360, 203),
        boxes=[(k, thing, (40 * k, 100, 40 * k + 30, 140)) for k, thing in enumerate(THINGS, start=1)],
        subjects=[ThumbnailSubject(name=PEOPLE[0], head=(100, 20, 130, 50), focus=1, lines=[])],
    )
    for clip in clips:
        for frame in frames[::15]:
            atomic_write(picture_path(folder, clip, frame), encoded.tobytes())
        lines = [json.dumps(asdict(replace(seen, frame=frame))) for frame in frames[::15]]
        for name in names:
            atomic_write(lines_path(folder, clip, name), "\n".join(lines) + "\n")


_ZOOM = """
const [done] = arguments, sheet = document.getElementById("timeline"), taken = [];
sheet.scrollIntoView();
let k = 0;
const step = () => {
  const start = performance.now();
  sheet.dispatchEvent(new KeyboardEvent("keydown", {key: k % 12 < 6 ? "+" : "-", bubbles: true}));
  requestAnimationFrame(() => requestAnimationFrame(() => {
    taken.push(performance.now() - start);
    k += 1;
    if (k < 36) step(); else done(taken);
  }));
};
step();
"""


def _in_chromium(page: Path, profile: Path) -> dict[str, Any]:
    """Times in a browser without a display, if Chromium, its driver and selenium are installed."""
    program, driver = shutil.which("chromium"), shutil.which("chromedriver")
    try:
        from selenium.webdriver import Chrome, ChromeOptions, ChromeService
        from selenium.webdriver.support.wait import WebDriverWait
    except ImportError:
        program = None
    if program is None or driver is None:
        return {"first_paint_s": None, "drawn_s": None, "redraw_ms": None}
    options = ChromeOptions()
    options.binary_location = program
    for flag in ("--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={profile}"):
        options.add_argument(flag)
    browser = Chrome(options=options, service=ChromeService(driver))
    try:
        browser.set_window_size(1400, 900)
        browser.set_script_timeout(300)
        browser.set_page_load_timeout(300)
        browser.get(page.as_uri())
        WebDriverWait(browser, 120).until(
            lambda found: found.execute_script("return document.documentElement.dataset.ready === 'yes'")
        )
        paint, drawn = browser.execute_script(
            "return [performance.getEntriesByName('first-contentful-paint')[0].startTime,"
            " performance.getEntriesByName('drawn')[0].startTime]"
        )
        redraws = browser.execute_async_script(_ZOOM)
    finally:
        browser.quit()
    return {
        "first_paint_s": paint / 1000,
        "drawn_s": drawn / 1000,
        "redraw_ms": (statistics.median(redraws), max(redraws)),
    }


def page_table(timings: Sequence[PageTiming]) -> Table:
    """A row per page."""
    return Table(
        title="Report pages",
        columns=("Run", "Clips", "Frames", "Configurations", "Subjects", "MB", "First paint s", "Drawn s", "Redraw ms"),
        words=1,
        rows=tuple(
            (
                each.size.name,
                *map(str, (each.size.clips, each.size.frames, each.size.configurations, each.size.subjects)),
                f"{each.megabytes:.1f}",
                *(UNKNOWN if s is None else f"{s:.2f}" for s in (each.first_paint_s, each.drawn_s)),
                UNKNOWN if each.redraw_ms is None else f"{each.redraw_ms[0]:.0f} / {each.redraw_ms[1]:.0f}",
            )
            for each in timings
        ),
        notes=(
            "Seeded runs with six targets. Frames: of each clip. In Chromium without a display: seconds to the first "
            "paint, and until the last figure is drawn; ms for a zoom of the timeline and the two screen refreshes "
            "after it, median / longest.",
        ),
    )
