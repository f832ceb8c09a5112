"""Mutations that know no format: of bytes, and of words and lines of text."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Sequence
from random import Random

Mutation = Callable[[Random, bytes, Sequence[bytes]], bytes]

WORDS = (
    *("", " ", "\t", "\n", "\r", "\0", "\x1b[2J", "é", "漢", "\u2028", "\ufeff", "\udc80"),
    *("%s", "%n", "{}", "..", "/", "=", "NaN", "None"),
    *("nan", "inf", "-inf", "none", "ignore", "null", "true", "-0", "0", "-1", "1", "1.5", "1e-300", "1e300", "1e999"),
    *("2147483648", "4294967296", "9223372036854775807", "9223372036854775808", "-9223372036854775809"),
    *("99999999999999999999", "0x7f", "1_0", "٣", "²", "[", "]", "{", "}", '"', "'", "\\", "#", "&", "<", "]]>", "!!x"),
    *("9" * 400, "a" * 3000, "../../x", "1970-01-01", "&a", "*a", "${CLIP}", "%d", "%099999999d"),
)
_INTEGERS = (0, 1, 2, *((1 << bits) - less for bits in (7, 8, 15, 16, 31, 32, 63, 64) for less in (0, 1)))


def _place(rng: Random, data: bytes) -> tuple[int, int]:
    first = rng.randrange(len(data) + 1)
    return first, min(len(data), first + rng.choice((1, 2, 4, 8, 16, 64, 300)))


def flip(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    changed = bytearray(data)
    for _each in range(rng.choice((1, 1, 2, 8)) if data else 0):
        changed[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def _number(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """An interesting integer, or the one there a little changed, over 1, 2, 4 or 8 bytes."""
    code, size = rng.choice((("B", 1), ("H", 2), ("I", 4), ("Q", 8)))
    if len(data) < size:
        return data
    at, order = rng.randrange(len(data) - size + 1), rng.choice("<>")
    (there,) = struct.unpack_from(order + code, data, at)
    value = rng.choice(_INTEGERS) if rng.random() < 0.6 else there + rng.choice((-16, -1, 1, 16))
    return data[:at] + struct.pack(order + code, value % (1 << 8 * size)) + data[at + size :]


def _truncate(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _drop(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    first, last = _place(rng, data)
    return data[:first] + data[last:]


def _double(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    first, last = _place(rng, data)
    return data[:last] + data[first:last] * rng.choice((1, 1, 3, 50)) + data[last:]


def _insert(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    at = rng.randrange(len(data) + 1)
    return data[:at] + rng.randbytes(rng.choice((1, 2, 4, 8, 32))) + data[at:]


def _zero(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    first, last = _place(rng, data)
    return data[:first] + rng.choice((b"\0", b"\xff")) * (last - first) + data[last:]


def _splice(rng: Random, data: bytes, corpus: Sequence[bytes]) -> bytes:
    """A piece of a whole file over, or into, this one."""
    other = rng.choice(corpus)
    first, last = _place(rng, other)
    at = rng.randrange(len(data) + 1)
    return data[:at] + other[first:last] + data[at + rng.choice((0, last - first)) :]


BYTEWISE: tuple[Mutation, ...] = (flip, flip, _number, _number, _truncate, _drop, _double, _insert, _zero, _splice)


# Text


def exchange_word(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """Another word or number in the place of one."""
    matches = list(re.finditer(rb"[\w.+-]+", data))
    if not matches:
        return data
    match = rng.choice(matches)
    words = [rng.choice(WORDS).encode(errors="surrogatepass"), rng.choice(matches)[0]]
    return data[: match.start()] + rng.choice(words) + data[match.end() :]


def change_lines(rng: Random, data: bytes, _: Sequence[bytes]) -> bytes:
    """A line dropped, doubled, moved, pushed in or out, or joined with the next."""
    lines = data.splitlines(keepends=True)
    if not lines:
        return data
    at, to = rng.randrange(len(lines)), rng.randrange(len(lines))
    what = rng.randrange(6)
    if what == 0:
        del lines[at]
    elif what == 1:
        lines.insert(to, lines[at])
    elif what == 2:
        lines[at], lines[to] = lines[to], lines[at]
    elif what == 3:
        lines[at] = rng.choice((b"  ", b"- ", b"\t", b"#", b",")) + lines[at]
    elif what == 4:
        lines[at] = lines[at].lstrip()
    else:
        lines[at] = lines[at].rstrip(b"\r\n")
    return b"".join(lines)


TEXTUAL: tuple[Mutation, ...] = (exchange_word, exchange_word, exchange_word, change_lines, _splice, flip, _truncate)
