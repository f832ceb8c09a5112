"""The benchmark's baselines do the same as what they are compared with, and its rows are of what they say."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

from harness.bench import SECTIONS, Bench
from harness.bench.attention import scenes_of, seeded_scenes, time_methods
from harness.bench.gpu import measure_gpu
from harness.bench.realtime import ROWS, configuration_of, measure_speed, rows_at_hand
from harness.bench.stages import measure_stages
from harness.cli import main
from harness.clips.add import add_clip
from harness.clips.manifest import load_manifest
from harness.report.formats import Table
from harness.run.experiment import load_experiment
from tests import graphs
from tests.command import vfoa
from tests.disk import write_text
from tests.measured import EXPERIMENT, measured_tables
from vfoa.bayes import BayesSettings

CLIP = "studio_table"
FRAMES = (1, 2, 3)


def test_speed_is_measured_of_every_row_on_the_same_frames() -> None:
    rows, _ = rows_at_hand("demo", CLIP)
    speeds = {each.what: each for each in measure_speed("demo", load_manifest(CLIP), FRAMES, 2, rows=rows, rounds=1)}
    assert list(speeds) == [row.what for row in rows]
    for speed in speeds.values():
        assert speed.match_ms[1] >= speed.match_ms[0] > 0
        assert speed.fps > 0
        assert speed.stereo is not None
        assert speed.stereo.frames == len(FRAMES)


def test_stages_are_timed_for_a_method_that_uses_clouds() -> None:
    configuration = load_experiment("demo", clips=(CLIP,)).configurations[0]
    attend = configuration.attend.model_copy(update={"attention": BayesSettings(method="bayes")})
    assert attend.attention.cloud_points
    (costs,) = measure_stages(load_manifest(CLIP), [replace(configuration, attend=attend)], FRAMES, None)
    assert costs.frames == len(FRAMES)
    assert min(costs.stages_ms["attention"]) > 0
    assert costs.recording_bytes


def test_what_configurations_share_makes_none_of_them_slower(monkeypatch: pytest.MonkeyPatch) -> None:
    """A run times measures and recordings at the first configuration: the others would seem faster."""
    first, second, *_ = load_experiment("demo", clips=(CLIP,)).configurations
    ms = {(first.name, "stereo"): 10.0, (first.name, "measures"): 2.0, (first.name, "recording"): 20.0}
    ms[second.name, "stereo"] = 10.0
    times = [
        {"clip": CLIP, "configuration": name, "frame": frame, "stage": stage, "ms": value}
        for (name, stage), value in ms.items()
        for frame in FRAMES
    ]
    monkeypatch.setattr("harness.bench.stages.read_timings", lambda directory: pa.Table.from_pylist(times))
    costs = measure_stages(load_manifest(CLIP), [first, second], FRAMES, None)
    assert [each.frame_ms for each in costs] == [(10.0, 10.0)] * 2
    assert costs[0].stages_ms["recording"] == (20.0, 20.0)


def test_rows_whose_models_are_not_here_are_left_out_with_a_note(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vfoa.weights.directories", lambda: [tmp_path])
    rows, (note,) = rows_at_hand("demo", CLIP)
    assert rows == [row for row in ROWS if not row.has_models]
    assert "yunet_n_dynamic.onnx" in note


def test_the_note_names_the_models_that_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("harness.bench.realtime.check_located", lambda names: None)
    rows, (note,) = rows_at_hand("demo", CLIP)
    choices = configuration_of("demo", CLIP, rows[-1], ()).choices
    assert rows == [*ROWS]
    for slot in ("heads", "head_pose", "gaze"):
        assert (choice := choices[slot]) is not None
        assert f"{slot} {choice.name}" in note


def test_every_network_of_a_configuration_runs_on_the_provider() -> None:
    for configuration in load_experiment("default", clips=(CLIP,)).configurations:
        plain = configuration.on("cuda").plain()
        assert {plain[slot]["provider"] for slot in ("segmentation", "heads", "head_pose", "gaze")} == {"cuda"}
        assert "provider" not in plain["stereo"]


def test_a_provider_that_is_not_there_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("onnxruntime.get_available_providers", lambda: ["CPUExecutionProvider"])
    monkeypatch.setattr("sys.argv", ["vfoa", "bench", "--provider", "cuda"])
    with pytest.raises(SystemExit) as exit_:
        main()
    assert exit_.value.code
    assert "onnxruntime-gpu" in capsys.readouterr().err


def test_networks_are_timed_on_the_cpu_and_say_that_there_is_no_cuda(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("onnxruntime.get_available_providers", lambda: ["CPUExecutionProvider"])
    monkeypatch.setattr("vfoa.weights.directories", lambda: [tmp_path])
    weights = Path(graphs.yolo_seg(tmp_path / "yolo.onnx", np.zeros((1, 116, 1)))).as_posix()
    changes = ("segmentation.model=yolo_seg", f'segmentation.weights="{weights}"')
    experiment = load_experiment("demo", clips=(CLIP,), overrides=changes)
    found = {each.slot + each.name: each.ms for each in measure_gpu(load_manifest(CLIP), experiment, FRAMES)}
    assert found["stereohitnet"] == {"cpu": "no weights", "cuda": "not available"}
    assert found["segmentationyolo_seg"]["cuda"] == "not available"
    assert found["stereobm"]["cuda"] == "CPU only"
    for measured in (found["segmentationyolo_seg"]["cpu"], found["stereobm"]["cpu"]):
        assert isinstance(measured, float)
        assert measured > 0


def test_every_method_is_timed_on_all_material() -> None:
    experiment = load_experiment("demo", clips=(CLIP,))
    scenes = scenes_of(load_manifest(CLIP), experiment.configurations[0], FRAMES)
    assert [scene.index for scene, _ in scenes] == list(FRAMES)
    found = time_methods({"seeded": seeded_scenes(boxes=6, subjects=2, frames=3), CLIP: scenes}, rounds=1)
    assert {name.split(",")[0] for name in found} == {"cones", "nearest", "logit", "bayes"}
    assert all(list(row) == ["seeded", CLIP] and min(row.values()) > 0 for row in found.values())


def test_people_of_seeded_scenes_move_among_things_at_rest() -> None:
    scenes = [scene for scene, _ in seeded_scenes(boxes=6, subjects=4, frames=5)]
    assert [(len(scene.targets), len(scene.people)) for scene in scenes] == [(6, 4)] * 5
    assert all(scene.targets is scenes[0].targets for scene in scenes)
    eyes = {tuple(person.eye_origin_left.tolist()) for scene in scenes for person in scene.people}
    assert len(eyes) == 20


def test_a_clip_of_measurements_is_timed_without_the_sections_of_images(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    add_clip(measured_tables(tmp_path / "talk"), name="talk")
    write_text(tmp_path / "talk.toml", EXPERIMENT)
    monkeypatch.setattr("harness.bench.SECTIONS", {name: _titled(name) for name in SECTIONS})
    assert vfoa(monkeypatch, capsys, "bench", "talk.toml", "--out", "b.md")[0] == 0
    heads = [line for line in Path("b.md").read_text().splitlines() if line.startswith("## ")]
    assert heads == ["## stages", "## attention"]
    code, _, said = vfoa(monkeypatch, capsys, "bench", "talk.toml", "--only", "gpu")
    assert (code, said.count("\n")) == (2, 1)
    assert "gpu: talk holds measurements" in said


def test_the_first_experiment_of_a_working_directory_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its stages read files of the clip (``${CLIP}``), and the clip has no true disparity. The notes say units."""
    monkeypatch.chdir(tmp_path)
    assert vfoa(monkeypatch, capsys, "init", ".")[0] == 0
    words = ("--only", "stages", "--only", "stereo", "--limit", "2", "--out", "b.md")
    code, said, err = vfoa(monkeypatch, capsys, "bench", "experiments/first.toml", *words)
    assert (code, err) == (0, "")
    printed = " ".join(said.split())
    stages, stereo = Path("b.md").read_text(encoding="utf-8").split("## ")[1:]
    notes = [line[2:] for line in stages.splitlines() if line.startswith("- ")]
    assert notes
    assert all(note in printed for note in notes)
    title = stereo.splitlines()[0]
    assert "Nothing to show." in stereo
    assert title in printed


def test_a_clip_is_measured_as_vfoa_run_runs_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    measured: list[Bench] = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("harness.bench.SECTIONS", {"stereo": lambda bench: measured.append(bench) or []})
    assert vfoa(monkeypatch, capsys, "bench", "studio_table", "--only", "stereo")[0] == 0
    assert [(bench.name, bench.manifest.name) for bench in measured] == [("default", "studio_table")]


def test_missing_models_are_named_with_the_command_that_fetches_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VFOA_CACHE", str(tmp_path))
    monkeypatch.delenv("VFOA_MODELS", raising=False)
    code, _, said = vfoa(monkeypatch, capsys, "bench", "studio_table", "--only", "stages")
    assert (code, said.count("\n")) == (2, 1)
    assert "vfoa models fetch --for studio_table" in said


def _titled(name: str) -> Callable[[Bench], list[Table]]:
    return lambda bench: [Table(title=name, columns=("clip",), rows=((bench.manifest.name,),), words=1)]


def test_a_section_that_is_not_there_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.argv", ["vfoa", "bench", "--only", "realtim"])
    with pytest.raises(SystemExit):
        main()
    assert "did you mean 'realtime'" in capsys.readouterr().err
    assert "realtime" in SECTIONS
