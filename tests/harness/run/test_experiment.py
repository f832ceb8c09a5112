from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from harness.pipeline.configuration import Configuration
from harness.run.experiment import load_experiment
from harness.run.grid import base_of
from harness.run.notes import WARNINGS, NoteKind
from harness.run.plan import describe, prepare
from vfoa.errors import VfoaError

HEAD = """
clips = ["one", "two"]
[defaults.stereo]
matcher = "sgbm"
min_depth_m = 0.8
[defaults.segmentation]
model = "truth"
[defaults.heads]
detector = "truth"
[defaults.head_pose]
model = "simulated"
error_deg = 5.0
[defaults.gaze]
model = "none"
"""


def _write(folder: Path, text: str) -> str:
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return str(path)


def _by_name(configurations: tuple[Configuration, ...]) -> dict[str, dict[str, object]]:
    return {one.name: one.plain() for one in configurations}


def test_a_grid_is_every_combination_named_by_its_values(tmp_path: Path) -> None:
    path = _write(
        tmp_path,
        HEAD + '[grid]\n"stereo.matcher" = ["bm", "sgbm"]\n"attention.cones_cm" = { one = [10], two = [10, 25] }\n',
    )
    experiment = load_experiment(path)
    found = _by_name(experiment.configurations)
    assert experiment.name == "mine"
    assert list(found) == ["bm-one", "bm-two", "sgbm-one", "sgbm-two"]
    assert found["bm-two"]["stereo"]["matcher"] == "bm"  # type: ignore[index]
    assert found["bm-two"]["attention"]["cones_cm"] == [10.0, 25.0]  # type: ignore[index]
    assert found["sgbm-one"]["stereo"]["min_depth_m"] == 0.8  # type: ignore[index]
    assert found["sgbm-one"]["gaze"] is None


def test_a_default_holds_for_the_stages_that_have_it(tmp_path: Path) -> None:
    path = _write(tmp_path, HEAD + '[grid]\n"stereo.matcher" = ["sgbm", "truth"]\n')
    found = _by_name(load_experiment(path).configurations)
    assert found["sgbm"]["stereo"]["min_depth_m"] == 0.8  # type: ignore[index]
    assert found["truth"]["stereo"] == {"matcher": "truth"}


def test_a_clip_that_is_given_twice_is_not_said_of_the_file(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"^clip 'demo_1' is given twice"):
        load_experiment(_write(tmp_path, HEAD), clips=("demo_1", "demo_1"))
    with pytest.raises(VfoaError, match=r"mine\.toml: clips: clip 'one' is given twice"):
        load_experiment(_write(tmp_path, HEAD.replace('"two"', '"one"')))


def test_a_limit_holds_for_the_clips_of_the_file_alone(tmp_path: Path) -> None:
    path = _write(tmp_path, "limit = 5\n" + HEAD)
    own, another = load_experiment(path), load_experiment(path, clips=("studio_table",))
    assert (own.limit, another.limit) == (5, None)
    assert [len(clip.frames) for clip in prepare(replace(another, limit=5)).clips] == [5]
    assert [len(clip.frames) for clip in prepare(replace(another, limit=5), limit=7).clips] == [7]
    with pytest.raises(VfoaError, match=r"limit: .*greater than or equal to 1"):
        load_experiment(_write(tmp_path, "limit = 0\n" + HEAD))


def test_an_experiment_may_name_whose_labels_are_scored(tmp_path: Path) -> None:
    assert load_experiment(_write(tmp_path, HEAD)).annotator is None
    assert load_experiment(_write(tmp_path, 'annotator = "anna"\n' + HEAD)).annotator == "anna"


def test_an_override_holds_in_every_configuration(tmp_path: Path) -> None:
    path = _write(tmp_path, HEAD + '[grid]\n"attention.n_rays" = [4, 40]\n')
    overrides = ("stereo.matcher=bm", "attention.cones_deg=[60]", "stereo.min_depth_m=0.5")
    found = _by_name(load_experiment(path, clips=("three",), overrides=overrides).configurations)
    assert [one["stereo"]["matcher"] for one in found.values()] == ["bm", "bm"]  # type: ignore[index]
    assert [one["attention"]["cones_deg"] for one in found.values()] == [[60.0], [60.0]]  # type: ignore[index]
    assert [one["attention"]["n_rays"] for one in found.values()] == [4, 40]  # type: ignore[index]


def test_a_default_of_a_stage_that_an_override_exchanges_is_no_error(tmp_path: Path) -> None:
    path = _write(tmp_path, HEAD.replace('model = "truth"', 'model = "coco_panoptic"\nroot = "masks"', 1))
    (found,) = load_experiment(path, overrides=("segmentation.model=truth",)).configurations
    assert found.plain()["segmentation"] == {"model": "truth", "every": 1}


def test_what_is_written_out_reads_back_as_itself(tmp_path: Path) -> None:
    first = load_experiment(_write(tmp_path, HEAD)).configurations[0]
    tables = {key: value if value else {"model": "none"} for key, value in first.plain().items()}
    rows = [
        f"{key}.{name} = {value!r}".replace("'", '"')
        for key, table in tables.items()
        for name, value in table.items()
        if value is not None
    ]
    text = 'clips = ["one"]\n[[configuration]]\nname = "default"\n' + "\n".join(rows)
    again = load_experiment(_write(tmp_path, text.replace("True", "true").replace("False", "false"))).configurations[0]
    assert again.plain() == first.plain()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD.replace('"sgbm"', '"sgmb"'), r"stereo\.matcher: no 'sgmb'.*'sgbm'"),
        (HEAD + "[defaults.atention]\nn_rays = 4\n", r"defaults\.atention: .*'attention'"),
        (HEAD + "[grid]\n'atention.n_rays' = [4]\n", r"atention\.n_rays: .*'attention'"),
        (HEAD + "[grid]\n'attention.n_ray' = [4]\n", "'attention.n_ray'; did you mean 'n_rays'"),
        (HEAD + "[grid]\n'attention.n_rays' = ['many']\n", r"attention.n_rays: .*'many'"),
        (HEAD + "[grid]\n'attention.n_rays' = [1000000000]\n", r"attention.n_rays: .*100000"),
        (HEAD + "[grid]\n'attention.cones_cm' = [[1e308]]\n", r"attention.cones_cm.*10000"),
        (HEAD + "[grid]\n'attention.n_rays' = 4\n", r"grid\.attention\.n_rays: expected a list"),
        (HEAD + "[grid]\nattention.n_rays = 4\n", r"grid\.attention\.n_rays: expected a list"),
        (HEAD + "[grid.attention]\nn_rays = [4]\none = { n_rays = 4 }\n", "attention: .*both, .*'n_rays' and 'one'"),
        (HEAD.replace("min_depth_m", "min_depth"), r"defaults\.stereo\.min_depth: .*did you mean 'min_depth_m'"),
        (
            HEAD.replace("matcher =", "matchr =") + "[grid]\n'stereo.matcher' = ['bm']\n",
            r"defaults\.stereo\.matchr: .*did you mean 'matcher'",
        ),
        (HEAD.replace('clips = ["one", "two"]', ""), r"clips: .*found none"),
        (HEAD.replace("clips", "clip"), r"'clip'.*'clips'"),
        (HEAD + "[[configuration]]\nstereo.matcher = 'bm'\n", r"number 1: expected a name"),
        (HEAD + 2 * "[[configuration]]\nname = 'a'\n", r"configuration 'a': expected another name beside 'a'"),
        (HEAD + "[[configuration]]\nname = '../a'\n", r"expected a name of letters"),
        (HEAD + "[[configuration]]\nname = 'a.seed2'\n", r"'a\.seed2': expected no name of a seed"),
        (HEAD + "[[configuration]]\nname = 'a'\n[[configuration]]\nname = 'a+gaze'\n", r"'a\+gaze': .* beside 'a'"),
        (HEAD + "[[configuration]]\nname = 'a'\n[[configuration]]\nname = 'a.scene'\n", r"'a\.scene': .* beside 'a'"),
        (HEAD + "[[configuration]]\nname = 'Ab'\n[[configuration]]\nname = 'aB'\n", r"'aB': .* beside 'Ab'"),
        (HEAD + "[[configuration]]\nname = 'a.Scene'\n[[configuration]]\nname = 'A'\n", r"'a\.Scene': .* beside 'A'"),
        (HEAD + "[grid]\n'attention.n_rays' = [4, 8, 4]\n", r"configuration '4': expected another name beside '4'"),
        ('clips = ["one"]\n[[configuration]]\nname = "a"\nstereo.p1 = 1\n', r"stereo\.matcher: missing; .*stereo\.p1"),
        ("clips = [", r"not TOML"),
        ('preset = "gone.toml"\n' + HEAD, r"mine\.toml: preset: .*gone\.toml: no such file"),
        (HEAD.replace("matcher", "matchr"), r"unknown key 'stereo\.matchr'; did you mean 'matcher'"),
        ('clips = ["one"]\n[[configuration]]\nname = "a"\nstereo.b = 1\n', r"unknown key 'stereo\.b'; exp.*matcher"),
        (HEAD + "[grid.attention]\na = { method = 'logit', weights = 'w.toml' }\n", r"attention\.weights: .*'w\.toml'"),
    ],
)  # fmt: skip
def test_a_mistake_is_one_line_with_file_and_key(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(VfoaError, match=message) as caught:
        load_experiment(_write(tmp_path, text))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("clip", ["demo_tolk", "gone.toml"])
def test_an_unknown_clip_is_told_with_the_file_that_names_it(tmp_path: Path, clip: str) -> None:
    text = HEAD.replace('"one", "two"', f'"{clip}"')
    with pytest.raises(VfoaError, match=rf"mine\.toml: clips: .*{clip}"):
        prepare(load_experiment(_write(tmp_path, text)))
    with pytest.raises(VfoaError, match=rf"^(no clip )?'?{clip}"):
        prepare(load_experiment(_write(tmp_path, HEAD), clips=(clip,)))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("clips", 'annotator = "bob"\nclips', r"mine\.toml: annotator: .*'bob'"),
        ('model = "truth"', 'model = "yolo_seg"\nweights = "a.onnx"', r"mine\.toml: segmentation\.weights: a\.onnx"),
        (
            "[defaults.gaze]",
            "[defaults.attention]\nmethod = 'answers'\nfile = 'a.csv'\n[defaults.gaze]",
            "attention.file",
        ),
    ],
)
def test_what_an_experiment_names_and_is_not_here_is_told_with_its_key(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    text = HEAD.replace('"one", "two"', '"demo_1"').replace(old, new, 1)
    with pytest.raises(VfoaError, match=message):
        describe(prepare(load_experiment(_write(tmp_path, text))))


def test_a_missing_annotator_of_the_command_line_is_not_told_as_the_files(tmp_path: Path) -> None:
    experiment = load_experiment(_write(tmp_path, HEAD), clips=("demo_1",))
    with pytest.raises(VfoaError, match=r"^demo_1: no annotations by 'bob'"):
        prepare(replace(experiment, annotator="bob", given=frozenset({"annotator"})))


def test_an_unknown_experiment_proposes_the_nearest() -> None:
    with pytest.raises(VfoaError, match=r"experiment: no 'demmo'.*'demo'\?"):
        load_experiment("demmo")


def test_the_method_of_attention_decides_which_settings_are_known():
    experiment = load_experiment("bayes")
    methods = {
        base_of(configuration.name): configuration.attend.attention.method
        for configuration in experiment.configurations
    }
    assert methods["best_cones"] == "cones"
    assert {methods[name] for name in ("bayes", "bayes_both", "bayes_told", "wrong_bayes")} == {"bayes"}
    assert {methods[name] for name in ("nearest", "wrong_nearest")} == {"nearest"}
    with pytest.raises(VfoaError, match=r"attention.*p_nowhere"):
        load_experiment("demo", overrides=("attention.p_nowhere=0.2",))


def test_a_preset_stands_between_the_defaults_and_what_a_configuration_says(tmp_path: Path) -> None:
    text = (
        'preset = "realtime"\n' + HEAD + '[[configuration]]\nname = "quick"\n'
        '[[configuration]]\nname = "own"\nstereo.resolution = "full"\n'
        '[[configuration]]\nname = "slow"\npreset = "none"\n'
        '[[configuration]]\nname = "true"\nstereo.matcher = "truth"\n'
    )
    stereo = {
        name: one["stereo"] for name, one in _by_name(load_experiment(_write(tmp_path, text)).configurations).items()
    }
    assert {name: (one.get("resolution"), one.get("region")) for name, one in stereo.items()} == {  # type: ignore[attr-defined]
        "quick": ("half", "needed"),
        "own": ("full", "needed"),
        "slow": ("full", "frame"),
        "true": (None, None),
    }


def test_defaults_that_the_preset_of_the_file_replaces_are_named(tmp_path: Path) -> None:
    """Rates would be those of other gazes than the file asks for."""

    def said(text: str, **given: str) -> list[str]:
        notes = load_experiment(_write(tmp_path, text), **given).notes
        return [note.text for note in notes if note.kind == NoteKind.PARTLY_SET]

    measured = 'preset = "measured"\nclips = ["any"]\n'
    gaze = '[defaults.gaze]\nmodel = "simulated"\nerror_deg = 11\n'
    (note,) = said(measured + gaze)
    assert "gaze.model, gaze.error_deg" in note
    assert "'measured'" in note
    assert said(measured + "[grid]\ngaze = { one = { model = 'simulated', error_deg = 11 } }\n") == []
    points = f"{HEAD}[defaults.reconstruction]\nmax_points = 500\n"
    assert said(f"{points}[grid]\npreset = ['none', 'realtime']\n") == []
    assert said(f"clips = ['any']\n{gaze}", preset="measured") == []  # asked for over the file


def test_a_method_inherits_the_defaults_of_attention_that_it_has(tmp_path: Path) -> None:
    """As a matcher does: the cones of all configurations beside a method that has none."""

    def attention(defaults: str, one: str, other: str) -> list[dict[str, object]]:
        text = f"{HEAD}[defaults.attention]\n{defaults}\n[grid.attention]\none = {{{one}}}\nother = {{{other}}}\n"
        found = _by_name(load_experiment(_write(tmp_path, text)).configurations)
        return [found[name]["attention"] for name in ("one", "other")]  # type: ignore[misc]

    cones, posterior = attention("cones_cm = [10, 25]", "", "method = 'bayes'")
    assert (cones["cones_cm"], posterior["method"]) == ([10, 25], "bayes")
    posterior, cones = attention("method = 'bayes'\nsmoothing = 'off'", "", "method = 'cones'")
    assert posterior["smoothing"] == "off"
    assert "smoothing" not in cones
    with pytest.raises(VfoaError, match=r"attention\.n_ray: .*'n_rays'"):
        attention("n_ray = 20", "method = 'cones'", "method = 'bayes'")


def test_a_preset_may_be_an_axis_or_asked_for_from_outside(tmp_path: Path) -> None:
    grid = _write(tmp_path, HEAD + '[grid]\npreset = ["none", "realtime"]\n')
    resolutions = {
        name: one["stereo"]["resolution"]  # type: ignore[index]
        for name, one in _by_name(load_experiment(grid).configurations).items()
    }
    assert resolutions == {"none": "full", "realtime": "half"}
    (plain,) = load_experiment(_write(tmp_path, HEAD), preset="realtime").configurations
    assert plain.plain()["stereo"]["resolution"] == "half"
    assert plain.is_in_region


@pytest.mark.parametrize("is_here", [False, True])
def test_the_gaze_model_auto_is_what_is_here_and_a_quick_one_in_real_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_here: bool
) -> None:
    monkeypatch.setenv("VFOA_MODELS", str(tmp_path))
    monkeypatch.setattr("vfoa.weights.cache_directory", lambda: tmp_path / "none")
    if is_here:
        (tmp_path / "mobileone_s0_gaze.onnx").touch()

    def model(*overrides: str, preset: str | None = None) -> object:
        (found,) = load_experiment("default", clips=("any",), overrides=overrides, preset=preset).configurations
        choice = found.choices["gaze"]
        return choice and choice.name

    assert model() == ("l2cs" if is_here else "adas_0002")
    assert model(preset="realtime") == "adas_0002"
    assert model("gaze.model=l2cs", preset="realtime") == "l2cs"
    assert model("gaze.model=none", preset="realtime") is None


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('preset = "real-time"\n' + HEAD, r"preset: .*'real-time'.*'realtime'"),
        ('preset = "realtime"\n' + HEAD + '[defaults.reconstruction]\nstuff = ["road"]\n', 'stereo.region = "frame"'),
    ],
)
def test_a_preset_that_is_not_there_or_does_not_fit_is_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(VfoaError, match=said):
        load_experiment(_write(tmp_path, text))


def test_an_override_holds_where_the_stage_has_the_setting_and_a_note_names_the_others() -> None:
    experiment = load_experiment("demo", clips=("studio_table",), overrides=("stereo.mode=hh",))
    found = _by_name(experiment.configurations)
    assert [found[name]["stereo"].get("mode") for name in ("bm-one", "sgbm-one")] == [None, "hh"]  # type: ignore[attr-defined]
    (note,) = (note for note in experiment.notes if note.kind == NoteKind.PARTLY_SET)
    assert note.text == "stereo.mode is not set in bm-one, bm-two, bm-nearest: no such setting there."
    assert note.kind in WARNINGS  # on the terminal, beside the rates
    with pytest.raises(VfoaError, match=r"unknown key 'stereo\.moed'"):
        load_experiment("demo", overrides=("stereo.moed=hh",))


@pytest.mark.parametrize(
    ("overrides", "idle"),
    [
        (["attention.method=bayes", "attention.look_ahead_s=5"], {"attention.look_ahead_s": 'smoothing = "both"'}),
        (["attention.smoothing=both"], {"attention.smoothing": "weights that use later frames"}),
        (["gaze_filter.hold=2"], {"gaze_filter.hold": 'cues = "gaze" or "both"'}),
        (["stereo.matcher=bm", "stereo.texture_threshold=3"], {"stereo.texture_threshold": "wls = false"}),
        (["stereo.wls=false", "stereo.wls_sigma=2"], {"stereo.wls_sigma": "wls = true"}),
        (["gaze_filter.hold=2", "gaze_filter.cues=both"], {}),
        (["attention.method=bayes", "attention.smoothing=both", "attention.look_ahead_s=5"], {}),
    ],
)
def test_a_setting_without_an_effect_is_said(overrides: list[str], idle: dict[str, str]) -> None:
    experiment = load_experiment("default", clips=("studio_table",), overrides=tuple(overrides))
    notes = [note.text for note in experiment.notes if note.kind == NoteKind.PARTLY_SET]
    assert len(notes) == len(idle)
    for note, (key, needed) in zip(notes, idle.items(), strict=True):
        assert note.startswith(f"{key} has no effect")
        assert needed in note


def test_a_setting_that_counts_in_one_configuration_is_none_without_an_effect(tmp_path: Path) -> None:
    given = ("attention.method=bayes", "attention.look_ahead_s=5")
    grid = '[grid]\n"attention.smoothing" = ["forward", "both"]\n'
    experiment = load_experiment(_write(tmp_path, HEAD + grid), clips=("studio_table",), overrides=given)
    assert len(experiment.configurations) == 2
    assert [note for note in experiment.notes if note.kind == NoteKind.PARTLY_SET] == []


def test_an_experiment_says_the_kind_of_its_recordings(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    for kind in ("none", "jpeg"):
        path.write_text(f'clips = ["a"]\npreset = "measured"\nrecording = "{kind}"\n')
        assert load_experiment(str(path)).recording == kind
    path.write_text('clips = ["a"]\npreset = "measured"\n')
    assert load_experiment(str(path)).recording == "light"


@pytest.mark.parametrize(
    "axes",
    [
        '"attention.cones_cm" = [[10], [10, 25]]\n"stereo.matcher" = ["bm", "sgbm"]\n',
        'attention.cones_cm = [[10], [10, 25]]\nstereo.matcher = ["bm", "sgbm"]\n',
        'attention.cones_cm = { 10 = [10], 10_25 = [10, 25] }\nstereo.matcher = { bm = "bm", sgbm = "sgbm" }\n',
    ],
)
def test_a_grid_needs_no_quotes_and_no_names(tmp_path: Path, axes: str) -> None:
    found = load_experiment(_write(tmp_path, HEAD + "[grid]\n" + axes)).configurations
    assert [(each.name, each.attend.attention.model_dump()["cones_cm"]) for each in found] == [
        ("10-bm", (10,)),
        ("10-sgbm", (10,)),
        ("10_25-bm", (10, 25)),
        ("10_25-sgbm", (10, 25)),
    ]
    assert found[3].factors == {"attention.cones_cm": "10_25", "stereo.matcher": "sgbm"}


def test_a_label_of_a_grid_can_stand_for_several_settings(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text(
        'clips = ["a"]\npreset = "measured"\n[grid.gaze]\nheads = { model = "none" }\n'
        'wrong = { model = "simulated", error_deg = 20 }\n'
    )
    heads, wrong = load_experiment(str(path)).configurations
    assert (heads.name, heads.choices["gaze"]) == ("heads", None)
    assert wrong.choices["gaze"] is not None
    assert wrong.choices["gaze"].plain()["error_deg"] == 20
