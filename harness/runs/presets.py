"""Named bundles of settings. They stand over an experiment's defaults, and under what a configuration says itself.

A stage takes those of the settings that it has; the run's manifest holds what came of it, setting by setting.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from vfoa.errors import VfoaError, did_you_mean

PRESETS: dict[str, dict[str, dict[str, Any]]] = {
    "none": {},
    # half the disparities of a quarter of the pixels, where there is something to be looked at
    "realtime": {"stereo": {"resolution": "half", "region": "needed"}},
}


def preset_tables(name: str | None, where: str) -> Mapping[str, Mapping[str, Any]]:
    """The settings of a preset, by table; none without a name.

    Raises
    ------
    VfoaError
        If there is no such preset; ``where`` opens the message.
    """
    if name is None:
        return {}
    if not isinstance(name, str) or name not in PRESETS:
        raise VfoaError(f"{where}: preset: no {name!r}; {did_you_mean(str(name), PRESETS)}")
    return PRESETS[name]
