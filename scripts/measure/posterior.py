"""Accuracy and calibration of attention on drawn scenes with errors of known size.

Scenes are those of ``simulated_scenes.py``. Settings were chosen on ``room``; ``table`` shares no distribution
with it and is reported. Every method gets a claimed gaze error of 11.1 degrees, whatever the true one is; "told" gets
the true mean error of a frame, and takes it as true. "All known" gets the same for the same sequence drawn without bias
and gain, and uses its later frames: the best that the model can reach if it has nothing to learn.
"""

from __future__ import annotations

import argparse
import copy
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from harness.report.formats import Table
from scripts.measure.printing import print_tables
from scripts.measure.simulated_scenes import NOWHERE, Errors, Generator, draw_sequence
from scripts.measure.simulated_scenes import Sequence as Drawn
from vfoa.geometry import angle_between, sigma_rad, unit
from vfoa.posterior.belief import Belief, MeasuredCues, Scenery
from vfoa.posterior.filter import answered, smoothed, update
from vfoa.posterior.grid import Error
from vfoa.types import Float

ERRORS_DEG = (5.0, 11.0, 20.0, 36.0)
BIASES_DEG = (0.0, 10.0, 25.0)
CLAIMED_DEG, HEAD_DEG = 11.1, 5.0
METHODS = ("nearest", "told", "forward", "both", "all known")
_BINS = 10


@dataclass(slots=True)
class Answers:
    """The answers of one method in all frames of a cell: confidences and whether each was right."""

    confidence: list[Float] = field(default_factory=list)
    right: list[np.ndarray] = field(default_factory=list)

    def add(self, confidence: Float, right: np.ndarray) -> None:
        """Add a sequence's frames (N,)."""
        self.confidence.append(confidence)
        self.right.append(right)

    @property
    def rate(self) -> float:
        """Share of right answers."""
        return float(np.concatenate(self.right).mean())

    @property
    def calibration_error(self) -> float:
        """Expected calibration error over ten equal bins of the confidence (Guo et al. 2017)."""
        confidence, right = np.concatenate(self.confidence), np.concatenate(self.right)
        bins = np.minimum((confidence * _BINS).astype(int), _BINS - 1)
        count = np.maximum(np.bincount(bins, minlength=_BINS), 1)
        gap = np.bincount(bins, confidence, _BINS) - np.bincount(bins, right, _BINS)
        return float((np.abs(gap / count) * np.bincount(bins, minlength=_BINS)).sum() / len(bins))


@dataclass(frozen=True, slots=True, kw_only=True)
class Cell:
    """One row: the errors of its sequences, and the answers of each method."""

    name: str
    answers: dict[str, Answers]


def measure_posterior(
    generator: Generator = "table",
    sequences: int = 16,
    *,
    first_seed: int = 0,
    gains: tuple[float, float] = (0.6, 1.0),
) -> list[Cell]:
    """Draw this many sequences for each error and bias, gains even between two limits, and measure every method."""
    cells = []
    for error_deg in ERRORS_DEG:
        for bias_deg in BIASES_DEG:
            drawn = []
            for seed in range(first_seed, first_seed + sequences):
                rng = np.random.default_rng([int(error_deg), int(bias_deg), seed])
                errors = Errors(gaze_deg=error_deg, bias_deg=bias_deg, gain=float(rng.uniform(*gains)))
                same = copy.deepcopy(rng)
                drawn.append(
                    (draw_sequence(generator, errors, rng), draw_sequence(generator, Errors(gaze_deg=error_deg), same))
                )
            cells.append(_measured_cell(f"{error_deg:g} deg, bias {bias_deg:g}", drawn, error_deg))
    return cells


def measure_true_claims(generator: Generator = "table", sequences: int = 12) -> Cell:
    """Measure sequences whose claimed 11.1 degrees are true, without bias and gain: the cost of not knowing this."""
    drawn = [draw_sequence(generator, Errors(gaze_deg=11.1), np.random.default_rng([7, k])) for k in range(sequences)]
    return _measured_cell("11.1 deg, as claimed", [(sequence, sequence) for sequence in drawn], 11.1)


def posterior_table(generator: str, cells: Sequence[Cell], true_claims: Cell) -> Table:
    """Rate and calibration error of each method in each cell, and over all cells together."""
    pooled = Cell(
        name="all together",
        answers={method: _joined(cell.answers[method] for cell in cells) for method in METHODS},
    )
    rows = tuple(
        (
            cell.name,
            f"{100 * cell.answers['nearest'].rate:.0f}",
            *(_entry(cell.answers[method]) for method in METHODS[1:]),
        )
        for cell in (*cells, pooled, true_claims)
    )
    return Table(
        title=f"Attention on drawn scenes ({generator}), FRR % / calibration error",
        columns=("Error and bias", "Nearest", "Told", "Forward", "Both", "All known"),
        rows=rows,
        words=0,
        notes=(
            "Gains between 0.6 and 1, 0 to 40 % of looks at nothing. Claimed are 11.1 deg; 'told' takes the true mean "
            "error of a frame as true, and knows of no bias and no gain. 'both' knows the whole sequence. 'all known' "
            "is 'both', told the true error, of the same sequence without bias and gain.",
        ),
    )


def _entry(answers: Answers) -> str:
    return f"{100 * answers.rate:.0f} / {answers.calibration_error:.2f}"


def _joined(many: Iterable[Answers]) -> Answers:
    joined = Answers()
    for answers in many:
        joined.confidence += answers.confidence
        joined.right += answers.right
    return joined


def _measured_cell(name: str, drawn: Sequence[tuple[Drawn, Drawn]], error_deg: float) -> Cell:
    """One row of pairs: a sequence, and the same without bias and gain."""
    answers = {method: Answers() for method in METHODS}
    for sequence, unbiased in drawn:
        truth = np.where(sequence.label == NOWHERE, len(sequence.objects), sequence.label)
        answers["nearest"].add(np.ones(len(truth)), _nearest(sequence) == truth)
        answers["told"].add(*_judged(_answers(_beliefs(sequence, "told", error_deg), "told"), truth))
        beliefs = _beliefs(sequence, "unknown", CLAIMED_DEG)
        answers["forward"].add(*_judged(_answers(beliefs, "unknown"), truth))
        both = [answered(*pair, "unknown", later_known=True) for pair in zip(beliefs, smoothed(beliefs), strict=True)]
        answers["both"].add(*_judged(both, truth))
        known = smoothed(_beliefs(unbiased, "told", error_deg))
        answers["all known"].add(*_judged(known, truth))
    return Cell(name=name, answers=answers)


def _judged(probabilities: Sequence[Float], truth: np.ndarray) -> tuple[Float, np.ndarray]:
    table = np.array(probabilities)
    return table.max(axis=1), table.argmax(axis=1) == truth


def _answers(beliefs: Sequence[Belief], error: Error) -> list[Float]:
    return [answered(belief, belief.probabilities, error) for belief in beliefs]


def _nearest(drawn: Drawn, gaze_share: float = 0.6) -> np.ndarray:
    """The row (N,) of the object nearest in angle to the mean of gaze and head."""
    directions = unit(gaze_share * drawn.gaze + (1 - gaze_share) * drawn.head)
    towards = drawn.objects - drawn.eyes
    return np.asarray(angle_between(directions[:, None], towards[None]).argmin(axis=1))


def _beliefs(drawn: Drawn, error: Error, claimed_deg: float) -> list[Belief]:
    towards = drawn.objects - drawn.eyes
    distance = np.linalg.norm(towards, axis=1)
    scenery = Scenery(
        keys=(*range(len(towards)), None),
        directions=towards / distance[:, None],
        variances=(drawn.radii_m / distance) ** 2 / 4,
        to_camera=unit(-drawn.eyes),
    )
    claims = MeasuredCues(
        gaze=None, head=None, gaze_sigma_rad=sigma_rad(claimed_deg), head_sigma_rad=sigma_rad(HEAD_DEG)
    )
    beliefs: list[Belief] = []
    dt_s = float(drawn.time_s[1] - drawn.time_s[0])
    for gaze, head in zip(drawn.gaze, drawn.head, strict=True):
        before = beliefs[-1] if beliefs else None
        beliefs.append(update(before, scenery, replace(claims, gaze=gaze, head=head), dt_s, error))
    return beliefs


def main() -> None:
    """Measure and print the table."""
    argparse.ArgumentParser(description="Measure the posterior on drawn scenes.").parse_args()
    print_tables(posterior_table("table", measure_posterior(), measure_true_claims()))
