"""Numbers of examples for slow properties."""

from __future__ import annotations

from hypothesis import settings

few = settings(max_examples=settings.default.max_examples // 4)
"""For a property whose example takes a tenth of a second or more."""
