"""Boxes of COCO's JSON as drawn shapes: tracks of CVAT, and images whose names other programs have changed."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.labels.formats.coco import Coco
from harness.labels.formats.exchange import Imported
from harness.labels.labels import Labels
from tests.disk import write_text
from tests.exchanges import PlainClip, exchange, row
from vfoa.errors import VfoaError

CATEGORIES = {1: "bird", 2: "cup", 3: "girl", 4: "head", 5: "chair"}
NAMES = {name: number for number, name in CATEGORIES.items()}


def box(image: int, name: str, left: float, **more: Any) -> dict[str, Any]:
    return {"image_id": image, "category_id": NAMES[name], "bbox": [left, 2.5, 10, 4], **more}


def document(files: Mapping[int, str], boxes: Sequence[Mapping[str, Any]], **more: Any) -> str:
    images = [{"id": number, "file_name": name, "width": 64, "height": 48} for number, name in files.items()]
    categories = [{"id": number, "name": name, "supercategory": ""} for number, name in CATEGORIES.items()]
    annotations = [{"id": number, "area": 40.0, "iscrowd": 0, **each} for number, each in enumerate(boxes, start=1)]
    return json.dumps({"images": images, "categories": categories, "annotations": annotations, "info": {}, **more})


def read(tmp_path: Path, files: Mapping[int, str], *boxes: Mapping[str, Any], **more: Any) -> Imported:
    return Coco().read(write_text(tmp_path / "instances.json", document(files, boxes)), exchange(PlainClip(), **more))


def lefts(imported: Imported, name: str, kind: str = "box") -> dict[int, float]:
    """The left side of a name's box in each frame, from the corner of a pixel."""
    shapes = [(frame, shape, place) for frame in range(1, 51) for shape, place in imported.drawn.at(frame)]
    return {frame: place[0] + 0.5 for frame, shape, place in shapes if (shape.name, shape.kind) == (name, kind)}


@given(st.dictionaries(st.integers(1, 50), st.none() | st.floats(0, 50).map(lambda left: round(left, 1)), min_size=1))
def test_a_box_is_where_its_image_has_it_and_moves_on_between_images(
    tmp_path_factory: pytest.TempPathFactory, seen: dict[int, float | None]
) -> None:
    """An image without the box ends it, also where it comes back."""
    files = {100 + frame: f"left/{frame:05d}.png" for frame in seen} | {1: "left/00999.png"}
    boxes = [box(100 + frame, "bird", left) for frame, left in seen.items() if left is not None]
    imported = read(tmp_path_factory.mktemp("coco"), files, *boxes, box(1, "cup", 0))
    found, at = lefts(imported, "bird"), None
    for frame in range(1, 51):
        at = frame if frame in seen else at
        assert (frame in found) == (at is not None and seen[at] is not None)
    assert {frame: left for frame, left in seen.items() if left is not None} == pytest.approx(
        {frame: left for frame, left in found.items() if frame in seen}, abs=0.011
    )


def test_a_film_s_pictures_are_places_in_it(tmp_path: Path) -> None:
    """As CVAT writes tracks: the picture 0 is the clip's first frame, 1; boxes move linearly between key frames."""
    files = {number + 1: f"frame_{number:06d}.png" for number in range(30)}
    track = [
        box(number + 1, "bird", 2.0 * number, attributes={"track_id": 0, "keyframe": number in (0, 20)})
        for number in range(21)
    ]
    other = [box(number + 1, "bird", 50, attributes={"track_id": 1, "keyframe": True}) for number in (0, 1)]
    imported = read(
        tmp_path, files, *(each | {"segmentation": []} for each in [*track, *other]), renamed={"bird#1": "cup"}
    )
    assert lefts(imported, "bird") == pytest.approx({number + 1: 2.0 * number for number in range(21)})
    assert lefts(imported, "cup") == {1: 50, 2: 50}
    shapes = {shape.name: [(key.frame, key.outside) for key in shape.keys] for shape in imported.drawn.tracks}
    assert shapes == {"bird": [(1, False), (21, False), (22, True)], "cup": [(1, False), (2, False), (3, True)]}
    shifted = read(tmp_path, files, *track, offset=0.4)
    assert lefts(shifted, "bird")[1] == 20.0


def test_a_public_export_of_cvat(tmp_path: Path) -> None:
    """A part of somebody's file (PanchalJai/Video-Annotation-Portfolio), its last picture with two of its cars."""
    text = """{"licenses":[{"name":"","id":0,"url":""}],"info":{"contributor":"","date_created":"","description":""},
    "categories":[{"id":1,"name":"car","supercategory":""}],"images":[
    {"id":1,"width":1920,"height":1080,"file_name":"frame_000000.png","license":0,"flickr_url":"","date_captured":0},
    {"id":1410,"width":1920,"height":1080,"file_name":"frame_001409.png","license":0,"flickr_url":"",
     "date_captured":0}],"annotations":[
    {"id":8025,"image_id":1410,"category_id":1,"segmentation":[],"area":9265.977799999988,
     "bbox":[1845.67,265.6,74.33,124.66],"iscrowd":0,
     "attributes":{"occluded":false,"rotation":0.0,"track_id":2,"keyframe":false}},
    {"id":8026,"image_id":1410,"category_id":1,"segmentation":[],"area":140291.05999999997,
     "bbox":[728.75,536.96,432.25,324.56],"iscrowd":0,
     "attributes":{"occluded":false,"rotation":0.0,"track_id":3,"keyframe":false}}]}"""
    path, renamed = write_text(tmp_path / "instances_default.json", text), {"car#2": "bird", "car#3": "cup"}
    imported = Coco().read(path, exchange(PlainClip(), renamed=renamed, offset=1409 / 25))
    places = {shape.name: place for shape, place in imported.drawn.at(1)}
    assert places["bird"] == pytest.approx((1845.17, 265.1, 1919.5, 389.76))
    assert places["cup"] == pytest.approx((728.25, 536.46, 1160.5, 861.02))
    assert imported.size_px == (1920, 1080)


@pytest.mark.parametrize(
    ("segmentation", "expected"),
    [([], (13, -3, 17, 17)), ([[0, 0, 1, 1]], (5, 5, 25, 9))],  # the box of a mask is that of its pixels
)
def test_a_box_that_cvat_turned_is_read_by_its_extent(
    tmp_path: Path, segmentation: Any, expected: tuple[float, ...]
) -> None:
    """CVAT writes the box as it was before, and the angle about its middle, as in its own XML."""
    turned = {"bbox": [5, 5, 20, 4], "segmentation": segmentation, "attributes": {"rotation": 90.0}}
    imported = read(tmp_path, {1: "1.png"}, box(1, "bird", 5) | turned)
    ((_, place),) = imported.drawn.at(1)
    assert [side + 0.5 for side in place] == pytest.approx(expected)


def test_images_of_the_clip_s_own_are_known_by_their_numbers(tmp_path: Path) -> None:
    files = {number: f"frame_{number:06d}.png" for number in (3, 4)}
    assert lefts(read(tmp_path, files, box(3, "bird", 7), box(4, "bird", 8)), "bird")[3] == 7


def test_images_that_ffmpeg_counts_from_1_are_the_frames_of_a_film(tmp_path: Path) -> None:
    text = document({n: f"{n:04d}.png" for n in (1, 2, 3)}, [box(n, "bird", 7 + n) for n in (2, 3)])
    path = write_text(tmp_path / "instances.json", text)
    found = lefts(Coco().read(path, exchange(PlainClip(frames=range(3)))), "bird")
    assert [found[1], found[2]] == [9, 10]
    with pytest.raises(VfoaError, match="--fps"):
        Coco().read(path, exchange(PlainClip(frames=range(3)), fps=5.0))


@pytest.mark.parametrize(
    ("first", "second", "more"),
    [
        ("d3f5a9c1-00005.png", "0a1b2c3d-00006.png", {}),
        ("images\\d3f5a9c1-00005.png", "images\\0a1b2c3d-00006.png", {}),
        ("00005_png.rf.6382e752d1e00ca7367fb9871a322fb6.jpg", "00006_png.rf.d55ee07d43dad4c7cd9f3d3ccc3d4d1a.jpg", {}),
        ("u1x9.jpg", "k27z.jpg", {"extra": {"name": "{}.png"}}),
    ],
)
def test_what_other_programs_add_to_a_name_is_no_number(
    tmp_path: Path, first: str, second: str, more: Mapping[str, Any]
) -> None:
    """Label Studio puts 8 digits before a name, Roboflow 32 after it, or keeps the name beside it."""
    images = [{"id": number, "file_name": name} for number, name in ((5, first), (6, second))]
    if more:
        images = [{**image, "extra": {"name": f"0000{image['id']}.png"}} for image in images]
    text = document({}, [box(5, "bird", 1), box(6, "bird", 2)], images=images)
    imported = Coco().read(write_text(tmp_path / "_annotations.coco.json", text), exchange(PlainClip()))
    assert [lefts(imported, "bird")[frame] for frame in (5, 6)] == [1, 2]
    assert imported.size_px is None


def test_attributes_have_names_and_looks(tmp_path: Path) -> None:
    files = {number: f"{number:04d}.png" for number in range(1, 5)}
    girl = [
        box(number, "girl", 30, attributes={"looks_at": look})
        for number, look in enumerate(["bird", "bird", "", "none"], start=1)
    ]
    head = box(1, "head", 30, attributes={"name": "girl", "occluded": False})
    imported = read(tmp_path, files, *girl, head, box(2, "chair", 0))
    assert imported.labels == Labels(
        [row(1, 2, "bird"), row(3, 3, "ignore", note="not labelled yet"), row(4, 4, "none")]
    )
    assert [*lefts(imported, "girl", "head")] == [1]
    assert [note for note in imported.notes if "chair" in note]
    assert imported.size_px == (64, 48)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (document({1: "1.png"}, [box(2, "bird", 0)]), ["annotation 1", "image_id", "2"]),
        (document({1: "1.png"}, [{**box(1, "bird", 0), "category_id": 9}]), ["annotation 1", "category_id", "9"]),
        (document({1: "1.png"}, [{"image_id": 1, "category_id": 1}]), ["annotation 1", "bbox"]),
        (document({1: "1.png"}, [{**box(1, "bird", 0), "bbox": [1, 2, 3]}]), ["bbox", "[1.0, 2.0, 3.0]"]),
        (document({1: "1.png"}, [{**box(1, "bird", 0), "bbox": [1, 2, 0, 3]}]), ["annotation 1"]),
        (document({1: "1.png"}, [box(1, "bird", 0, attributes={"rotation": 10**400})]), ["annotation 1", "turned"]),
        (document({1: "1.png"}, [box(1, "bird", 0), box(1, "bird", 9)]), ["annotation 2", "'bird'", "annotation 1"]),
        (document({1: "1.png"}, [box(1, "chair", 0)]), ["chair", "bird"]),
        (document({1: "a/1.png", 2: "b/1.png"}, [box(1, "bird", 0)]), ["1.png"]),
        (document({}, [], images=[{"id": 1, "file_name": "1.png"}] * 2), ["images", "id 1"]),
        (json.dumps([box(1, "bird", 0)]), ["person", "bird"]),  # COCO's category 1
        ("{}", ["images", "COCO"]),
        ('{"shapes": [], "imagePath": "00001.png"}', ["images", "COCO"]),  # labelme
        ("<xml/>", ["not JSON", "COCO"]),
    ],
)
def test_a_wrong_file_is_named_with_its_place(tmp_path: Path, content: str, words: list[str]) -> None:
    path = write_text(tmp_path / "instances.json", content)
    with pytest.raises(VfoaError) as error:
        Coco().read(path, exchange())
    assert str(error.value).startswith(str(path))
    assert [word for word in words if word not in str(error.value)] == []


@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_boxes_of_a_detector_s_results_are_drawn(tmp_path: Path, mark: str) -> None:
    """Of COCO's categories; the id of an image is its number, or its name without the suffix."""
    results = [
        {"image_id": image, "category_id": number, "bbox": [left, 2.5, 10, 4], "score": score}
        for image, number, left, score in [(3, 16, 1, 0.9), (3, 47, 7, 0.8), (3, 16, 30, 0.2), (5, 16, 3, 0.7)]
    ]
    for named in (results, [{**each, "image_id": f"frame_{each['image_id']:06d}"} for each in results]):
        imported = Coco().read(write_text(tmp_path / "results.json", mark + json.dumps(named)), exchange(PlainClip()))
        found = lefts(imported, "bird")
        assert [found.get(frame) for frame in (2, 3, 5, 9)] == [None, 1, 3, 3]
        assert 3 in lefts(imported, "cup")
        assert 5 not in lefts(imported, "cup")


@pytest.mark.parametrize(("results", "said"), [([], "no images"), ([{"category_id": 999, "score": 1}], "category_id")])
def test_results_of_nothing_that_is_known_are_refused(tmp_path: Path, results: list[dict[str, Any]], said: str) -> None:
    content = [{"image_id": 3, "bbox": [1, 2, 3, 4], **each} for each in results]
    with pytest.raises(VfoaError, match=said):
        Coco().read(write_text(tmp_path / "results.json", json.dumps(content)), exchange(PlainClip()))
