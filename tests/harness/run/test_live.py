"""Live runs: sources that do not wait, and what is kept of them."""

from __future__ import annotations

import csv
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from rerun.experimental import ViewerClient

from harness.cli import main
from harness.clips.manifest import ClipManifest, make_manifest
from harness.record import viewer
from harness.report.sinks import recordings
from harness.run.directory import RunDirectory
from harness.run.experiment import Experiment, load_experiment
from harness.run.live import LiveReport, Newest, run_live
from harness.run.results import read_results
from harness.sources.live import Arrival, CameraPair, LiveSource, PlayedClip
from harness.sources.recordings.mcap_tail import McapTail, follow_records
from harness.sources.recordings.topics import RecordingSettings
from harness.sources.stereo_folder import StereoFolderClip, StereoFolderSettings
from harness.stages.configuration import STAGES
from tests.alley import write_masks
from tests.disk import HEIGHT, WIDTH, moving_picture, picture, sintel_scene, write_text, write_video
from tests.harness.record.test_viewer import needs_vulkan
from tests.recordings import recorder, rectified_camera
from vfoa.errors import VfoaError
from vfoa.estimator import rectified_rig
from vfoa.types import StereoFrame

CAMERA = {"fx_px": 50.0, "cx_px": 31.5, "cy_px": 23.5, "baseline_m": 0.1}
EXPERIMENT = """
clips = ["any"]
[defaults]
stereo = {{ matcher = "bm", min_depth_m = 1.0 }}
segmentation = {{ model = "coco_panoptic", root = "{masks}" }}
heads.detector = "person_mask"
head_pose.model = "none"
gaze.model = "none"
"""
MANIFEST = make_manifest({"name": "live", "adapter": "any"}, Path("live.toml"))


@pytest.fixture(scope="module")
def experiment_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One that runs without models, on frames from 0 to 199."""
    folder = tmp_path_factory.mktemp("live")
    return write_text(folder / "plain.toml", EXPERIMENT.format(masks=write_masks(folder / "masks", range(200))))


@pytest.fixture(scope="module")
def experiment(experiment_file: Path) -> Experiment:
    return load_experiment(str(experiment_file))


def _run(
    source: LiveSource, experiment: Experiment, out: Path, manifest: ClipManifest = MANIFEST, **options: object
) -> LiveReport:
    given = {"stopped": Event(), **options}
    return run_live(source, manifest, experiment, RunDirectory(out), **given)  # type: ignore[arg-type]


def _frames(out: Path) -> list[int]:
    return [record.frame for record in read_results(out / "results.jsonl")]


# The newest frame


class Ticking:
    """Frames of a source that ticks when the test says so; the last is followed by an error, if there is one."""

    rate_hz = None

    def __init__(self, count: int, error: VfoaError | None = None) -> None:
        self.go = [Event() for _ in range(count)]
        self.error = error

    def begin(self) -> None:
        pass

    def arrivals(self, stopped: Event) -> Iterator[Arrival]:
        for number, go in enumerate(self.go, start=1):
            assert go.wait(30)
            yield Arrival(number=number, time_ns=number, arrived_s=time.monotonic(), read=_never)
        if self.error:
            raise self.error


def _never() -> StereoFrame:
    raise AssertionError("nobody asked for it")


def test_whoever_asks_gets_the_newest_frame_and_the_others_are_counted() -> None:
    source = Ticking(7)
    newest = iter(Newest(source, Event()))
    source.go[0].set()
    assert [(arrival.number, dropped) for arrival, dropped in [next(newest)]] == [(1, 0)]
    for go in source.go[1:6]:
        go.set()
    time.sleep(0.05)  # for some of them to come
    arrival, dropped = next(newest)
    assert dropped == arrival.number - 2
    source.go[6].set()
    rest = list(newest)
    assert rest[-1][0].number == 7
    assert 2 + len(rest) + dropped + sum(each for _, each in rest) == 7


def test_a_source_that_breaks_gives_its_last_frame_before_its_error() -> None:
    source = Ticking(1, VfoaError("unplugged"))
    source.go[0].set()
    newest = iter(Newest(source, Event()))
    assert next(newest)[0].number == 1
    with pytest.raises(VfoaError, match="unplugged"):
        next(newest)


# Clips at their own pace


def test_a_clip_comes_at_its_own_rate_and_every_frame_is_done_or_dropped(
    experiment: Experiment, tmp_path: Path
) -> None:
    images = [moving_picture(number) for number in range(30)]
    for side in ("left", "right"):
        write_video(tmp_path / f"{side}.mkv", images, rate_hz=25.0)
    settings = StereoFolderSettings.model_validate(
        {"layout": "videos", "left": "left.mkv", "right": "right.mkv", "camera": CAMERA}
    )
    source = PlayedClip(StereoFolderClip(settings, tmp_path), "videos")
    started = time.monotonic()
    report = _run(source, experiment, tmp_path / "run")
    assert time.monotonic() - started >= 29 / 25
    frames = _frames(tmp_path / "run")
    assert report.frames + report.dropped == 30
    assert frames == sorted(set(frames))
    assert len(frames) == report.frames
    assert frames[-1] == 29  # the newest is always taken
    rows = list(csv.DictReader((tmp_path / "run" / "latency.csv").read_text().splitlines()))
    assert [int(row["frame"]) for row in rows] == frames
    assert sum(int(row["dropped_before"]) for row in rows) == report.dropped
    latencies = sorted(float(row["latency_ms"]) for row in rows)
    assert latencies[0] > 0
    assert report.latency_median_ms == pytest.approx(np.median(latencies), abs=0.1)
    assert json.loads((tmp_path / "run" / "manifest.json").read_text())["live"]["dropped"] == report.dropped


@pytest.mark.parametrize("threads", [1, 2])
def test_one_frame_and_a_limit_are_kept(experiment: Experiment, tmp_path: Path, threads: int) -> None:
    for count, limit, expected in ((1, None, 1), (50, 2, 2)):
        folder = tmp_path / str(count)
        root = sintel_scene(folder / "data", frames=tuple(range(1, count + 1)))
        manifest = {"name": "alley", "adapter": "sintel", "root": str(root), "source": {"scene": "alley"}}
        source = PlayedClip(make_manifest(manifest, folder / "alley.toml").open(), "alley")
        assert _run(source, experiment, folder / "run", limit=limit, threads=threads).frames == expected
        assert len(_frames(folder / "run")) == expected


class Stalling:
    """A clip that gives one more frame than a failing stage stands, and then nothing, but does not end either."""

    rate_hz = None

    def __init__(self, clip: StereoFolderClip) -> None:
        self._clip = clip

    def begin(self) -> None:
        pass

    def arrivals(self, stopped: Event) -> Iterator[Arrival]:
        for number in (1, 2):
            yield Arrival(number=number, time_ns=0, arrived_s=0.0, read=partial(self._clip.frame, number))
            time.sleep(0.5)
        assert stopped.wait(30), "expected to be told to end"


def test_a_failing_stage_ends_the_run_although_the_source_waits(experiment: Experiment, tmp_path: Path) -> None:
    root = sintel_scene(tmp_path / "data", frames=(1, 2))
    manifest = {"name": "alley", "adapter": "sintel", "root": str(root), "source": {"scene": "alley"}}
    source = Stalling(make_manifest(manifest, tmp_path / "alley.toml").open())  # type: ignore[arg-type]
    (configuration,) = experiment.configurations
    heads = STAGES["heads"].parse({"detector": "truth"}, "test")  # which a live frame does not know
    failing = replace(configuration, choices={**configuration.choices, "heads": heads})
    with pytest.raises(VfoaError, match=r"heads|people"):
        _run(source, replace(experiment, configurations=(failing,)), tmp_path / "run", threads=2)
    assert not (tmp_path / "run").exists()  # the first frame failed: nothing is worth keeping


class Stills:
    """One picture again and again: frames 1, 3, 5, ..., each ready when it is asked for."""

    rate_hz = None

    def begin(self) -> None:
        self.begun = True

    def arrivals(self, stopped: Event) -> Iterator[Arrival]:
        image = moving_picture(0)
        rig = rectified_rig(image, fx_px=50.0, cx_px=31.5, cy_px=23.5, baseline_m=0.1)
        for number in range(1, 2000, 2):
            frame = StereoFrame(index=number, time_ns=number, left=image, right=image, rig=rig)
            yield Arrival(number=number, time_ns=number, arrived_s=time.monotonic(), read=partial(_itself, frame))
            time.sleep(0.005)
            if stopped.is_set():
                return


def _itself(frame: StereoFrame) -> StereoFrame:
    return frame


@pytest.mark.parametrize(("threads", "delay"), [(1, 0), (2, 0), (1, 2), (2, 2)])
def test_key_frames_are_counted_among_the_frames_that_were_taken(tmp_path: Path, threads: int, delay: int) -> None:
    masks = write_masks(tmp_path / "masks", range(2000))
    file = write_text(tmp_path / "key_frames.toml", EXPERIMENT.format(masks=masks))
    experiment = load_experiment(str(file), overrides=("segmentation.every=3", f"segmentation.delay={delay}"))
    _run(Stills(), experiment, tmp_path / "run", limit=7, threads=threads)
    records = list(read_results(tmp_path / "run" / "results.jsonl"))
    due = [max(place - delay, 0) for place in range(len(records))]
    keys = [records[place - place % 3].frame for place in due]
    expected = [None if each.frame == key else key for each, key in zip(records, keys, strict=True)]
    assert len(records) == 7
    assert [each.masks_from for each in records] == expected
    ages = [0 if key is None else each.time_ns - key for each, key in zip(records, expected, strict=True)]
    assert [round(1e9 * (each.masks_age_s or 0)) for each in records] == ages  # a frame's time is its number


# Recordings that are being written


def _write(path: Path, count: int, rate_hz: float, begun: object, at_once: int) -> None:
    """A writer as a robot has it: it never hears of its readers. The first pairs are there before anybody looks."""
    camera = rectified_camera(WIDTH, HEIGHT, 50.0, 31.5, 23.5)
    right_camera = rectified_camera(WIDTH, HEIGHT, 50.0, 31.5, 23.5, 0.1)
    with recorder(path, "protobuf", chunk_size=1) as record:  # a chunk a message: each gets to the file at once
        for number in range(1, count + 1):
            if number > at_once:
                begun.wait(60)  # type: ignore[attr-defined]
                time.sleep(1 / rate_hz)
            stamp = number * 40_000_000
            for side, each, seed in (("left", camera, 0), ("right", right_camera, 1000)):
                record.camera(f"/stereo/{side}/camera_info", stamp, each)
                record.picture(f"/stereo/{side}/image_raw", stamp, picture(seed + number))


@pytest.mark.parametrize("at_once", [2, 20])
def test_a_recording_is_followed_behind_its_writer(experiment: Experiment, tmp_path: Path, at_once: int) -> None:
    path, spawn = tmp_path / "growing.mcap", multiprocessing.get_context("spawn")
    begun, count = spawn.Event(), at_once + 25
    writer = spawn.Process(target=_write, args=(path, count, 25.0, begun, at_once))
    writer.start()
    while not path.exists() or path.stat().st_size < (at_once - 1) * 2 * picture(1).nbytes:
        time.sleep(0.02)
    source = McapTail(path, RecordingSettings())
    source.begin = begun.set  # type: ignore[method-assign]
    report = _run(source, experiment, tmp_path / "run", threads=2)
    writer.join()
    records = list(read_results(tmp_path / "run" / "results.jsonl"))
    assert report.damaged == 0
    # what stood there before is passed over but for its newest pair (the writer's last lines wait in its buffer),
    # by which everything is rehearsed
    assert 1 <= report.frames <= 26
    assert records[-1].time_ns == count * 40_000_000
    assert [record.time_ns for record in records] == sorted({record.time_ns for record in records})
    assert records[0].time_ns >= at_once * 40_000_000


def test_pairs_of_a_growing_recording_are_those_of_the_finished_one(tmp_path: Path) -> None:
    path = tmp_path / "done.mcap"
    everything = Event()
    everything.set()
    _write(path, 5, 1e6, everything, 0)
    arrivals = list(McapTail(path, RecordingSettings()).arrivals(Event()))
    frame = arrivals[-1].read()
    assert np.array_equal(frame.left, picture(5))
    assert np.array_equal(frame.right, picture(1005))
    assert (frame.time_ns, frame.rig.fx_px, frame.rig.baseline_m) == (200_000_000, 50.0, 0.1)


@pytest.mark.parametrize(
    ("data", "said"), [(None, "no such file"), (b"no recording at all", "not MCAP: it starts with")]
)
def test_what_is_no_recording_is_one_line(tmp_path: Path, data: bytes | None, said: str) -> None:
    path = tmp_path / "wrong.mcap"
    if data is not None:
        path.write_bytes(data)
    with pytest.raises(VfoaError, match=said):
        list(McapTail(path, RecordingSettings()).arrivals(Event()))


def test_a_recording_that_begins_anew_is_said(tmp_path: Path) -> None:
    path = tmp_path / "take.mcap"
    with recorder(path) as record:
        record.picture("/left/image", 1, picture(1))
    whole = path.read_bytes()
    path.write_bytes(whole[: whole.index(b"\x0f\4\0\0\0\0\0\0\0")])  # before the end of the data: the writer is at it
    records = follow_records(path, Event())
    while next(records) is not None:
        pass
    path.write_bytes(whole[:50])
    with pytest.raises(
        VfoaError, match=r"take\.mcap: is shorter than the part already read; expected a recording that"
    ):
        next(records)


def test_of_several_cameras_one_is_followed_by_its_topics(tmp_path: Path) -> None:
    path = tmp_path / "rigs.mcap"
    cameras = {side: rectified_camera(WIDTH, HEIGHT, 50, 31.5, 23.5, b) for side, b in (("left", 0.0), ("right", 0.1))}
    with recorder(path) as record:
        for stamp_ns in (1, 2):
            for rig, seed in (("front", 1), ("rear", 2)):
                for side, camera in cameras.items():
                    record.camera(f"/{rig}/{side}/camera_info", stamp_ns, camera)
                    record.picture(f"/{rig}/{side}/image", stamp_ns, picture(seed))
    settings = {"left": "/rear/left/image", "right": "/rear/right/image"}
    (arrival,) = McapTail(path, RecordingSettings.model_validate(settings)).arrivals(Event())
    assert np.array_equal(arrival.read().left, picture(2))
    (arrival,) = McapTail(path, RecordingSettings(left="/front/left/image", right="/front/right/image")).arrivals(
        Event()
    )
    assert np.array_equal(arrival.read().left, picture(1))


def test_a_recording_without_a_pair_says_what_it_has(tmp_path: Path) -> None:
    path = tmp_path / "mono.mcap"
    with recorder(path, "protobuf") as record:
        record.picture("/camera/image", 1, picture(1))
    with pytest.raises(VfoaError, match=r"0 pairs of image topics.*/camera/image"):
        list(McapTail(path, RecordingSettings()).arrivals(Event()))


# Cameras


class FakeCamera:
    """A camera with so many frames; the one in ``broken`` cannot be decoded."""

    def __init__(self, count: int, seed: int, broken: int | None = None) -> None:
        self._left, self._at, self._seed, self._broken = count, 0, seed, broken

    def isOpened(self) -> bool:  # noqa: N802  # OpenCV's name
        return True

    def grab(self) -> bool:
        time.sleep(0.02)
        self._at += 1
        return self._at <= self._left

    def retrieve(self) -> tuple[bool, np.ndarray | None]:
        return (False, None) if self._at == self._broken else (True, picture(self._seed + self._at)[..., ::-1])


def _calibration(folder: Path) -> Path:
    rows = "50 0 31.5 {} 0 50 23.5 0 0 0 1 0"
    return write_text(folder / "calib.txt", f"P2: {rows.format(0)}\nP3: {rows.format(-5)}\n")


def test_two_cameras_are_a_source(experiment: Experiment, tmp_path: Path) -> None:
    calibration = _calibration(tmp_path)
    arrivals = list(CameraPair(FakeCamera(5, 0), FakeCamera(5, 1000, broken=3), calibration).arrivals(Event()))
    assert [arrival.number for arrival in arrivals] == [1, 2, 3, 4]
    frame = arrivals[-1].read()
    assert np.array_equal(frame.left, picture(5))
    assert np.array_equal(frame.right, picture(1005))
    assert (frame.rig.fx_px, frame.rig.baseline_m) == (50.0, pytest.approx(0.1))
    report = _run(CameraPair(FakeCamera(40, 0), FakeCamera(40, 1000), calibration), experiment, tmp_path / "run")
    assert 1 <= report.frames <= 40


def test_a_source_of_damaged_frames_alone_is_an_error(experiment: Experiment, tmp_path: Path) -> None:
    root = sintel_scene(tmp_path / "data", frames=(1, 2))
    for number in (1, 2):
        (root / "training" / "clean_left" / "alley" / f"frame_000{number}.png").write_bytes(b"not a picture")
    manifest = {"name": "alley", "adapter": "sintel", "root": str(root), "source": {"scene": "alley"}}
    with pytest.raises(VfoaError, match=r"no frame can be read.*frame_0001\.png"):
        _run(PlayedClip(make_manifest(manifest, tmp_path / "alley.toml").open(), "alley"), experiment, tmp_path / "run")


def test_a_damaged_frame_is_counted_and_passed_over(experiment: Experiment, tmp_path: Path) -> None:
    root = sintel_scene(tmp_path / "data", frames=tuple(range(1, 31)))
    (root / "training" / "clean_left" / "alley" / "frame_0030.png").write_bytes(b"not a picture")
    manifest = {"name": "alley", "adapter": "sintel", "root": str(root), "source": {"scene": "alley"}}
    source = PlayedClip(make_manifest(manifest, tmp_path / "alley.toml").open(), "alley")
    report = _run(source, experiment, tmp_path / "run")
    assert report.damaged == 1
    assert 30 not in _frames(tmp_path / "run")
    assert "1 damaged" in str(report)


@needs_vulkan
def test_a_viewer_is_shown_the_frames_and_follows_them(experiment: Experiment, tmp_path: Path) -> None:
    root = sintel_scene(tmp_path / "data", frames=tuple(range(1, 31)))
    manifest = {"name": "alley", "adapter": "sintel", "root": str(root), "source": {"scene": "alley"}}
    source = PlayedClip(make_manifest(manifest, tmp_path / "alley.toml").open(), "alley")
    with viewer.listening(["--headless"]) as address:
        _run(source, experiment, tmp_path / "run", sinks=recordings(experiment.configurations, "light", address))
        client = ViewerClient.connect(address)
        deadline, frames = time.monotonic() + 30, _frames(tmp_path / "run")
        while time.monotonic() < deadline:
            (shown,) = client.get_state().recordings or [None]
            times = {timeline.name: (timeline.start, timeline.end) for timeline in shown.timelines} if shown else {}
            if times.get("frame") == (frames[0], frames[-1]) and shown.current_time == frames[-1]:
                return
            time.sleep(0.2)
    pytest.fail(f"expected frames {frames[0]} to {frames[-1]}, followed to the last; found {shown}")


# The command


@pytest.mark.parametrize("sign", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_live_run_and_keeps_it(sign: signal.Signals, experiment_file: Path, tmp_path: Path) -> None:
    root = sintel_scene(tmp_path / "data", frames=tuple(range(1, 151)))
    write_text(
        tmp_path / "datasets" / "alley.toml",
        f'name = "alley"\nadapter = "sintel"\nroot = "{root.as_posix()}"\n[source]\nscene = "alley"\n',
    )
    command = [sys.executable, "-c", "from harness.cli import main; main()", "live", "alley", "--out", "run"]
    process = subprocess.Popen(
        [*command, "--experiment", str(experiment_file)],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[4])},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    deadline = time.monotonic() + 60
    while not list(tmp_path.glob("run/partial/*.partial")) and time.monotonic() < deadline:
        time.sleep(0.05)
    time.sleep(2.5)
    process.send_signal(sign)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    frames = _frames(tmp_path / "run")
    assert 1 <= len(frames) < 150
    assert f"{len(frames)} frames" in out
    assert "latency" in out
    assert (tmp_path / "run" / "alley__default.rrd").is_file()
    assert not list(tmp_path.glob("run/**/*.partial"))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["0", "--right", "1"], "two cameras need --calibration"),
        (["rtsp://caf\udce9", "--right", "1", "--calibration", "c.yaml"], "its name is not UTF-8"),
        (["no_such_clip"], "no clip 'no_such_clip'"),
        (["nowhere.mcap"], "nowhere.mcap: no such file"),
        (["nowhere.mcap", "--source", "lefd=/a"], "unknown key '--source.lefd'; did you mean 'left'"),
        (["nowhere.mcap", "--source", "left"], "left: expected KEY=VALUE, such as left=/front/left/image"),
        (["nowhere.mcap", "--source", "start_s=1"], "--source start_s: has no meaning for a growing recording"),
        (["no_such_clip", "--source", "left=/a"], "--source is for an .mcap file"),
        (["nowhere.mcap", "--calibration", "c.yaml"], "--calibration is for two cameras"),
        (["nowhere.mcap", "--recording", "none", "--viewer"], "nothing for a viewer"),
        (["nowhere.mcap", "--experiment", "demo"], "several configurations; say --config, one of: bm-one"),
        (["nowhere.mcap", "--experiment", "demo", "--config", "bm-onee"], "did you mean 'bm-one'"),
    ],
)
def test_what_cannot_be_run_live_is_one_line(
    arguments: list[str],
    said: str,
    experiment_file: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    monkeypatch.chdir(tmp_path)
    if "--experiment" not in arguments:
        arguments = [*arguments, "--experiment", str(experiment_file)]
    monkeypatch.setattr("sys.argv", ["vfoa", "live", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    line = capsys.readouterr().err
    assert said in line
    assert line.count("\n") == 1
    assert not list(tmp_path.glob("runs/*"))


def test_a_run_that_is_there_is_not_written_over(experiment: Experiment, tmp_path: Path) -> None:
    write_text(tmp_path / "run" / "manifest.json", "{}")
    with pytest.raises(VfoaError, match="holds a run already"):
        _run(Ticking(0), experiment, tmp_path / "run")
