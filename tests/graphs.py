"""Small ONNX graphs of known behaviour, with the signatures of real networks."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from onnx import NodeProto, TensorProto, helper, numpy_helper, save

Shape = tuple[int | str, ...]


def constant(
    path: Path, inputs: Mapping[str, Shape], outputs: Mapping[str, ArrayLike], integers: Collection[str] = ()
) -> str:
    """A graph that takes ``inputs``, ignores them and always gives ``outputs``; ``integers`` as int64."""
    arrays = {
        name: np.asarray(value, dtype=np.int64 if name in integers else np.float32) for name, value in outputs.items()
    }
    nodes = [constant_node(name, array) for name, array in arrays.items()]
    return write(path, nodes, inputs, {name: array.shape for name, array in arrays.items()}, integers)


def mean_color(path: Path, input_name: str, shape: Shape, output_name: str, factor: float) -> str:
    """A graph that answers ``factor`` times the mean of each channel of its input image: [1, channels]."""
    nodes = [
        helper.make_node("GlobalAveragePool", [input_name], ["pooled"]),
        helper.make_node("Flatten", ["pooled"], ["flat"]),
        constant_node("factor", np.float32(factor)),
        helper.make_node("Mul", ["flat", "factor"], [output_name]),
    ]
    return write(path, nodes, {input_name: shape}, {output_name: (1, shape[1])})


def yolo_seg(path: Path, output0: ArrayLike, size: int = 320) -> str:
    """A YOLO-seg graph: the given boxes, and prototypes 0, 1, 2 that say where the image is red, green and blue.

    A prototype is 20 (channel - 0.5), averaged over the 4 x 4 pixels it stands for; prototypes 3 to 31 are 0.
    """
    boxes = np.asarray(output0, dtype=np.float32)
    nodes = [
        constant_node("output0", boxes),
        helper.make_node("AveragePool", ["images"], ["pooled"], kernel_shape=[4, 4], strides=[4, 4]),
        constant_node("half", np.float32(0.5)),
        helper.make_node("Sub", ["pooled", "half"], ["centered"]),
        constant_node("twenty", np.float32(20)),
        helper.make_node("Mul", ["centered", "twenty"], ["colors"]),
        constant_node("pads", np.array([0, 0, 0, 0, 0, 29, 0, 0], np.int64)),
        helper.make_node("Pad", ["colors", "pads"], ["output1"]),
    ]
    shapes = {"output0": boxes.shape, "output1": (1, 32, size // 4, size // 4)}
    return write(path, nodes, {"images": (1, 3, size, size)}, shapes)


def seven_levels(path: Path) -> str:
    """A Gaze360 graph whose angles spell the crops it was shown, one hexadecimal digit each.

    A digit is the mean red of a crop, 0 to 15, by ImageNet's statistics: theta 16^4 has those of crops 0 to 3 and phi
    16^4 those of crops 4 to 6, the earliest first. Sigma is always 0.1. Means are taken to the 64th, so that the
    pictures of a head that hardly moves are told apart too.
    """
    places = np.zeros((7, 2), np.float32)
    places[:4, 0], places[4:, 1] = (16.0**-1, 16.0**-2, 16.0**-3, 16.0**-4), (16.0**-2, 16.0**-3, 16.0**-4)
    fineness = 64
    nodes = [
        constant_node("red", np.array(0)),
        helper.make_node("Gather", ["images", "red"], ["reds"], axis=2),
        helper.make_node("Cast", ["reds"], ["reds64"], to=TensorProto.DOUBLE),
        helper.make_node("ReduceMean", ["reds64"], ["means64"], axes=[2, 3], keepdims=0),
        helper.make_node("Cast", ["means64"], ["means"], to=TensorProto.FLOAT),
        constant_node("deviation", np.float32(58.395 * fineness)),
        helper.make_node("Mul", ["means", "deviation"], ["scaled"]),
        constant_node("mean", np.float32(123.675 * fineness)),
        helper.make_node("Add", ["scaled", "mean"], ["levels"]),
        helper.make_node("Round", ["levels"], ["digits"]),
        constant_node("places", places / fineness),
        helper.make_node("MatMul", ["digits", "places"], ["gaze"]),
        constant_node("sigma", np.array([[0.1]])),
    ]
    return write(path, nodes, {"images": (1, 7, 3, 224, 224)}, {"gaze": (1, 2), "sigma": (1, 1)})


def write(
    path: Path,
    nodes: list[NodeProto],
    inputs: Mapping[str, Shape],
    outputs: Mapping[str, Shape],
    integers: Collection[str] = (),
) -> str:
    """Save a graph and return its path. The versions are ones that every supported ONNX Runtime reads."""
    graph = helper.make_graph(
        nodes,
        "graph",
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in inputs.items()],
        [
            helper.make_tensor_value_info(name, TensorProto.INT64 if name in integers else TensorProto.FLOAT, shape)
            for name, shape in outputs.items()
        ],
    )
    model = helper.make_model(graph, ir_version=8, opset_imports=[helper.make_opsetid("", 17)])
    save(model, path)
    return str(path)


def constant_node(name: str, value: np.ndarray | np.generic) -> NodeProto:
    """A node that always gives ``value``; float64 becomes float32, as all graphs here are."""
    array = np.asarray(value)
    value = array.astype(np.float32) if array.dtype == np.float64 else array
    return helper.make_node("Constant", [], [name], value=numpy_helper.from_array(np.asarray(value)))
