from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner

from harness.cli.models import app
from vfoa.errors import VfoaError
from vfoa.gaze.gaze360 import SIGNATURE
from vfoa.onnx import Model, RuntimeSettings

torch = pytest.importorskip("torch", reason="needs PyTorch, the extra vfoa[export]: make export-extra")
from harness.pipeline.export import gaze360  # noqa: E402

Arrays = dict[str, NDArray[Any]]


def official_shapes() -> Iterator[tuple[str, tuple[int, ...]]]:
    """Name and shape of every tensor of the official checkpoint (github.com/erkil1452/gaze360), written out."""

    def batch_norm(name: str, channels: int) -> Iterator[tuple[str, tuple[int, ...]]]:
        yield from ((f"{name}.{part}", (channels,)) for part in ("weight", "bias", "running_mean", "running_var"))
        yield f"{name}.num_batches_tracked", ()

    base = "module.base_model"
    yield f"{base}.conv1.weight", (64, 3, 7, 7)
    yield from batch_norm(f"{base}.bn1", 64)
    channels_in = 64
    for layer, channels in enumerate((64, 128, 256, 512), start=1):
        for block in (0, 1):
            name = f"{base}.layer{layer}.{block}"
            yield f"{name}.conv1.weight", (channels, channels_in, 3, 3)
            yield from batch_norm(f"{name}.bn1", channels)
            yield f"{name}.conv2.weight", (channels, channels, 3, 3)
            yield from batch_norm(f"{name}.bn2", channels)
            if channels_in != channels:
                yield f"{name}.downsample.0.weight", (channels, channels_in, 1, 1)
                yield from batch_norm(f"{name}.downsample.1", channels)
            channels_in = channels
    for name, shape in {f"{base}.fc1": (1000, 512), f"{base}.fc2": (256, 1000), "module.last_layer": (3, 512)}.items():
        yield f"{name}.weight", shape
        yield f"{name}.bias", shape[:1]
    for layer, inputs in ((0, 256), (1, 512)):
        for way in ("", "_reverse"):
            yield f"module.lstm.weight_ih_l{layer}{way}", (4 * 256, inputs)
            yield f"module.lstm.weight_hh_l{layer}{way}", (4 * 256, 256)
            yield f"module.lstm.bias_ih_l{layer}{way}", (4 * 256,)
            yield f"module.lstm.bias_hh_l{layer}{way}", (4 * 256,)


def random_tensors(seed: int) -> Arrays:
    """Random weights that keep the signal's size from layer to layer; the means and variances are random too."""
    random = np.random.default_rng(seed)

    def fill(name: str, shape: tuple[int, ...]) -> NDArray[Any]:
        if name.endswith("num_batches_tracked"):
            return np.array(1000)
        if len(shape) > 1:
            return random.normal(0, np.sqrt(2 / np.prod(shape[1:])), shape).astype(np.float32)
        positive = name.endswith("running_var") or (name.endswith("weight") and len(shape) == 1)
        return (random.uniform(0.5, 1.5, shape) if positive else random.normal(0, 0.1, shape)).astype(np.float32)

    return {name: fill(name, shape) for name, shape in official_shapes()}


def save(path: Path, tensors: Arrays) -> Path:
    """A checkpoint as the authors' training wrote it: PyTorch's old format, and a score beside the tensors."""
    state = {name: torch.from_numpy(np.array(values)) for name, values in tensors.items()}
    content = {"epoch": 80, "state_dict": state, "best_prec1": torch.tensor(13.5)}
    torch.save(content, path, _use_new_zipfile_serialization=False)
    return path


def random_images(count: int, seed: int) -> NDArray[np.float32]:
    return np.random.default_rng(seed).standard_normal((count, 7, 3, 224, 224), dtype=np.float32)


def run_pytorch(network: Any, images: NDArray[np.float32]) -> NDArray[np.float32]:
    """Theta, phi and sigma of the first sequence."""
    with torch.no_grad():
        return torch.cat(network(torch.from_numpy(images.copy())), dim=1).numpy()[0]


@pytest.fixture(scope="module")
def tensors() -> Arrays:
    return random_tensors(seed=1)


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory, tensors: Arrays) -> Path:
    return save(tmp_path_factory.mktemp("gaze360") / "gaze360_model.pth.tar", tensors)


@pytest.fixture
def refused(tmp_path: Path) -> Any:
    """The message with which a checkpoint is refused; no file may have been written."""

    def message(checkpoint: Path) -> str:
        out = tmp_path / "refused" / "gaze360.onnx"
        with pytest.raises(VfoaError) as caught:
            gaze360.export(checkpoint, out)
        assert not out.parent.exists()
        text = str(caught.value)
        assert "\n" not in text
        return text

    return message


def test_onnx_and_pytorch_agree(checkpoint: Path, tmp_path: Path) -> None:
    out = tmp_path / "models" / "gaze360.onnx"
    told = CliRunner().invoke(
        app, ["export", "gaze360", "--checkpoint", str(checkpoint), "--out", str(out)], catch_exceptions=False
    )
    assert told.exit_code == 0
    line = re.fullmatch(rf"gaze360: {re.escape(str(out))}: ONNX and PyTorch differ by (\S+) rad .*\n", told.stdout)
    assert line
    assert float(line[1]) <= 1e-4
    assert sum(gaze360.PROOF_BATCHES) == 20
    assert [path.name for path in out.parent.iterdir()] == ["gaze360.onnx"]

    model, network = Model(str(out), SIGNATURE, RuntimeSettings()), gaze360.load(checkpoint)
    images = random_images(5, seed=100)
    outputs = model.run(images=images)
    found = np.hstack([outputs["gaze"], outputs["sigma"]])
    expected = [run_pytorch(network, images[i : i + 1]) for i in range(5)]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-4)
    assert np.ptp(found, axis=0).min() > 0.01  # the inputs matter: agreement is not that of two constants


def test_the_angles_are_those_of_the_paper(tensors: Arrays, tmp_path: Path) -> None:
    """A last layer without weights leaves its bias: theta = pi tanh, phi = pi/2 tanh, sigma = pi sigmoid."""
    bias = np.array([0.5, -1.0, 2.0], np.float32)
    blind = {"module.last_layer.weight": np.zeros((3, 512), np.float32), "module.last_layer.bias": bias}
    network = gaze360.load(save(tmp_path / "blind.pth.tar", tensors | blind))
    with torch.no_grad():
        gaze, sigma = network(torch.from_numpy(random_images(2, seed=0)))
    assert gaze.numpy() == pytest.approx(np.tile([np.pi * np.tanh(0.5), np.pi / 2 * np.tanh(-1)], (2, 1)), abs=1e-6)
    assert sigma.numpy() == pytest.approx(np.full((2, 1), np.pi / (1 + np.exp(-2))), abs=1e-6)


def test_the_gaze_is_that_of_the_middle_frame(tensors: Arrays, tmp_path: Path) -> None:
    """With the same weights in both directions of time, only the middle step is the same for reversed frames."""
    mirrored = dict(tensors)
    for name in [name for name in tensors if name.endswith("_reverse")]:
        forward = tensors[name.removesuffix("_reverse")]
        reads_both = name.endswith("weight_ih_l1_reverse")  # (forward, backward) of the layer below
        mirrored[name] = np.roll(forward, 256, axis=1) if reads_both else forward
    last = tensors["module.last_layer.weight"]
    mirrored["module.last_layer.weight"] = (last + np.roll(last, 256, axis=1)) / 2
    network = gaze360.load(save(tmp_path / "mirrored.pth.tar", mirrored))
    images = random_images(1, seed=0)
    ahead, back, shifted = (
        run_pytorch(network, frames) for frames in (images, images[:, ::-1], np.roll(images, 1, axis=1))
    )
    assert back == pytest.approx(ahead, abs=1e-5)
    assert shifted != pytest.approx(ahead, abs=1e-3)


def test_the_stages_of_the_residual_network_halve_the_image() -> None:
    """He et al. 2016, table 1: 112, 56, 56, 28, 14, 7 pixels on a side for an image of 224."""
    network = gaze360.Gaze360Network().base_model
    sides = []
    for name in ("conv1", "maxpool", "layer1", "layer2", "layer3", "layer4"):
        getattr(network, name).register_forward_hook(lambda module, inputs, output: sides.append(output.shape[-1]))
    with torch.no_grad():
        network(torch.zeros(1, 3, 224, 224))
    assert sides == [112, 56, 56, 28, 14, 7]


def test_nothing_is_written_where_the_two_differ(
    checkpoint: Path, tmp_path: Path, refused: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = gaze360.load(save(tmp_path / "other.pth.tar", random_tensors(seed=2)))
    write = gaze360._write_onnx
    monkeypatch.setattr(gaze360, "_write_onnx", lambda network, path: write(other, path))
    assert re.search(r"ONNX and PyTorch differ by \S+ rad; expected at most 0.0001", refused(checkpoint))


def test_a_place_that_cannot_be_written_is_named(
    checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gaze360, "_prove", lambda *arguments: 0.0)  # which is held above, and slow
    (tmp_path / "file").touch()
    out = tmp_path / "file" / "gaze360.onnx"
    with pytest.raises(VfoaError, match=f"^{re.escape(str(out))}: cannot be written: "):
        gaze360.export(checkpoint, out)


@pytest.mark.parametrize(
    "name",
    ["base_model.conv1.weight", "base_model.layer3.0.downsample.1.running_var", "lstm.bias_hh_l1_reverse"],
)
def test_a_missing_tensor_is_named(name: str, tensors: Arrays, tmp_path: Path, refused: Any) -> None:
    rest = {other: values for other, values in tensors.items() if other != f"module.{name}"}
    message = refused(save(tmp_path / "cut.pth.tar", rest))
    assert f"tensor module.{name}: found nothing, expected {list(tensors[f'module.{name}'].shape)}" in message


@pytest.mark.parametrize("name", ["module.attention.weight", "last_layer.bias", "module.base_model.layer1.2.bn1.bias"])
def test_an_extra_tensor_is_named(name: str, tensors: Arrays, tmp_path: Path, refused: Any) -> None:
    message = refused(save(tmp_path / "more.pth.tar", tensors | {name: np.zeros(3, np.float32)}))
    assert f"tensor {name}: found" in message


def test_a_tensor_of_another_shape_is_named(tensors: Arrays, tmp_path: Path, refused: Any) -> None:
    message = refused(
        save(tmp_path / "four.pth.tar", tensors | {"module.last_layer.weight": np.zeros((4, 512), np.float32)})
    )
    assert "tensor module.last_layer.weight: found [4, 512], expected [3, 512]" in message


def test_counters_of_training_steps_may_be_absent(tensors: Arrays, checkpoint: Path, tmp_path: Path) -> None:
    """Old PyTorch wrote none, and inference does not read them."""
    rest = {name: values for name, values in tensors.items() if not name.endswith("num_batches_tracked")}
    network, whole = gaze360.load(save(tmp_path / "old.pth.tar", rest)), gaze360.load(checkpoint)
    images = random_images(1, seed=0)
    assert np.array_equal(run_pytorch(network, images), run_pytorch(whole, images))


class Stranger:
    """Forbidden content of a checkpoint: something that is not a tensor, and would be made by calling it."""


def test_what_is_not_a_checkpoint_is_refused(checkpoint: Path, tmp_path: Path, refused: Any) -> None:
    path = tmp_path / "file.pth.tar"
    path.write_text("not a checkpoint\n" * 10)
    assert refused(path).startswith(f"{path}: cannot be loaded: ")
    path.write_bytes(checkpoint.read_bytes()[:-1000])
    assert refused(path).startswith(f"{path}: cannot be loaded: ")
    torch.save({"state_dict": {}, "optimizer": Stranger()}, path)
    assert refused(path).startswith(f"{path}: cannot be loaded: ")
    path.write_text("version https://git-lfs.github.com/spec/v1\n")
    assert f"{path}: a Git LFS pointer" in refused(path)
    torch.save({"epoch": 3, "weights": {}}, path)
    assert "expected the key state_dict, found the keys epoch, weights" in refused(path)
    torch.save([1.0], path)
    assert "expected the key state_dict, found a list" in refused(path)
    assert "no such file" in refused(tmp_path / "absent.pth.tar")
