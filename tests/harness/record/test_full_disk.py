"""A recording whose file takes no more bytes: said in one line, within bounded time, and the process ends."""

from __future__ import annotations

import _thread
import os
import subprocess
import sys
from pathlib import Path

import pytest

from harness.record import layer_file
from harness.record.layers import ClipFiles

PROGRAM = """
import resource, sys
from pathlib import Path

import numpy as np
import rerun as rr

from harness.record.layer_file import LayerFile
from harness.record.layers import (ClipFiles)

resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))  # Python ignores the signal that comes with it
folder = Path(sys.argv[1])
layer = LayerFile(folder / "clip.rrd", ClipFiles(run=folder, clip="clip"))
layer.open()
log = layer.part("noise")
for number in range(5):
    log.begin(number, number)
    noise = np.random.default_rng(number).bytes(720_000)
    log.row("/noise", rr.EncodedImage, blob=[noise], media_type=["image/png"])
    log.end()
try:
    layer.close(complete=sys.argv[2] == "complete")
except OSError as error:
    print(error)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="limits files as Linux does")
@pytest.mark.parametrize("how", ["complete", "after an error"])
def test_a_file_that_takes_no_more_ends_in_bounded_time(how: str, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(tmp_path), how],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    assert ("clip.rrd.partial" in done.stdout) == (how == "complete")
    assert not (tmp_path / "clip.rrd").exists()


def test_a_thread_that_has_no_memory_to_begin_is_an_error_and_no_wait(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(_thread, "start_new_thread", lambda function, arguments: 0)  # as it ends where memory does
    monkeypatch.setattr(layer_file, "_PATIENCE_S", 0.01)
    layer = layer_file.LayerFile(tmp_path / "clip.rrd", ClipFiles(run=tmp_path, clip="clip"))
    with pytest.raises(OSError, match="no memory") as error:
        layer.open()
    assert error.value.filename == str(tmp_path / "clip.rrd.partial")
    assert not (tmp_path / "clip.rrd").exists()
