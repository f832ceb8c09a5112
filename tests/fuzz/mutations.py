"""Files that are almost right: seeded mutations of whole files, of their bytes and of what their format means.

The same generator gives the same bytes, so that a case is named by its parser, its seed and its number.
"""

from __future__ import annotations

from collections.abc import Sequence
from random import Random
from typing import Literal

from tests.fuzz.bytewise import BYTEWISE, TEXTUAL
from tests.fuzz.structured import STRUCTURED

Kind = Literal["binary", "text", "csv", "json", "jsonl", "toml", "xml", "yaml", "zip"]

MOST_BYTES = 1 << 18
"""No case is longer, or twice the longest whole file."""
_MOST_MUTATIONS = 4


def mutate(rng: Random, data: bytes, corpus: Sequence[bytes], kind: Kind) -> bytes:
    """One to four mutations of a file, half of them of its structure where the kind has one."""
    most = max(MOST_BYTES, 2 * max(map(len, corpus)))
    for _ in range(rng.randint(1, _MOST_MUTATIONS)):
        structured = STRUCTURED.get(kind)
        if structured is not None and rng.random() < 0.6:
            data = structured(rng, data, corpus)
        elif kind != "binary" and kind != "zip" and rng.random() < 0.6:
            data = rng.choice(TEXTUAL)(rng, data, corpus)
        else:
            data = rng.choice(BYTEWISE)(rng, data, corpus)
    return data[:most]
