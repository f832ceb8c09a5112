from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
from onnx import helper

from scripts.measure.mirror import frame_of
from tests import graphs
from tests.masks import assert_masks, logits, patchwork, picture, rectangle, seen
from vfoa.errors import VfoaError
from vfoa.segmentation import SEGMENTERS
from vfoa.segmentation.rf_detr_seg import RfDetrSeg
from vfoa.types import Instances, Mask

SIZE = 312
GRID = SIZE // 4
LARGE = 4.0
"""A logit of 0.982."""


def outputs(*queries: tuple[int, float, Mask]) -> dict[str, np.ndarray]:
    """The answer to (COCO's number, logit, mask) per query; every other class is unlikely."""
    labels = np.full((1, len(queries), 91), -9.0)
    for n, (category, logit, _) in enumerate(queries):
        labels[0, n, category] = logit
    masks = logits([mask for *_, mask in queries])[None]
    return {"dets": np.zeros((1, len(queries), 4)), "labels": labels, "masks": masks}


def segment(
    folder: Path, found: dict[str, np.ndarray], width: int = GRID, height: int = GRID, **settings: object
) -> Instances:
    weights = graphs.constant(folder / "rf-detr.onnx", {"input": (1, 3, SIZE, SIZE)}, found)
    model = RfDetrSeg(RfDetrSeg.Settings.model_validate({"weights": weights, **settings}))
    return pickle.loads(pickle.dumps(model)).segment(frame_of(np.zeros((height, width, 3), np.uint8)))


def test_is_used_by_name() -> None:
    assert SEGMENTERS.load("rf_detr_seg") is RfDetrSeg


def test_reproduces_known_masks_exactly(tmp_path: Path) -> None:
    cup, person, book = patchwork(GRID, GRID, 3)
    found = segment(tmp_path, outputs((47, 0.5, cup), (1, LARGE, person), (84, 1.0, book)))
    assert seen(found) == [("person", 1, True, 0.982), ("book", 84, True, 0.7311), ("cup", 47, True, 0.6225)]
    assert_masks(found, person, book, cup)


def test_masks_are_stretched_to_the_image(tmp_path: Path) -> None:
    left = rectangle(GRID, GRID, 0, 0, GRID // 2, GRID)
    found = segment(tmp_path, outputs((1, LARGE, left)), 1024, 436)
    assert_masks(found, rectangle(1024, 436, 0, 0, 512, 436))


def test_the_input_is_stretched_rgb_by_imagenets_statistics(tmp_path: Path) -> None:
    """The graph's three masks are the three channels, averaged over the pixels that they stand for."""
    labels = np.full((1, 3, 91), -9.0, np.float32)
    labels[0, [0, 1, 2], [1, 47, 84]] = 3, 2, 1
    nodes = [
        helper.make_node("AveragePool", ["input"], ["masks"], kernel_shape=[4, 4], strides=[4, 4]),
        graphs.constant_node("dets", np.zeros((1, 3, 4), np.float32)),
        graphs.constant_node("labels", labels),
    ]
    shapes = {"dets": (1, 3, 4), "labels": (1, 3, 91), "masks": (1, 3, GRID, GRID)}
    weights = graphs.write(tmp_path / "colors.onnx", nodes, {"input": (1, 3, SIZE, SIZE)}, shapes)
    red, green = rectangle(2 * SIZE, SIZE, 0, 0, 200, SIZE), rectangle(2 * SIZE, SIZE, 400, 0, 2 * SIZE, SIZE)
    image = picture(2 * SIZE, SIZE, red=red, green=green)
    # A channel is 0 in the network's input where it has ImageNet's mean: a little less than half of 255.
    image[..., 2] = 103  # blue's mean is 103.53
    found = RfDetrSeg(RfDetrSeg.Settings(weights=weights)).segment(frame_of(image))
    assert [instance.label for instance in found.instances] == ["person", "cup"]
    assert_masks(found, red, green)
    image[..., 2] = 104
    found = RfDetrSeg(RfDetrSeg.Settings(weights=weights, max_hidden=0.9)).segment(frame_of(image))
    assert [instance.label for instance in found.instances] == ["person", "cup", "book"]


def test_keeps_what_scores_enough_is_wanted_and_not_hidden(tmp_path: Path) -> None:
    a, b, _ = patchwork(GRID, GRID, 3)
    answer = outputs((47, 0.1, a), (1, LARGE, b), (84, -0.1, a | b))
    assert [label for label, *_ in seen(segment(tmp_path, answer))] == ["person", "cup"]
    assert [label for label, *_ in seen(segment(tmp_path, answer, labels=("cup",)))] == ["cup"]
    low = segment(tmp_path, answer, score_threshold=0.4)
    assert [label for label, *_ in seen(low)] == ["person", "cup"]  # the book is hidden by both
    assert segment(tmp_path, answer, score_threshold=0.99).instances == ()


def test_numbers_that_coco_does_not_use_are_no_categories(tmp_path: Path) -> None:
    (mask,) = patchwork(GRID, GRID, 1)
    assert segment(tmp_path, outputs((12, 9.0, mask), (0, 9.0, mask))).instances == ()


def test_a_detector_without_masks_is_refused(tmp_path: Path) -> None:
    answer = outputs((1, LARGE, patchwork(GRID, GRID, 1)[0]))
    del answer["masks"]
    with pytest.raises(VfoaError, match=r"outputs.*masks \[1, any, any, any\]"):
        segment(tmp_path, answer)
