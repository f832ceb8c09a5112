"""A configuration runner writes the same as a plain loop over the frames: memory, later frames and all frames."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.clips.manifest import load_manifest
from harness.clips.naming import FrameNames, Rules, SubjectNames, name_frame
from harness.pipeline.perception import FollowedFrame, Perception
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.run.table_records import read_records
from tests.disk import write_text
from tests.experiments import TRUTH, experiment_of
from vfoa.bayes import BayesSettings, smooth
from vfoa.pipeline import Attending
from vfoa.tracking import Tracked
from vfoa.types import Scene

FRAMES, LOOK_AHEAD_S = 8, 60
SMOOTHED = {"attention.method": "bayes", "attention.smoothing": "both", "attention.look_ahead_s": LOOK_AHEAD_S}
EXPERIMENT = experiment_of(["studio_talk"], {"smoothed": SMOOTHED}, TRUTH)


def test_a_lane_remembers_who_is_called_what(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given, left = [], []

    def watched(
        scene: Scene, tracked: Tracked, subjects: Rules, targets: Rules, memory: SubjectNames
    ) -> tuple[FrameNames, SubjectNames]:
        given.append(memory)
        names, after = name_frame(scene, tracked, subjects, targets, memory)
        left.append(after)
        return names, after

    monkeypatch.setattr("harness.clips.naming.name_frame", watched)
    experiment = load_experiment(str(write_text(tmp_path / "smoothed.toml", EXPERIMENT)))
    run_plan(prepare(experiment, limit=3), tmp_path / "run", workers=1, progress=lambda clip: None)
    assert given == [SubjectNames(), *left[:-1]]
    assert left[0].by_track


def test_a_lane_remembers_from_frame_to_frame_and_writes_those_that_wait_at_the_end(tmp_path: Path) -> None:
    experiment = load_experiment(str(write_text(tmp_path / "smoothed.toml", EXPERIMENT)))
    plan = prepare(experiment, limit=FRAMES)
    run = run_plan(plan, tmp_path / "run", workers=1, progress=lambda clip: None)
    written = [
        [(subject.track_id, subject.focus, [value.total for value in subject.attention]) for subject in record.subjects]
        for record in read_records(run)
    ]

    configuration = experiment.configurations[0].for_clip("studio_talk")
    settings = configuration.attend.attention
    assert isinstance(settings, BayesSettings)
    forward = settings.model_copy(update={"smoothing": "forward"})
    results, attending = [], Attending(configuration.attend.model_copy(update={"attention": forward}))
    pipeline = Perception([configuration], load_manifest("studio_talk").open())
    for shared in pipeline.frames(range(1, FRAMES + 1)):
        found = shared.by_configuration["smoothed"]
        assert isinstance(found, FollowedFrame)
        results += attending.step(found.scene, found.tracked)
    revised = smooth(results, len(results), settings)
    assert written == [
        [
            (attention.subject.track_id, attention.focus, [value.total for value in attention.values])
            for attention in result.attentions
        ]
        for result in revised
    ]
    assert all(written)
