"""vfoa: 3D Visual Focus of Attention: who looks at what, in metres. Functions take arrays and return frozen values.

The method is that of Simões and Moreno, "3D estimation of visual focus of attention from stereo", ICARSC 2022.

    import vfoa

    estimator = vfoa.Estimator.open()                                    # as `vfoa run CLIP`
    rig = vfoa.rectified_rig(left, fx_px=700, cx_px=640, cy_px=360, baseline_m=0.12)
    print(estimator.estimate(left, right, rig))                          # person 1 looks at cup#2 ...

Modules are imported when a name of theirs is first used. ONNX Runtime's usage statistics are switched off in this
process and its children, unless the environment sets ``ORT_DISABLE_TELEMETRY=0``.
"""

from __future__ import annotations

import os
from importlib import import_module
from typing import Any

os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")  # ONNX Runtime reads the variable when it is imported

__version__ = "0.1.0"

_HOMES = {
    "Estimate": "vfoa.estimate",
    "Estimator": "vfoa.estimator",
    "Follower": "vfoa.estimator",
    "Look": "vfoa.estimate",
    "MeasuredFollower": "vfoa.measured_follower",
    "Observed": "vfoa.measured",
    "Score": "vfoa.scoring",
    "Stages": "vfoa.pipeline",
    "StereoFrame": "vfoa.types",
    "StereoRig": "vfoa.types",
    "VfoaError": "vfoa.errors",
    "rectified_rig": "vfoa.estimator",
    "score": "vfoa.scoring",
}
"""The module of each public name; ``__init__.pyi`` tells type checkers the same."""

__all__ = [
    "Estimate",
    "Estimator",
    "Follower",
    "Look",
    "MeasuredFollower",
    "Observed",
    "Score",
    "Stages",
    "StereoFrame",
    "StereoRig",
    "VfoaError",
    "__version__",
    "rectified_rig",
    "score",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'vfoa' has no attribute {name!r}")
    return getattr(import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOMES})
