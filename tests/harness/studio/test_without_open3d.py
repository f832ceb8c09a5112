"""Open3D renders the studio: everything else works where it cannot be imported."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np

from harness.run.directory import RunDirectory
from harness.run.table_records import read_records
from scripts.measure.stage_outputs import write_coco_panoptic
from tests.disk import HEIGHT, WIDTH, sintel_scene, write_text
from vfoa.types import Instances

BLOCKED = "import sys; sys.modules['open3d'] = None\n"


def _vfoa(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    code = f"{BLOCKED}import vfoa\nfrom harness.cli import main\nsys.argv = ['vfoa', *{list(words)!r}]\nmain()"
    env = {**os.environ, "VFOA_CACHE": str(folder / "cache")}
    return subprocess.run(
        [sys.executable, "-c", code], cwd=folder, env=env, capture_output=True, text=True, check=False
    )


def test_a_real_clip_runs_without_open3d(tmp_path: Path) -> None:
    root = sintel_scene(tmp_path / "data", frames=(1, 2))
    nothing = Instances(ids=np.zeros((HEIGHT, WIDTH), np.uint16), instances=())
    write_coco_panoptic(tmp_path / "masks", [(frame, nothing) for frame in (1, 2)])
    write_text(
        tmp_path / "datasets" / "real.toml",
        f'name = "real"\nadapter = "sintel"\nroot = "{root.as_posix()}"\n[source]\nscene = "alley"\n',
    )
    stages = (
        'stereo = { matcher = "bm", min_depth_m = 1.0 }\nheads.detector = "person_mask"\n'
        f'segmentation = {{ model = "coco_panoptic", root = "{(tmp_path / "masks").as_posix()}" }}\n'
        'head_pose.model = "none"\ngaze.model = "none"\n'
    )
    write_text(tmp_path / "mine.toml", f'clips = ["real"]\n[[configuration]]\nname = "only"\n{stages}')
    ran = _vfoa(tmp_path, "run", "mine.toml", "--workers", "1", "--recording", "none", "--out", "out")
    assert ran.returncode == 0, ran.stderr
    assert len(list(read_records(RunDirectory(tmp_path / "out")))) == 2


def test_the_studio_says_in_one_line_that_it_needs_open3d(tmp_path: Path) -> None:
    words = ("run", "demo", "--clip", "studio_table", "--limit", "1", "--workers", "1", "--no-cache", "--out", "out")
    ran = _vfoa(tmp_path, *words)
    assert ran.returncode == 2
    assert "rendering a studio clip needs Open3D" in ran.stderr
    assert len(ran.stderr.splitlines()) == 1
