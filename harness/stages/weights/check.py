"""Checks of a model's file against the catalogue, and the time of one inference on this machine."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from harness.files.digests import file_digest
from harness.stages.weights.catalogue import CatalogueEntry
from vfoa.errors import VfoaError
from vfoa.onnx import Model, RuntimeSettings, Signature
from vfoa.weights import is_lfs_pointer

Verdict = Literal["ok", "fails", "absent"]


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelCheck:
    """The result of checking one model.

    ``provider`` and ``inference_ms`` are None if nothing was run; ``checksum_known`` says whether the catalogue has a
    checksum to compare with. ``message`` says what is wrong, or what else a reader must know.
    """

    name: str
    verdict: Verdict
    path: str | None = None
    provider: str | None = None
    inference_ms: float | None = None
    checksum_known: bool = False
    message: str | None = None


def check_model(name: str, entry: CatalogueEntry, settings: RuntimeSettings) -> ModelCheck:
    """Load a model, check its signature, run it once on zeros, compare its checksum; a failure is a verdict."""
    path = entry.find()
    if path is None:
        source = f"vfoa models fetch {name}" if entry.address else f"its home: {entry.home}"
        return ModelCheck(name=name, verdict="absent", message=f"no file {entry.file} here ({source})")
    try:
        _check_whole(path, entry)
        provider, inference_ms = _run_once(path, entry, settings) if entry.is_onnx else (None, None)
        _check_sum(path, entry)
    except VfoaError as error:
        return ModelCheck(name=name, verdict="fails", path=str(path), message=str(error))
    return ModelCheck(
        name=name,
        verdict="ok",
        path=str(path),
        provider=provider,
        inference_ms=inference_ms,
        checksum_known=entry.sha256 is not None,
        message=None if entry.is_onnx else entry.note,
    )


def signature(entry: CatalogueEntry) -> Signature:
    """Return the catalogue's signature of a model; a length given as a word becomes None."""

    def shapes(tensors: dict[str, tuple[int | str, ...]]) -> dict[str, tuple[int | None, ...]]:
        return {
            name: tuple(length if isinstance(length, int) else None for length in shape)
            for name, shape in tensors.items()
        }

    return Signature(
        inputs=shapes(dict(entry.inputs)),
        outputs=shapes(dict(entry.outputs)),
        by_position=entry.by_position,
        integers=frozenset(entry.integers),
    )


def _check_whole(path: Path, entry: CatalogueEntry) -> None:
    if is_lfs_pointer(path):
        raise VfoaError(f"{path}: a Git LFS pointer; expected the model itself (fetch it with git lfs pull)")
    found = path.stat().st_size
    if entry.bytes is not None and found < entry.bytes:
        raise VfoaError(f"{path}: truncated: found {found} bytes, expected {entry.bytes}")


def _run_once(path: Path, entry: CatalogueEntry, settings: RuntimeSettings) -> tuple[str, float]:
    """Return the provider, and the milliseconds of one inference on zeros."""
    model = Model(str(path), signature(entry), settings)
    zeros = {
        name: np.zeros([entry.sizes[length] if isinstance(length, str) else length for length in shape], np.float32)
        for name, shape in entry.inputs.items()
    }
    provider = model.provider()
    started = time.perf_counter()
    model.run(**zeros)
    return provider, (time.perf_counter() - started) * 1000


def _check_sum(path: Path, entry: CatalogueEntry) -> None:
    if entry.sha256 is None:
        return
    found = file_digest(path)
    if found != entry.sha256:
        raise VfoaError(
            f"{path}: corrupt, or another version: found sha256 {found[:16]}..., expected {entry.sha256[:16]}..."
        )
