"""Speaking turns: imported from and exported to ELAN, shown on the page, and entered with keys."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from pympi.Elan import Eaf
from typer.testing import CliRunner

from harness.cli import app
from harness.clips.manifest import load_manifest
from harness.labels.timeline import Timeline
from tests.annotating import FRAMES, MANIFEST, Page, shown, wait_for
from tests.browser import chromium, set_width
from tests.disk import write_text

HEAD = "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note\n"


def _turns(work: Path) -> str:
    """A line a subject, a letter a frame."""
    found = load_manifest(str(work / "datasets" / "noise.toml")).speech(Timeline(frames=FRAMES, times_ns=()))
    assert found is not None
    lines = ["".join("s" if found.at(frame, name) else "-" for frame in FRAMES) for name in ("ann", "ben")]
    return "\n".join(lines)


def test_a_transcript_in_elan_is_turns_and_comes_back(work: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(work)
    write_text(
        work / "datasets" / "noise.toml", MANIFEST.replace('right = "right"\n', 'right = "right"\nrate_hz = 10\n')
    )
    document = Eaf(author="test")
    for tier, turns in {
        "Ann's words": ((0, 300, "where is the cup?"), (300, 600, ""), (600, 700, "ah")),
        "ben": ((200, 500, "there"),),
        "noises": ((0, 900, "a door"),),
    }.items():
        document.add_tier(tier)
        for turn in turns:
            document.add_annotation(tier, *turn)
    document.to_file(str(work / "talk.eaf"))
    arguments = ["labels", "import", "talk.eaf", "--clip", "noise", "--format", "elan", "--speech"]
    result = CliRunner().invoke(app, [*arguments, "--rename", "Ann's words=ann"], catch_exceptions=False)
    assert "3 turns of ann, ben" in result.output
    assert "'noises' is no subject's and is left out" in result.output
    assert _turns(work) == "sss---s-----\n--sss-------"
    assert not (work / "annotations" / "noise.csv").exists()

    CliRunner().invoke(app, ["labels", "export", "noise", "back.eaf", "--format", "elan", "--speech"])
    back = Eaf(str(work / "back.eaf"))
    assert sorted(back.get_annotation_data_for_tier("ann")) == [(0, 300, "speaks"), (600, 700, "speaks")]
    CliRunner().invoke(app, [*arguments[:2], "back.eaf", *arguments[3:], "--replace"], catch_exceptions=False)
    assert _turns(work) == "sss---s-----\n--sss-------"


def test_turns_are_said_by_a_key_at_either_end_shown_on_a_lane_and_undone(
    noise: Callable[..., Page], work: Path, tmp_path: Path
) -> None:
    from selenium.webdriver import ActionChains

    write_text(work / "annotations" / "noise.speech.csv", f"{HEAD}1,2,ben,speaks,\n")
    page = noise()
    with chromium(tmp_path / "profile") as browser:
        set_width(browser, 1280)
        browser.get(page.address)
        wait_for(lambda: shown(browser) is not None)

        def press(*keys: str) -> None:
            ActionChains(browser, duration=0).send_keys("".join(keys)).perform()
            wait_for(lambda: browser.execute_script("return document.body.getAttribute('aria-busy') === 'false'"))

        right = "\ue014"
        wait_for(
            lambda: [each.text for each in browser.find_elements("css selector", ".speech > span")] == ["ben speaks"]
        )
        press(right, "c", right, right, "c", right, right, "c", right, "c")
        assert _turns(work) == "-sss-ss-----\nss----------"
        press("C")
        assert _turns(work) == "-sss--------\nss----------"
        press("f")
        assert _turns(work) == "-sss-ss-----\nss----------"
        lanes = browser.find_elements("css selector", ".speech")
        assert [each.get_attribute("aria-label") for each in lanes] == [
            "ann speaks 2 to 4, 6 to 7",
            "ben speaks 1 to 2",
        ]
        assert not page.file.exists()  # no look was said
