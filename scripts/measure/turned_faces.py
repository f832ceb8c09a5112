"""Models of gaze and head pose on faces that turn: the angle to the labelled head, and between an image and its mirror.

Photographs (``*.jpg``) may have labelled head poses in a ``pose.json`` beside them: ``yaw_deg`` (< 0 to the image's
right) and ``pitch_deg`` (> 0 up) by the photograph's name without its extension. Nobody labelled where these people
look, so the head stands in for it: eyes are 13 degrees off a head in the median. The weights are looked for as by
``vfoa models list``.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.report.formats import UNKNOWN, Table
from scripts.measure.mirror import frame_of, mirrored, mirrored_direction, mirrored_head, read_rgb
from scripts.measure.printing import print_tables
from vfoa.crops import center
from vfoa.gaze.adas import Adas0002
from vfoa.gaze.l2cs import L2cs
from vfoa.geometry import angle_between, direction_from_crop, pixel_ray
from vfoa.head_pose.fsanet import FsaNet
from vfoa.head_pose.tddfa_v2 import TddfaV2
from vfoa.heads.yunet import YuNet
from vfoa.types import Float, Gaze, Head, HeadPose, StereoFrame

Model = Callable[[StereoFrame, Head], "Float | None"]
"""Gives the direction (3,) of a head or its gaze, camera frame; None for no answer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """One model on one photograph, degrees. None: no answer, or no label.

    ``turned`` is from the direction to the camera, ``to_head`` from the labelled head, ``to_mirror`` from the mirrored
    answer for the mirrored photograph.
    """

    model: str
    turned: float
    to_head: float | None
    to_mirror: float | None


def measure(photograph: Path, models: Mapping[str, Model], faces: YuNet) -> tuple[float | None, list[Answer]]:
    """The labelled turn of the surest face of a photograph, and the answers of the models that have one."""
    frame = frame_of(read_rgb(photograph))
    head = surest(faces.faces(frame))
    face_box_px = head.box_px if head.face_box_px is None else head.face_box_px
    ray = pixel_ray(*center(face_box_px), frame.rig)
    in_crop = labelled_direction(photograph)
    label = None if in_crop is None else direction_from_crop(in_crop, ray)
    answers = []
    for name, model in models.items():
        direction = model(frame, head)
        in_mirror = model(mirrored(frame), mirrored_head(head, frame.rig.width_px))
        if direction is not None:
            other = None if in_mirror is None else mirrored_direction(in_mirror)
            answers.append(
                Answer(
                    model=name,
                    turned=degrees_between(direction, -ray),
                    to_head=None if label is None else degrees_between(direction, label),
                    to_mirror=None if other is None else degrees_between(direction, other),
                )
            )
    return None if label is None else degrees_between(label, -ray), answers


def labelled_direction(photograph: Path) -> Float | None:
    """Direction (3,) of the head in the axes of its crop by the ``pose.json`` beside a photograph; None without one."""
    path = photograph.with_name("pose.json")
    pose = json.loads(path.read_text(encoding="utf-8")).get(photograph.stem) if path.is_file() else None
    if pose is None:
        return None
    yaw, pitch = math.radians(pose["yaw_deg"]), math.radians(pose["pitch_deg"])
    return np.array([-math.sin(yaw), -math.sin(pitch) * math.cos(yaw), -math.cos(pitch) * math.cos(yaw)])


def surest(faces: Iterable[Head]) -> Head:
    """The face with the highest score."""
    return max(faces, key=lambda face: face.score)


def answers_of(models: Mapping[str, Model], frame: StereoFrame, head: Head) -> dict[str, Float]:
    """The answers of the models that have one for a head."""
    answers = {name: model(frame, head) for name, model in models.items()}
    return {name: direction for name, direction in answers.items() if direction is not None}


def turns_of(
    models: Mapping[str, Model], frame: StereoFrame, faces: YuNet, before: Mapping[str, Float]
) -> dict[str, float] | None:
    """The angle of each model's answer for the surest face to an answer of before, degrees; None: no face is found."""
    found = faces.faces(frame)
    if not found:
        return None
    now = answers_of(models, frame, surest(found))
    return {name: degrees_between(now[name], before[name]) for name in now if name in before}


def turns_row(label: str, turns: Sequence[Mapping[str, float] | None], names: Sequence[str]) -> tuple[str, ...]:
    """A row of a table: the faces that are found, and the mean turn of each model's answer."""
    seen = [of_face for of_face in turns if of_face is not None]
    of_models = ([of_face[name] for of_face in seen if name in of_face] for name in names)
    cells = (f"{np.mean(of_model):.1f}" if of_model else UNKNOWN for of_model in of_models)
    return (label, f"{len(seen)} of {len(turns)}", *cells)


def given_photographs(description: str | None) -> list[Path]:
    """The photographs that the command line names."""
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("photographs", type=Path, nargs="+", help="photographs of one face each")
    return list(parser.parse_args().photographs)


def degrees_between(a: Float, b: Float) -> float:
    """The angle between two directions (3,), degrees."""
    return math.degrees(angle_between(a, b))


def models() -> dict[str, Model]:
    """The models by name."""

    def of_gaze(model: L2cs | Adas0002) -> Model:
        def direction(frame: StereoFrame, head: Head) -> Float | None:
            gaze = model.estimate(frame, head, None)
            return gaze.direction if isinstance(gaze, Gaze) else None

        return direction

    def of_head(model: FsaNet | TddfaV2) -> Model:
        def direction(frame: StereoFrame, head: Head) -> Float | None:
            pose: HeadPose | None = model.estimate(frame, head)
            return pose.direction if pose else None

        return direction

    return {
        "MobileGaze, one crop": of_gaze(L2cs(L2cs.Settings(mirrored=False))),
        "MobileGaze, averaged": of_gaze(L2cs(L2cs.Settings())),
        "ADAS-0002": of_gaze(Adas0002(Adas0002.Settings())),
        "FSA-Net": of_head(FsaNet(FsaNet.Settings())),
        "3DDFA_V2": of_head(TddfaV2(TddfaV2.Settings())),
    }


def turned_faces_table(rows: Sequence[tuple[str, float | None, Answer]]) -> Table:
    """One row for each photograph and model: where it turns, and how far the answer is off."""

    def cell(value: float | None) -> str:
        return UNKNOWN if value is None else f"{value:.1f}"

    return Table(
        title="Faces that turn",
        columns=("photograph", "model", "labelled turn deg", "turn", "to the head", "to the mirror image"),
        rows=tuple(
            (name, answer.model, *map(cell, (turn, answer.turned, answer.to_head, answer.to_mirror)))
            for name, turn, answer in rows
        ),
        words=2,
    )


def main() -> None:
    """Measure the models on photographs and print a table."""
    photographs, known, faces = given_photographs(__doc__), models(), YuNet(YuNet.Settings())
    rows = []
    for photograph in photographs:
        turn, answers = measure(photograph, known, faces)
        rows += [(photograph.stem, turn, answer) for answer in answers]
    print_tables(turned_faces_table(rows))
