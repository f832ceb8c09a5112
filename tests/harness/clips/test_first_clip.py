"""A first clip of one's own on a machine that has some models: the commands that `vfoa clips add` names work, in order.

Without any model, and from other sources: tests/test_own_recording.py.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from harness.clips.manifest import load_manifest
from harness.sources import MeasuredClip
from tests.annotating import served_by_the_program
from tests.command import vfoa
from tests.depth_recordings import Lens, Shot, write_take
from tests.disk import picture
from tests.harness.clips.adding import NUMBERS, images
from tests.measured import measured_tables


def realsense_bag(root: Path) -> Path:
    lens = Lens(width=64, height=48, fx=100.0, cx=31.5, cy=23.5)
    depth_mm = np.full((48, 64), 1500, np.uint16)
    shots = (Shot(stamp_ns=n * 40_000_000, colour=picture(n), depth_mm=depth_mm, lens=lens) for n in (1, 2))
    return write_take(root, "bag", shots)


SOURCES: dict[str, tuple[Callable[[Path], Path], tuple[str, ...]]] = {
    "stereo-folder": (lambda root: images(root, "left/{}.png", "right/{}.png"), NUMBERS),
    "realsense-bag": (realsense_bag, ()),
}


@pytest.mark.parametrize("kind", SOURCES)
def test_a_source_becomes_a_table_by_the_commands_that_adding_names(
    kind: str,
    tmp_path: Path,
    shared_models: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    make, options = SOURCES[kind]
    (tmp_path / "work").mkdir()
    (tmp_path / "source").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setenv("VFOA_MODELS", str(shared_models))

    def run(*words: str) -> list[str]:
        code, out, err = vfoa(monkeypatch, capsys, *words)
        assert (code, err) == (0, ""), words
        return out.splitlines()

    told = run("clips", "add", str(make(tmp_path / "source")), "--name", "mine", *options)
    told = run(*shlex.split(told[-1])[1:])  # the same command with names of people and things
    commands = [shlex.split(line.removeprefix("next: vfoa ")) for line in told if line.startswith("next: vfoa")]
    assert [command[0] for command in commands] == ["clips", "annotate", "run"]
    for command in commands:
        if command[0] == "annotate":
            with served_by_the_program(Path.cwd(), command[1]) as (_, address):
                assert address.startswith("http://127.0.0.1")
        else:
            run(*command, *(["--recording", "none", "--workers", "1"] if command[0] == "run" else []))
    assert (Path("runs") / "mine" / "frr.csv").is_file()


def test_measurements_without_objects_get_one_by_the_options_that_adding_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    measured_tables(tmp_path / "talk")
    (tmp_path / "talk" / "objects.csv").unlink()
    _, told, _ = vfoa(monkeypatch, capsys, "clips", "add", "talk")
    (options,) = re.findall(r"`(--.*?)`", told)
    options = options.replace("NEW", "with_lamp").replace("X,Y,Z", "0.1,0.2,1.8")
    code, _, err = vfoa(monkeypatch, capsys, "clips", "add", "talk", *shlex.split(options))
    assert (code, err) == (0, "")
    clip = load_manifest("with_lamp").open()
    assert isinstance(clip, MeasuredClip)
    boxes = [target.box for target in clip.scene(1).targets if target.instance.label == "lamp"]
    assert [box and box.center_m.tolist() for box in boxes] == [[0.1, 0.2, 1.8]]
