from __future__ import annotations

from pathlib import Path

import numpy as np
from onnx import helper

from scripts.measure.mirror import frame_of
from tests import graphs
from tests.masks import BOOK, CUP, PERSON, assert_masks, patchwork, rectangle, seen
from vfoa.coco import STUFF_IDS
from vfoa.segmentation import SEGMENTERS
from vfoa.segmentation.panoptic_fpn import PanopticFpn
from vfoa.types import Instances, Mask

SIZE = 128
ROI = 28
WHOLE = (0.0, 0.0, 128.0, 128.0)
SEA, SKY = (STUFF_IDS.index(id_) for id_ in (155, 187))
THING = 53
Box = tuple[float, float, float, float]
Row = tuple[Box, int, float, Mask]

FULL = np.ones((ROI, ROI), bool)


def semantic(*regions: tuple[int, Mask]) -> np.ndarray:
    """Logits [1, 54, h, w] that say a kind of stuff where its mask is, and elsewhere that there is some thing."""
    found = np.full((54, *regions[0][1].shape), -5)
    found[THING] = 0
    for kind, mask in regions:
        found[kind, mask] = 5
    return found[None]


def outputs(*rows: Row, stuff: np.ndarray) -> dict[str, np.ndarray]:
    """The answer to (box, place among the things, score, mask inside the box) per instance."""
    return {
        "dets": np.array([[[*box, score] for box, _, score, _ in rows]]),
        "labels": np.array([[category for _, category, *_ in rows]]),
        "masks": np.where(np.stack([mask for *_, mask in rows]), 0.9, 0.1)[None],
        "semseg": stuff,
    }


def segment(
    folder: Path, found: dict[str, np.ndarray], width: int = SIZE, height: int = SIZE, **settings: object
) -> Instances:
    weights = graphs.constant(folder / "fpn.onnx", {"input": (1, 3, SIZE, SIZE)}, found, integers={"labels"})
    model = PanopticFpn(PanopticFpn.Settings.model_validate({"weights": weights, **settings}))
    return model.segment(frame_of(np.zeros((height, width, 3), np.uint8)))


def test_is_used_by_name() -> None:
    assert SEGMENTERS.load("panoptic_fpn") is PanopticFpn


def test_reproduces_known_masks_of_things_and_stuff_exactly(tmp_path: Path) -> None:
    person, cup = patchwork(ROI, ROI, 2)
    left = rectangle(SIZE, SIZE, 0, 0, 64, SIZE)
    answer = outputs(
        ((50, 60, 50 + ROI, 60 + ROI), CUP, 0.6, cup),
        ((10, 5, 10 + ROI, 5 + ROI), PERSON, 0.9, person),
        stuff=semantic((SEA, left), (SKY, ~left)),
    )
    found = segment(tmp_path, answer)
    truth = np.zeros((2, SIZE, SIZE), bool)
    truth[0, 5 : 5 + ROI, 10 : 10 + ROI] = person
    truth[1, 60 : 60 + ROI, 50 : 50 + ROI] = cup
    assert seen(found) == [
        ("person", 1, True, 0.9),
        ("cup", 47, True, 0.6),
        ("sea", 155, False, 1.0),
        ("sky-other-merged", 187, False, 1.0),
    ]
    free = ~truth.any(axis=0)
    assert_masks(found, *truth, left & free, ~left & free)


def test_boxes_and_stuff_scale_with_the_image_which_lies_at_the_upper_left(tmp_path: Path) -> None:
    quarter = rectangle(32, 32, 0, 0, 32, 8)  # on a grid a quarter of the input's size
    answer = outputs(((16, 32, 64, 64), BOOK, 0.9, FULL), stuff=semantic((SKY, quarter)))
    found = segment(tmp_path, answer, width=512, height=256)
    assert_masks(found, rectangle(512, 256, 64, 128, 256, 256), rectangle(512, 256, 0, 0, 512, 128))


def test_fusion_is_detectron2s(tmp_path: Path) -> None:
    none = semantic((THING, np.zeros((SIZE, SIZE), bool)))
    rows = (
        ((0.0, 0.0, 40.0, 40.0), PERSON, 0.9, FULL),
        ((20.0, 0.0, 60.0, 40.0), CUP, 0.8, FULL),  # exactly half is hidden: it stays
        ((19.0, 0.0, 59.0, 40.0), BOOK, 0.7, FULL),  # more is hidden
        ((80.0, 80.0, 100.0, 100.0), BOOK, 0.49, FULL),  # below 0.5
    )
    found = segment(tmp_path, outputs(*rows, stuff=none))
    assert [label for label, *_ in seen(found)] == ["person", "cup"]
    assert_masks(found, rectangle(SIZE, SIZE, 0, 0, 40, 40), rectangle(SIZE, SIZE, 40, 0, 60, 40))
    lower = segment(tmp_path, outputs(*rows, stuff=none), score_threshold=0.4)
    assert [label for label, *_ in seen(lower)] == ["person", "cup", "book"]


def test_stuff_needs_an_area_of_the_image_that_things_leave_free(tmp_path: Path) -> None:
    sea, sky = rectangle(SIZE, SIZE, 0, 0, 64, 64), rectangle(SIZE, SIZE, 64, 64, 128, 128)  # 4096 pixels each
    pixel = ((64.0, 64.0, 65.0, 65.0), PERSON, 0.9, FULL)
    answer = outputs(pixel, stuff=semantic((SEA, sea), (SKY, sky)))
    assert [label for label, *_ in seen(segment(tmp_path, answer))] == ["person", "sea"]
    found = segment(tmp_path, answer, min_stuff_px=4095)
    assert [label for label, *_ in seen(found)] == ["person", "sea", "sky-other-merged"]
    twice = segment(tmp_path, answer, width=2 * SIZE, height=2 * SIZE)
    assert [label for label, *_ in seen(twice)] == ["person", "sea", "sky-other-merged"]


def test_only_what_is_wanted_is_kept(tmp_path: Path) -> None:
    everywhere = np.ones((SIZE, SIZE), bool)
    answer = outputs((WHOLE, PERSON, 0.9, FULL), ((0, 0, 9, 9), CUP, 0.8, FULL), stuff=semantic((SKY, everywhere)))
    found = segment(tmp_path, answer, labels=("cup", "sky-other-merged"))
    assert [label for label, *_ in seen(found)] == ["cup", "sky-other-merged"]


def test_the_input_is_padded_rgb_by_imagenets_statistics(tmp_path: Path) -> None:
    """The graph's box is the person's, whose score is what it is asked for; its stuff is sea where red is bright."""
    nodes = [
        graphs.constant_node("dets", np.zeros((1, 1, 5), np.float32)),
        graphs.constant_node("labels", np.zeros((1, 1), np.int64)),
        graphs.constant_node("masks", np.zeros((1, 1, ROI, ROI), np.float32)),
        graphs.constant_node("pads", np.array([0, SEA, 0, 0, 0, 54 - 3 - SEA, 0, 0])),
        helper.make_node("Pad", ["input", "pads"], ["semseg"]),  # stuff SEA, SEA + 1, SEA + 2: red, green, blue
    ]
    shapes = {
        "dets": (1, 1, 5),
        "labels": (1, 1),
        "masks": (1, 1, ROI, ROI),
        "semseg": (1, 54, "height", "width"),
    }
    inputs = {"input": (1, 3, "height", "width")}
    weights = graphs.write(tmp_path / "colors.onnx", nodes, inputs, shapes, integers={"labels"})
    image = np.zeros((96, 200, 3), np.uint8)
    image[:, :100, 0], image[:, 100:, 1] = 124, 117  # a little above the means of red and green
    settings = PanopticFpn.Settings(weights=weights, short_side_px=96, long_side_px=224, min_stuff_px=1)
    found = PanopticFpn(settings).segment(frame_of(image))
    assert [instance.category_id for instance in found.instances] == [155, STUFF_IDS[SEA + 1]]
    assert_masks(found, rectangle(200, 96, 0, 0, 100, 96), rectangle(200, 96, 100, 0, 200, 96))
