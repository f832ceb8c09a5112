"""Damage that a run meets, one case per kind of file, and what vfoa says of it; tests/fuzz changes contents.

A row: the name, what is done to a working project, and what the one line on stderr has in it. The command is a run
where none is named. ``SURVIVED`` are the cases that must work all the same.
"""

from __future__ import annotations

import os
import shutil
import struct
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import pyarrow.parquet as pq

from tests.disk import write_text
from tests.harness.damage.project import EXPERIMENT, LABELS, put

Damage = Callable[[Path], object]

RUN = ("run", "e.toml", "--out", "out", "--workers", "1", "--recording", "none")
CHECK = ("clips", "check", "mine")

ONNX = "weights/yolo.onnx"
LEFT = "images/left/000002.png"
MASK = "stage_outputs/png/frame_0002.png"
DISPARITY = "stage_outputs/disparity/frame_0002.npy"


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """One kind of damage: what is done, what is run, and what is said of it (all of ``says``)."""

    name: str
    damage: Damage
    says: tuple[str, ...] = ()
    command: tuple[str, ...] = RUN


def case(name: str, damage: Damage, *says: str, command: tuple[str, ...] = RUN) -> Case:
    return Case(name=name, damage=damage, says=says, command=command)


# The ways


def empty(path: str) -> Damage:
    return lambda root: put(root / path, b"")


def cut(path: str, share: float = 0.6) -> Damage:
    def damage(root: Path) -> None:
        data = (root / path).read_bytes()
        put(root / path, data[: int(share * len(data))])

    return damage


def flipped(path: str, share: float = 0.5) -> Damage:
    def damage(root: Path) -> None:
        data = bytearray((root / path).read_bytes())
        data[int(share * len(data))] ^= 0xFF
        put(root / path, bytes(data))

    return damage


def text(path: str, content: str | bytes = "not what it says it is\n") -> Damage:
    return lambda root: put(root / path, content)


def replaced(path: str, old: str, new: str) -> Damage:
    def damage(root: Path) -> None:
        content = (root / path).read_text()
        assert old in content, (path, old)
        put(root / path, content.replace(old, new))

    return damage


def gone(path: str) -> Damage:
    return lambda root: (root / path).unlink()


def a_folder(path: str) -> Damage:
    def damage(root: Path) -> None:
        (root / path).unlink()
        (root / path).mkdir()

    return damage


def a_pipe(path: str) -> Damage:
    def damage(root: Path) -> None:
        (root / path).unlink()
        os.mkfifo(root / path)

    return damage


def dangling(path: str) -> Damage:
    def damage(root: Path) -> None:
        (root / path).unlink()
        (root / path).symlink_to("nowhere")

    return damage


def image(path: str, pixels: np.ndarray) -> Damage:
    def damage(root: Path) -> None:
        (root / path).unlink(missing_ok=True)
        assert cv2.imwrite(str(root / path), pixels)

    return damage


def claims(path: str, width: int, height: int) -> Damage:
    """The size in a PNG's head is another one, and its checksum right."""

    def damage(root: Path) -> None:
        data = bytearray((root / path).read_bytes())
        data[16:24] = struct.pack(">II", width, height)
        data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
        put(root / path, bytes(data))

    return damage


def array(path: str, values: np.ndarray, *, pickled: bool = False) -> Damage:
    content = BytesIO()
    np.save(content, values, allow_pickle=pickled)
    return lambda root: put(root / path, content.getvalue())


def both(*damages: Damage) -> Damage:
    def damage(root: Path) -> None:
        for each in damages:
            each(root)

    return damage


def pixels(path: str, change: Callable[[np.ndarray], np.ndarray]) -> Damage:
    def damage(root: Path) -> None:
        image(path, change(cv2.imread(str(root / path), cv2.IMREAD_UNCHANGED)))(root)

    return damage


def _no_length(root: Path) -> None:
    path = root / "stage_outputs" / "gaze.csv"
    header, *rows = path.read_text().splitlines()
    columns = header.split(",")
    first = rows[0].split(",")
    for name in ("x", "y", "z"):
        first[columns.index(name)] = "0"
    put(path, "\n".join([header, ",".join(first), *rows[1:]]) + "\n")


def _learned(root: Path) -> None:
    files = 'model = "coco_panoptic", root = "stage_outputs", partial = true'
    replaced("e.toml", files, f'model = "yolo_seg", weights = "{ONNX}"')(root)
    (root / ONNX).parent.mkdir()


_ALL_IMAGES = [f"images/{side}/00000{number}.png" for side in ("left", "right") for number in (1, 2, 3)]


def _gray(colours: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY)


def _deep(colours: np.ndarray) -> np.ndarray:
    return colours.astype(np.uint16) * 257


def _with_mark(root: Path) -> None:
    put(root / TOML, b"\xef\xbb\xbf" + (root / TOML).read_bytes())


def _linked(root: Path) -> None:
    (root / "images" / "left").rename(root / "elsewhere")
    (root / "images" / "left").symlink_to("../elsewhere")


def _renamed(root: Path) -> None:
    (root / "images").rename(root / "Bilder vom Frühstück")
    replaced(TOML, "../images", "../Bilder vom Frühstück")(root)


def _stray(root: Path) -> None:
    Path(os.fsdecode(os.fsencode(root / "images" / "left") + b"/\xff\xfe.png")).write_bytes(b"")


def _without_last_answer(root: Path) -> None:
    table, changed = pq.read_table(root / _ANSWERS), BytesIO()
    pq.write_table(table.slice(0, table.num_rows - 1), changed, write_page_checksum=True)
    put(root / _ANSWERS, changed.getvalue())


def _answers_flipped(root: Path) -> None:
    """Flip the bits of the last byte of the frames' numbers."""
    table = pq.ParquetFile(root / _ANSWERS)
    numbers = table.metadata.row_group(0).column(table.schema_arrow.names.index("frame"))
    begin = numbers.dictionary_page_offset or numbers.data_page_offset
    data = bytearray((root / _ANSWERS).read_bytes())
    data[begin + numbers.total_compressed_size - 1] ^= 0xFF
    put(root / _ANSWERS, bytes(data))


# The table

_IMAGES = [
    case("image cut", cut(LEFT), "000002.png", "truncated"),
    case("image of another size", image(LEFT, np.zeros((48, 64, 3), np.uint8)), "000002.png", "64", "1024"),
    case("image claims no pixels", claims(LEFT, 0, 436), "000002.png", "without pixels"),
    case("image gone on one side", gone("images/right/000002.png"), "frame 2: not in the clip"),
    case("image is a folder", a_folder(LEFT), "000002.png", "directory"),
    case("image is a pipe", a_pipe(LEFT), "000002.png", "not a plain file"),
    case("image is a dangling link", dangling(LEFT), "000002.png", "a link to nowhere, which does not exist"),
    case("no images on one side", lambda root: [each.unlink() for each in (root / "images/left").iterdir()], "left"),
    case("a stray image whose name is not UTF-8", _stray, "do not share one numbering"),
    case("folder of images gone", lambda root: os.rename(root / "images/left", root / "images/links"), "left"),
]

YML = "images/stereo.yml"
_CALIBRATION = [
    case("calibration cut", cut(YML), "stereo.yml"),
    case("calibration gone", gone(YML), "stereo.yml", "no such file"),
    case("calibration without a baseline", replaced(YML, "-0.059999999999999998", "0."), "stereo.yml: T:", "not all 0"),
    case("calibration with swapped views", replaced(YML, "-0.059999999999999998", "0.06"), "stereo.yml"),
    case(
        "calibration of another size",
        replaced(YML, "image_width: 1024", "image_width: 640"),
        "calibration",
        "640",
        "1024",
    ),
]

TOML = "datasets/mine.toml"
_MANIFEST = [
    case("manifest with a wrong type", replaced(TOML, "rate_hz = 25.0", 'rate_hz = "fast"'), "mine.toml", "rate_hz"),
    case("manifest of an unknown adapter", replaced(TOML, '"stereo_folder"', '"stereo_fodler"'), "stereo_folder"),
    case("manifest is a dangling link", dangling(TOML), "mine.toml", "a link to nowhere, which does not exist"),
    case("manifest is a folder", a_folder(TOML), "no clip 'mine'"),
]

CSV = "annotations/mine.csv"
_ANNOTATIONS = [
    case("annotations are a pipe", a_pipe(CSV), "mine.csv", "not a plain file"),
    case("annotations overlap", text(CSV, LABELS + "2,3,anna,book,\n"), "mine.csv:4"),
    case("annotations name an unknown target", replaced(CSV, "mug", "mgu"), "mine.csv:3", "'mug'"),
]

_EXPERIMENT = [
    case("experiment cut", cut("e.toml", 0.5), "e.toml"),
    case("experiment with an impossible number", text("e.toml", EXPERIMENT + "attention.n_rays = 0\n"), "n_rays"),
]

_STAGE_OUTPUTS = [
    case("mask of another size", image(MASK, np.zeros((10, 10, 3), np.uint8)), "frame_0002.png", "10"),
    case("mask with an unknown id", pixels(MASK, lambda ids: np.full_like(ids, 77)), "frame_0002.png"),
    case("panoptic.json cut", cut("stage_outputs/panoptic.json"), "panoptic.json"),
    case("disparity of another size", array(DISPARITY, np.ones((5, 5), np.float32)), "frame_0002.npy", "5"),
    case(
        "disparity is a pickle",
        array(DISPARITY, np.array([[{}]], dtype=object), pickled=True),
        "frame_0002.npy",
    ),
    case("disparity gone", gone(DISPARITY), "frame_0002.npy"),
    case("heads lack a column", replaced("stage_outputs/heads.csv", "u0_px", "u_px"), "heads.csv", "u0_px"),
    case("gaze of no length", _no_length, "gaze.csv:2"),
]

_WEIGHTS = [
    case("weights are text", both(_learned, text(ONNX)), "yolo.onnx"),
    case("weights gone", _learned, "yolo.onnx"),
]

_OUTPUT = [
    case("output is a file", text("out", ""), "out"),
    case("output under a file", lambda root: None, "e.toml", command=(*RUN[:3], "e.toml/out", *RUN[4:])),
    case("output holds something else", lambda root: write_text(root / "out" / "notes.txt", "mine"), "out"),
]

REFUSED = [*_IMAGES, *_CALIBRATION, *_MANIFEST, *_ANNOTATIONS, *_EXPERIMENT, *_STAGE_OUTPUTS, *_WEIGHTS, *_OUTPUT]
SURVIVED = [
    case("annotations with a byte-order mark", text(CSV, b"\xef\xbb\xbf" + LABELS.encode())),
    case("annotations with CRLF", text(CSV, LABELS.replace("\n", "\r\n"))),
    case("manifest with a byte-order mark", _with_mark),
    case("gray images", both(*(pixels(each, _gray) for each in _ALL_IMAGES))),
    case("16-bit images", both(*(pixels(each, _deep) for each in _ALL_IMAGES))),
    case("images behind a link", _linked),
    case("a folder with spaces and umlauts", _renamed),
]


# Runs that stand already


_SCORE = ("score", "run")
_EXPORT = ("export-failure", "run", "--clip", "mine", "--frame", "2")
_ANSWERS = "run/answers/only/mine.parquet"
_RUN_MANIFEST = "run/manifest.json"

RUNS = [
    case("answers empty", empty(_ANSWERS), "mine.parquet: damaged:", command=_SCORE),
    case("answers cut", cut(_ANSWERS, 0.5), "mine.parquet: damaged:", command=_SCORE),
    case("answers lack a row", _without_last_answer, "mine.parquet: frame 3: expected the tracks", command=_SCORE),
    case("answers with a flipped bit", _answers_flipped, "mine.parquet: cannot be read", "CRC", command=_SCORE),
    case("answers are binary", text(_ANSWERS, bytes(range(256))), "mine.parquet: damaged:", command=_SCORE),
    case("answers are a pipe", a_pipe(_ANSWERS), "mine.parquet", "not a plain file", command=_SCORE),
    case("answers gone", gone(_ANSWERS), "mine.parquet: no such file", command=_SCORE),
    case("run without answers", lambda root: shutil.rmtree(root / "run/answers"), "an earlier version", command=_SCORE),
    case("run's manifest empty", empty(_RUN_MANIFEST), "manifest.json", command=_SCORE),
    case("run's manifest cut", cut(_RUN_MANIFEST), "manifest.json", command=_SCORE),
    case("run's manifest is a list", text(_RUN_MANIFEST, "[1, 2]"), "manifest.json", command=_SCORE),
    case("run's manifest without clips", text(_RUN_MANIFEST, '{"finished": "now"}'), command=_SCORE),
    case("run's manifest of words", replaced(_RUN_MANIFEST, '"clips": [', '"clips": ["a", '), "clips", command=_SCORE),
    case("run's manifest with 5,000 digits", text(_RUN_MANIFEST, 5_000 * "9"), "64 bits", command=_SCORE),
    case(
        "run's manifest with a stage of text",
        text(_RUN_MANIFEST, '{"configurations": {"only": {"segmentation": "text"}}}'),
        "manifest.json",
        "only.segmentation",
        command=_SCORE,
    ),
    case("run's manifest is a pipe", a_pipe(_RUN_MANIFEST), "manifest.json", "not a plain file", command=_SCORE),
    case("run's manifest gone", gone(_RUN_MANIFEST), "run", command=_SCORE),
    case("annotations spoilt since", text(CSV, LABELS + "2,3,anna,book,\n"), "mine.csv:4", command=_SCORE),
    case("timings cut", cut("run/timings.parquet", 0.53), "timings.parquet", command=_SCORE),
    case("recording gone", gone("run/mine__only.rrd"), "*.rrd", command=_EXPORT),
    case("recording empty", empty("run/mine__only.rrd"), "mine__only.rrd", command=_EXPORT),
    case("recording is text", text("run/mine__only.rrd"), "mine__only.rrd", command=_EXPORT),
]
"""Messages on a finished run whose files are damaged; its tables stay as they were."""
