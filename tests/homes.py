"""A server on this machine as the home of the models of a default run, with their genuine files."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from harness.pipeline import weights
from harness.pipeline.weights import CatalogueEntry, catalogue
from tests import graphs
from tests.web import Site

NEEDED = ("yunet", "3ddfa-v2", "adas-0002", "adas-head-pose", "rf-detr-seg-medium")
"""What a default run needs where no licence was accepted."""
MOBILEGAZE = "mobilegaze-mobileone-s0"
OTHER_FILES = ("rf-detr-seg-medium", MOBILEGAZE)
"""Models whose files are not at hand as their homes have them: graphs that find nothing in their place."""


def serve_models(site: Site, models: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Serve the genuine files of the networks that a default run needs; all others keep their addresses.

    ``folder`` gets the graphs of :data:`OTHER_FILES`.
    """
    if not (models / "openvino_ir").is_dir():
        pytest.skip(f"needs the networks in OpenVINO's format: no folder {models / 'openvino_ir'}")
    entries = dict(catalogue())
    others = []
    for entry in (entries[name] for name in OTHER_FILES):
        shapes = {key: [1 if length == "batch" else length for length in shape] for key, shape in entry.outputs.items()}
        nothing = {key: np.full(shape, -9.0) for key, shape in shapes.items()}
        others.append(Path(graphs.constant(folder / entry.file, entry.inputs, nothing)))
    genuine = (path for kinds in ("*.onnx", "openvino_ir/*", "3ddfa_v2/*.pth") for path in models.glob(kinds))
    files = {path.name: path for path in (*genuine, *others)}
    for name in (*NEEDED, MOBILEGAZE):
        entries[name] = _served(site, name, entries[name], files)
    monkeypatch.setattr(weights, "catalogue", lambda: entries)


def _served(site: Site, name: str, entry: CatalogueEntry, files: dict[str, Path]) -> CatalogueEntry:
    """A model whose home is this site, if its files are here."""

    def address(file: str) -> str:
        site.files[f"/{file}"] = files[file].read_bytes()
        return site.url(f"/{file}")

    if entry.openvino is not None:
        stem = Path(entry.file).stem
        parts = {
            suffix: getattr(entry.openvino, suffix).model_copy(update={"address": address(f"{stem}.{suffix}")})
            for suffix in ("xml", "bin")
        }
        return entry.model_copy(update={"openvino": entry.openvino.model_copy(update=parts)})
    if entry.checkpoint is not None:
        checkpoint = entry.checkpoint.model_copy(update={"address": address(f"{Path(entry.file).stem}.pth")})
        return entry.model_copy(update={"checkpoint": checkpoint})
    if name in OTHER_FILES:
        sha256 = hashlib.sha256(files[entry.file].read_bytes()).hexdigest()
        return entry.model_copy(update={"address": address(entry.file), "sha256": sha256})
    return entry.model_copy(update={"address": address(entry.file)})
