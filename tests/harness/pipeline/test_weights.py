from __future__ import annotations

import hashlib
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from harness.cli.models import app
from harness.pipeline import weights as models
from harness.pipeline.configuration import STAGES, StageChoice
from harness.pipeline.weights import (
    CatalogueEntry,
    catalogue,
    check_model,
    fetch_model,
    find_model,
    locate_weights,
    missing_weights,
    ready_stages,
    signature,
)
from harness.run.experiment import load_experiment
from tests import graphs
from tests.web import Site
from vfoa.errors import VfoaError
from vfoa.gaze import adas, l2cs
from vfoa.head_pose import fsanet, sixdrepnet, tddfa_v2
from vfoa.heads import yunet
from vfoa.onnx import Model, RuntimeSettings
from vfoa.segmentation import mask_classification, mask_rcnn, panoptic_fpn, rf_detr_seg, yolo_seg
from vfoa.stereo import hitnet

CPU = RuntimeSettings()
WEIGHTS = hashlib.sha256(b"weights").hexdigest()
SIGNATURES = {
    "adas-0002": adas.GAZE,
    "adas-head-pose": adas.HEAD_POSE,
    "heads.yunet": yunet.SIGNATURE,
    "head_pose.fsanet": fsanet.SIGNATURE,
    "head_pose.3ddfa_v2": tddfa_v2.SIGNATURE,
    "head_pose.6drepnet": sixdrepnet.SIGNATURE,
    "gaze.l2cs": l2cs.SIGNATURE,
    "stereo.hitnet": hitnet.SIGNATURE,
    "segmentation.rf_detr_seg": rf_detr_seg.SIGNATURE,
    "segmentation.yolo_seg": yolo_seg.SIGNATURE,
    "segmentation.mask_rcnn": mask_rcnn.SIGNATURE,
    "segmentation.mask_classification": mask_classification.SIGNATURE,
    "segmentation.panoptic_fpn": panoptic_fpn.SIGNATURE,
}
"""Requirements of a stage on a network, by the model's name, or by the stage where it has one network."""


@pytest.fixture(autouse=True)
def _models_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders of this test alone: ``given`` for VFOA_MODELS, ``cache`` for what is fetched."""
    (tmp_path / "given").mkdir()
    monkeypatch.setenv("VFOA_MODELS", str(tmp_path / "given"))
    monkeypatch.setattr("vfoa.weights.platformdirs.user_cache_dir", lambda name: str(tmp_path / "cache"))
    monkeypatch.setenv("COLUMNS", "200")
    for name in ("HTTP_PROXY", "ALL_PROXY", "http_proxy", "all_proxy"):
        monkeypatch.delenv(name, raising=False)


def entry_of(**known: Any) -> CatalogueEntry:
    return CatalogueEntry.model_validate(
        {"file": "model.onnx", "task": "test", "licence": "MIT", "home": "https://example.org", **known}
    )


def small_model(folder: Path) -> tuple[Path, CatalogueEntry]:
    """A network [1, 3, h, w] -> [1, 3] in a folder, and its entry."""
    path = Path(graphs.mean_color(folder / "model.onnx", "image", (1, 3, "h", "w"), "means", 1.0))
    content = path.read_bytes()
    return path, entry_of(
        sha256=hashlib.sha256(content).hexdigest(),
        bytes=len(content),
        inputs={"image": [1, 3, "h", "w"]},
        outputs={"means": [1, 3]},
        sizes={"h": 8, "w": 8},
    )


# The catalogue


def test_every_entry_names_a_stage_that_exists_and_what_it_needs_to_be_run() -> None:
    for name, entry in catalogue().items():
        assert entry.home.startswith("https://"), name
        assert entry.address is None or entry.address.startswith("https://"), name
        assert entry.address is None or entry.sha256 is not None, name
        assert entry.can_be_fetched or entry.note, name
        if entry.is_onnx:
            assert entry.stage is not None, name
            slot, stage = entry.stage.split(".")
            assert stage in STAGES[slot].library.names(), name
            assert entry.outputs, name
            opened = {length for shape in entry.inputs.values() for length in shape if isinstance(length, str)}
            assert opened == set(entry.sizes), name
    files = [entry.file for entry in catalogue().values()]
    assert len(set(files)) == len(files)


def test_the_catalogues_signatures_are_those_of_the_stages(tmp_path: Path) -> None:
    for name, entry in catalogue().items():
        if not entry.is_onnx:
            continue
        outputs = {
            key: np.zeros([length if isinstance(length, int) else entry.sizes.get(length, 4) for length in shape])
            for key, shape in entry.outputs.items()
        }
        path = graphs.constant(tmp_path / f"{name}.onnx", entry.inputs, outputs, entry.integers)
        for wanted in (SIGNATURES.get(name) or SIGNATURES[str(entry.stage)], signature(entry)):
            Model(path, wanted, CPU).check()


def test_what_was_trained_on_gaze360_is_not_for_commerce() -> None:
    for name, entry in catalogue().items():
        if "Gaze360" in entry.task + entry.licence:
            assert entry.non_commercial, name


def test_nothing_is_fetched_by_an_address_alone() -> None:
    for name, entry in catalogue().items():  # without a checksum, a login page would pass for the model
        assert [entry.address, entry.openvino, entry.checkpoint].count(None) >= 2, name
        assert entry.sha256 is not None or not entry.can_be_fetched, name


def test_a_name_that_is_not_there() -> None:
    with pytest.raises(VfoaError, match=r"models: .*'yunett'; .*'yunet'"):
        find_model("yunett")


# Fetching


def test_fetches_into_the_cache_once(tmp_path: Path, site: Site) -> None:
    site.files["/model.onnx"] = b"weights"
    entry = entry_of(address=site.url("/model.onnx"), sha256=WEIGHTS)
    for _ in range(2):
        path = fetch_model("small", entry, accept_licence=False)
        assert path == tmp_path / "cache" / "models" / "model.onnx"
        assert path.read_bytes() == b"weights"
    assert len(site.asked) == 1


def test_a_damaged_file_in_the_cache_is_fetched_again(tmp_path: Path, site: Site) -> None:
    site.files["/model.onnx"] = b"weights"
    path = tmp_path / "cache" / "models" / "model.onnx"
    path.parent.mkdir(parents=True)
    path.write_bytes(b"wei")
    entry = entry_of(address=site.url("/model.onnx"), sha256=WEIGHTS)
    assert fetch_model("small", entry, accept_licence=False).read_bytes() == b"weights"


def test_terms_must_be_accepted_before_anything_is_asked_for(site: Site) -> None:
    site.files["/model.onnx"] = b"weights"
    entry = entry_of(address=site.url("/model.onnx"), sha256=WEIGHTS, licence="research", non_commercial=True)
    with pytest.raises(VfoaError, match=r"small: its licence .*research.*--accept-licence"):
        fetch_model("small", entry, accept_licence=False)
    assert site.asked == []
    assert fetch_model("small", entry, accept_licence=True).read_bytes() == b"weights"


def test_without_an_address_it_says_where_to_look(tmp_path: Path) -> None:
    with pytest.raises(
        VfoaError,
        match=r"small: .*https://example\.org as .*cache",
    ):
        fetch_model("small", entry_of(note="in an archive"), accept_licence=False)


def test_another_file_of_that_name_is_not_hidden_behind(tmp_path: Path, site: Site) -> None:
    (tmp_path / "given" / "model.onnx").write_bytes(b"other")
    entry = entry_of(address=site.url("/model.onnx"), sha256="0" * 64)
    with pytest.raises(VfoaError, match=r"given/model\.onnx: .*checksum .*small"):
        fetch_model("small", entry, accept_licence=False)


@pytest.mark.parametrize(
    "file",
    [
        *(f"{network}_gaze.onnx" for network in ("mobileone_s0", "mobilenetv2", "resnet18", "resnet34", "resnet50")),
        *("resnet18.onnx", "resnet50.onnx", "mobilenetv3_small.onnx"),  # 6DRepNet
    ],
)
def test_each_network_of_a_release_is_fetched_from_its_home_once_its_terms_are_accepted(file: str, site: Site) -> None:
    (name,) = (name for name, entry in catalogue().items() if entry.file == file)
    entry = find_model(name)
    assert entry.address == f"{entry.home}/releases/download/weights/{entry.file}"
    served = entry.model_copy(update={"address": site.url("/model.onnx"), "sha256": WEIGHTS})
    site.files["/model.onnx"] = b"weights"
    with pytest.raises(VfoaError, match="expected --accept-licence"):
        fetch_model(name, served, accept_licence=False)
    assert fetch_model(name, served, accept_licence=True).name == entry.file


# Checking


def test_a_good_model_says_provider_and_time(tmp_path: Path) -> None:
    _, entry = small_model(tmp_path / "given")
    found = check_model("small", entry, CPU)
    assert (found.verdict, found.provider, found.message) == ("ok", "cpu", None)
    assert found.checksum_known
    assert found.inference_ms is not None
    assert found.inference_ms > 0


def test_each_kind_of_failure_is_one_clear_line(tmp_path: Path) -> None:
    path, entry = small_model(tmp_path / "given")
    whole = path.read_bytes()
    other = entry.model_copy(update={"outputs": {"gaze": (1, 3)}})
    absent = RuntimeSettings.model_validate({"provider": "tensorrt" if sys.platform == "darwin" else "coreml"})
    flipped = whole.replace(b"GlobalAveragePool", b"GlobalAveragePoop")
    kinds: list[tuple[bytes, CatalogueEntry, RuntimeSettings, str]] = [
        (whole[:-9], entry, CPU, f"truncated: found {len(whole) - 9} bytes, expected {len(whole)}"),
        (flipped, entry, CPU, "not a complete ONNX model"),
        (b"<html>" * len(whole), entry, CPU, "not a complete ONNX model"),
        (b"version https://git-lfs.github.com/spec/v1\noid", entry, CPU, "a Git LFS pointer"),
        (whole, other, CPU, "another model's outputs; expected gaze [1, 3]"),
        (whole + b"\x00\x00", entry, CPU, "not a complete ONNX model"),
        (whole, entry.model_copy(update={"sha256": "0" * 64}), CPU, "corrupt, or another version: found sha256"),
        (whole, entry, absent, "is not in this build of ONNX Runtime"),
    ]
    for content, asked, settings, expected in kinds:
        path.write_bytes(content)
        found = check_model("small", asked, settings)
        assert (found.verdict, found.provider) == ("fails", None)
        assert found.message is not None
        assert expected in found.message
        assert "\n" not in found.message


def test_a_network_that_fails_when_it_runs_is_one_clear_line(tmp_path: Path) -> None:
    from onnx import helper

    nodes = [
        graphs.constant_node("shape", np.array([2, 2])),
        helper.make_node("Reshape", ["image", "shape"], ["means"]),
    ]
    graphs.write(tmp_path / "given" / "model.onnx", nodes, {"image": ("n", 3)}, {"means": ("a", "b")})
    entry = entry_of(inputs={"image": ["n", 3]}, outputs={"means": ["a", "b"]}, sizes={"n": 1})
    found = check_model("small", entry, CPU)
    assert found.verdict == "fails"
    assert found.message is not None
    assert "model.onnx: fails on image [1, 3]: " in found.message
    assert "\n" not in found.message


def test_a_checkpoint_is_only_compared(tmp_path: Path) -> None:
    (tmp_path / "given" / "model.pth.tar").write_bytes(b"tensors")
    right = entry_of(file="model.pth.tar", sha256=hashlib.sha256(b"tensors").hexdigest(), note="export it")
    found = check_model("small", right, CPU)
    assert (found.verdict, found.provider, found.message) == ("ok", None, "export it")
    wrong = entry_of(file="model.pth.tar", sha256="0" * 64)
    assert check_model("small", wrong, CPU).verdict == "fails"


# The command line


def run(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


def test_check_names_what_is_wrong_and_exits_2(tmp_path: Path, shared_models: Path) -> None:
    for file in ("fsanet-1x1-iter-688590.onnx", "fsanet-var-iter-688590.onnx"):
        shutil.copy(shared_models / file, tmp_path / "given" / file)
    assert run("check").exit_code == 0  # what is absent is no failure, unless it is asked for
    assert run("check", "hitnet-320x240").exit_code == 2
    damaged = tmp_path / "given" / "fsanet-var-iter-688590.onnx"
    damaged.chmod(0o644)
    damaged.write_bytes(damaged.read_bytes()[:1000])
    found = run("check", "fsanet-1x1", "fsanet-var")
    assert found.exit_code == 2
    good, bad = found.stdout.splitlines()
    assert good.startswith("fsanet-1x1: ok: cpu, ")
    assert good.endswith(" ms, checksum correct")
    assert bad == f"fsanet-var: fails: {damaged}: truncated: found 1000 bytes, expected 1246963"
    verdicts = dict(line.split(": ")[:2] for line in run("check").stdout.splitlines())
    assert (verdicts["fsanet-1x1"], verdicts["fsanet-var"], verdicts["gaze360"]) == ("ok", "fails", "absent")


def test_every_model_of_the_shared_folder_is_right(shared_models: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("VFOA_MODELS", str(shared_models))
    here = {name for name, entry in catalogue().items() if (shared_models / entry.file).is_file()}
    unused = {"landmarks-regression-retail-0009.onnx"}  # vfoa ran it before 0.1.0
    files = {path.name for path in shared_models.glob("*.onnx")} - unused
    assert {catalogue()[name].file for name in here} == files
    found = run("check", *here)
    assert found.exit_code == 0, found.stdout
    assert all(": ok: cpu, " in line and line.endswith("checksum correct") for line in found.stdout.splitlines())


def test_fetch_shows_the_licence_and_the_path(tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch) -> None:
    site.files["/model.onnx"] = b"weights"
    entry = entry_of(address=site.url("/model.onnx"), sha256=WEIGHTS, licence="research only", non_commercial=True)
    monkeypatch.setattr(models, "catalogue", lambda: {"small": entry})
    refused = run("fetch", "small")
    assert refused.exit_code == 2
    assert "small: licence: research only" in refused.stdout
    assert (
        refused.stderr
        == "vfoa: small: its licence allows no commercial use: research only; expected --accept-licence\n"
    )
    found = run("fetch", "small", "--accept-licence")
    assert found.exit_code == 0
    assert found.stdout.splitlines()[-1] == f"small: {tmp_path / 'cache' / 'models' / 'model.onnx'}"


def test_what_cannot_be_fetched_does_not_stop_the_others(
    tmp_path: Path, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    site.files["/model.onnx"] = b"weights"
    here = entry_of(address=site.url("/model.onnx"), sha256=WEIGHTS)
    nowhere = entry_of(file="other.onnx")
    monkeypatch.setattr(models, "catalogue", lambda: {"nowhere": nowhere, "here": here})
    found = run("fetch", "nowhere", "here")
    assert found.exit_code == 2
    assert "vfoa: nowhere: no address with a checksum is known" in found.stderr
    assert found.stdout.splitlines()[-1] == f"here: {tmp_path / 'cache' / 'models' / 'model.onnx'}"


def chosen(**tables: dict[str, Any]) -> list[StageChoice]:
    choices = [STAGES[slot].parse(table, "test") for slot, table in tables.items()]
    return [choice for choice in choices if choice]


def test_weights_that_are_missing_are_all_named_with_the_command_that_brings_them(tmp_path: Path) -> None:
    one, two = (find_model(name) for name in ("fsanet-1x1", "fsanet-var"))
    fsanet = chosen(head_pose={"model": "fsanet"})
    with pytest.raises(VfoaError, match=r"\(MIT, 1\.2 MB\), .*fsanet-1x1 fsanet-var$"):
        locate_weights(fsanet)
    for entry in (one, two):
        (tmp_path / "given" / entry.file).touch()
    assert locate_weights(fsanet) == {e.file: tmp_path / "given" / e.file for e in (one, two)}
    with pytest.raises(VfoaError, match=r"mine\.onnx: no such model file"):
        locate_weights(chosen(segmentation={"model": "yolo_seg", "weights": "mine.onnx"}))


def test_a_missing_network_names_one_that_is_here_and_the_options_it_names_are_taken(tmp_path: Path) -> None:
    wanted = chosen(segmentation={"model": "rf_detr_seg"}, heads={"detector": "yunet"})
    with pytest.raises(VfoaError, match=r"fetch yunet rf-detr-seg-medium$"):  # heads alone have a replacement
        locate_weights(wanted)
    for here, options in [
        (
            "yolov8n-seg",
            " (AGPL-3.0): --set segmentation.model=yolo_seg --set segmentation.weights=yolov8n-seg_int8.onnx ",
        ),
        (
            "rf-detr-seg-nano",
            " (Apache-2.0): --set segmentation.model=rf_detr_seg --set segmentation.weights=rfdetr-seg-nano.onnx ",
        ),
    ]:
        (tmp_path / "given" / find_model(here).file).touch()
        with pytest.raises(VfoaError, match=re.escape(f"already{options}--set heads.detector=person_mask") + "$"):
            locate_weights(wanted)
    (stage,) = (each for each in ready_stages(STAGES["segmentation"]) if each.name == "yolo_seg")
    table = dict(setting.removeprefix("segmentation.").split("=") for setting in stage.settings)
    assert locate_weights(chosen(segmentation=table)).keys() == {"yolov8n-seg_int8.onnx"}


@pytest.mark.parametrize(
    ("cues", "is_advised"),
    [
        ({}, True),
        ({"gaze": {"model": "gaze360"}}, True),
        ({"gaze": {"model": "adas_0002"}}, False),
        ({"head_pose": {"model": "fsanet"}, "gaze": {"model": "gaze360"}}, False),
        ({"gaze": {"model": "l2cs"}}, False),
    ],
)
def test_heads_without_faces_are_not_advised_to_a_network_that_needs_a_face(
    cues: dict[str, dict[str, Any]], is_advised: bool
) -> None:
    heads = chosen(heads={"detector": "yunet"})
    together, apart = missing_weights([*heads, *chosen(**cues)]), missing_weights(heads, others=chosen(**cues))
    for missing in (together, apart):
        assert missing
        assert ("--set heads.detector=person_mask" in missing.alternatives) == is_advised


@pytest.mark.parametrize("here", [None, *catalogue()])
def test_what_is_advised_in_place_of_missing_weights_is_taken_and_needs_no_more(
    here: str | None, tmp_path: Path
) -> None:
    if here:
        (tmp_path / "given" / find_model(here).file).touch()
    (default,) = load_experiment("default", clips=("studio_table",)).configurations
    missing = missing_weights(default.stages)
    assert missing
    options = tuple(setting for stage in missing.instead if stage for setting in stage.settings)
    (changed,) = load_experiment("default", clips=("studio_table",), overrides=options).configurations
    left = missing_weights(changed.stages)
    replaced = sum(stage is not None for stage in missing.instead)
    assert len(left.instead if left else ()) == len(missing.instead) - replaced
    heads = changed.choices["heads"]
    assert heads
    assert STAGES["heads"].finds_faces(heads.name)


def test_the_list_says_what_is_here(tmp_path: Path) -> None:
    entry = find_model("fsanet-var")
    (tmp_path / "given" / entry.file).write_bytes(b"")
    rows = {line.split()[0]: line.split() for line in run("list").stdout.splitlines() if line.split()}
    assert rows.keys() >= catalogue().keys()
    assert ("yes" in rows["fsanet-var"], "yes" in rows["gaze360"]) == (True, False)
