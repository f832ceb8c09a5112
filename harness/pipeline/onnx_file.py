"""ONNX files written without the ``onnx`` package: the few messages of its protobuf format that a network needs.

The same network gives the same bytes on every machine, so that the catalogue can have the checksum of a conversion.
Field numbers: ``onnx/onnx.proto`` of the ONNX project.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Tensor = NDArray[np.float32] | NDArray[np.int64]

_IR_VERSION, _OPSET = 8, 13
_FLOAT, _INT64 = 1, 7
"""Values of ``TensorProto.DataType``."""
_ATTRIBUTE_INT, _ATTRIBUTE_INTS = 2, 7
"""Values of ``AttributeProto.AttributeType``."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Node:
    """One operation of ONNX's operator set 13, with the names of the tensors that it takes and gives."""

    operator: str
    inputs: Sequence[str]
    outputs: Sequence[str]
    attributes: Mapping[str, int | Sequence[int]] = field(default_factory=dict)


def encode_model(
    name: str,
    *,
    nodes: Sequence[Node],
    inputs: Mapping[str, Sequence[int]],
    outputs: Mapping[str, Sequence[int]],
    constants: Mapping[str, Tensor],
) -> bytes:
    """Encode a network as an ONNX file's content.

    Parameters
    ----------
    name
        Name of the graph.
    nodes
        Its operations: each one after those that give its inputs.
    inputs, outputs
        Shapes of its float32 inputs and outputs, by name.
    constants
        Arrays of float32 or int64 that the operations take, by name.
    """
    graph = b"".join(
        [
            *(_message(1, _node(node)) for node in nodes),
            _text(2, name),
            *(_message(5, _tensor(tensor, array)) for tensor, array in constants.items()),
            *(_message(11, _value(tensor, shape)) for tensor, shape in inputs.items()),
            *(_message(12, _value(tensor, shape)) for tensor, shape in outputs.items()),
        ]
    )
    operators = _text(1, "") + _integer(2, _OPSET)
    return _integer(1, _IR_VERSION) + _text(2, "vfoa") + _message(7, graph) + _message(8, operators)


def _node(node: Node) -> bytes:
    return b"".join(
        [
            *(_text(1, tensor) for tensor in node.inputs),
            *(_text(2, tensor) for tensor in node.outputs),
            _text(4, node.operator),
            *(_message(5, _attribute(name, value)) for name, value in node.attributes.items()),
        ]
    )


def _attribute(name: str, value: int | Sequence[int]) -> bytes:
    if isinstance(value, int):
        return _text(1, name) + _integer(3, value) + _integer(20, _ATTRIBUTE_INT)
    return _text(1, name) + b"".join(_integer(8, each) for each in value) + _integer(20, _ATTRIBUTE_INTS)


def _tensor(name: str, array: Tensor) -> bytes:
    kind = _FLOAT if array.dtype == np.float32 else _INT64
    raw = array.astype(array.dtype.newbyteorder("<")).tobytes()
    return (
        b"".join(_integer(1, length) for length in array.shape) + _integer(2, kind) + _text(8, name) + _message(9, raw)
    )


def _value(name: str, shape: Sequence[int]) -> bytes:
    dimensions = b"".join(_message(1, _integer(1, length)) for length in shape)
    return _text(1, name) + _message(2, _message(1, _integer(1, _FLOAT) + _message(2, dimensions)))


def _integer(number: int, value: int) -> bytes:
    return _varint(number << 3) + _varint(value)


def _text(number: int, value: str) -> bytes:
    return _message(number, value.encode())


def _message(number: int, content: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    value &= (1 << 64) - 1  # negative integers are encoded as their two's complement
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*encoded, value])
