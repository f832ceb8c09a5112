"""Networks in OpenVINO's format: each layer against numpy, the published ADAS networks against another conversion."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from onnx import checker, load_from_string

from harness.pipeline.openvino_ir import convert
from harness.pipeline.weights import CatalogueEntry, check_model, fetch_model, find_model
from scripts.measure.mirror import frame_of, read_rgb
from tests.openvino import Ir, affine
from tests.scenes import square_box
from tests.web import Site
from vfoa.crops import CropCamera, center
from vfoa.errors import VfoaError
from vfoa.gaze.adas import HEAD_POSE, Adas0002
from vfoa.geometry import angle_between
from vfoa.heads.yunet import YuNet
from vfoa.onnx import Model, RuntimeSettings, blob
from vfoa.types import Gaze

ADAS = ("adas-0002", "adas-head-pose")


def at(site: Site, name: str, folder: Path) -> CatalogueEntry:
    """The catalogue's entry of a network, whose two files this site serves from a folder."""
    entry = find_model(name)
    assert entry.openvino is not None
    files = {}
    for suffix in ("xml", "bin"):
        file = getattr(entry.openvino, suffix)
        path = f"/{Path(entry.file).stem}.{suffix}"
        site.files[path] = (folder / path.lstrip("/")).read_bytes()
        files[suffix] = file.model_copy(update={"address": site.url(path)})
    return entry.model_copy(update={"openvino": entry.openvino.model_copy(update=files)})


def run(content: bytes, **inputs: np.ndarray) -> dict[str, np.ndarray]:
    checker.check_model(load_from_string(content), full_check=True)
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]
    return dict(zip(names, session.run(names, inputs), strict=True))


# The published networks


@pytest.fixture
def published(shared_models: Path) -> Path:
    folder = shared_models / "openvino_ir"
    if not folder.is_dir():
        pytest.skip(f"needs the networks in OpenVINO's format: no folder {folder}")
    return folder


def test_the_published_networks_are_fetched_and_converted(cache: Path, site: Site, published: Path) -> None:
    told: list[tuple[int, int | None]] = []
    for name in ADAS:
        entry = at(site, name, published)
        path = fetch_model(name, entry, accept_licence=False, progress=lambda *each: told.append(each))
        assert path == cache / entry.file
        verdict = check_model(name, entry, RuntimeSettings())
        assert (verdict.verdict, verdict.checksum_known, verdict.message) == ("ok", True, None)
        assert told[-1] == (told[-1][1], sum(len(site.files[f"/{path.stem}.{suffix}"]) for suffix in ("xml", "bin")))
        asked = len(site.asked)
        assert fetch_model(name, entry, accept_licence=False) == path
        assert len(site.asked) == asked
    assert {path.name for path in cache.iterdir()} == {find_model(name).file for name in ADAS}


def test_the_fetched_networks_answer_as_the_other_conversion_on_real_faces(
    cache: Path, site: Site, published: Path, shared_models: Path, shared_data: Path
) -> None:
    photographs = sorted((shared_data / "faces").glob("*.jpg"))
    if not photographs:
        pytest.skip(f"needs photographs of faces in {shared_data / 'faces'}")
    gaze, pose = (fetch_model(name, at(site, name, published), accept_licence=False) for name in ADAS)
    converted = Adas0002(Adas0002.Settings(weights=str(gaze), head_pose_weights=str(pose)))
    other = Adas0002(
        Adas0002.Settings(weights=str(shared_models / gaze.name), head_pose_weights=str(shared_models / pose.name))
    )
    poses = [Model(str(path), HEAD_POSE, RuntimeSettings()) for path in (pose, shared_models / pose.name)]
    yunet = YuNet(YuNet.Settings(weights=str(shared_models / "yunet_n_dynamic.onnx")))
    compared = 0
    for photograph in photographs:
        frame = frame_of(read_rgb(photograph))
        head = yunet.faces(frame)[0]
        face = blob(CropCamera.at(square_box(center(head.face_box_px), 200), frame.rig).image(frame, 60), bgr=True)
        own, reference = (network.run(data=face) for network in poses)
        for name in own:
            np.testing.assert_allclose(own[name], reference[name], atol=0.05)  # degrees: float16 at 64 is 0.03
        gazes = [model.estimate(frame, head, None) for model in (converted, other)]
        assert type(gazes[0]) is type(gazes[1])
        if isinstance(gazes[0], Gaze) and isinstance(gazes[1], Gaze):
            assert np.degrees(angle_between(gazes[0].direction, gazes[1].direction)) < 0.05
            compared += 1
    assert compared >= len(photographs) // 2


@pytest.mark.parametrize("suffix", ["xml", "bin"])
def test_a_wrong_checksum_leaves_no_network(cache: Path, site: Site, published: Path, suffix: str) -> None:
    entry = at(site, "adas-0002", published)
    path = f"/gaze-estimation-adas-0002.{suffix}"
    site.files[path] = site.files[path][:-1] + b"?"
    with pytest.raises(VfoaError, match=rf"adas-0002\.{suffix}: .*sha384 \w+"):
        fetch_model("adas-0002", entry, accept_licence=False)
    assert not (cache / entry.file).exists()


def test_another_conversion_is_not_installed(cache: Path, site: Site, tmp_path: Path) -> None:
    small = published_ir(site, tmp_path).model_copy(update={"sha256": "0" * 64})
    with pytest.raises(VfoaError, match="wrong checksum of the conversion"):
        fetch_model("small", small, accept_licence=False)
    assert list(cache.iterdir()) == []


def published_ir(site: Site, folder: Path) -> CatalogueEntry:
    """The entry of a small network that a site serves."""
    layers, constants = affine().write(folder / "small.xml")
    content = {path.suffix[1:]: path.read_bytes() for path in (layers, constants)}
    site.files |= {f"/small.{suffix}": data for suffix, data in content.items()}
    files = {
        suffix: {
            "address": site.url(f"/small.{suffix}"),
            "bytes": len(data),
            "sha384": hashlib.sha384(data).hexdigest(),
        }
        for suffix, data in content.items()
    }
    return CatalogueEntry.model_validate(
        {
            "file": "small.onnx",
            "task": "test",
            "licence": "MIT",
            "home": "https://example.org",
            "openvino": files,
            "sha256": hashlib.sha256(convert(layers, constants)).hexdigest(),
        }
    )


# Layers


def test_a_network_keeps_the_names_of_its_inputs_and_outputs(tmp_path: Path) -> None:
    content = convert(*affine().write(tmp_path / "small.xml"))
    outputs = run(content, values=np.float32([[1, 2, 4]]))
    assert {name: values.tolist() for name, values in outputs.items()} == {"scaled": [[3, 5, 9]]}


def test_layers_of_vectors(tmp_path: Path) -> None:
    ir = Ir()
    values = ir.parameter("values", 2, 3)
    matrix = np.float16([[1, 0, 2], [0, -1, 0.5]])
    product = ir.layer("MatMul", values, ir.constant(matrix), shape=(2, 2), transpose_a="false", transpose_b="true")
    positive = ir.layer("ReLU", product, shape=(2, 2))
    lower = ir.layer("Subtract", positive, ir.constant(np.full((1, 1), 0.25)), shape=(2, 2))
    both = ir.layer("Concat", lower, values, shape=(2, 5), axis=1)
    flat = ir.layer("Reshape", both, ir.constant([1, -1], "int64"), shape=(1, 10), special_zero="true")
    deep = ir.layer("Unsqueeze", flat, ir.constant([2], "int64"), shape=(1, 10, 1))
    bounds = [ir.constant(numbers, "int64") for numbers in ([7, 1, 0], [7, 9, 1], [1, 3, 1])]
    masks = {"begin_mask": "1, 0, 1", "end_mask": "1, 0, 0"}
    part = ir.layer("StridedSlice", deep, *bounds, shape=(1, 3, 1), new_axis_mask="", **masks)
    ir.layer("Result", ir.layer("Squeeze", part, ir.constant([2], "uint64"), shape=(1, 3), name="part"))
    given = np.float32([[1, -2, 3], [0, 4, -5]])
    expected = np.concatenate([np.maximum(given @ matrix.T.astype(np.float32), 0) - 0.25, given], 1).reshape(1, 10)
    outputs = run(convert(*ir.write(tmp_path / "vectors.xml")), values=given)
    np.testing.assert_array_equal(outputs["part"], expected[:, 1:9:3])


def test_layers_of_images(tmp_path: Path) -> None:
    ir = Ir()
    window = {"strides": "2, 2", "dilations": "1, 1", "auto_pad": "explicit"}
    image = ir.parameter("image", 1, 1, 4, 4)
    kernel = ir.constant(np.arange(4.0).reshape(1, 1, 2, 2))
    conv = ir.layer("Convolution", image, kernel, shape=(1, 1, 3, 2), pads_begin="1, 0", pads_end="1, 0", **window)
    ir.layer("Result", conv)
    pooled = ir.layer(
        "MaxPool",
        image,
        shape=(1, 1, 2, 2),
        name="pooled",
        kernel="3, 3",
        pads_begin="0, 0",
        pads_end="0, 0",
        rounding_type="ceil",
        **window,
    )
    ir.layer("Result", pooled)
    given = np.arange(16, dtype=np.float32).reshape(1, 1, 4, 4)
    outputs = run(convert(*ir.write(tmp_path / "images.xml")), image=given)
    rows = np.pad(given[0, 0], ((1, 1), (0, 0)))
    expected = [[(rows[y : y + 2, x : x + 2] * [[0, 1], [2, 3]]).sum() for x in (0, 2)] for y in (0, 2, 4)]
    np.testing.assert_array_equal(outputs[f"Convolution {conv}"][0, 0], expected)
    np.testing.assert_array_equal(outputs["pooled"][0, 0], [[10, 11], [14, 15]])
