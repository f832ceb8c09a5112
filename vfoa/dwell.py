"""How long a subject stays on a target: the transitions of a hidden Markov model, and its passes over whole clips.

In each frame a subject leaves with probability 1 / ``dwell_frames`` for any target of the prior, the same one included.
The forward pass happens frame by frame in :mod:`vfoa.bayes`. What comes after a frame can only be told from later
frames: :func:`revise` looks back from them, at the beliefs of the forward pass alone (Kim 1994).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from pydantic import Field

from vfoa.settings import Settings
from vfoa.types import Attention, Float, FrameResult, TargetAttention

Keys = tuple[int | None, ...]
Belief = Mapping[int | None, float]
"""Probability by instance id; None is nowhere."""

_Step = tuple[Keys, Float]
"""The targets of a frame, nowhere last, and their probabilities."""


class DwellSettings(Settings):
    """Settings of the prior and of its course over time.

    ``p_nowhere`` is the prior of looking at none of the targets; the targets share the rest evenly. ``smoothing``:
    every frame by itself; ``forward``, from the frames before; ``both``, from those after as well; ``viterbi``, the
    likeliest sequence, with the probabilities of ``both``. The last two wait for ``look_ahead_frames``.
    """

    p_nowhere: float = Field(default=0.1, gt=0, lt=1)
    smoothing: Literal["off", "forward", "both", "viterbi"] = "off"
    dwell_frames: float = Field(default=19.0, gt=1)
    look_ahead_frames: int = Field(default=25, ge=1, le=1000)

    @property
    def frames_awaited(self) -> int:
        """How many later frames a frame's answer needs."""
        return self.look_ahead_frames if self.smoothing in ("both", "viterbi") else 0


def prior(keys: Keys, settings: DwellSettings) -> Float:
    """Prior (T,) of looking at each of the keys, of which the last is nowhere."""
    count = len(keys) - 1
    if count == 0:
        return np.ones(1)
    return np.array([(1 - settings.p_nowhere) / count] * count + [settings.p_nowhere])


def transition(held: Belief, keys: Keys, settings: DwellSettings) -> tuple[Float, Float]:
    """What a belief predicts for the next frame: probabilities (T,), and which part (T,) of each has stayed.

    What was believed of targets that are gone is open again.
    """
    fresh = prior(keys, settings)
    leave = 1 / settings.dwell_frames
    stayed = (1 - leave) * np.array([held.get(key, 0.0) for key in keys])
    predicted = stayed + max(1 - stayed.sum(), 0.0) * fresh
    return predicted, stayed / predicted


def revise(window: Sequence[FrameResult], at: int, settings: DwellSettings) -> FrameResult:
    """The frame ``window[at]`` as the frames around it have it."""
    return replace(window[at], attentions=tuple(_revised(each, window, at, settings) for each in window[at].attentions))


def _revised(attention: Attention, window: Sequence[FrameResult], at: int, settings: DwellSettings) -> Attention:
    if attention.missing is not None:
        return attention
    track = attention.subject.track_id
    steps = [[_step(each) for each in frame.attentions if _is_of(each, track)] for frame in window]
    place = sum(len(found) for found in steps[:at])
    sequence = [step for found in steps for step in found]
    keys, smoothed = _backward(sequence[place:], settings)
    best = int(smoothed.argmax())
    if settings.smoothing == "viterbi":
        best = _likeliest(sequence, settings)[place]
    probability = dict(zip(keys, smoothed.tolist(), strict=True))
    values = tuple(_weighed(value, probability.get(value.instance_id, 0.0)) for value in attention.values)
    return replace(attention, values=values, focus=keys[best], tied=())


def _weighed(value: TargetAttention, total: float) -> TargetAttention:
    """A target's attention with another total, divided as before."""
    if value.total == 0:
        return value
    return replace(value, gaze=value.gaze * total / value.total, head=value.head * total / value.total, total=total)


def _is_of(attention: Attention, track: int) -> bool:
    return attention.subject.track_id == track and attention.missing is None


def _step(attention: Attention) -> _Step:
    """What was believed in a frame. A target without any probability was not seen: the prior had no share for it."""
    seen = [value for value in attention.values if value.total > 0]
    totals = [value.total for value in seen]
    return (*(value.instance_id for value in seen), None), np.array([*totals, max(1 - sum(totals), 0.0)])


def _backward(sequence: Sequence[_Step], settings: DwellSettings) -> _Step:
    """The first frame's probabilities, given all of the sequence."""
    later_keys, later = sequence[-1]
    leave = 1 / settings.dwell_frames
    for keys, filtered in reversed(sequence[:-1]):
        predicted, _ = transition(dict(zip(keys, filtered.tolist(), strict=True)), later_keys, settings)
        ratio = later / predicted
        anew = float(ratio @ prior(later_keys, settings))
        by_key = dict(zip(later_keys, ratio.tolist(), strict=True))
        smoothed = filtered * np.array([(1 - leave) * by_key.get(key, anew) + leave * anew for key in keys])
        later_keys, later = keys, smoothed / smoothed.sum()
    return later_keys, later


def _likeliest(sequence: Sequence[_Step], settings: DwellSettings) -> list[int]:
    """The columns of the likeliest sequence (Viterbi 1967); a frame's likelihoods are filtered over predicted."""
    leave = 1 / settings.dwell_frames
    keys, filtered = sequence[0]
    with np.errstate(divide="ignore"):
        score = np.log(filtered)
        back: list[Float] = []
        for later_keys, later in sequence[1:]:
            predicted, _ = transition(dict(zip(keys, filtered.tolist(), strict=True)), later_keys, settings)
            fresh = prior(later_keys, settings)
            # whoever looked at what is gone has left it for certain
            left = score + np.log([leave if key in later_keys else 1.0 for key in keys])
            best = int(left.argmax())
            columns = {key: column for column, key in enumerate(keys)}
            came = np.array([columns.get(key, best) for key in later_keys])
            jump = left[best] + np.log(fresh)
            stay = np.where(
                [key in columns for key in later_keys], score[came] + np.log(1 - leave + leave * fresh), -np.inf
            )
            back.append(np.where(stay >= jump, came, best))
            score = np.maximum(stay, jump) + np.log(later) - np.log(predicted)
            keys, filtered = later_keys, later
    path = [int(score.argmax())]
    for origins in reversed(back):
        path.append(int(origins[path[-1]]))
    return path[::-1]
