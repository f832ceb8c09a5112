"""Masks of COCO's files, against COCO's own code and scikit-image."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pycocotools.mask
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from skimage.draw import polygon2mask

from harness.files.coco_masks import read_mask
from vfoa.errors import VfoaError
from vfoa.types import Mask

MASKS = arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, min_side=1, max_side=40))


def read(segmentation: Any, size: tuple[int, int]) -> Mask:
    return read_mask(json.dumps(segmentation).encode(), size, "a.json: annotation 1: segmentation")


@given(MASKS)
def test_run_lengths_are_those_of_coco_s_own_code(mask: Mask) -> None:
    packed = pycocotools.mask.encode(np.asfortranarray(mask.astype(np.uint8)))
    assert np.array_equal(read({"size": [*mask.shape], "counts": packed["counts"].decode()}, mask.shape), mask)


@given(MASKS)
def test_run_lengths_may_be_numbers(mask: Mask) -> None:
    flat = mask.T.ravel().tolist()
    counts, is_covered = [0], False
    for pixel in flat:
        if pixel != is_covered:
            counts.append(0)
            is_covered = pixel
        counts[-1] += 1
    assert np.array_equal(read({"size": [*mask.shape], "counts": counts}, mask.shape), mask)


def test_a_mask_of_coco_s_own_results() -> None:
    """A small object of ``instances_val2014_fakesegm100_results.json`` of cocodataset/cocoapi."""
    counts = "c]e32X=1N3N2I7M3N2N2MFbCJ`<1eCN\\<NiCOZd`4"
    mask = read({"size": [426, 640], "counts": counts}, (426, 640))
    assert pycocotools.mask.encode(np.asfortranarray(mask.astype(np.uint8)))["counts"] == counts.encode()
    assert 0 < mask.sum() < 500


@given(
    st.lists(st.tuples(st.floats(-5, 45), st.floats(-5, 35)), min_size=3, max_size=9),
    st.lists(st.tuples(st.integers(-2, 42), st.integers(-2, 32)), min_size=3, max_size=5),
)
def test_polygons_hold_the_centres_inside(corners: list[tuple[float, float]], others: list[tuple[int, int]]) -> None:
    """scikit-image's centres are whole numbers; what lies on a side may differ, so corners are moved off it."""
    size, moved = (30, 40), np.array([0.1301, 0.0703])
    parts = [np.array(each, dtype=float).round(2) + moved for each in (corners, others)]
    assume(all(part.min() < 0 or part.max() > 1 for part in parts))  # those are shares of the image
    found = read([part.ravel().tolist() for part in parts], size)
    expected = np.logical_or(*(polygon2mask(size, part[:, ::-1] - 0.5) for part in parts))
    assert np.count_nonzero(found != expected) <= 1


def test_a_square_of_whole_pixels() -> None:
    mask = read([[2, 1, 5, 1, 5, 4, 2, 4]], (6, 8))
    assert np.argwhere(mask).tolist() == [[row, column] for row in (1, 2, 3) for column in (2, 3, 4)]


@pytest.mark.parametrize(
    ("segmentation", "words"),
    [
        (None, ["no mask"]),
        ([], ["no mask"]),
        ([[]], ["no mask"]),
        ([[1, 2, 3, 4]], ["4 numbers"]),
        ([[1, 2, 3, 4, 5, 6, 7]], ["7 numbers"]),
        ([[1, 2, 3, 4, 1e9, 6]], ["8 x 6"]),
        ([[0.1, 0.2, 0.3, 0.2, 0.3, 1]], ["from 0 to 1", "pixels"]),
        ({"size": [8, 6], "counts": [48]}, ["[8, 6]", "[6, 8]"]),
        ({"size": [6, 8], "counts": [47]}, ["47", "48"]),
        ({"size": [6, 8], "counts": [-1, 49]}, ["48"]),
        ({"size": [6, 8], "counts": [50, -2]}, ["48"]),
        ({"size": [6, 8], "counts": []}, ["48"]),
        ({"size": [6, 8], "counts": "zzzz"}, ["'zzzz'"]),
        ({"size": [6, 8], "counts": ""}, ["''"]),
        ({"size": [6, 8], "counts": "P" * 30 + "0"}, ["PPP"]),
        ({"size": [6, 8], "counts": "0"}, ["0 pixels", "48"]),
        ({"size": [6, 8], "counts": "é"}, ["é"]),
        ({"size": [6, 8]}, ["counts"]),
        ("a", []),
    ],
)
def test_what_is_no_mask_is_named(segmentation: Any, words: list[str]) -> None:
    with pytest.raises(VfoaError) as error:
        read(segmentation, (6, 8))
    assert str(error.value).startswith("a.json: annotation 1: segmentation: ")
    assert [word for word in words if word not in str(error.value)] == []


@given(st.text(st.characters(min_codepoint=48, max_codepoint=111), max_size=40))
def test_any_text_is_a_mask_or_an_error(counts: str) -> None:
    try:
        mask = read({"size": [6, 8], "counts": counts}, (6, 8))
    except VfoaError:
        return
    assert mask.shape == (6, 8)
    assert mask.dtype == np.bool_
