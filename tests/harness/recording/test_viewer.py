from __future__ import annotations

import ctypes.util
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import psutil
import pytest

from harness.recording import find_recordings, viewer
from harness.recording.blueprint import eye_controls
from harness.recording.excerpt import write_excerpt
from harness.recording.viewer import screenshot
from vfoa.errors import VfoaError
from vfoa.geometry import box_corners


def test_the_eye_looks_at_the_scene_from_outside(frames):
    position, target = eye_controls(frames[0].result.scene)
    boxes = [target.box for target in frames[0].result.scene.targets if target.box is not None]
    corners = np.concatenate([box_corners(box) for box in boxes])
    assert (corners.min(axis=0) <= target).all()
    assert (target <= corners.max(axis=0)).all()
    assert np.linalg.norm(position - target) > np.linalg.norm(corners - target, axis=1).max()
    assert np.isfinite(eye_controls(None)).all()


needs_vulkan = pytest.mark.skipif(
    ctypes.util.find_library("vulkan") is None or not any(Path("/usr/share/vulkan/icd.d").glob("*.json")),
    reason="needs a Vulkan driver (Debian: mesa-vulkan-drivers libvulkan1)",
)


@needs_vulkan
def test_the_real_viewer_draws_the_frame_it_is_asked_for(frames, record_run, tmp_path):
    path = record_run(frames)
    pictures = []
    for frame in (10, 13):
        png = tmp_path / f"{frame}.png"
        screenshot(path, frame, png, size=(800, 500))
        pictures.append(cv2.imread(str(png)))
    assert pictures[0].shape == (500, 800, 3)
    left = [picture[40:220, :450] for picture in pictures]
    # noise images in the left view: drawn, and another one in each frame
    assert left[0].std() > 20
    assert (left[0] != left[1]).mean() > 0.2


@needs_vulkan
def test_the_real_viewer_goes_from_recording_to_recording_and_back(frames, record_run, tmp_path, monkeypatch):
    one, two = record_run(frames), tmp_path / "excerpt.rrd"
    write_excerpt(one, 13, 1, two)
    clients, open_at = [], viewer._open

    def overheard(client, *what):
        clients.append(client)
        open_at(client, *what)

    monkeypatch.setattr(viewer, "_open", overheard)
    in_front = []
    with viewer.opened(["--headless", "--window-size", "640x480"]) as go_to:
        for recording, frame in ((one, 14), (two, 13), (one, 10)):
            go_to(recording, frame)
            state = clients[0].get_state()
            shown = {each.store_id: each for each in state.recordings}[state.active_recording]
            assert (shown.current_timeline, shown.current_time) == ("frame", frame)
            in_front.append(state.active_recording)
        with pytest.raises(VfoaError, match=r"clip__gone\.rrd"):
            go_to(one.with_name("clip__gone.rrd"), 10)
    assert in_front[0] == in_front[2] != in_front[1]


def test_recordings_are_found_by_clip_and_configuration(tmp_path):
    for name in ("a__one", "a__two", "b__one"):
        (tmp_path / f"{name}.rrd").touch()
    (tmp_path / "b__two.rrd.partial").touch()
    assert [path.stem for path in find_recordings(tmp_path, None, None)] == ["a__one", "a__two", "b__one"]
    assert [path.stem for path in find_recordings(tmp_path, "a", "two")] == ["a__two"]
    assert find_recordings(tmp_path / "a__one.rrd", None, None) == [tmp_path / "a__one.rrd"]
    (tmp_path / "a__one__two.rrd").touch()
    assert [path.stem for path in find_recordings(tmp_path, "a", "two")] == ["a__two"]
    assert [path.stem for path in find_recordings(tmp_path, "a", "one__two")] == ["a__one__two"]
    with pytest.raises(VfoaError, match=r"clip 'c'.*expected one of: a, b"):
        find_recordings(tmp_path, "c", None)
    with pytest.raises(VfoaError, match=r"'two'.*expected one of: one"):
        find_recordings(tmp_path, "b", "two")
    with pytest.raises(VfoaError, match="found nothing there"):
        find_recordings(tmp_path / "nowhere", None, None)
    (tmp_path / "empty").mkdir()
    with pytest.raises(VfoaError, match="found none"):
        find_recordings(tmp_path / "empty", None, None)


@pytest.mark.parametrize(("options", "code"), [([], 0), (["--screenshot", "a.png"], 130)])
def test_a_viewer_does_not_outlive_the_command_that_opened_it(tmp_path, options, code):
    (tmp_path / "a__one.rrd").touch()
    binary = tmp_path / "rerun"
    binary.write_text(f"#!/bin/sh\necho $$ > {tmp_path}/started\nmv {tmp_path}/started {tmp_path}/pid\nexec sleep 60\n")
    binary.chmod(0o755)
    fake = f"from harness.recording import viewer; viewer.viewer_binary = lambda: {str(binary)!r}"
    command = [sys.executable, "-c", f"{fake}; from harness.cli import main; main()", "view", str(tmp_path), *options]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])}
    with subprocess.Popen(command, cwd=tmp_path, env=environment, stderr=subprocess.PIPE) as process:
        try:
            deadline = time.monotonic() + 30
            while not (tmp_path / "pid").exists() and time.monotonic() < deadline:
                time.sleep(0.05)
            process.send_signal(signal.SIGTERM)
            process.communicate(timeout=30)
        finally:
            process.kill()
    assert process.returncode == code
    assert not psutil.pid_exists(int((tmp_path / "pid").read_text()))
