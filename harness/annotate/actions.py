"""A person's actions on the page, and the marks that they set: until the next change, in a range, notes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

from pydantic import Field

from harness.annotate.drawing_store import Draw
from harness.annotate.marks import Mark, Stretch, SubjectMarks, counts, joined, looked_at, stretch_at, stretches
from harness.labels.rows import parse_tags
from vfoa.settings import Settings


class Action(Settings):
    """A person's action; ``kind`` decides which of the other values are needed. ``draw`` is one on the image.

    An action that is sent again under the same ``id``, because its answer was lost, is not made twice.
    """

    kind: Literal[
        "look", "range", "clear", "nudge", "move", "accept", "confirm", "note", "seen", "draw", "undo", "redo"
    ]
    id: str = Field(default="", max_length=64)
    subject: str = ""
    at: int = 0
    last: int = 0
    by: int = 0
    target: str | None = None
    point_px: tuple[float, float] | None = None
    attention: float = 1.0
    note: str = ""
    tags: str | None = None
    draw: Draw = Field(default_factory=Draw)


def edited(
    action: Action, track: Sequence[Mark | None], suggested: Sequence[tuple[str, float] | None] | None, seen: int
) -> list[Stretch]:
    """The new marks of a subject after an action on its labels; none if nothing changes.

    ``suggested`` has a target and the attention to it for each frame; the frames up to ``seen`` were seen.
    """
    at = action.at
    match action.kind:
        case "look":
            return look(track, at, action.target or "", action.point_px)
        case "range":
            return mark_range(track, at, action.last, action.target)
        case "clear":
            return clear(track, at)
        case "nudge":
            return move_change(track, at, stretch_at(track, at, looked_at)[0] + action.by)
        case "move":
            return move_change(track, at, action.last)
        case "accept":
            if not suggested:
                return []
            accepted = [answer[0] if answer and answer[1] >= action.attention else None for answer in suggested]
            return accept(track, accepted, seen)
        case "confirm":
            return confirm(track, at)
        case "note":
            return annotate(track, at, action.note, None if action.tags is None else parse_tags(action.tags, "label"))
        case "seen" | "draw" | "undo" | "redo":
            return []


def look(
    track: Sequence[Mark | None], at: int, target: str, point_px: tuple[float, float] | None = None
) -> list[Stretch]:
    """The subject looks at a target from a position on, until the mark changes.

    After the position the mark is carried on, except over frames that a person has labelled before. Frames keep their
    tags.
    """
    _, last = stretch_at(track, at, looked_at)
    mark = Mark(target=target, point_px=point_px)

    def carried_on(old: Mark | None) -> Mark:
        return replace(mark, tags=old.tags if old else (), carried=not _is_given(old))

    here = Stretch(first=at, last=at, mark=replace(carried_on(track[at]), carried=False))
    return joined([here, *changed(track, at + 1, last, carried_on)])


def changed(
    track: Sequence[Mark | None], first: int, last: int, new: Callable[[Mark | None], Mark | None]
) -> list[Stretch]:
    """The stretches between two positions with a new mark for each; none if the first position comes after the last."""
    if first > last:
        return []
    return joined(replace(part, mark=new(part.mark)) for part in stretches(track, first, last))


def mark_range(track: Sequence[Mark | None], first: int, last: int, target: str | None) -> list[Stretch]:
    """The subject looks at a target from one position to another; None removes the labels.

    Frames that were labelled keep their note and tags.
    """
    plain = None if target is None else Mark(target=target)
    if plain is None or not 0 <= first <= last < len(track):  # the store refuses such positions
        return [Stretch(first=first, last=last, mark=plain)]
    return changed(track, first, last, lambda old: replace(plain, note=old.note, tags=old.tags) if old else plain)


def clear(track: Sequence[Mark | None], at: int) -> list[Stretch]:
    """Remove the labels from a position until the target changes."""
    return mark_range(track, at, stretch_at(track, at, looked_at)[1], None)


def move_change(track: Sequence[Mark | None], at: int, to: int) -> list[Stretch]:
    """Move the change of target at or before ``at`` to the position ``to``; not past the next change before or after.

    Suggestions do not move.
    """
    change, last = stretch_at(track, at, looked_at)
    if change == 0 or any(mark is not None and mark.is_suggested for mark in (track[change - 1], track[change])):
        return []
    first, _ = stretch_at(track, change - 1, looked_at)
    to = min(max(to, first), last)
    if to == change:
        return []
    mark = track[change] if to < change else track[change - 1]
    low, high = (to, change - 1) if to < change else (change, to - 1)
    return [Stretch(first=low, last=high, mark=mark and replace(mark, carried=False))]


def accept(track: Sequence[Mark | None], suggested: Sequence[str | None], seen: int) -> list[Stretch]:
    """Fill unlabelled frames with suggestions, one per frame or None; they stay suggestions.

    Frames after the last one that was ``seen``, to which a mark was only carried on, count as unlabelled, too.
    """
    filled: SubjectMarks = [
        mark if target is None or counts(mark, at, seen) else Mark(target=target, is_suggested=True)
        for at, (mark, target) in enumerate(zip(track, suggested, strict=True))
    ]
    return _differing(track, filled)


def confirm(track: Sequence[Mark | None], at: int) -> list[Stretch]:
    """Confirm the suggestions at and around a position that have its target; they keep their notes."""
    first, last = stretch_at(track, at, looked_at)
    if (here := track[at]) is None or not here.is_suggested:
        return []
    return changed(track, first, last, lambda mark: mark and replace(mark, is_suggested=False))


def annotate(track: Sequence[Mark | None], at: int, note: str, tags: tuple[str, ...] | None = None) -> list[Stretch]:
    """Put a note and tags on the label at a position: the frames around it with the same mark. None keeps the tags."""
    if track[at] is None:
        return []
    first, last = stretch_at(track, at, lambda mark: mark and replace(mark, carried=False, point_px=None))
    return changed(
        track, first, last, lambda mark: mark and replace(mark, note=note, tags=mark.tags if tags is None else tags)
    )


def _is_given(mark: Mark | None) -> bool:
    """Whether a person has labelled the frame itself."""
    return mark is not None and not mark.is_suggested and not mark.carried


def _differing(old: Sequence[Mark | None], new: Sequence[Mark | None]) -> list[Stretch]:
    """The new marks from the first to the last position in which two tracks differ."""
    where = [at for at in range(len(old)) if old[at] != new[at]]
    return list(stretches(new, where[0], where[-1])) if where else []
