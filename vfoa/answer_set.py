"""An answer as a set: the fewest objects that together are looked at with a given probability."""

from __future__ import annotations

from vfoa.types import Attention


def smallest_set(attention: Attention, probability: float = 0.9) -> tuple[int | None, ...]:
    """The instance ids with at least this probability together, likeliest first; None is nowhere.

    For attentions that are posteriors: nowhere has what the targets leave of 1. Among equals, targets come in their
    order and nowhere last. Empty where the attention is missing.
    """
    if attention.missing is not None:
        return ()
    totals: dict[int | None, float] = {value.instance_id: value.total for value in attention.values}
    totals[None] = max(0.0, 1.0 - sum(totals.values()))
    found: list[int | None] = []
    reached = 0.0
    for key in sorted(totals, key=lambda key: -totals[key]):
        found.append(key)
        reached += totals[key]
        if reached >= probability - 1e-9:
            break
    return tuple(found)
