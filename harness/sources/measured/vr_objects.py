"""People who look at ten objects in a virtual room (github.com/ischtz/jov2023-vr-objects; read, not used).

Schuetz, Baltaretu and Fiehler, Journal of Vision 24(7):10, 2024, MIT. One session of one person is a folder::

    data/kitchen_laser/9/S003/trial_results.csv             a row for each trial: target and its box, phases
    data/kitchen_laser/9/S003/trackers/VR_move_T001.csv     90 Hz: head_pos_* (m), head_rot_* (degrees)
    data/kitchen_laser/9/S003/trackers/Eye_gaze_T001.csv    dir_*: gaze in the head; gaze_*, gaze_object: its hit

Unity's axes are left-handed with y up, and a rotation is Ry Rx Rz; here y is negated. The frames are the first samples
of each tenth of a second of the previews, in which all things are in place, and of the responses, in which the trial's
target is missing. Between them are gaps in time.

The number of things tells the phase, and with it nearly the answer: in previews half of the frames are looks at one of
the ten, in responses 1 % at one of the nine. A method that counts targets learns that, and nothing about people. The
manifests call the two phases search and answer, and tables have the rates of each.

The head is the cue. The gaze is ground truth, and so is its target: the thing whose collider it hits, ``none`` for
another collider; unknown for an invalid gaze, a copy of a thing, a cursor, and a look under 0.1 s.
"""

from __future__ import annotations

import itertools
import operator
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from harness.files.digests import digest_files
from harness.files.tables import TableColumns, read_columns
from harness.sources import Recognised, given_root
from harness.sources.measured.clip import (
    FramesOfMeasurements,
    MeasuredFrame,
    MeasuredObject,
    MeasuredPerson,
    MeasuredSettings,
)
from vfoa.errors import VfoaError, located, reported_as
from vfoa.geometry import unit
from vfoa.types import Float, HeadPose

RATE_HZ = 10
SHORTEST_LOOK_S = 0.1
NOWHERE = "none"
_INVALID_M = -9000.0
"""A point of the gaze below this is not valid: upstream writes -99999."""
_FLIP = np.array([1.0, -1.0, 1.0])
_PHASES = (("t_scene_preview_start", "t_scene_preview_end"), ("t_response_start", "t_response_end"))
_COPY = re.compile("clone|cursor", re.IGNORECASE)


def _of(what: str, axes: str = "xyz") -> tuple[str, ...]:
    return tuple(f"{what}_{axis}" for axis in axes)


_BOX = (*_of("target_bbox_center"), *_of("target_bbox_size"))


class VrObjectsSettings(MeasuredSettings):
    """The first trials of a session; those whose trackers are not here are left out, and a note says which."""

    trials: int = Field(default=20, ge=1)


@dataclass(frozen=True, slots=True, kw_only=True)
class Trial:
    """One trial's samples: times (n,) s, and in this project's axes the head, its direction and the gaze (n, 3).

    ``hits`` (n, 3) are the points that the gaze hits, m, NaN where it is not valid; ``colliders`` their names, blank
    there. ``phases`` are the preview and the response as slices of the samples; ``target`` is missing in the response.
    """

    number: int
    target: str
    times_s: Float
    heads_m: Float
    directions: Float
    gazes: Float
    hits: Float
    colliders: tuple[str, ...]
    phases: tuple[slice, slice]


class VrObjectsClip(FramesOfMeasurements):
    """A clip from one person's session; the root is its folder."""

    Settings = VrObjectsSettings

    def __init__(self, settings: VrObjectsSettings, root: Path | None) -> None:
        folder = given_root(root)
        results = folder / "trial_results.csv"
        columns = _table(results, ("ppid", "trial_num", "target", "target_label", *itertools.chain(*_PHASES), *_BOX))
        things = _things(columns, settings)
        numbers = {row: int(text) for row, text in enumerate(columns.cells["trial_num"]) if text.isdigit()}
        chosen = {row: number for row, number in numbers.items() if number <= settings.trials}
        here = [row for row, number in chosen.items() if all(path.is_file() for path in _trackers(folder, number))]
        absent = [number for row, number in chosen.items() if row not in here]
        if not here:
            raise VfoaError(
                f"{folder / 'trackers'}: no trial from 1 to {settings.trials}; expected VR_move_T001.csv ..."
            )
        self.trials = tuple(read_trial(folder, columns, row) for row in here)
        self.notes = (f"trials without trackers here: {', '.join(map(str, absent))}",) if absent else ()
        files = [path for trial in self.trials for path in _trackers(folder, trial.number)]
        super().__init__(
            dict(enumerate(_frames(self.trials, things, f"p{columns.cells['ppid'][0]}"), start=1)),
            settings.fixed_objects(),
            settings,
            str(folder),
            digest_files([("results", results), *(("tracker", path) for path in files)]),
        )

    @classmethod
    def recognise(cls, path: Path, given: Mapping[str, Any]) -> tuple[Recognised, ...]:
        """Recognise the folder of one person's session."""
        if not (path / "trial_results.csv").is_file() or not (path / "trackers").is_dir():
            return ()
        return (
            Recognised(
                root=path,
                source={},
                layout="a session of vr-objects: head, true gaze and boxes of objects",
                name="_".join((path.parent.parent.name, f"p{path.parent.name}")),
                calibration="not needed",
                licence="MIT",
            ),
        )


def read_trial(folder: Path, results: TableColumns, row: int) -> Trial:
    """Read the trial in a row of the results.

    Raises
    ------
    VfoaError
        If a tracker's file is missing or damaged, or the two differ in their times: file, line, found, expected.
    """
    number = int(results.cells["trial_num"][row])
    move, eye = _trackers(folder, number)
    heads = _table(move, ("time", *_of("head_pos"), *_of("head_rot")))
    gazes = _table(eye, ("time", *_of("dir"), *_of("gaze"), "gaze_object"))
    times_s = _numbers(gazes, ("time",))[:, 0]
    if not np.array_equal(times_s, _numbers(heads, ("time",))[:, 0]):
        raise VfoaError(f"{eye}: its times are not those of {move.name}; expected the same in both")
    rotations = Rotation.from_euler("YXZ", _numbers(heads, _of("head_rot", "yxz")), degrees=True)
    hits = _numbers(gazes, _of("gaze")) * _FLIP
    hits[hits[:, 0] < _INVALID_M] = np.nan
    with reported_as(results.where(row)):
        bounds_s = [[float(results.cells[edge][row]) for edge in phase] for phase in _PHASES]
    return Trial(
        number=number,
        target=results.cells["target"][row],
        times_s=times_s,
        heads_m=_numbers(heads, _of("head_pos")) * _FLIP,
        directions=rotations.apply([0.0, 0.0, 1.0]) * _FLIP,
        gazes=rotations.apply(_numbers(gazes, _of("dir"))) * _FLIP,
        hits=hits,
        colliders=tuple(
            "" if np.isnan(hit) else name for hit, name in zip(hits[:, 0], gazes.cells["gaze_object"], strict=True)
        ),
        phases=(_between(times_s, *bounds_s[0]), _between(times_s, *bounds_s[1])),
    )


def _frames(trials: Sequence[Trial], things: Mapping[str, MeasuredObject], person: str) -> Iterator[MeasuredFrame]:
    phases = ((trial, phase) for trial in trials for phase in trial.phases if phase.start < phase.stop)
    start_s = next((float(trial.times_s[phase.start]) for trial, phase in phases), 0.0)
    names = {key: thing.name for key, thing in things.items()}
    last = -1
    for trial in trials:
        in_response = tuple(thing for key, thing in things.items() if key != trial.target)
        for phase, objects in zip(trial.phases, (tuple(things.values()), in_response), strict=True):
            targets = looked_at(trial.times_s[phase], trial.colliders[phase], names)
            times_s = trial.times_s[phase] - start_s
            tenths = (times_s * RATE_HZ).astype(int)
            for place in np.flatnonzero(np.diff(tenths, prepend=last)):
                sample = phase.start + place
                person_then = MeasuredPerson(
                    name=person,
                    eyes_m=trial.heads_m[sample],
                    head_pose=HeadPose(direction=unit(trial.directions[sample])),
                    true_gaze=unit(trial.gazes[sample]) if trial.colliders[sample] else None,
                    true_target=targets[place],
                )
                yield MeasuredFrame(time_ns=round(1e9 * times_s[place]), people=(person_then,), objects=objects)
            last = int(tenths[-1]) if len(tenths) else last


def looked_at(times_s: Float, colliders: Sequence[str], things: Mapping[str, str]) -> list[str | None]:
    """The target of each sample of one phase, from the collider that it hits; None: not known.

    ``things`` are names by upstream's id (``K01_L15``), with which the names of a thing's colliders begin.
    """
    sample_targets = [_target(name, things) for name in colliders]
    targets: list[str | None] = []
    for target, samples in itertools.groupby(range(len(sample_targets)), key=sample_targets.__getitem__):
        first, *rest = samples
        last = rest[-1] if rest else first
        is_long = times_s[last] - times_s[first] >= SHORTEST_LOOK_S
        targets += [target if is_long else None] * (last - first + 1)
    return targets


def _target(collider: str, things: Mapping[str, str]) -> str | None:
    if not collider or _COPY.search(collider):
        return None
    return next((name for key, name in things.items() if f"{collider}_".startswith(f"{key}_")), NOWHERE)


def _things(results: TableColumns, settings: MeasuredSettings) -> dict[str, MeasuredObject]:
    """The boxes of all things by upstream's id, in its order: every thing is the target of some trial."""
    columns = results.cells["target"], results.cells["target_label"], _numbers(results, _BOX)
    with located(results.path):
        return {
            key: MeasuredObject(name=name, category=name, box=settings.box(box[:3] * _FLIP, box[3:]))
            for key, name, box in sorted(zip(*columns, strict=True), key=operator.itemgetter(0))
        }


def _trackers(folder: Path, trial: int) -> tuple[Path, Path]:
    place = folder / "trackers"
    return place / f"VR_move_T{trial:03}.csv", place / f"Eye_gaze_T{trial:03}.csv"


def _between(times_s: Float, first_s: float, last_s: float) -> slice:
    return slice(int(np.searchsorted(times_s, first_s)), int(np.searchsorted(times_s, last_s, side="right")))


def _table(path: Path, names: Sequence[str]) -> TableColumns:
    """Some columns of a table with a header and at least one row; others are not read."""
    table = read_columns(path, None, names)
    if not table.lines:
        raise VfoaError(f"{path}: no row below the header; expected at least one")
    return table


def _numbers(table: TableColumns, names: Sequence[str]) -> Float:
    """Columns as finite numbers (n, columns)."""
    numbers = table.group(names)
    for row in np.flatnonzero(np.isnan(numbers).any(axis=1))[:1]:
        raise VfoaError(f"{table.where(int(row))}: found nothing; expected numbers in {', '.join(names)}")
    return numbers
