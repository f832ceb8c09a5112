"""An experiment whose stages answer from what a person drew on a clip."""

from __future__ import annotations

CLIP = "studio_talk"
DRAWN = f"""
clips = ["{CLIP}"]
[[configuration]]
name = "drawn"
stereo = {{ matcher = "bm", min_depth_m = 0.8, wls = false, region = "needed" }}
segmentation.model = "drawn"
heads.detector = "drawn"
head_pose.model = "truth"
gaze.model = "truth"
"""
