"""Calibrations as Python saves them: read, or named with what to save instead."""

from __future__ import annotations

import json
import pathlib
import pickle
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.io import savemat

from harness.sources.calibration_files.python_files import FROM_ARRAYS, FROM_PICKLE, SAVE
from harness.sources.calibration_files.read import find_calibrations, read_cameras
from harness.sources.rectification import RawCalibration
from tests.calibrations import RIG, SIZE, opencv_nodes, rectification, write_opencv
from tests.disk import write_bytes, write_text
from tests.repository import REPOSITORY
from vfoa.errors import VfoaError

NODES: dict[str, Any] = opencv_nodes(RIG)
LISTS = {name: value.tolist() for name, value in NODES.items()}
ROWS = {name: value.ravel().tolist() for name, value in NODES.items()}
TUTORIAL: dict[str, Any] = {
    "mtxL": NODES["K1"],
    "distL": NODES["D1"],
    "mtxR": NODES["K2"],
    "distR": NODES["D2"],
    "Rot": NODES["R"],
    "Trns": NODES["T"],
}
NESTED = {
    "left": {"K": LISTS["K1"], "D": LISTS["D1"]},
    "right": {"K": LISTS["K2"], "D": LISTS["D2"]},
    "R": LISTS["R"],
    "T": LISTS["T"],
}
IN_TABLES = {
    "camera_left": {"camera_matrix": LISTS["K1"], "dist_coeffs": LISTS["D1"]},
    "camera_right": {"camera_matrix": LISTS["K2"], "dist_coeffs": LISTS["D2"]},
}
MAPS: dict[str, Any] = {
    name: np.zeros((48, 64), np.float32) for name in ("stereoMapL_x", "stereoMapL_y", "stereoMapR_x", "stereoMapR_y")
}


def _size() -> tuple[int, int]:
    return SIZE


def _json(document: Any) -> Callable[[Path], object]:
    return lambda path: write_text(path, json.dumps(document))


def _yaml(document: Any) -> Callable[[Path], object]:
    """As scripts write it, with values of Python."""
    return lambda path: write_text(path, yaml.dump(document))


def _npz(**arrays: Any) -> Callable[[Path], object]:
    return lambda path: np.savez(path, **arrays)


WRITERS: dict[str, tuple[str, Callable[[Path], object]]] = {
    "savez": ("stereo.npz", _npz(image_size=SIZE, **NODES)),
    "savez_compressed": ("c.npz", lambda path: np.savez_compressed(path, **NODES)),
    "names of a tutorial": ("c.npz", _npz(**TUTORIAL)),
    "matrices beside maps": ("c.npz", _npz(**NODES, **MAPS)),
    "rectification": ("c.npz", _npz(**NODES, **rectification(RIG))),
    "FileStorage in JSON": ("c.json", lambda path: write_opencv(path, NODES, SIZE)),
    "lists in JSON": ("c.json", _json(LISTS)),
    "rows in JSON": ("c.json", _json(ROWS)),
    "nested JSON": ("c.json", _json(NESTED)),
    "a table of the pair in JSON": ("c.json", _json({**IN_TABLES, "stereo": {"R": LISTS["R"], "T": LISTS["T"]}})),
    "a table of the pose in JSON": (
        "c.json",
        _json({**IN_TABLES, "extrinsics": {"rotation_matrix": LISTS["R"], "translation_vector": LISTS["T"]}}),
    ),
    "rotation vector in JSON": ("c.json", _json({**LISTS, "R": RIG.rotation_vector.tolist()})),
    "arrays in YAML": ("c.yaml", _yaml({**NODES, "R": np.asfortranarray(NODES["R"]), "T": NODES["T"].astype(">f8")})),
    "tuples and numbers of NumPy in YAML": (
        "c.yaml",
        _yaml({**LISTS, "image_size": SIZE, "rms": np.float64(0.3), "baseline_m": np.float32(0.12), "when": Path("a")}),
    ),
}


@pytest.mark.parametrize("name", WRITERS)
def test_what_python_saves_is_the_calibration_of_yaml(tmp_path: Path, name: str) -> None:
    file_name, write = WRITERS[name]
    write(path := tmp_path / file_name)
    nodes = NODES | (rectification(RIG) if name == "rectification" else {})
    expected = read_cameras([write_opencv(tmp_path / "c.yml", nodes, SIZE)], _size)
    (tmp_path / "c.yml").unlink()
    cameras = read_cameras([path], _size)
    assert isinstance(cameras, RawCalibration)
    assert isinstance(expected, RawCalibration)
    for side in ("left", "right"):
        one, other = getattr(cameras, side), getattr(expected, side)
        for matrix in "kdrp":
            np.testing.assert_allclose(getattr(one, matrix), getattr(other, matrix), rtol=1e-6, atol=1e-6)
    assert find_calibrations(tmp_path, _size) == ([(file_name,)], [])


FOREIGN: dict[str, tuple[Callable[[Path], object], str]] = {
    "stereo_calib.pkl": (lambda path: write_bytes(path, pickle.dumps(NODES)), "a pickle of Python"),
    "calibration.bin": (lambda path: write_bytes(path, pickle.dumps(NODES)), "a pickle of Python"),
    "stereoParams.mat": (lambda path: write_bytes(path, b"MATLAB 5.0 MAT-file, Platform: PCWIN64"), "a file of MATLAB"),
    "stereo_objects.mat": (lambda path: savemat(path, {"stereoParams": {"K": 1.0}}), "a file of MATLAB"),
    "stereo_new.mat": (lambda path: write_bytes(path, b"MATLAB 7.3 MAT-file, Platform: PCWIN64"), "a file of MATLAB"),
    "calibration.h5": (lambda path: write_bytes(path, b"\x89HDF\r\n\x1a\n"), "a file of HDF5"),
    "Calib_board.toml": (lambda path: write_text(path, '[cam_0]\nname = "left"\n'), "a file in TOML"),
    "camera_matrix.npy": (lambda path: np.save(path, NODES["K1"]), "one array of NumPy"),
    "stereo_calib.npz": (_npz(calibration=np.array(NODES, object)), "objects of Python"),
    "stereoMap.npz": (_npz(**MAPS), "rectification maps"),
    "stereoMap.xml": (lambda path: write_opencv(path, MAPS), "rectification maps"),
    "stereoMap.yml": (lambda path: write_opencv(path, MAPS), "rectification maps"),
    "map_large.xml": (lambda path: write_opencv(path, {"mapx": np.ones((600, 800))}), "rectification maps"),
}


@pytest.mark.parametrize("name", FOREIGN)
def test_another_kind_of_file_is_named_with_what_to_save(tmp_path: Path, name: str) -> None:
    write, kind = FOREIGN[name]
    write(tmp_path / name)
    with pytest.raises(VfoaError, match=kind) as error:
        read_cameras([tmp_path / name], _size)
    assert str(error.value).startswith(f"{tmp_path / name}: ")
    assert "K1" in str(error.value)
    if not name.endswith(".bin"):  # beside images, files of other suffixes are not opened
        assert find_calibrations(tmp_path, _size) == ([], [str(error.value)])


class _Trap:
    def __init__(self, path: Path) -> None:
        self._path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self._path,)


def test_a_pickle_is_not_run(tmp_path: Path) -> None:
    trap = _Trap(tmp_path / "was run")
    write_bytes(tmp_path / "a.pkl", pickle.dumps(trap))
    np.savez(tmp_path / "b.npz", K1=np.array(trap, object))
    write_text(tmp_path / "c.yaml", yaml.dump({**NODES, "K1": trap}))
    for name in ("a.pkl", "b.npz", "c.yaml"):
        with pytest.raises(VfoaError):
            read_cameras([tmp_path / name], _size)
    assert not (tmp_path / "was run").exists()


def test_what_is_advised_can_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    width, height = SIZE
    exec(SAVE, {"np": np, **NODES, "width": width, "height": height})
    cameras = read_cameras([tmp_path / "stereo.npz"], _size)
    assert isinstance(cameras, RawCalibration)
    assert cameras.left.size_px == SIZE


def test_what_is_advised_for_pickles_arrays_and_texts_makes_a_calibration(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_bytes(tmp_path / "FILE", pickle.dumps(TUTORIAL))
    for name, array in NODES.items():
        np.save(tmp_path / f"{name}.npy", array)
        np.savetxt(tmp_path / f"{name}.txt", array)
    page = (REPOSITORY / "datasets" / "README.md").read_text(encoding="utf-8")
    (from_texts,) = re.findall(r"`(np\.savez\([^`]*np\.loadtxt\([^`]*)`", page)
    for advice in (FROM_PICKLE, FROM_ARRAYS, from_texts):
        (tmp_path / "stereo.npz").unlink(missing_ok=True)
        exec(advice, {"np": np, "pickle": pickle, "pathlib": pathlib})
        cameras = read_cameras([tmp_path / "stereo.npz"], _size)
        assert isinstance(cameras, RawCalibration)
        np.testing.assert_allclose(cameras.right.d, NODES["D2"].ravel())


@pytest.mark.parametrize(
    ("name", "write", "fault"),
    [
        ("stereo.yml", lambda path: write_opencv(path, {**NODES, "K1": np.zeros((3, 3))}), "K"),
        ("calibration.json", lambda path: write_text(path, '{"K1": ['), "not JSON"),
        ("stereo.npz", lambda path: write_bytes(path, b"PK damaged"), "not a .npz file"),
        ("rig.npz", _npz(K1=NODES["K1"], D1=NODES["D1"]), "found D1, K1; expected"),
        ("a.json", _json({**LISTS, "T": [0.1, 0, 0]}), "expected a positive one"),
        ("a.yaml", _yaml({**NODES, "T": Path("a")}), "T: found 'an object of Python'; expected numbers"),
    ],
)
def test_a_faulty_calibration_beside_images_is_named(
    tmp_path: Path, name: str, write: Callable[[Path], object], fault: str
) -> None:
    write(tmp_path / name)
    write_text(tmp_path / "notes.json", '{"title": "no calibration"}')
    calibrations, (note,) = find_calibrations(tmp_path, _size)
    assert calibrations == []
    assert name in note
    assert fault in note


def test_one_good_calibration_is_enough(tmp_path: Path) -> None:
    write_text(tmp_path / "calibration.json", "{")
    write_opencv(tmp_path / "stereo.yml", NODES, SIZE)
    assert find_calibrations(tmp_path, _size) == ([("stereo.yml",)], [])


def test_a_file_for_each_frame_is_not_tried(tmp_path: Path) -> None:
    for number in range(30):
        write_text(tmp_path / f"{number}.json", json.dumps(LISTS))
    assert find_calibrations(tmp_path, _size) == ([], [])
    write_opencv(tmp_path / "calibration.json", NODES, SIZE)
    assert find_calibrations(tmp_path, _size) == ([("calibration.json",)], [])
