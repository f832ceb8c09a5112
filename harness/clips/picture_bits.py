"""Which bits of 16-bit pictures a camera uses: of 12 bits in 16, cutting to 8 keeps 4."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

_BITS, _KEPT = 16, 8
MOST_NOTED = 14
"""Most bits that are noted: 15 lose one bit, as a dark scene of 16 bits does."""


def picture_bits_notes(greatest: Sequence[int]) -> Iterator[str]:
    """A note if the greatest values of 16-bit pictures need fewer bits, with what to do."""
    most = max(greatest, default=0)
    if not 0 < (bits := most.bit_length()) <= MOST_NOTED:
        return
    factor = 2 ** (_BITS - bits)
    yield (
        f"the 16-bit pictures use {bits} bits (the greatest value found is {most}): of these, the 8 bits that "
        f"are read keep {max(0, bits - _KEPT)}; multiply the values by {factor} before they are saved (files: "
        f"cv2.imwrite(file, cv2.imread(file, cv2.IMREAD_UNCHANGED) * {factor}))"
    )
