"""Scenes outlive a run: another run that sees the same reads no image, and gives what it gives without a cache."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.clips.add import add_clip
from harness.clips.manifest import load_manifest
from harness.labels.drawn_shapes import KeyFrame, drawn_of, write_drawn
from harness.pipeline import perception
from harness.pipeline.cache_store import Store
from harness.report.sinks import composed_sinks
from harness.report.write import rescore
from harness.run import loop, scenes
from harness.run.directory import RunDirectory
from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.run.timings import read_timings
from harness.sources.sintel import SintelClip
from harness.studio import StudioClip
from tests import graphs
from tests.alley import write_experiment
from tests.disk import picture, write_image, write_text
from tests.drawn_clip import CLIP, DRAWN
from tests.experiments import BLOCKS, experiment_of
from tests.measured import measured_tables
from tests.records import tables_of
from tests.repository import copy_clip
from vfoa.errors import VfoaError

FRAMES = 3
ALLEY = """\
defaults.stereo = { matcher = "bm", min_depth_m = 1.0 }
[[configuration]]
name = "cones"
[[configuration]]
name = "filtered"
gaze_filter.cues = "both"
"""


@pytest.fixture(scope="module")
def alley(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An experiment on a small clip of files."""
    return write_experiment(tmp_path_factory.mktemp("alley"), range(1, FRAMES + 1), ALLEY)


class Reads(list[int]):
    """Numbers of frames, and whether a run is being planned."""

    planning = False


READ = Reads()


def _run(
    experiment: Path | str, out: Path, store: Store | None, *overrides: str, recorded: bool = False, limit: int = FRAMES
) -> RunDirectory:
    loaded = load_experiment(str(experiment), overrides=overrides)
    READ.planning = True
    plan = prepare(loaded, limit=limit, sinks=composed_sinks(loaded.configurations, recorded=recorded))
    READ.planning = False
    return run_plan(plan, out, workers=1, progress=lambda clip: None, cache=store)


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "cache", 10**9)


@pytest.fixture
def read(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The frames of clips of files that runs read, by number. Planning is not counted: it looks for near objects."""
    frame = SintelClip.frame
    monkeypatch.setattr(
        SintelClip, "frame", lambda self, number: (READ.planning or READ.append(number), frame(self, number))[1]
    )
    READ.clear()
    return READ


def _files(directory: RunDirectory) -> dict[str, bytes]:
    """Thumbnails, which are files beside the tables."""
    return {path.name: path.read_bytes() for path in directory.path.rglob("thumbnails/**/*") if path.is_file()}


def _stages(directory: RunDirectory) -> set[str]:
    return {*read_timings(directory).column("stage").to_pylist()}


OTHER = ("attention.cones_cm=[10.0,25.0]", "attention.n_rays=64")


def test_another_method_reads_no_frame(alley: Path, tmp_path: Path, store: Store, read: list[int]) -> None:
    _run(alley, tmp_path / "first", store)
    assert read == [1, 2, 3]
    second = _run(alley, tmp_path / "second", store, *OTHER)
    assert read == [1, 2, 3]
    plain = _run(alley, tmp_path / "plain", None, *OTHER)
    assert tables_of(second) == tables_of(plain)
    assert _files(second) == _files(plain)
    assert {"1.webp", "2.webp", "3.webp", "alley__filtered.jsonl"} <= _files(second).keys()
    assert _stages(second) == _stages(plain)
    assert [(row["slot"], row["stage"], row["reused"], row["computed"]) for row in second.read_manifest().cache] == [
        ("scene", "tables", FRAMES, 0)
    ]
    rescore(second)
    assert read == [1, 2, 3] * 2


def test_a_run_is_whole_without_the_cache(alley: Path, tmp_path: Path, store: Store) -> None:
    _run(alley, tmp_path / "first", store)
    second = _run(alley, tmp_path / "second", store, *OTHER)
    assert {
        usage.slot: (usage.name, usage.files) for usage in store.usage() if usage.slot not in ("stereo", "gaze")
    } == {
        "heads": ("person_mask", FRAMES),
        "scene": ("tables", 1),
        "directions": ("tables", 1),
        "pictures": ("files", 1),
    }
    before = tables_of(second), _files(second)
    store.clear()
    assert store.usage() == []
    assert (tables_of(second), _files(second)) == before
    assert not any(path.is_symlink() or path.stat().st_nlink > 1 for path in second.path.rglob("*.parquet"))


@pytest.mark.parametrize("slot", ["scene", "directions", "pictures"])
@pytest.mark.parametrize("spoil", [lambda data: data[:-9], lambda data: data[:200] + b"\x07\x07\x07" + data[203:]])
def test_a_damaged_copy_is_named_and_the_clip_perceived_again(
    slot: str,
    spoil: Callable[[bytes], bytes],
    alley: Path,
    tmp_path: Path,
    store: Store,
    read: list[int],
    caplog: pytest.LogCaptureFixture,
) -> None:
    first = _run(alley, tmp_path / "first", store)
    (copy,) = store.stages.glob(f"{slot}/*/*.bin")
    copy.write_bytes(spoil(copy.read_bytes()))
    second = _run(alley, tmp_path / "second", store)
    assert f"{copy}: damaged" in caplog.text
    assert read == [1, 2, 3] * 2
    assert (tables_of(second), _files(second)) == (tables_of(first), _files(first))
    assert not list(second.path.rglob("*.tables"))
    _run(alley, tmp_path / "third", store)
    assert read == [1, 2, 3] * 2


def test_beyond_the_limit_scenes_are_removed_and_perceived_again(alley: Path, tmp_path: Path, read: list[int]) -> None:
    for name in ("first", "second"):
        _run(alley, tmp_path / name, Store(tmp_path / "cache", 1))
    assert read == [1, 2, 3] * 2
    assert not list((tmp_path / "cache").rglob("*.bin"))


def test_recordings_need_the_images(alley: Path, tmp_path: Path, store: Store, read: list[int]) -> None:
    _run(alley, tmp_path / "first", store)
    second = _run(alley, tmp_path / "second", store, recorded=True)
    assert read == [1, 2, 3] * 2
    assert {"alley.rrd", "alley__cones.rrd", "alley__filtered.rrd"} <= {path.name for path in second.path.glob("*.rrd")}
    assert tables_of(second) == tables_of(_run(alley, tmp_path / "third", store))
    assert read == [1, 2, 3] * 2


def test_a_changed_clip_or_its_truth_is_perceived_again(
    alley: Path, tmp_path: Path, store: Store, read: list[int]
) -> None:
    shutil.copytree(alley.parent, tmp_path / "mine")
    for path in (tmp_path / "mine").rglob("*.toml"):
        path.write_text(path.read_text().replace(alley.parent.as_posix(), (tmp_path / "mine").as_posix()))
    experiment = tmp_path / "mine" / "alley.toml"
    _run(experiment, tmp_path / "first", store)
    training = next((tmp_path / "mine").rglob("training"))
    for number, changed in enumerate(("clean_left/alley/frame_0002.png", "disparities/alley/frame_0001.png")):
        write_image(training / changed, picture(50 + number))
        _run(experiment, tmp_path / f"changed{number}", store)
        assert read == [1, 2, 3] * (2 + number)
    _run(experiment, tmp_path / "part", store, limit=2)
    assert read == [*[1, 2, 3] * 3, 1, 2]


@pytest.mark.parametrize(
    ("override", "scenes_too"),
    [
        ("gaze.stride=2", False),
        ("tracking.sigma_iou=0.4", True),
        ("reconstruction.boxes=oriented", True),
        ("stereo.block_size_px=9", True),
        ("attention.method=bayes", True),  # it asks for clouds
        ("gaze_filter.cues=both", None),
    ],
)
def test_what_decides_scenes_or_directions_is_perceived_again(
    override: str, scenes_too: bool | None, alley: Path, tmp_path: Path, store: Store, read: list[int]
) -> None:
    runs = [_run(alley, tmp_path / "first", store), _run(alley, tmp_path / "second", store, override)]
    assert read == ([1, 2, 3] if scenes_too is None else [1, 2, 3] * 2)
    keys = [
        [{path.parts[-3] for path in run.path.glob(f"{place}/*/*/*")} for run in runs]
        for place in ("scenes", "directions")
    ]
    assert [one == other for one, other in keys] == [not scenes_too, scenes_too is None]


@pytest.fixture
def maps(tmp_path: Path) -> tuple[str, ...]:
    """Settings that take maps of ids for masks."""
    write_text(tmp_path / "ids.csv", "id,category\n1,cup\n")
    height, width = picture(1).shape[:2]
    for number in range(1, FRAMES + 1):
        write_image(tmp_path / f"{number:05d}.png", np.zeros((height, width), np.uint8))
    return ("segmentation.model=id_maps", f"segmentation.root={tmp_path}")


def test_missing_weights_beside_maps_are_named_with_the_command_that_fetches_them(
    alley: Path, maps: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VFOA_MODELS", str(tmp_path / "none"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "none"))
    with pytest.raises(VfoaError, match=r"expected: vfoa models fetch rf-detr-seg-medium$"):
        _run(alley, tmp_path / "run", None, *maps, "segmentation.people=rf_detr_seg")


def test_other_weights_beside_maps_are_perceived_again(
    alley: Path, maps: tuple[str, ...], tmp_path: Path, store: Store, read: list[int]
) -> None:
    """The network that finds people beside maps of ids has another content under the same name."""
    words = (*maps, "segmentation.people=yolo_seg", f"segmentation.weights={tmp_path / 'people.onnx'}")
    for runs, content in enumerate((0.0, 0.0, 1.0)):
        graphs.yolo_seg(tmp_path / "people.onnx", np.full((1, 116, 9), content))
        _run(alley, tmp_path / f"run{runs}", store, *words)
    assert read == [1, 2, 3] * 2


def _perceives_nothing(*_: object, **__: object) -> Any:
    raise AssertionError("the clip is perceived again")


def test_only_what_is_new_is_perceived(
    alley: Path, tmp_path: Path, store: Store, read: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    _run(alley, tmp_path / "first", store)
    more = write_text(
        tmp_path / "more.toml", f'{alley.read_text()}[[configuration]]\nname = "wider"\ngaze.stride = 2\n'
    )
    perceived: list[list[str]] = []
    build = perception.Perception.__init__

    def noted(self: perception.Perception, configurations: Any, *rest: Any, **options: Any) -> None:
        perceived.append([each.name for each in configurations])
        build(self, configurations, *rest, **options)

    with monkeypatch.context() as patch:
        patch.setattr(perception.Perception, "__init__", noted)
        second = _run(more, tmp_path / "second", store)
    assert perceived == [["wider"]]
    plain = _run(more, tmp_path / "plain", None)
    assert (tables_of(second), _files(second)) == (tables_of(plain), _files(plain))
    assert _stages(second) == _stages(plain)


def test_directions_are_used_with_their_own_scene_alone(
    alley: Path, tmp_path: Path, store: Store, read: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stage answers differently the second time, and the third run has its scene and the directions of the first."""
    _run(alley, tmp_path / "first", store)
    rows = scenes._scene_rows

    def other(*arguments: Any) -> Any:
        found = rows(*arguments)
        return {**found, "objects": [], "people": [(*row[:5], 0.123, *row[6:]) for row in found["people"]]}

    with monkeypatch.context() as patch:
        patch.setattr(scenes, "_scene_rows", other)
        second = _run(alley, tmp_path / "second", store, "gaze.stride=2")
    assert read == [1, 2, 3] * 2
    assert tables_of(_run(alley, tmp_path / "third", store, "gaze.stride=2")) == tables_of(second)
    assert read == [1, 2, 3] * 2
    _run(alley, tmp_path / "fourth", store)
    assert read == [1, 2, 3] * 3


STUDIO = experiment_of(
    ["studio_talk"],
    {
        "cones": {},
        "posterior": {"attention.method": "bayes"},
        "keys": {"segmentation.every": 2},
        "truth": {"stereo.matcher": "truth", "reconstruction.boxes": "oriented"},
    },
    BLOCKS,
    seeds=2,
)
POSES = experiment_of(["talk"], {"cones": {}, "posterior": {"attention.method": "bayes"}}, preset="measured")


def _draw(frame: int) -> None:
    """Draw a head and an object on the clip of the studio, at this frame."""
    manifest = load_manifest(CLIP)
    boxes = {
        ("anna", "head"): (300.0, 100.0, 360.0, 180.0),
        (next(iter(manifest.targets)), "box"): (100.0, 200.0, 160.0, 260.0),
    }
    keys = {name: [KeyFrame(frame=frame, place=place)] for name, place in boxes.items()}
    write_drawn(manifest.annotations.place_drawn(), drawn_of(keys))


@pytest.mark.parametrize("text", [STUDIO, DRAWN, POSES])
def test_every_kind_of_scene_is_found_again(
    text: str, tmp_path: Path, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    if text == POSES:
        measured_tables(tmp_path / "data" / "talk")
        add_clip(tmp_path / "data" / "talk")
    if text == DRAWN:
        copy_clip(CLIP, tmp_path)
        _draw(1)
    experiment = write_text(tmp_path / "kinds.toml", text)
    first = _run(experiment, tmp_path / "first", store)
    with monkeypatch.context() as patch:
        patch.setattr(loop, "_perception", _perceives_nothing)
        patch.setattr(StudioClip, "frame", _perceives_nothing)
        second = _run(experiment, tmp_path / "second", store, "gaze_filter.cues=both")
    assert tables_of(second) == tables_of(_run(experiment, tmp_path / "plain", None, "gaze_filter.cues=both"))
    assert text == DRAWN or tables_of(second) != tables_of(first)
    assert {path.relative_to(first.path) for path in first.path.glob("scenes/*/*/*")} == {
        path.relative_to(second.path) for path in second.path.glob("scenes/*/*/*")
    }
    if text == DRAWN:
        _draw(2)
        monkeypatch.setattr(loop, "_perception", _perceives_nothing)
        with pytest.raises(AssertionError, match="perceived again"):
            _run(experiment, tmp_path / "third", store)


def test_of_a_clip_without_images_no_pictures_are_missed(
    tmp_path: Path, store: Store, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """The first configuration's scene is copied, so that only the second one is perceived."""
    monkeypatch.chdir(tmp_path)
    measured_tables(tmp_path / "data" / "talk")
    add_clip(tmp_path / "data" / "talk")
    _run(write_text(tmp_path / "kinds.toml", POSES), tmp_path / "first", store)
    shutil.rmtree(store.stages / "pictures")  # as trimming does
    both = f'{POSES}[[configuration]]\nname = "heads"\ngaze.model = "none"\n'
    second = _run(write_text(tmp_path / "kinds.toml", both), tmp_path / "second", store)
    assert caplog.messages == []
    assert (store.stages / "directions").is_dir()
    assert not second.read_manifest().failed
