"""3DDFA_V2's checkpoint (mb05_120x120.pth) converted to ONNX without PyTorch.

The file is in PyTorch's format before 1.6: four pickles (magic number, version, byte order, the arrays' descriptions),
a pickle of keys, then for each key the number of values as int64 and the values. Pickles can run any code: this reader
allows four names and replaces them by its own. The network is ``models/mobilenet_v1.py`` of its home with half of the
channels. Its output is cut to the 12 numbers of the pose, in their own units.
"""

from __future__ import annotations

import math
import pickle
from collections import OrderedDict
from collections.abc import Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from harness.files.io import read_bytes
from harness.pipeline.onnx_file import Node, Tensor, encode_model

_TYPES = {"FloatStorage": "<f4", "LongStorage": "<i8"}
"""numpy's types by those of PyTorch's storages."""

_MEAN = (
    *(0.00034926363, 2.5279013e-07, -6.875198e-07, 60.167957),
    *(-6.295513e-07, 0.00057572004, -5.0853912e-05, 74.2782),
    *(5.400917e-07, 6.5741384e-05, 0.00034420125, -66.67158),
)
_DEVIATION = (
    *(0.00017632153, 6.7379435e-05, 0.0004470849, 26.550232),
    *(0.0001231377, 4.4930217e-05, 7.923671e-05, 6.982563),
    *(0.0004350444, 0.0001231489, 0.00017400002, 20.80304),
)
"""Mean and standard deviation of the pose, row by row: the first 12 of ``configs/param_mean_std_62d_120x120.pkl``."""

_BLOCKS = ("dw2_1", "dw2_2", "dw3_1", "dw3_2", "dw4_1", "dw4_2", *(f"dw5_{n}" for n in range(1, 7)), "dw6")
_HALVED = ("dw2_2", "dw3_2", "dw4_2", "dw5_6")
"""Blocks with a stride of 2."""


def convert(checkpoint: Path) -> bytes:
    """Convert the checkpoint to the content of an ONNX file: ``input`` [1, 3, 120, 120] to ``param`` [1, 12].

    The caller compares the file with its checksum: nothing in it is checked here, but for what it may name.
    """
    return _encoded(_arrays(read_bytes(checkpoint)))


def _encoded(arrays: Mapping[str, Tensor]) -> bytes:
    network = _NodeList(arrays)
    tensor = network.convolution("input", "conv1", "bn1", stride=2)
    for block in _BLOCKS:
        stride = 2 if block in _HALVED else 1
        tensor = network.convolution(tensor, f"{block}.conv_dw", f"{block}.bn_dw", stride=stride)
        tensor = network.convolution(tensor, f"{block}.conv_sep", f"{block}.bn_sep")
    pooled = network.node("GlobalAveragePool", tensor, output="pooled")
    flat = network.node("Flatten", pooled, output="flat")
    pose = len(_MEAN)
    weight, bias = (
        network.constant(name, arrays[name][:pose]) for name in ("module.fc_param.weight", "module.fc_param.bias")
    )
    normalised = network.node("Gemm", flat, weight, bias, output="normalised", transB=1)
    scaled = network.node(
        "Mul", normalised, network.constant("deviation", np.array(_DEVIATION, np.float32)), output="scaled"
    )
    network.node("Add", scaled, network.constant("mean", np.array(_MEAN, np.float32)), output="param")
    return encode_model(
        "3ddfa_v2",
        nodes=network.nodes,
        inputs={"input": (1, 3, 120, 120)},
        outputs={"param": (1, pose)},
        constants=network.constants,
    )


class _NodeList:
    """The nodes and constants that were added."""

    def __init__(self, arrays: Mapping[str, Tensor]) -> None:
        self._arrays = arrays
        self.nodes: list[Node] = []
        self.constants: dict[str, Tensor] = {}

    def node(self, operator: str, *inputs: str, output: str, **attributes: int | Sequence[int]) -> str:
        """Add an operation; return its output."""
        self.nodes.append(Node(operator=operator, inputs=inputs, outputs=[output], attributes=attributes))
        return output

    def constant(self, name: str, array: Tensor) -> str:
        """Add a constant; return its name."""
        self.constants[name] = array
        return name

    def convolution(self, tensor: str, name: str, norm: str, *, stride: int = 1) -> str:
        """Add a convolution, its batch normalisation (epsilon 1e-5, the default of both) and a ReLU."""
        weight = self._arrays[f"module.{name}.weight"]
        size = weight.shape[-1]
        kernel = self.constant(f"{name}.weight", weight)
        groups = len(weight) if name.endswith("conv_dw") else 1
        window = {"kernel_shape": (size, size), "strides": (stride, stride), "pads": (size // 2,) * 4}
        folded = self.node("Conv", tensor, kernel, output=name, group=groups, **window)
        own = [
            self.constant(f"{norm}.{part}", self._arrays[f"module.{norm}.{part}"])
            for part in ("weight", "bias", "running_mean", "running_var")
        ]
        return self.node("Relu", self.node("BatchNormalization", folded, *own, output=norm), output=f"{norm}.relu")


# The checkpoint


class _Reader(pickle.Unpickler):
    """Reads the descriptions of arrays: (storage, shape), where a storage is (type, key)."""

    def find_class(self, module: str, name: str) -> Any:
        if module == "torch" and name in _TYPES:
            return name
        known = {("collections", "OrderedDict"): OrderedDict, ("torch._utils", "_rebuild_tensor_v2"): _described}
        if (module, name) not in known:
            raise pickle.UnpicklingError(f"found {module}.{name}, which no list of arrays needs")
        return known[module, name]

    def persistent_load(self, pid: Any) -> Any:
        _, kind, key, *_ = pid
        return kind, key


def _described(storage: Any, offset: int, shape: Sequence[int], *_: object) -> Any:
    return storage, shape


def _arrays(content: bytes) -> dict[str, Tensor]:
    """The arrays of a checkpoint by name: each of them whole and contiguous."""
    file = BytesIO(content)
    *_, described, keys = (_Reader(file).load() for _ in range(5))
    arrays, starts = described["state_dict"], {}
    sizes = {key: np.dtype(_TYPES[kind]).itemsize for (kind, key), _ in arrays.values()}
    for key in keys:
        length = int.from_bytes(file.read(8), "little")
        starts[key] = file.tell()
        file.seek(length * sizes[key], 1)
    return {
        name: np.frombuffer(content, _TYPES[kind], math.prod(shape), starts[key]).reshape(shape)
        for name, ((kind, key), shape) in arrays.items()
    }
