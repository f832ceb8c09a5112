from __future__ import annotations

from enum import StrEnum
from random import Random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from harness.pipeline.cache_store import content_digest, decode, encode
from vfoa.types import Disparity, Gaze, Head, HeadPose, Instance, Instances


class Word(StrEnum):
    YES = "yes"


SHAPES = arrays.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=7)
DTYPES = st.sampled_from(["f4", "f8", "u1", "u2", "i8", "?"])


@given(arrays.arrays(dtype=DTYPES, shape=SHAPES))
def test_an_array_survives_to_the_last_bit(array: np.ndarray) -> None:
    (found,) = decode(encode((array,)))
    assert (found.dtype, found.shape, found.tobytes()) == (array.dtype, array.shape, array.tobytes())


@given(arrays.arrays(dtype=DTYPES, shape=arrays.array_shapes(min_dims=2, max_dims=3, min_side=2)), st.randoms())
def test_an_array_keeps_the_order_of_its_axes(array: np.ndarray, random: Random) -> None:
    turned = array.transpose(random.sample(range(array.ndim), array.ndim))[::-1]
    (found,) = decode(encode((turned,)))
    assert np.array_equal(found, turned, equal_nan=found.dtype.kind == "f")
    assert np.argsort(found.strides).tolist() == np.argsort(np.abs(turned.strides)).tolist()


@given(st.floats(), st.integers(-(2**63), 2**63 - 1), st.text())
def test_numbers_and_text_survive_with_their_types(number: float, integer: int, text: str) -> None:
    values = (number, np.float32(1.1), np.float64(number), integer, np.int64(integer), True, text, None)
    found = decode(encode(values))
    assert [type(each) for each in found] == [type(value) for value in values]
    assert repr(found) == repr(values)


def test_the_values_of_the_pipeline_survive() -> None:
    rng = np.random.default_rng(1)
    disparity = rng.uniform(0, 64, (6, 8)).astype(np.float32)
    disparity[0, :3] = np.nan
    instances = (Instance(id=3, label="cup", category_id=47, is_thing=True, score=0.1),)
    heads = (
        Head(box_px=np.array([1.0, 2, 3, 4]), score=0.3, landmarks_px=rng.normal(size=(5, 2)), instance_id=3),
        Head(box_px=np.array([1 / 3, 2, 3, 4]), score=0.7),
    )
    values = (
        Disparity(disparity_px=disparity, confidence=disparity / 3),
        Instances(ids=np.where(disparity > 30, 3, 0).astype(np.uint16), instances=instances),
        heads,
        HeadPose(direction=np.array([0.3, 0.1, -0.9]), yaw_rad=0.1, sigma_rad=0.2),
        Gaze(direction=np.array([1e-9, 0.1, -0.9])),
    )
    found = decode(encode(values))
    assert encode(found) == encode(values)
    assert found[0].disparity_px.tobytes() == disparity.tobytes()
    assert found[1].instances == instances
    assert isinstance(found[2], tuple)
    assert found[3].direction.tobytes() == values[3].direction.tobytes()
    assert np.isnan(found[3].pitch_rad)


def test_what_is_no_value_of_the_pipeline_is_refused() -> None:
    for thing in (object(), {1, 2}, {"a": {1}}, b"bytes", Word.YES, np.array([object()]), print):
        with pytest.raises(TypeError):
            encode((thing,))


def test_contents_are_told_apart_and_equal_ones_are_not() -> None:
    box = np.array([1.0, 2, 3, 4])
    one, same = Head(box_px=box, score=0.5), Head(box_px=box.copy(), score=0.5)
    others = [Head(box_px=box + 1e-12, score=0.5), Head(box_px=box, score=0.5, instance_id=1), None]
    assert content_digest(one) == content_digest(same)
    assert len({content_digest(each) for each in (one, *others)}) == 4
    assert content_digest(one, None) != content_digest(None, one)
