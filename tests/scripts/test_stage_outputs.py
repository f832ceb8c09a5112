from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.pipeline.stage_files.coco_panoptic import CocoPanoptic, CocoPanopticSettings
from scripts.measure.mirror import frame_of
from scripts.measure.stage_outputs import write_coco_panoptic
from vfoa.errors import VfoaError
from vfoa.types import Instance, Instances, StereoFrame

PERSON, SKY = (1, "person", True), (187, "sky-other-merged", False)


class AnyClip(NamedTuple):
    """A clip of which only the frame numbers are known."""

    frames: tuple[int, ...]


def instances_of(ids: np.ndarray, **kinds: tuple[int, tuple[int, str, bool], float]) -> Instances:
    """Instances of an id map: each an id, a category and a score. An id is that of one object in all frames."""
    return Instances(
        ids=ids.astype(np.uint16),
        instances=tuple(
            Instance(id=id_, label=label, category_id=category, is_thing=is_thing, score=score, keeps_id=True)
            for id_, (category, label, is_thing), score in kinds.values()
        ),
    )


def frame(number: int, ids: np.ndarray) -> StereoFrame:
    return replace(frame_of(np.zeros((*ids.shape, 3), np.uint8)), index=number)


def read(root: Path, number: int, ids: np.ndarray, *stuff: str) -> Instances:
    settings_ = CocoPanopticSettings(root=str(root), stuff=stuff)
    return CocoPanoptic(settings_, AnyClip((number,))).segment(frame(number, ids))  # type: ignore[arg-type]


@given(
    first=st.integers(1, 65534),
    number=st.integers(0, 12345),
    score=st.floats(0, 1),
    seed=st.integers(0, 99),
)
def test_what_was_written_is_read_back(tmp_path: Path, first: int, number: int, score: float, seed: int) -> None:
    second = 65535
    ids = np.random.default_rng(seed).choice([0, first, second], (6, 9))
    ids[0, :3] = 0, first, second
    written = instances_of(ids, sky=(second, SKY, 1.0), person=(first, PERSON, score))
    write_coco_panoptic(tmp_path, [(number, written)])
    found = read(tmp_path, number, ids, "sky-other-merged")
    np.testing.assert_array_equal(found.ids, ids)
    assert found.instances == written.instances


def test_the_file_is_cocos(tmp_path: Path) -> None:
    ids = np.zeros((5, 8), np.uint16)
    ids[1:4, 2:7], ids[2, 3] = 300, 0
    person = instances_of(ids, person=(300, PERSON, 0.5), gone=(7, PERSON, 0.4))
    write_coco_panoptic(tmp_path, [(3, instances_of(np.zeros((5, 8)))), (12, person)])
    content = json.loads((tmp_path / "panoptic.json").read_text(encoding="utf-8"))
    assert [image["id"] for image in content["images"]] == [3, 12]
    assert content["images"][1] == {"id": 12, "file_name": "frame_0012.png", "width": 8, "height": 5}
    assert content["categories"] == [{"id": 1, "name": "person", "isthing": 1}]
    assert content["annotations"][0]["segments_info"] == []
    (segment,) = content["annotations"][1]["segments_info"]
    expected = {"id": 300, "category_id": 1, "iscrowd": 0, "bbox": [2, 1, 5, 3], "area": 14, "score": 0.5}
    assert segment == expected
    np.testing.assert_array_equal(read(tmp_path, 12, ids).ids, ids)


def test_a_number_with_two_meanings_is_refused(tmp_path: Path) -> None:
    ids = np.ones((2, 2))
    person, stuff = instances_of(ids, a=(1, PERSON, 1.0)), instances_of(ids, a=(1, (1, "banner", False), 1.0))
    with pytest.raises(VfoaError, match="category 1 is 'person' and 'banner'"):
        write_coco_panoptic(tmp_path, [(1, person), (2, stuff)])
    assert not (tmp_path / "panoptic.json").exists()
