"""The temporal network of Gaze360 (Kellnhofer et al. 2019), built in PyTorch and filled from the official checkpoint.

It estimates the gaze of the middle of seven head crops: ResNet-18 per crop, a bidirectional LSTM over the seven, and a
linear layer on its fourth step. The ONNX file takes ``images`` [B, 7, 3, 224, 224], RGB by ImageNet's mean and
deviation, and gives ``gaze`` [B, 2] = (theta, phi) and ``sigma`` [B, 1], all in radians: theta > 0 to the image's left,
phi > 0 up, sigma the distance to the 10 % and 90 % quantiles.
"""

from __future__ import annotations

import io
import math
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from harness.files.io import atomic_write, read_bytes
from vfoa.errors import VfoaError, first_line
from vfoa.gaze.gaze360 import SIDE_PX, SIGNATURE
from vfoa.onnx import Model, RuntimeSettings
from vfoa.weights import is_lfs_pointer


class BasicBlock(nn.Module):
    """Two 3 x 3 convolutions and a shortcut, which is a 1 x 1 convolution if the shape changes."""

    def __init__(self, channels_in: int, channels: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(channels_in, channels, 3, stride=stride, padding=1, bias=False)
        self.bn1 = nn.BatchNorm2d(channels)
        self.conv2 = nn.Conv2d(channels, channels, 3, padding=1, bias=False)
        self.bn2 = nn.BatchNorm2d(channels)
        self.downsample = nn.Identity()
        if stride != 1 or channels_in != channels:
            self.downsample = nn.Sequential(
                nn.Conv2d(channels_in, channels, 1, stride=stride, bias=False), nn.BatchNorm2d(channels)
            )

    def forward(self, x: Any) -> Any:
        """Features (B, channels_in, h, w) to (B, channels, h / stride, w / stride)."""
        residual = self.bn2(self.conv2(self.bn1(self.conv1(x)).relu()))
        return (residual + self.downsample(x)).relu()


class ResNet18(nn.Module):
    """An image to ``features`` numbers, through a hidden layer of 1000 (the size of ImageNet's classes).

    The attributes have the names of the tensors in the official checkpoint.
    """

    def __init__(self, features: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, 64, 7, stride=2, padding=3, bias=False)
        self.bn1 = nn.BatchNorm2d(64)
        self.maxpool = nn.MaxPool2d(3, stride=2, padding=1)
        self.layer1 = _stage(64, 64, stride=1)
        self.layer2 = _stage(64, 128, stride=2)
        self.layer3 = _stage(128, 256, stride=2)
        self.layer4 = _stage(256, 512, stride=2)
        self.fc1 = nn.Linear(512, 1000)
        self.fc2 = nn.Linear(1000, features)

    def forward(self, images: Any) -> Any:
        """Images (B, 3, H, W) to features (B, features)."""
        x = self.maxpool(self.bn1(self.conv1(images)).relu())
        x = self.layer4(self.layer3(self.layer2(self.layer1(x))))
        return self.fc2(self.fc1(x.mean(dim=(2, 3))).relu())


def _stage(channels_in: int, channels: int, *, stride: int) -> nn.Sequential:
    return nn.Sequential(BasicBlock(channels_in, channels, stride), BasicBlock(channels, channels, 1))


FRAMES = 7
FEATURES = 256
OPSET = 17
TOLERANCE_RAD = 1e-4
PROOF_BATCHES = (1, 2, 3, 4, 5, 5)
"""Batch sizes on which ONNX and PyTorch are compared: 20 inputs, of different batch sizes, since the size must be open.
"""

_PREFIX = "module."  # prefix of DataParallel, used in training
_COUNTER = ".num_batches_tracked"  # counts training steps; PyTorch before 0.4.1 did not save it


class Gaze360Network(nn.Module):
    """The network; its attributes have the names of the tensors in the official checkpoint."""

    def __init__(self) -> None:
        super().__init__()
        self.base_model = ResNet18(FEATURES)
        self.lstm = nn.LSTM(FEATURES, FEATURES, num_layers=2, bidirectional=True, batch_first=True)
        self.last_layer = nn.Linear(2 * FEATURES, 3)

    def forward(self, images: Any) -> tuple[Any, Any]:
        """Images (B, 7, 3, 224, 224) to gaze (B, 2) and sigma (B, 1) in radians."""
        features = self.base_model(images.flatten(0, 1)).unflatten(0, (-1, FRAMES))
        steps, _ = self.lstm(features)
        theta, phi, sigma = self.last_layer(steps[:, FRAMES // 2]).split(1, dim=1)
        gaze = torch.cat([math.pi * theta.tanh(), math.pi / 2 * phi.tanh()], dim=1)
        return gaze, math.pi * sigma.sigmoid()


def export(checkpoint: Path, out: Path) -> float:
    """Write the network of a checkpoint as ONNX, after checking that ONNX Runtime and PyTorch agree.

    Parameters
    ----------
    checkpoint
        The official file, or one with the same tensors.
    out
        The ONNX file. It is written or replaced atomically, and only after the check.

    Returns
    -------
    The greatest difference in radians between the two on 20 random inputs.

    Raises
    ------
    VfoaError
        If the checkpoint cannot be read, if one of its tensors is missing, unexpected or of a wrong shape, if the
        two differ by more than 1e-4 rad, or if the file cannot be written.
    """
    network = load(checkpoint)
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / "gaze360.onnx"
        _write_onnx(network, draft)
        difference_rad = _prove(network, draft, checkpoint)
        try:
            atomic_write(out, draft.read_bytes())
        except OSError as error:
            raise VfoaError(f"{out}: cannot be written: {error.strerror or error}") from None
    return difference_rad


def load(checkpoint: Path) -> Gaze360Network:
    """Build the network with the tensors of a checkpoint, ready for inference.

    Raises
    ------
    VfoaError
        If the checkpoint cannot be read, or if one of its tensors is missing, unexpected or of a wrong shape.
    """
    of_file = _read_tensors(checkpoint)
    network = Gaze360Network()
    expected = {_PREFIX + name: tensor for name, tensor in network.state_dict().items()}
    for name in dict.fromkeys((*expected, *of_file)):
        shape, wanted = (_shape(tensors.get(name)) for tensors in (of_file, expected))
        if shape != wanted and (name in of_file or not name.endswith(_COUNTER)):
            raise VfoaError(f"{checkpoint}: tensor {name}: found {shape}, expected {wanted}, as in Gaze360")
    network.load_state_dict({name.removeprefix(_PREFIX): tensor for name, tensor in (expected | of_file).items()})
    return network.eval()


def _read_tensors(checkpoint: Path) -> dict[str, Any]:
    content = read_bytes(checkpoint)
    if is_lfs_pointer(checkpoint):
        raise VfoaError(f"{checkpoint}: a Git LFS pointer; expected the checkpoint itself (fetch it with git lfs pull)")
    try:
        # A checkpoint is a pickle, and a pickle can run any code: here, PyTorch unpickles only tensors
        saved = torch.load(io.BytesIO(content), map_location="cpu", weights_only=True)
    except Exception as error:  # the errors of a damaged pickle have no common base class
        problem = f"cannot be loaded: {first_line(error)}"
        raise VfoaError(f"{checkpoint}: {problem}; expected a complete PyTorch checkpoint of tensors alone") from error
    tensors = saved.get("state_dict") if isinstance(saved, dict) else None
    if not isinstance(tensors, dict):
        what = f"the keys {', '.join(map(str, saved))}" if isinstance(saved, dict) else f"a {type(saved).__name__}"
        raise VfoaError(f"{checkpoint}: not Gaze360's checkpoint; expected the key state_dict, found {what}")
    return tensors


def _shape(tensor: Any) -> str:
    if tensor is None:
        return "nothing"
    return str(list(tensor.shape)) if isinstance(tensor, torch.Tensor) else type(tensor).__name__


def _write_onnx(network: Gaze360Network, path: Path) -> None:
    with warnings.catch_warnings():
        # Tracing needs no package beside onnx; PyTorch recommends its newer exporter
        warnings.filterwarnings("ignore", category=DeprecationWarning)
        # Tracing takes the LSTM's checks of its input for constants; the check below shows that the batch size is not
        # one
        warnings.filterwarnings("ignore", category=torch.jit.TracerWarning)
        warnings.filterwarnings("ignore", message="Exporting a model to ONNX with a batch_size other than 1")
        torch.onnx.export(
            network,
            (torch.zeros(1, FRAMES, 3, SIDE_PX, SIDE_PX),),
            str(path),
            input_names=list(SIGNATURE.inputs),
            output_names=list(SIGNATURE.outputs),
            dynamic_axes={name: {0: "batch"} for name in [*SIGNATURE.inputs, *SIGNATURE.outputs]},
            opset_version=OPSET,
            dynamo=False,
        )


def _prove(network: Gaze360Network, path: Path, checkpoint: Path) -> float:
    """Return the greatest difference in radians between ONNX Runtime and PyTorch; an error beyond the tolerance."""
    model = Model(str(path), SIGNATURE, RuntimeSettings())
    random = np.random.default_rng(0)
    greatest_rad = 0.0
    for size in PROOF_BATCHES:
        images = random.standard_normal((size, FRAMES, 3, SIDE_PX, SIDE_PX), dtype=np.float32)
        outputs = model.run(images=images)
        with torch.no_grad():
            expected = dict(zip(SIGNATURE.outputs, network(torch.from_numpy(images)), strict=True))
        difference_rad = max(float(np.abs(outputs[name] - expected[name].numpy()).max()) for name in expected)
        if not difference_rad <= TOLERANCE_RAD:  # NaN also counts as a difference
            raise VfoaError(
                f"{checkpoint}: ONNX and PyTorch differ by {difference_rad:.2g} rad; expected at most {TOLERANCE_RAD:g}"
            )
        greatest_rad = max(greatest_rad, difference_rad)
    return greatest_rad
