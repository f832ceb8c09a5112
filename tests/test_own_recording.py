"""The tutorial of one's own recordings: each kind of source, from a machine without models and data to a table.

After ``vfoa clips add``, exactly the commands that it prints are run, in their order. What people do on the labelling
page is sent to its server as the page sends it. Weights come from a server on this machine that has the genuine files.
"""

from __future__ import annotations

import csv
import json
import re
import shlex
from collections.abc import Callable
from http.cookiejar import CookieJar
from pathlib import Path
from typing import Any
from urllib.request import HTTPCookieProcessor, ProxyHandler, Request, build_opener

import pytest

from harness.report.frames_csv import export_frames
from tests import annotating, own_recordings
from tests.command import vfoa
from tests.homes import NEEDED, serve_models
from tests.pages import is_shown_by, rates, steps
from tests.repository import REPOSITORY
from tests.web import serve

PAGE = (REPOSITORY / "docs" / "tutorials" / "own-recording.md").read_text(encoding="utf-8")
SECTIONS = {part.partition("\n")[0]: part for part in PAGE.split("\n## ")}
BOXES = re.compile(r"^\| (\w+) \| (\d+), (\d+) \| (\d+), (\d+) \|$", re.MULTILINE)
ALONE = ("--workers", "1")
"""Four frames are no work for processes, each of which loads the networks."""
SOURCES: dict[str, Callable[[Path, Path], Path]] = {
    "A folder of pairs with a calibration file": own_recordings.stereo_folder,
    "A recording of ROS 2 (MCAP) with camera_info": own_recordings.mcap,
    "A film with both views side by side": own_recordings.side_by_side,
    "A bag of a RealSense camera": own_recordings.depth_bag,
}


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The home of somebody who has just installed vfoa; the working directory is an empty folder in it."""
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / ".cache"))
    monkeypatch.setenv("VFOA_CACHE", str(tmp_path / ".cache" / "vfoa"))
    monkeypatch.setenv("COLUMNS", "100")
    for name in ("VFOA_MODELS", "VFOA_DATA", "HTTP_PROXY", "ALL_PROXY", "http_proxy", "all_proxy"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path


def told(printed: str) -> list[str]:
    """The commands that a command says to run next."""
    return re.findall(r"^next: .*?(vfoa .*)$", printed, re.MULTILINE)


def label_and_draw(clip: str) -> None:
    """Send what the labelling page sends when somebody draws the page's boxes and labels both halves of the clip."""
    boxes = [{"name": name, "kind": "box", "place": [*map(float, place)]} for name, *place in BOXES.findall(PAGE)]
    assert [box["name"] for box in boxes] == ["screen", "shelf", "clock", "ann"]
    half = len(own_recordings.FRAMES) // 2
    changes: list[dict[str, Any]] = [{"kind": "draw", "draw": {"do": "key", "at": 0, **box}} for box in boxes]
    changes += [
        {"kind": "range", "subject": "ann", "at": at, "last": at + half - 1, "target": target}
        for at, target in ((0, "screen"), (half, "shelf"))
    ]
    with annotating.serve(clip=clip) as page:
        opener = build_opener(ProxyHandler({}), HTTPCookieProcessor(CookieJar()))
        opener.open(page.address, timeout=60).read()
        body = json.dumps({"revision": 1, "drawn": 1, "changes": changes}).encode()
        headers = {"Content-Type": "application/json", "X-Vfoa-Token": page.token}
        answer = opener.open(
            Request(f"{page.address.partition('/?')[0]}/api/change", data=body, headers=headers), timeout=60
        )
        assert answer.status == 200


def as_shown(out: str, home: Path) -> str:
    """What a command printed, with the paths of the tutorial."""
    return out.replace(f"{home / 'work'}/", "").replace(str(home), "/home/me")


@pytest.mark.parametrize("title", SOURCES)
def test_a_recording_becomes_a_table_by_the_commands_that_adding_it_prints(
    title: str,
    home: Path,
    shared_data: Path,
    shared_models: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    source = SOURCES[title](home / "desk", shared_data)
    (add, shown), *others = steps(SECTIONS[title])
    with serve() as site:
        serve_models(site, shared_models, home, monkeypatch)
        commands = [(add, shown)]
        for command, expected in commands:
            words = shlex.split(command)[1:]
            if words[0] == "annotate":
                label_and_draw(words[1])
                continue
            code, out, err = vfoa(monkeypatch, capsys, *words, *(ALONE if words[0] == "run" else ()))
            assert (code, err) == (0, ""), command
            printed = as_shown(out, home)
            assert is_shown_by(printed, expected), printed
            assert rates(printed) == pytest.approx(rates(expected), abs=0.01), command
            if command == add:
                assert told(printed) == [command for command, _ in others]
                commands += others
    assert source.exists()
    assert len(list((home / ".cache" / "vfoa" / "models").iterdir())) == len(NEEDED)
    rows = csv.DictReader(export_frames(Path("runs/desk")).read_text().splitlines())
    answers = {row["frame"]: (row["truth"], row["predicted"]) for row in rows}
    assert [*answers.values()] == [("screen", "screen")] * 2 + [("shelf", "shelf")] * 2


def test_measured_heads_become_a_table_by_the_commands_that_adding_them_prints(
    home: Path, shared_data: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (home / "talk").symlink_to(shared_data / "idiap_vfoa")
    (add, shown), *others = steps(SECTIONS["Heads that a tracker measured"])
    commands = [(add, shown)]
    for command, expected in commands:
        words = shlex.split(command)[1:]
        code, out, err = vfoa(monkeypatch, capsys, *words, *(ALONE if words[0] == "run" else ()))
        assert (code, err) == (0, ""), command
        printed = as_shown(out, home)
        assert is_shown_by(printed, expected), printed
        assert rates(printed) == pytest.approx(rates(expected), abs=0.01), command
        if command == add:
            labels = "../talk/gt_first_half.npz"
            assert [line.replace("FILE", labels) for line in told(printed)] == [command for command, _ in others]
            commands += others
    whole = next(csv.DictReader(Path("runs/talk/frr.csv").read_text().splitlines()))
    assert (whole["subject"], whole["n"]) == ("(all)", "1060")
    assert 0.5 < float(whole["frr"]) < 1
