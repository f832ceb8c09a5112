"""Decompression of recordings, bounded by the size that their headers state: a few kB can unpack to gigabytes."""

from __future__ import annotations

import bz2

import lz4.frame  # type: ignore[import-untyped]
import zstandard

MOST_BYTES = 2**28
"""Most bytes of a decompressed chunk or message; writers begin a new chunk after 1 to 4 MB, or a larger message."""


def unpack(data: bytes, compression: str, size: int) -> bytes:
    """Return the bytes of a chunk, decompressed to the size that it states.

    Raises
    ------
    ValueError
        If the size is too large or wrong, or the compression is none of lz4, zstd, bz2, none and "".
    Exception
        If the data are damaged: the libraries have errors of their own.
    """
    if size > MOST_BYTES:
        raise ValueError(f"it claims {size} bytes; expected at most {MOST_BYTES}")
    match compression:
        case "zstd":
            data = zstandard.ZstdDecompressor().stream_reader(data).read(size + 1)
        case "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
        case "bz2":
            data = bz2.BZ2Decompressor().decompress(data, max_length=size + 1)
        case "" | "none":
            pass
        case _:
            raise ValueError(f"compression {compression!r}; expected lz4, zstd, bz2 or none")
    if len(data) != size:
        raise ValueError(f"it does not unpack to the {size} bytes that it claims")
    return data


def zstd_size(head: bytes) -> int | None:
    """The size that the head of data in Zstandard states, bytes; None if it states none. Raises as :func:`unpack`."""
    size: int = zstandard.get_frame_parameters(head).content_size
    return None if size == zstandard.CONTENTSIZE_UNKNOWN else size
