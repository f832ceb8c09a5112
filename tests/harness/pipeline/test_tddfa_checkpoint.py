"""3DDFA_V2's checkpoint: a small one written as PyTorch did before 1.6, and the published one."""

from __future__ import annotations

import hashlib
import json
import pickle
import sys
from collections import OrderedDict
from io import BytesIO
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import onnxruntime
import pytest
from onnx import checker, load_from_string

from harness.pipeline.tddfa_checkpoint import convert
from harness.pipeline.weights import CatalogueEntry, check_model, fetch_model, find_model
from scripts.measure.mirror import frame_of, read_rgb
from tests.web import Site
from vfoa.errors import VfoaError
from vfoa.geometry import angle_between
from vfoa.head_pose.tddfa_v2 import TddfaV2
from vfoa.heads.yunet import YuNet
from vfoa.onnx import RuntimeSettings

CHANNELS = {
    "dw2_1": (16, 32),
    "dw2_2": (32, 64),
    "dw3_1": (64, 64),
    "dw3_2": (64, 128),
    "dw4_1": (128, 128),
    "dw4_2": (128, 256),
    **{f"dw5_{n}": (256, 256) for n in range(1, 6)},
    "dw5_6": (256, 512),
    "dw6": (512, 512),
}
"""Channels into and out of each block, as in the published network."""


class Storage:
    """An array of PyTorch's that knows its key."""

    def __init__(self, key: str, array: np.ndarray) -> None:
        self.key, self.array = key, array


class Tensor:
    """A tensor as PyTorch pickles it."""

    def __init__(self, key: str, array: np.ndarray) -> None:
        self.storage, self.array = Storage(key, array), array

    def __reduce__(self) -> tuple[Any, tuple[Any, ...]]:
        strides = tuple(step // self.array.itemsize for step in self.array.strides)
        return sys.modules["torch._utils"]._rebuild_tensor_v2, (self.storage, 0, self.array.shape, strides, False, None)


@pytest.fixture
def torch(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """The names of PyTorch that a checkpoint has."""
    module, private = ModuleType("torch"), ModuleType("torch._utils")
    for owner, name in ((module, "FloatStorage"), (module, "LongStorage"), (private, "_rebuild_tensor_v2")):
        made = type(name, (), {"__module__": owner.__name__, "__qualname__": name})
        setattr(owner, name, made)
    monkeypatch.setitem(sys.modules, "torch", module)
    monkeypatch.setitem(sys.modules, "torch._utils", private)
    return module


def checkpoint(path: Path, arrays: dict[str, np.ndarray], torch: ModuleType) -> Path:
    """Write arrays as a checkpoint."""

    class Writer(pickle.Pickler):
        def persistent_id(self, obj: Any) -> Any:
            if not isinstance(obj, Storage):
                return None
            kind = torch.FloatStorage if obj.array.dtype == np.float32 else torch.LongStorage
            return "storage", kind, obj.key, "cuda:2", obj.array.size, None

    file = BytesIO()
    tensors = OrderedDict((name, Tensor(str(n), array)) for n, (name, array) in enumerate(arrays.items()))
    for value in (0x1950A86A20F9469CFC6C, 1001, {"little_endian": True}, {"epoch": 1, "state_dict": tensors}):
        Writer(file, 2).dump(value)
    keys = [tensor.storage.key for tensor in tensors.values()][::-1]  # in an order of their own
    Writer(file, 2).dump(keys)
    for key in keys:
        array = list(arrays.values())[int(key)]
        file.write(array.size.to_bytes(8, "little") + array.tobytes())
    path.write_bytes(file.getvalue())
    return path


def small() -> dict[str, np.ndarray]:
    """Arrays of a network whose output does not depend on its input: only the bias of its last layer."""

    def norm(name: str, channels: int) -> dict[str, np.ndarray]:
        parts = {"weight": 1, "bias": 0, "running_mean": 0, "running_var": 1}
        arrays = {f"module.{name}.{part}": np.full(channels, value, np.float32) for part, value in parts.items()}
        return {**arrays, f"module.{name}.num_batches_tracked": np.array(7, np.int64)}

    arrays = {"module.conv1.weight": np.ones((16, 3, 3, 3), np.float32), **norm("bn1", 16)}
    for block, (taken, given) in CHANNELS.items():
        arrays[f"module.{block}.conv_dw.weight"] = np.ones((taken, 1, 3, 3), np.float32) / 9
        arrays |= norm(f"{block}.bn_dw", taken)
        arrays[f"module.{block}.conv_sep.weight"] = np.ones((given, taken, 1, 1), np.float32) / taken
        arrays |= norm(f"{block}.bn_sep", given)
    arrays["module.fc_param.weight"] = np.zeros((62, 512), np.float32)
    arrays["module.fc_param.bias"] = np.arange(62, dtype=np.float32)
    return arrays


def run(content: bytes, image: np.ndarray) -> np.ndarray:
    checker.check_model(load_from_string(content), full_check=True)
    session = onnxruntime.InferenceSession(content, providers=["CPUExecutionProvider"])
    assert [output.name for output in session.get_outputs()] == ["param"]
    return np.asarray(session.run(["param"], {"input": image})[0])


# A small checkpoint


def test_the_output_is_the_pose_in_its_own_units(tmp_path: Path, torch: ModuleType) -> None:
    content = convert(checkpoint(tmp_path / "small.pth", small(), torch))
    pose = run(content, np.ones((1, 3, 120, 120), np.float32))
    assert pose.shape == (1, 12)
    # number n: n standard deviations from the mean
    assert pose[0, 0] == pytest.approx(0.00034926363)
    assert pose[0, 3] == pytest.approx(60.167957 + 3 * 26.550232)
    assert pose[0, 5] == pytest.approx(0.00057572004 + 5 * 4.4930217e-05)
    assert pose[0, 11] == pytest.approx(-66.67158 + 11 * 20.80304)


class Evil:
    def __reduce__(self) -> tuple[Any, tuple[str]]:
        return exec, ("raise SystemExit('a checkpoint ran code')",)


def test_a_checkpoint_runs_nothing(tmp_path: Path) -> None:
    (tmp_path / "other.pth").write_bytes(pickle.dumps(Evil()))
    with pytest.raises(pickle.UnpicklingError, match=r"found builtins\.exec"):
        convert(tmp_path / "other.pth")


# The published checkpoint


@pytest.fixture
def published(shared_models: Path) -> Path:
    path = shared_models / "3ddfa_v2" / "mb05_120x120.pth"
    if not path.is_file():
        pytest.skip(f"needs 3DDFA_V2's checkpoint: no file {path}")
    return path


def served(site: Site, content: bytes) -> CatalogueEntry:
    """The catalogue's entry, whose checkpoint this site serves."""
    entry = find_model("3ddfa-v2")
    assert entry.checkpoint is not None
    site.files["/mb05.pth"] = content
    return entry.model_copy(
        update={"checkpoint": entry.checkpoint.model_copy(update={"address": site.url("/mb05.pth")})}
    )


def test_the_published_checkpoint_is_fetched_and_converted(cache: Path, site: Site, published: Path) -> None:
    entry = served(site, published.read_bytes())
    told: list[tuple[int, int | None]] = []
    path = fetch_model("3ddfa-v2", entry, accept_licence=False, progress=lambda *each: told.append(each))
    assert list(cache.iterdir()) == [path] == [cache / "mb05_120x120.onnx"]
    assert told[-1] == (3752462, 3752462)
    assert hashlib.sha256(path.read_bytes()).hexdigest() == entry.sha256
    verdict = check_model("3ddfa-v2", entry, RuntimeSettings())
    assert (verdict.verdict, verdict.checksum_known, verdict.message) == ("ok", True, None)
    assert fetch_model("3ddfa-v2", entry, accept_licence=False) == path
    assert len(site.asked) == 1


@pytest.mark.parametrize("kind", ["a byte is wrong", "cut", "a login page"])
def test_another_file_at_its_address_is_refused(cache: Path, site: Site, published: Path, kind: str) -> None:
    content = published.read_bytes()
    contents = {
        "a byte is wrong": content[:100_000] + bytes([content[100_000] ^ 1]) + content[100_001:],
        "cut": content[:-1000],
        "a login page": b"<!doctype html><title>Sign in</title>",
    }
    with pytest.raises(VfoaError) as raised:
        fetch_model("3ddfa-v2", served(site, contents[kind]), accept_licence=False)
    assert "\n" not in str(raised.value)
    assert "mb05" in str(raised.value)
    assert not cache.exists() or list(cache.iterdir()) == []


def test_a_file_placed_by_hand_is_found(cache: Path, shared_models: Path) -> None:
    other = shared_models / "3ddfa_v2" / "mb05_120x120.onnx"
    if not other.is_file():
        pytest.skip(f"needs 3DDFA_V2: no file {other}")
    cache.mkdir(parents=True)
    (cache / other.name).write_bytes(other.read_bytes())
    assert check_model("3ddfa-v2", find_model("3ddfa-v2"), RuntimeSettings()).verdict == "ok"
    assert TddfaV2(TddfaV2.Settings())._model.path == cache / other.name


def test_the_converted_network_answers_as_another_conversion_on_real_faces(
    tmp_path: Path, published: Path, shared_models: Path, shared_data: Path
) -> None:
    labels, other = shared_data / "faces" / "pose.json", published.with_suffix(".onnx")
    if not (labels.is_file() and other.is_file()):
        pytest.skip(f"needs {labels} and {other}")
    (tmp_path / "converted.onnx").write_bytes(convert(published))
    models = [TddfaV2(TddfaV2.Settings(weights=str(path))) for path in (tmp_path / "converted.onnx", other)]
    yunet = YuNet(YuNet.Settings(weights=str(shared_models / "yunet_n_dynamic.onnx")))
    for name in json.loads(labels.read_text()):
        frame = frame_of(read_rgb(labels.parent / f"{name}.jpg"))
        head = yunet.faces(frame)[0]
        poses = [model.estimate(frame, head) for model in models]
        assert poses[0] is not None
        assert poses[1] is not None
        assert np.degrees(angle_between(poses[0].direction, poses[1].direction)) < 0.01
        assert poses[0].roll_rad == pytest.approx(poses[1].roll_rad, abs=1e-4)
