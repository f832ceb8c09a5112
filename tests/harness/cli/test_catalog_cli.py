"""Runs in Rerun's catalogue: what the table says, the documented query, and the errors."""

from __future__ import annotations

import csv
import io
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import redirect_stdout
from importlib import util
from pathlib import Path

import pytest

from harness.record.catalog import serving
from harness.record.composed import find_clips
from harness.record.layers import ClipFiles
from harness.run.directory import RunDirectory
from tests.command import run_in, vfoa
from tests.disk import share_rendered_frames
from tests.harness.record.conftest import four_frames, write_run
from tests.pages import BLOCK
from tests.repository import REPOSITORY
from vfoa.errors import VfoaError

PAGE = (REPOSITORY / "docs" / "catalog.md").read_text(encoding="utf-8")
needs_datafusion = pytest.mark.skipif(util.find_spec("datafusion") is None, reason="needs vfoa[catalog]: DataFusion")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The demo on two clips, four configurations, six frames each."""
    folder = tmp_path_factory.mktemp("catalog")
    share_rendered_frames(folder / "c")
    shipped = (REPOSITORY / "harness" / "experiments" / "demo.toml").read_text(encoding="utf-8")
    short = re.sub(r"(?s)^clips = \[.*?\]", 'clips = ["demo_crowd", "demo_1"]', shipped, flags=re.MULTILINE)
    short = re.sub(r"(?m)^nearest = .*$", "", short)
    (folder / "demo.toml").write_text(short, encoding="utf-8")
    words = ["run", "demo.toml", "--out", "runs/demo", "--limit", "6", "--workers", "1", "--cache", str(folder / "c")]
    run_in(folder, *words)
    return folder / "runs" / "demo"


@pytest.fixture(scope="module")
def served(run: Path) -> Iterator[tuple[str, Path]]:
    """The address of a catalogue with that run, and with a copy of it under the same name."""
    copy = run.parent.parent / "other" / "demo"
    shutil.copytree(run, copy)
    with serving([run, copy]) as catalogue:
        assert list(catalogue.datasets.items()) == [("demo", run), ("demo-2", copy)]
        assert catalogue.address.startswith("rerun+http://127.0.0.1:")
        yield catalogue.address, run


def _rows(run: Path, clip: str) -> dict[str, dict[str, str]]:
    """The rows of ``frr.csv`` of a clip, over all its subjects, by configuration."""
    with (run / "frr.csv").open(encoding="utf-8") as file:
        return {
            row["configuration"]: row
            for row in csv.DictReader(file)
            if row["clip"] == clip and row["subject"] == "(all)"
        }


def _asked(address: str) -> list[list[dict[str, str]]]:
    """The two tables that the documented query prints."""
    (query,) = (block["text"] for block in BLOCK.finditer(PAGE) if block["title"] == "query.py")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["query.py", address])
        said = _printed(query)
    return [list(csv.DictReader(io.StringIO(table))) for table in said.strip().split("\n\n")]


def _printed(program: str) -> str:
    """What a program of Python prints, executed here: a process would import all of Rerun and DataFusion again."""
    with redirect_stdout(io.StringIO()) as said:
        exec(compile(program, "program", "exec"), {"__name__": "__main__"})
    return said.getvalue()


@needs_datafusion
def test_the_documented_query_finds_the_rates_of_frr_csv(served: tuple[str, Path]) -> None:
    address, run = served
    rates, errors = _asked(address)
    clips = ("demo_crowd", "demo_1")
    expected = {(clip, name): row for clip in clips for name, row in _rows(run, clip).items()}
    assert len(expected) == 8
    for dataset in ("demo", "demo-2"):
        found = {(row["clip"], row["configuration"]): row for row in rates if row["run"] == dataset}
        assert {pair: (row["n"], row["frr"]) for pair, row in found.items()} == {
            pair: (row["n"], row["frr"]) for pair, row in expected.items()
        }
        by_type = {
            (row["clip"], row["configuration"], row["error"]): int(row["n"]) for row in errors if row["run"] == dataset
        }
        assert by_type == {
            (*pair, column.removeprefix("error_type_")): int(count)
            for pair, row in expected.items()
            for column, count in row.items()
            if column.startswith("error_type_") and int(count)
        }


@needs_datafusion
def test_the_table_has_properties_to_sort_by_and_a_layout(served: tuple[str, Path]) -> None:
    from rerun.catalog import CatalogClient

    address, run = served
    dataset = CatalogClient(address).get_dataset("demo")
    assert dataset.default_blueprint() is not None
    assert dataset.default_segment_table_blueprint() is not None
    table = dataset.segment_table().to_pandas()
    rows = {row["property:run:clip"][0]: row for _, row in table.iterrows()}
    assert set(rows) == {"demo_crowd", "demo_1"}
    for clip, row in rows.items():
        of_csv = _rows(run, clip)
        assert row["property:run:run"][0] == "demo"
        assert row["property:run:labelled"][0] == int(of_csv["bm-one"]["n"])
        assert row["property:bm_one:settings"][0] == "stereo.matcher = bm, attention = one"
        assert row["property:bm_one:frr"][0] == pytest.approx(float(of_csv["bm-one"]["frr"]), abs=1e-6)
        counts = {key: int(value) for key, value in of_csv["bm-one"].items() if key.startswith("error_type_")}
        commonest = row["property:bm_one:commonest_error"][0]
        assert counts[f"error_type_{commonest}"] == max(counts.values())
        layers = {"images", "run", "bm-one", "bm-one.scene", "bm-one.verdicts", "sgbm-two.verdicts"}
        assert layers <= set(row["rerun_layer_names"])


@needs_datafusion
def test_names_are_those_of_the_run(tmp_path: Path) -> None:
    """They have spaces, slashes and letters that a path escapes."""
    runs = [write_run(tmp_path / name, {"two cones": four_frames()}).run for name in ("new", "old")]
    with serving(runs) as catalogue:
        rates, errors = _asked(catalogue.address)
    assert [(row["run"], row["configuration"], row["n"], row["frr"]) for row in rates] == [
        ("new", "two cones", "4", "0.250000"),
        ("old", "two cones", "4", "0.250000"),
    ]
    assert [row["error"] for row in errors] != []


@needs_datafusion
def test_a_damaged_recording_is_one_line(run: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    shutil.copytree(run, broken)
    file = ClipFiles(run=broken, clip="demo_1").attention("bm-two")
    file.write_bytes(b"RRF2" + b"x" * 100)
    with pytest.raises(VfoaError, match=r"demo_1__bm-two\.rrd") as error, serving([broken]):
        pass
    assert "\n" not in str(error.value)


def test_without_datafusion_one_line_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr("harness.record.catalog.find_spec", lambda name: None)
    code, out, err = vfoa(monkeypatch, capsys, "catalog", str(tmp_path))
    assert (code, out) == (2, "")
    expected = "vfoa: catalog: needs the package datafusion; expected vfoa installed with its extra: vfoa[catalog]\n"
    assert err == expected


@needs_datafusion
def test_a_run_without_recordings_is_refused(
    run: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    bare = RunDirectory(tmp_path / "bare")
    bare.write_manifest(RunDirectory(run).read_manifest())
    code, out, err = vfoa(monkeypatch, capsys, "catalog", str(run), str(bare.path))
    assert (code, out) == (2, "")
    assert err.startswith(f"vfoa: {bare.path}: expected recordings (*.rrd), found none")


def test_layers_have_the_names_of_their_files(run: Path) -> None:
    clip = next(clip for clip in find_clips(run, None, None) if clip.files.clip == "demo_1")
    named = clip.layer_files()
    assert named["images"].name == "demo_1.rrd"
    assert named["sgbm-one.scene"].name == "demo_1__sgbm-one.scene.rrd"
    assert len(named) == 1 + 2 + 4 + 4


@needs_datafusion
def test_the_command_prints_three_lines_of_python_and_ends_with_ctrl_c(tmp_path: Path) -> None:
    run = write_run(tmp_path / "run", {"two cones": four_frames()}).run
    command = [sys.executable, "-m", "harness", "catalog", str(run)]
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "SSH_CONNECTION": "192.0.2.1 50000 192.0.2.7 22"},
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a suite in the background ignores it
    )
    try:
        assert process.stdout is not None
        said = [process.stdout.readline() for _ in range(6)]
        assert said[0] == "Serving until Ctrl-C: run\n"
        *imports, table = (line.strip() for line in said[3:])
        program = "\n".join([*imports, f"print(*{table})"])
        assert "property:run:clip" in _printed(program).split()
        process.send_signal(signal.SIGINT)
        rest, complaints = process.communicate(timeout=180)
        assert (process.returncode, rest) == (0, "")
    finally:
        process.kill()
        process.communicate()
    port = int(said[1].rpartition(":")[2])
    assert complaints.endswith(f"ssh -N -L {port}:127.0.0.1:{port} 192.0.2.7\n")
    assert complaints.count("\n") == 1
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", port)) != 0  # nothing listens there any more
