from __future__ import annotations

from pathlib import Path

import numpy as np
from onnx import helper

from scripts.measure.mirror import frame_of
from tests import graphs
from tests.masks import assert_masks, patchwork, picture, rectangle, seen
from vfoa.segmentation import SEGMENTERS
from vfoa.segmentation.mask_rcnn import MaskRcnn
from vfoa.types import Instances, Mask

WIDTH, HEIGHT = 60, 40
WHOLE = (0.0, 0.0, float(WIDTH), float(HEIGHT))


def outputs(*rows: tuple[int, float, Mask], box: tuple[float, float, float, float] = WHOLE) -> dict[str, np.ndarray]:
    """The answer to (COCO's number, score, mask) per instance, under names of somebody's own."""
    return {
        "bbox_coords": np.array([box] * len(rows)),
        "bbox_labels": np.array([category for category, *_ in rows]),
        "bbox_scores": np.array([score for _, score, _ in rows]),
        "bbox_masks": np.stack([np.where(mask, 0.9, 0.1) for *_, mask in rows])[:, None],
    }


def segment(
    folder: Path,
    found: dict[str, np.ndarray],
    size: tuple[int | str, int | str] = (HEIGHT, WIDTH),
    width: int = WIDTH,
    height: int = HEIGHT,
    **settings: object,
) -> Instances:
    weights = graphs.constant(folder / "mask-rcnn.onnx", {"x": (3, *size)}, found, integers={"bbox_labels"})
    model = MaskRcnn(MaskRcnn.Settings.model_validate({"weights": weights, **settings}))
    return model.segment(frame_of(np.zeros((height, width, 3), np.uint8)))


def test_is_used_by_name() -> None:
    assert SEGMENTERS.load("mask_rcnn") is MaskRcnn


def test_reproduces_known_masks_exactly_at_an_open_or_a_fixed_size(tmp_path: Path) -> None:
    cup, person = patchwork(WIDTH, HEIGHT, 2)
    for size in (("height", "width"), (HEIGHT, WIDTH)):
        found = segment(tmp_path, outputs((47, 0.6, cup), (1, 0.9, person)), size)
        assert seen(found) == [("person", 1, True, 0.9), ("cup", 47, True, 0.6)]
        assert_masks(found, person, cup)


def test_masks_of_a_fixed_size_are_stretched_to_the_image(tmp_path: Path) -> None:
    upper = rectangle(WIDTH, HEIGHT, 0, 0, WIDTH, 10)
    found = segment(tmp_path, outputs((1, 0.9, upper)), width=4 * WIDTH, height=2 * HEIGHT)
    assert_masks(found, rectangle(4 * WIDTH, 2 * HEIGHT, 0, 0, 4 * WIDTH, 20))


def test_the_input_is_rgb_from_0_to_1(tmp_path: Path) -> None:
    """The graph's three masks are the three channels."""
    nodes = [
        graphs.constant_node("boxes", np.array([WHOLE] * 3, np.float32)),
        graphs.constant_node("labels", np.array([1, 47, 84])),
        graphs.constant_node("scores", np.array([0.9, 0.8, 0.7], np.float32)),
        graphs.constant_node("axis", np.array([1])),
        helper.make_node("Unsqueeze", ["image", "axis"], ["masks"]),
    ]
    shapes = {"boxes": (3, 4), "labels": (3,), "scores": (3,), "masks": (3, 1, "height", "width")}
    inputs = {"image": (3, "height", "width")}
    weights = graphs.write(tmp_path / "colors.onnx", nodes, inputs, shapes, integers={"labels"})
    red, green = rectangle(WIDTH, HEIGHT, 3, 5, 20, 30), rectangle(WIDTH, HEIGHT, 30, 1, 50, 39)
    image = picture(WIDTH, HEIGHT, red=red, green=green)
    image[..., 2] = 127
    found = MaskRcnn(MaskRcnn.Settings(weights=weights)).segment(frame_of(image))
    assert_masks(found, red, green)
    image[..., 2] = 128
    assert len(MaskRcnn(MaskRcnn.Settings(weights=weights)).segment(frame_of(image)).instances) == 3


def test_keeps_what_scores_enough_is_wanted_and_not_hidden(tmp_path: Path) -> None:
    a, b = patchwork(WIDTH, HEIGHT, 2)
    answer = outputs((47, 0.6, a), (1, 0.9, b), (84, 0.55, a), (16, 0.3, ~(a | b)))
    assert [label for label, *_ in seen(segment(tmp_path, answer))] == ["person", "cup"]
    assert [label for label, *_ in seen(segment(tmp_path, answer, labels=("cup", "book")))] == ["cup"]
    assert [label for label, *_ in seen(segment(tmp_path, answer, score_threshold=0.2))] == ["person", "cup", "bird"]


def test_an_image_without_anything_is_empty(tmp_path: Path) -> None:
    nothing = {
        "boxes": np.zeros((0, 4)),
        "labels": np.zeros(0),
        "scores": np.zeros(0),
        "masks": np.zeros((0, 1, HEIGHT, WIDTH)),
    }
    weights = graphs.constant(tmp_path / "empty.onnx", {"x": (3, "h", "w")}, nothing, integers={"labels"})
    found = MaskRcnn(MaskRcnn.Settings(weights=weights)).segment(frame_of(np.zeros((HEIGHT, WIDTH, 3), np.uint8)))
    assert found.instances == ()
