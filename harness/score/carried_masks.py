"""Notes on configurations that segment key frames only."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any


def said_of_carried_masks(configurations: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield a note for each distance of key frames above 1, with the configurations that have it."""
    names: dict[int, list[str]] = {}
    for name, configuration in configurations.items():
        every = (configuration.get("segmentation") or {}).get("every", 1)
        if every > 1:
            names.setdefault(every, []).append(name)
    for every, chosen in names.items():
        yield (
            f"{', '.join(chosen)}: masks are found once in {every} frames and carried to the frames between by optical "
            f"flow (segmentation.every = {every}); masks_from in results.jsonl says which."
        )
