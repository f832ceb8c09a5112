"""Several seeds of the simulated errors: a configuration repeated, once for each."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace

from harness.stages.configuration import Configuration
from harness.stages.slots import StageChoice
from vfoa.errors import VfoaError

_SEED = re.compile(r"\.seed\d+(?=\+|$)")


def repeated(configuration: Configuration, seeds: int, where: str) -> Iterator[Configuration]:
    """The configuration under this many seeds, its own and the next ones, named ``sgbm-two.seed1`` and so on.

    Stages without a seed are the same in all of them, so that what they find is computed once and shared.

    Raises
    ------
    VfoaError
        If no stage has a seed; ``where`` opens the message.
    """
    seeded = [choice for choice in configuration.choices.values() if choice is not None and _has_seed(choice)]
    if not seeded:
        raise VfoaError(
            f"{where}: seeds: found {seeds}, but configuration {configuration.name!r} has no simulated stage; expected "
            'gaze.model = "simulated" or head_pose.model = "simulated"'
        )
    for step in range(seeds):
        choices = {
            slot: _shifted(choice, step) if choice in seeded else choice
            for slot, choice in configuration.choices.items()
        }
        first = min(getattr(choice.settings, "seed") for choice in seeded)  # noqa: B009
        yield replace(configuration, name=f"{configuration.name}.seed{first + step}", choices=choices)


def base_of(name: str) -> str:
    """The configuration that this one repeats under another seed; its own name where it repeats none."""
    return _SEED.sub("", name)


def _has_seed(choice: StageChoice) -> bool:
    return "seed" in type(choice.settings).model_fields


def _shifted(choice: StageChoice | None, step: int) -> StageChoice | None:
    if choice is None:
        return None
    seed = getattr(choice.settings, "seed")  # noqa: B009
    return replace(choice, settings=choice.settings.model_copy(update={"seed": seed + step}))
