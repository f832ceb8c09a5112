from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from onnx import helper

from scripts.measure.mirror import frame_of
from tests import graphs
from tests.masks import BOOK, CUP, PERSON, assert_masks, logits, patchwork, picture, rectangle, seen
from vfoa.coco import STUFF_IDS
from vfoa.errors import VfoaError
from vfoa.segmentation import SEGMENTERS
from vfoa.segmentation.mask_classification import MaskClassification
from vfoa.types import Instances, Mask

SIZE = 64
SEA, SKY = (80 + STUFF_IDS.index(id_) for id_ in (155, 187))
NOTHING = 133


def class_logits(*queries: tuple[int, float]) -> np.ndarray:
    """Logits [1, Q, 134] whose softmax gives each query's class its probability and the others the rest evenly."""
    probabilities = np.stack([np.full(134, (1 - probability) / 133) for _, probability in queries])
    for n, (category, probability) in enumerate(queries):
        probabilities[n, category] = probability
    return np.log(probabilities)[None]


def outputs(*queries: tuple[int, float, Mask]) -> dict[str, np.ndarray]:
    classes = class_logits(*((category, probability) for category, probability, _ in queries))
    return {
        "class_queries_logits": classes,
        "masks_queries_logits": logits([mask for *_, mask in queries])[None],
        "encoder_last_hidden_state": np.zeros((1, 2)),  # exporters add more
    }


def segment(
    folder: Path, found: dict[str, np.ndarray], width: int = SIZE, height: int = SIZE, **settings: object
) -> Instances:
    weights = graphs.constant(folder / "eomt.onnx", {"pixel_values": (1, 3, SIZE, SIZE)}, found)
    model = MaskClassification(MaskClassification.Settings.model_validate({"weights": weights, **settings}))
    return model.segment(frame_of(np.zeros((height, width, 3), np.uint8)))


def test_is_used_by_name() -> None:
    assert SEGMENTERS.load("mask_classification") is MaskClassification


def test_reproduces_known_masks_of_things_and_stuff_exactly(tmp_path: Path) -> None:
    sky, person, cup = patchwork(SIZE, SIZE, 3)
    found = segment(tmp_path, outputs((SKY, 0.95, sky), (PERSON, 0.9, person), (CUP, 0.97, cup)))
    assert seen(found) == [
        ("cup", 47, True, 0.97),
        ("sky-other-merged", 187, False, 0.95),
        ("person", 1, True, 0.9),
    ]
    assert_masks(found, cup, sky, person)


def test_what_nobody_claims_belongs_to_nobody(tmp_path: Path) -> None:
    (person,) = patchwork(SIZE, SIZE, 1)
    found = segment(tmp_path, outputs((PERSON, 0.9, person)))
    np.testing.assert_array_equal(found.mask(0), ~person)


def test_a_pixel_belongs_to_the_greatest_product_of_class_and_mask_probability(tmp_path: Path) -> None:
    answer = outputs((PERSON, 0.95, np.ones((SIZE, SIZE), bool)), (CUP, 0.85, np.ones((SIZE, SIZE), bool)))
    left = rectangle(SIZE, SIZE, 0, 0, 32, SIZE)
    # Sure of the left half, just above one half on the right; the cup is sure of the right half alone.
    answer["masks_queries_logits"][0, 0] = np.where(left, 8, 0.5)
    answer["masks_queries_logits"][0, 1] = np.where(left, -8, 8)
    found = segment(tmp_path, answer, min_visible=0.4)
    assert_masks(found, left, ~left)
    # By default the person is dropped, having lost half of what it claims; the pixels stay free.
    found = segment(tmp_path, answer)
    assert [label for label, *_ in seen(found)] == ["cup"]
    assert_masks(found, ~left)


def test_logits_may_be_of_any_size(tmp_path: Path) -> None:
    """exp(89) is beyond a float32."""
    sky, person = patchwork(SIZE, SIZE, 2)
    answer = outputs((SKY, 0.95, sky), (PERSON, 0.9, person))
    answer["masks_queries_logits"] *= 1000
    assert_masks(segment(tmp_path, answer), sky, person)


def test_the_same_stuff_is_one_segment_the_same_thing_is_two(tmp_path: Path) -> None:
    a, b, c, d = patchwork(SIZE, SIZE, 4)
    found = segment(tmp_path, outputs((SEA, 0.9, a), (BOOK, 0.98, b), (SEA, 0.95, c), (BOOK, 0.97, d)))
    assert [label for label, *_ in seen(found)] == ["book", "book", "sea"]
    assert_masks(found, b, d, a | c)


def test_queries_for_nothing_and_unsure_ones_do_not_count(tmp_path: Path) -> None:
    a, b, c = patchwork(SIZE, SIZE, 3)
    answer = outputs((NOTHING, 0.99, a), (PERSON, 0.75, b), (CUP, 0.9, c))
    assert [label for label, *_ in seen(segment(tmp_path, answer))] == ["cup"]
    assert [label for label, *_ in seen(segment(tmp_path, answer, score_threshold=0.7))] == ["cup", "person"]


def test_what_is_not_wanted_still_hides_what_is_behind_it(tmp_path: Path) -> None:
    a, b = patchwork(SIZE, SIZE, 2)
    answer = outputs((PERSON, 0.99, a), (SEA, 0.9, a | b))
    found = segment(tmp_path, answer, labels=("sea",), min_visible=0.4)
    assert_masks(found, b)


def test_the_image_lies_at_the_upper_left_or_is_stretched(tmp_path: Path) -> None:
    upper = rectangle(SIZE, SIZE, 0, 0, SIZE, 16)
    answer = outputs((PERSON, 0.99, upper), (CUP, 0.98, ~upper))
    for fit, row in (("pad", 64), ("stretch", 32)):  # an image twice as wide as high fills the upper half
        found = segment(tmp_path, answer, width=256, height=128, fit=fit, min_visible=0.1)
        assert_masks(found, rectangle(256, 128, 0, 0, 256, row), rectangle(256, 128, 0, row, 256, 128))


def test_the_input_is_rgb_by_imagenets_statistics(tmp_path: Path) -> None:
    """The graph's three masks are the three channels."""
    nodes = [
        graphs.constant_node("class_queries_logits", class_logits((PERSON, 0.99), (CUP, 0.98), (BOOK, 0.97))),
        graphs.constant_node("twenty", np.float32(20)),
        helper.make_node("Mul", ["pixel_values", "twenty"], ["masks_queries_logits"]),
    ]
    shape = (1, 3, "height", "width")
    shapes = {"class_queries_logits": (1, 3, 134), "masks_queries_logits": shape}
    weights = graphs.write(tmp_path / "colors.onnx", nodes, {"pixel_values": shape}, shapes)
    red, green = rectangle(128, 64, 3, 5, 20, 30), rectangle(128, 64, 60, 1, 128, 60)
    image = picture(128, 64, red=red, green=green)
    image[..., 2] = 103  # blue's mean is 103.53
    model = MaskClassification(MaskClassification.Settings(weights=weights, input_size_px=128, min_visible=0.1))
    assert_masks(model.segment(frame_of(image)), red, green)
    image[..., 2] = 104
    assert len(model.segment(frame_of(image)).instances) == 3


def test_a_model_of_other_classes_is_refused(tmp_path: Path) -> None:
    answer = outputs((PERSON, 0.9, np.ones((SIZE, SIZE), bool)))
    answer["class_queries_logits"] = np.zeros((1, 1, 151))
    with pytest.raises(VfoaError, match=r"\[1, any, 134\].*\[1, 1, 151\]"):
        segment(tmp_path, answer)
