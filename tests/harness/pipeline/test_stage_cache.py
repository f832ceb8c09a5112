from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest

from harness.files.digests import code_of
from harness.pipeline import cache, cache_store
from harness.pipeline.cache import difference, identify, parts_of_clip
from harness.pipeline.configuration import StageChoice
from harness.run.experiment import load_experiment
from tests.disk import write_text
from vfoa.errors import VfoaError

CLIP = {"clip": "name", "clip sha256": "sha", "clip code": "read", "versions": {"mcap": "1"}}


def _choice(slot: str, *overrides: str, experiment: str = "demo") -> StageChoice:
    choice = load_experiment(experiment, clips=("clip",), overrides=overrides).configurations[0].choices[slot]
    assert choice is not None
    return choice


def test_every_part_makes_another_identity_but_the_clips_name() -> None:
    base = identify(_choice("stereo"), CLIP)
    assert base is not None
    same = identify(_choice("stereo"), {**CLIP, "clip": "renamed"})
    changed = [
        identify(_choice("stereo"), {**CLIP, "clip sha256": "another"}),
        identify(_choice("stereo"), {**CLIP, "clip code": "another"}),
        identify(_choice("stereo"), {**CLIP, "versions": {"mcap": "2"}}),
        identify(_choice("stereo", "stereo.wls=true"), CLIP),
        identify(_choice("stereo", "stereo.min_depth_m=0.9"), CLIP),
        identify(_choice("heads", "heads.detector=person_mask"), CLIP),
    ]
    assert same is not None
    assert same.digest == base.digest
    assert len({base.digest, *(each.digest for each in changed if each)}) == 7


def test_results_of_another_format_are_not_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = identify(_choice("stereo"), CLIP)
    monkeypatch.setattr(cache_store, "__file__", str(write_text(tmp_path / "values.py", "# another order")))
    after = identify(_choice("stereo"), CLIP)
    assert before is not None
    assert after is not None
    assert before.digest != after.digest


def test_a_clip_is_known_by_its_content_and_by_all_code_that_reads_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    write_text(tmp_path / "cameras" / "__init__.py", "")
    write_text(
        tmp_path / "cameras" / "clip.py",
        "from cameras import rectify\nclass Clip:\n    def digest(self):\n        return 'sha'\n",
    )
    rectify = write_text(tmp_path / "cameras" / "rectify.py", "")
    clip = importlib.import_module("cameras.clip").Clip()
    before = parts_of_clip("table", clip)
    rectify.write_text("# a lens is undistorted otherwise")
    code_of.cache_clear()
    after = parts_of_clip("table", clip)
    assert before["clip sha256"] == after["clip sha256"] == "sha"
    assert before["clip code"] != after["clip code"]
    one, other = (identify(_choice("stereo"), each) for each in (before, after))
    assert one is not None
    assert other is not None
    assert one.digest != other.digest


def test_a_stage_that_reads_more_than_it_is_given_has_none() -> None:
    assert identify(_choice("segmentation"), CLIP) is None
    assert identify(_choice("gaze"), CLIP) is None


def test_weights_count_by_their_content(tmp_path: Path) -> None:
    weights = tmp_path / "net.onnx"
    weights.write_bytes(b"one")
    choice = _choice("gaze", "gaze.model=l2cs", f"gaze.weights={weights.as_posix()}", experiment="default")
    before = identify(choice, CLIP)
    weights.write_bytes(b"two")
    after = identify(choice, CLIP)
    assert before is not None
    assert after is not None
    assert before.digest != after.digest


def test_every_network_that_a_stage_runs_must_be_there(tmp_path: Path) -> None:
    """ADAS-0002 runs a head-pose network of its own."""
    weights = tmp_path / "net.onnx"
    weights.write_bytes(b"gaze")
    used = [f"gaze.{key}={weights.as_posix()}" for key in ("weights", "head_pose_weights")]
    identity = identify(_choice("gaze", *used, experiment="default"), CLIP)
    assert identity is not None
    assert identity.parts["weights"].keys() == {weights.as_posix()}
    with pytest.raises(VfoaError, match=r"absent\.onnx: no such model file"):
        identify(_choice("gaze", used[0], "gaze.head_pose_weights=absent.onnx", experiment="default"), CLIP)


def test_the_code_is_a_file_and_all_that_it_imports_of_its_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(tmp_path))
    write_text(tmp_path / "mine" / "__init__.py", "")
    write_text(tmp_path / "mine" / "stage.py", "def match():\n    from . import steps\n    import numpy\n")
    steps = write_text(tmp_path / "mine" / "steps.py", "import mine.deep.er\n")
    write_text(tmp_path / "mine" / "deep" / "__init__.py", "")
    deeper = write_text(tmp_path / "mine" / "deep" / "er.py", "import vfoa.types\n")
    other = write_text(tmp_path / "mine" / "other.py", "")

    def digest() -> str:
        code_of.cache_clear()
        return code_of("mine.stage")[0]

    seen = {digest()}
    other.write_text("# of no concern")
    assert digest() in seen
    for file in (steps, deeper):
        file.write_text(file.read_text() + "# changed")
        assert digest() not in seen
        seen.add(digest())
    assert {"numpy", "python", "machine"} <= code_of("mine.stage")[1].keys()
    assert "mine" not in sys.modules  # looking at code must not run it


def test_an_output_depends_on_the_code_of_its_stage(monkeypatch: pytest.MonkeyPatch) -> None:
    choice = _choice("stereo")
    before = identify(choice, CLIP)
    monkeypatch.setattr(cache, "code_of", lambda module: ("another", {}))
    after = identify(choice, CLIP)
    assert before is not None
    assert after is not None
    assert after.parts["code"] == "another"
    assert after.digest != before.digest


def test_why_there_is_nothing_is_how_the_nearest_differs() -> None:
    parts = {
        "stage": "bm",
        "clip": "table",
        "settings": {"wls": True, "block": 5},
        "code": "1",
        "versions": {"cv": "5"},
    }
    near = {**parts, "settings": {"wls": False, "block": 5}}
    far = {**parts, "code": "2", "versions": {"cv": "4"}}
    assert difference(parts, []) == "first time"
    assert difference(parts, [{**near, "stage": "sgbm"}]) == "first time"
    assert difference(parts, [{**near, "clip": "talk"}]) == "first time on this clip"
    assert difference(parts, [far, near]) == "settings.wls changed"
    assert difference(parts, [far]) == "code, versions.cv changed"
