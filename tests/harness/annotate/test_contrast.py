"""Names stand on colours and stripes: WCAG 2.1 asks for a contrast of 4.5 to 1."""

from __future__ import annotations

import re
from importlib import resources

import numpy as np
import pytest
from numpy.typing import NDArray

CSS = (resources.files("harness.annotate") / "page" / "page.css").read_text()
COLOURS = dict(re.findall(r"\.(c-[a-z]+|is-none|is-ignore) \{ --c: (#[0-9a-f]{3,6});", CSS))
STRIPES = max(int(alpha, 16) / 15 for alpha in re.findall(r"repeating-linear-gradient\([^)]*#000([0-9a-f]) ", CSS))


def _linear(colour: str) -> NDArray[np.float64]:
    """sRGB (3,) in [0, 1] of #rgb or #rrggbb."""
    digits = colour.lstrip("#")
    pairs = [each * 2 for each in digits] if len(digits) == 3 else [digits[k : k + 2] for k in (0, 2, 4)]
    return np.array([int(pair, 16) / 255 for pair in pairs])


def _contrast(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    def luminance(colour: NDArray[np.float64]) -> float:
        linear = np.where(colour <= 0.03928, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


def _ink(selector: str) -> NDArray[np.float64]:
    (rule,) = re.findall(rf"^{re.escape(selector)} \{{([^}}]*)\}}", CSS, re.MULTILINE)
    (colour,) = re.findall(r"(?<![-\w])color: (#[0-9a-f]+);", rule)
    return _linear(colour)


def test_every_colour_is_found() -> None:
    assert len(COLOURS) == 12


@pytest.mark.parametrize("name", COLOURS)
def test_a_name_can_be_read_on_its_colour_and_on_its_stripes(name: str) -> None:
    colour = _linear(COLOURS[name])
    for ground in (colour, colour * (1 - STRIPES)):
        assert _contrast(_ink(".piece"), ground) >= 4.5
        assert _contrast(_ink("#names .look"), ground) >= 4.5
        whitened = 1 - (1 - ground) * (1 - 0xB8 / 255)
        assert _contrast(_ink(".piece.unseen"), whitened) >= 4.5
