"""How many examples a slow property is tried on."""

from __future__ import annotations

from hypothesis import settings

few = settings(max_examples=settings.default.max_examples // 5)
"""For a property that takes a tenth of a second or more to try."""
