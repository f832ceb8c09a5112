"""The mixed-effects model against statsmodels' own formula, on runs drawn with known odds."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest
from statsmodels.genmod.bayes_mixed_glm import BinomialBayesMixedGLM

from harness.score.mixed_model import odds_ratio
from harness.score.scored_frames import ScoredFrames

LOG_ODDS = 0.8


def _run(seed: int, clips: int = 8, looks: int = 3, frames: int = 10) -> tuple[list[ScoredFrames], list[ScoredFrames]]:
    """Two configurations; the odds of the second are exp(0.8) times those of the first."""
    rng = np.random.default_rng(seed)
    found: tuple[list[ScoredFrames], list[ScoredFrames]] = ([], [])
    for clip in range(clips):
        ease = 0.5 + rng.normal(0, 0.6)
        for subject in ("anna", "ben"):
            of_look = np.repeat(ease + rng.normal(0, 0.5, looks), frames)
            for k, each in enumerate(found):
                right = rng.random(looks * frames) < 1 / (1 + np.exp(-(of_look + k * LOG_ODDS)))
                each.append(
                    ScoredFrames(
                        clip=f"clip {clip}",
                        subject=subject,
                        frames=tuple(range(looks * frames)),
                        looks=tuple(np.repeat(np.arange(looks), frames).tolist()),
                        truth=("cup",) * (looks * frames),
                        correct=tuple(right.astype(int).tolist()),
                    )
                )
    return found


def _frame(first: list[ScoredFrames], second: list[ScoredFrames]) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "right": right,
            "second": which,
            "clip": each.clip,
            "subject": f"{each.clip} {each.subject}",
            "look": f"{each.clip} {each.subject} {look}",
        }
        for which, run in enumerate((first, second))
        for each in run
        for look, right in zip(each.looks, each.correct, strict=True)
    )


@pytest.mark.parametrize("seed", [1, 2])
def test_the_odds_ratio_is_that_of_statsmodels_formula(seed: int) -> None:
    first, second = _run(seed)
    found = odds_ratio("a", "b", first, second)
    random = {name: f"0 + C({name})" for name in ("clip", "subject", "look")}
    model = BinomialBayesMixedGLM.from_formula("right ~ second", random, _frame(first, second), vcp_p=1, fe_p=3)
    size = 2 + 3 + model.exog_vc.shape[1]
    expected = model.fit_vb(mean=np.zeros(size), sd=np.full(size, 0.5))
    assert math.log(found.ratio) == pytest.approx(expected.fe_mean[1], abs=0.01)
    assert math.log(found.high / found.low) / (2 * 1.96) == pytest.approx(expected.fe_sd[1], rel=0.02)
    assert math.log(found.ratio) == pytest.approx(LOG_ODDS, abs=0.45)


def test_what_cannot_be_modelled_is_refused_with_the_reason() -> None:
    first, second = _run(3, clips=4)
    assert odds_ratio("a", "b", first, second).refusal == "4 clips; a random effect of clips needs at least 6"
    first, _ = _run(3, clips=6, looks=1, frames=2)
    perfect = [
        ScoredFrames(
            clip=each.clip,
            subject=each.subject,
            frames=each.frames,
            looks=each.looks,
            truth=each.truth,
            correct=(1,) * len(each.frames),
        )
        for each in first
    ]
    found = odds_ratio("a", "b", first, perfect)
    assert found.refusal == "a configuration is right in all frames or in none"
    assert math.isnan(found.ratio)
