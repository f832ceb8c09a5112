"""Methods of attention: what a class must have to be one, the names of those that there are, and what several share."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol, Self, TypeVar

from vfoa.registry import Registry
from vfoa.settings import Settings
from vfoa.types import Attention, Box3D, FrameResult, Scene, Subject, Target, TargetAttention

State = TypeVar("State")


class MethodSettings(Settings):
    """Base class of the settings of every method."""

    method: str
    """The name of the method, as in :data:`METHODS`."""

    @property
    def is_unfitted(self) -> bool:
        """Whether weights are still to be fitted to the labels of an experiment's other clips."""
        return False

    @property
    def cloud_points(self) -> int:
        """Points of each target's cloud that the method uses, evenly chosen (:func:`vfoa.visible.spaced`); 0: none."""
        return 0

    @property
    def expectation(self) -> str:
        """What to expect of these weights on other clips: a sentence, empty where nothing is known."""
        return ""

    def for_clip(self, clip: str) -> Self:
        """Return the settings for one clip: a method may have weights of its own for it."""
        return self


class AttentionMethod(Protocol[State]):
    """Says how much each subject looks at each target. Built as ``Class(settings)``, with ``Class.Settings``.

    A method may have a state of each person, from one frame to the next: any value that is not changed in place. The
    caller keeps it under the person's name, or with the track of a person without a name until the track ends.
    """

    @property
    def probabilistic(self) -> bool:
        """Whether the totals are probabilities; "nowhere" has the rest up to 1."""
        ...

    @property
    def says_nowhere(self) -> bool:
        """Whether no focus is the answer "nowhere"; otherwise it is no answer."""
        ...

    def start(self) -> State:
        """Return the state of a person before the first frame."""
        ...

    def attend(
        self, subjects: tuple[Subject, ...], scene: Scene, states: tuple[State, ...]
    ) -> tuple[tuple[Attention, ...], tuple[State, ...]]:
        """Return the attention of each subject in a frame, and the state of each after it.

        ``states`` are those before it. All are in the order of the subjects; frames come in the order of time.
        """
        ...


class FramesMethod(AttentionMethod[None], Protocol):
    """A method without states that answers many frames faster together than one after the other."""

    def attend_frames(self, frames: Sequence[tuple[tuple[Subject, ...], Scene]]) -> list[tuple[Attention, ...]]:
        """Return what :meth:`attend` returns for the subjects of each scene, without the states."""
        ...


class RevisingMethod(AttentionMethod[State], Protocol[State]):
    """A method that can revise its answers when it knows later frames."""

    @property
    def look_ahead_s(self) -> float:
        """Seconds of later frames that a frame's answer needs; 0: none, and nothing is revised."""
        ...

    def revise(self, window: Sequence[FrameResult], count: int) -> list[FrameResult]:
        """Return the first ``count`` frames of a window in their order, with the attention given the whole window."""
        ...


METHODS = Registry(
    kind="attention.method",
    builtin={
        "cones": "vfoa.cones:Cones",
        "bayes": "vfoa.bayes:Posterior",
        "logit": "vfoa.logit:Logit",
        "nearest": "vfoa.nearest:Nearest",
    },
    group="vfoa.attention",
)
DEFAULT_METHOD = "cones"
"""The method where none is named."""


def open_method(settings: MethodSettings) -> AttentionMethod[Any]:
    """Return the method that these settings name."""
    method: AttentionMethod[Any] = METHODS.load(settings.method)(settings)
    return method


def look_ahead_s(method: AttentionMethod[Any]) -> float:
    """Return the seconds of later frames that an answer of a method needs; 0 for one that never revises."""
    seconds: float = getattr(method, "look_ahead_s", 0.0)
    return seconds


def boxes_of_others(subject: Subject, targets: tuple[Target, ...]) -> dict[int, Box3D]:
    """Return the boxes of the targets by instance id, in the order of the targets, without the subject's own box."""
    own = subject.person.instance_id
    return {
        target.instance.id: target.box for target in targets if target.box is not None and target.instance.id != own
    }


def answer_of(
    subject: Subject,
    totals: Mapping[int, float],
    nowhere: float,
    shares: tuple[float, float],
    names: Mapping[int, str],
    **details: Any,
) -> Attention:
    """Return the attention with these probabilities by instance id.

    The focus is the first that is :func:`likeliest`. ``shares`` are those of gaze and head in each total, NaN for a cue
    that was not measured; ``details`` are other fields of the attention.
    """
    by_gaze, by_head = shares
    values = tuple(
        TargetAttention(instance_id=number, gaze=by_gaze * total, head=by_head * total, total=total)
        for number, total in totals.items()
    )
    first = likeliest(totals, nowhere, names)
    return Attention(subject=subject, values=values, focus=next(iter(first), None), tied=tuple(first[1:]), **details)


def likeliest(totals: Mapping[int, float], nowhere: float, names: Mapping[int, str]) -> list[int]:
    """Return the likeliest targets of the likeliest name; none where ``nowhere`` is as likely as it.

    A label says that one of three cups is looked at, not which. ``totals`` are the targets' probabilities by instance
    id, ``names`` are as in :attr:`vfoa.types.Scene.names`: a target without one counts alone.
    """
    named = {number: names.get(number, number) for number in totals}
    of_name = dict.fromkeys(named.values(), 0.0)
    for number, total in totals.items():
        of_name[named[number]] += total
    ranks = {number: (of_name[named[number]], total) for number, total in totals.items()}
    best = max(ranks.values(), default=(0.0, 0.0))
    return [number for number, rank in ranks.items() if rank == best and best[0] > nowhere]


def person_key(subject: Subject) -> int | str:
    """What a person is remembered by: the name, which outlives tracks, or else the track."""
    return subject.track_id if subject.name is None else subject.name


def revised(
    window: Sequence[FrameResult],
    count: int,
    kind: type,
    of_person: Callable[[list[tuple[FrameResult, Attention]]], Iterator[Attention]],
) -> list[FrameResult]:
    """Return the first ``count`` frames of a window with the attentions that have a ``belief`` of a kind revised.

    ``of_person`` yields them from the attentions of a person in the whole window, in order; those of later frames are
    not asked for.
    """
    people: dict[int | str, list[tuple[FrameResult, Attention]]] = {}
    for frame in window:
        for attention in frame.attentions:
            if isinstance(attention.belief, kind):
                people.setdefault(person_key(attention.subject), []).append((frame, attention))
    later = {key: of_person(frames) for key, frames in people.items()}
    return [
        replace(
            frame,
            attentions=tuple(
                next(later[person_key(attention.subject)]) if isinstance(attention.belief, kind) else attention
                for attention in frame.attentions
            ),
        )
        for frame in window[:count]
    ]
