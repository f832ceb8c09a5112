"""Why the wrong frames are wrong, and what to do next: sentences that stand under a focus recognition rate."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

from harness.score.verdicts import ERROR_TYPES, Verdict

NEXT_STEPS = {
    "no_subject": (
        "see which heads were found (vfoa view RUN --failures); check the subject's rule in the manifest "
        "([subjects.NAME]), or take another head detector (--set heads.detector=person_mask)"
    ),
    "no_eyes_3d": (
        "the head has no depth: check stereo.min_depth_m and the calibration (vfoa clips check CLIP), or another "
        "matcher (--set stereo.matcher=bm)"
    ),
    "no_direction": (
        "gaze and head models gave nothing: look at the head boxes (vfoa view RUN --failures), or score coverage apart"
    ),
    "target_not_segmented": (
        "give the target a category that the model finds ([targets.NAME] in the manifest), take another model, or "
        "masks of your own (--set segmentation.model=coco_panoptic --set segmentation.root=FOLDER)"
    ),
    "target_without_box": (
        "the target has no depth: check stereo.min_depth_m (vfoa clips check CLIP), or another matcher "
        "(--set stereo.matcher=bm)"
    ),
    "false_attention": (
        "narrower cones (--set attention.cones_deg=[20]), or the posterior, which knows of nowhere "
        "(--set attention.method=bayes)"
    ),
    "wrong_subject": (
        "tell people apart by at_px or box_px in the manifest ([subjects.NAME]), and see the tracks (vfoa view RUN)"
    ),
    "no_hit": (
        "no ray met any object: wider cones (--set attention.cones_deg=[40]), or the posterior, which always has an "
        "answer (--set attention.method=bayes)"
    ),
    "missed": (
        "no ray met the target: see by how much gaze and head are off (vfoa view RUN --failures); wider cones "
        "(--set attention.cones_deg=[40]) forgive more, and must be chosen on other clips"
    ),
    "outscored": (
        "another object got more attention: see which (vfoa view RUN --failures), and which stage costs the frames "
        "(vfoa run CLIP --oracle)"
    ),
}
"""What to try for each error type, in the imperative and without a full stop."""

TOP = 2
"""How many error types are told."""


def next_steps(verdicts: Iterable[Verdict]) -> list[str]:
    """A sentence for each of the most frequent error types: how many wrong frames have it, its meaning, what to try.

    Empty where nothing is wrong. Frames of several configurations count each.
    """
    counts = Counter(each.error_type for each in verdicts if each.error_type is not None)
    wrong = sum(counts.values())
    order = list(ERROR_TYPES)
    top = sorted(counts.items(), key=lambda each: (-each[1], order.index(each[0])))
    return [
        f"{count} of {wrong} wrong frames: {name} ({ERROR_TYPES[name]}). Next: {NEXT_STEPS[name]}."
        for name, count in top[:TOP]
    ]
