"""Runs whose clips, weights, cache and directory are on object storage, by workers that share no folder.

The storage is a local S3 server (moto). Each worker has a working folder and a cache of its own.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import fsspec
import pytest
from moto.server import ThreadedMotoServer
from typer.testing import CliRunner

from harness.cli import app
from harness.mirror import Mirror, local_copy
from harness.record import images
from harness.remote import Remote
from harness.report.sinks import composed_sinks
from harness.report.write import rescore
from harness.run import checkpoint, remote_checkpoint
from harness.run.clip_job import ClipJob
from harness.run.directory import RunDirectory
from harness.run.elsewhere import run_elsewhere
from harness.run.executors import worker
from harness.run.executors.cluster import Cluster, connect, local_cluster
from harness.run.experiment import load_experiment
from harness.run.lease import leased
from harness.run.out import opened
from harness.run.runner import prepare, run_plan
from harness.stages.cache.store import open_store
from tests import graphs
from tests.alley import write_masks
from tests.disk import sintel_scene, write_text
from tests.dying_worker import CONTINUED, DIED, DyingWorkers
from vfoa.errors import VfoaError

ROOT = Path(__file__).parents[3]
FRAMES, CLIPS = 4, ("one", "two", "three", "four")
TABLES = ("results.jsonl", "frr.csv", "frames.csv", "comparisons.csv", "frr.tex")

CLIP = 'name = "{name}"\nadapter = "sintel"\nroot = "s3://vfoa/clips"\nsource.scene = "alley"\n'
EXPERIMENT = """
clips = {clips}
defaults.stereo = {{ matcher = "bm", min_depth_m = 1.0 }}
defaults.segmentation = {{ model = "coco_panoptic", root = "s3://vfoa/masks" }}
defaults.heads.detector = "person_mask"
defaults.head_pose.model = "none"
defaults.gaze = {{ model = "gaze360", weights = "levels.onnx", stride = 1 }}
[[configuration]]
name = "one-cone"
[[configuration]]
name = "two-cones"
attention.cones_cm = [10.0, 25.0]
"""


@pytest.fixture(scope="module")
def bucket() -> Iterator[str]:
    """An S3 server on this machine with an empty bucket, which every process here takes for Amazon's."""
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    server.start()
    host, port = server.get_host_and_port()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
        patch.setenv("AWS_ACCESS_KEY_ID", "tester")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        patch.setenv("AWS_EC2_METADATA_DISABLED", "true")
        storage = fsspec.filesystem("s3", skip_instance_cache=True)
        storage.mkdir("vfoa")
        yield "s3://vfoa"
        fsspec.filesystem("s3").clear_instance_cache()
    server.stop()


@pytest.fixture(scope="module")
def experiment(bucket: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """An experiment of four clips; nothing of what it reads is on this machine but the manifests."""
    here, numbers = tmp_path_factory.mktemp("uploaded"), tuple(range(1, FRAMES + 1))
    sintel_scene(here / "clips", frames=numbers)
    write_masks(here / "masks", numbers)
    (here / "models").mkdir()
    graphs.seven_levels(here / "models" / "levels.onnx")
    names = [path.relative_to(here).as_posix() for path in here.rglob("*") if path.is_file()]
    Remote(bucket).upload(names, here)
    folder = tmp_path_factory.mktemp("experiment")
    manifests = [write_text(folder / "datasets" / f"{name}.toml", CLIP.format(name=name)) for name in CLIPS]
    text = EXPERIMENT.format(clips=[manifest.as_posix() for manifest in manifests])
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("VFOA_MODELS", f"{bucket}/models")
        patch.setenv("VFOA_MODELS_ADDRESS", "")
        yield write_text(folder / "alleys.toml", text)


@dataclass(frozen=True)
class Workers:
    """A scheduler and its workers; ``folders`` has the cache of each."""

    scheduler: str
    folders: list[Path]
    processes: list[subprocess.Popen[bytes]]


@pytest.fixture(scope="module")
def workers(experiment: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Workers]:
    """Two workers, none of which is replaced when it dies."""
    folders = [tmp_path_factory.mktemp(name) for name in ("first", "second")]
    with local_cluster(0) as address:
        command = [sys.executable, "-m", "distributed.cli.dask_worker", address, "--nthreads", "1"]
        processes = []
        try:
            for folder in folders:
                (folder / "work").mkdir()
                kept = {name: value for name, value in os.environ.items() if not name.startswith("VFOA_")}
                own = {"VFOA_CACHE": str(folder / "cache"), "PYTHONPATH": str(ROOT)}
                processes.append(
                    subprocess.Popen(
                        [*command, "--no-nanny", "--no-dashboard"],
                        cwd=folder / "work",
                        env={**kept, **own},
                        stderr=subprocess.DEVNULL,
                    )
                )
            with connect(address) as client:
                client.wait_for_workers(len(folders), timeout=120)
            yield Workers(address, folders, processes)
        finally:
            for process in processes:
                process.kill()
                process.wait()


@pytest.fixture(scope="module")
def alone(experiment: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The tables of one process that writes to a folder."""
    out = tmp_path_factory.mktemp("alone") / "run"
    done = CliRunner().invoke(
        app, ["run", str(experiment), "--out", str(out), "--workers", "1", "--no-cache", "--recording", "none"]
    )
    assert done.exit_code == 0, done.output
    return {name: (out / name).read_bytes() for name in TABLES}


def _tables(address: str) -> dict[str, bytes | None]:
    return {name: Remote(address).read(name) for name in TABLES}


def test_workers_share_a_clip_through_the_cache_and_its_run_is_scored_and_continued_elsewhere(
    experiment: Path,
    bucket: str,
    workers: Workers,
    alone: dict[str, bytes],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    address, cache = f"{bucket}/runs/shared/", f"{bucket}/other-cache"
    command = ["run", str(experiment), "--clip", str(experiment.parent / "datasets" / "one.toml"), "--out", address]
    how = ["--scheduler", workers.scheduler, "--cache", cache]
    command += ["--recording", "none"]
    done = CliRunner().invoke(app, [*command, *how])
    assert done.exit_code == 0, done.output
    lines = alone["results.jsonl"].splitlines()
    assert Remote(address.rstrip("/")).read("results.jsonl") == b"".join(
        line + b"\n" for line in lines if b'"clip":"one"' in line
    )
    assert f"stereo bm: {FRAMES} reused" in done.output or f"stereo bm: 0 reused, {FRAMES} computed" in done.output
    # another machine, which has seen nothing of it
    monkeypatch.setenv("VFOA_CACHE", str(tmp_path / "another machine"))
    local_copy.cache_clear()
    again = CliRunner().invoke(app, [*command, "--workers", "1", "--cache", cache])
    assert again.exit_code == 0, again.output
    assert "nothing was computed" in again.output
    page = Remote(address.rstrip("/")).read("report.html")
    compared = CliRunner().invoke(app, ["compare", address, "--json"])
    assert compared.exit_code == 0, compared.output
    assert compared.output == "[]\n"  # no frame has a label
    exported = CliRunner().invoke(app, ["labels", "export", address, "--format", "csv", "--config", "one-cone"])
    assert str(exported.exception).endswith("no prediction (no_eyes_3d) and no label.")  # so it has read the run
    Remote(address.rstrip("/")).remove(["report.html"])
    local_copy.cache_clear()
    scored = CliRunner().invoke(app, ["score", address.rstrip("/")])
    assert scored.exit_code == 0, scored.output
    assert page is not None
    assert Remote(address.rstrip("/")).read("report.html") == page


def test_a_worker_that_does_not_see_the_directory_says_what_to_do(workers: Workers, tmp_path: Path) -> None:
    with connect(workers.scheduler) as client:
        client.run(setattr, worker, "PATIENCE_SECONDS", 0)
        work = Cluster(client, (), tmp_path / "run" / "manifest.json").run(len, ["a"], print, _lost)
        with pytest.raises(VfoaError, match=r"tcp://.*: sees no .*manifest\.json; expected the disk .* or --out and"):
            list(work)


def _lost(job: str, why: str) -> int:
    raise AssertionError(why)


def test_another_worker_continues_a_killed_one_from_its_checkpoint_with_the_same_results(
    experiment: Path, bucket: str, workers: Workers, alone: dict[str, bytes]
) -> None:
    address = f"{bucket}/runs/killed"
    with connect(workers.scheduler) as client:  # a checkpoint after every frame
        for module, name in ((checkpoint, "SECONDS"), (remote_checkpoint, "SECONDS"), (images, "KEY_FRAME_S")):
            client.run(setattr, module, name, 0.0)
    loaded = load_experiment(str(experiment))
    sinks = [*composed_sinks(loaded.configurations, "light"), DyingWorkers(f"{bucket}/notes", "two", 3)]
    store = open_store(f"{bucket}/cache")
    with opened(address) as out:
        directory = run_plan(
            prepare(loaded, sinks=sinks),
            out,
            workers=1,
            scheduler=workers.scheduler,
            progress=lambda clip: None,
            cache=store,
        )
        rescore(directory)
    assert _tables(address) == alone
    dead = Remote(f"{bucket}/notes").read(DIED)
    assert dead is not None
    assert Remote(f"{bucket}/notes").read(CONTINUED) == b"3"
    assert [process.pid for process in workers.processes if process.poll() is not None] == [int(dead)]
    recordings = {f"{clip}__{configuration.name}.rrd" for clip in CLIPS for configuration in loaded.configurations}
    assert recordings <= Remote(address).files().keys()
    assert not [name for name in Remote(address).files() if name.startswith(("partial/", "."))]
    for folder in workers.folders:
        assert list((folder / "cache" / "remote").iterdir())  # each fetched what it needed
    assert list(Remote(f"{bucket}/cache").files("stages/stereo"))


def test_a_cache_that_workers_cannot_see_is_refused(experiment: Path, bucket: str, tmp_path: Path) -> None:
    done = CliRunner().invoke(
        app,
        [
            *["run", str(experiment), "--scheduler", "tcp://127.0.0.1:1", "--cache", str(tmp_path)],
            *["--out", f"{bucket}/runs/unseen"],
        ],
    )
    assert isinstance(done.exception, VfoaError)
    assert "expected --cache on object storage, too, or --no-cache" in str(done.exception)


def test_a_worker_that_sees_another_storage_of_the_same_name_refuses_its_job(
    experiment: Path, bucket: str, tmp_path: Path
) -> None:
    one = prepare(load_experiment(str(experiment))).clips[0]
    job = ClipJob(
        manifest=one.manifest, frames=one.frames, labels=None, configurations=(), directory=RunDirectory(tmp_path)
    )
    with pytest.raises(
        VfoaError, match=r"^s3://vfoa/runs/nowhere: no manifest\.json of the run, as seen by the worker"
    ):
        run_elsewhere(f"{bucket}/runs/nowhere", job, print)


def test_a_second_run_at_an_address_is_refused(experiment: Path, bucket: str) -> None:
    address = f"{bucket}/runs/busy"
    with leased(address, print):
        done = CliRunner().invoke(app, ["run", str(experiment), "--no-cache", "--out", address])
        assert isinstance(done.exception, VfoaError)
        assert f"{address}: process {os.getpid()} on " in str(done.exception)
    assert not Remote(address).files()


@pytest.mark.parametrize("option", ["--out", "--cache"])
def test_a_missing_bucket_is_one_line_before_anything_is_computed(option: str, experiment: Path, bucket: str) -> None:
    done = CliRunner().invoke(app, ["run", str(experiment), option, "s3://nowhere/x"])
    assert str(done.exception) == (
        "s3://nowhere/x: cannot be written: FileNotFoundError: The specified bucket does not exist"
    )


def test_missing_keys_are_one_line(bucket: str, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY"):
        monkeypatch.delenv(name)
    fsspec.filesystem("s3").clear_instance_cache()
    try:
        with pytest.raises(VfoaError, match=r"^s3://vfoa/x: cannot be written: NoCredentialsError: Unable to locate"):
            Remote("s3://vfoa/x").check_writable()
    finally:
        fsspec.filesystem("s3").clear_instance_cache()


def test_what_a_run_removes_or_changes_here_is_removed_or_changed_there(bucket: str) -> None:
    mirror = Mirror(f"{bucket}/runs/mirror")
    mirror.pull()
    folder = mirror.folder
    assert Mirror.at(folder) is not None
    for name in ("kept.txt", "changed.txt", "gone.txt", ".lock", "partial/a.jsonl"):
        write_text(folder / name, name)
    mirror.push()
    assert sorted(Remote(mirror.address).files()) == ["changed.txt", "gone.txt", "kept.txt", "partial/a.jsonl"]
    (folder / "gone.txt").unlink()
    write_text(folder / "changed.txt", "longer than before")
    Remote(mirror.address).write("new.txt", b"of a worker")
    mirror.push()
    mirror.pull()
    assert (folder / "new.txt").read_text() == "of a worker"
    assert not Remote(mirror.address).has("gone.txt")
    assert Remote(mirror.address).read("changed.txt") == b"longer than before"
    Remote(mirror.address).remove_all()
    mirror.pull()
    assert list(folder.iterdir()) == [folder / ".lock"]  # so that another run can begin there
    assert RunDirectory(folder).is_new()
