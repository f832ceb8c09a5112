from __future__ import annotations

from typing import Any

import pytest

from harness.run.manifest import RunManifest, differences, differences_in_common


def _manifest(
    n_rays: int = 40, frames: int = 3, numpy: str = "2.4", names: tuple[str, ...] = ("a", "b"), step: int = 1
) -> dict[str, Any]:
    settings = {"stereo": {"matcher": "bm"}, "attention": {"n_rays": n_rays}}
    times = [*range(0, frames * step, step)]
    clips = [{"name": name, "frames": [*range(frames)], "times_ns": times, "sha256": "0"} for name in names]
    return {
        "experiment": "e",
        "notes": [],
        "clips": clips,
        "configurations": {"one": settings, "two": settings},
        "versions": {"numpy": numpy},
    }


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (_manifest(), ""),
        ({**_manifest(), "host": "another"}, ""),
        (_manifest(n_rays=20), "attention.n_rays"),
        (_manifest(frames=2), "frames of a, frames of b"),
        (_manifest(step=2), "times_ns of a, times_ns of b"),
        (_manifest(names=("a",)), "clips"),
        (_manifest(names=("a", "b", "b")), "clips"),
        (_manifest(numpy="2.3"), "versions.numpy"),
        (_manifest(n_rays=20, frames=2, numpy="2.3"), "frames of a, frames of b, attention.n_rays and 1 more"),
        ({}, "experiment, notes, clips and 2 more"),
    ],
)
def test_what_differs_is_named(found: dict[str, Any], said: str) -> None:
    assert differences(found, _manifest()) == said


@pytest.mark.parametrize(
    ("other", "said"),
    [
        (_manifest(), ""),
        ({**_manifest(), "commit": "another", "host": {"cores": 4}}, ""),
        (_manifest(n_rays=20), "attention.n_rays"),
        (_manifest(names=("b", "c")), ""),
        (_manifest(names=("c", "b"), frames=2), "frames of b"),
        ({**_manifest(), "configurations": {"two": {"attention": {"n_rays": 40}, "stereo": None}}}, "stereo"),
        ({**_manifest(), "configurations": {"three": {"stereo": None}}}, ""),
        ({**_manifest(), "weights_sha256": {"face.onnx": "2", "eye.onnx": "2"}}, "weights_sha256.face.onnx"),
        ({**_manifest(numpy="2.3"), "source_sha256": "2"}, "versions.numpy, code"),
    ],
)
def test_what_two_runs_have_in_common_is_compared(other: dict[str, Any], said: str) -> None:
    one = RunManifest.model_validate({**_manifest(), "weights_sha256": {"face.onnx": "1"}, "source_sha256": "1"})
    if "source_sha256" not in other:
        other = {**other, "source_sha256": "1"}
    found = differences_in_common(one, RunManifest.model_validate(other))
    assert found == said
