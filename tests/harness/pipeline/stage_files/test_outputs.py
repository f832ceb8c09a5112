from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.pipeline.stage_files.coco_panoptic import CocoPanoptic, CocoPanopticSettings
from harness.pipeline.stage_files.maps import FileMatcher, FileMatcherSettings
from harness.sources.media.maps import read_disparity, read_pfm, small_ids
from harness.sources.sintel import SintelClip, SintelSettings
from harness.sources.stereo_folder import StereoFolderClip
from tests.disk import (
    HEIGHT,
    WIDTH,
    sintel_disparity,
    sintel_scene,
    write_bytes,
    write_image,
    write_text,
)
from tests.pairs import open_pairs
from vfoa.errors import VfoaError
from vfoa.pixels import relabel

CATEGORIES = [
    {"id": 1, "name": "person", "isthing": 1},
    {"id": 16, "name": "bird", "isthing": 1},
    {"id": 187, "name": "sky", "isthing": 0},
]
SEGMENTS = [
    {"id": 3, "category_id": 1, "score": 0.75},
    {"id": 70000, "category_id": 16},
    {"id": 5, "category_id": 187},
    {"id": 6, "category_id": 1, "iscrowd": 1},
    {"id": 9, "category_id": 1},
]


@pytest.fixture
def clip(tmp_path: Path) -> StereoFolderClip:
    return open_pairs(tmp_path, (4, 7))


def _map() -> np.ndarray:
    """Ids by row band: 0, 3, 70000, 5, 6; segment 9 of the JSON is not drawn."""
    ids = np.zeros((HEIGHT, WIDTH), np.uint32)
    for band, number in enumerate((0, 3, 70000, 5, 6)):
        ids[band * 8 : band * 8 + 8] = number
    return ids


def _coco(root: Path, segments: list[dict[str, Any]] = SEGMENTS, ids: np.ndarray | None = None) -> str:
    _coco_masks(root, _map() if ids is None else ids)
    annotations = [
        {"image_id": number, "file_name": f"frame_{number:04d}.png", "segments_info": segments} for number in (4, 7)
    ]
    content = {"images": [], "annotations": annotations, "categories": CATEGORIES}
    write_text(root / "panoptic.json", json.dumps(content))
    return str(root)


def _coco_masks(root: Path, ids: np.ndarray) -> None:
    image = np.stack([ids & 255, ids >> 8 & 255, ids >> 16], axis=-1).astype(np.uint8)
    for number in (4, 7):
        write_image(root / "png" / f"frame_{number:04d}.png", image)


def test_things_are_read_and_stuff_only_by_name(clip: StereoFolderClip, tmp_path: Path) -> None:
    root = _coco(tmp_path / "coco")
    found = CocoPanoptic(CocoPanopticSettings(root=root), clip).segment(clip.frame(7))
    assert [(instance.id, instance.label, instance.is_thing, instance.score) for instance in found.instances] == [
        (3, "person", True, 0.75),
        (1, "bird", True, 1.0),
    ]
    assert np.array_equal(found.mask(3), _map() == 3)
    assert np.array_equal(found.mask(1), _map() == 70000)
    assert np.array_equal(found.mask(0), np.isin(_map(), [0, 5, 6]))
    with_sky = CocoPanoptic(CocoPanopticSettings(root=root, stuff=("sky",)), clip).segment(clip.frame(7))
    assert [(instance.id, instance.label, instance.is_thing) for instance in with_sky.instances][-1] == (
        5,
        "sky",
        False,
    )


def test_ids_are_those_of_objects_unless_one_has_two_categories(clip: StereoFolderClip, tmp_path: Path) -> None:
    """Other programs number the segments of each frame anew, so that a number is a person now and a bird later."""
    root = tmp_path / "coco"
    person = {"id": 3, "category_id": 1}
    _coco_masks(root, np.full((HEIGHT, WIDTH), 3, np.uint32))
    for segments, keep in (
        ([person, {"id": 70000, "category_id": 16}], True),
        ([{"id": 3, "category_id": 16}], False),
    ):
        annotations = [
            {"image_id": 4, "file_name": "frame_0004.png", "segments_info": [person]},
            {"image_id": 7, "file_name": "frame_0007.png", "segments_info": segments},
        ]
        write_text(root / "panoptic.json", json.dumps({"annotations": annotations, "categories": CATEGORIES}))
        segmenter = CocoPanoptic(CocoPanopticSettings(root=str(root)), clip)
        assert [each.keeps_id for number in (4, 7) for each in segmenter.segment(clip.frame(number)).instances] == [
            keep,
            keep,
        ]


def test_the_masks_of_bandage_2_hold_the_girl_and_the_dragon_in_every_frame(shared_data: Path) -> None:
    clip = SintelClip(SintelSettings.model_validate({"scene": "bandage_2"}), shared_data / "sintel")
    segmenter = CocoPanoptic(CocoPanopticSettings(root=str(shared_data / "bandage_2_panoptic")), clip)
    for number in (1, 25, 50):
        found = segmenter.segment(clip.frame(number))
        assert sorted(instance.label for instance in found.instances) == ["bird", "person"]
        assert all(found.mask(instance.id).sum() > 1000 for instance in found.instances)


def test_mistakes_in_the_masks_are_one_line(clip: StereoFolderClip, tmp_path: Path) -> None:
    def segment(name: str, **change: Any) -> None:
        settings = CocoPanopticSettings(root=_coco(tmp_path / name, **change))
        CocoPanoptic(settings, clip).segment(clip.frame(4))

    with pytest.raises(VfoaError, match=r"frame_0004\.png: .*5; .*panoptic\.json"):
        segment("unknown", segments=[SEGMENTS[0], SEGMENTS[1], SEGMENTS[3]])
    with pytest.raises(VfoaError, match=r"segment 3 .*category_id 2.*16, 187"):
        segment("category", segments=[{"id": 3, "category_id": 2}, *SEGMENTS[1:]])
    with pytest.raises(VfoaError, match=r"frame_0004\.png: .*64 x 47.*64 x 48"):
        segment("size", ids=_map()[1:])
    with pytest.raises(VfoaError, match=r"segments_info\[0\]: .*`category_id`"):
        segment("broken", segments=[{"id": 3}])
    with pytest.raises(VfoaError, match=r"frame_0004\.png: segments_info: id 3 "):
        segment("twice", segments=[SEGMENTS[0], *SEGMENTS])


def test_mistakes_around_the_masks_are_one_line(clip: StereoFolderClip, tmp_path: Path) -> None:
    root = _coco(tmp_path / "coco")
    with pytest.raises(VfoaError, match=r"no stuff category 'ski'.*'sky'\?"):
        CocoPanoptic(CocoPanopticSettings(root=root, stuff=("ski",)), clip)
    with pytest.raises(VfoaError, match=r"gone/panoptic\.json: no such file"):
        CocoPanoptic(CocoPanopticSettings(root=str(tmp_path / "gone")), clip)
    with pytest.raises(VfoaError, match="VFOA_NOT_SET"):
        CocoPanoptic(CocoPanopticSettings(root="${VFOA_NOT_SET}/x"), clip)
    document = json.loads((tmp_path / "coco" / "panoptic.json").read_text())
    for table, said in (("annotations", r"file_name 'frame_0004\.png'"), ("categories", "id 1")):
        twice = document | {table: [*document[table], document[table][0]]}
        write_text(tmp_path / "coco" / "panoptic.json", json.dumps(twice))
        with pytest.raises(VfoaError, match=rf"panoptic\.json: {table}: {said}"):
            CocoPanoptic(CocoPanopticSettings(root=root), clip)
    deep = '{"info": ' + "[" * 100_000
    for content, said in (
        ("{", "not JSON"),
        ("[]", "the document"),
        (deep, "(?:nested|not JSON)"),
        ("\ud800", "not JSON"),
    ):
        (tmp_path / "coco" / "panoptic.json").write_bytes(content.encode(errors="surrogatepass"))
        with pytest.raises(VfoaError, match=rf"panoptic\.json: {said}"):
            CocoPanoptic(CocoPanopticSettings(root=root), clip)


def test_a_frame_without_masks_is_found_at_the_start(tmp_path: Path) -> None:
    clip = SintelClip(SintelSettings.model_validate({"scene": "alley"}), sintel_scene(tmp_path, frames=(4, 5)))
    with pytest.raises(VfoaError, match="no annotation for frame 5"):
        CocoPanoptic(CocoPanopticSettings(root=_coco(tmp_path / "coco")), clip)


def test_the_masks_digest_follows_their_contents(clip: StereoFolderClip, tmp_path: Path) -> None:
    def digest(name: str, **change: Any) -> str:
        return CocoPanoptic(CocoPanopticSettings(root=_coco(tmp_path / name, **change)), clip).digest()

    other = _map()
    other[0, 0] = 3
    assert digest("a") == digest("b")
    assert digest("c", ids=other) != digest("a")


@pytest.mark.parametrize(
    ("value", "place"),
    [
        ({"id": 1 << 24, "category_id": 1}, "id"),
        ({"id": -1, "category_id": 1}, "id"),
        ({"id": 1, "category_id": "person"}, "category_id"),
        ({"id": 1, "category_id": 1, "score": float("nan")}, ""),
        ({"id": 1, "category_id": 1, "name": "a,\nb"}, ""),
    ],
)
def test_a_wrong_value_in_the_masks_is_named(
    clip: StereoFolderClip, tmp_path: Path, value: dict[str, Any], place: str
) -> None:
    with pytest.raises(VfoaError, match=rf"panoptic\.json: .*{place}") as error:
        CocoPanoptic(CocoPanopticSettings(root=_coco(tmp_path / "coco", [value])), clip)
    assert "\n" not in str(error.value)


def test_flags_whole_scores_and_other_keys_are_read(clip: StereoFolderClip, tmp_path: Path) -> None:
    root = Path(_coco(tmp_path / "coco", [{"id": 3.0, "category_id": 1, "iscrowd": False, "score": 1, "area": 10**30}]))
    document = json.loads((root / "panoptic.json").read_text())
    document["categories"][0]["isthing"] = True
    write_text(root / "panoptic.json", "\ufeff" + json.dumps(document))
    ids = np.where(_map() == 3, 3, 0)
    _coco_masks(root, ids)
    (person,) = CocoPanoptic(CocoPanopticSettings(root=str(root)), clip).segment(clip.frame(4)).instances
    assert (person.id, person.label, person.score) == (3, "person", 1.0)


@given(st.sets(st.integers(0, (1 << 24) - 1), max_size=50))
def test_small_ids_are_distinct_and_keep_what_fits(ids: set[int]) -> None:
    small = small_ids(ids, "here")
    assert small.keys() == ids - {0}
    assert len(set(small.values())) == len(small)
    assert all(0 < new <= 65535 and (new == old or old > 65535) for old, new in small.items())


def test_too_many_ids_are_refused() -> None:
    with pytest.raises(VfoaError, match="65536 different segment ids"):
        small_ids(range(1, 65537), "here")


def test_ids_that_nobody_wants_become_no_instance() -> None:
    ids = np.array([[0, 9], [70000, 9]], np.uint32)
    assert relabel(ids, {70000: 1}).tolist() == [[0, 0], [1, 0]]


# Disparity


def _disparity() -> np.ndarray:
    """Multiples of 1/64 (exact in every format here), with a hole."""
    disparity = np.random.default_rng(0).integers(1, 64 * 60, (HEIGHT, WIDTH)).astype(np.float32) / 64
    disparity[3, 5] = np.nan
    return disparity


def _write_disparity(root: Path, suffix: str) -> None:
    disparity = _disparity()
    zeroed = np.nan_to_num(disparity)
    for number in (4, 7):
        path = root / f"d_{number:03d}.{suffix.split('-')[0]}"
        match suffix:
            case "npy":
                write_bytes(path, b"")
                np.save(path, disparity.astype(np.float64))
            case "pfm":
                write_image(path, np.where(np.isnan(disparity), np.float32(np.inf), disparity))
            case "png-sintel":
                write_image(path, sintel_disparity(zeroed))
            case "png-kitti":
                write_image(path, (zeroed * 256).astype(np.uint16))


@pytest.mark.parametrize("suffix", ["npy", "pfm", "png-sintel", "png-kitti"])
def test_every_format_gives_the_same_map(clip: StereoFolderClip, tmp_path: Path, suffix: str) -> None:
    _write_disparity(tmp_path / "disparity", suffix)
    pattern = f"d_%03d.{suffix.split('-')[0]}"
    matcher = FileMatcher(FileMatcherSettings(root=str(tmp_path / "disparity"), pattern=pattern), clip)
    np.testing.assert_array_equal(matcher.match(clip.frame(7)).disparity_px, _disparity())


@given(width=st.integers(1, 7), height=st.integers(1, 7), little=st.booleans(), seed=st.integers(0, 9))
def test_pfm_rows_go_up_in_either_byte_order(tmp_path: Path, width: int, height: int, little: bool, seed: int) -> None:
    expected = np.random.default_rng(seed).normal(size=(height, width)).astype(np.float32)
    pixels = expected[::-1].astype("<f4" if little else ">f4").tobytes()
    path = write_bytes(tmp_path / "a.pfm", f"Pf\n{width} {height}\n{-1.0 if little else 1.0}\n".encode() + pixels)
    assert np.array_equal(read_pfm(path), expected)
    if little:
        assert np.array_equal(cv2.imread(str(path), cv2.IMREAD_UNCHANGED), expected)


def test_a_map_of_another_size_or_a_missing_one_is_one_line(clip: StereoFolderClip, tmp_path: Path) -> None:
    for number in (4, 7):
        np.save(tmp_path / f"{number}.npy", np.ones((5, 6), np.float32))
    matcher = FileMatcher(FileMatcherSettings(root=str(tmp_path), pattern="%d.npy"), clip)
    with pytest.raises(VfoaError, match=r"4\.npy: .*6 x 5.*64 x 48"):
        matcher.match(clip.frame(4))
    (tmp_path / "7.npy").unlink()
    with pytest.raises(VfoaError, match=r"7\.npy: no such file.*7"):
        FileMatcher(FileMatcherSettings(root=str(tmp_path), pattern="%d.npy"), clip)
    with pytest.raises(VfoaError, match=r"stereo\.pattern: 'd\.npy'"):
        FileMatcher(FileMatcherSettings(root=str(tmp_path), pattern="d.npy"), clip)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.pfm", b"PF\n2 2\n-1.0\n" + bytes(48), "not a one-channel PFM"),
        ("a.pfm", b"Pf\n2 2\n-1.0\n" + bytes(15), "found 15 bytes of pixels; expected 16"),
        ("a.npy", b"\x93NUMPY", "not an npy file"),
        ("a.exr", b"", "not a readable EXR"),
    ],
)
def test_damaged_maps_are_one_line(tmp_path: Path, name: str, content: bytes, message: str) -> None:
    with pytest.raises(VfoaError, match=message):
        read_disparity(write_bytes(tmp_path / name, content))


@pytest.mark.parametrize("colours", [cv2.COLORMAP_JET, cv2.COLORMAP_VIRIDIS, None])
def test_a_picture_of_disparity_is_refused(tmp_path: Path, colours: int | None) -> None:
    gray = np.tile(np.linspace(0, 255, 320).astype(np.uint8), (200, 1))
    picture = np.dstack([gray] * 3) if colours is None else cv2.applyColorMap(gray, colours)
    with pytest.raises(VfoaError, match="a picture of disparity"):
        read_disparity(write_image(tmp_path / "jet.png", picture))


def test_disparities_that_leave_the_right_image_are_refused(tmp_path: Path, clip: StereoFolderClip) -> None:
    np.save(tmp_path / "0004.npy", np.full((HEIGHT, WIDTH), 1200, np.float32))  # depth in mm, or counts
    settings = FileMatcherSettings(root=str(tmp_path), pattern="%04d.npy", partial=True)
    with pytest.raises(VfoaError, match=r"0004\.npy: .* beyond the right image"):
        FileMatcher(settings, clip).match(clip.frame(4))


def test_negative_and_integer_disparities_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "negative.npy", -np.ones((2, 2), np.float32))
    np.save(tmp_path / "whole.npy", np.ones((2, 2), np.int16))
    with pytest.raises(VfoaError, match="4 of 4 disparities are negative"):
        read_disparity(tmp_path / "negative.npy")
    with pytest.raises(VfoaError, match="int16; expected"):
        read_disparity(tmp_path / "whole.npy")
    np.save(tmp_path / "flow.npy", np.where(np.arange(64) < 2, 0.5, -np.linspace(5, 60, 64))[None])  # of RAFT-Stereo
    with pytest.raises(VfoaError, match="62 of 64 disparities are negative"):
        read_disparity(tmp_path / "flow.npy")
    np.save(tmp_path / "sparse.npy", np.where(np.arange(64) < 2, 0.5, -1.0)[None])  # -1 is unknown
    assert np.isfinite(read_disparity(tmp_path / "sparse.npy")).sum() == 2
    with pytest.raises(VfoaError, match="8-bit RGB"):
        read_disparity(write_image(tmp_path / "gray.png", np.ones((2, 2), np.uint8)))
