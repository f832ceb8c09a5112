"""Who looks at what without images: eyes, directions and boxes that something else measured.

A motion capture system, a headset or another program's head pose gives them; everything is in metres in one camera
frame, x to the right, y down and z forward. Where the origin is counts for the posterior and the logit alone: they
expect that a gaze is drawn towards the camera there, as a model's is that sees its image.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from numpy.typing import ArrayLike

from vfoa.config import METHOD_OF_CLIP, check_immediate, dotted_tables, read_steps
from vfoa.errors import VfoaError, reported_as
from vfoa.estimate import Look, looks_of
from vfoa.measured import HEAD_SIZE_M, PERSON, Observed, box_around, box_of, target_of
from vfoa.pipeline import Attending
from vfoa.scoring import IGNORED, NOWHERE
from vfoa.times import time_of_frame
from vfoa.tracking import Tracker
from vfoa.types import Box3D, Scene, Target


class MeasuredFollower:
    """Says in each frame of a sequence who looks at what. The people are also targets for each other.

    Parameters
    ----------
    settings
        Values of ``attention``, ``gaze_filter`` and ``tracking`` by dotted key, such as
        ``{"attention.method": "bayes"}``; ``vfoa settings`` prints every key. The method is that of ``vfoa run CLIP``
        if it is not given.

    Raises
    ------
    VfoaError
        If a key or a value is wrong, or the method needs later frames.

    Examples
    --------
    >>> follower = vfoa.MeasuredFollower({"attention.method": "cones", "attention.cones_deg": [20]})
    >>> anna = vfoa.Observed(eyes_m=[0, -0.4, 2], gaze=[0.5, 0.4, -1])
    >>> for look in follower.step({"anna": anna}, {"cup": [0.5, 0, 1]}):
    ...     print(look)
    anna looks at cup (attention 0.02), 1.19 m away
    """

    def __init__(self, settings: Mapping[str, Any] | None = None) -> None:
        tables = dotted_tables(
            {**METHOD_OF_CLIP, **(settings or {})}.items(), ("attention", "gaze_filter", "tracking"), "settings"
        )
        _, attend = read_steps(tables, None, "settings")
        check_immediate(attend)
        self._tracker, self._attending = Tracker(attend.tracking), Attending(attend)
        self._numbers: dict[str, int] = {}
        self._people: set[str] = set()
        self._frames = 0
        self._time_ns: int | None = None

    def step(
        self, people: Mapping[str, Observed], objects: Mapping[str, ArrayLike | Box3D], *, time_ns: int | None = None
    ) -> tuple[Look, ...]:
        """Say what each of the people looks at in the next frame, in their order.

        Parameters
        ----------
        people
            Everyone in the frame, by name.
        objects
            The other targets of the frame by name: a middle (3,), of which a cube of
            :data:`~vfoa.measured.POINT_SIZE_M` is made, a middle and the extents along the axes (2, 3), or a box. Under
            a person's name, it is the person's own box; without one, others look at the head.
        time_ns
            The frame's time, nanoseconds, as in :meth:`vfoa.estimator.Follower.step`.

        Raises
        ------
        VfoaError
            If a point, a direction or an extent is wrong: the name comes first; or if the time is not later than that
            of the frame before.
        """
        now_ns = time_of_frame(time_ns, self._time_ns)
        scene = self._scene(people, objects, now_ns)
        names = {number: name for name, number in self._numbers.items()}
        tracked = self._tracker.step(scene.people)
        subjects = {track: name for track, name in zip(tracked.ids, people, strict=True) if track is not None}
        (result,) = self._attending.step(scene, tracked, subjects)
        self._frames, self._time_ns = self._frames + 1, now_ns
        looks = {look.subject: look for look in looks_of(result, names)}
        return tuple(looks[name] for name in people)

    def _scene(self, people: Mapping[str, Observed], objects: Mapping[str, ArrayLike | Box3D], time_ns: int) -> Scene:
        """The frame as a scene; names get their numbers when they are first seen."""
        for what, table in (("people", people), ("objects", objects)):
            if not isinstance(table, Mapping):
                raise VfoaError(f"{what}: expected a mapping by name, found {type(table).__name__}")
            for name in table:
                if not (isinstance(name, str) and name):
                    raise VfoaError(f"{what}: expected names, texts that are not empty, found {name!r}")
                if name in (NOWHERE, IGNORED):
                    raise VfoaError(f"{what}: {name!r} is the label of no target; expected another name")
        boxes: dict[str, Box3D | None] = {}
        seen = []
        self._people |= people.keys()
        for name, observed in people.items():
            if not isinstance(observed, Observed):
                raise VfoaError(f"{name}: expected vfoa.Observed, found {type(observed).__name__}")
            with reported_as(name):
                seen.append(person := observed.person(self._number(name)))
            boxes[name] = None if person.eye_origin_left is None else box_of(person.eye_origin_left, HEAD_SIZE_M)
        for name, given in objects.items():
            with reported_as(name):
                boxes[name] = box_around(given)
        targets = (self._target(name, box) for name, box in boxes.items())
        in_order = tuple(sorted(targets, key=lambda target: target.instance.id))
        return Scene(index=self._frames, time_ns=time_ns, targets=in_order, people=tuple(seen))

    def _target(self, name: str, box: Box3D | None) -> Target:
        is_person = name in self._people
        return target_of(self._number(name), PERSON if is_person else name, int(not is_person), box)

    def _number(self, name: str) -> int:
        return self._numbers.setdefault(name, len(self._numbers) + 1)
