"""Settings that are gone: what each was, the version that removed it, and what to use instead."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

_FITTED_TOGETHER = "an assumption of the posterior, fitted together with the others, gone since 0.1.0; leave it out"
_OWN_HEAD_POSE = "gone since 0.1.0; leave it out, ADAS-0002 always runs the head-pose network of its training"
_DETECTORS_LANDMARKS = "gone since 0.1.0; leave it out, ADAS-0002 always takes the landmarks of the head detector"

REMOVED: Mapping[str, str] = {
    "attention.about_head_deg": _FITTED_TOGETHER,
    "attention.aside_deg": _FITTED_TOGETHER,
    "attention.below_deg": _FITTED_TOGETHER,
    "attention.bias_deg": _FITTED_TOGETHER,
    "attention.bias_s": _FITTED_TOGETHER,
    "attention.bias_share": _FITTED_TOGETHER,
    "attention.cues": "which cues the posterior uses, gone since 0.1.0; use gaze.model = 'none' or head_pose.model = "
    "'none' to leave one out",
    "attention.directions": "the number of rays to a target, gone since 0.1.0; leave it out, boxes need none",
    "attention.dwell_looks": _FITTED_TOGETHER,
    "attention.dwell_s": _FITTED_TOGETHER,
    "attention.evidence": _FITTED_TOGETHER,
    "attention.faces": "whether people are looked at in the face, gone since 0.1.0; leave it out, they are",
    "attention.facing_s": _FITTED_TOGETHER,
    "attention.frame_rate_hz": "the rate of frames without times, gone since 0.1.0; give frames their times, by "
    "rate_hz in the clip's manifest or by time_ns in Python",
    "attention.gain": "a fitted factor of the gaze's angle to the camera, gone since 0.1.0; leave it out, it is "
    "learned: 1, 0.8 or 0.6",
    "attention.head_evidence": _FITTED_TOGETHER,
    "attention.head_lag_s": _FITTED_TOGETHER,
    "attention.head_share": _FITTED_TOGETHER,
    "attention.nowhere_deg": _FITTED_TOGETHER,
    "attention.nowhere_looks": _FITTED_TOGETHER,
    "attention.occlusion": "whether a target hides those behind it, gone since 0.1.0; leave it out, no target hides "
    "another",
    "attention.p_nowhere": _FITTED_TOGETHER,
    "attention.rest_deg": _FITTED_TOGETHER,
    "attention.scale_spread": _FITTED_TOGETHER,
    "attention.smoothed_temperature": _FITTED_TOGETHER,
    "attention.smoothing=viterbi": "the likeliest sequence of targets, gone since 0.1.0; use 'both', which also knows "
    "later frames",
    "attention.surface": "what a target is, gone since 0.1.0; leave it out, it is its cloud, or its box where it has "
    "no cloud",
    "attention.tails": _FITTED_TOGETHER,
    "attention.temperature": _FITTED_TOGETHER,
    "attention.unbiased": _FITTED_TOGETHER,
    "bench=gaze_filter": "gone since 0.1.0; use `python -m scripts.measure gaze_filter` in a clone of the repository",
    "bench=memory": "gone since 0.1.0; use `python -m scripts.measure hours 1500 3000` in a clone of the repository",
    "bench=overhead": "gone since 0.1.0; use `python -m scripts.measure overhead` in a clone of the repository",
    "bench=posterior": "gone since 0.1.0; use `python -m scripts.measure posterior` in a clone of the repository",
    "bench=recording": "gone since 0.1.0; use `python -m scripts.measure recording_size` in a clone of the repository",
    "bench=segmenter": "masks of a segmenter beside the loop, gone since 0.1.0; use realtime",
    "drawn.depth_share": "the margin of depth about an object, gone since 0.1.0; leave it out, it is 5 %",
    "drawn.point_radius_px": "the radius of a drawn point, gone since 0.1.0; leave it out, it is 6 px, or draw a box",
    "drawn.size_share": "the margin of depth by a box's side, gone since 0.1.0; leave it out, it is a half, and draw a "
    "longer object as two targets",
    "gaze.eye_side": "the side of an eye crop, gone since 0.1.0; leave it out, it is 0.85 of the distance of the eyes",
    "gaze.head_pose": f"whose head pose ADAS-0002 gets, {_OWN_HEAD_POSE}",
    "gaze.landmarks": f"whose landmarks ADAS-0002 uses, {_DETECTORS_LANDMARKS}",
    "gaze.landmarks_weights": f"a network of landmarks, {_DETECTORS_LANDMARKS}",
    "gaze.most_turned_deg": "the turn of a head that has no gaze, gone since 0.1.0; leave it out, ADAS-0002's is 40 "
    "degrees, and only gaze.model = 'l2cs' has the setting",
    "head_pose.needs_face": "whether a head needs a face, gone since 0.1.0; leave it out, FSA-Net always needs one",
    "heads.fallback": "what finds people without a face, gone since 0.1.0; leave it out, their masks do",
    "heads.nms_iou": "the overlap of two faces, gone since 0.1.0; leave it out, it is 0.3",
    "preset=guided": "a guided search where objects and heads are, gone since 0.1.0; use 'realtime', or --set "
    "stereo.region=needed",
    "segmentation.delay": "the number of frames after which masks were used, gone since 0.1.0; use segmentation.every "
    "alone",
    "segmentation.nms_iou": "the overlap of two boxes, gone since 0.1.0; leave it out, it is 0.7",
    "stereo.counts_per_px": "the scale of disparity in 16-bit PNG files, gone since 0.1.0; use 256 counts per pixel, "
    "or pixels in .npy or .pfm files",
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
