"""The smallest set of targets that a subject looks at with at least a given probability."""

from __future__ import annotations

from vfoa.types import Attention


def smallest_set(attention: Attention, probability: float = 0.9) -> tuple[int | None, ...]:
    """Return the instance ids that together have at least this probability, likeliest first; None stands for nowhere.

    For attention values that are probabilities: nowhere has the rest up to 1. Among equal probabilities, targets keep
    their order and nowhere comes last. The result is empty where the attention is missing.
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
