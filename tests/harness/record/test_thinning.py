"""Recordings that are whole around wrong frames: the same values there, nothing that takes space elsewhere."""

from __future__ import annotations

import subprocess
from functools import partial

import pytest
from rerun.chunk import RrdReader

from harness.record import entities
from harness.record.composed import find_clips
from harness.record.excerpt import write_excerpt
from harness.record.program import viewer_binary
from harness.record.thinning import Judged, Whole
from harness.score.verdicts import judge
from tests.harness.record.conftest import ANN, LABEL, show, write_run

FRAMES = range(10, 30)
WRONG = {"one": {15, 23}, "two": {15}}
WHOLE = {"one": {10, 14, 15, 16, 22, 23, 24}, "two": {10, 14, 15, 16}}
LARGE = ("/points", "/cones", "/rays", "/missed_rays", "/hits")


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """The same two configurations recorded whole, and whole around wrong frames: Ann looks at the book, not the cup."""
    seen = {
        name: [show(frame, things=(1, 2, 3, 4), gaze_at=4 if frame in wrong else 2) for frame in FRAMES]
        for name, wrong in WRONG.items()
    }
    folder = tmp_path_factory.mktemp("thin")
    write = partial(write_run, judge=lambda record: [judge(record, ANN, LABEL)])
    return write(folder / "whole", seen), write(folder / "thin", seen, around=1)


def _is_large(path: str) -> bool:
    return path.startswith((entities.MASKS, entities.DISPARITY)) or (
        path.startswith((entities.RECONSTRUCTION, entities.ATTENTION_3D)) and path.endswith(LARGE)
    )


def test_frames_around_wrong_ones_are_whole_and_the_others_thin(runs, read_back):
    whole, thin = map(read_back, runs)
    assert {path for path in whole.paths if _is_large(path)}
    assert whole.paths == thin.paths
    for path in whole.paths:
        kept = WHOLE["two"] if "/two/" in f"{path}/" else WHOLE["one"]  # the masks are of both
        expected = whole.everything(path)
        found = thin.everything(path)
        cleared = found.pop("Clear:is_recursive", {}) if _is_large(path) else {}
        if _is_large(path):
            expected = {
                name: {frame: value for frame, value in values.items() if frame in kept}
                for name, values in expected.items()
                if name != "Clear:is_recursive"
            }
            assert set(cleared) >= {frame + 1 for frame in kept if frame + 1 not in kept}
        assert found == expected, path


def test_thin_recordings_are_opened_as_whole_ones(runs, read_back, tmp_path):
    _, thin = runs
    for path in thin.run.glob("*.rrd"):
        done = subprocess.run([viewer_binary(), "rrd", "verify", path], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    assert len(RrdReader(thin.files.attention("one")).blueprints()) == 1
    assert not list(thin.run.glob("*.partial*"))
    (clip,) = find_clips(thin.run, None, None)
    for recording in (clip.compose(), clip.compare("one", "two"), clip.under("two").compose()):
        assert recording.layout() is not None
        assert len({RrdReader(file).recordings()[0].recording_id for file in recording.files}) == 1
    write_excerpt(clip.compose(), 25, 23, 1, tmp_path / "excerpt.rrd")
    excerpt = read_back(tmp_path / "excerpt.rrd")
    assert set(excerpt.at(entities.cue_3d("one", ANN, "gaze", "rays"), "LineStrips3D:strips")) == {22, 23, 24}


def test_a_clip_without_wrong_frames_shows_its_scene_in_the_first():
    times = dict.fromkeys(range(5, 9), 0)
    none = Whole.around((), 2, times)
    assert none.frames == {5}
    assert none.ends_ns() == {6: 0}
    assert Whole.around({8}, 1, times).frames == {5, 7, 8}
    assert Whole.around({8}, 1, times).ends_ns() == {6: 0}
    assert Whole.around({5}, 99, times).ends_ns() == {}


def test_a_run_that_goes_on_knows_the_wrong_frames_before():
    before, after = (Judged(around=1) for _ in range(2))
    seen = show(15, things=(1, 2, 3, 4), gaze_at=4).record
    before.add(seen, [judge(seen, ANN, LABEL)])
    after.resume(before.state())
    assert after == before
    assert after.whole() == Whole(frames=frozenset({15}), times_ns={15: seen.time_ns})
