"""Doubts about the data of a clip: axes or units of another program, and people who are too far away.

Labels that are mistaken are in :mod:`harness.score.mistaken_labels`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from harness.clips.axes import other_axes
from harness.run.directory import Pair
from harness.run.notes import Note, NoteKind
from harness.score.verdict_columns import PairVerdicts

USUAL_HEAD_M = (0.1, 0.45)
"""Widths of a head's box, or a face's: a median outside of it is probably due to the unit of the depth."""
SMALL_HEAD_PX = 60
"""Height of a head's box below which gaze networks fail (`python -m scripts.measure small_faces`)."""
COARSE_DEPTH_M = 0.25
"""Error of the depth of eyes by half a pixel of disparity above which it outweighs that of a gaze: at a thing that is a
metre away, it is 14 degrees."""
CUT_SHARE = 0.2
"""Share of heads at the image's border above which a note says so (`python -m scripts.measure cut_faces`)."""
HELD_SHARE = 0.1
"""Share of boxes or eyes at the depth of an earlier frame above which a matcher is said to miss them."""

Settings = Mapping[str, Any]
"""The settings of a configuration, as a run's manifest has them."""


def data_notes(judged: Mapping[Pair, PairVerdicts], settings: Mapping[str, Settings]) -> tuple[Note, ...]:
    """A note for each clip and doubt, under the first configuration that shows it; settings by configuration."""
    doubts: tuple[Callable[[PairVerdicts, Settings], str], ...] = (
        _other_axes,
        _other_unit,
        _small_heads,
        _cut_heads,
        _held_depth,
        _coarse_depth,
    )
    notes = []
    for doubt in doubts:
        texts: dict[str, str] = {}
        for (clip, configuration), part in judged.items():
            if clip not in texts and (text := doubt(part, settings.get(configuration, {}))):
                texts[clip] = f"{clip} under {configuration}: {text}."
        notes += [Note(text, NoteKind.DOUBT) for text in texts.values()]
    return tuple(notes)


def _other_axes(part: PairVerdicts, settings: Settings) -> str:
    """Directions that are in another program's axes; empty if they are not."""
    directions, to_targets = part.aims.swapaxes(0, 1)
    return str(other_axes(directions, to_targets) or "")


def _other_unit(part: PairVerdicts, settings: Settings) -> str:
    """Heads of no usual size in metres."""
    if not part.head_widths_m.size:
        return ""
    width_m = float(np.median(part.head_widths_m))
    if USUAL_HEAD_M[0] <= width_m <= USUAL_HEAD_M[1]:
        return ""
    return (
        f"heads are {width_m:.2g} m wide (median): is the unit of depth right? In [source], depth_scale is the number "
        "of counts per metre of measured depth, baseline_m (or calibration_unit) that of a pair"
    )


def _small_heads(part: PairVerdicts, settings: Settings) -> str:
    """Faces that are too small for the network that gives the gaze."""
    if not _looks_at_pixels(settings, "gaze", "model") or not part.head_heights_px.size:
        return ""
    height_px = float(np.median(part.head_heights_px))
    if height_px >= SMALL_HEAD_PX:
        return ""
    return (
        f"heads are {height_px:.0f} px high (median). Faces shrunk below {SMALL_HEAD_PX} px turn the gazes of networks "
        "by 10 to 30 degrees, and their head poses by 2 to 9: film nearer or with more pixels, or try the head alone "
        "(--set gaze.model=none)"
    )


def _cut_heads(part: PairVerdicts, settings: Settings) -> str:
    """Heads of which networks see a part."""
    is_seen = any(_looks_at_pixels(settings, table, "model") for table in ("gaze", "head_pose"))
    if not is_seen or part.cut_heads <= CUT_SHARE:
        return ""
    return (
        f"the image's border cuts {100 * part.cut_heads:.0f} % of the heads. A fifth to two fifths of a face cut off "
        "turn gazes by 6 to 18 degrees and head poses by 6 to 14: film so that heads are whole"
    )


def _coarse_depth(part: PairVerdicts, settings: Settings) -> str:
    """Eyes that are too far away for the stereo pair."""
    if not _looks_at_pixels(settings, "stereo", "matcher") or not part.depths_m.size:
        return ""
    depth_m, step_m = np.median(part.depths_m, axis=0)
    if step_m / 2 <= COARSE_DEPTH_M:
        return ""
    return (
        f"eyes are {depth_m:.1f} m away (median), where half a pixel of disparity is {step_m / 2:.2f} m: film nearer, "
        "with more pixels, or with cameras that are further apart"
    )


def _held_depth(part: PairVerdicts, settings: Settings) -> str:
    """Objects or eyes without a depth in many frames."""
    shares = {"3D boxes": part.held_boxes, "eyes": part.held_eyes}
    missed = [f"{100 * share:.0f} % of the {name}" for name, share in shares.items() if share > HELD_SHARE]
    if not missed:
        return ""
    return (
        f"{' and '.join(missed)} are where an earlier frame measured them (depth_from in the tables), since their own "
        "frame has too little depth: rates hide it while people and objects rest; another matcher may find more"
    )


_WITHOUT_PIXELS = ("none", "truth", "simulated", "files", "sensor")
"""Stages that answer from something else than the images."""


def _looks_at_pixels(settings: Settings, table: str, key: str) -> bool:
    return (settings.get(table) or {}).get(key, "none") not in _WITHOUT_PIXELS
