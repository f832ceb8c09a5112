from __future__ import annotations

import numpy as np
import pytest

from harness.recording import entities
from harness.recording.once import once
from tests.harness.recording.conftest import ANN


def test_the_same_array_is_encoded_once_and_an_equal_one_anew() -> None:
    made: list[str] = []

    def make(image: np.ndarray, size: str) -> str:
        made.append(f"{image.sum()} {size}")
        return made[-1]

    image = np.ones(3, np.uint8)
    assert once(make, image, "light") == once(make, image, "".join(["li", "ght"])) == "3 light"
    assert len(made) == 1
    assert once(make, image, "full") == "3 full"
    assert once(make, image.copy(), "full") == "3 full"
    assert once(make, 2 * image, "full") == "6 full"
    assert len(made) == 4


@pytest.mark.parametrize("sizes", [("light", "light"), ("light", "full")])
def test_recordings_side_by_side_hold_what_each_would_hold_alone(frames, record_run, read_back, tmp_path, sizes):
    from harness.recording.recorder import Recorder

    paths = [tmp_path / "beside" / f"clip__{number}.rrd" for number in range(2)]
    recorders = [
        Recorder(
            path, clip="clip", configuration=path.stem, rate_hz=25, size=size, subjects=(ANN,), targets=("red cup",)
        )
        for path, size in zip(paths, sizes, strict=True)
    ]
    with recorders[0], recorders[1]:
        for shown in frames:
            for recorder in recorders:
                recorder.log(shown)
    for path, size in zip(paths, sizes, strict=True):
        alone, beside = read_back(record_run(frames, size=size)), read_back(path)
        for entity, component in (
            (entities.IMAGE, "EncodedImage:blob"),
            (entities.RIGHT, "EncodedImage:blob"),
            (entities.MASKS, "SegmentationImage:buffer"),
            (entities.DISPARITY, "DepthImage:buffer"),
        ):
            assert len(alone.at(entity, component)) == len(frames)
            assert beside.at(entity, component) == alone.at(entity, component)
