"""From a recording and no models to a table: `vfoa clips add`, `vfoa models fetch --for CLIP`, `vfoa run CLIP`."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from harness.pipeline import weights
from harness.pipeline.weights import catalogue
from tests.command import vfoa
from tests.disk import write_text
from tests.harness.clips.adding import NUMBERS, images
from tests.homes import MOBILEGAZE, NEEDED, serve_models
from tests.measured import measured_tables
from tests.web import Site, serve

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def site() -> Iterator[Site]:
    with serve() as found:
        yield found


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The only folder of weights; it does not exist yet. The working directory is another empty folder."""
    (tmp_path / "work").mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.delenv("VFOA_MODELS", raising=False)
    monkeypatch.setattr("vfoa.weights.cache_directory", lambda: tmp_path / "models")
    monkeypatch.setattr(weights, "cache_directory", lambda: tmp_path / "models")
    for name in ("HTTP_PROXY", "ALL_PROXY", "http_proxy", "all_proxy"):
        monkeypatch.delenv(name, raising=False)
    return tmp_path / "models"


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    return lambda *words: vfoa(monkeypatch, capsys, *words)


@pytest.fixture
def _homes(site: Site, shared_models: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    serve_models(site, shared_models, tmp_path, monkeypatch)


def add(run: Run, source: Path) -> list[str]:
    code, out, err = run(
        "clips", "add", str(source), "--name", "mine", *NUMBERS, "--subject", "ann", "--target", "mug=cup"
    )
    assert (code, err) == (0, "")
    return out.splitlines()


@pytest.mark.usefixtures("_homes")
def test_one_command_brings_what_the_default_run_of_a_new_clip_needs(
    site: Site, cache: Path, tmp_path: Path, run: Run
) -> None:
    said = add(run, images(tmp_path / "source", "left/{}.png", "right/{}.png"))
    assert said[-2:] == ["next: vfoa models fetch --for mine", "next: vfoa run mine"]
    code, _, err = run("run", "mine")
    assert code == 2
    assert "expected: vfoa models fetch --for mine" in err
    assert not cache.exists()

    code, out, err = run("models", "fetch", "--for", "mine")
    assert (code, err) == (0, "")
    hint, *lines = out.splitlines()
    assert hint.startswith("gaze: ADAS-0002; with --accept-licence MobileGaze")
    first, rest = lines[: len(NEEDED)], lines[len(NEEDED) :]
    assert {line.partition(":")[0] for line in first} == {*NEEDED}
    assert all("licence: " in line and (" MB; " in line or "size not known" in line) for line in first)
    files = {catalogue()[name].file for name in NEEDED}
    assert {line.partition(": ")[2] for line in rest} == {str(cache / file) for file in files}
    assert {path.name for path in cache.iterdir()} == files
    assert {path for path, _ in site.asked} == site.files.keys() - {f"/{catalogue()[MOBILEGAZE].file}"}

    code, _, err = run("run", "mine", "--recording", "none", "--workers", "1")
    assert (code, err) == (0, "")
    assert gaze_of_the_run() == "adas_0002"


@pytest.mark.usefixtures("_homes")
def test_mobilegaze_takes_the_place_of_adas_where_its_licence_is_accepted(
    cache: Path, tmp_path: Path, run: Run
) -> None:
    add(run, images(tmp_path / "source", "left/{}.png", "right/{}.png"))
    code, out, err = run("models", "fetch", "--for", "mine", "--accept-licence")
    assert (code, err) == (0, "")
    named = {line.partition(":")[0] for line in out.splitlines() if ": licence: " in line}
    assert named == {*NEEDED, MOBILEGAZE} - {"adas-0002", "adas-head-pose"}
    code, _, err = run("run", "mine", "--recording", "none", "--workers", "1")
    assert (code, err) == (0, "")
    assert gaze_of_the_run() == "l2cs"


def gaze_of_the_run() -> str:
    """The gaze model that the run of the clip says it had."""
    manifest = json.loads((Path("runs") / "mine" / "manifest.json").read_text(encoding="utf-8"))
    return str(manifest["configurations"]["default"]["gaze"]["model"])


def test_a_run_that_lacks_other_models_than_the_default_one_names_them(cache: Path, tmp_path: Path, run: Run) -> None:
    add(run, images(tmp_path / "source", "left/{}.png", "right/{}.png"))
    code, _, err = run("run", "mine", "--set", "heads.detector=person_mask", "--set", "head_pose.model=none")
    assert code == 2
    assert "expected: vfoa models fetch adas-0002 adas-head-pose rf-detr-seg-medium" in err


def test_an_experiment_needs_the_models_of_its_configurations(
    cache: Path, tmp_path: Path, shared_models: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("VFOA_MODELS", str(shared_models))
    add(run, images(tmp_path / "source", "left/{}.png", "right/{}.png"))
    networks = {"heads.detector": "yunet", "head_pose.model": "fsanet", "gaze.model": "adas_0002"}
    stages = {"stereo.matcher": "bm", "segmentation.model": "drawn", **networks}
    lines = [f'{key} = "{name}"' for key, name in stages.items()]
    text = "\n".join(['clips = ["mine"]', "[[configuration]]", 'name = "one"', *lines])
    write_text(Path("experiments/heads.toml"), text)
    code, out, err = run("models", "fetch", "--for", "heads")
    assert (code, err) == (0, "")
    named = [line.partition(":")[0] for line in out.splitlines() if ": licence: " in line]
    assert {*named} == {"yunet", "fsanet-1x1", "fsanet-var", "adas-0002", "adas-head-pose"}


def test_a_clip_without_images_needs_no_models(cache: Path, tmp_path: Path, run: Run) -> None:
    code, _, err = run("clips", "add", str(measured_tables(tmp_path)), "--name", "mine")
    assert (code, err) == (0, "")
    assert run("models", "fetch", "--for", "mine") == (0, "mine: a run of it needs no models\n", "")


@pytest.mark.parametrize("words", [(), ("--for", "no-such-clip")])
def test_what_to_fetch_must_be_named(words: tuple[str, ...], cache: Path, run: Run) -> None:
    code, _, err = run("models", "fetch", *words)
    assert (code, err.count("\n")) == (2, 1)
