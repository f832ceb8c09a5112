"""Settings that are gone: what each was, the version that removed it, and what to use instead."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

_OWN_HEAD_POSE = "gone since 0.1.0; leave it out, ADAS-0002 always runs the head-pose network of its training"
_DETECTORS_LANDMARKS = "gone since 0.1.0; leave it out, ADAS-0002 always takes the landmarks of the head detector"

REMOVED: Mapping[str, str] = {
    "attention.cues": "which cues the posterior uses, gone since 0.1.0; use gaze.model = 'none' or head_pose.model = "
    "'none' to leave one out",
    "attention.gain": "a fitted factor of the gaze's angle to the camera, gone since 0.1.0; leave it out, it is "
    "learned: 1, 0.8 or 0.6",
    "attention.occlusion": "whether a target hides those behind it, gone since 0.1.0; leave it out, no target hides "
    "another",
    "attention.smoothing=viterbi": "the likeliest sequence of targets, gone since 0.1.0; use 'both', which also knows "
    "later frames",
    "bench=gaze_filter": "gone since 0.1.0; use `python -m scripts.measure gaze_filter` in a clone of the repository",
    "bench=memory": "gone since 0.1.0; use `python -m scripts.measure hours 1500 3000` in a clone of the repository",
    "bench=overhead": "gone since 0.1.0; use `python -m scripts.measure overhead` in a clone of the repository",
    "bench=posterior": "gone since 0.1.0; use `python -m scripts.measure posterior` in a clone of the repository",
    "bench=recording": "gone since 0.1.0; use `python -m scripts.measure recording_size` in a clone of the repository",
    "bench=segmenter": "masks of a segmenter beside the loop, gone since 0.1.0; use realtime",
    "gaze.head_pose": f"whose head pose ADAS-0002 gets, {_OWN_HEAD_POSE}",
    "gaze.landmarks": f"whose landmarks ADAS-0002 uses, {_DETECTORS_LANDMARKS}",
    "gaze.landmarks_weights": f"a network of landmarks, {_DETECTORS_LANDMARKS}",
    "head_pose.needs_face": "whether a head needs a face, gone since 0.1.0; leave it out, FSA-Net always needs one",
    "heads.fallback": "what finds people without a face, gone since 0.1.0; leave it out, their masks do",
    "preset=guided": "a guided search where objects and heads are, gone since 0.1.0; use 'realtime', or --set "
    "stereo.region=needed",
    "segmentation.delay": "the number of frames after which masks were used, gone since 0.1.0; use segmentation.every "
    "alone",
    "stereo.guided_uniqueness_percent": "a limit of the guided search, gone since 0.1.0; use stereo.uniqueness_percent",
    "stereo.search": "every search is full, 'guided' is gone since 0.1.0; use stereo.resolution = 'half' or "
    "stereo.region = 'needed' to save time",
}
"""A sentence by ``table.key``, or by ``table.key=value`` where only that value is gone."""


def removed(keys: Iterable[object], value: object) -> str | None:
    """What a setting was and what to use instead; None for a setting that never existed.

    ``keys`` are the table, any tables inside it, and the key.
    """
    path = [str(key) for key in keys]
    setting = ".".join(dict.fromkeys((path[0], path[-1])))
    return REMOVED.get(setting) or REMOVED.get(f"{setting}={value}")
