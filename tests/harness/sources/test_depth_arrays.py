"""Depth, disparity and ids in NumPy's files: of one array alone, or of an archive with one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness.sources.depth_folder import DepthFolderClip, DepthFolderSettings
from harness.sources.depth_layouts import recognise_depth
from harness.sources.media.maps import read_depth_file, read_disparity, read_ids
from tests.disk import HEIGHT, WIDTH, picture, write_image
from vfoa.errors import VfoaError

CAMERA = {"fx_px": 100, "cx_px": 31.5, "cy_px": 23.5}
MM = np.random.default_rng(3).integers(500, 4000, (HEIGHT, WIDTH)).astype(np.uint16)


def _take(root: Path, suffix: str) -> Path:
    (root / "depth").mkdir(parents=True)
    for n in (3, 4):
        write_image(root / "rgb" / f"{n}.png", picture(n))
        if suffix == "npz":
            np.savez_compressed(root / "depth" / f"{n}.npz", depth=MM)
        else:
            np.save(root / "depth" / f"{n}.npy", MM)
    return root


@pytest.mark.parametrize("suffix", ["npy", "npz"])
def test_a_folder_of_arrays_is_depth(tmp_path: Path, suffix: str) -> None:
    root = _take(tmp_path / "take", suffix)
    (found,) = recognise_depth(root, {})
    (named,) = recognise_depth(root, {"colour": "rgb", "depth": "depth"})
    assert (found.source["depth"], named.source["depth"]) == (f"depth/*.{suffix}", "depth")
    for source in (found.source, named.source):
        clip = DepthFolderClip(DepthFolderSettings.model_validate({**source, "camera": CAMERA}), root)
        assert tuple(clip.frames) == (3, 4)
        np.testing.assert_allclose(clip.frame(3).depth_m, MM / 1000, rtol=1e-6)


def test_an_archive_of_one_array_is_a_map(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    np.savez(path, np.full((4, 5), 7.5, np.float32))
    assert read_disparity(path).tolist() == np.full((4, 5), 7.5).tolist()
    np.savez_compressed(path, ids=np.full((4, 5), 7, np.int64))
    assert read_ids(path).tolist() == np.full((4, 5), 7).tolist()


@pytest.mark.parametrize("arrays", [{}, {"depth": MM, "confidence": MM}, {"depth": np.array([{"a": 1}])}])
def test_an_archive_of_anything_else_is_refused(tmp_path: Path, arrays: dict[str, np.ndarray]) -> None:
    np.savez(path := tmp_path / "a.npz", **arrays)
    with pytest.raises(VfoaError, match=r"a\.npz: "):
        read_depth_file(path, None)


def test_a_folder_without_depth_says_what_is_read(tmp_path: Path) -> None:
    root = _take(tmp_path / "take", "npy")
    for path in (root / "depth").iterdir():
        path.rename(path.with_suffix(".raw"))
    with pytest.raises(VfoaError, match=r"\.npy"):
        recognise_depth(root, {"colour": "rgb", "depth": "depth"})
