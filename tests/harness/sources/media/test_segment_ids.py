from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from harness.sources.media.maps import present_ids
from vfoa.pixels import relabel

some_ids = st.sampled_from([0, 1, 7, 255, 256, 65535, 65536, 2**24 - 1])
maps = arrays(np.uint32, st.tuples(st.integers(0, 4), st.integers(0, 4)), elements=some_ids)


@given(ids=maps)
def test_the_ids_of_a_map_are_those_in_it(ids: np.ndarray) -> None:
    assert present_ids(ids).tolist() == sorted(set(ids.ravel().tolist()))


@given(ids=maps, small=st.dictionaries(some_ids, st.integers(1, 65535)))
def test_each_id_becomes_its_small_one_or_none(ids: np.ndarray, small: dict[int, int]) -> None:
    relabelled = relabel(ids, small)
    assert relabelled.dtype == np.uint16
    assert relabelled.tolist() == [[small.get(number, 0) for number in row] for row in ids.tolist()]
