"""Recordings: every stage of every frame, written for the Rerun viewer in layers that the viewer merges.

``layers.py`` lists the files of a clip. ``recorder.py`` is the sink of a run's frames; ``images.py`` and
``frame_content.py`` log its layers, ``layer_file.py`` writes them. ``verdict_layer.py`` writes the layer of the
verdicts after each scoring. ``composed.py`` combines the layers, ``blueprint.py`` lays them out, ``viewer.py`` opens
them. This file does not import Rerun, so that runs without recordings start faster.
"""

from __future__ import annotations

import os

# if the disk is full, Rerun and the AV1 encoder would print more beside our line; they read these variables when
# imported
os.environ.setdefault("RUST_LOG", "warn,re_log_encoding=off,re_sdk=off")
os.environ.setdefault("SVT_LOG", "0")
# Rerun's allocator, mimalloc, gives freed memory back late, when the thread allocates again. The threads of a recording
# wait long between two sendings: each would keep the memory of its largest one
os.environ.setdefault("MIMALLOC_PURGE_DELAY", "0")
