from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from scripts.measure import posterior
from scripts.measure.posterior import Answers, measure_posterior, measure_true_claims, posterior_table


def test_the_calibration_error_is_that_of_the_bins() -> None:
    answers = Answers()
    answers.add(np.array([0.95, 0.95, 0.55]), np.array([True, False, True]))
    answers.add(np.array([0.55]), np.array([True]))
    assert answers.rate == 0.75
    assert answers.calibration_error == pytest.approx(0.5 * 0.45 + 0.5 * 0.45)


def test_a_row_for_each_cell_all_together_and_the_true_claims(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("scripts.measure.posterior.ERRORS_DEG", (11.0,))
    monkeypatch.setattr("scripts.measure.posterior.BIASES_DEG", (0.0, 25.0))
    short = partial(posterior.draw_sequence, n_frames=60)
    monkeypatch.setattr(posterior, "draw_sequence", short)
    cells = measure_posterior(sequences=1)
    table = posterior_table("table", cells, measure_true_claims(sequences=1))
    assert len(table.rows) == 4
    assert all(cell.answers["forward"].rate > 0.3 for cell in cells)
