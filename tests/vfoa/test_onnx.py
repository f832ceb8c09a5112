from __future__ import annotations

import pickle
import sys
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from onnx import helper

from tests import graphs
from vfoa.errors import VfoaError
from vfoa.gaze import MODELS as GAZES
from vfoa.head_pose import MODELS as HEAD_POSES
from vfoa.heads import DETECTORS
from vfoa.onnx import Model, RuntimeSettings, Signature, blob, check_provider
from vfoa.registry import Registry
from vfoa.segmentation import SEGMENTERS
from vfoa.stereo import MATCHERS

SIGNATURE = Signature(inputs={"image": (1, 3, 8, 8)}, outputs={"angles": (1, 3)})


@pytest.fixture
def weights(tmp_path: Path) -> str:
    return graphs.mean_color(tmp_path / "model.onnx", "image", (1, 3, 8, 8), "angles", 2.0)


def open_model(weights: str, signature: Signature = SIGNATURE) -> Model:
    model = Model(weights, signature, RuntimeSettings())
    model.check()
    return model


def test_runs_by_the_names_of_the_signature(weights: str) -> None:
    image = np.broadcast_to(np.float32([1, 2, 3])[None, :, None, None], (1, 3, 8, 8))
    found = open_model(weights).run(image=np.ascontiguousarray(image))
    np.testing.assert_allclose(found["angles"], [[2, 4, 6]])


def test_travels_to_another_process_open_or_not(weights: str) -> None:
    image = np.ones((1, 3, 8, 8), np.float32)
    for model in (Model(weights, SIGNATURE, RuntimeSettings()), open_model(weights)):
        copy = pickle.loads(pickle.dumps(model))
        np.testing.assert_array_equal(copy.run(image=image)["angles"], model.run(image=image)["angles"])


def test_finds_tensors_by_position_where_names_mean_nothing(weights: str) -> None:
    signature = Signature(inputs={"face": (1, 3, 8, 8)}, outputs={"points": (1, 3)}, by_position=True)
    found = open_model(weights, signature).run(face=np.ones((1, 3, 8, 8), np.float32))
    np.testing.assert_allclose(found["points"], [[2, 2, 2]])


def test_an_open_length_fits_any_and_is_told(tmp_path: Path) -> None:
    weights = graphs.mean_color(tmp_path / "model.onnx", "image", (1, 3, "height", "width"), "angles", 1.0)
    assert open_model(weights).input_shape("image") == (1, 3, None, None)
    wide = Signature(inputs={"image": (None, 3, None, None)}, outputs={"angles": (None, None)})
    assert open_model(weights, wide).run(image=np.ones((1, 3, 5, 9), np.float32))["angles"].shape == (1, 3)


@pytest.mark.parametrize(
    ("signature", "expected", "found"),
    [
        (Signature(inputs={"data": (1, 3, 8, 8)}, outputs={"angles": (1, 3)}), "data [1, 3, 8, 8]", "image"),
        (Signature(inputs={"image": (1, 3, 64, 64)}, outputs={"angles": (1, 3)}), "image [1, 3, 64, 64]", "8, 8"),
        (Signature(inputs={"image": (1, 3, 8)}, outputs={"angles": (1, 3)}), "image [1, 3, 8]", "[1, 3, 8, 8]"),
        (Signature(inputs={"image": (1, 3, 8, 8)}, outputs={"gaze": (1, 3)}), "gaze [1, 3]", "angles [1, 3]"),
        (Signature(inputs={"image": (1, 3, 8, 8)}, outputs={"angles": (None, 2)}), "angles [any, 2]", "[1, 3]"),
        (
            Signature(inputs={"a": (1, 3, 8, 8), "b": (1, 3)}, outputs={"angles": (1, 3)}, by_position=True),
            "b [1, 3]",
            "image [1, 3, 8, 8]",
        ),
    ],
)
def test_another_models_signature_is_one_clear_line(
    weights: str, signature: Signature, expected: str, found: str
) -> None:
    with pytest.raises(VfoaError) as caught:
        open_model(weights, signature)
    message = str(caught.value)
    said, _, was = message.partition(", found ")
    assert weights in message
    assert "\n" not in message
    assert expected in said
    assert found in was


def test_integers_are_taken_where_the_signature_has_them(tmp_path: Path) -> None:
    weights = graphs.constant(tmp_path / "labels.onnx", {"image": (1,)}, {"labels": [1, 47]}, integers={"labels"})
    floats = Signature(inputs={"image": (1,)}, outputs={"labels": (2,)})
    integers = Signature(inputs={"image": (1,)}, outputs={"labels": (2,)}, integers=frozenset({"labels"}))
    assert open_model(weights, integers).run(image=np.zeros(1, np.float32))["labels"].tolist() == [1, 47]
    with pytest.raises(VfoaError, match=r"labels \[2\].*float.*labels \[2\].*int64"):
        open_model(weights, floats)


def test_a_network_that_fails_is_one_clear_line(tmp_path: Path) -> None:
    nodes = [graphs.constant_node("two", np.ones((2, 2))), helper.make_node("MatMul", ["image", "two"], ["angles"])]
    weights = graphs.write(tmp_path / "model.onnx", nodes, {"image": (1, "n")}, {"angles": (1, 2)})
    model = open_model(weights, Signature(inputs={"image": (1, None)}, outputs={"angles": (1, 2)}))
    with pytest.raises(VfoaError, match=r"model\.onnx: fails on image \[1, 3\]: ") as caught:
        model.run(image=np.ones((1, 3), np.float32))
    assert "\n" not in str(caught.value)
    assert model.provider() == "cpu"


def test_a_missing_file_is_said_when_the_stage_is_built(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"absent\.onnx: no such model file"):
        Model(str(tmp_path / "absent.onnx"), SIGNATURE, RuntimeSettings())


def test_every_truncation_is_one_clear_line(weights: str) -> None:
    whole = Path(weights).read_bytes()
    for length in range(0, len(whole), 7):
        Path(weights).write_bytes(whole[:length])
        with pytest.raises(VfoaError) as caught:
            open_model(weights)
        assert str(caught.value).startswith(weights)
        assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 1\n", "Git LFS pointer"),
        (b"<!DOCTYPE html><html>Not found</html>", "not a complete ONNX model"),
        (bytes(range(256)) * 40, "not a complete ONNX model"),
    ],
)
def test_what_is_no_model_is_one_clear_line(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "model.onnx"
    path.write_bytes(content)
    with pytest.raises(VfoaError, match=said) as caught:
        open_model(str(path))
    assert "\n" not in str(caught.value)


def test_a_provider_that_is_not_there_is_an_error(weights: str) -> None:
    absent = "tensorrt" if sys.platform == "darwin" else "coreml"
    model = Model(weights, SIGNATURE, RuntimeSettings.model_validate({"provider": absent}))
    with pytest.raises(VfoaError, match=f"provider: '{absent}'.*cpu"):
        model.check()


@pytest.mark.parametrize("registry", [MATCHERS, SEGMENTERS, DETECTORS, HEAD_POSES, GAZES], ids=lambda each: each.kind)
def test_every_stage_with_weights_runs_on_a_provider(registry: Registry) -> None:
    settings = [registry.load(name).Settings for name in registry.names()]
    networks = [setting for setting in settings if any("weights" in name for name in setting.model_fields)]
    assert networks
    assert all(issubclass(network, RuntimeSettings) for network in networks)


def test_a_missing_gpu_build_names_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("onnxruntime.get_available_providers", lambda: ["CPUExecutionProvider"])
    with pytest.raises(VfoaError) as caught:
        check_provider("cuda")
    assert str(caught.value) == (
        "provider: 'cuda' is not in this build of ONNX Runtime; "
        "expected one of: cpu, or the package onnxruntime-gpu in place of onnxruntime"
    )
    check_provider("cpu")


def test_a_provider_that_does_not_start_is_an_error(weights: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A GPU build on a machine without GPU: ONNX Runtime only warns, and takes the CPU."""
    both = ["CUDAExecutionProvider", "CPUExecutionProvider"]
    monkeypatch.setattr("onnxruntime.get_available_providers", lambda: both)
    on_cpu = onnxruntime.InferenceSession
    monkeypatch.setattr(
        "onnxruntime.InferenceSession",
        lambda path, sess_options, providers: on_cpu(path, sess_options=sess_options, providers=providers[1:]),
    )
    with pytest.raises(VfoaError, match="provider: 'cuda' "):
        Model(weights, SIGNATURE, RuntimeSettings(provider="cuda")).check()


def test_a_blob_has_the_channels_first_in_the_order_asked_for() -> None:
    image = np.zeros((2, 4, 3), np.uint8)
    image[...] = [10, 20, 30]
    rgb = blob(image, bgr=False, scale=1 / 10)
    np.testing.assert_allclose(rgb[0, :, 1, 3], [1, 2, 3])
    bgr = blob(image, image, bgr=True, mean=10)
    assert bgr.shape == (2, 3, 2, 4)
    np.testing.assert_allclose(bgr[1, :, 0, 0], [20, 10, 0])
