"""The four scenarios as plain data: seats, positions of objects, and looks.

Room frame: the origin on the floor under the camera, x right and y forward as the camera sees them, z up, metres.
People sit at the far side of a table 0.74 m high and face the camera (heading 180 degrees).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from harness.studio.material import Colour, Material
from harness.studio.people import Appearance

Point = tuple[float, float, float]
TABLE_HEIGHT_M = 0.74
MEAN_FIXATION_S = 0.68


@dataclass(frozen=True, slots=True, kw_only=True)
class Roll:
    """A ball that rolls to and fro: its centre swings by ``reach_m`` (x, y) with a period in seconds."""

    reach_m: tuple[float, float]
    period_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Thing:
    """A thing in the room. ``label`` is its COCO name and a key of :data:`harness.studio.things.THINGS`."""

    name: str
    id: int
    label: str
    at: Point
    colour: Colour
    heading_deg: float = 0.0
    roll: Roll | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ScriptedLook:
    """One fixation of a script.

    ``at`` names a thing or a person, or is a point in the room where nothing stands. ``head_at`` is the target of the
    head, if it differs, and the head turns to it completely; without it the head follows the gaze by the actor's share.
    """

    at: str | Point
    head_at: str | Point | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Actor:
    """A person: their seat (on the floor), their heading, and their looks one after the other, repeated."""

    name: str
    id: int
    at: Point
    heading_deg: float
    appearance: Appearance
    script: tuple[ScriptedLook, ...]
    head_share: float = 0.65


@dataclass(frozen=True, slots=True, kw_only=True)
class Scenario:
    """Everything that decides a clip except its length and its seed.

    ``mean_fixation_s`` is the mean time of a look at one target; single fixations last from 0.7 to 4.4 times that.
    """

    rate_hz: float
    things: tuple[Thing, ...]
    actors: tuple[Actor, ...]
    cloth: Material
    wall: Colour
    curtain: tuple[Colour, Colour]
    mean_fixation_s: float = MEAN_FIXATION_S


ScenarioName = Literal["table", "talk", "split", "crowd"]

CAMERA: Point = (0.0, 0.0, 1.25)
"""The camera as a point to look at; it is no object of the scene."""

_Z = TABLE_HEIGHT_M
_OAK = Material(
    colours=((0.62, 0.44, 0.27), (0.56, 0.38, 0.22), (0.66, 0.48, 0.31)), pattern="wood", scale_m=0.16, grain=0.08
)
_GINGHAM = Material(
    colours=((0.93, 0.92, 0.88), (0.78, 0.45, 0.42), (0.68, 0.2, 0.2)), pattern="checks", scale_m=0.045, grain=0.04
)
_SLATE = Material(
    colours=((0.36, 0.4, 0.42), (0.32, 0.36, 0.38), (0.4, 0.44, 0.46)), pattern="wood", scale_m=0.2, grain=0.1
)

_ANNA = Appearance(
    skin=(0.9, 0.72, 0.6),
    hair=(0.36, 0.2, 0.1),
    shirt=Material(colours=((0.13, 0.38, 0.45), (0.18, 0.46, 0.53)), pattern="blotches", scale_m=0.02, grain=0.12),
    iris=(0.25, 0.4, 0.3),
    long_hair=True,
)
_BEN = Appearance(
    skin=(0.55, 0.37, 0.26),
    hair=(0.08, 0.06, 0.06),
    shirt=Material(colours=((0.85, 0.62, 0.25), (0.78, 0.52, 0.18)), pattern="stripes", scale_m=0.03, grain=0.1),
)
_CARA = Appearance(
    skin=(0.94, 0.78, 0.67),
    hair=(0.72, 0.5, 0.24),
    shirt=Material(colours=((0.62, 0.22, 0.28), (0.55, 0.17, 0.23)), pattern="blotches", scale_m=0.03, grain=0.12),
    iris=(0.25, 0.38, 0.55),
    long_hair=True,
)
_RED: Colour = (0.78, 0.2, 0.16)
_BLUE: Colour = (0.18, 0.36, 0.68)
_GREEN: Colour = (0.16, 0.42, 0.26)
_YELLOW: Colour = (0.93, 0.78, 0.22)
_BROWN: Colour = (0.55, 0.36, 0.2)
_STEEL: Colour = (0.66, 0.68, 0.7)
_CLAY: Colour = (0.72, 0.4, 0.27)

SCENARIOS: dict[ScenarioName, Scenario] = {
    "table": Scenario(
        rate_hz=20,
        cloth=_OAK,
        wall=(0.8, 0.8, 0.76),
        curtain=((0.35, 0.5, 0.55), (0.75, 0.8, 0.78)),
        things=(
            Thing(name="laptop", id=2, label="laptop", at=(-0.62, 1.52, _Z), heading_deg=150, colour=_STEEL),
            Thing(name="mug", id=3, label="cup", at=(-0.24, 1.24, _Z), heading_deg=200, colour=_RED),
            Thing(name="book", id=4, label="book", at=(0.13, 1.22, _Z), heading_deg=12, colour=_GREEN),
            Thing(name="bottle", id=5, label="bottle", at=(0.46, 1.36, _Z), colour=_GREEN),
            Thing(name="vase", id=6, label="vase", at=(0.74, 1.66, _Z), colour=_BLUE),
        ),
        actors=(
            Actor(
                name="anna",
                id=1,
                at=(0.0, 1.86, 0.0),
                heading_deg=180,
                appearance=_ANNA,
                script=tuple(ScriptedLook(at=at) for at in ("mug", "vase", CAMERA, "laptop", "book", "bottle")),
            ),
        ),
    ),
    "talk": Scenario(
        rate_hz=20,
        cloth=_GINGHAM,
        wall=(0.83, 0.78, 0.7),
        curtain=((0.62, 0.36, 0.3), (0.85, 0.74, 0.6)),
        things=(
            Thing(name="mug", id=3, label="cup", at=(-0.42, 1.28, _Z), heading_deg=160, colour=_BLUE),
            Thing(name="bear", id=4, label="teddy bear", at=(0.02, 1.46, _Z), colour=_BROWN),
            Thing(name="bowl", id=5, label="bowl", at=(0.38, 1.24, _Z), colour=_GREEN),
            Thing(name="plant", id=6, label="potted plant", at=(-0.92, 1.64, _Z), colour=_CLAY),
        ),
        actors=(
            Actor(
                name="anna",
                id=1,
                at=(-0.5, 1.84, 0.0),
                heading_deg=208,
                appearance=_ANNA,
                script=tuple(ScriptedLook(at=at) for at in ("ben", "mug", "bear", CAMERA, "ben", "bear")),
            ),
            Actor(
                name="ben",
                id=2,
                at=(0.52, 1.84, 0.0),
                heading_deg=152,
                appearance=_BEN,
                script=tuple(ScriptedLook(at=at) for at in ("bear", "anna", CAMERA, "bowl", "anna", "bear", "bowl")),
            ),
        ),
    ),
    "split": Scenario(
        rate_hz=20,
        cloth=_SLATE,
        wall=(0.74, 0.78, 0.8),
        curtain=((0.78, 0.72, 0.45), (0.5, 0.5, 0.34)),
        things=(
            Thing(name="clock", id=2, label="clock", at=(-0.66, 1.5, _Z), heading_deg=140, colour=_BROWN),
            Thing(name="banana", id=3, label="banana", at=(-0.26, 1.22, _Z), heading_deg=20, colour=_YELLOW),
            Thing(name="mug", id=4, label="cup", at=(0.16, 1.24, _Z), heading_deg=20, colour=_YELLOW),
            Thing(name="bottle", id=5, label="bottle", at=(0.45, 1.4, _Z), colour=_BLUE),
            Thing(name="plant", id=6, label="potted plant", at=(0.8, 1.64, _Z), colour=_CLAY),
        ),
        actors=(
            Actor(
                name="ben",
                id=1,
                at=(0.0, 1.86, 0.0),
                heading_deg=180,
                appearance=_BEN,
                script=(
                    ScriptedLook(at="mug", head_at="banana"),
                    ScriptedLook(at="bottle", head_at="mug"),
                    ScriptedLook(at="banana", head_at="mug"),
                    ScriptedLook(at=CAMERA, head_at=(-0.9, 0.3, 1.15)),
                    ScriptedLook(at="clock", head_at="banana"),
                    ScriptedLook(at="plant", head_at="bottle"),
                ),
            ),
        ),
    ),
    "crowd": Scenario(
        rate_hz=25,
        cloth=_OAK,
        wall=(0.72, 0.76, 0.7),
        curtain=((0.3, 0.36, 0.5), (0.7, 0.7, 0.66)),
        things=(
            Thing(name="plant", id=4, label="potted plant", at=(-1.02, 1.62, _Z), colour=_CLAY),
            Thing(name="bottle", id=5, label="bottle", at=(-0.63, 1.36, _Z), colour=_BLUE),
            Thing(name="mug", id=6, label="cup", at=(-0.31, 1.22, _Z), heading_deg=200, colour=_RED),
            Thing(name="bowl", id=7, label="bowl", at=(-0.15, 1.38, _Z), colour=_BLUE),
            Thing(
                name="ball",
                id=8,
                label="sports ball",
                at=(0.08, 1.2, _Z + 0.075),
                colour=(0.92, 0.45, 0.12),
                roll=Roll(reach_m=(0.07, 0.015), period_s=4.0),
            ),
            Thing(name="banana", id=9, label="banana", at=(0.32, 1.45, _Z), heading_deg=-20, colour=_YELLOW),
            Thing(name="book", id=10, label="book", at=(0.5, 1.22, _Z), heading_deg=-15, colour=_GREEN),
            Thing(name="clock", id=11, label="clock", at=(0.8, 1.4, _Z), heading_deg=190, colour=_BROWN),
        ),
        actors=(
            Actor(
                name="anna",
                id=1,
                at=(-0.74, 1.88, 0.0),
                heading_deg=195,
                appearance=_ANNA,
                script=tuple(ScriptedLook(at=at) for at in ("bottle", "mug", CAMERA, "ben", "bowl")),
            ),
            Actor(
                name="ben",
                id=2,
                at=(0.02, 1.94, 0.0),
                heading_deg=180,
                appearance=_BEN,
                script=tuple(ScriptedLook(at=at) for at in ("ball", "banana", "cara", "bowl", CAMERA, "book")),
            ),
            Actor(
                name="cara",
                id=3,
                at=(0.84, 1.88, 0.0),
                heading_deg=160,
                appearance=_CARA,
                script=tuple(ScriptedLook(at=at) for at in ("book", "ball", "clock", "ben", CAMERA, "banana")),
            ),
        ),
    ),
}
