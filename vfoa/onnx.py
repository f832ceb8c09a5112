"""Networks through ONNX Runtime: sessions, providers, threads and checks. Only this file imports ONNX Runtime."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from vfoa.errors import VfoaError
from vfoa.settings import Settings
from vfoa.types import Float, Image
from vfoa.weights import is_lfs_pointer, locate

Provider = Literal["cpu", "cuda", "tensorrt", "openvino", "coreml"]
Shape = tuple[int | None, ...]

_PROVIDERS: dict[Provider, str] = {
    "cpu": "CPUExecutionProvider",
    "cuda": "CUDAExecutionProvider",
    "tensorrt": "TensorrtExecutionProvider",
    "openvino": "OpenVINOExecutionProvider",
    "coreml": "CoreMLExecutionProvider",
}
_PACKAGES: dict[Provider, str] = {
    "cuda": "onnxruntime-gpu",
    "tensorrt": "onnxruntime-gpu",
    "openvino": "onnxruntime-openvino",
}
"""The packages that provide the providers missing in the package onnxruntime."""

_FATAL = 4


@cache
def _runtime() -> ModuleType:
    """ONNX Runtime. It is not imported above: settings, and outputs from a cache, do not need it."""
    import onnxruntime

    if os.environ.get("ORT_DISABLE_TELEMETRY") == "1":
        onnxruntime.disable_telemetry_events()  # a module that was imported before vfoa
    return onnxruntime


def _runtime_errors() -> tuple[type[Exception], ...]:
    """ONNX Runtime's errors, which have no common base class."""
    from onnxruntime.capi import onnxruntime_pybind11_state

    values = vars(onnxruntime_pybind11_state).values()
    return tuple(error for error in values if isinstance(error, type) and issubclass(error, Exception))


class RuntimeSettings(Settings):
    """Where a network runs: provider and threads."""

    provider: Provider = "cpu"
    """Provider that the network runs on. If it is unavailable, the run fails: there is no fallback."""
    threads: int = Field(default=1, ge=1)
    """Threads of one inference. 1 gives the same results on every machine; processes work on frames in parallel."""


class OnnxSettings(RuntimeSettings):
    """Settings of a stage with one network."""

    weights: str
    """Path of the network, or a file's name in the folders of weights."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Signature:
    """The inputs and outputs that a graph must have: names and shapes, None for a length of any value.

    ``by_position``: names in the graph are ignored; its i-th input and output get the i-th name here. Otherwise the
    inputs must have exactly these names, and the outputs must include these. Tensors are float32, except the
    ``integers``, which are int64.
    """

    inputs: Mapping[str, Shape]
    outputs: Mapping[str, Shape]
    by_position: bool = False
    integers: frozenset[str] = frozenset()


class Model:
    """A network with a known signature. It is opened at its first use, and pickled as its settings.

    Parameters
    ----------
    weights
        A path, or a file's name in the folders of weights.
    signature
        The inputs and outputs that its graph must have.
    settings
        Provider and threads.

    Raises
    ------
    VfoaError
        If there is no such file. At the first use: if it is no model, another model, or fails on this provider.
    """

    def __init__(self, weights: str, signature: Signature, settings: RuntimeSettings) -> None:
        self.path = locate(weights)
        self._weights, self._signature, self._settings = weights, signature, settings
        self._opened: tuple[Any, dict[str, str], dict[str, str]] | None = None

    def __reduce__(self) -> tuple[type[Model], tuple[str, Signature, RuntimeSettings]]:
        return type(self), (self._weights, self._signature, self._settings)

    def run(self, **inputs: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
        """Run the network once: inputs and outputs by the names of the signature.

        Raises
        ------
        VfoaError
            If it cannot be opened (see :meth:`check`), or fails on these inputs.
        """
        session, graph_inputs, graph_outputs = self._open()
        try:
            tensors = session.run(list(graph_outputs.values()), {graph_inputs[name]: inputs[name] for name in inputs})
        except _runtime_errors() as error:
            given = ", ".join(f"{name} {_text(array.shape)}" for name, array in inputs.items())
            raise VfoaError(f"{self.path}: fails on {given}: {' '.join(str(error).split())}") from error
        return dict(zip(graph_outputs, tensors, strict=True))

    def input_shape(self, name: str) -> Shape:
        """Shape of an input in the graph; None for a length that the graph leaves open."""
        session, graph_inputs, _ = self._open()
        return next(_shape(node) for node in session.get_inputs() if node.name == graph_inputs[name])

    def provider(self) -> Provider:
        """The provider that the network runs on, from its settings."""
        session, *_ = self._open()
        return next(name for name, provider in _PROVIDERS.items() if provider == session.get_providers()[0])

    def check(self) -> None:
        """Open the model now, to find a wrong one before the first frame.

        Raises
        ------
        VfoaError
            If it is no model, another model, or fails on this provider.
        """
        self._open()

    def _open(self) -> tuple[Any, dict[str, str], dict[str, str]]:
        if self._opened is None:
            session = _session(self.path, self._settings)
            takes = _match(self.path, "input", self._signature.inputs, session.get_inputs(), self._signature)
            gives = _match(self.path, "output", self._signature.outputs, session.get_outputs(), self._signature)
            self._opened = session, takes, gives
        return self._opened


IMAGENET_MEAN: Float = np.array([123.675, 116.28, 103.53])
"""Mean of ImageNet's pixels, RGB, 0 to 255; most networks subtract it (see :func:`blob`)."""

IMAGENET_SCALE: Float = 1 / np.array([58.395, 57.12, 57.375])
"""One over the standard deviation of ImageNet's pixels, RGB, 0 to 255."""


def blob(*images: Image, bgr: bool, mean: float | Float = 0.0, scale: float | Float = 1.0) -> NDArray[np.float32]:
    """Convert RGB images (H, W, 3) of one size to a network's input (N, 3, H, W) float32: (value - mean) * scale.

    ``bgr`` puts the channels in the order blue, green, red; ``mean`` and ``scale`` are in that order too.
    """
    batch = np.stack(images)[..., ::-1] if bgr else np.stack(images)
    values = np.ascontiguousarray(batch.transpose(0, 3, 1, 2), dtype=np.float32)
    values -= np.reshape(np.float32(mean), (-1, 1, 1))
    values *= np.reshape(np.float32(scale), (-1, 1, 1))
    return values


def available_providers() -> list[Provider]:
    """Return the providers that this build of ONNX Runtime has."""
    available = _runtime().get_available_providers()
    return [name for name, its_name in _PROVIDERS.items() if its_name in available]


def check_provider(provider: Provider) -> None:
    """Raise an error if this build of ONNX Runtime does not have the provider.

    Raises
    ------
    VfoaError
        With the providers that it has, and the package that has ``provider``.
    """
    available = available_providers()
    if provider not in available:
        names = ", ".join(available)
        package = _PACKAGES.get(provider)
        install = f", or the package {package} in place of onnxruntime" if package else ""
        raise VfoaError(
            f"provider: {provider!r} is not in this build of ONNX Runtime; expected one of: {names}{install}"
        )


def _session(path: Path, settings: RuntimeSettings) -> Any:
    check_provider(settings.provider)
    provider = _PROVIDERS[settings.provider]
    if is_lfs_pointer(path):
        raise VfoaError(f"{path}: a Git LFS pointer; expected the model itself (fetch it with git lfs pull)")
    options = _runtime().SessionOptions()
    options.intra_op_num_threads = settings.threads
    options.inter_op_num_threads = 1
    options.use_deterministic_compute = True
    options.log_severity_level = _FATAL
    # Single nodes that an accelerator cannot run fall back to the CPU; a provider that fails as a whole is an error.
    providers = list(dict.fromkeys([provider, _PROVIDERS["cpu"]]))
    try:
        session = _runtime().InferenceSession(str(path), sess_options=options, providers=providers)
    except _runtime_errors() as error:
        reason = " ".join(str(error).split())
        raise VfoaError(f"{path}: not a complete ONNX model; expected one that ONNX Runtime loads: {reason}") from error
    if session.get_providers()[0] != provider:
        raise VfoaError(
            f"provider: {settings.provider!r} could not start on this machine; expected its device, its driver and its "
            'libraries (for "cuda": those of CUDA and cuDNN that onnxruntime-gpu names)'
        )
    return session


def _shape(node: Any) -> Shape:
    return tuple(length if isinstance(length, int) else None for length in node.shape)


def _match(
    path: Path, kind: str, expected: Mapping[str, Shape], nodes: list[Any], signature: Signature
) -> dict[str, str]:
    """Return the name of each expected tensor in the graph; an error names the expected and the found ones."""
    if signature.by_position:
        chosen = dict(zip(expected, nodes, strict=False))
        right = len(nodes) == len(expected)
    else:
        chosen = {node.name: node for node in nodes if node.name in expected}
        right = len(chosen) == len(expected) and (kind == "output" or len(nodes) == len(expected))
    types = {name: "tensor(int64)" if name in signature.integers else "tensor(float)" for name in expected}
    right = right and all(_fits(shape, types[name], chosen[name]) for name, shape in expected.items())
    if not right:
        wanted = ", ".join(f"{name} {_text(shape)} {types[name]}" for name, shape in expected.items())
        actual = ", ".join(f"{node.name} {_text(_shape(node))} {node.type}" for node in nodes)
        unnamed = " (any names)" if signature.by_position else ""
        raise VfoaError(f"{path}: another model's {kind}s; expected{unnamed} {wanted}, found {actual}")
    return {name: chosen[name].name for name in expected}


def _fits(expected: Shape, type_: str, node: Any) -> bool:
    actual = _shape(node)
    same = len(actual) == len(expected) and all(None in (m, n) or m == n for m, n in zip(actual, expected, strict=True))
    return same and node.type == type_


def _text(shape: Shape) -> str:
    return "[" + ", ".join("any" if length is None else str(length) for length in shape) + "]"
