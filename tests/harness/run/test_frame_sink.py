"""Every sink of a run gets every frame in order, hears how the run ended, and can end its configuration alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

import pyarrow.parquet as pq
import pytest

from harness.clips.manifest import load_manifest
from harness.pipeline.perception import SharedFrame
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.frame_sink import ClipContext, FinishedFrame, SinkContext, SinkFactory
from harness.run.loop import ClipJob, run_clip
from vfoa.errors import VfoaError

NAMES = ("bm-one", "bm-two")


@dataclass
class Witness:
    """The sink of one configuration: writes down what happens to it, and fails at a frame if told to."""

    said: list[tuple[str, object]]
    name: str
    fails_at: int | None = None

    def __enter__(self) -> Self:
        self.said.append((self.name, "enter"))
        return self

    def __exit__(self, kind: object, *rest: object) -> None:
        self.said.append((self.name, kind))

    def write(self, frame: FinishedFrame) -> None:
        if frame.record.frame == self.fails_at:
            raise VfoaError("no room")
        self.said.append((self.name, frame.record.frame))


@dataclass
class Witnesses:
    """Opens a witness called after the configuration; for none of ``without``."""

    name: str
    said: list[tuple[str, object]] = field(default_factory=list)
    without: tuple[str, ...] = ()
    fails: Mapping[str, int] = field(default_factory=dict)

    def described(self) -> Mapping[str, Any]:
        return {}

    def open(self, context: SinkContext) -> Witness | None:
        if context.configuration in self.without:
            return None
        return Witness(self.said, f"{self.name} {context.configuration}", self.fails.get(context.configuration))


@dataclass
class SceneWitness:
    """The sink of a clip: writes down what happens to it, and fails at a frame if told to."""

    said: list[tuple[str, object]]
    fails_at: int | None = None
    whole: bool = True

    def described(self) -> Mapping[str, Any]:
        return {}

    def open(self, context: SinkContext) -> None:
        self.said.append(("answers", context.configuration))

    def open_scenes(self, context: ClipContext) -> Self:
        assert context.configurations == ("bm-one", "bm-two")
        return self

    def is_whole(self, context: ClipContext) -> bool:
        return self.whole

    def __enter__(self) -> Self:
        self.said.append(("clip", "enter"))
        return self

    def __exit__(self, kind: object, *rest: object) -> None:
        self.said.append(("clip", kind))

    def write(self, frame: SharedFrame) -> None:
        if frame.index == self.fails_at:
            raise VfoaError("no room")
        self.said.append(("clip", frame.index))


def _job(out: Path, *sinks: SinkFactory) -> ClipJob:
    experiment = load_experiment("demo", clips=("studio_table",))
    chosen = [configuration for configuration in experiment.configurations if configuration.name in NAMES]
    manifest = load_manifest("studio_table")
    return ClipJob(
        manifest=manifest,
        frames=(1, 2),
        configurations=tuple(chosen),
        directory=RunDirectory(out),
        clouds=(),
        sinks=sinks,
    )


def test_every_sink_gets_every_frame_and_hears_the_end(tmp_path: Path) -> None:
    said: list[tuple[str, object]] = []
    first, second = Witnesses("a", said), Witnesses("b", said, without=("bm-two",))
    outcome = run_clip(_job(tmp_path, first, second), lambda clip: None)
    assert not outcome.failures
    assert [event for name, event in said if name == "a bm-one"] == ["enter", 1, 2, None]
    assert [event for name, event in said if name == "a bm-two"] == ["enter", 1, 2, None]
    assert [name for name, event in said if event == 2] == ["a bm-one", "b bm-one", "a bm-two"]


@pytest.mark.parametrize("frame", [1, 2])
def test_a_sink_that_fails_ends_its_configuration_alone(tmp_path: Path, frame: int) -> None:
    said: list[tuple[str, object]] = []
    outcome = run_clip(_job(tmp_path, Witnesses("a", said), Witnesses("b", fails={"bm-one": frame})), lambda clip: None)
    assert {pair: str(error) for pair, error in outcome.failures.items()} == {("studio_table", "bm-one"): "no room"}
    assert [event for name, event in said if name == "a bm-one"] == ["enter", *range(1, frame + 1), VfoaError]
    directory = RunDirectory(tmp_path)
    assert [directory.is_finished(("studio_table", name)) for name in ("bm-one", "bm-two")] == [False, True]
    answers = pq.read_table(directory.answers(("studio_table", "bm-two")))
    assert set(answers["frame"].to_pylist()) == {1, 2}


WHOLE = [("clip", event) for event in ("enter", 1, 2, None)]
OPENED = [("answers", "bm-one"), ("answers", "bm-two")]


def test_the_sink_of_a_clip_gets_every_frame_once_and_is_closed_before_it_is_attended_to(tmp_path: Path) -> None:
    witness = SceneWitness([])
    assert not run_clip(_job(tmp_path, witness), lambda clip: None).failures
    assert witness.said == WHOLE + OPENED


def test_the_sink_of_a_clip_that_fails_ends_all_of_its_configurations(tmp_path: Path) -> None:
    witness = SceneWitness([], fails_at=2)
    outcome = run_clip(_job(tmp_path, witness), lambda clip: None)
    assert {pair[1]: str(error) for pair, error in outcome.failures.items()} == dict.fromkeys(NAMES, "no room")
    assert witness.said == [("clip", event) for event in ("enter", 1, VfoaError)]
    assert [path.name for path in tmp_path.iterdir()] == ["partial"]


@pytest.mark.parametrize("whole", [True, False])
def test_a_clip_is_perceived_again_if_a_sink_lacks_what_it_wrote(tmp_path: Path, whole: bool) -> None:
    run_clip(_job(tmp_path, SceneWitness([])), lambda clip: None)
    again, frames = SceneWitness([], whole=whole), list[str]()
    assert not run_clip(_job(tmp_path, again), frames.append).failures
    assert again.said == ([] if whole else WHOLE) + OPENED
    assert [name for name in frames if name] == ["studio_table"] * 2
