"""What is left of a layer's file when it is closed."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from harness.record.layer_file import LayerFile
from harness.record.layers import ClipFiles

LAYERS = 20


@pytest.mark.skipif(sys.platform != "linux", reason="counts the process's threads in /proc")
def test_closed_layers_leave_no_threads(tmp_path: Path) -> None:
    """Rerun's own: two for each stream, which would be thousands in a run of many clips."""
    counts = []
    for number in range(LAYERS):
        layer = LayerFile(tmp_path / f"{number}.rrd", ClipFiles(run=tmp_path, clip="clip"))
        layer.open(rrb.Blueprint(rrb.Spatial3DView()))
        log = layer.part("part")
        log.begin(1, 1)
        log.row("/value", rr.Scalars, scalars=[1.0])
        log.end()
        layer.end_frame()
        layer.close(complete=True)
        counts.append(len([*Path("/proc/self/task").iterdir()]))
    assert counts[-1] - counts[0] < LAYERS / 2
    assert {len(RrdReader(tmp_path / f"{number}.rrd").blueprints()) for number in range(LAYERS)} == {1}
