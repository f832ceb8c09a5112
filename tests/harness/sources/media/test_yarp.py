"""Logs of yarpdatadumper, in the forms of its source of 2010 and of 2021."""

from __future__ import annotations

from pathlib import Path

import pytest

from harness.sources.media.yarp import read_log
from tests.disk import write_text
from vfoa.errors import VfoaError


@pytest.mark.parametrize(
    "text",
    [
        "Type: Image:ppm;\nSource: /icub/cam/left [connected]\n7 10.25 00000000.ppm\n8 10.283333 00000001.ppm\n",
        "7 10.250000 00000000.ppm [rgb]\r\n8 10.283333 00000001.ppm [rgb]\r\n\r\n",
        "7 10.250000 10.251234 00000000.ppm [mono]\n8 10.283333 10.285000 00000001.ppm [mono]\n",
    ],
)
def test_the_sender_s_time_of_each_image_is_read(tmp_path: Path, text: str) -> None:
    path = write_text(tmp_path / "left" / "data.log", text)
    names = {10_250_000_000: "00000000.ppm", 10_283_333_000: "00000001.ppm"}
    assert read_log(path) == {time_ns: path.parent / name for time_ns, name in names.items()}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", ": no images"),
        ("7 10.25 0 1 2 3.5\n", ":1: found '7 10.25 0 1 2 3.5'; expected a number, a time and an image"),
        ("7 10.25 ../../key.ppm\n", ":1: found"),
        ("7 10.25 00000000.ppm\n8 10.25 00000001.ppm\n", ":2: the time 10.25 occurs twice: 00000000.ppm"),
    ],
)
def test_what_is_no_log_of_images_is_named(tmp_path: Path, text: str, message: str) -> None:
    path = write_text(tmp_path / "data.log", text)
    with pytest.raises(VfoaError) as error:
        read_log(path)
    assert str(error.value).startswith(f"{path}{message}")
