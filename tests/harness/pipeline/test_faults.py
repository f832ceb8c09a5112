"""A bug in a stage of somebody's own ends the configurations that have it: one line, a traceback that is kept, no more.

The same whoever does the work; and a bug of the harness itself is not taken for one of a stage.
"""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.pipeline.cache_store import Store
from harness.pipeline.stage_runner import StageRunner
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.records import FrameRecord
from harness.run.runner import prepare, run_plan
from harness.run.table_records import read_records
from scripts.measure.many_clips import local_cluster
from tests.alley import write_experiment
from tests.command import vfoa
from tests.disk import write_text
from tests.plugins import install
from tests.scenes import make_rig
from vfoa.errors import StageError, VfoaError
from vfoa.gaze.gaze360 import Gaze360
from vfoa.settings import Settings
from vfoa.types import Disparity, Gaze, Head, Instances, StereoFrame

FRAMES = 5
PLUGIN = """
import numpy as np
from vfoa.settings import Settings
from vfoa.types import Disparity

class Flat:
    class Settings(Settings):
        fails_at: int = -1
        disparity_px: float = 5.0

    def __init__(self, settings):
        self.settings = settings

    def match(self, frame):
        far = 1 / (frame.index - self.settings.fails_at)
        return Disparity(disparity_px=np.full(frame.left.shape[:2], self.settings.disparity_px, np.float32))
"""
EXPERIMENT = """\
[[configuration]]
name = "sound"
stereo = { matcher = "bm", min_depth_m = 1.0, wls = false }
[[configuration]]
name = "broken"
stereo = { matcher = "flat", fails_at = 4 }
[[configuration]]
name = "flat"
stereo.matcher = "flat"
"""
SAID = 'frame 4: stereo.matcher = "flat", match: ZeroDivisionError: division by zero'


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A package of somebody else's, as if it were installed."""
    folder = tmp_path_factory.mktemp("site")
    install(folder, "vfoa_flat", PLUGIN, group="vfoa.stereo", name="flat", cls="Flat")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(folder))
        yield folder
    sys.modules.pop("vfoa_flat", None)


@pytest.fixture(scope="module")
def experiment(site: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_experiment(tmp_path_factory.mktemp("faults"), range(1, FRAMES + 1), EXPERIMENT)


@pytest.fixture(scope="module")
def alone(experiment: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[FrameRecord]]:
    """The results of what is sound, run by itself."""
    folder = tmp_path_factory.mktemp("alone")
    return _results(_run(write_text(folder / "sound.toml", _only(experiment, "sound", "flat")), folder / "run"))


def _only(experiment: Path, *names: str) -> str:
    """The experiment's text with these configurations alone."""
    head, *every = experiment.read_text().split("[[configuration]]")
    return "[[configuration]]".join([head, *(each for each in every if any(f'"{name}"\n' in each for name in names))])


def _run(experiment: Path, out: Path, *, workers: int = 1, **how: Any) -> RunDirectory:
    plan = prepare(load_experiment(str(experiment)))
    return run_plan(plan, out, workers=workers, progress=lambda clip: None, **how)


def _results(directory: RunDirectory) -> dict[str, list[FrameRecord]]:
    found: dict[str, list[FrameRecord]] = {}
    for record in read_records(directory):
        found.setdefault(record.configuration, []).append(record)
    return found


def _check(directory: RunDirectory, alone: dict[str, list[FrameRecord]]) -> None:
    assert _results(directory) == alone
    (failed,) = directory.read_manifest().failed
    assert failed.plain() == {
        "clip": "alley",
        "configuration": "broken",
        "error": SAID,
        "traceback": "partial/alley__broken.traceback.txt",
    }
    trace = (directory.path / str(failed.traceback)).read_text()
    assert trace.startswith("Traceback (most recent call last)")
    assert "far = 1 / (frame.index - self.settings.fails_at)" in trace
    assert trace.endswith("ZeroDivisionError: division by zero\n")


@pytest.mark.parametrize("how", [{}, {"threads": 2}, {"workers": 2}], ids=str)
@pytest.mark.parametrize("cached", [False, True])
def test_a_bug_in_a_matcher_of_somebodys_own_ends_its_configuration_alone(
    how: dict[str, int], cached: bool, experiment: Path, alone: dict[str, list[FrameRecord]], tmp_path: Path
) -> None:
    store = Store(tmp_path / "cache", 10**9) if cached else None
    _check(_run(experiment, tmp_path / "run", cache=store, **how), alone)


def test_a_bug_on_a_cluster_is_said_in_the_same_words(
    experiment: Path, alone: dict[str, list[FrameRecord]], tmp_path: Path
) -> None:
    with local_cluster(1) as scheduler:
        _check(_run(experiment, tmp_path / "run", scheduler=scheduler), alone)
        cache = Store(tmp_path / "cache", 10**9)
        _check(_run(experiment, tmp_path / "shared", scheduler=scheduler, cache=cache), alone)


def test_a_mended_stage_is_tried_again_and_leaves_nothing_of_its_fault(
    experiment: Path, alone: dict[str, list[FrameRecord]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _check(_run(experiment, tmp_path / "run"), alone)
    flat = importlib.import_module("vfoa_flat").Flat
    mended = lambda self, frame: Disparity(disparity_px=np.full(frame.left.shape[:2], 9.0, np.float32))  # noqa: E731
    monkeypatch.setattr(flat, "match", mended)  # which finds something else in the frames before, too
    directory = _run(experiment, tmp_path / "run")
    assert [each.configuration for each in directory.read_manifest().failed] == ["broken"]
    directory = _run(experiment, tmp_path / "run", retry_failed=True)
    assert directory.read_manifest().failed == []
    assert not (directory.path / "partial").exists()
    results = _results(directory)
    assert {name: results[name] for name in alone} == alone
    assert results["broken"] == _results(_run(experiment, tmp_path / "anew"))["broken"]


def test_the_command_says_where_the_traceback_is_and_leaves_with_1(
    experiment: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ("run", str(experiment), "--out", "out", "--workers", "1", "--no-cache")
    code, _, complaint = vfoa(monkeypatch, capsys, *words)
    assert code == 1
    first, second = complaint.splitlines()
    kept = Path("out") / "partial" / "alley__broken.traceback.txt"
    assert first == f"vfoa: alley under broken: {SAID} (traceback: {kept})"
    assert kept.is_file()
    assert "--retry-failed" in second
    assert (Path("out") / "alley__sound.rrd").is_file()
    assert not (Path("out") / "alley__broken.rrd").exists()
    assert f"broken: left out, failed on alley: {SAID}" in (Path("out") / "frr.md").read_text()
    alone = write_text(Path("alone.toml"), _only(experiment, "broken"))
    code, _, complaint = vfoa(monkeypatch, capsys, "run", str(alone), "--out", "alone", "--workers", "1", "--no-cache")
    assert code == 2
    kept = Path("alone") / "partial" / "alley__broken.traceback.txt"
    assert complaint == f"vfoa: alley under broken: {SAID} (traceback: {kept})\n"
    assert kept.is_file()


def test_the_steps_of_an_oracle_ablation_that_do_without_a_faulty_stage_are_finished(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    stages = 'segmentation.model = "truth"\nheads.detector = "truth"\nhead_pose.model = "none"\ngaze.model = "truth"\n'
    flat = 'stereo = { matcher = "flat", fails_at = 2 }\n'
    file = write_text(tmp_path / "e.toml", f'clips = ["studio_table"]\n[defaults]\n{stages}{flat}')
    words = ("--oracle", "--limit", "3", "--workers", "1", "--recording", "none", "--no-cache", "--out", "out")
    code, said, complaint = vfoa(monkeypatch, capsys, "run", str(file), *words)
    assert code == 1
    assert complaint.count("\n") == 2
    assert "frame 2: stereo.matcher" in complaint
    assert "default+disparity" in said


def test_a_gaze_from_several_frames_that_fails_names_its_frame(
    experiment: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    estimate, calls = Gaze360.estimate_sequence, list[int]()

    def fails_on_its_third(self: Gaze360, crops: Any, head: Head, rig: Any) -> Gaze:
        calls.append(1)
        if len(calls) == 3:
            raise IndexError("no such bin")
        return estimate(self, crops, head, rig)

    monkeypatch.setattr(Gaze360, "estimate_sequence", fails_on_its_third)
    sound = write_text(tmp_path / "sound.toml", _only(experiment, "sound"))
    line = r"frame 3: gaze\.model = \"gaze360\", estimate_sequence: IndexError: no such bin"
    with pytest.raises(VfoaError, match=line):
        _run(sound, tmp_path / "run")
    (trace,) = (path for path in (tmp_path / "run").rglob("*") if path.is_file() and path.name != ".lock")
    assert "no such bin" in trace.read_text()


def test_a_fault_of_attention_is_one_line_too(
    experiment: Path, alone: dict[str, list[FrameRecord]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(scene: Any, *_: Any) -> Any:
        raise FloatingPointError("not a number")

    monkeypatch.setattr("vfoa.pipeline.filter_cues", fails)
    with pytest.raises(VfoaError, match="frame 1: attention: FloatingPointError"):
        _run(experiment, tmp_path / "run")


@pytest.mark.parametrize("place", ["harness.clips.naming.name_frame", "harness.pipeline.cache.encode"])
def test_a_bug_of_the_harness_is_not_taken_for_one_of_a_stage(
    place: str, experiment: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*_: Any) -> Any:
        raise ZeroDivisionError("ours")

    monkeypatch.setattr(place, fails)
    with pytest.raises(ZeroDivisionError, match="ours"):
        _run(experiment, tmp_path / "run", cache=Store(tmp_path / "cache", 10**9))


# A source that does not wait


# The guard


class Told:
    """A stage that does as it is told."""

    Settings = Settings

    def __init__(self, answer: Any) -> None:
        self._answer = answer

    def match(self, frame: StereoFrame) -> Any:
        if isinstance(self._answer, BaseException):
            raise self._answer
        return self._answer

    segment = match

    def detect(self, frame: StereoFrame, instances: Any) -> Any:
        return self._answer

    def estimate(self, frame: StereoFrame, head: Any, pose: Any = None) -> Any:
        return self._answer


def _frame() -> StereoFrame:
    rig = make_rig()
    image = np.zeros((rig.height_px, rig.width_px, 3), np.uint8)
    return StereoFrame(index=7, time_ns=0, left=image, right=image, rig=rig)


def _guarded(stage: object, slot: str = "stereo") -> StageRunner:
    return StageRunner(stage, slot=slot, name="mine")


@pytest.mark.parametrize(
    ("raised", "said"),
    [
        (MemoryError(), "MemoryError"),
        (OSError(2, "No such file", "model.bin"), "FileNotFoundError: [Errno 2] No such file: 'model.bin'"),
        (StopIteration(), "StopIteration"),
        (KeyError("left"), "KeyError: 'left'"),
        (ValueError("two\nlines"), "ValueError: two lines"),
        (ValueError("x" * 999), f"ValueError: {'x' * 300}..."),
    ],
)
def test_whatever_a_stage_raises_is_one_line(raised: Exception, said: str) -> None:
    with pytest.raises(StageError) as error:
        _guarded(Told(raised)).match(_frame())
    assert str(error.value) == f"mine, match: {said}"
    assert type(raised).__name__ in error.value.trace
    assert error.value.__context__ is None


@pytest.mark.parametrize("raised", [KeyboardInterrupt(), SystemExit(3), VfoaError("bad weights")])
def test_what_is_no_fault_stays_as_it_is(raised: BaseException) -> None:
    with pytest.raises(type(raised)) as error:
        _guarded(Told(raised)).match(_frame())
    assert error.value is raised


_MAP = Disparity(disparity_px=np.zeros((3, 4), np.float32))
_IDS = Instances(ids=np.zeros((3, 4), np.uint16), instances=())


@pytest.mark.parametrize(
    ("slot", "method", "answer", "said"),
    [
        ("stereo", "match", None, "TypeError: returned NoneType; expected Disparity"),
        ("stereo", "match", np.zeros((2, 2)), "TypeError: returned ndarray; expected Disparity"),
        ("stereo", "match", _MAP, "ValueError: returned a map of (3, 4); expected "),
        ("segmentation", "segment", _IDS, "ValueError: returned a map of (3, 4); expected "),
        ("heads", "detect", None, "TypeError: returned NoneType; expected tuple or list"),
        ("heads", "detect", (1, 2), "TypeError: returned a tuple of other values; expected vfoa.Head values alone"),
        ("gaze", "estimate", (0.0, 0.0, 1.0), "TypeError: returned tuple; expected Gaze or NoGaze or None"),
        ("head_pose", "estimate", Gaze(direction=np.array([0.0, 0, 1])), "returned Gaze; expected HeadPose or None"),
    ],
)
def test_what_a_stage_returns_by_mistake_is_said_of_the_stage(slot: str, method: str, answer: Any, said: str) -> None:
    stage = _guarded(Told(answer), slot)
    others = {"match": (), "segment": (), "detect": (None,), "estimate": (None,)}[method]
    with pytest.raises(StageError) as error:
        getattr(stage, method)(_frame(), *others)
    assert said in str(error.value)


def test_a_fault_in_an_exceptions_own_text_is_survived() -> None:
    class Mute(Exception):  # noqa: N818
        def __str__(self) -> str:
            raise ZeroDivisionError

    with pytest.raises(StageError, match="mine, match: Mute"):
        _guarded(Told(Mute())).match(_frame())
