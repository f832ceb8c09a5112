"""Every parser of files that a user or another program has written: whole files to begin with, and what reads them.

A new parser is one line here; the suite and `make fuzz` try all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.clips.manifest import load_manifest
from harness.labels.drawn import read_drawn
from harness.labels.files import read_annotations
from harness.labels.formats import FORMATS
from harness.labels.formats.cvat_drawn import read_cvat_drawn
from harness.run.experiment import load_experiment
from harness.run.fitted_weights import read_fitted
from harness.run.results import read_results
from harness.score.exported import ExportedTable
from harness.sources.calibration_files.one_camera import read_one_camera
from harness.sources.calibration_files.options import Options
from harness.sources.calibration_files.read import read_cameras
from harness.sources.media.depth_files import read_depth_file
from harness.sources.media.disparity_files import read_depth, read_disparity, read_sintel_disparity
from harness.sources.media.images import read_raw, read_rgb
from harness.sources.media.video import Video
from harness.sources.sintel_files import read_camera, read_segments
from harness.sources.stamped_list import read_stamped_list
from harness.stages.outputs.tables import read_table
from tests.calibrations import SIZE
from tests.exchanges import exchange
from tests.fuzz import calibration_seeds as cameras
from tests.fuzz import media_seeds as media
from tests.fuzz import recorded_states as recorded
from tests.fuzz import seeds, states
from tests.fuzz.mutations import Kind


@dataclass(frozen=True, slots=True)
class Parser:
    """A parser by name.

    ``write`` makes a whole file at a path, the first of them; ``more`` makes others. ``read`` raises nothing but a
    VfoaError. ``names_file`` says that its message names the file. The suite tries the first ``suite_cases`` cases,
    fewer of what takes long.
    """

    name: str
    file_name: str
    kind: Kind
    write: Callable[[Path], Any]
    read: Callable[[Path], Any]
    more: tuple[Callable[[Path], Any], ...] = ()
    names_file: bool = True
    suite_cases: int = 150

    @property
    def folder(self) -> str:
        """Its name as that of a folder."""
        return "".join(sign if sign.isalnum() else "-" for sign in self.name.lower())

    def corpus(self, place: Path) -> list[bytes]:
        """Whole files of this parser, made in a folder of their own."""
        found = []
        for number, write in enumerate((self.write, *self.more)):
            path = place / str(number) / self.file_name
            path.parent.mkdir(parents=True, exist_ok=True)
            write(path)
            found.append(path.read_bytes())
        return found


def _cameras(path: Path) -> Any:
    return read_cameras([path], lambda: SIZE)


def _beside(name: str) -> Callable[[Path], Any]:
    """Reads a pair of which the other file is whole: the right camera's, or the extrinsics."""

    def read(path: Path) -> Any:
        other = path.with_name(name)
        if not other.exists():
            cameras.other_calibration(other)
        return read_cameras([path, other], lambda: SIZE)

    return read


def _annotations(path: Path) -> Any:
    return read_annotations(path, timeline=None, subjects=["anna"], targets=["mug", "book"])


def _drawn(path: Path) -> Any:
    drawn = read_drawn(path, frames=None, subjects=["anna"], targets=["mug", "book"])
    return [drawn.at(frame) for frame in range(12)]


def _signals(path: Path) -> Any:
    return read_table(path, ("x", "y", "z"), range(9)).columns.group(("x", "y", "z"))


def _video(path: Path) -> Any:
    video = Video(path)
    return [video.read(place) for place in range(min(len(video.index.stamps_ns), 9))]


def _labels(name: str) -> Callable[[Path], Any]:
    return lambda path: FORMATS.load(name)().read(path, exchange())


def _camera(path: Path) -> Any:
    return read_one_camera(path, SIZE)


def _formats() -> Iterator[Parser]:
    kinds: dict[str, tuple[str, Kind]] = {
        "boris": ("theirs.csv", "csv"),
        "boris-aggregated": ("theirs.csv", "csv"),
        "csv": ("theirs.csv", "csv"),
        "childplay": ("theirs.csv", "csv"),
        "cvat": ("theirs.xml", "xml"),
        "elan": ("theirs.eaf", "xml"),
    }
    for name, (file_name, kind) in kinds.items():
        yield Parser(f"{name} labels", file_name, kind, seeds.exported(name), _labels(name))


PARSERS: Sequence[Parser] = (
    Parser("manifest", "mine.toml", "toml", seeds.manifest, load_manifest, (seeds.measured_manifest, seeds.recorded)),
    Parser("experiment", "e.toml", "toml", seeds.experiment, lambda path: load_experiment(str(path)), suite_cases=100),
    Parser("fitted settings", "fitted.toml", "toml", seeds.fitted, read_fitted),
    Parser("labels", "mine.csv", "csv", seeds.labels, _annotations),
    Parser("drawn", "mine.drawn.csv", "csv", seeds.drawn, _drawn),
    Parser("cvat tracks", "theirs.xml", "xml", seeds.cvat_tracks, lambda path: read_cvat_drawn(path, exchange())),
    *_formats(),
    Parser("BORIS project", "theirs.boris", "json", seeds.boris_project, _labels("boris")),
    Parser("BORIS project, packed", "theirs.boris.gz", "binary", seeds.boris_packed, _labels("boris")),
    Parser("BORIS workbook", "theirs.xlsx", "zip", seeds.boris_workbook, _labels("boris"), suite_cases=50),
    Parser("VideoAttentionTarget labels", "girl.txt", "csv", seeds.attention_target, _labels("videoattentiontarget")),
    Parser("Idiap labels, arrays", "a_gt.npz", "zip", seeds.idiap_arrays, states.idiap_labels),
    Parser("Idiap labels, table", "labels.csv", "csv", seeds.idiap_table, states.idiap_labels),
    Parser("journal of labels", "journal.jsonl", "jsonl", states.write_journal, states.open_labels),
    Parser("results", "results.jsonl", "jsonl", seeds.results, lambda path: list(read_results(path))),
    Parser(
        "run manifest",
        "manifest.json",
        "json",
        states.write_run_manifest,
        states.open_run,
        names_file=False,
        suite_cases=50,
    ),
    Parser("thumbnails", "clip__one.jsonl", "jsonl", states.write_thumbnails, states.open_thumbnails),
    Parser("exported table", "table.json", "json", states.write_exported, ExportedTable.read),
    Parser("cache entry", "entry.bin", "binary", states.write_entry, states.load_entry, names_file=False),
    Parser("cache identity", "identity.json", "json", states.write_identity, states.use_identity, names_file=False),
    Parser("rendered pair", "pair.bin", "binary", states.write_pair, states.load_rendered, names_file=False),
    Parser("signal table", "gaze.csv", "csv", seeds.signals, _signals),
    Parser("heads table", "heads.csv", "csv", seeds.heads, states.read_saved_heads),
    Parser("COCO panoptic", "panoptic.json", "json", states.write_coco, states.read_coco),
    Parser("measured people", "people.csv", "csv", seeds.people, states.open_tables, names_file=False),
    Parser("measured objects", "objects.csv", "csv", seeds.objects, states.open_tables, names_file=False),
    Parser(
        "measured people, Parquet",
        "people.parquet",
        "binary",
        seeds.people_parquet,
        states.open_tables,
        names_file=False,
    ),
    Parser("Idiap tracker", "tracker.csv", "csv", seeds.idiap_tracker, states.open_idiap),
    Parser("list of stamps", "rgb.txt", "text", seeds.stamps, read_stamped_list),
    Parser(
        "OpenCV calibration",
        "stereo.yml",
        "yaml",
        cameras.opencv,
        _cameras,
        (cameras.opencv_rectified,),
    ),
    Parser(
        "OpenCV XML calibration",
        "stereo.xml",
        "xml",
        cameras.opencv,
        _cameras,
        (cameras.opencv_rectified,),
    ),
    Parser("OpenCV intrinsics", "intrinsics.yml", "yaml", cameras.opencv_inner, _beside("extrinsics.yml")),
    Parser("ROS calibration", "left.yaml", "yaml", cameras.ros, _beside("right.yaml")),
    Parser("EuRoC calibration", "cam0.yaml", "yaml", cameras.euroc, _beside("cam1.yaml")),
    Parser("Kalibr calibration", "camchain.yaml", "yaml", cameras.kalibr, _cameras),
    Parser("ZED calibration", "SN1.conf", "text", cameras.zed, _cameras),
    Parser("KITTI calibration", "calib.txt", "text", cameras.kitti, _cameras),
    Parser("Middlebury calibration", "calib.txt", "text", cameras.middlebury, _cameras),
    Parser(
        "matrix calibration",
        "K.txt",
        "text",
        cameras.matrix,
        lambda path: read_cameras([path], lambda: SIZE, Options(baseline_m=0.1)),
        (cameras.foundation,),
    ),
    Parser("one camera, ROS", "camera.yaml", "yaml", cameras.ros, _camera),
    Parser("one camera, JSON", "camera.json", "json", cameras.open3d, _camera, (cameras.realsense,)),
    Parser(
        "one camera, numbers",
        "camera.txt",
        "text",
        cameras.matrix,
        _camera,
        (cameras.four_numbers,),
    ),
    Parser("one camera, npy", "camera.npy", "binary", cameras.npy_camera, _camera),
    Parser("Sintel camera", "frame.cam", "binary", media.sintel_cam, read_camera),
    Parser("Sintel depth", "frame.dpt", "binary", media.dpt, read_depth),
    Parser("Sintel disparity", "frame.png", "binary", media.sintel_png, read_sintel_disparity),
    Parser("Sintel segments", "frame.png", "binary", media.segments_png, read_segments),
    Parser("KITTI disparity", "frame.png", "binary", media.png_16, read_disparity),
    Parser("npy disparity", "frame.npy", "binary", media.npy, read_disparity),
    Parser("PFM disparity", "frame.pfm", "binary", media.pfm, read_disparity),
    *(
        Parser(f"{suffix} depth", f"frame.{suffix}", "binary", write, lambda path: read_depth_file(path, None))
        for suffix, write in (
            ("npy", media.npy),
            ("exr", media.exr),
            ("pfm", media.pfm),
            ("tif", media.png_16),
        )
    ),
    Parser("PNG image", "frame.png", "binary", media.image, read_rgb),
    Parser("JPEG image", "frame.jpg", "binary", media.image, read_rgb, (media.turned_jpeg,)),
    Parser("TIFF image", "frame.tif", "binary", media.image, read_raw),
    Parser("WebP image", "frame.webp", "binary", media.image, read_rgb),
    Parser("video", "both.mkv", "binary", media.video, _video),
    *(
        Parser(f"MCAP, {family}", "take.mcap", "binary", media.mcap(family), recorded.read_recording)
        for family in ("ros2", "protobuf", "json")
    ),
    Parser("MCAP of a depth camera", "take.mcap", "binary", media.depth_bag("mcap"), recorded.read_recording),
    Parser("MCAP of a video", "take.mcap", "binary", media.video_mcap, recorded.read_recording),
    Parser("ROS 1 bag", "take.bag", "binary", media.depth_bag("bag"), recorded.read_recording),
    Parser("ROS 2 bag", "take.db3", "binary", media.depth_bag("db3"), recorded.read_recording),
    Parser(
        "ROS 2 bag's metadata",
        "metadata.yaml",
        "yaml",
        recorded.write_metadata,
        recorded.read_with_metadata,
        suite_cases=50,
    ),
    *(
        Parser(f"message: {name}", "message.bin", "binary", write, recorded.read_message(name))
        for name, write in recorded.MESSAGES.items()
    ),
)
"""All parsers, each under its own name."""
