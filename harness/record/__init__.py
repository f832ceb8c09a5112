"""Recordings: every stage of every frame, written for the Rerun viewer in layers that the viewer merges.

``layers.py`` lists the files of a clip. ``recorder.py`` is the sink of a run's frames, ``sink.py`` opens it;
``images.py``, ``reconstruction.py`` and ``attention.py`` log its layers; ``verdict_layer.py`` writes the layer of the
verdicts after each scoring. ``composed.py`` puts the layers together again, ``blueprint.py`` lays them out,
``viewer.py`` opens them. This file does not import Rerun, so that a run without recordings does not pay for it.
"""

from __future__ import annotations

import os
from typing import Literal

# of a disk that is full, Rerun and the AV1 encoder would say more beside our line; they read this when they are loaded
os.environ.setdefault("RUST_LOG", "warn,re_log_encoding=off,re_sdk=off")
os.environ.setdefault("SVT_LOG", "0")

Size = Literal["light", "full"]
"""How much a recording holds: ``light`` is enough to understand a failure, ``full`` is everything, without loss."""
