"""Positions of heads and targets in the image, from a run's results or from the clip's ground truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from harness.clips.naming import NameRule
from harness.labels.bodies import Box, Point
from harness.run.records import FrameRecord
from harness.sources import AnyClip, Truth


@dataclass(frozen=True, slots=True, kw_only=True)
class RunBodies:
    """Positions from the results of one configuration: its head boxes, and the boxes of named targets."""

    records: Mapping[int, FrameRecord]

    def head_box(self, frame: int, subject: str) -> Box | None:
        """The head box with the subject's name."""
        people = self.records[frame].subjects if frame in self.records else ()
        return next((each.head_box_px for each in people if each.name == subject), None)

    def target_at(self, frame: int, point_px: Point, but: str) -> str | None:
        """The name of the smallest box that holds the point: nearer objects usually have smaller boxes."""
        targets = self.records[frame].targets if frame in self.records else ()
        boxes = [(each.box_px, each) for each in targets if each.name != but and each.box_px is not None]
        holding = [(_area(box), each.instance_id, each.name) for box, each in boxes if _holds(box, point_px)]
        return min(holding)[2] if holding else None

    def point_of(self, frame: int, target: str) -> Point | None:
        """The middle of the target's box."""
        targets = self.records[frame].targets if frame in self.records else ()
        box = next((each.box_px for each in targets if each.name == target), None)
        return None if box is None else ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2)


@dataclass(slots=True, kw_only=True)
class TrueBodies:
    """Positions from the ground truth: people, and instances named by the manifest's rules on ids and categories."""

    clip: AnyClip
    rules: Mapping[str, NameRule]
    _last: tuple[int, Truth] | None = field(default=None)

    def head_box(self, frame: int, subject: str) -> Box | None:
        """The true head box."""
        for person in self._truth(frame).people or ():
            if person.name == subject:
                u0, v0, u1, v1 = (float(each) for each in person.head_box_px)
                return u0, v0, u1, v1
        return None

    def target_at(self, frame: int, point_px: Point, but: str) -> str | None:
        """The name of the instance whose mask holds the point."""
        instances = self._truth(frame).instances
        u, v = round(point_px[0]), round(point_px[1])
        if instances is None or not (0 <= v < instances.ids.shape[0] and 0 <= u < instances.ids.shape[1]):
            return None
        found = self._names(frame).get(int(instances.ids[v, u]))
        return None if found == but else found

    def point_of(self, frame: int, target: str) -> Point | None:
        """The pixel of the target's mask nearest to the mask's middle."""
        instances = self._truth(frame).instances
        ids = [key for key, name in self._names(frame).items() if name == target]
        if instances is None or not ids:
            return None
        pixels = np.argwhere(np.isin(instances.ids, ids))
        if not len(pixels):
            return None
        v, u = pixels[np.argmin(((pixels - pixels.mean(axis=0)) ** 2).sum(axis=1))]
        return float(u), float(v)

    def _names(self, frame: int) -> dict[int, str]:
        instances = self._truth(frame).instances
        names = {}
        for each in instances.instances if instances else ():
            exact = (name for name, rule in self.rules.items() if rule.instance == each.id)
            shared = (name for name, rule in self.rules.items() if rule.is_shared and rule.category == each.label)
            if name := next(exact, None) or next(shared, None):
                names[each.id] = name
        return names

    def _truth(self, frame: int) -> Truth:
        if self._last is None or self._last[0] != frame:
            self._last = frame, self.clip.truth(frame)
        return self._last[1]


def _holds(box: Box, point: Point) -> bool:
    return box[0] <= point[0] <= box[2] and box[1] <= point[1] <= box[3]


def _area(box: Box) -> float:
    return (box[2] - box[0]) * (box[3] - box[1])
