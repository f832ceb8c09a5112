"""The key and the colour of each name on the labelling page. A name keeps them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from itertools import product

from harness.clips.naming import HUES, PATTERNS, NameRule

DIGITS = "1234567890"
KEYS = (*DIGITS, *(f"shift+{digit}" for digit in DIGITS))
COLOURS = tuple(f"{hue} {pattern}" for hue, pattern in product(HUES, PATTERNS))


@dataclass(frozen=True, slots=True, kw_only=True)
class Look:
    """A key of :data:`KEYS`, None if all are taken, and a colour of :data:`COLOURS`."""

    key: str | None
    colour: str


def looks(rules: Mapping[str, NameRule]) -> dict[str, Look]:
    """Return the key and colour of every name.

    Names without a key or colour in the manifest get those of their place, or the next free ones.

    Parameters
    ----------
    rules
        The manifest's targets, then its subjects, which are targets as well.
    """
    places = dict(enumerate(rules))
    keys = _fill(places, {name: rule.key for name, rule in rules.items()}, _key_of_place, KEYS)
    colours = _fill(places, {name: rule.colour for name, rule in rules.items()}, _colour_of_place, _colours_in_order())
    return {
        name: Look(key=keys[name], colour=colours[name] or _colour_of_place(place)) for place, name in places.items()
    }


def _fill(
    places: Mapping[int, str],
    given: Mapping[str, str | None],
    of_place: Callable[[int], str | None],
    choices: Iterable[str],
) -> dict[str, str | None]:
    """The given value, else the place's own, else the first free choice; None if nothing is free."""
    found = dict(given)
    for place, name in places.items():
        own = of_place(place)
        if found[name] is None and own not in found.values():
            found[name] = own
    free = iter([each for each in choices if each not in found.values()])
    return {name: value if value is not None else next(free, None) for name, value in found.items()}


def _key_of_place(place: int) -> str | None:
    return KEYS[place] if place < len(KEYS) else None


def _colour_of_place(place: int) -> str:
    """Colour of a place; twenty names in a row differ by colour and by pattern."""
    return f"{HUES[place % len(HUES)]} {PATTERNS[(place + place // 20) % len(PATTERNS)]}"


def _colours_in_order() -> list[str]:
    return [_colour_of_place(place) for place in range(len(COLOURS))]
