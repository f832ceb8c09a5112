"""Randomly drawn scenes for measuring attention, with known targets and set errors of the directions.

Two generators that share no distribution, so that settings can be tuned on one and tested on the other:

room     objects anywhere in front of a person, exponential looks, normal errors of which a part drifts
table    people and objects around a table and on a wall, log-normal looks, von Mises-Fisher or Student errors

Both return a :class:`Sequence`: arrays of directions and labels of one person, in the camera frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from vfoa.geometry import angle_between, perturb, unit
from vfoa.types import Float

Generator = Literal["room", "table"]
NOWHERE = -1
"""Label of a frame in which the person looks at none of the objects."""

_STUDENT_MEAN = float(np.sqrt(3.0))
"""Mean length of a two-dimensional Student variable with three degrees of freedom and unit scale."""

_LEAST_MISS_RAD = float(np.deg2rad(8.0))
"""A person who looks at nothing looks at least this far past the middle of every object."""

Labels = NDArray[np.intp]


@dataclass(frozen=True, slots=True, kw_only=True)
class Errors:
    """Errors of the directions of a sequence: mean angles in degrees, and ``gain`` towards the camera.

    ``gaze_deg`` and ``head_deg`` are the mean angles of the errors of single frames. ``bias_deg`` turns every gaze of
    the person by the same angle, and every head direction by a third of it. ``gain`` is the factor that remains of the
    angle between a direction and the direction to the camera, for gaze and head alike.
    """

    gaze_deg: float = 11.1
    head_deg: float = 5.0
    bias_deg: float = 0.0
    gain: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class _Scene:
    """The objects that a person sees, and how the head follows: its share of the way, pace per frame, and offset."""

    eyes: Float
    objects: Float
    radii_m: Float
    ahead: Float
    share: float
    pace: float
    aside_deg: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Sequence:
    """One person over N frames: eyes (3,), objects (T, 3) with radii (T,) in metres, measured directions (N, 3).

    ``label`` (N,) is the row of the object that is looked at, :data:`NOWHERE` for none. ``time_s`` (N,) is in seconds.
    """

    eyes: Float
    objects: Float
    radii_m: Float
    time_s: Float
    label: Labels
    gaze: Float
    head: Float


def draw_sequence(generator: Generator, errors: Errors, rng: np.random.Generator, n_frames: int = 300) -> Sequence:
    """Draw one person in one scene."""
    draw = _room if generator == "room" else _table
    return draw(errors, rng, n_frames)


def _room(errors: Errors, rng: np.random.Generator, n_frames: int) -> Sequence:
    """Objects anywhere in a field of 100 by 50 degrees before the person; normal errors with a drifting part."""
    rate_hz = float(rng.choice([12.5, 25.0]))
    eyes = np.array([rng.uniform(-1, 1), rng.uniform(-0.3, 0.2), rng.uniform(1.5, 3.5)])
    ahead = perturb(unit(-eyes), *np.deg2rad(rng.normal(0, [25, 5])))
    count = int(rng.integers(3, 8))
    directions = perturb(ahead, *np.deg2rad(rng.uniform([[-50], [-20]], [[50], [30]], (2, count))))
    distance = rng.uniform(0.6, 2.5, count)
    objects = eyes + directions * distance[:, None]
    radii = rng.uniform(0.04, 0.2, count)
    leave = 1 / (rng.uniform(0.6, 3.0) * rate_hz)
    nowhere = rng.uniform(0, 0.3)
    label = np.empty(n_frames, dtype=np.intp)
    now = _pick(rng, count, nowhere)
    for frame in range(n_frames):
        if frame and rng.random() < leave:
            now = _pick(rng, count, nowhere)
        label[frame] = now
    share, pace = rng.uniform(0.3, 0.9), rng.uniform(0.08, 0.25)
    aside_deg = rng.uniform(3, 9)
    scene = _Scene(eyes=eyes, objects=objects, radii_m=radii, ahead=ahead, share=share, pace=pace, aside_deg=aside_deg)
    head, aim = _look(label, scene, rng)
    noisy = []
    for true, error_deg, bias_deg in ((aim, errors.gaze_deg, errors.bias_deg), (head, errors.head_deg, 0.0)):
        sigma = np.deg2rad(error_deg) / np.sqrt(np.pi / 2)
        drift = _drift(rng, n_frames, np.exp(-1 / rng.uniform(8, 30)))
        part = rng.uniform(0.1, 0.6)
        noise = sigma * (np.sqrt(part) * drift + np.sqrt(1 - part) * rng.normal(size=(2, n_frames)))
        noisy.append(perturb(_shrunk(true, eyes, errors.gain), *(noise + _constant(rng, bias_deg))))
    time_s = np.arange(n_frames) / rate_hz
    gaze, head = noisy
    return Sequence(eyes=eyes, objects=objects, radii_m=radii, time_s=time_s, label=label, gaze=gaze, head=head)


def _table(errors: Errors, rng: np.random.Generator, n_frames: int) -> Sequence:
    """A person at a table with the camera opposite: other people around it, things on the table and on the walls."""
    rate_hz = float(rng.choice([10.0, 15.0]))
    eyes = np.array([rng.uniform(-0.7, 0.7), 0.0, rng.uniform(1.2, 2.2)])
    seats = rng.permutation([[-1.1, 0.0, 1.2], [1.1, 0.0, 1.2], [-0.6, 0.0, 0.5], [0.7, 0.0, 0.4]])
    things = np.column_stack([rng.uniform(-0.6, 0.6, 4), np.full(4, 0.45), rng.uniform(0.6, 1.1, 4)])
    walls = np.column_stack([rng.uniform(-2.5, 2.5, 3), rng.uniform(-0.8, 0.1, 3), rng.uniform(-1.5, 0.5, 3)])
    people, on_table, on_wall = int(rng.integers(1, 4)), int(rng.integers(1, 3)), int(rng.integers(0, 3))
    objects = np.vstack([seats[:people], things[:on_table], walls[:on_wall]]) + rng.normal(
        0, 0.05, (people + on_table + on_wall, 3)
    )
    radii = np.concatenate([np.full(people, 0.09), np.full(on_table, 0.06), np.full(on_wall, 0.25)])
    liking = rng.gamma(2.0, size=len(objects))
    median_s = rng.uniform(0.8, 1.7)
    nowhere = rng.uniform(0, 0.4)
    label = np.empty(0, dtype=np.intp)
    now = NOWHERE - 1
    while len(label) < n_frames:
        choice = NOWHERE if rng.random() < nowhere else int(rng.choice(len(objects), p=liking / liking.sum()))
        if choice == now:
            continue
        now = choice
        frames = max(2, round(rate_hz * median_s * float(np.exp(rng.normal(0, 1.0)))))
        label = np.concatenate([label, np.full(frames, now)])
    label = label[:n_frames]
    ahead = unit(objects.mean(axis=0) - eyes)
    share = rng.uniform(0.35, 0.95)
    pace = 1 - float(np.exp(-1 / (rate_hz * 0.3)))
    scene = _Scene(eyes=eyes, objects=objects, radii_m=radii, ahead=ahead, share=share, pace=pace, aside_deg=6.0)
    head, aim = _look(label, scene, rng)
    student = rng.random() < 0.5
    noisy = []
    for true, error_deg, bias_deg in (
        (aim, errors.gaze_deg, errors.bias_deg),
        (head, errors.head_deg, errors.bias_deg / 3),
    ):
        noise = _student(rng, n_frames, error_deg) if student else _von_mises_fisher(rng, n_frames, error_deg)
        biased = perturb(_shrunk(true, eyes, errors.gain), *_constant(rng, bias_deg))
        noisy.append(perturb(biased, *noise))
    time_s = np.arange(n_frames) / rate_hz
    gaze, head = noisy
    return Sequence(eyes=eyes, objects=objects, radii_m=radii, time_s=time_s, label=label, gaze=gaze, head=head)


def _pick(rng: np.random.Generator, count: int, nowhere: float) -> int:
    return NOWHERE if rng.random() < nowhere else int(rng.integers(count))


def _look(label: Labels, scene: _Scene, rng: np.random.Generator) -> tuple[Float, Float]:
    """True head and gaze directions (N, 3): the gaze rests anywhere on an object, the head follows a share of it."""
    heads, gazes = [], []
    head = goal = scene.ahead
    gaze: Float | None = None
    for frame, current in enumerate(label.tolist()):
        if frame == 0 or current != label[frame - 1]:
            goal, gaze = _fixation(current, scene, rng)
        head = goal if frame == 0 else unit(head + scene.pace * (goal - head))
        # eyes that look at nothing move about where the head points, and rest on no object
        if gaze is None or (current == NOWHERE and rng.random() < 0.1):
            gaze = _off_objects(head, scene, rng)
        heads.append(head)
        gazes.append(gaze)
    return np.array(heads), np.array(gazes)


def _fixation(current: int, scene: _Scene, rng: np.random.Generator) -> tuple[Float, Float | None]:
    """The head's goal (3,) and the gaze (3,) of a new look; the gaze is None for a look at nothing."""
    aside = np.deg2rad(scene.aside_deg) * rng.normal(size=2)
    if current == NOWHERE:
        return perturb(scene.ahead, *np.deg2rad(rng.normal(0, [30, 15]))), None
    # uniform over the visible disc of the object
    towards = scene.objects[current] - scene.eyes
    turn, reach = rng.uniform(0, 2 * np.pi), 0.9 * scene.radii_m[current] / np.linalg.norm(towards)
    reach *= np.sqrt(rng.random())
    gaze = perturb(unit(towards), reach * np.cos(turn), reach * np.sin(turn))
    angle = float(angle_between(scene.ahead, gaze))
    way = np.sin((1 - scene.share) * angle) * scene.ahead + np.sin(scene.share * angle) * gaze
    return perturb(unit(way), *aside), gaze


def _off_objects(head: Float, scene: _Scene, rng: np.random.Generator) -> Float:
    """A gaze (3,) about the head, on no object."""
    towards = scene.objects - scene.eyes
    wide = np.maximum(np.arctan2(scene.radii_m, np.linalg.norm(towards, axis=1)), _LEAST_MISS_RAD)
    for _ in range(20):
        gaze = perturb(head, *np.deg2rad(rng.normal(0, 16, 2)))
        if (angle_between(towards, gaze) > wide).all():
            break
    return gaze


def _shrunk(directions: Float, eyes: Float, gain: float) -> Float:
    """Directions (N, 3) turned towards the camera: the factor ``gain`` remains of the angle."""
    camera = unit(-eyes)
    angle = np.maximum(angle_between(camera, directions), 1e-9)[:, None]
    return unit(np.sin((1 - gain) * angle) * camera + np.sin(gain * angle) * directions)


def _constant(rng: np.random.Generator, bias_deg: float) -> Float:
    turn = rng.uniform(0, 2 * np.pi)
    return np.deg2rad(bias_deg) * np.array([[np.cos(turn)], [np.sin(turn)]])


def _drift(rng: np.random.Generator, n_frames: int, keep: float) -> Float:
    """A stationary first-order autoregressive process (2, N) of variance 1."""
    drift = np.empty((2, n_frames))
    drift[:, 0] = rng.normal(size=2)
    for frame in range(1, n_frames):
        drift[:, frame] = keep * drift[:, frame - 1] + np.sqrt(1 - keep**2) * rng.normal(size=2)
    return drift


def _student(rng: np.random.Generator, n_frames: int, error_deg: float) -> Float:
    """Turns (2, N) of a two-dimensional Student distribution with three degrees of freedom and this mean angle."""
    raw = rng.normal(size=(2, n_frames)) / np.sqrt(rng.chisquare(3, n_frames) / 3)
    return raw * np.deg2rad(error_deg) / _STUDENT_MEAN


def _von_mises_fisher(rng: np.random.Generator, n_frames: int, error_deg: float) -> Float:
    """Turns (2, N) with angles of a von Mises-Fisher distribution of about this mean angle."""
    kappa = np.pi / 2 / np.deg2rad(error_deg) ** 2  # Rayleigh: mean = sigma sqrt(pi / 2), kappa = 1 / sigma^2
    cosine = 1 + np.log(rng.random(n_frames) * (1 - np.exp(-2 * kappa)) + np.exp(-2 * kappa)) / kappa
    angle, turn = np.arccos(np.clip(cosine, -1, 1)), rng.uniform(0, 2 * np.pi, n_frames)
    return np.stack([angle * np.cos(turn), angle * np.sin(turn)])
