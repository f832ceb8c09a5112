"""A package of ten lines, installed beside the harness, whose gaze model is used by its name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.run.experiment import load_experiment
from harness.run.runner import prepare, run_plan
from harness.run.table_records import read_records
from tests.plugins import install

PLUGIN = """
from vfoa.settings import Settings
from vfoa.types import Gaze

class Ahead:
    class Settings(Settings):
        down: float = 0.0

    def __init__(self, settings):
        self.settings = settings

    def estimate(self, frame, head, head_pose):
        return Gaze(direction=(0.0, self.settings.down, 1.0))
"""


EXPERIMENT = """
[[configuration]]
name = "ahead"
stereo.matcher = "truth"
segmentation.model = "truth"
heads.detector = "truth"
head_pose.model = "none"
gaze.model = "ahead"
gaze.down = 0.75
"""


def test_a_gaze_model_of_another_package_is_used_by_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    site = install(tmp_path / "site", "vfoa_ahead", PLUGIN, group="vfoa.gaze", name="ahead", cls="Ahead")
    monkeypatch.syspath_prepend(str(site))

    file = tmp_path / "plugin.toml"
    file.write_text(EXPERIMENT, encoding="utf-8")
    experiment = load_experiment(str(file), clips=("studio_table",))
    plan = prepare(experiment, limit=2)
    directory = run_plan(plan, tmp_path / "run", workers=1, progress=lambda clip: None)

    gazes = [subject.gaze for record in read_records(directory) for subject in record.subjects]
    assert gazes
    for gaze in gazes:
        np.testing.assert_allclose(gaze, (0, 0.6, 0.8), atol=1e-9)
