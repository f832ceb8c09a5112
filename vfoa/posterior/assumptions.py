"""What several parts of the posterior assume. These numbers and those of the parts were fitted together.

Changing one alone is no experiment, so that none is a setting. Angles are mean angles in degrees.
"""

from __future__ import annotations

from typing import Literal

Error = Literal["unknown", "told"]
"""``unknown``: the claimed error is a prior; scale, bias and gain are learned. ``told``: it is true."""

BIAS_SHARE = 0.35
"""Share of the variance of the error that drifts; the rest is new in each frame."""
TAILS = 4.0
"""Degrees of freedom of the Student distribution of the errors."""
ASIDE_DEG = 5.0
"""Offset from its share of the way at which the head stops; new in each look."""
REST_DEG = 20.0
"""Constant offset of a person's head from where the body faces."""
NOWHERE_DEG = 35.0
"""Angle between where the body faces and a head that looks at no target."""
