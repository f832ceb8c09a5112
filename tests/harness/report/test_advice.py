"""Every option that a table advises is taken by the experiment that it is printed for."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from harness.files.folders import names
from harness.report.advice import NEXT_STEPS, advice
from harness.run.experiment import PRESETS, Experiment, load_experiment
from harness.score.finished_run import how_to_label
from harness.score.verdicts import ERROR_TYPES
from tests.disk import write_text

_OPTION = re.compile(r"--set ([^\s)]+)")
MEASURED = ("people", "conversation")
"""Experiments on clips of measurements."""


def _methods(folder: Path) -> list[Path]:
    """An experiment with each method, each with a setting of its own."""
    own = {
        "cones": ("cones", "cones_deg = [30]"),
        "nearest": ("nearest", "limit_deg = 20"),
        "bayes": ("bayes", 'smoothing = "both"'),
        "logit": ("logit", 'smoothing = "both"'),
        "gaze": ("cones", 'weighting = "gaze"'),
    }
    return [
        write_text(
            folder / f"{name}.toml",
            'clips = ["studio_table"]\ndefaults.stereo.matcher = "bm"\ndefaults.segmentation.model = "truth"\n'
            'defaults.heads.detector = "person_mask"\ndefaults.head_pose.model = "none"\n'
            'defaults.gaze.model = "truth"\n'
            f'[[configuration]]\nname = "own"\nattention = {{ method = "{method}", {setting} }}\n',
        )
        for name, (method, setting) in own.items()
    ]


def _maps(folder: Path) -> Path:
    """An experiment with masks of another program."""
    segmenter, heads = 'segmentation = { model = "id_maps", root = "masks" }', 'heads.detector = "yunet"'
    return _without_head_pose(folder / "maps.toml", segmenter, heads, 'gaze.model = "truth"')


def _blind(folder: Path) -> Path:
    """An experiment without a model of gaze or head pose."""
    segmenter, heads = 'segmentation.model = "truth"', 'heads.detector = "person_mask"'
    return _without_head_pose(folder / "blind.toml", segmenter, heads, 'gaze.model = "none"')


def _without_head_pose(path: Path, *stages: str) -> Path:
    """An experiment of one configuration with these stages beside BM."""
    defaults = "\n".join(('stereo.matcher = "bm"', 'head_pose.model = "none"', *stages))
    return write_text(path, f'clips = ["studio_table"]\n[defaults]\n{defaults}\n[[configuration]]\nname = "own"\n')


@pytest.fixture(autouse=True)
def _no_data(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("VFOA_DATA", "VFOA_MODELS"):
        monkeypatch.setenv(name, str(tmp_path))


def _load(name: str, *, preset: str | None = None, overrides: tuple[str, ...] = ()) -> Experiment:
    """An experiment on another clip: nothing of its own is needed here."""
    return load_experiment(name, clips=("studio_table",), preset=preset, overrides=overrides)


def _experiments(folder: Path) -> list[tuple[str, str | None]]:
    """Each experiment by name, and a preset."""
    presets = [("default", preset) for preset in PRESETS]
    return [
        *((name, None) for name in names("experiments")),
        *presets,
        *((str(path), None) for path in (*_methods(folder), _maps(folder), _blind(folder))),
    ]


def _plain(experiment: Experiment, name: str) -> list[dict[str, object]]:
    measured = name in MEASURED
    return [(each.without_images() if measured else each).plain() for each in experiment.configurations]


def test_every_error_type_has_advice_for_every_experiment(tmp_path: Path) -> None:
    assert list(NEXT_STEPS) == list(ERROR_TYPES)
    for name, preset in _experiments(tmp_path):
        configurations = _plain(_load(name, preset=preset), name)
        for error_type in ERROR_TYPES:
            assert advice(error_type, configurations), (name, error_type)
            assert advice(error_type, []), error_type


def test_every_option_that_is_advised_is_taken(tmp_path: Path) -> None:
    advised = set()
    for name, preset in _experiments(tmp_path):
        configurations = _plain(_load(name, preset=preset), name)
        for error_type in ERROR_TYPES:
            for option in _OPTION.findall(" ".join(advice(error_type, configurations))):
                advised.add(option)
                changed = _load(name, preset=preset, overrides=(option,))
                assert _plain(changed, name) != configurations, (name, error_type, option)
    assert len(advised) >= 7
    assert "segmentation.people=rf_detr_seg" in advised


def test_a_run_without_recordings_is_not_viewed() -> None:
    recorded, not_recorded = (advice("outscored", [], recorded=each) for each in (True, False))
    assert recorded[0] == "see what won instead (vfoa view RUN --failures)"
    assert not_recorded[0] == "see what won instead (in a run with --recording light)"
    for error_type in ERROR_TYPES:
        assert "vfoa view" not in " ".join(advice(error_type, [], recorded=False)), error_type


def test_without_models_of_gaze_and_head_pose_one_is_advised(tmp_path: Path) -> None:
    blind = _blind(tmp_path)
    first, faces, *_ = advice("no_direction", _plain(_load(str(blind)), "blind"))
    assert "(--set gaze.model=auto)" in first
    assert "(--set heads.detector=yunet)" in faces
    with_gaze = advice("no_direction", _plain(_load(str(blind), overrides=("gaze.model=truth",)), "blind"))
    assert faces == with_gaze[0]


@pytest.mark.parametrize("name", MEASURED)
def test_nothing_of_images_is_advised_for_measurements(name: str) -> None:
    configurations = _plain(_load(name), name)
    for error_type in ERROR_TYPES:
        said = " ".join(advice(error_type, configurations))
        assert not re.search(r"stereo|heads\.|segmentation|vfoa annotate|drawn", said), (error_type, said)
    assert "vfoa annotate" not in how_to_label("clip", configurations)
    assert "vfoa annotate clip" in how_to_label("clip", _plain(_load("demo"), "demo"))


@pytest.mark.parametrize("method", ["bayes", "logit"])
def test_a_method_that_knows_of_nowhere_is_not_told_of_one_that_does(method: str, tmp_path: Path) -> None:
    (path,) = (path for path in _methods(tmp_path) if path.stem == method)
    configurations = _plain(_load(str(path)), method)
    advised = advice("false_attention", configurations) + advice("no_hit", configurations)
    assert [step for step in advised if "posterior" in step] == []


@pytest.mark.parametrize(
    ("cones", "wider", "narrower"),
    [
        ("cones_cm=[10]", ["attention.cones_cm=[40]"], ["attention.cones_cm=[5]"]),
        ("cones_cm=[10, 25]", ["attention.cones_cm=[40]"], ["attention.cones_cm=[20]"]),
        ("cones_deg=[15, 40]", ["attention.cones_deg=[80]"], ["attention.cones_deg=[20]"]),
        ("cones_deg=[90]", [], ["attention.cones_deg=[20]"]),
    ],
)
def test_cones_are_advised_that_differ_from_those_used_in_the_named_direction(
    cones: str, wider: list[str], narrower: list[str]
) -> None:
    configurations = _plain(_load("default", overrides=("attention.method=cones", f"attention.{cones}")), "default")
    for error_type, expected in (("no_hit", wider), ("missed", wider), ("false_attention", narrower)):
        options = _OPTION.findall(" ".join(advice(error_type, configurations)))
        assert [option for option in options if ".cones_" in option] == expected, error_type


def test_where_everything_is_drawn_no_model_is_to_find_the_target() -> None:
    drawn = _plain(_load("default", overrides=("segmentation.model=drawn", "drawn.targets=false")), "default")
    steps = advice("target_not_segmented", drawn)
    assert steps[0].endswith("(vfoa annotate CLIP, key p)")
    assert "category" not in " ".join(steps)
    assert advice("target_not_segmented", _plain(_load("default"), "default"))[1] == steps[0]


def test_answers_of_another_system_are_not_explained_by_gaze_cones_or_methods() -> None:
    answers, cones = ({"attention": {"method": method}} for method in ("answers", "cones"))
    for error_type in ("false_attention", "no_hit", "missed", "outscored"):
        assert advice(error_type, [answers]) == ["see what the other system answered (vfoa view RUN --failures)"]
        assert advice(error_type, [answers, cones]) == advice(error_type, [cones])
