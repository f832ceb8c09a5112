"""The WLS filter gives the same map whatever the number of threads is."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from vfoa.stereo.block_matching import WlsFilter

HEIGHT, WIDTH, DISPARITY = 241, 323, 320


def wavy_map(rng: np.random.Generator):
    """Disparities (H, W) in sixteenths of a noisy surface, and a smooth guide, in which roundings are close calls."""
    guide = cv2.GaussianBlur(rng.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8), (0, 0), 3)
    waves = 100 * np.sin(np.arange(WIDTH) / 40) + 40 * np.cos(np.arange(HEIGHT)[:, None] / 30)
    return (DISPARITY + waves + rng.normal(0, 4, (HEIGHT, WIDTH))).astype(np.int16), guide


@pytest.mark.parametrize("seed", range(1, 5))
def test_the_number_of_threads_changes_no_pixel(seed):
    left, guide = wavy_map(np.random.default_rng(seed))
    right = np.full((HEIGHT, WIDTH), -DISPARITY, np.int16)
    wls = WlsFilter(smoothness=8000, sigma_color=1.5, discontinuity_radius_px=3)
    before = cv2.getNumThreads()
    try:
        found = []
        for threads in (1, 2, 3, 4, 7):
            cv2.setNumThreads(threads)
            found.append(wls.filter(left, right, guide))
            assert cv2.getNumThreads() == threads
    finally:
        cv2.setNumThreads(before)
    for filtered, confidence in found[1:]:
        np.testing.assert_array_equal(filtered, found[0][0])
        np.testing.assert_array_equal(confidence, found[0][1])
