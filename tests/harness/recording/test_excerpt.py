from __future__ import annotations

import os
import subprocess

import pytest
from rerun.chunk import RrdReader

from harness.recording import entities
from harness.recording.excerpt import write_excerpt
from harness.recording.viewer import viewer_binary
from vfoa.errors import VfoaError

MATRIX = "Pinhole:image_from_camera"


@pytest.mark.parametrize(
    ("frame", "margin", "kept"), [(13, 1, [13, 14]), (10, 1, [10, 11]), (11, 99, [10, 11, 13, 14])]
)
def test_an_excerpt_is_whole_and_holds_the_frames_around_one(
    frames, record_run, read_back, tmp_path, frame, margin, kept
):
    recording, excerpt = record_run(frames), tmp_path / "excerpt.rrd"
    write_excerpt(recording, frame, margin, excerpt)
    done = subprocess.run([viewer_binary(), "rrd", "verify", excerpt], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    whole, part = read_back(recording), read_back(excerpt)
    for path, component in (
        (entities.IMAGE, "EncodedImage:blob"),
        (entities.SUMMARY, "TextDocument:text"),
        (entities.box(4), "Boxes3D:centers"),
    ):
        expected = {f: value for f, value in whole.at(path, component).items() if f in kept}
        assert part.at(path, component) == expected
    assert list(part.at(entities.IMAGE, "EncodedImage:blob")) == kept
    # the camera was logged at the first frame alone, and without it nothing is drawn
    assert part.at(entities.CAMERA, MATRIX) == {kept[0]: whole.at(entities.CAMERA, MATRIX)[10]}
    guide = (entities.GUIDE, "TextDocument:text")
    assert part.static(*guide) == whole.static(*guide)
    stores = RrdReader(excerpt)
    assert (len(stores.recordings()), len(stores.blueprints())) == (1, 1)


def test_a_frame_that_is_not_there_is_refused(frames, record_run, tmp_path):
    recording = record_run(frames)
    with pytest.raises(VfoaError, match="no frame 12; expected one of 10 to 14"):
        write_excerpt(recording, 12, 1, tmp_path / "excerpt.rrd")
    with pytest.raises(VfoaError, match="--margin"):
        write_excerpt(recording, 13, -1, tmp_path / "excerpt.rrd")


def test_an_excerpt_that_fails_leaves_the_old_one_alone(frames, record_run, tmp_path, monkeypatch):
    recording, excerpt = record_run(frames), tmp_path / "out" / "excerpt.rrd"
    write_excerpt(recording, 13, 1, excerpt)
    before = excerpt.read_bytes()
    monkeypatch.setattr("harness.recording.excerpt._write_camera", lambda *rest: rest[-1].write_bytes(b"no recording"))
    with pytest.raises(VfoaError, match="rerun rrd merge: "):
        write_excerpt(recording, 10, 1, excerpt)
    assert excerpt.read_bytes() == before
    assert os.listdir(excerpt.parent) == ["excerpt.rrd"]
