"""Conversion of published checkpoints to ONNX files. The only folder that imports PyTorch."""

from __future__ import annotations

from pathlib import Path

from vfoa.errors import VfoaError

_EXTRA = ("torch", "onnx")


def export_gaze360(checkpoint: Path, out: Path) -> float:
    """Write Gaze360's network as ONNX: calls :func:`harness.pipeline.export.gaze360.export`.

    Raises
    ------
    VfoaError
        If PyTorch is not installed, or the checkpoint is not Gaze360's.
    """
    try:
        import onnx  # noqa: F401 PyTorch's exporter asks for it late

        from harness.pipeline.export.gaze360 import export
    except ModuleNotFoundError as error:
        if error.name not in _EXTRA:
            raise
        raise VfoaError(
            f"models export: needs the package {error.name}; expected vfoa installed with its extra: vfoa[export]"
        ) from None
    return export(checkpoint, out)
