"""Masks as numbers in maps: palettes, gray and arrays, as video segmenters write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import PIL.Image
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from harness.pipeline.stage_files.id_maps import IdMaps, IdMapsSettings, with_people
from harness.sources.stereo_folder import StereoFolderClip
from tests import graphs
from tests.disk import HEIGHT, WIDTH, write_image, write_text
from tests.pairs import open_pairs
from vfoa.errors import VfoaError
from vfoa.segmentation.rf_detr_seg import RfDetrSeg
from vfoa.types import Instance, Instances
from vfoa.weights import weights_of

PALETTE = np.random.default_rng(1).integers(0, 256, (256, 3), dtype=np.uint8)
PALETTE[9] = PALETTE[7]
"""Two objects in one colour: only the number tells them."""
TABLE = "id,category,name\n7,person,\n9,robot,\n200,robot,pepper\n201,,\n"


@pytest.fixture
def clip(tmp_path: Path) -> StereoFolderClip:
    return open_pairs(tmp_path, (1, 2))


def _map() -> np.ndarray:
    ids = np.zeros((HEIGHT, WIDTH), np.uint8)
    ids[:8], ids[8:16], ids[16:20], ids[40:] = 7, 9, 200, 201
    return ids


def _write(path: Path, ids: np.ndarray, kind: str = "palette") -> None:
    match kind:
        case "palette":  # as SAM 2's vos_inference.py
            image = PIL.Image.fromarray(ids.astype(np.uint8))
            image.putpalette(PALETTE.ravel().tolist())
            image.save(path)
        case "npy":
            np.save(path, ids.astype(np.int64))
        case _:
            write_image(path, ids.astype(kind))


def _segmenter(clip: StereoFolderClip, root: Path, **settings: object) -> IdMaps:
    return IdMaps(IdMapsSettings.model_validate({"root": str(root), **settings}), clip)


@pytest.mark.parametrize("kind", ["palette", "uint8", "uint16", "npy"])
def test_every_kind_of_map_holds_the_same_objects(clip: StereoFolderClip, tmp_path: Path, kind: str) -> None:
    suffix = "npy" if kind == "npy" else "png"
    write_text(tmp_path / "ids.csv", TABLE)
    for number in (0, 1):
        _write(tmp_path / f"{number:05d}.{suffix}", _map() if number else np.zeros((HEIGHT, WIDTH)), kind)
    segmenter = _segmenter(clip, tmp_path, pattern=f"%05d.{suffix}", frame_offset=1)
    assert segmenter.segment(clip.frame(1)).instances == ()
    found = segmenter.segment(clip.frame(2))
    assert found.ids.dtype == np.uint16
    assert np.array_equal(found.ids, np.where(_map() == 201, 0, _map()))
    assert [(each.id, each.label, each.category_id, each.name) for each in found.instances] == [
        (7, "person", 1, None),
        (9, "robot", 1001, None),
        (200, "robot", 1001, "pepper"),
    ]
    assert all(each.keeps_id for each in found.instances)


def test_numbers_beyond_16_bits_become_small_ones(clip: StereoFolderClip, tmp_path: Path) -> None:
    write_text(tmp_path / "ids.csv", "id,category\n70000,cup\n1,person\n")
    np.save(tmp_path / "1.npy", np.where(_map() == 9, 70000, _map() == 7))
    found = _segmenter(clip, tmp_path, pattern="%d.npy", partial=True).segment(clip.frame(1))
    assert np.array_equal(found.ids, np.where(_map() == 9, 2, _map() == 7))
    assert [(each.id, each.label) for each in found.instances] == [(1, "person"), (2, "cup")]


def test_the_digest_follows_the_contents(clip: StereoFolderClip, tmp_path: Path) -> None:
    write_text(tmp_path / "ids.csv", TABLE)
    for number in (1, 2):
        _write(tmp_path / f"{number:05d}.png", _map())
    first = _segmenter(clip, tmp_path).digest()
    assert _segmenter(clip, tmp_path).digest() == first
    _write(tmp_path / "00002.png", np.roll(_map(), 1))
    second = _segmenter(clip, tmp_path).digest()
    write_text(tmp_path / "ids.csv", TABLE.replace("robot,\n", "cup,\n"))
    assert len({first, second, _segmenter(clip, tmp_path).digest()}) == 3


@pytest.mark.parametrize(
    ("table", "place"),
    [
        ("id,label\n7,person\n", r"ids\.csv:1: "),
        ("id,category\n7,person\n7,robot\n", r"ids\.csv:3: id: found 7; .*once"),
        ("id,category\n0,person\n", r"ids\.csv:2: id: found 0; "),
        ("id,category\n7,=cup\n", r"ids\.csv:2: found the name '=cup'"),
        ("id,category\n7,person\n9,robot\n", r"00001\.png: holds the number 200; .*ids\.csv"),
        (TABLE, r"00002\.png: no such file; expected the map of frame 2 \(1 of 2 frames are missing"),
    ],
)
def test_mistakes_are_one_line(clip: StereoFolderClip, tmp_path: Path, table: str, place: str) -> None:
    write_text(tmp_path / "ids.csv", table)
    _write(tmp_path / "00001.png", _map())
    with pytest.raises(VfoaError, match=place) as caught:
        _segmenter(clip, tmp_path, partial=table != TABLE).segment(clip.frame(1))
    assert "\n" not in str(caught.value)


def test_a_missing_table_is_explained(clip: StereoFolderClip, tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"ids\.csv: no such file; .*id,category,name"):
        _segmenter(clip, tmp_path)


@pytest.mark.parametrize(
    ("ids", "place"),
    [
        (np.zeros((HEIGHT, WIDTH, 3), np.uint8), r"found shape \(48, 64, 3\) of uint8"),
        (np.zeros((HEIGHT, WIDTH), np.float32), r"float32"),
        (np.full((HEIGHT, WIDTH), -1), "found the numbers -1 to -1"),
        (np.full((HEIGHT, WIDTH), 1 << 24), "16777216"),
        (np.zeros((2, 3), np.uint8), "the map is 3 x 2 pixels, the left image 64 x 48"),
    ],
)
def test_what_is_no_map_of_this_image_is_refused(
    clip: StereoFolderClip, tmp_path: Path, ids: np.ndarray, place: str
) -> None:
    write_text(tmp_path / "ids.csv", TABLE)
    np.save(tmp_path / "1.npy", ids)
    with pytest.raises(VfoaError, match=place):
        _segmenter(clip, tmp_path, pattern="%d.npy", partial=True).segment(clip.frame(1))


def test_a_picture_of_colours_is_no_map(clip: StereoFolderClip, tmp_path: Path) -> None:
    write_text(tmp_path / "ids.csv", TABLE)
    write_image(tmp_path / "00001.png", PALETTE[_map()])
    with pytest.raises(VfoaError, match=r"00001\.png: found shape .*palette"):
        _segmenter(clip, tmp_path, partial=True).segment(clip.frame(1))


def _instance(number: int, label: str) -> Instance:
    return Instance(id=number, label=label, category_id=1, is_thing=True, score=0.9)


def test_people_of_another_segmenter_fill_what_the_maps_leave_free() -> None:
    """A person behind an object keeps the rest; one who is hidden by half is an object of the maps."""
    objects = Instances(
        ids=np.array([[1, 1, 0, 0, 0, 0, 3, 3]], np.uint16), instances=(_instance(1, "robot"), _instance(3, "cup"))
    )
    found = Instances(
        ids=np.array([[0, 1, 1, 1, 2, 4, 4, 4]], np.uint16),
        instances=(_instance(1, "person"), _instance(2, "cup"), _instance(4, "person")),
    )
    both = with_people(objects, found)
    assert both.ids.tolist() == [[1, 1, 2, 2, 0, 0, 3, 3]]
    assert both.ids.dtype == np.uint16
    assert [(each.id, each.label, each.score) for each in both.instances] == [
        (1, "robot", 0.9), (3, "cup", 0.9), (2, "person", 0.9)
    ]  # fmt: skip


@given(
    ids=arrays(np.uint16, (4, 6), elements=st.integers(0, 3)),
    theirs=arrays(np.uint16, (4, 6), elements=st.integers(0, 5)),
)
def test_every_pixel_of_the_maps_stays(ids: np.ndarray, theirs: np.ndarray) -> None:
    objects = Instances(ids=ids, instances=tuple(_instance(number, "cup") for number in (1, 2, 3)))
    found = Instances(ids=theirs, instances=tuple(_instance(number, "person") for number in range(1, 6)))
    both = with_people(objects, found)
    assert np.array_equal(np.where(ids, both.ids, 0), ids)
    names = {each.id: each.label for each in both.instances}
    assert len(names) == len(both.instances)
    free = (ids == 0) & (theirs > 0)
    for number in range(1, 6):
        mask = theirs == number
        kept = 2 * np.count_nonzero(mask & free) > np.count_nonzero(mask)
        values = {*both.ids[mask & free].tolist()}
        assert len(values) <= 1
        assert all((names.get(value) == "person") == kept for value in values)


def test_a_network_finds_the_people(clip: StereoFolderClip, tmp_path: Path) -> None:
    write_text(tmp_path / "ids.csv", TABLE)
    for number in (1, 2):
        _write(tmp_path / f"{number:05d}.png", np.where(_map() == 200, 200, 0))
    one = graphs.yolo_seg(tmp_path / "one.onnx", np.zeros((1, 116, 9)))
    plain = _segmenter(clip, tmp_path)
    with_network = _segmenter(clip, tmp_path, people="yolo_seg", weights=one)
    assert [each.name for each in with_network.segment(clip.frame(1)).instances] == ["pepper"]
    assert plain.digest() != with_network.digest()
    assert [*weights_of(IdMapsSettings(root="x"))] == []
    assert [*weights_of(IdMapsSettings(root="x", people="yolo_seg", weights=one))] == [one]
    own = IdMapsSettings(root="x", people="rf_detr_seg")
    assert [*weights_of(own)] == [RfDetrSeg.Settings().weights]


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"people": "yolo"}, "did you mean 'yolo_seg'"),
        ({"weights": "a.onnx"}, "expected people"),
        ({"people": "yolo_seg"}, "people = 'yolo_seg': weights: missing"),
    ],
)
def test_a_wrong_segmenter_of_people_is_named(settings: dict[str, str], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        IdMapsSettings.model_validate({"root": "x", **settings})
