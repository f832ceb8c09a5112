"""Probable errors in a manifest: categories that no model has, names reserved for unnamed objects."""

from __future__ import annotations

import difflib
import re

from harness.clips.manifest import ClipManifest
from harness.sources import Clip, MeasuredClip
from vfoa.coco import STUFF, THINGS

_AUTOMATIC = re.compile(r".+#\d+")
_COCO = frozenset({*THINGS.values(), *STUFF.values()})


def manifest_problems(manifest: ClipManifest) -> list[str]:
    """Names that the program gives to unnamed objects."""
    automatic = [name for name in (*manifest.subjects, *manifest.targets) if _AUTOMATIC.fullmatch(name)]
    return [
        f"{name!r} is reserved for an object without a name (label#id); expected another name" for name in automatic
    ]


def manifest_notes(manifest: ClipManifest, clip: Clip) -> list[str]:
    """Categories that are similar to a word of COCO and occur nowhere in the clip's ground truth."""
    known = known_categories(clip)
    notes = []
    for table, rules in (("subjects", manifest.subjects), ("targets", manifest.targets)):
        for name, rule in rules.items():
            near = difflib.get_close_matches(rule.category, known, n=1, cutoff=0.75)
            if rule.category not in known and near:
                notes.append(
                    f"{table}.{name}: no model of COCO's categories knows {rule.category!r}; did you mean {near[0]!r}?"
                )
    return notes


def unknown_categories(manifest: ClipManifest) -> list[str]:
    """One note about all targets whose category is not in COCO."""
    unknown = [f"{name} ({rule.category})" for name, rule in manifest.targets.items() if rule.category not in _COCO]
    if not unknown:
        return []
    said = f"no model of COCO's categories knows {', '.join(unknown)}"
    return [f"{said}: take other masks, or draw: vfoa annotate {manifest.name}, key p"]


def known_categories(clip: Clip | MeasuredClip) -> frozenset[str]:
    """The categories of the segmentation models, which are COCO's, and those of the clip's ground truth, or its own."""
    if isinstance(clip, MeasuredClip):
        return frozenset(clip.categories.values())
    instances = clip.truth(clip.frames[0]).instances
    return _COCO | frozenset(each.label for each in instances.instances) if instances else _COCO
