from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from scripts.measure.mirror import bandage_frame, frame_of, read_rgb
from tests import graphs
from tests.masks import CUP, PERSON, picture, rectangle
from vfoa.coco import STUFF, THINGS
from vfoa.errors import VfoaError
from vfoa.segmentation.yolo_seg import YoloSeg
from vfoa.types import Instances

RED, GREEN, BLUE = np.eye(3, 32)


def output0(*rows: tuple[tuple[float, float, float, float], int, float, np.ndarray]) -> np.ndarray:
    """[1, 116, P] of rows (u0, v0, u1, v1 in the network's square), class, score, coefficients; P = 2100."""
    found = np.zeros((116, 2100))
    for n, ((u0, v0, u1, v1), label, score, coefficients) in enumerate(rows):
        found[:4, 100 * n] = (u0 + u1) / 2, (v0 + v1) / 2, u1 - u0, v1 - v0
        found[4 + label, 100 * n] = score
        found[84:, 100 * n] = coefficients
    return found[None]


def segment(path: Path, found: np.ndarray, image: np.ndarray, **settings: object) -> Instances:
    weights = graphs.yolo_seg(path / "yolo.onnx", found)
    return YoloSeg(YoloSeg.Settings.model_validate({"weights": weights, **settings})).segment(frame_of(image))


@pytest.mark.parametrize(("width", "height"), [(640, 480), (480, 640), (320, 320), (160, 80)])
def test_reproduces_known_masks_whatever_the_images_shape(tmp_path: Path, width: int, height: int) -> None:
    # Edges on the prototypes' grid: then the mask is known to the pixel, but for its corners.
    red = rectangle(width, height, width // 4, height // 4, width // 2, height // 2)
    blue = rectangle(width, height, width // 2, height // 2, width, height)
    whole = (0.0, 0.0, 320.0, 320.0)
    found = segment(
        tmp_path,
        output0((whole, CUP, 0.6, BLUE), (whole, PERSON, 0.9, RED)),
        picture(width, height, red=red, blue=blue),
    )
    assert [(i.id, i.label, i.category_id, i.is_thing) for i in found.instances] == [
        (1, "person", 1, True),
        (2, "cup", 47, True),
    ]
    assert [i.score for i in found.instances] == pytest.approx([0.9, 0.6])
    prototype_px = max(width, height) / 80
    for mask, truth in ((found.mask(1), red), (found.mask(2), blue)):
        wrong = mask ^ truth
        assert wrong.sum() <= prototype_px**2 / 2  # interpolation rounds corners, an eighth of a prototype each
        assert not (wrong & ~truth).any()


def test_follows_edges_between_the_prototypes_to_a_pixel_or_two(tmp_path: Path) -> None:
    red = rectangle(1242, 375, 333, 101, 517, 270)
    found = segment(tmp_path, output0(((0, 0, 320, 320), CUP, 0.9, RED)), picture(1242, 375, red=red))
    v, u = np.nonzero(found.mask(1))
    # A prototype stands for 15.5 image pixels here, and is interpolated.
    np.testing.assert_allclose([u.min(), v.min(), u.max() + 1, v.max() + 1], [333, 101, 517, 270], atol=4)


def test_a_mask_ends_at_its_box(tmp_path: Path) -> None:
    red = rectangle(640, 480, 0, 0, 640, 480)
    # The image lies 40 pixels down in the square, at half its size.
    found = segment(tmp_path, output0(((50, 90, 150, 190), CUP, 0.9, RED)), picture(640, 480, red=red))
    np.testing.assert_array_equal(found.mask(1), rectangle(640, 480, 100, 100, 300, 300))


def test_the_better_score_wins_where_masks_overlap(tmp_path: Path) -> None:
    red = rectangle(640, 480, 0, 0, 640, 480)
    found = segment(
        tmp_path,
        output0(((0, 40, 200, 280), CUP, 0.5, RED), ((150, 40, 320, 280), PERSON, 0.8, RED)),
        picture(640, 480, red=red),
    )
    assert [i.label for i in found.instances] == ["person", "cup"]
    np.testing.assert_array_equal(found.mask(1), rectangle(640, 480, 300, 0, 640, 480))
    np.testing.assert_array_equal(found.mask(2), rectangle(640, 480, 0, 0, 300, 480))


def test_a_second_find_of_the_same_thing_is_dropped(tmp_path: Path) -> None:
    red = rectangle(640, 480, 0, 0, 640, 480)
    box, nearly, around = (60.0, 100.0, 160.0, 200.0), (62.0, 100.0, 160.0, 200.0), (40.0, 100.0, 160.0, 200.0)
    for second in ((nearly, CUP, 0.7, RED), (around, PERSON, 0.7, RED)):
        found = segment(tmp_path, output0((box, CUP, 0.9, RED), second), picture(640, 480, red=red))
        assert [i.label for i in found.instances] == ["cup"]


def test_keeps_what_scores_enough_and_is_wanted(tmp_path: Path) -> None:
    red = rectangle(640, 480, 0, 0, 640, 480)
    rows = (((0, 40, 100, 100), CUP, 0.6, RED), ((150, 40, 320, 280), PERSON, 0.3, RED))
    image = picture(640, 480, red=red)

    def labels(**settings: object) -> list[str]:
        return [i.label for i in segment(tmp_path, output0(*rows), image, **settings).instances]

    assert labels() == ["cup", "person"]
    assert labels(score_threshold=0.5) == ["cup"]
    assert labels(labels=("person",)) == ["person"]
    assert labels(score_threshold=0.7) == []


def test_an_unknown_label_is_one_clear_line(tmp_path: Path) -> None:
    weights = graphs.yolo_seg(tmp_path / "yolo.onnx", output0())
    with pytest.raises(VfoaError, match=r"no thing 'persn' in COCO.*'person'"):
        YoloSeg(YoloSeg.Settings(weights=weights, labels=("persn",)))


def test_the_categories_of_coco() -> None:
    assert (len(THINGS), len(STUFF)) == (80, 53)
    assert not set(THINGS) & set(STUFF)
    assert len({*THINGS.values(), *STUFF.values()}) == 133
    assert list(THINGS) == sorted(THINGS)
    assert list(STUFF) == sorted(STUFF)


def test_finds_the_cars_of_a_street(shared_data: Path, shared_models: Path) -> None:
    model = YoloSeg(YoloSeg.Settings(weights=str(shared_models / "yolov8n-seg_int8.onnx")))
    found = model.segment(frame_of(read_rgb(shared_data / "kitti_pair" / "left.png")))
    assert {i.label for i in found.instances} == {"car"}
    # The nearest car, parked at the right, reaches the lower right corner's region.
    assert found.ids[300, 1000] == 1
    assert found.ids[230, 845] not in (0, 1)
    assert found.ids[300, 300] == 0


def test_finds_the_girl_of_bandage_2(shared_data: Path, shared_models: Path) -> None:
    settings = YoloSeg.Settings(weights=str(shared_models / "yolov8n-seg_int8.onnx"))
    model = pickle.loads(pickle.dumps(YoloSeg(settings)))
    found = 0
    for number in range(1, 51, 7):
        instances = model.segment(bandage_frame(shared_data, number))
        truth = read_rgb(shared_data / "bandage_2_panoptic" / "png" / f"frame_{number:04d}.png")[..., 0] == 1
        people = [instances.mask(i.id) for i in instances.instances if i.label == "person"]
        found += any((truth & mask).sum() > 0.5 * truth.sum() for mask in people)
    assert found == 8
