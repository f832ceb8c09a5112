"""Recordings that were cut or damaged: what is left is read, and what is lost is said."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]
import numpy as np
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Chunk
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType

from harness.sources.recordings.mcap_files import HEAD, records_in
from tests.disk import HEIGHT, WIDTH, picture
from tests.harness.sources.numbered_recording import open_clip, pairs, stamp
from tests.recordings import Family, write_pairs
from vfoa.errors import VfoaError


@pytest.mark.parametrize("family", ["ros2", "protobuf"])
def test_a_cut_file_gives_the_frames_before_the_cut_and_says_so(tmp_path: Path, family: Family) -> None:
    whole = write_pairs(tmp_path / "a.mcap", pairs(range(1, 31)), family, chunk_size=4 * WIDTH * HEIGHT)
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: int(whole.stat().st_size * 0.6)])
    clip = open_clip(cut)
    assert 15 <= len(clip.frames) <= 18
    for n in clip.frames:
        assert np.array_equal(clip.frame(n).left, picture(n))
    assert f"cut at byte {cut.stat().st_size}" in clip.notes[0]
    assert "lost" in clip.notes[0]


def test_what_a_lost_first_chunk_declared_is_found_in_the_summary(tmp_path: Path) -> None:
    path = write_pairs(
        tmp_path / "a.mcap", pairs(range(1, 11)), chunk_size=4 * WIDTH * HEIGHT, compression=CompressionType.NONE
    )
    data = bytearray(path.read_bytes())
    data[data.index(picture(1).tobytes()) + 1000] ^= 1
    path.write_bytes(data)
    clip = open_clip(path)
    assert 7 <= len(clip.frames) <= 9
    assert np.array_equal(clip.frame(len(clip.frames)).left, picture(10))


def test_zeros_after_a_crash_are_a_cut(tmp_path: Path) -> None:
    path = write_pairs(tmp_path / "a.mcap", pairs(range(1, 11)), chunk_size=4 * WIDTH * HEIGHT)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2] + bytes(len(whole)))
    clip = open_clip(path)
    assert 1 <= len(clip.frames) < 10
    assert [
        word for note in clip.notes for word in ("chunk at byte", "everything after it is lost") if word in note
    ] == [
        "chunk at byte",
        "everything after it is lost",
    ]


def test_a_flipped_bit_is_found_by_checksum_and_costs_its_chunk_alone(tmp_path: Path) -> None:
    path = write_pairs(
        tmp_path / "a.mcap", pairs(range(1, 11)), chunk_size=4 * WIDTH * HEIGHT, compression=CompressionType.NONE
    )
    data = bytearray(path.read_bytes())
    place = data.index(picture(4).tobytes()) + 1000
    data[place] ^= 1
    path.write_bytes(data)
    clip = open_clip(path)
    assert 7 <= len(clip.frames) <= 9
    kept = {clip.frame(n).time_ns for n in clip.frames}
    assert stamp(4) not in kept
    assert {stamp(1), stamp(10)} < kept
    assert "checksum" in clip.notes[0]


def test_a_damaged_compressed_chunk_is_told(tmp_path: Path) -> None:
    path = write_pairs(tmp_path / "a.mcap", pairs(range(1, 11)), chunk_size=4 * WIDTH * HEIGHT)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 255
    path.write_bytes(data)
    clip = open_clip(path)
    assert 7 <= len(clip.frames) <= 9
    assert "damaged" in clip.notes[0]


@pytest.mark.parametrize("compression", ["zstd", "lz4"])
@pytest.mark.parametrize("claimed", [2**20, 2**40])
def test_a_chunk_is_not_unpacked_beyond_what_it_claims_and_a_recording_can_have(compression: str, claimed: int) -> None:
    pack = zstandard.compress if compression == "zstd" else lz4.frame.compress
    chunk = Chunk(
        compression=compression,
        data=pack(bytes(2**24)),
        message_start_time=0,
        message_end_time=0,
        uncompressed_crc=0,
        uncompressed_size=claimed,
    )
    content = _content(chunk)
    tracemalloc.start()
    with pytest.raises(ValueError, match="claims"):
        records_in(content)
    assert tracemalloc.get_traced_memory()[1] < 2**23
    tracemalloc.stop()


@pytest.mark.parametrize("has_checksum", [True, False])
def test_a_compression_that_nobody_reads_is_named(tmp_path: Path, has_checksum: bool) -> None:
    path = write_pairs(tmp_path / "a.mcap", pairs(), "protobuf", enable_crcs=has_checksum)
    path.write_bytes(path.read_bytes().replace(b"zstd", b"zst2"))
    with pytest.raises(VfoaError, match=r"a\.mcap: .*compression 'zst2'.*lz4"):
        open_clip(path)


@pytest.mark.parametrize("compression", list(CompressionType))
def test_the_records_of_a_chunk_are_those_that_the_library_finds(tmp_path: Path, compression: CompressionType) -> None:
    path = write_pairs(tmp_path / "a.mcap", pairs(), chunk_size=4 * WIDTH * HEIGHT, compression=compression)
    with path.open("rb") as file:
        chunks = [record for record in StreamReader(file, emit_chunks=True).records if isinstance(record, Chunk)]
    assert len(chunks) > 1
    for chunk in chunks:
        assert records_in(_content(chunk)) == breakup_chunk(chunk)


def _content(chunk: Chunk) -> memoryview:
    """What a chunk's record holds after its opcode and length."""
    builder = RecordBuilder()
    chunk.write(builder)
    return memoryview(builder.end())[HEAD.size :]
