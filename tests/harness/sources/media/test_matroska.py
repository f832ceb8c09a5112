"""Blocks of Matroska files are the packets that FFmpeg finds."""

from __future__ import annotations

from pathlib import Path

import av
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.sources.media.matroska import read_blocks
from tests.disk import moving_picture, write_bytes
from tests.examples import few
from tests.kinect import kinect_recording
from vfoa.errors import VfoaError


def _packets(path: Path) -> list[tuple[int, int, bytes]]:
    with av.open(str(path)) as container:
        streams = list(container.streams.video)
        places = {stream.index: place for place, stream in enumerate(streams)}
        return [
            (places[packet.stream.index], round(packet.pts * packet.time_base * 10**9), bytes(packet))
            for packet in container.demux(streams)
            if packet.pts is not None
        ]


def _blocks(path: Path) -> list[tuple[int, int, bytes]]:
    data = path.read_bytes()
    return [(each.track, each.time_ns, data[each.offset : each.offset + each.size]) for each in read_blocks(path)]


def _film(path: Path, count: int, **options: str) -> Path:
    """Two tracks of whole pictures, at other times."""
    with av.open(str(path), "w", format="matroska", options=options) as container:
        streams = [container.add_stream("mjpeg", rate=rate, options={"strict": "-1"}) for rate in (25, 10)]
        for stream in streams:
            stream.width, stream.height, stream.pix_fmt = 64, 48, "yuvj420p"
        for number in range(count):
            for stream in streams:
                picture = av.VideoFrame.from_ndarray(moving_picture(number)).reformat(format="yuvj420p")
                picture.pts = number
                container.mux(stream.encode(picture))
        for stream in streams:
            container.mux(stream.encode())
    return path


@pytest.mark.parametrize("options", [{}, {"live": "1"}, {"cluster_time_limit": "100"}, {"reserve_index_space": "9000"}])
def test_blocks_are_ffmpeg_s_packets(tmp_path: Path, options: dict[str, str]) -> None:
    path = _film(tmp_path / "a.mkv", 20, **options)
    found = _blocks(path)
    assert len(found) == 40
    assert sorted(found) == sorted(_packets(path))


def test_blocks_of_azure_kinect_s_recorder(tmp_path: Path) -> None:
    path = kinect_recording(tmp_path)
    assert _blocks(path) == _packets(path)


@few
@given(st.floats(0, 1))
def test_a_file_that_was_cut_off_has_the_blocks_before(tmp_path_factory: pytest.TempPathFactory, share: float) -> None:
    path = kinect_recording(tmp_path_factory.mktemp("mkv"))
    data, whole = path.read_bytes(), _blocks(path)
    path.write_bytes(data[: 100 + int(share * (len(data) - 100))])
    found = _blocks(path)
    assert found == whole[: len(found)]
    assert len(found) >= len(whole) * share - 2


@given(st.binary(max_size=80))
def test_other_bytes_are_refused_or_have_no_block(tmp_path_factory: pytest.TempPathFactory, data: bytes) -> None:
    path = write_bytes(tmp_path_factory.mktemp("mkv") / "a.mkv", data)
    with pytest.raises(VfoaError, match=r"a\.mkv: not a Matroska file"):
        read_blocks(path)
    try:
        found = read_blocks(write_bytes(path, b"\x1a\x45\xdf\xa3\x80" + data))
    except VfoaError:
        return
    assert sum(block.size for block in found) <= len(data)
