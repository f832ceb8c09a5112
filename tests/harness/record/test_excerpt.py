from __future__ import annotations

import os
import subprocess

import pytest
from rerun.chunk import RrdReader
from typer.testing import CliRunner

from harness.cli import app
from harness.record import entities
from harness.record.composed import find_clips
from harness.record.excerpt import write_excerpt
from harness.record.viewer import viewer_binary
from tests.harness.record.conftest import CONFIGURATION
from vfoa.errors import VfoaError

MATRIX = "Pinhole:image_from_camera"
SUMMARY = entities.summary(CONFIGURATION)


def _clip(recorded):
    return find_clips(recorded.run, None, None)[0]


@pytest.mark.parametrize(
    ("frame", "margin", "kept"),
    [(13, 1, [10, 11, 13, 14]), (10, 1, [10, 11]), (11, 1, [10, 11, 13]), (11, 99, [10, 11, 13, 14])],
)
def test_an_excerpt_is_whole_and_holds_the_frames_around_one(
    frames, record_run, read_back, tmp_path, frame, margin, kept
):
    recorded, excerpt = record_run(frames), tmp_path / "excerpt.rrd"
    write_excerpt(_clip(recorded), None, frame, margin, excerpt)
    done = subprocess.run([viewer_binary(), "rrd", "verify", excerpt], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    whole, part = read_back(recorded), read_back(excerpt)
    for path, component in (
        (entities.masks(CONFIGURATION), "EncodedImage:blob"),
        (SUMMARY, "TextDocument:text"),
        (entities.box(CONFIGURATION, 4), "Boxes3D:centers"),
    ):
        expected = {f: value for f, value in whole.at(path, component).items() if f in kept}
        assert part.at(path, component) == expected
    assert list(part.at(SUMMARY, "TextDocument:text")) == kept
    # a video is decoded from the key frame before, where everything else is there, too
    assert list(part.at(entities.IMAGE, "VideoStream:sample")) == kept
    guide = (entities.GUIDE, "TextDocument:text")
    assert part.static(*guide) == whole.static(*guide)
    stores = RrdReader(excerpt)
    # a plot shows the frames that are there, not those of the whole clip
    rooms = stores.stream(store=stores.blueprints()[0]).filter(components="TimeAxis:view_range")
    starts = {chunk.to_record_batch().column("TimeAxis:view_range")[0].as_py()[0]["start"] for chunk in rooms}
    assert len(starts) == 1
    assert kept[0] - 1 <= starts.pop() <= kept[0]
    assert (len(stores.recordings()), len(stores.blueprints())) == (1, 1)


def test_an_excerpt_of_jpeg_pictures_has_those_of_its_frames(frames, record_run, read_back, tmp_path):
    recorded, excerpt = record_run(frames, jpeg=True), tmp_path / "excerpt.rrd"
    write_excerpt(_clip(recorded), None, 13, 1, excerpt)
    whole, part = (read_back(each).at(entities.IMAGE, "EncodedImage:blob") for each in (recorded, excerpt))
    assert part == {frame: whole[frame] for frame in (11, 13, 14)}
    # the camera was logged at the first frame alone, and without it nothing is drawn
    assert read_back(excerpt).at(entities.CAMERA, MATRIX) == {11: read_back(recorded).at(entities.CAMERA, MATRIX)[10]}


def test_a_frame_that_is_not_there_is_refused(frames, record_run, tmp_path):
    clip = _clip(record_run(frames))
    with pytest.raises(VfoaError, match="no frame 12; expected one of 10 to 14, such as 11 or 13"):
        write_excerpt(clip, None, 12, 1, tmp_path / "excerpt.rrd")
    with pytest.raises(VfoaError, match="--margin"):
        write_excerpt(clip, None, 13, -1, tmp_path / "excerpt.rrd")


def test_an_excerpt_that_fails_leaves_the_old_one_alone(frames, record_run, tmp_path):
    recorded, excerpt = record_run(frames), tmp_path / "out" / "excerpt.rrd"
    clip = _clip(recorded)
    write_excerpt(clip, None, 13, 1, excerpt)
    before = excerpt.read_bytes()
    recorded.files.attention(CONFIGURATION).write_bytes(b"no recording")
    with pytest.raises(VfoaError, match=r"clip__two cones\.rrd: .*damaged"):
        write_excerpt(clip, None, 10, 1, excerpt)
    assert excerpt.read_bytes() == before
    assert os.listdir(excerpt.parent) == ["excerpt.rrd"]


def test_the_verb_replaces_a_file_of_its_user_only_where_that_was_said(frames, record_run, tmp_path):
    recorded, own = record_run(frames), tmp_path / "labels.csv"
    own.write_text("mine")
    words = ["export-failure", str(recorded.run), "--frame", "13", "--margin", "0", "--out", str(own)]
    with pytest.raises(VfoaError, match=r"labels\.csv: .*--replace, .*--out"):
        CliRunner().invoke(app, words, catch_exceptions=False)
    assert own.read_text() == "mine"
    assert CliRunner().invoke(app, [*words, "--replace"], catch_exceptions=False).exit_code == 0
    assert own.read_bytes()[:4] == b"RRF2"
