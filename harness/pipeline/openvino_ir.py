"""Networks in OpenVINO's own format (IR), converted to ONNX: an .xml file of layers and a .bin file of constants.

The known layers are those of the Open Model Zoo's ADAS networks. All constants become float32 or int64: values of
float16 stay exact, and ONNX Runtime computes in float32.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from harness.files.io import read_bytes
from harness.files.parsing import parse_xml
from harness.pipeline.onnx_file import Node, Tensor, encode_model
from vfoa.errors import VfoaError

_TYPES = {"f16": "<f2", "f32": "<f4", "i32": "<i4", "i64": "<i8", "u64": "<u8"}
"""numpy's types by those of a Const layer."""
_SAME = {
    "Add": "Add",
    "Multiply": "Mul",
    "ReLU": "Relu",
    "Reshape": "Reshape",
    "Squeeze": "Squeeze",
    "Subtract": "Sub",
    "Unsqueeze": "Unsqueeze",
}
"""ONNX's operators by the layers that have the same inputs."""
_ASSUMED = {"auto_broadcast": "numpy", "auto_pad": "explicit", "axis": "0", "special_zero": "true"}
"""Values of attributes that ONNX's operators have without an attribute."""
_TAKEN = {"Concat": ("axis",)}
"""Attributes of these that are converted."""
_LARGEST = int(np.iinfo(np.int64).max)

Port = tuple[str, str]
"""Ids of a layer and of one of its ports."""


def convert(layers: Path, constants: Path) -> bytes:
    """Convert a network, an .xml and a .bin file, to the content of an ONNX file. Inputs and outputs keep their names.

    Raises
    ------
    VfoaError
        If a file cannot be read, a layer is unknown or has an unexpected attribute, or the .bin file is shorter than
        the layers say. The message names the file and the layer.
    """
    root = parse_xml(read_bytes(layers), layers)
    network = _ConvertedNetwork(constants)
    for layer in _layers(root, layers):
        network.add(layer)
    if not network.outputs:
        raise VfoaError(f"{layers}: found no layer of type Result; expected a network in OpenVINO's format")
    return network.encoded(root.get("name", ""))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layer:
    """A layer. ``inputs`` are the ports that give them, ``outputs`` the names of its own output ports."""

    path: Path
    kind: str
    name: str
    attributes: Mapping[str, str]
    inputs: Sequence[Port]
    input_shapes: Sequence[Sequence[int]]
    outputs: Mapping[Port, str]

    def error(self, problem: str) -> VfoaError:
        return VfoaError(f"{self.path}: layer {self.name!r} ({self.kind}): {problem}")

    def integers(self, key: str, *, length: int | None = None) -> tuple[int, ...]:
        """The integers of an attribute, none if it is missing or empty; ``length``: how many are expected."""
        text = self.attributes.get(key, "")
        try:
            numbers = _integers(text)
        except ValueError:
            raise self.error(f"{key}: found {text!r}; expected integers") from None
        if length not in (None, len(numbers)):
            raise self.error(f"{key}: found {text!r}; expected {length} integer")
        return numbers

    def one_of(self, key: str, values: Mapping[str, int], default: str) -> int:
        """The integer that an attribute's value stands for."""
        value = self.attributes.get(key, default)
        if value not in values:
            raise self.error(f"{key}: found {value!r}; expected one of {', '.join(values)}")
        return values[value]


def _layers(root: Element, path: Path) -> Iterator[_Layer]:
    sources = {
        (edge.get("to-layer", ""), edge.get("to-port", "")): (edge.get("from-layer", ""), edge.get("from-port", ""))
        for edge in root.iterfind("edges/edge")
    }
    for element in root.iterfind("layers/layer"):
        own, name, data = element.get("id", ""), element.get("name", ""), element.find("data")
        taken = element.findall("input/port")
        try:
            shapes = [_integers(",".join(length.text or "" for length in port.iterfind("dim"))) for port in taken]
        except ValueError:
            raise VfoaError(f"{path}: layer {name!r}: an input without a fixed size; expected integers (dim)") from None
        yield _Layer(
            path=path,
            kind=element.get("type", ""),
            name=name,
            attributes={} if data is None else data.attrib,
            inputs=[sources.get((own, port.get("id", "")), ("", "")) for port in taken],
            input_shapes=shapes,
            outputs={
                (own, port.get("id", "")): port.get("names", name).partition(",")[0]
                for port in element.iterfind("output/port")
            },
        )


def _integers(text: str) -> tuple[int, ...]:
    """Integers between commas; a :class:`ValueError` for anything else, and for those that int64 cannot hold."""
    numbers = tuple(int(number) for number in text.split(",") if number.strip())
    if any(abs(number) > _LARGEST for number in numbers):
        raise ValueError
    return numbers


class _ConvertedNetwork:
    """The converted part of a network."""

    def __init__(self, constants: Path) -> None:
        self._content_path, self._content = constants, read_bytes(constants)
        self._tensors: dict[Port, str] = {}
        self._published: dict[Port, str] = {}
        self._constants: dict[str, Tensor] = {}
        self._nodes: list[Node] = []
        self._inputs: dict[str, Sequence[int]] = {}
        self.outputs: dict[str, Sequence[int]] = {}

    def add(self, layer: _Layer) -> None:
        """Convert the next layer; those that give its inputs come before it."""
        self._published |= layer.outputs
        for key, value in _ASSUMED.items():
            if key not in _TAKEN.get(layer.kind, ()) and layer.attributes.get(key, value) != value:
                raise layer.error(f"{key}: found {layer.attributes[key]!r}; expected {value!r}")
        if layer.kind in _SAME:
            self.operator(layer, _SAME[layer.kind])
        elif layer.kind in _CONVERTERS:
            _CONVERTERS[layer.kind](self, layer)
        else:
            known = ", ".join(sorted([*_SAME, *_CONVERTERS]))
            raise layer.error(f"unknown kind of layer; expected one of {known}")

    def encoded(self, name: str) -> bytes:
        """The network as the content of an ONNX file."""
        used = {tensor for node in self._nodes for tensor in node.inputs}
        return encode_model(
            name,
            nodes=self._nodes,
            inputs=self._inputs,
            outputs=self.outputs,
            constants={tensor: array for tensor, array in self._constants.items() if tensor in used},
        )

    def operator(self, layer: _Layer, operator: str, *own: str, **attributes: int | Sequence[int]) -> None:
        """Add ONNX's operator for a layer. ``own``: tensors that it takes instead of the layer's inputs."""
        inputs = own or [self.tensor(layer, place) for place in range(len(layer.inputs))]
        output = self._output(layer)
        self._nodes.append(Node(operator=operator, inputs=inputs, outputs=[output], attributes=attributes))

    def list_of(self, layer: _Layer, name: str, values: Sequence[int]) -> str:
        """Add a constant list of int64 that a layer takes in ONNX; return its tensor."""
        tensor = f"{self._output(layer)}:{name}"
        self._constants[tensor] = np.array(values, np.int64)
        return tensor

    def constant(self, layer: _Layer) -> None:
        """Read a constant of the .bin file."""
        kind = layer.attributes.get("element_type", "")
        if kind not in _TYPES:
            raise layer.error(f"element_type: found {kind!r}; expected one of {', '.join(_TYPES)}")
        shape = layer.integers("shape")
        (offset,), (size,) = (layer.integers(key, length=1) for key in ("offset", "size"))
        if offset < 0 or min(shape, default=1) < 1 or size != math.prod(shape) * np.dtype(_TYPES[kind]).itemsize:
            raise layer.error(f"found {size} bytes at {offset}; expected those of {kind} {list(shape)}")
        if offset + size > len(self._content):
            raise layer.error(
                f"{self._content_path} is truncated: found {len(self._content)} bytes; expected {offset + size} or more"
            )
        array = np.frombuffer(self._content[offset : offset + size], _TYPES[kind]).reshape(shape)
        self._constants[self._output(layer)] = _widened(array)

    def convert(self, layer: _Layer) -> None:
        """Pass a constant on unchanged: it was widened when it was read."""
        tensor = self.tensor(layer, 0)
        wanted = layer.attributes.get("destination_type")
        kind = {"float32": "f32", "int64": "i64"}[self.value(layer, 0).dtype.name]
        if wanted != kind:
            raise layer.error(f"destination_type: found {wanted!r}; expected {kind!r}")
        self._tensors[self._port(layer)] = tensor

    def parameter(self, layer: _Layer) -> None:
        """Add an input of the network."""
        if (kind := layer.attributes.get("element_type")) != "f32":
            raise layer.error(f"element_type: found {kind!r}; expected 'f32'")
        name = layer.outputs[self._port(layer)]
        self._check_new(layer, name)
        self._inputs[name] = layer.integers("shape")
        self._tensors[self._port(layer)] = name

    def result(self, layer: _Layer) -> None:
        """Add an output of the network, under the name of the tensor that it is."""
        tensor = self.tensor(layer, 0)
        name = self._published[layer.inputs[0]]
        self._check_new(layer, name)
        self._nodes.append(Node(operator="Identity", inputs=[tensor], outputs=[name]))
        self.outputs[name] = layer.input_shapes[0]

    def value(self, layer: _Layer, place: int) -> Tensor:
        """The value of an input that must be a constant."""
        tensor = self.tensor(layer, place)
        if tensor not in self._constants:
            raise layer.error(f"input {place}: found a computed tensor; expected a constant")
        return self._constants[tensor]

    def integers(self, layer: _Layer, place: int) -> list[int]:
        """The integers of an input that must be a constant list of them."""
        array = self.value(layer, place)
        if array.dtype != np.int64 or array.ndim != 1:
            raise layer.error(
                f"input {place}: found {array.dtype} of {array.ndim} dimensions; expected a list of int64"
            )
        return [int(value) for value in array]

    def tensor(self, layer: _Layer, place: int) -> str:
        """The tensor at this input of a layer."""
        port = layer.inputs[place] if place < len(layer.inputs) else None
        if port not in self._tensors:
            raise layer.error(f"input {place}: found nothing; expected the output of a layer before it")
        return self._tensors[port]

    def _output(self, layer: _Layer) -> str:
        """Name the tensor of a layer's first output: no other one is converted."""
        port = self._port(layer)
        self._tensors[port] = ":".join(port)
        return self._tensors[port]

    def _port(self, layer: _Layer) -> Port:
        if not layer.outputs:
            raise layer.error("found no output; expected one")
        return next(iter(layer.outputs))

    def _check_new(self, layer: _Layer, name: str) -> None:
        if name in self._inputs or name in self.outputs:
            raise layer.error(f"another input or output is called {name!r}; expected unique names")


def _convolution(network: _ConvertedNetwork, layer: _Layer) -> None:
    network.operator(layer, "Conv", **_window(layer))


def _max_pool(network: _ConvertedNetwork, layer: _Layer) -> None:
    rounding = layer.one_of("rounding_type", {"floor": 0, "ceil": 1}, "floor")
    network.operator(layer, "MaxPool", kernel_shape=layer.integers("kernel"), ceil_mode=rounding, **_window(layer))


def _window(layer: _Layer) -> dict[str, Sequence[int]]:
    """The attributes of an operator that slides a window."""
    begin, end, strides = (layer.integers(key) for key in ("pads_begin", "pads_end", "strides"))
    return {"strides": strides, "pads": begin + end, "dilations": layer.integers("dilations")}


def _mat_mul(network: _ConvertedNetwork, layer: _Layer) -> None:
    """A product of matrices: Gemm, since MatMul of ONNX cannot transpose."""
    if any(len(shape) != 2 for shape in layer.input_shapes):
        raise layer.error("found a product of arrays; expected one of two matrices")
    first, second = (layer.one_of(f"transpose_{each}", {"false": 0, "true": 1}, "false") for each in "ab")
    network.operator(layer, "Gemm", transA=first, transB=second)


def _concat(network: _ConvertedNetwork, layer: _Layer) -> None:
    (axis,) = layer.integers("axis", length=1)
    network.operator(layer, "Concat", axis=axis)


def _strided_slice(network: _ConvertedNetwork, layer: _Layer) -> None:
    """A part of each axis. Where a mask is 1, the bound is ignored: the part goes as far as the axis."""
    for key in ("new_axis_mask", "shrink_axis_mask", "ellipsis_mask"):
        if any(layer.integers(key)):
            raise layer.error(f"{key}: found {layer.attributes[key]!r}; expected zeros")
    bounds = [network.integers(layer, place) for place in (1, 2, 3)]
    begin_mask, end_mask = layer.integers("begin_mask"), layer.integers("end_mask")
    if len({len(each) for each in (*bounds, begin_mask, end_mask)}) != 1 or min(bounds[2], default=1) < 1:
        raise layer.error("expected bounds and masks of the same length, and steps of 1 or more")
    starts = [0 if open_ else start for start, open_ in zip(bounds[0], begin_mask, strict=True)]
    ends = [_LARGEST if open_ else end for end, open_ in zip(bounds[1], end_mask, strict=True)]
    axes = range(len(starts))
    lists = {"starts": starts, "ends": ends, "axes": axes, "steps": bounds[2]}
    whole = network.tensor(layer, 0)
    network.operator(layer, "Slice", whole, *(network.list_of(layer, name, list_) for name, list_ in lists.items()))


def _widened(array: NDArray[Any]) -> Tensor:
    return array.astype(np.float32) if array.dtype.kind == "f" else array.astype(np.int64)


_CONVERTERS: Mapping[str, Callable[[_ConvertedNetwork, _Layer], None]] = {
    "Concat": _concat,
    "Const": _ConvertedNetwork.constant,
    "Convert": _ConvertedNetwork.convert,
    "Convolution": _convolution,
    "MatMul": _mat_mul,
    "MaxPool": _max_pool,
    "Parameter": _ConvertedNetwork.parameter,
    "Result": _ConvertedNetwork.result,
    "StridedSlice": _strided_slice,
}
