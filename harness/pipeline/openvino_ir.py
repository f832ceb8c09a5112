"""Networks in OpenVINO's own format (IR), converted to ONNX: an .xml file of layers and a .bin file of constants.

The known layers are those of the Open Model Zoo's ADAS networks, and so are the attributes: ONNX's operators have the
values of all others without an attribute. All constants become float32 or int64: values of float16 stay exact, and ONNX
Runtime computes in float32.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from harness.files.io import read_bytes
from harness.files.parsing import parse_xml
from harness.pipeline.onnx_file import Node, Tensor, encode_model

_TYPES = {"f16": "<f2", "i64": "<i8", "u64": "<u8"}
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
_LARGEST = int(np.iinfo(np.int64).max)


def convert(layers: Path, constants: Path) -> bytes:
    """Convert a network, an .xml and a .bin file, to the content of an ONNX file. Inputs and outputs keep their names.

    The caller compares both files with their checksums: nothing in them is checked here.
    """
    root = parse_xml(read_bytes(layers), layers)
    network = _ConvertedNetwork(read_bytes(constants))
    for layer in _layers(root):
        network.add(layer)
    return network.encoded(root.get("name", ""))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layer:
    """A layer. ``inputs`` are the ports that give them; ``output`` is its own first port, and ``name`` that tensor's.

    A port is "layer:port", of their ids.
    """

    kind: str
    name: str
    attributes: Mapping[str, str]
    inputs: Sequence[str]
    input_shapes: Sequence[Sequence[int]]
    output: str

    def integers(self, key: str) -> tuple[int, ...]:
        """The integers of an attribute."""
        return _integers(self.attributes[key])


def _layers(root: Element) -> Iterator[_Layer]:
    sources = {
        f"{edge.get('to-layer')}:{edge.get('to-port')}": f"{edge.get('from-layer')}:{edge.get('from-port')}"
        for edge in root.iterfind("edges/edge")
    }
    for element in root.iterfind("layers/layer"):
        data, inputs, output = element.find("data"), element.findall("input/port"), element.find("output/port")
        port = {} if output is None else output.attrib
        yield _Layer(
            kind=element.attrib["type"],
            name=port.get("names", element.attrib["name"]).partition(",")[0],
            attributes={} if data is None else data.attrib,
            inputs=[sources[f"{element.get('id')}:{each.get('id')}"] for each in inputs],
            input_shapes=[_integers(",".join(length.text or "" for length in each.iterfind("dim"))) for each in inputs],
            output=f"{element.get('id')}:{port.get('id')}",
        )


def _integers(text: str) -> tuple[int, ...]:
    return tuple(int(number) for number in text.split(",") if number.strip())


class _ConvertedNetwork:
    """The converted part of a network."""

    def __init__(self, constants: bytes) -> None:
        self._content = constants
        self._names: dict[str, str] = {}
        self._tensors: dict[str, str] = {}
        """Tensors by the ports that give them, where they are not called as the port."""
        self._constants: dict[str, Tensor] = {}
        self._nodes: list[Node] = []
        self._inputs: dict[str, Sequence[int]] = {}
        self._outputs: dict[str, Sequence[int]] = {}

    def add(self, layer: _Layer) -> None:
        """Convert the next layer; those that give its inputs come before it."""
        self._names[layer.output] = layer.name
        match layer.kind:
            case "Parameter":
                self._inputs[layer.name] = layer.integers("shape")
                self._tensors[layer.output] = layer.name
            case "Result":
                name = self._names[layer.inputs[0]]
                self._nodes.append(Node(operator="Identity", inputs=[self._tensor(layer, 0)], outputs=[name]))
                self._outputs[name] = layer.input_shapes[0]
            case "Const":
                self._constants[layer.output] = self._read(layer)
            case "Convert":  # of a constant, which was widened when it was read
                self._tensors[layer.output] = self._tensor(layer, 0)
            case "Concat":
                self._operator(layer, "Concat", axis=int(layer.attributes["axis"]))
            case "Convolution":
                self._operator(layer, "Conv", **_window(layer))
            case "MatMul":  # Gemm, since MatMul of ONNX cannot transpose
                first, second = (int(layer.attributes[f"transpose_{each}"] == "true") for each in "ab")
                self._operator(layer, "Gemm", transA=first, transB=second)
            case "MaxPool":
                rounding = int(layer.attributes["rounding_type"] == "ceil")
                kernel = layer.integers("kernel")
                self._operator(layer, "MaxPool", kernel_shape=kernel, ceil_mode=rounding, **_window(layer))
            case "StridedSlice":
                self._strided_slice(layer)
            case kind:
                self._operator(layer, _SAME[kind])

    def encoded(self, name: str) -> bytes:
        """The network as the content of an ONNX file."""
        used = {tensor for node in self._nodes for tensor in node.inputs}
        return encode_model(
            name,
            nodes=self._nodes,
            inputs=self._inputs,
            outputs=self._outputs,
            constants={tensor: array for tensor, array in self._constants.items() if tensor in used},
        )

    def _operator(self, layer: _Layer, operator: str, *own: str, **attributes: int | Sequence[int]) -> None:
        """Add ONNX's operator for a layer. ``own``: tensors that it takes instead of the layer's inputs."""
        inputs = own or [self._tensor(layer, place) for place in range(len(layer.inputs))]
        self._nodes.append(Node(operator=operator, inputs=inputs, outputs=[layer.output], attributes=attributes))

    def _strided_slice(self, layer: _Layer) -> None:
        """A part of each axis. Where a mask is 1, the bound is ignored: the part goes as far as the axis."""
        starts, ends, steps = (self._constants[self._tensor(layer, place)] for place in (1, 2, 3))
        lists = {
            "starts": np.where(layer.integers("begin_mask"), 0, starts),
            "ends": np.where(layer.integers("end_mask"), _LARGEST, ends),
            "axes": np.arange(len(starts)),
            "steps": steps,
        }
        own = {f"{layer.output}:{name}": np.asarray(values, np.int64) for name, values in lists.items()}
        self._constants |= own
        self._operator(layer, "Slice", self._tensor(layer, 0), *own)

    def _read(self, layer: _Layer) -> Tensor:
        """A constant of the .bin file."""
        kind, offset, size = (layer.attributes[key] for key in ("element_type", "offset", "size"))
        array = np.frombuffer(self._content[int(offset) : int(offset) + int(size)], _TYPES[kind])
        array = array.reshape(layer.integers("shape"))
        return array.astype(np.float32) if kind == "f16" else array.astype(np.int64)

    def _tensor(self, layer: _Layer, place: int) -> str:
        """The tensor at this input of a layer."""
        port = layer.inputs[place]
        return self._tensors.get(port, port)


def _window(layer: _Layer) -> dict[str, Sequence[int]]:
    """The attributes of an operator that slides a window."""
    begin, end, strides = (layer.integers(key) for key in ("pads_begin", "pads_end", "strides"))
    return {"strides": strides, "pads": begin + end, "dilations": layer.integers("dilations")}
