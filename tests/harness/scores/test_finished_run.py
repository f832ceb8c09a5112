from __future__ import annotations

from pathlib import Path

from harness.runs.directory import RunDirectory
from harness.scores.finished_run import FinishedRun


def test_what_is_true_of_several_clips_is_said_once(tmp_path: Path) -> None:
    clips = [
        {"name": name, "manifest": "", "frames": [1], "notes": notes}
        for name, notes in (("studio_table", ["Rendered."]), ("studio_talk", ["Rendered.", "Two people."]))
    ]
    manifest = {"notes": ["Ours."], "clips": clips, "configurations": {"one": {}}, "finished": "now"}
    run = FinishedRun(directory=RunDirectory(tmp_path), manifest=manifest)
    assert run.reference().notes == ("Ours.", "studio_table, studio_talk: Rendered.", "studio_talk: Two people.")
