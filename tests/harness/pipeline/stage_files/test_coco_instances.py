"""Masks in COCO's format of instances: drawn ones, and results of a detector."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.pipeline.stage_files.coco_instances import CocoInstances, CocoInstancesSettings
from harness.sources.stereo_folder import StereoFolderClip
from tests.disk import HEIGHT, WIDTH, write_text
from tests.pairs import open_pairs
from vfoa.errors import VfoaError

CATEGORIES = [{"id": 1, "name": "person"}, {"id": 7, "name": "robot"}]


@pytest.fixture
def clip(tmp_path: Path) -> StereoFolderClip:
    return open_pairs(tmp_path, (4, 7))


def band(left: int, right: int) -> list[list[int]]:
    """A polygon over the image's whole height."""
    return [[left, 0, right, 0, right, HEIGHT, left, HEIGHT]]


def drawn(image: int, category: int, left: int, right: int, **more: Any) -> dict[str, Any]:
    return {"image_id": image, "category_id": category, "segmentation": band(left, right), **more}


def document(annotations: Sequence[Any], names: Sequence[str] = ("left/0004.png", "left/0007.png")) -> dict[str, Any]:
    images = [{"id": number, "file_name": name} for number, name in enumerate(names)]
    return {"images": images, "categories": CATEGORIES, "annotations": [*annotations]}


def segmenter(clip: StereoFolderClip, root: Path, content: Any, **settings: Any) -> CocoInstances:
    write_text(root / "instances.json", json.dumps(content))
    return CocoInstances(CocoInstancesSettings(root=str(root), **settings), clip)


def test_masks_are_read_and_smaller_ones_lie_on_larger_ones(clip: StereoFolderClip, tmp_path: Path) -> None:
    annotations = [
        drawn(0, 1, 0, 20, attributes={"track_id": 0, "name": "anna"}),
        drawn(0, 7, 5, 8, attributes={"track_id": 3}, iscrowd=1),
        drawn(1, 7, 9, 12, attributes={"track_id": 3}),
    ]
    stage = segmenter(clip, tmp_path, document(annotations))
    found = stage.segment(clip.frame(4))
    assert [(each.id, each.label, each.name, each.score, each.is_thing) for each in found.instances] == [
        (3, "robot", None, 1.0, True),
        (1, "person", "anna", 1.0, True),
    ]
    columns = [0] * WIDTH
    columns[:20], columns[5:8] = [1] * 20, [3] * 3
    assert np.array_equal(found.ids, np.broadcast_to(columns, (HEIGHT, WIDTH)))
    (robot,) = stage.segment(clip.frame(7)).instances
    assert (robot.id, robot.label, robot.keeps_id) == (3, "robot", True)


def test_polygons_of_resized_images_are_refused(clip: StereoFolderClip, tmp_path: Path) -> None:
    content = document([drawn(0, 7, 0, 9)])
    for image in content["images"]:
        image.update(width=WIDTH // 2, height=HEIGHT // 2)
    stage = segmenter(clip, tmp_path, content)
    with pytest.raises(VfoaError, match=r"instances\.json: left/0004\.png: found 32 x 24 pixels; expected 64 x 48"):
        stage.segment(clip.frame(4))
    content["images"][0].update(width=WIDTH, height=HEIGHT)
    assert len(segmenter(clip, tmp_path, content).segment(clip.frame(4)).instances) == 1


def test_results_of_a_detector(clip: StereoFolderClip, tmp_path: Path) -> None:
    """Without a data set, ``image_id`` is the frame's number and ``category_id`` is COCO's; scores decide."""
    results = [
        drawn(4, 47, 0, 20, score=0.9),
        drawn(4, 1, 5, 10, score=0.8),
        drawn(4, 47, 12, 30, score=0.7),
        drawn(4, 16, 40, 50, score=0.2),
    ]
    stage = segmenter(clip, tmp_path, results)
    found = stage.segment(clip.frame(4))
    assert [(each.label, each.score, each.keeps_id) for each in found.instances] == [
        ("cup", 0.9, False),
        ("cup", 0.7, False),
    ]
    assert stage.segment(clip.frame(7)).instances == ()
    low = segmenter(clip, tmp_path, results, min_score=0.1, max_hidden=1.0)
    assert [each.label for each in low.segment(clip.frame(4)).instances] == ["cup", "cup", "bird"]


def test_results_with_their_data_set(clip: StereoFolderClip, tmp_path: Path) -> None:
    write_text(tmp_path / "gt.json", json.dumps(document([])))
    stage = segmenter(clip, tmp_path, [drawn(1, 7, 0, 9, score=0.9)], dataset="gt.json")
    assert [each.label for each in stage.segment(clip.frame(7)).instances] == ["robot"]
    assert stage.segment(clip.frame(4)).instances == ()


def test_images_may_count_from_0(clip: StereoFolderClip, tmp_path: Path) -> None:
    content = document([drawn(0, 7, 0, 9)], ["frame_000003.png", "frame_000006.png"])
    with pytest.raises(VfoaError, match="frame_offset"):
        segmenter(clip, tmp_path, content)
    stage = segmenter(clip, tmp_path, content, frame_offset=1)
    assert [each.label for each in stage.segment(clip.frame(4)).instances] == ["robot"]


@pytest.mark.parametrize(("frames", "images", "offset"), [((0, 1, 2), (1, 3), -1), ((1, 2, 3), (0, 1, 2), 1)])
def test_results_that_count_from_another_number_are_refused(
    frames: tuple[int, ...], images: tuple[int, ...], offset: int, tmp_path: Path
) -> None:
    clip = open_pairs(tmp_path / "other", frames)
    results = [drawn(image, 1, 0, 20, score=0.9) for image in images]
    with pytest.raises(VfoaError, match=f"instances.json: .*segmentation.frame_offset = {offset}"):
        segmenter(clip, tmp_path, results)
    stage = segmenter(clip, tmp_path, results, frame_offset=offset)
    assert len(stage.segment(clip.frame(images[0] + offset)).instances) == 1
    segmenter(clip, tmp_path, [*results, drawn(9, 1, 0, 20, score=0.9)])  # of a longer film


def test_a_frame_that_is_not_listed_is_found_at_the_start(clip: StereoFolderClip, tmp_path: Path) -> None:
    content = document([drawn(0, 7, 0, 9)], ["0004.png"])
    with pytest.raises(VfoaError, match=r"instances\.json: no image 7 \(1 of 2"):
        segmenter(clip, tmp_path, content)
    stage = segmenter(clip, tmp_path, content, partial=True)
    assert len(stage.segment(clip.frame(4)).instances) == 1
    with pytest.raises(VfoaError, match=r"instances\.json: no image 7"):
        stage.segment(clip.frame(7))


def test_the_digest_follows_the_contents(clip: StereoFolderClip, tmp_path: Path) -> None:
    first = segmenter(clip, tmp_path, document([drawn(0, 7, 0, 9)])).digest()
    assert segmenter(clip, tmp_path, document([drawn(0, 7, 0, 9)])).digest() == first
    assert segmenter(clip, tmp_path, document([drawn(0, 7, 0, 10)])).digest() != first


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (document([drawn(0, 9, 0, 9)]), ["annotations[0]", "category_id", "9"]),
        (document([drawn(5, 1, 0, 9, id=33)]), ["annotation 33", "image_id", "5"]),
        (document([drawn(0, 1, 0, 9, track_id=2), drawn(0, 1, 0, 9, track_id=2)]), ["annotations[1]", "track_id 2"]),
        (document([{"image_id": 0, "category_id": 1, "bbox": [0, 0, 5, 5]}]), ["annotations[0]", "segmentation"]),
        (
            document([{**drawn(0, 1, 0, 9), "segmentation": {"size": [1, 1], "counts": [1]}}]),
            ["segmentation", "[1, 1]"],
        ),
        (document([drawn(0, 1, 0, 9, name="a\nb")]), ["annotations[0]", "a\\nb"]),
        (document([]) | {"categories": [{"id": 1, "name": " "}]}, ["categories"]),
        ([drawn(4, 12, 0, 9)], ["annotations[0]", "12"]),
        ([{**drawn(4, 1, 0, 9), "image_id": "left_a"}], ["left_a", "segmentation.dataset"]),
        ([drawn(5, 1, 0, 9)], ["no image 4", "2 of 2"]),
        ([], ["no images"]),
        ({"images": []}, ["categories"]),
    ],
)
def test_mistakes_are_one_line(clip: StereoFolderClip, tmp_path: Path, content: Any, words: list[str]) -> None:
    with pytest.raises(VfoaError) as error:
        segmenter(clip, tmp_path, content).segment(clip.frame(4))
    assert str(error.value).startswith(str(tmp_path / "instances.json"))
    assert [word for word in words if word not in str(error.value)] == []
