"""A mixed-effects logistic regression of two configurations: the odds ratio of being right, with clips as a sample.

Clip, subject within clip and look are random effects. statsmodels fits it by variational Bayes; its maximum a
posteriori drives variances to zero and does not converge on such data. Priors: normal with standard deviation 3 on the
fixed effects, and 1 on the logarithms of the random effects' standard deviations. The approximation treats parameters
as independent, so that the interval is somewhat too narrow: use the permutation test to decide, the model to describe.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.score.intervals import LEAST_CLIPS
from harness.score.scored_frames import ScoredFrames
from harness.score.statistics import Codes
from vfoa.errors import VfoaError
from vfoa.types import Float

_Z = 1.959963984540054


@dataclass(frozen=True, slots=True, kw_only=True)
class OddsRatio:
    """The odds ratio of being right under the configuration against the reference.

    ``spreads`` are the standard deviations of the random effects of clips, subjects and looks, in log-odds. ``refusal``
    says why there is no model; all numbers are NaN then.
    """

    reference: str
    configuration: str
    ratio: float
    low: float
    high: float
    spreads: tuple[float, float, float]
    refusal: str | None = None


def odds_ratio(
    reference: str, configuration: str, first: Sequence[ScoredFrames], second: Sequence[ScoredFrames]
) -> OddsRatio:
    """Fit the model to the common frames of two configurations.

    Raises
    ------
    VfoaError
        If statsmodels is not installed.
    """
    right, is_second, effects = _design(first, second)
    refusal = _refusal(right, is_second, effects)
    if refusal is None:
        fit = _fit(right, is_second, effects)
        if fit is not None:
            mean, deviation, spreads = fit
            low, high = (math.exp(mean + sign * _Z * deviation) for sign in (-1, 1))
            return OddsRatio(
                reference=reference,
                configuration=configuration,
                ratio=math.exp(mean),
                low=low,
                high=high,
                spreads=spreads,
            )
        refusal = "the fit did not converge"
    nothing = (math.nan, math.nan, math.nan)
    return OddsRatio(
        reference=reference,
        configuration=configuration,
        ratio=math.nan,
        low=math.nan,
        high=math.nan,
        spreads=nothing,
        refusal=refusal,
    )


def _design(first: Sequence[ScoredFrames], second: Sequence[ScoredFrames]) -> tuple[Float, Float, tuple[Codes, ...]]:
    """Whether each frame is right (n,), its configuration (n,), and the codes (n,) of clip, subject and look."""
    others = {(each.clip, each.subject): dict(zip(each.frames, each.correct, strict=True)) for each in second}
    clips: dict[str, int] = {}
    subjects: dict[tuple[str, str], int] = {}
    looks: dict[tuple[str, str, int], int] = {}
    rows: list[tuple[int, int, int, int, int]] = []
    for each in first:
        known = others.get((each.clip, each.subject), {})
        for frame, look, was_right in zip(each.frames, each.looks, each.correct, strict=True):
            if frame in known:
                codes = (
                    clips.setdefault(each.clip, len(clips)),
                    subjects.setdefault((each.clip, each.subject), len(subjects)),
                    looks.setdefault((each.clip, each.subject, look), len(looks)),
                )
                rows += [(int(was_right), 0, *codes), (int(known[frame]), 1, *codes)]
    right, is_second, *effects = np.array(rows, dtype=np.intp).reshape(-1, 5).T
    return right.astype(np.float64), is_second.astype(np.float64), tuple(effects)


def _refusal(right: Float, is_second: Float, effects: tuple[Codes, ...]) -> str | None:
    clips = len(np.unique(effects[0]))
    if clips < LEAST_CLIPS:
        return f"{clips} clips; a random effect of clips needs at least {LEAST_CLIPS}"
    if right.max() > 1:
        return "several seeds; the model takes one"
    if any(right[is_second == which].std() == 0 for which in (0, 1)):
        return "a configuration is right in all frames or in none"
    return None


def _fit(
    right: Float, is_second: Float, effects: tuple[Codes, ...]
) -> tuple[float, float, tuple[float, float, float]] | None:
    """Mean and standard deviation of the log odds ratio, and the random effects' spreads; None without convergence."""
    try:
        from statsmodels.genmod.bayes_mixed_glm import BinomialBayesMixedGLM
    except ImportError:
        raise VfoaError('compare --model: needs statsmodels: pip install "vfoa[model]"') from None
    from scipy import sparse  # not at the top: `vfoa score` imports this module, and never fits a model

    n, places = len(right), np.arange(len(right))
    design = sparse.hstack([sparse.csr_matrix((np.ones(n), (places, codes))) for codes in effects]).tocsr()
    kinds = np.concatenate([np.full(codes.max() + 1, kind) for kind, codes in enumerate(effects)])
    model = BinomialBayesMixedGLM(right, np.stack([np.ones(n), is_second], axis=1), design, kinds, vcp_p=1, fe_p=3)
    zeros = np.zeros(2 + len(effects) + design.shape[1])
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        # statsmodels starts at random values; a fixed seed makes equal runs give equal numbers
        found = model.fit_vb(mean=zeros, sd=np.full(len(zeros), 0.5))
    mean, deviation = float(found.fe_mean[1]), float(found.fe_sd[1])
    if said or not math.isfinite(mean) or not math.isfinite(deviation):
        return None
    clip, subject, look = np.exp(found.vcp_mean).tolist()
    return mean, deviation, (clip, subject, look)
