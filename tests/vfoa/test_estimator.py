from __future__ import annotations

import ast
import math
import re
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

import vfoa
from tests.repository import REPOSITORY
from tests.true_stages import BOXES, EYES, FAR, NEAR, Seen, TrueGaze, renamed, true_percepts, true_stages
from vfoa.bayes import BayesSettings
from vfoa.estimate import Look
from vfoa.estimator import DEFAULTS
from vfoa.geometry import unit
from vfoa.logit import LogitSettings
from vfoa.pipeline import AttendSettings
from vfoa.reconstruction import ReconstructionSettings
from vfoa.segmentation.key_frames import KeyFrameSettings
from vfoa.types import Gaze, Head, HeadPose, Instances, NoAttention, Percepts, StereoFrame

PATCH = ReconstructionSettings(eyes="patch")
BLACK = np.zeros((240, 400, 3), np.uint8)
AT_HAND = {"segmentation.model": "yolo_seg", "segmentation.weights": "yolov8n-seg_int8.onnx"}
"""The default segmentation's weights are not among those that the tests may expect."""


@pytest.fixture(scope="module")
def percepts() -> Percepts:
    return true_percepts()


def test_two_images_and_a_rig_give_who_looks_at_what_by_name(percepts: Percepts) -> None:
    estimator = vfoa.Estimator(true_stages(percepts, NEAR), reconstruction=PATCH)
    estimate = estimator.estimate(BLACK, BLACK, percepts.rig)
    (look,) = estimate.looks
    assert (look.subject, look.target, look.missing) == ("person 1", estimate.target_names[NEAR], None)
    assert look.attention == max(look.values.values()) > 0
    np.testing.assert_allclose(look.distance_m, np.linalg.norm(np.array([0.5, 0.2, 1.8]) - EYES), atol=0.05)
    assert str(estimate).startswith(f"person 1 looks at {look.target} (attention ")


def test_the_name_of_a_target_does_not_depend_on_which_others_are_in_the_frame(percepts: Percepts) -> None:
    """It is the one that a run gives: ``label#id``."""
    alone = replace(
        percepts,
        instances=Instances(
            ids=np.where(percepts.instances.ids == NEAR, 0, percepts.instances.ids),
            instances=tuple(each for each in percepts.instances.instances if each.id != NEAR),
        ),
    )
    estimates = (
        vfoa.Estimator(true_stages(given, FAR), reconstruction=PATCH).estimate(BLACK, BLACK, percepts.rig)
        for given in (percepts, alone)
    )
    both, one = (estimate.target_names for estimate in estimates)
    label = percepts.instances.instances[-1].label
    assert both == {1: "person#1", NEAR: f"{label}#{NEAR}", FAR: f"{label}#{FAR}"}
    assert one == {1: "person#1", FAR: f"{label}#{FAR}"}


@pytest.mark.parametrize("missing", NoAttention)
def test_a_look_without_an_answer_says_why(missing: NoAttention) -> None:
    """Also of methods of other distributions, which may give any reason."""
    look = Look(
        track_id=1, subject="anna", target=None, attention=math.nan, distance_m=math.nan, values={}, missing=missing
    )
    assert str(look).startswith("anna: unknown (")


def test_a_follower_carries_the_memory_over_frames(percepts: Percepts) -> None:
    estimator = vfoa.Estimator(true_stages(percepts, NEAR), reconstruction=PATCH)
    follower = estimator.follow(percepts.rig)
    followed = [follower.step(BLACK, BLACK, time_ns=10**9 * i) for i in range(3)]
    found = [(each.result.scene.index, each.result.scene.time_ns) for each in followed]
    assert found == [(0, 0), (1, 10**9), (2, 2 * 10**9)]
    assert [look.track_id for each in followed for look in each.looks] == [1, 1, 1]


def test_a_frame_without_a_time_comes_a_25th_of_a_second_after_the_one_before(percepts: Percepts) -> None:
    follower = vfoa.Estimator(true_stages(percepts, NEAR), reconstruction=PATCH).follow(percepts.rig)
    times_ns: tuple[int | None, ...] = (None, None, 10**9, None)
    found = [follower.step(BLACK, BLACK, time_ns=time_ns).result.scene.time_ns for time_ns in times_ns]
    assert found == [0, 40_000_000, 1_000_000_000, 1_040_000_000]


def test_a_follower_segments_key_frames_and_each_sequence_has_its_own(percepts: Percepts) -> None:
    estimator = vfoa.Estimator(true_stages(percepts, NEAR), reconstruction=PATCH, key_frames=KeyFrameSettings(every=2))
    for _ in range(2):
        follower = estimator.follow(percepts.rig)
        found = [follower.step(BLACK, BLACK).percepts.instances.carried_from for _ in range(5)]
        assert found == [None, 0, None, 2, None]


def test_the_posterior_follows_with_and_without_times(percepts: Percepts) -> None:
    attention = AttendSettings(attention=BayesSettings(method="bayes"))
    estimator = vfoa.Estimator(true_stages(percepts, NEAR), reconstruction=PATCH, attend=attention)
    follower = estimator.follow(percepts.rig)
    (look,) = [follower.step(BLACK, BLACK) for _ in range(5)][-1].looks
    assert look.target == estimator.estimate(BLACK, BLACK, percepts.rig).target_names[NEAR]
    assert 0 < look.attention <= 1


class NumberedAnew(Seen):
    """A segmenter whose ids are other ones in each frame."""

    def segment(self, frame: StereoFrame) -> Instances:
        ids = [instance.id for instance in self.percepts.instances.instances]
        by = frame.index % len(ids)
        return renamed(self.percepts.instances, dict(zip(ids, ids[by:] + ids[:by], strict=True)))


@pytest.mark.parametrize("settings", [LogitSettings, BayesSettings], ids=["logit", "bayes"])
def test_what_is_remembered_of_objects_does_not_go_by_the_numbers_of_a_segmenter(
    settings: type[LogitSettings | BayesSettings], percepts: Percepts
) -> None:
    method = "logit" if settings is LogitSettings else "bayes"
    attend = AttendSettings(attention=settings.model_validate({"method": method}))
    stages = true_stages(percepts, NEAR)
    assert isinstance(stages.segmenter, Seen)
    found = []
    for segmenter in (stages.segmenter, NumberedAnew(**vars(stages.segmenter))):
        estimator = vfoa.Estimator(replace(stages, segmenter=segmenter), reconstruction=PATCH, attend=attend)
        follower = estimator.follow(percepts.rig)
        found.append([look.values for _ in range(5) for look in follower.step(BLACK, BLACK).looks])
    assert found[0] == found[1]
    assert len(found[0]) == 5


def test_a_method_that_needs_later_frames_is_refused(percepts: Percepts) -> None:
    both = AttendSettings(attention=BayesSettings(method="bayes", smoothing="both", look_ahead_s=1.5))
    with pytest.raises(vfoa.VfoaError, match=r"'bayes' needs 1\.5 s of later frames"):
        vfoa.Estimator(true_stages(percepts, NEAR), attend=both)


class TurningGaze(TrueGaze):
    """The gaze goes from the far target to the near one after two frames."""

    def estimate(self, frame: StereoFrame, head: Head, head_pose: HeadPose | None) -> Gaze:
        looked_at = FAR if frame.index < 2 else NEAR
        return Gaze(direction=unit(BOXES[looked_at].center_m - EYES))


@pytest.mark.parametrize("settings", [LogitSettings, BayesSettings], ids=["logit", "bayes"])
def test_a_method_with_a_memory_takes_the_time_between_frames(
    settings: type[LogitSettings | BayesSettings], percepts: Percepts
) -> None:
    stages = true_stages(percepts, NEAR)
    assert isinstance(stages.gaze, TrueGaze)
    turning = replace(stages, gaze=TurningGaze(**vars(stages.gaze)))

    def attention(step_ns: int | None) -> float:
        method = "logit" if settings is LogitSettings else "bayes"
        attend = AttendSettings(attention=settings.model_validate({"method": method}))
        follower = vfoa.Estimator(turning, reconstruction=PATCH, attend=attend).follow(percepts.rig)
        times_ns = [step_ns and i * step_ns for i in range(3)]
        looks = [look for time_ns in times_ns for look in follower.step(BLACK, BLACK, time_ns=time_ns).looks]
        return max(looks[-1].values.values())

    assert attention(None) == attention(40_000_000) != attention(500_000_000)


@pytest.mark.parametrize(
    "wrong",
    [
        pytest.param(0, id="the same again"),
        pytest.param(-40_000_000, id="back"),
        pytest.param(1, id="seconds"),
        pytest.param(40, id="milliseconds"),
        pytest.param(40_000, id="microseconds"),
        pytest.param(0.04, id="no whole number"),
    ],
)
def test_a_time_in_another_unit_or_order_is_refused_and_changes_nothing(wrong: float, percepts: Percepts) -> None:
    follower = vfoa.Estimator(true_stages(percepts, NEAR), reconstruction=PATCH).follow(percepts.rig)
    follower.step(BLACK, BLACK, time_ns=0)
    with pytest.raises(vfoa.VfoaError, match="time_ns: "):
        follower.step(BLACK, BLACK, time_ns=wrong)  # type: ignore[arg-type]
    scene = follower.step(BLACK, BLACK, time_ns=np.int64(40_000_000)).result.scene
    assert (scene.index, scene.time_ns) == (1, 40_000_000)


def test_without_a_direction_the_look_says_why(percepts: Percepts) -> None:
    estimator = vfoa.Estimator(true_stages(percepts, NEAR, cues=False), reconstruction=PATCH)
    (look,) = estimator.estimate(BLACK, BLACK, percepts.rig).looks
    assert (look.target, look.missing) == (None, NoAttention.NO_DIRECTION)
    assert math.isnan(look.attention)


@pytest.mark.parametrize("wrong", [BLACK[:-1], None])
def test_wrong_images_leave_the_memory_as_it_was(wrong: Any, percepts: Percepts) -> None:
    follower = vfoa.Estimator(true_stages(percepts, NEAR), reconstruction=PATCH).follow(percepts.rig)
    with pytest.raises(vfoa.VfoaError, match="frame 0"):
        follower.step(wrong, BLACK)
    assert follower.step(BLACK, BLACK).result.scene.index == 0


def test_a_rig_needs_an_image() -> None:
    with pytest.raises(vfoa.VfoaError, match="left: expected an image"):
        vfoa.rectified_rig(cast("Any", None), fx_px=1, cx_px=0, cy_px=0, baseline_m=1)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"stereo.matcher": "sgmb"}, "'sgbm'"),
        ({"sterio.matcher": "bm"}, "'stereo'"),
        ({"gaze.model": None}, "gaze.model: no 'None'"),
        ({"stereo.min_depth": 1}, "stereo.min_depth"),
        ({"gaze.model": "gaze360", "gaze.weights": "x.onnx"}, "gaze.model"),
        ({"attention.method": "bayes", "attention.smoothing": "both"}, "attention.method"),
        ({"stereo.region": "needed", "reconstruction.stuff": ["road"]}, "stereo.region"),
        ({"segmentation.model": "yolo_seg", "segmentation.weights": "none-such.onnx"}, "none-such.onnx"),
    ],
)
def test_wrong_settings_are_one_line_that_names_them(settings: dict[str, object], said: str) -> None:
    with pytest.raises(vfoa.VfoaError) as error:
        vfoa.Estimator.open(settings)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_the_defaults_are_those_of_the_command_line() -> None:
    experiment = tomllib.loads((REPOSITORY / "harness/experiments/default.toml").read_text(encoding="utf-8"))
    (configuration,) = experiment["configuration"]
    of_arrays = {key: value for key, value in configuration.items() if key not in ("name", "drawn")}
    tables = {**experiment["defaults"], **of_arrays}
    assert {f"{table}.{key}": value for table, of in tables.items() for key, value in of.items()} == DEFAULTS


def _script() -> str:
    """The first Python block of README.md."""
    found = re.search(r"^```python\n(.*?)^```", (REPOSITORY / "README.md").read_text(encoding="utf-8"), re.M | re.S)
    assert found
    return found[1]


def test_the_script_of_the_readme_has_ten_lines_at_most() -> None:
    assert len([line for line in _script().splitlines() if line.strip()]) <= 10


def test_the_script_of_the_readme_runs_on_a_real_pair(
    shared_data: Path,
    default_models: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture,
) -> None:
    from harness.clips.manifest import load_manifest

    monkeypatch.setenv("VFOA_DATA", str(shared_data))
    monkeypatch.setenv("VFOA_MODELS", str(default_models))
    monkeypatch.chdir(tmp_path)
    frame = load_manifest(REPOSITORY / "datasets/sintel_bandage_2.toml").open().frame(1)
    np.save("left.npy", frame.left)
    np.save("right.npy", frame.right)
    script = _script()
    assert "Estimator.open()" in script
    exec(script.replace("Estimator.open()", f"Estimator.open({AT_HAND!r})"), {})
    assert capsys.readouterr().out.startswith("person 1 looks at ")


def test_importing_vfoa_imports_nothing_heavy() -> None:
    code = "import sys, vfoa; print(vfoa.__version__, *sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    version, *modules = done.stdout.split()
    assert version == vfoa.__version__
    assert not {"numpy", "cv2", "pydantic", "onnxruntime", "scipy"} & set(modules)


def test_every_public_name_is_there_and_type_checkers_know_it() -> None:
    stub = ast.parse((REPOSITORY / "vfoa/__init__.pyi").read_text(encoding="utf-8"))
    aliases = {alias.asname for node in stub.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert {name for name in aliases if name} | {"__version__"} == set(vfoa.__all__)
    for name in vfoa.__all__:
        assert getattr(vfoa, name) is not None
