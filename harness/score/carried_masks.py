"""Notes on configurations that segment key frames only."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any


def said_of_carried_masks(configurations: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield a note for each distance and delay of key frames, with the configurations that have it."""
    names: dict[tuple[int, int], list[str]] = {}
    for name, configuration in configurations.items():
        segmentation = configuration.get("segmentation") or {}
        every, delay = segmentation.get("every", 1), segmentation.get("delay", 0)
        if every + delay > 1:
            names.setdefault((every, delay), []).append(name)
    for (every, delay), chosen in names.items():
        later = f" and used from {delay} frames later on" if delay else ""
        yield (
            f"{', '.join(chosen)}: masks are found once in {every} frames{later} (segmentation.every = {every}, "
            f"segmentation.delay = {delay}). Optical flow carries them to the frames between, so they are up to "
            f"{every + delay - 1} frames old; masks_from and masks_age_s in results.jsonl say which and how old."
        )
