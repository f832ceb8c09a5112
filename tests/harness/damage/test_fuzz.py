"""Every parser on files that are almost right: a value, or one line that names the file. Never anything else."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.clips.manifest import load_manifest
from harness.labels.files import read_annotations
from harness.labels.formats import FORMATS
from harness.labels.labels import Labels
from harness.run.experiment import load_experiment
from harness.run.results import read_results, to_line
from harness.sources.calibration_files.read import read_cameras
from harness.sources.media.disparity_files import read_depth, read_disparity, read_sintel_disparity
from harness.sources.media.images import read_rgb
from harness.sources.recordings.clip import McapClip
from harness.sources.recordings.settings import RecordingSettings
from harness.sources.sintel_files import read_camera
from harness.stages.outputs.tables import read_table
from tests.calibrations import RIG, SIZE, opencv_nodes, write_kalibr, write_opencv, write_zed
from tests.disk import picture, sintel_camera, sintel_disparity, write_bytes, write_image, write_text
from tests.exchanges import exchange, row, staged
from tests.harness.damage.project import EXPERIMENT, LABELS, MANIFEST
from tests.recordings import rectified_camera, write_pairs
from tests.records import answers
from vfoa.errors import VfoaError

Reader = Callable[[Path], Any]


def _size() -> tuple[int, int]:
    return SIZE


def _cameras(path: Path) -> Any:
    return read_cameras([path], _size)


def _annotations(path: Path) -> Any:
    return read_annotations(path, timeline=None, subjects=["anna"], targets=["mug", "book"])


def _mcap(path: Path) -> Any:
    clip = McapClip(RecordingSettings(), path)
    return [clip.frame(number) for number in clip.frames]


def _format(name: str) -> Reader:
    return lambda path: FORMATS.load(name)().read(path, exchange())


def _npy(path: Path) -> None:
    np.save(path, np.ones((4, 5), np.float32))


def _dpt(path: Path) -> None:
    header = np.array([202021.25], "<f4").tobytes() + np.array([5, 4], "<i4").tobytes()
    write_bytes(path, header + np.ones(20, "<f4").tobytes())


def _pfm(path: Path) -> None:
    write_bytes(path, b"Pf\n5 4\n-1.0\n" + np.ones(20, "<f4").tobytes())


def _kitti(path: Path) -> None:
    write_text(path, "P2: 700 0 600 0 0 700 180 0 0 0 1 0\nP3: 700 0 600 -370 0 700 180 0 0 0 1 0\n")


def _recording(path: Path) -> None:
    left, right = (rectified_camera(64, 48, 50.0, 31.5, 23.5, baseline) for baseline in (0.0, 0.1))
    write_pairs(path, [(k * 40_000_000, picture(k), picture(1000 + k), left, right) for k in (1, 2)], chunk_size=9_000)


def _export(name: str) -> Callable[[Path], None]:
    labels = Labels([row(1, 3, "bird"), row(4, 9, "none"), row(10, 12, "bird")])
    clip, bodies = staged()
    return lambda path: FORMATS.load(name)().write(path, labels, exchange(clip, bodies=bodies)) and None


PARSERS: dict[str, tuple[str, Callable[[Path], Any], Reader]] = {
    "manifest": ("mine.toml", lambda path: write_text(path, MANIFEST), load_manifest),
    "experiment": ("e.toml", lambda path: write_text(path, EXPERIMENT), lambda path: load_experiment(str(path))),
    "annotations": ("mine.csv", lambda path: write_text(path, LABELS), _annotations),
    "results": (
        "results.jsonl",
        lambda path: write_text(path, "".join(map(to_line, answers(["mug", "none", None])))),
        lambda path: list(read_results(path)),
    ),
    "signal table": (
        "gaze.csv",
        lambda path: write_text(path, "frame,subject,x,y,z\n1,anna,0,0,1\n2,anna,0.5,-0.5,1e0\n"),
        lambda path: [each.numbers(("x", "y", "z")) for each in read_table(path, ("x", "y", "z"), range(9))],
    ),
    "OpenCV calibration": ("stereo.yml", lambda path: write_opencv(path, opencv_nodes(RIG), SIZE), _cameras),
    "OpenCV XML calibration": ("stereo.xml", lambda path: write_opencv(path, opencv_nodes(RIG), SIZE), _cameras),
    "Kalibr calibration": ("camchain.yaml", lambda path: write_kalibr(path, RIG), _cameras),
    "ZED calibration": ("SN1.conf", lambda path: write_zed(path, RIG), _cameras),
    "KITTI calibration": ("calib.txt", _kitti, _cameras),
    "Sintel camera": ("frame.cam", lambda path: write_bytes(path, sintel_camera(100.0)), read_camera),
    "Sintel depth": ("frame.dpt", _dpt, read_depth),
    "Sintel disparity": (
        "frame.png",
        lambda path: write_image(path, sintel_disparity(np.full((4, 5), 7.0))),
        read_sintel_disparity,
    ),
    "KITTI disparity": (
        "frame.png",
        lambda path: write_image(path, np.full((4, 5), 700, np.uint16)),
        read_disparity,
    ),
    "npy disparity": ("frame.npy", _npy, read_disparity),
    "PFM disparity": ("frame.pfm", _pfm, read_disparity),
    "PNG image": ("frame.png", lambda path: write_image(path, picture(1, 20, 10)), read_rgb),
    "JPEG image": ("frame.jpg", lambda path: write_image(path, picture(1, 20, 10)), read_rgb),
    "MCAP": ("take.mcap", _recording, _mcap),
    **{
        f"{name} labels": ("theirs", _export(name), _format(name))
        for name in FORMATS.builtin
        if name not in ("videoattentiontarget", "idiap_vfoa")  # the second is only read
    },
}

_WORDS = ["nan", "inf", "-1", "0", "1e999", "99999999999999999999", "", "é", "\0", "[", '"', "1.5", "none", "\n"]


@st.composite
def _edits(draw: st.DrawFn) -> Callable[[bytes], bytes]:
    """Bytes flipped, cut off, left out, doubled; numbers and words replaced."""
    kind = draw(st.sampled_from(["flip", "cut", "drop", "double", "word", "word"]))
    at, length = draw(st.floats(0, 1)), draw(st.integers(1, 40))
    value, word = draw(st.integers(1, 255)), draw(st.sampled_from(_WORDS)).encode()

    def edit(data: bytes) -> bytes:
        place = min(int(at * len(data)), len(data) - 1)
        if kind == "flip":
            return data[:place] + bytes([data[place] ^ value]) + data[place + 1 :]
        if kind == "cut":
            return data[:place]
        if kind == "drop":
            return data[:place] + data[place + length :]
        if kind == "double":
            return data[: place + length] + data[place:]
        words = list(re.finditer(rb"[\w.+-]+", data)) or [re.match(rb"", data)]
        match = words[min(int(at * len(words)), len(words) - 1)]
        assert match is not None
        return data[: match.start()] + word + data[match.end() :]

    return edit


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("fuzz")


@pytest.mark.parametrize("name", PARSERS)
@given(edits=st.lists(_edits(), max_size=3))
def test_a_parser_answers_or_says_in_one_line_what_is_wrong(
    name: str, edits: list[Callable[[bytes], bytes]], folder: Path
) -> None:
    file_name, write, read = PARSERS[name]
    path = folder / name / file_name
    kept = folder / name / f"whole-{file_name}"
    if not kept.exists():
        path.parent.mkdir(exist_ok=True)
        write(path)
        path.rename(kept)
    data = kept.read_bytes()
    for edit in edits:
        data = edit(data) if data else data
    path.write_bytes(data)
    refused = _refused(read, path)
    assert edits or refused is None
    if refused is not None:
        assert "\n" not in refused
        assert file_name in refused


def _refused(read: Reader, path: Path) -> str | None:
    """What is wrong with the file, None if it can be read."""
    try:
        read(path)
    except VfoaError as error:
        return str(error)
    return None
