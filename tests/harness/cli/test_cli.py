"""The command line as its user meets it: help, and one line for each usual mistake."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from harness.cli import main, one_line_errors, setup
from harness.cli.run import experiment_of
from harness.pipeline.weights import catalogue
from scripts.site_pages import commands_page
from tests.command import vfoa
from tests.disk import labels_text, picture, sintel_scene, stereo_pair_folder, write_image, write_text
from vfoa.errors import VfoaError

HEAVY = ("cv2", "open3d", "onnxruntime", "rerun", "pandas", "scipy", "filterpy", "matplotlib")

CLIP = 'name = "mine"\nadapter = "{adapter}"\nroot = "{root}"\n[source]\n{source}\n'
SINTEL = 'scene = "alley"'
FOLDER = 'left = "left"\nright = "right"\n[source.camera]\nfx_px = 50.0\ncx_px = 31.5\ncy_px = 23.5\nbaseline_m = 0.1'
PEOPLE = '[subjects.girl]\ncategory = "person"\n[targets.bird]\ncategory = "bird"\n'


def _clip(folder: Path, adapter: str, root: Path, source: str) -> None:
    write_text(folder / "datasets" / "mine.toml", CLIP.format(adapter=adapter, root=root.as_posix(), source=source))


def test_help_loads_nothing_heavy() -> None:
    code = (
        "import sys; from harness.cli import main; sys.argv = ['vfoa', '--help']\n"
        "try: main()\nexcept SystemExit: pass\n"
        f"loaded = [name for name in {HEAVY!r} if name in sys.modules]; assert not loaded, loaded"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "demo" in done.stdout


@pytest.mark.parametrize("module", ["vfoa", "harness"])
def test_the_packages_run_as_modules(module: str) -> None:
    done = subprocess.run([sys.executable, "-m", module, "--version"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.split()[0]) == (0, "vfoa"), done.stderr


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("run", "demmo"), "no experiment or clip 'demmo'; did you mean 'demo'?"),
        (("run", "bencmark"), "no experiment or clip 'bencmark'; did you mean 'benchmark'?"),
        (("fit", "bencmark"), "no experiment or clip 'bencmark'; expected one of: bandage_2"),
        (("run", "studio_tabel"), "no experiment or clip 'studio_tabel'; did you mean 'studio_table'?"),
        (("run", "demo", "--clip", "studio_tabel"), "no clip 'studio_tabel'; did you mean 'studio_table'?"),
        (("run", "demo", "--set", "stereo.matcher=sgmb"), "no 'sgmb'; did you mean 'sgbm'?"),
        (("run", "demo", "--set", "stereo.machter=bm"), "demo.toml --set stereo.machter=bm: "),
        (("run", "demo", "--set", "stereo.machter=bm"), "unknown key 'stereo.machter'; did you mean 'matcher'?"),
        (
            ("run", "studio_table", "--set", "attention.cones_deg=[30]"),
            "unknown key 'attention.cones_deg'; it is a setting of attention.method = \"cones\"",
        ),
        (
            ("run", "studio_table", "--set", "stereo.matcher=hitnet", "--set", "stereo.wls=true"),
            'stereo.wls\'; it is a setting of stereo.matcher = "bm" or stereo.matcher = "sgbm"',
        ),
        (("run", "demo", "--preset", "nope"), "vfoa: preset: no 'nope'; did you mean 'none'?"),
        (("run", "demo", "--preset", "nope.toml"), "vfoa: preset: nope.toml: no such file"),
        (("run", "demo", "--set", "attention"), "--set attention: expected KEY=VALUE"),
        (("run", "nowhere/mine.toml"), "nowhere/mine.toml: no such file"),
        (("score", "nowhere"), "nowhere: expected a run's directory, found nothing there"),
        (("view", "nowhere"), "nowhere: expected a run's directory, found nothing there"),
        (("view", "nowhere.rrd"), "nowhere.rrd: no such file"),
        (("view", __file__), "test_cli.py: expected a run's directory, found a file"),
    ],
)
def test_a_wrong_word_is_one_line_and_exit_code_2(
    arguments: tuple[str, ...],
    line: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    code, _, said = vfoa(monkeypatch, capsys, *arguments)
    assert code == 2
    assert line in said
    assert said.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("run", "films/one.mp4"), "vfoa: films/one.mp4: a file, and no experiment or clip; "),
        (("run", "films"), "vfoa clips add films makes"),
        (("annotate", "films/one.mp4"), "vfoa clips add films/one.mp4 makes"),
        (("clips", "check", "films"), "vfoa clips add films makes"),
        (("clips", "add", "my.toml"), "my.toml: found a manifest or an experiment; "),
    ],
)
def test_a_recording_in_place_of_a_clip_says_how_it_is_added(
    arguments: tuple[str, ...],
    line: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    write_text(tmp_path / "films" / "one.mp4", "")
    write_text(tmp_path / "my.toml", 'clips = ["one"]\n')
    code, out, said = vfoa(monkeypatch, capsys, *arguments)
    assert code != 0
    assert line in out + said


@pytest.mark.parametrize(
    ("files", "options", "command"),
    [
        ((), (), "vfoa run demo"),
        (("datasets/talk.toml", "datasets/walk.toml"), (), "vfoa run talk"),
        (("datasets/talk.toml",), ("--clip", "walk"), "vfoa run walk"),
        (("datasets/talk.toml", "experiments/mine.toml", "experiments/yours.toml"), (), "vfoa run mine"),
    ],
)
def test_a_run_of_nothing_names_what_can_be_run(
    files: tuple[str, ...],
    options: tuple[str, ...],
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    for file in files:
        write_text(tmp_path / file, "")
    code, _, said = vfoa(monkeypatch, capsys, "run", *options)
    assert code == 2
    assert said.endswith(f"expected an experiment or clips: {command}\n")


@pytest.mark.parametrize("of", [(), ("labels",), ("cache",), ("clips",), ("models",)], ids=" ".join)
def test_the_help_cuts_no_verb_short(
    of: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    _, said, _ = vfoa(monkeypatch, capsys, *of, "--help")
    verbs = said.split("Commands:")[1].splitlines()[1:]
    assert len(verbs) >= 2
    assert [line for line in verbs if not line.endswith(".") or line.endswith("...")] == []


def test_the_help_names_no_type_of_python() -> None:
    python = re.compile(r"<(?:list|tuple|int|float|str|path)\b")
    assert [line for line in commands_page().splitlines() if python.search(line)] == []


@pytest.mark.parametrize(
    ("option", "value", "expected"),
    [
        ("--limit", "many", "--limit: expected a whole number, found 'many'"),
        ("--limit", "0", "--limit: expected greater than or equal to 1, found '0'"),
        ("--recording", "heavy", "--recording: 'heavy' is not one of 'light', 'jpeg', 'none'"),
    ],
)
def test_a_wrong_value_is_told_as_in_a_file(
    option: str, value: str, expected: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = vfoa(monkeypatch, capsys, "run", "demo", option, value)
    assert (code, out, err) == (2, "", f"vfoa: run: {expected}; see `vfoa run -h`\n")


def test_a_run_of_one_clip_bears_its_name() -> None:
    assert experiment_of(["studio_table"], (), (), None).name == "studio_table"
    assert experiment_of(["studio_table", "studio_talk"], (), (), None).name == "default"
    assert experiment_of(["demo"], ("studio_table",), (), None).name == "demo"


def test_a_clip_is_not_passed_over_for_an_experiment_of_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    _clip(tmp_path, "stereo_folder", tmp_path, FOLDER)
    clip = (tmp_path / "datasets" / "mine.toml").rename(tmp_path / "datasets" / "demo.toml")
    with pytest.raises(VfoaError, match=rf"{re.escape(str(clip))}: .*vfoa run default --clip demo"):
        experiment_of(["demo"], (), (), None)
    shipped = experiment_of(["demo"], ("studio_talk",), (), None).where
    own = write_text(tmp_path / "experiments" / "demo.toml", Path(shipped).read_text(encoding="utf-8"))
    assert experiment_of(["demo"], (), (), None).where == str(own)


def _wrong_path(folder: Path) -> None:
    _clip(folder, "sintel", folder / "nowhere", SINTEL)


def _missing_right(folder: Path) -> None:
    root = sintel_scene(folder / "data")
    (root / "training" / "clean_right" / "alley" / "frame_0002.png").unlink()
    _clip(folder, "sintel", root, SINTEL)


def _sizes_differ(folder: Path) -> None:
    root = stereo_pair_folder(folder / "data")
    write_image(root / "right" / "000001.png", picture(1, 60, 48))
    _clip(folder, "stereo_folder", root, FOLDER)


def _unknown_key(folder: Path) -> None:
    _clip(folder, "sintel", sintel_scene(folder / "data"), SINTEL + '\nscnee = "alley"')


def _unknown_target(folder: Path) -> None:
    root = sintel_scene(folder / "data")
    _clip(folder, "sintel", root, SINTEL + "\n" + PEOPLE)
    write_text(folder / "annotations" / "mine.csv", labels_text("1,3,girl,brid,"))


def _truncated(folder: Path) -> None:
    root = sintel_scene(folder / "data")
    path = root / "training" / "clean_left" / "alley" / "frame_0001.png"
    path.write_bytes(path.read_bytes()[:-30])
    _clip(folder, "sintel", root, SINTEL)


@pytest.mark.parametrize(
    ("spoil", "line"),
    [
        (_wrong_path, "nowhere"),
        (_missing_right, "frame_0002.png"),
        (_sizes_differ, "60"),
        (_unknown_key, "unknown key 'source.scnee'; did you mean 'scene'?"),
        (_unknown_target, "mine.csv:3: unknown target 'brid'; did you mean 'bird'?"),
        (_truncated, "frame_0001.png: truncated PNG"),
    ],
)
def test_a_spoilt_clip_is_one_line_and_no_table(
    spoil: object, line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil(tmp_path)  # type: ignore[operator]
    stages = (
        'stereo = { matcher = "bm", min_depth_m = 1.0 }\nsegmentation.model = "truth"\n'
        'heads.detector = "person_mask"\nhead_pose.model = "none"\ngaze.model = "none"\n'
    )
    write_text(tmp_path / "e.toml", f'clips = ["mine"]\n[[configuration]]\nname = "only"\n{stages}')
    monkeypatch.chdir(tmp_path)
    options = ("--out", "out", "--workers", "1", "--recording", "none", "--no-cache")
    code, _, said = vfoa(monkeypatch, capsys, "run", "e.toml", *options)
    assert code == 2
    assert line in said, said
    assert said.count("\n") == 1, said
    written = {path.name for path in (tmp_path / "out").glob("*")}
    assert written <= {".lock", "manifest.json", "partial", "inputs.noted", "thumbnails"}


@pytest.mark.parametrize(
    "words",
    [
        ("fit", "studio_talk", "--out"),
        ("bench", "demo", "--out"),
        ("models", "export", "gaze360", "--checkpoint", "none.pt", "--out"),
    ],
    ids=lambda words: words[0],
)
def test_a_file_that_is_there_is_replaced_only_if_told_so(
    words: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine").write_text("mine")
    code, _, said = vfoa(monkeypatch, capsys, *words, "mine")
    assert code == 2
    assert said == "vfoa: mine: exists already; expected --replace, or another --out\n"
    assert (tmp_path / "mine").read_text() == "mine"


@pytest.fixture
def models(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The only folder of weights, with a file for each network of the catalogue; and a wide terminal."""
    for entry in catalogue().values():
        write_text(tmp_path / "models" / entry.file, "weights")
    monkeypatch.setenv("VFOA_MODELS", str(tmp_path / "models"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("COLUMNS", "1000")
    return tmp_path / "models"


def _lines(out: str, *words: str) -> list[str]:
    """The line of the table with each word."""
    return [next(line for line in out.splitlines() if word in line) for word in words]


def test_the_doctor_finds_nothing_to_mend_where_all_is_here(
    models: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, said = vfoa(monkeypatch, capsys, "doctor")
    assert (code, said) == (0, "")
    assert out.startswith("`vfoa run CLIP` can work here.\n")
    mended = [
        line.split()[-1] for line in _lines(out, "Python", "ximgproc", "segmentation", "yunet)", "3ddfa_v2)", "l2cs)")
    ]
    assert mended == ["-"] * 6


def test_the_doctor_names_a_fix_for_a_default_that_another_stage_can_replace(
    models: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (models / catalogue()["yunet"].file).unlink()
    code, out, _ = vfoa(monkeypatch, capsys, "doctor")
    (line,) = _lines(out, "yunet)")
    assert code == 0
    assert "vfoa models fetch yunet" in line
    assert "person_mask" in line


def test_the_doctor_breaks_no_path(
    models: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("VFOA_CACHE", str(folder := tmp_path / ("deep" * 10) / "cache"))
    _, out, _ = vfoa(monkeypatch, capsys, "doctor")
    assert f"stage cache: {folder}: writable" in out.splitlines()


def test_the_doctor_fails_where_a_stage_has_no_model(
    models: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for entry in catalogue().values():
        if (entry.stage or "").startswith("gaze."):
            (models / entry.file).unlink(missing_ok=True)
    (models / catalogue()["yunet"].file).unlink()
    code, out, said = vfoa(monkeypatch, capsys, "doctor")
    (line,) = _lines(out, "gaze (default")
    assert "ready: none" in line
    assert code == 2
    assert said.count("\n") == 1
    assert "gaze (default adas_0002)" in said
    (command,) = re.findall("`(vfoa models fetch .*?)`", said)
    assert {"yunet", "adas-0002", "adas-head-pose"} == {*command.split()[3:]}


def test_the_doctor_fails_where_a_package_cannot_be_imported(
    models: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "open3d", None)  # as where a library of the system is missing
    code, out, _ = vfoa(monkeypatch, capsys, "doctor")
    assert (code, "libgl1" in out) == (2, True)


@pytest.mark.parametrize(
    ("devices", "is_offered"), [((), False), (("nvidiactl",), False), (("nvidia0", "nvidiactl"), True)]
)
def test_the_doctor_offers_cuda_where_there_is_a_gpu(
    devices: tuple[str, ...],
    is_offered: bool,
    models: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for device in devices:
        write_text(models.parent / "dev" / device, "")
    monkeypatch.setattr(setup, "_DEVICES", models.parent / "dev")
    monkeypatch.setattr("vfoa.onnx.available_providers", lambda: ["cpu"])
    code, out, _ = vfoa(monkeypatch, capsys, "doctor")
    assert (code, "CUDA" in out) == (0, is_offered)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["run", "--nope"], "vfoa: run: No such option: --nope"),
        (["nope"], "vfoa: No such command 'nope'; see `vfoa -h`"),
        (["clips", "export", "--limit"], "vfoa: clips export: Option '--limit' requires an argument"),
    ],
)
def test_a_wrong_command_line_is_one_line(words, said, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["vfoa", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert error.startswith(said)
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("error", "is_memory"),
    [
        (ImportError("libm.so: failed to map segment from shared object"), True),
        (SystemError("error return without exception set"), True),
        (ImportError("no module"), False),
        (SystemError("a fault"), False),
    ],
)
def test_a_library_that_finds_no_memory_is_one_line_and_no_other_fault_is(
    error: Exception, is_memory: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit if is_memory else type(error)), one_line_errors():
        raise error
    assert capsys.readouterr().err.count("\n") == is_memory
