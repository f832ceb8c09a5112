"""No command replaces what it reads, not even with ``--replace``."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.command import run_in, vfoa
from tests.disk import write_text
from tests.measured import EXPERIMENT, MANIFEST, measured_tables, true_labels

CASES = [
    ("compare run --page", "run/answers/cones/talk.parquet"),
    ("compare run --page", "run/manifest.json"),
    ("compare run --page", "annotations/talk.csv"),
    ("compare run --page", "datasets/talk.toml"),
    ("bench talk.toml --clip talk --out", "datasets/talk.toml"),
    ("bench talk.toml --clip talk --out", "annotations/talk.csv"),
    ("export-failure run --frame 3 --config cones --out", "run/talk__cones.rrd"),
    ("view run --config cones --screenshot", "run/talk__cones.rrd"),
    ("view run --config cones --screenshot", "run/talk.rrd"),
    ("models export gaze360 --checkpoint gaze.pth --out", "gaze.pth"),
    ("labels export talk --format csv", "annotations/talk.csv"),
    ("labels export run --format csv --config cones", "run/answers/cones/talk.parquet"),
    ("fit run --even-if-worse --out", "datasets/talk.toml"),
    ("fit run --even-if-worse --out", "run/answers/cones/talk.parquet"),
]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working directory with a labelled clip and a finished run with recordings."""
    folder = tmp_path_factory.mktemp("inputs")
    measured_tables(folder / "data" / "talk")
    write_text(folder / "datasets" / "talk.toml", MANIFEST)
    write_text(folder / "annotations" / "talk.csv", true_labels())
    write_text(folder / "talk.toml", EXPERIMENT)
    write_text(folder / "gaze.pth", "weights")
    run_in(folder, "run", "talk.toml", "--out", "run", "--workers", "1")
    return folder


@pytest.mark.parametrize(("words", "target"), CASES)
def test_what_a_command_reads_is_not_replaced(
    made: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], words: str, target: str
) -> None:
    monkeypatch.chdir(made)
    before = {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()}
    code, _, said = vfoa(monkeypatch, capsys, *words.split(), target, "--replace")
    assert code == 2
    assert "this command reads it" in said
    assert {path: path.read_bytes() for path in Path().rglob("*") if path.is_file()} == before
