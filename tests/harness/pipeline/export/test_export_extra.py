from __future__ import annotations

import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from harness.cli.models import app
from vfoa.errors import VfoaError


@pytest.mark.parametrize("package", ["torch", "onnx"])
def test_without_the_extra_its_name_is_told(package: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.delitem(sys.modules, "harness.pipeline.export.gaze360", raising=False)
    monkeypatch.delitem(sys.modules, "harness.pipeline.export.gaze360", raising=False)
    (tmp_path / "model.pth.tar").write_bytes(b"")
    arguments = ["--checkpoint", str(tmp_path / "model.pth.tar"), "--out", str(tmp_path / "gaze360.onnx")]
    found = CliRunner().invoke(app, ["export", "gaze360", *arguments])
    assert isinstance(found.exception, VfoaError)
    assert str(found.exception) == (
        f"models export: needs the package {package}; expected vfoa installed with its extra: vfoa[export]"
    )
